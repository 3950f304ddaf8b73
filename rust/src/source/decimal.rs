//! Seconds as decimal text to nanoseconds, without the rounding that a float would add.

/// The significant digits that are looked at; more than any stamp has.
const DIGITS: u32 = 36;

/// Decimal seconds (`-1.5`, `1305031102.175304`, `2e-3`) × 1e9, rounded to the nearest, halves away from zero. `None` where the text is
/// no such number, or the result doesn't fit.
pub fn nanoseconds(text: &str) -> Option<i64> {
    let text = text.trim();
    let (negative, unsigned) = match text.as_bytes().first()? {
        b'-' => (true, &text[1..]),
        b'+' => (false, &text[1..]),
        _ => (false, text),
    };
    let (mantissa, exponent) = match unsigned.split_once(['e', 'E']) {
        Some((mantissa, exponent)) => (mantissa, exponent.parse::<i32>().ok()?),
        None => (unsigned, 0),
    };
    let (whole, fraction) = mantissa.split_once('.').unwrap_or((mantissa, ""));
    let digits = || whole.bytes().chain(fraction.bytes());
    if digits().next().is_none() || !digits().all(|digit| digit.is_ascii_digit()) {
        return None;
    }
    let mut value: i128 = 0;
    let mut power = exponent.checked_add(9)?.checked_sub(i32::try_from(fraction.len()).ok()?)?;
    for digit in digits() {
        if value < 10_i128.pow(DIGITS) {
            value = 10 * value + i128::from(digit - b'0');
        } else {
            power = power.checked_add(1)?;
        }
    }
    let scale = 10_i128.checked_pow(power.unsigned_abs());
    let ns = match (power >= 0, scale) {
        _ if value == 0 => 0,
        (true, scale) => value.checked_mul(scale?)?,
        (false, Some(scale)) => (value + scale / 2) / scale,
        (false, None) => 0,
    };
    i64::try_from(if negative { -ns } else { ns }).ok()
}

#[cfg(test)]
mod tests {
    use super::nanoseconds;
    use proptest::prelude::*;
    use std::format;

    #[test]
    fn reads_what_people_write() {
        for (text, ns) in [
            ("0", 0),
            ("-0.0", 0),
            ("1.5", 1_500_000_000),
            (" +.5 ", 500_000_000),
            ("5.", 5_000_000_000),
            ("1305031102.175304", 1_305_031_102_175_304_000),
            ("0.0333333333333333333333333333333333333333333333", 33_333_333),
            ("2e-3", 2_000_000),
            ("1.25E+1", 12_500_000_000),
            ("0.0000000005", 1),
            ("-0.0000000005", -1),
            ("0.00000000049999999999999999999999999999999999999999", 0),
            ("1e-400", 0),
            ("0e999", 0),
            ("9223372036.854775807", i64::MAX),
        ] {
            assert_eq!(nanoseconds(text), Some(ns), "{text}");
        }
    }

    #[test]
    fn refuses_the_rest() {
        for text in
            ["", ".", "-", "e5", "1e", "nan", "inf", "1,5", "0x10", "1_000", "1 2", "--1", "9223372036.854775808", "1e20", "1e2147483647"]
        {
            assert_eq!(nanoseconds(text), None, "{text}");
        }
    }

    proptest! {
        #[test]
        fn is_exact_for_every_stamp(ns: i64) {
            let (sign, size) = (if ns < 0 { "-" } else { "" }, ns.unsigned_abs());
            prop_assert_eq!(nanoseconds(&format!("{sign}{}.{:09}", size / 1_000_000_000, size % 1_000_000_000)), Some(ns).filter(|&ns| ns != i64::MIN));
            prop_assert_eq!(nanoseconds(&format!("{ns}e-9")), Some(ns).filter(|&ns| ns != i64::MIN));
        }

        #[test]
        fn never_panics(text in ".{0,40}") {
            let _ = nanoseconds(&text);
        }
    }
}
