//! Simulated recordings.

use super::waiting::wait_for;
use crate::sim::{self, SimError};
use pyo3::exceptions::PyOSError;
use pyo3::prelude::*;
use std::io;
use std::path::PathBuf;
use std::string::{String, ToString};
use std::vec::Vec;

/// Simulates `scene` (`NAME?key=value&…`) into `out` (`OUT.npz`), with camera and truth beside it: frames, throws, true contacts. Ctrl-C ends
/// it and leaves no file.
#[pyfunction]
pub fn simulate(py: Python<'_>, scene: String, out: PathBuf) -> PyResult<(usize, usize, usize)> {
    let plan = wait_for(py, None, move || sim::Plan::new(&scene, &out))??;
    #[allow(clippy::redundant_closure_for_method_calls)] // The method by itself is not of every lifetime.
    let go_on = || Python::attach(|py| py.check_signals()).map_err(io::Error::other);
    let summary = py.detach(|| plan.write(go_on))?;
    Ok((summary.frames, summary.balls, summary.contacts))
}

/// What really happens in `scene`, as JSON; no frame is made.
#[pyfunction]
pub fn truth(py: Python<'_>, scene: String) -> PyResult<String> {
    let scene = wait_for(py, None, move || sim::Scene::parse(&scene))??;
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
            SimError::Write { source, .. } => source.downcast().unwrap_or_else(|_| PyOSError::new_err(message)),
            _ => super::error::ConfigError::new_err(message),
        }
    }
}
