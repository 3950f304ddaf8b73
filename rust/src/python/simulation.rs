//! Simulated recordings.

use crate::sim::{self, SimError};
use pyo3::exceptions::PyOSError;
use pyo3::prelude::*;
use std::path::PathBuf;
use std::string::{String, ToString};
use std::vec::Vec;

/// Simulates `scene` (`NAME?key=value&…`) into `out` (`OUT.npz`), with camera and truth beside it: frames, throws, true contacts.
#[pyfunction]
#[allow(clippy::needless_pass_by_value)] // As Python gives it.
pub fn simulate(py: Python<'_>, scene: &str, out: PathBuf) -> PyResult<(usize, usize, usize)> {
    let summary = py.detach(|| sim::simulate(scene, &out))?;
    Ok((summary.frames, summary.balls, summary.contacts))
}

/// What really happens in `scene`, as JSON; no frame is made.
#[pyfunction]
pub fn truth(py: Python<'_>, scene: &str) -> PyResult<String> {
    let scene = py.detach(|| sim::Scene::parse(scene))?;
    serde_json::to_string(scene.truth()).map_err(|error| PyOSError::new_err(error.to_string()))
}

/// The names of the scenes there are.
#[pyfunction]
pub fn scenes() -> Vec<String> {
    sim::SCENES.iter().map(|(name, _)| name.to_string()).collect()
}

impl From<SimError> for PyErr {
    fn from(error: SimError) -> Self {
        let message = error.to_string();
        match error {
            SimError::Write { .. } => PyOSError::new_err(message),
            _ => super::error::ConfigError::new_err(message),
        }
    }
}
