//! Configurations from Python: paths, dicts and dataclasses.

use super::error::in_config;
use super::waiting::wait_for;
use crate::config::{CameraConfig, Config};
use crate::config_file::{self, ConfigFileError};
use crate::source::{camera_in_force, may_be_silent};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyDict, PyFloat, PyInt, PyList, PyString, PyTuple};
use serde::de::DeserializeOwned;
use std::boxed::Box;
use std::format;
use std::path::{Path, PathBuf};
use std::string::{String, ToString};
use std::time::Duration;
use std::vec::Vec;

/// A pipe may be silent for so long.
const PATIENCE: Duration = Duration::from_secs(2);

/// `None`, the path of a TOML file, a dict or a dataclass.
pub fn config(from: Option<&Bound<'_, PyAny>>) -> PyResult<Config> {
    let Some(from) = from else { return Ok(Config::default()) };
    let config = if let Some(path) = path(from) {
        config_file::read_config(&path)?
    } else {
        let tree = whole(from, "config")?;
        let surfaces = tree.get("environment").and_then(toml::Value::as_table).into_iter().flatten();
        let count = |entries: &toml::Value| entries.as_array().map_or(0, Vec::len);
        let kinds = surfaces.flat_map(|(kind, entries)| std::iter::repeat_n(kind.as_str(), count(entries)));
        let mut config: Config = keys(tree.clone(), "config")?;
        config_file::number(&mut config.environment, kinds);
        config_file::read_meshes(&mut config, Path::new(""), |_| "config".into())?;
        config
    };
    config.validate()?;
    Ok(config)
}

/// Where `camera` says something: in a file, or by itself, as a file of the same content would.
pub enum CameraSource {
    File(PathBuf),
    Keys(Box<CameraConfig>),
    Nowhere,
}

impl CameraSource {
    /// What it says; a file that is a pipe may stay silent.
    pub fn read(self) -> Result<Option<CameraConfig>, ConfigFileError> {
        match self {
            Self::File(path) => config_file::read_camera(&path).map(Some),
            Self::Keys(keys) => Ok(Some(*keys)),
            Self::Nowhere => Ok(None),
        }
    }
}

/// `None`, the path of a camera file, a dict or a dataclass.
pub fn camera(from: Option<&Bound<'_, PyAny>>) -> PyResult<CameraSource> {
    let Some(from) = from else { return Ok(CameraSource::Nowhere) };
    if let Some(path) = path(from) {
        return Ok(CameraSource::File(path));
    }
    let keys: CameraConfig = keys(whole(from, "camera")?, "camera")?;
    keys.validate()?;
    Ok(CameraSource::Keys(Box::new(keys)))
}

/// The configuration in force for `source`, as TOML; a source that can't be opened is the error that opening it is.
#[pyfunction]
#[pyo3(signature = (source=None, config=None, camera=None))]
pub fn dump_config(
    py: Python<'_>,
    source: Option<&str>,
    config: Option<&Bound<'_, PyAny>>,
    camera: Option<&Bound<'_, PyAny>>,
) -> PyResult<String> {
    let mut config = self::config(config)?;
    let camera = self::camera(camera)?.read()?;
    let mut assumed = None;
    if let Some(source) = source {
        let (named, theirs, camera) = (String::from(source), config.clone(), camera.clone());
        let patience = may_be_silent(source).then_some(PATIENCE);
        let posed = move || {
            let opened = crate::source::open(&named, &theirs, camera.as_ref())?;
            // Positions are in the world.
            Ok::<_, crate::source::SourceError>(opened.camera().is_none_or(|camera| camera.pose.is_some()))
        };
        assumed = Some(config.camera_assumption(wait_for(py, patience, posed)??));
    }
    config.camera = camera_in_force(source, &config, camera.as_ref())?;
    config.assume.camera = assumed.or(config.assume.camera);
    config.validate()?;
    config_file::to_toml(&config).map_err(|error| in_config(error.to_string()))
}

fn path(from: &Bound<'_, PyAny>) -> Option<PathBuf> {
    from.extract().ok()
}

/// A dict or a dataclass, in its order.
fn whole(from: &Bound<'_, PyAny>, what: &str) -> PyResult<toml::Value> {
    if !(from.is_instance_of::<PyDict>() || from.hasattr("__dataclass_fields__")?) {
        return Err(PyTypeError::new_err(format!(
            "{what} must be the path of a TOML file, a dict or a dataclass, got {}",
            from.get_type()
        )));
    }
    Ok(tree(from, what)?.unwrap_or_else(|| toml::Table::new().into()))
}

fn keys<T: DeserializeOwned>(tree: toml::Value, what: &str) -> PyResult<T> {
    tree.try_into().map_err(|error| in_config(format!("{what}: {}", error.to_string().trim_end().replace('\n', " "))))
}

/// `None` where a key is left out.
fn tree(from: &Bound<'_, PyAny>, key: &str) -> PyResult<Option<toml::Value>> {
    if from.is_none() {
        return Ok(None);
    }
    Ok(Some(if let Ok(dict) = from.cast::<PyDict>() {
        let mut table = toml::Table::new();
        for (name, value) in dict {
            let name: String = name.str()?.to_string();
            if let Some(value) = tree(&value, &format!("{key}.{name}"))? {
                table.insert(name, value);
            }
        }
        table.into()
    } else if let Ok(fields) = from.getattr("__dataclass_fields__") {
        let values = PyDict::new(from.py());
        for name in fields.try_iter()? {
            let name = name?;
            values.set_item(&name, from.getattr(name.cast::<PyString>()?)?)?;
        }
        return tree(values.as_any(), key);
    } else if from.is_instance_of::<PyBool>() {
        toml::Value::Boolean(from.extract()?)
    } else if from.is_instance_of::<PyInt>() {
        toml::Value::Integer(from.extract()?)
    } else if from.is_instance_of::<PyFloat>() {
        toml::Value::Float(from.extract()?)
    } else if from.is_instance_of::<PyString>() {
        toml::Value::String(from.extract()?)
    } else if from.is_instance_of::<PyList>() || from.is_instance_of::<PyTuple>() {
        let items = from.try_iter()?.map(|item| tree(&item?, key)).collect::<PyResult<Vec<_>>>()?;
        toml::Value::Array(items.into_iter().flatten().collect())
    } else if from.hasattr("tolist")? {
        return tree(&from.call_method0("tolist")?, key);
    } else if let Ok(path) = from.extract::<PathBuf>() {
        toml::Value::String(path.display().to_string())
    } else {
        return Err(in_config(format!("{key} can't be of {}", from.get_type())));
    }))
}
