//! What can be wrong with what the user gave. Errors of recordings are in [`crate::source`].

use core::fmt;

/// A value of the configuration that can't be: which key, what stood there, and what may stand there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ConfigError {
    /// The key, as in the TOML file: `object.radius`.
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
        } else {
            write!(f, "{} = {}: expected {}", self.key, self.value, self.expected)
        }
    }
}

impl core::error::Error for ConfigError {}
