//! What can be wrong with a source: what happened, the evidence, and what mends it.

use super::RecordError;
use crate::config_file::ConfigFileError;
use crate::error::ConfigError;
use crate::seeing::SeeError;
use std::boxed::Box;
use std::io;
use std::string::String;

/// Why a source can't be opened, or broke.
#[derive(Debug, thiserror::Error)]
pub enum SourceError {
    /// There is no such file.
    #[error("{source_name}: no such file; `physinc run demo` needs none")]
    NotFound {
        /// What the user named.
        source_name: String,
    },
    /// The operating system refuses.
    #[error("{source_name}: {error}")]
    Unreadable {
        /// What the user named.
        source_name: String,
        /// What it says.
        error: io::Error,
    },
    /// There is no such source, or it takes no such keys.
    #[error("{source_name}: {what}")]
    Unknown {
        /// What the user named.
        source_name: String,
        /// What there is instead.
        what: String,
    },
    /// No device can be read.
    #[error("{source_name}: this build reads no live Kinects (feature `usb`); without one, try `physinc run demo`")]
    NoDevice {
        /// What the user named.
        source_name: String,
    },
    /// A device that can't be had, or was lost.
    #[cfg(feature = "usb")]
    #[error(transparent)]
    Device(#[from] super::usb::DeviceError),
    /// The recording isn't what it should be.
    #[error("{source_name}: {what}")]
    Malformed {
        /// What the user named.
        source_name: String,
        /// What is wrong, where, and what is expected.
        what: String,
    },
    /// It has neither frames nor positions.
    #[error("{source_name}: it is empty: neither frames nor positions in it")]
    Empty {
        /// What the user named.
        source_name: String,
    },
    /// A camera file is wrong.
    #[error(transparent)]
    CameraFile(#[from] ConfigFileError),
    /// The camera can't be.
    #[error(transparent)]
    Camera(#[from] ConfigError),
    /// It can't be recorded any longer.
    #[error(transparent)]
    Record(Box<RecordError>),
    /// A frame that is not its camera's.
    #[error(transparent)]
    Image(#[from] SeeError),
    /// A mistake in physinc.
    #[error("physinc made a mistake while reading (the panic is on stderr); please report it, with the recording if you can")]
    Panicked,
}

impl SourceError {
    pub(crate) fn unreadable(source_name: &str, error: io::Error) -> Self {
        match error.kind() {
            io::ErrorKind::NotFound => Self::NotFound { source_name: source_name.into() },
            _ => Self::Unreadable { source_name: source_name.into(), error },
        }
    }

    pub(crate) fn unknown(source_name: &str, what: impl Into<String>) -> Self {
        Self::Unknown { source_name: source_name.into(), what: what.into() }
    }

    pub(crate) fn malformed(source_name: &str, what: impl Into<String>) -> Self {
        Self::Malformed { source_name: source_name.into(), what: what.into() }
    }
}

impl From<RecordError> for SourceError {
    fn from(error: RecordError) -> Self {
        match error {
            RecordError::Source(error) => error,
            error => Self::Record(Box::new(error)),
        }
    }
}
