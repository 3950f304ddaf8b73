//! Trajectories known up to scale. Python's signatures and documentation are in `arrays.py`.

use super::array::{array1, array2};
use super::law;
use super::result::ScaleFit;
use super::samples::{Noise, samples};
use super::waiting::wait_for;
use crate::physics::scale::{self, NoScale};
use crate::physics::split;
use crate::source::{Csv, Input, Source, SourceError};
use crate::time::seconds_between;
use pyo3::IntoPyObjectExt;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use std::format;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::string::{String, ToString};
use std::vec::Vec;

/// Metres per unit, or why there is no such thing.
#[pyfunction]
pub fn fit_scale<'py>(
    t: &Bound<'py, PyAny>,
    positions: &Bound<'py, PyAny>,
    gravity: f64,
    drag: Option<&Bound<'py, PyAny>>,
    sd: Option<f64>,
    covariance: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyAny>> {
    if !(gravity > 0.0 && gravity.is_finite()) {
        return Err(PyValueError::new_err(format!("gravity = {gravity}: a size must be above 0 and finite, m/s²")));
    }
    let unknown = drag.and_then(|drag| drag.extract::<String>().ok()).is_some_and(|word| word == "unknown");
    let drag = if unknown { scale::Drag::UNKNOWN } else { scale::Drag { mean: law::drag(drag)?.drag, sd: 0.0 } };
    let noise = Noise { sd, covariance };
    let mut samples = samples(t, positions, noise, if noise.is_unknown() { split::LEAST } else { 4 })?;
    let mut scratch = std::vec![0.0; 3 * samples.len()];
    match scale::fit_scale(&mut samples, gravity, drag, !noise.is_unknown(), &mut scratch) {
        Ok(fit) => ScaleFit {
            scale: fit.scale,
            sd: fit.sd,
            gravity_direction: fit.down.into(),
            drag: fit.drag,
            residual_sd: fit.residual_sd,
            dof: fit.dof,
        }
        .into_bound_py_any(t.py()),
        Err(NoScale::Straight) => {
            "its acceleration can't be told from none: it moves straight, or was not seen long enough".into_bound_py_any(t.py())
        }
        Err(NoScale::NoFlight { residual_sd, noise }) => format!(
            "no one flight fits: it is {residual_sd:.1e} units off, its noise is {noise:.1e}; was it touched, or does it move by itself?"
        )
        .into_bound_py_any(t.py()),
    }
}

/// The flights of a motion, as slices.
#[pyfunction]
pub fn split_flights<'py>(t: &Bound<'py, PyAny>, positions: &Bound<'py, PyAny>) -> PyResult<Vec<(usize, usize)>> {
    let samples = samples(t, positions, Noise { sd: None, covariance: None }, 0)?;
    let mut found = Vec::new();
    split::flights(&samples, &mut std::vec![0.0; 3 * samples.len()], &mut |range| found.push((range.start, range.end)));
    Ok(found)
}

/// Times (s), positions, covariances, row by row, tracks.
type Rows<'py> = (Bound<'py, PyAny>, Bound<'py, PyAny>, Bound<'py, PyAny>, Vec<i64>);

/// The rows of a CSV of positions: times (s, since the first), positions [N, 3], covariances [N, 9] (NaN where none is told), tracks (−1
/// where none is told).
///
/// A pipe is read as long as it takes; Ctrl-C ends that.
#[pyfunction]
pub fn read_positions(py: Python<'_>, path: PathBuf) -> PyResult<Rows<'_>> {
    let columns = wait_for(py, None, move || columns(&path))??;
    Ok((array1(py, &columns.times), array2(py, &columns.centers)?, array2(py, &columns.covariances)?, columns.tracks))
}

/// What [`read_positions`] reads.
#[derive(Default)]
struct Columns {
    times: Vec<f64>,
    centers: Vec<[f64; 3]>,
    covariances: Vec<[f64; 9]>,
    tracks: Vec<i64>,
}

fn columns(path: &Path) -> Result<Columns, SourceError> {
    let name = path.display().to_string();
    let file = File::open(path).map_err(|error| SourceError::unreadable(&name, error))?;
    let mut csv = Csv::new(&name, file, 0.0);
    let (mut columns, mut first) = (Columns::default(), None);
    while let Some(input) = csv.next_input()? {
        let Input::Positions { timestamp_ns, positions } = input else { continue };
        let since = seconds_between(*first.get_or_insert(timestamp_ns), timestamp_ns);
        for position in positions {
            columns.times.push(since);
            columns.centers.push(position.center.into());
            columns.covariances.push(position.covariance.map_or([f64::NAN; 9], |covariance| core::array::from_fn(|i| covariance[i])));
            columns.tracks.push(position.label.map_or(-1, i64::from));
        }
    }
    Ok(columns)
}
