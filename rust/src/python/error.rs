//! Errors as the exceptions of `physinc.errors`.

use crate::config_file::ConfigFileError;
use crate::source::SourceError;
use crate::source::usb::{DeviceError, Problem};
use pyo3::PyErr;
use std::string::{String, ToString};

mod exceptions {
    pyo3::import_exception!(physinc.errors, PhysincError);
    pyo3::import_exception!(physinc.errors, ConfigError);
    pyo3::import_exception!(physinc.errors, DeviceBusyError);
    pyo3::import_exception!(physinc.errors, DeviceDisconnectedError);
    pyo3::import_exception!(physinc.errors, DeviceNotFoundError);
    pyo3::import_exception!(physinc.errors, DevicePermissionError);
    pyo3::import_exception!(physinc.errors, DeviceReplyError);
    pyo3::import_exception!(physinc.errors, RecordingError);
    pyo3::import_exception!(physinc.errors, RecordingNotFoundError);
    pyo3::import_exception!(physinc.errors, StreamTimeoutError);
    pyo3::import_exception!(physinc.errors, UnknownSourceError);
}
pub use exceptions::{ConfigError, PhysincError, RecordingError, StreamTimeoutError};

impl From<SourceError> for PyErr {
    fn from(error: SourceError) -> Self {
        let message = error.to_string();
        match error {
            SourceError::Record(error) => (*error).into(),
            SourceError::Unknown { .. } => exceptions::UnknownSourceError::new_err(message),
            SourceError::NotFound { .. } => exceptions::RecordingNotFoundError::new_err(message),
            SourceError::Device(DeviceError { problem, .. }) => match problem {
                Problem::NoBus { .. } | Problem::NotFound { .. } => exceptions::DeviceNotFoundError::new_err(message),
                Problem::Denied { .. } => exceptions::DevicePermissionError::new_err(message),
                Problem::Busy { .. } => exceptions::DeviceBusyError::new_err(message),
                Problem::Gone { .. } => exceptions::DeviceDisconnectedError::new_err(message),
                Problem::Confused(_) => exceptions::DeviceReplyError::new_err(message),
                Problem::Slow { .. } | Problem::Bandwidth { .. } | Problem::Memory { .. } | Problem::Usb(_) => {
                    PhysincError::new_err(message)
                }
            },
            SourceError::NoDevice { .. } => exceptions::DeviceNotFoundError::new_err(message),
            SourceError::CameraFile(_) | SourceError::Camera(_) => ConfigError::new_err(message),
            SourceError::Panicked => PhysincError::new_err(message),
            SourceError::Unreadable { .. } | SourceError::Malformed { .. } | SourceError::Empty { .. } | SourceError::Image(_) => {
                RecordingError::new_err(message)
            }
        }
    }
}

impl From<ConfigFileError> for PyErr {
    fn from(error: ConfigFileError) -> Self {
        ConfigError::new_err(error.to_string())
    }
}

impl From<crate::error::ConfigError> for PyErr {
    fn from(error: crate::error::ConfigError) -> Self {
        ConfigError::new_err(error.to_string())
    }
}

/// A configuration that came from Python, not from a file.
pub fn in_config(what: impl Into<String>) -> PyErr {
    ConfigError::new_err(what.into())
}
