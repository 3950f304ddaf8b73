//! The camera file of a recording.

use super::capture::unpacked_name;
use crate::config::{CameraConfig, Config};
use crate::config_file::{ConfigFileError, read_camera};
use std::path::{Path, PathBuf};

/// The keys in force for the recording at `path`: `[camera]` in `config` wins, key by key, over `camera`, which replaces the file found
/// beside the recording.
pub(super) fn in_force(path: &Path, config: &Config, camera: Option<&CameraConfig>) -> Result<CameraConfig, ConfigFileError> {
    let found = Some(beside(path)).filter(|file| camera.is_none() && file.is_file());
    let found = found.map(|file| read_camera(&file)).transpose()?;
    Ok(camera.or(found.as_ref()).map_or_else(|| config.camera.clone(), |keys| config.camera.or(keys)))
}

/// Where the camera file of the recording at `path` is, or would be: `camera.toml` in a folder; of a file `NAME.camera.toml`, or
/// `camera.toml` beside it if that alone is there.
pub(super) fn beside(path: &Path) -> PathBuf {
    if path.is_dir() {
        return path.join("camera.toml");
    }
    let of_its_own = unpacked_name(path).with_extension("camera.toml");
    let shared = path.with_file_name("camera.toml");
    if shared.is_file() && !of_its_own.is_file() { shared } else { of_its_own }
}
