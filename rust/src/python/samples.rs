//! Times, positions and their noise from Python, checked.

use super::array::{points, shown};
use crate::math::Mat3;
use crate::physics::Sample;
use numpy::{AllowTypeChange, PyArrayLike1, PyArrayLikeDyn};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use std::format;
use std::vec::Vec;

/// What is known of the noise of positions.
#[derive(Clone, Copy)]
pub struct Noise<'a, 'py> {
    /// Standard deviation an axis, m.
    pub sd: Option<f64>,
    /// [3, 3] or [N, 3, 3], m².
    pub covariance: Option<&'a Bound<'py, PyAny>>,
}

impl Noise<'_, '_> {
    /// Nothing.
    pub fn is_unknown(&self) -> bool {
        self.sd.is_none() && self.covariance.is_none()
    }
}

/// Samples in order of time; where nothing is known of their noise they weigh as if it were 1 mm. At least `least` of them.
pub fn samples(t: &Bound<'_, PyAny>, positions: &Bound<'_, PyAny>, noise: Noise<'_, '_>, least: usize) -> PyResult<Vec<Sample>> {
    let times = times(t)?;
    let positions = points(positions, "positions")?;
    if times.len() != positions.len() {
        return Err(PyValueError::new_err(format!("t has {} times, positions {} rows", times.len(), positions.len())));
    }
    if times.len() < least {
        return Err(PyValueError::new_err(format!("at least {least} positions are needed, got {}", times.len())));
    }
    let weights = weights(noise, times.len())?;
    let weight = |i: usize| weights.get(i).or(weights.first()).copied().unwrap_or_else(Mat3::identity);
    let sample = |(i, (t, position))| Sample { t, position, weight: weight(i), half_span: 0.0 };
    Ok(times.into_iter().zip(positions).enumerate().map(sample).collect())
}

/// Finite and rising.
fn times(t: &Bound<'_, PyAny>) -> PyResult<Vec<f64>> {
    let wrong = || PyValueError::new_err(format!("t must be an array [N], got {}", shown(t)));
    let times: PyArrayLike1<'_, f64, AllowTypeChange> = t.extract().map_err(|_| wrong())?;
    let times: Vec<f64> = times.as_array().iter().copied().collect();
    if let Some(i) = times.iter().position(|t| !t.is_finite()) {
        return Err(PyValueError::new_err(format!("t must be finite, t[{i}] is not")));
    }
    match times.windows(2).position(|pair| pair[1] <= pair[0]) {
        Some(i) => Err(PyValueError::new_err(format!("t must rise, but t[{}] = {} follows {}", i + 1, times[i + 1], times[i]))),
        None => Ok(times),
    }
}

/// One weight for all, or one for each.
fn weights(noise: Noise<'_, '_>, count: usize) -> PyResult<Vec<Mat3>> {
    let covariance = match (noise.sd, noise.covariance) {
        (Some(_), Some(_)) => return Err(PyValueError::new_err("sd and covariance say the same: give one of them")),
        (Some(sd), None) if !(1e-9..=1e6).contains(&sd) => {
            return Err(PyValueError::new_err(format!("sd = {sd}: expected 1e-9 to 1e6 m")));
        }
        (sd, None) => return Ok([Mat3::from_diagonal_element(sd.unwrap_or(1e-3).powi(-2))].into()),
        (None, Some(covariance)) => covariance,
    };
    let wrong =
        || PyValueError::new_err(format!("covariance must be an array [3, 3] or [N, 3, 3] with N = {count}, got {}", shown(covariance)));
    let numbers: PyArrayLikeDyn<'_, f64, AllowTypeChange> = covariance.extract().map_err(|_| wrong())?;
    let numbers = numbers.as_array();
    if numbers.shape() != [3, 3] && numbers.shape() != [count, 3, 3] {
        return Err(wrong());
    }
    let numbers: Vec<f64> = numbers.iter().copied().collect();
    let inverse = |(i, c): (usize, &[f64])| {
        let c = Mat3::from_row_slice(c);
        let proper = c.iter().all(|x| x.is_finite()) && (c - c.transpose()).abs().max() <= 1e-9 * c.abs().max();
        let inverse = c.cholesky().filter(|_| proper).map(|factor| factor.inverse());
        inverse
            .filter(|w| w.iter().all(|x| x.is_finite()))
            .ok_or_else(|| PyValueError::new_err(format!("covariance must be finite, symmetric and positive definite, number {i} is not")))
    };
    numbers.chunks_exact(9).enumerate().map(inverse).collect()
}
