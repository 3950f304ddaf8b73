//! The Kinect's clock: 60 MHz, 32 bits, so that it wraps every 71.6 s.

/// Ticks after which the device's counter begins anew.
const WRAP: i128 = 1 << 32;

/// Counts the wraps of a device's clock with the help of the host's, which needs to be right to half a wrap only.
#[derive(Debug, Default)]
pub(super) struct Clock {
    /// Host's time (ns) and unwrapped ticks of the frame before.
    before: Option<(i64, i64)>,
}

impl Clock {
    /// The unwrapped ticks of a frame that arrived at `host_ns`; ticks of more than 32 bits are unwrapped already. `None` where that
    /// doesn't fit.
    pub(super) fn unwrap(&mut self, host_ns: i64, ticks: u64) -> Option<i64> {
        let mut unwrapped = i128::from(ticks);
        if let Some((host_before, before)) = self.before
            && unwrapped < WRAP
        {
            let expected = i128::from(before) + (i128::from(host_ns) - i128::from(host_before)) * 3 / 50;
            unwrapped += (expected - unwrapped + WRAP / 2).div_euclid(WRAP) * WRAP;
        }
        let unwrapped = i64::try_from(unwrapped).ok()?;
        self.before = Some((host_ns, unwrapped));
        Some(unwrapped)
    }
}

/// Ticks × 50/3, rounded, ns.
pub(super) fn nanoseconds(ticks: i64) -> Option<i64> {
    i64::try_from((i128::from(ticks) * 50 + 1).div_euclid(3)).ok()
}

/// The tick nearest to `ns`, at most 8⅓ ns away.
pub(super) fn nearest(ns: i64) -> i64 {
    (i128::from(ns) * 3 + 25).div_euclid(50) as i64
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn wraps_are_counted_through_gaps_and_lateness() {
        let second = 1_000_000_000;
        let mut clock = Clock::default();
        let wrap = 1_i64 << 32;
        assert_eq!(clock.unwrap(100 * second, 4_294_000_000), Some(4_294_000_000));
        assert_eq!(clock.unwrap(100 * second, 1_032_704), Some(wrap + 1_032_704));
        // Arrived 30 s late, three minutes on.
        assert_eq!(clock.unwrap(310 * second, 1_032_704 + 2_210_065_408), Some(wrap + 1_032_704 + 180 * 60_000_000));
        // An older frame after a newer one stays older.
        assert_eq!(clock.unwrap(310 * second, 1_032_704 + 2_210_065_400), Some(wrap + 1_032_704 + 180 * 60_000_000 - 8));
        assert_eq!(clock.unwrap(0, u64::MAX), None);
        assert_eq!(clock.unwrap(i64::MIN, 1 << 32), Some(wrap));
    }

    #[test]
    fn a_tick_is_fifty_thirds_of_a_nanosecond() {
        assert_eq!([0, 1, 2, 3, 60_000_000].map(nanoseconds), [0, 17, 33, 50, 1_000_000_000].map(Some));
        assert_eq!(nanoseconds(i64::MAX), None);
    }

    proptest! {
        #[test]
        fn ticks_pass_through_nanoseconds_unchanged(ticks in 0..i64::MAX / 17) {
            prop_assert_eq!(nearest(nanoseconds(ticks).unwrap()), ticks);
        }

        #[test]
        fn nanoseconds_move_by_half_a_tick_at_most(ns: i64) {
            prop_assert!(nanoseconds(nearest(ns)).is_none_or(|again| again.abs_diff(ns) <= 8));
        }
    }
}
