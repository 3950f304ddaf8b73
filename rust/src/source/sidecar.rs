//! The camera file of a recording.

use super::capture::unpacked_name;
use crate::config::{CameraConfig, Config};
use crate::config_file::{ConfigFileError, read_camera};
use std::path::{Path, PathBuf};

/// The keys in force for the recording at `path`: `[camera]` in `config` wins, key by key, over `camera`, which replaces the file found
/// beside the recording.
pub(super) fn in_force(path: &Path, config: &Config, camera: Option<&CameraConfig>) -> Result<CameraConfig, ConfigFileError> {
    let found = if camera.is_none() { beside(path) } else { None };
    let found = found.map(|file| read_camera(&file)).transpose()?;
    Ok(camera.or(found.as_ref()).map_or_else(|| config.camera.clone(), |keys| config.camera.or(keys)))
}

/// `camera.toml` in a folder; of a file `NAME.camera.toml`, else `camera.toml` beside it.
fn beside(path: &Path) -> Option<PathBuf> {
    if path.is_dir() {
        return Some(path.join("camera.toml")).filter(|file| file.is_file());
    }
    let of_its_own = unpacked_name(path).with_extension("camera.toml");
    let shared = path.with_file_name("camera.toml");
    [of_its_own, shared].into_iter().find(|file| file.is_file())
}
