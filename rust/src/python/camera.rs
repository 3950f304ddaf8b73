//! The camera of a source: where its file is, and a pose that is level.

use super::array::{array2, vector};
use super::law::finite;
use crate::geometry::camera::Pose;
use crate::source;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use std::path::PathBuf;

/// The camera file of a source by name, or where it would be; `None` of what has no place.
#[pyfunction]
pub fn camera_file(source: &str) -> Option<PathBuf> {
    source::camera_file(source)
}

/// `world_from_camera` [4, 4] in which `gravity` [3] (camera frame) pulls down: of a `known` one heading and place are kept.
#[pyfunction]
pub fn level_pose<'py>(gravity: &Bound<'py, PyAny>, known: Option<[[f64; 4]; 4]>) -> PyResult<Bound<'py, PyAny>> {
    let down = vector(gravity, "gravity").and_then(|g| finite(g, "gravity"))?;
    if down == crate::math::Vec3::zeros() {
        return Err(PyValueError::new_err("gravity must have a length"));
    }
    let pose = match known.map(|rows| Pose::from_rows(&rows)) {
        None => Pose::level(&down),
        Some(Some(known)) => known.levelled(&down),
        Some(None) => return Err(PyValueError::new_err("known must be 4 rows of 4, a rotation and a translation")),
    };
    array2(gravity.py(), &pose.to_rows())
}
