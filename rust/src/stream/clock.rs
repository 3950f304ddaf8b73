//! The device's clock, 60 MHz modulo 2³², to nanoseconds that never wrap.

use crate::kinect::packet::TICKS_PER_SECOND;

/// How far the device's time may be from what the times of arrival say, before the two are no longer tied together by it, ticks.
const TRUSTED: i64 = TICKS_PER_SECOND as i64;

/// Counts the clock's wraps (every 71.6 s), by the time of arrival also those that fall into a gap.
#[derive(Clone, Copy, Debug, Default)]
pub struct Clock {
    /// Unwrapped ticks that were seen at a time of arrival, ns.
    tie: Option<(i64, i64)>,
    /// What is added to the device's readings.
    offset: u32,
    /// The device's clock began anew: the next reading may be anything.
    anew: bool,
}

impl Clock {
    /// The stamp, in ns, of `ticks` read from a frame that arrived at `arrival_ns`: unwrapped from the first reading, not rebased,
    /// × 50/3, rounded. Of all counts of wraps, the one nearest to the time of arrival: right while device and host agree to 35 s
    /// over the time since the last reading. Wild readings, over 1 s from where they should be, don't count: the time of arrival does.
    pub fn stamp_ns(&mut self, ticks: u32, arrival_ns: i64) -> i64 {
        let mut ticks = ticks.wrapping_add(self.offset);
        let (unwrapped, expected) = match self.tie {
            None => (i64::from(ticks), i64::from(ticks)),
            Some((tied_ticks, tied_ns)) => {
                let expected = expected(tied_ticks, arrival_ns.saturating_sub(tied_ns));
                if core::mem::take(&mut self.anew) {
                    self.offset = self.offset.wrapping_add((expected as u32).wrapping_sub(ticks));
                    ticks = expected as u32;
                }
                (nearest(ticks, expected), expected)
            }
        };
        if unwrapped.saturating_sub(expected).abs() >= TRUSTED {
            return stamp(expected);
        }
        self.tie = Some((unwrapped, arrival_ns));
        stamp(unwrapped)
    }

    /// The device was away: by the times of arrival its next reading goes on where the one before was, whatever it says.
    pub fn begin_anew(&mut self) {
        self.anew = true;
    }
}

/// The unwrapped reading `elapsed_ns` after an unwrapped one, by the host's clock.
pub fn expected(ticks: i64, elapsed_ns: i64) -> i64 {
    ticks.saturating_add((elapsed_ns / 50).saturating_mul(3))
}

/// Of all that the clock reads as `ticks`, the unwrapped reading nearest to `expected`.
pub fn nearest(ticks: u32, expected: i64) -> i64 {
    let off = ticks.wrapping_sub(expected as u32) as i32;
    expected.saturating_add(off.into())
}

/// Ticks × 50/3, to the nearest (thirds are never halfway), ns; `None` where they are too many for that.
pub fn nanoseconds(ticks: i64) -> Option<i64> {
    i64::try_from((i128::from(ticks) * 50 + 1).div_euclid(3)).ok()
}

fn stamp(ticks: i64) -> i64 {
    nanoseconds(ticks).unwrap_or(if ticks < 0 { i64::MIN } else { i64::MAX })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const SECOND: i64 = 1_000_000_000;

    #[test]
    fn ticks_are_rounded_to_nanoseconds() {
        for (ticks, ns) in
            [(0, 0), (1, 17), (2, 33), (3, 50), (60_000_000, SECOND), (-1, -17), (-2, -33), (i64::MAX, i64::MAX), (i64::MIN, i64::MIN)]
        {
            assert_eq!(stamp(ticks), ns, "{ticks}");
        }
    }

    #[test]
    fn a_wild_reading_passes() {
        for bit in 0..32 {
            let mut clock = Clock::default();
            let read = |clock: &mut Clock, ticks, at| clock.stamp_ns(ticks, at);
            assert_eq!(read(&mut clock, 6_000_000, 5), SECOND / 10);
            let wild = read(&mut clock, 0x007a_1200 ^ 1 << bit, 5 + SECOND / 30);
            assert!((wild - SECOND * 2 / 15).abs() < 600_000_000, "bit {bit}: {wild}");
            assert_eq!(read(&mut clock, 12_000_000, 5 + SECOND / 10), SECOND / 5, "bit {bit}");
        }
    }

    #[test]
    fn a_device_that_was_away_goes_on_where_it_was() {
        let mut clock = Clock::default();
        assert_eq!(clock.stamp_ns(6_000_000, 0), SECOND / 10);
        clock.begin_anew();
        assert_eq!(clock.stamp_ns(77, 3 * SECOND), 31 * SECOND / 10, "when it arrived");
        // From there by its own clock, however late it arrives.
        assert_eq!(clock.stamp_ns(77 + 6_000_000, 4 * SECOND), 32 * SECOND / 10);
        clock.begin_anew();
        assert_eq!(clock.stamp_ns(u32::MAX, 100 * SECOND), (32 + 960) * SECOND / 10);
    }

    proptest! {
        /// Through gaps of up to ten minutes, with a late host.
        #[test]
        fn wraps_are_counted(start in any::<u32>(), gaps in prop::collection::vec((0_i64..600 * SECOND, 0_i64..SECOND / 4), 1..40)) {
            let mut clock = Clock::default();
            let (mut true_ticks, mut arrival) = (i64::from(start), 7);
            prop_assert_eq!(clock.stamp_ns(start, arrival), stamp(true_ticks));
            for (gap, late) in gaps {
                true_ticks += gap / 50 * 3;
                arrival += gap;
                prop_assert_eq!(clock.stamp_ns(true_ticks as u32, arrival + late), stamp(true_ticks));
            }
        }

        #[test]
        fn nothing_panics(readings in prop::collection::vec((any::<u32>(), any::<i64>()), 0..20)) {
            let mut clock = Clock::default();
            for (ticks, arrival) in readings {
                clock.stamp_ns(ticks, arrival);
            }
        }
    }
}
