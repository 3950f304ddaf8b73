//! Time is an integer of nanoseconds on the stream's own clock; differences are seconds.

/// Seconds from `start_ns` to `end_ns`, exact to the rounding of the result even where the stamps are far from zero or from each other.
#[inline]
pub fn seconds_between(start_ns: i64, end_ns: i64) -> f64 {
    match end_ns.checked_sub(start_ns) {
        Some(ns) => ns as f64 * 1e-9,
        None => (end_ns as f64 - start_ns as f64) * 1e-9,
    }
}

/// The stamp `seconds` after `start_ns`, rounded to the nanosecond, held inside the range of stamps.
#[inline]
pub fn after(start_ns: i64, seconds: f64) -> i64 {
    start_ns.saturating_add(libm::round(seconds * 1e9) as i64)
}
