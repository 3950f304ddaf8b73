//! Device's ticks in the names of a recording's frames: 60 MHz, 32 bits, so that they wrap every 71.6 s, or unwrapped already.

use crate::stream::clock;

/// Counts the wraps with the help of the host's clock, which needs to be right to half a wrap only.
#[derive(Debug, Default)]
pub(super) struct Wraps {
    /// Host's time (ns) and unwrapped ticks of the frame before.
    before: Option<(i64, i64)>,
}

impl Wraps {
    /// The unwrapped ticks of a frame that arrived at `host_ns`; ticks of more than 32 bits are unwrapped already. `None` where that
    /// doesn't fit.
    pub(super) fn unwrap(&mut self, host_ns: i64, ticks: u64) -> Option<i64> {
        let unwrapped = match (self.before, u32::try_from(ticks)) {
            (Some((host_before, before)), Ok(ticks)) => clock::nearest(ticks, clock::expected(before, host_ns.saturating_sub(host_before))),
            _ => i64::try_from(ticks).ok()?,
        };
        self.before = Some((host_ns, unwrapped));
        Some(unwrapped)
    }
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
        let mut wraps = Wraps::default();
        let wrap = 1_i64 << 32;
        assert_eq!(wraps.unwrap(100 * second, 4_294_000_000), Some(4_294_000_000));
        assert_eq!(wraps.unwrap(100 * second, 1_032_704), Some(wrap + 1_032_704));
        // Arrived 30 s late, three minutes on.
        assert_eq!(wraps.unwrap(310 * second, 1_032_704 + 2_210_065_408), Some(wrap + 1_032_704 + 180 * 60_000_000));
        // An older frame after a newer one stays older.
        assert_eq!(wraps.unwrap(310 * second, 1_032_704 + 2_210_065_400), Some(wrap + 1_032_704 + 180 * 60_000_000 - 8));
        assert_eq!(wraps.unwrap(0, u64::MAX), None);
        assert_eq!(wraps.unwrap(i64::MIN, 1 << 32), Some(wrap));
    }

    proptest! {
        #[test]
        fn ticks_pass_through_nanoseconds_unchanged(ticks in 0..i64::MAX / 17) {
            prop_assert_eq!(nearest(clock::nanoseconds(ticks).unwrap()), ticks);
        }

        #[test]
        fn nanoseconds_move_by_half_a_tick_at_most(ns: i64) {
            prop_assert!(clock::nanoseconds(nearest(ns)).is_none_or(|again| again.abs_diff(ns) <= 8));
        }
    }
}
