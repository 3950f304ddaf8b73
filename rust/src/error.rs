//! What can be wrong with what the user gave. Errors of recordings are in [`crate::source`].

use core::fmt;

/// A value of the configuration, or the length of a buffer, that can't be: which key, what stood there, and what may stand there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ConfigError {
    /// The key, as in the TOML file: `object.radius`; of a buffer its field: `buffers.runs`.
    pub key: &'static str,
    /// The value that was given; NaN where it is no number.
    pub value: f64,
    /// What the key takes.
    pub expected: &'static str,
}

impl fmt::Display for ConfigError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.value.is_nan() {
            write!(f, "{}: expected {}", self.key, self.expected)
        } else if self.value != 0.0 && !(1e-6..1e9).contains(&self.value.abs()) {
            write!(f, "{} = {:e}: expected {}", self.key, self.value, self.expected)
        } else {
            write!(f, "{} = {}: expected {}", self.key, self.value, self.expected)
        }
    }
}

impl core::error::Error for ConfigError {}

#[cfg(test)]
mod tests {
    use super::*;
    use std::string::ToString;

    #[test]
    fn values_are_shown_in_few_digits() {
        let shown = |value| ConfigError { key: "camera.cx", value, expected: "a column" }.to_string();
        assert_eq!(shown(1e300), "camera.cx = 1e300: expected a column");
        assert_eq!(shown(-1e-300), "camera.cx = -1e-300: expected a column");
        assert_eq!(shown(f64::INFINITY), "camera.cx = inf: expected a column");
        assert_eq!(shown(-20.5), "camera.cx = -20.5: expected a column");
        assert_eq!(shown(0.0), "camera.cx = 0: expected a column");
        assert_eq!(shown(f64::NAN), "camera.cx: expected a column");
    }
}
