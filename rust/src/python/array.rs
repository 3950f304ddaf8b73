//! Numbers and numpy arrays from Python, checked; and back.

use crate::math::{Mat3, Vec3};
use numpy::{AllowTypeChange, PyArray1, PyArray2, PyArrayLike1, PyArrayLike2, PyArrayMethods};
use pyo3::exceptions::{PyOverflowError, PyTypeError, PyValueError};
use pyo3::prelude::*;
use std::format;
use std::string::ToString;
use std::vec::Vec;

/// Three numbers; `what` is it that they are.
pub fn vector(array: &Bound<'_, PyAny>, what: &str) -> PyResult<Vec3> {
    let wrong = || PyValueError::new_err(format!("{what} must be 3 numbers, got {}", shown(array)));
    let numbers: PyArrayLike1<'_, f64, AllowTypeChange> = array.extract().map_err(|_| wrong())?;
    let numbers = numbers.as_array();
    if numbers.len() == 3 { Ok(Vec3::new(numbers[0], numbers[1], numbers[2])) } else { Err(wrong()) }
}

/// 3×3 numbers; `what` is it that they are.
pub fn matrix(array: &Bound<'_, PyAny>, what: &str) -> PyResult<Mat3> {
    let wrong = || PyValueError::new_err(format!("{what} must be 3 rows of 3 numbers, got {}", shown(array)));
    let numbers: PyArrayLike2<'_, f64, AllowTypeChange> = array.extract().map_err(|_| wrong())?;
    let numbers = numbers.as_array();
    if numbers.shape() == [3, 3] { Ok(Mat3::from_fn(|i, j| numbers[(i, j)])) } else { Err(wrong()) }
}

/// [N, 3] finite numbers; `what` is it that they are.
pub fn points(array: &Bound<'_, PyAny>, what: &str) -> PyResult<Vec<Vec3>> {
    let wrong = || PyValueError::new_err(format!("{what} must be an array [N, 3], got {}", shown(array)));
    let numbers: PyArrayLike2<'_, f64, AllowTypeChange> = array.extract().map_err(|_| wrong())?;
    let numbers = numbers.as_array();
    if numbers.shape()[1] != 3 {
        return Err(wrong());
    }
    if let Some(row) = numbers.rows().into_iter().position(|row| !row.iter().all(|x| x.is_finite())) {
        return Err(PyValueError::new_err(format!("{what} must be finite, row {row} is not")));
    }
    Ok(numbers.rows().into_iter().map(|row| Vec3::new(row[0], row[1], row[2])).collect())
}

/// An integer that fits; `what` is it, of what is `expected`.
pub fn integer<T: for<'a, 'py> FromPyObject<'a, 'py, Error = PyErr>>(value: &Bound<'_, PyAny>, what: &str, expected: &str) -> PyResult<T> {
    value.extract().map_err(|error: PyErr| {
        let message = format!("{what} = {}: expected {expected}", shown(value));
        if error.is_instance_of::<PyOverflowError>(value.py()) { PyValueError::new_err(message) } else { PyTypeError::new_err(message) }
    })
}

/// A stamp, ns.
pub fn timestamp_ns(value: &Bound<'_, PyAny>) -> PyResult<i64> {
    integer(value, "timestamp_ns", "an integer, ns, from -2^63 to 2^63 - 1")
}

/// A float64 array [N].
pub fn array1<'py>(py: Python<'py>, numbers: &[f64]) -> Bound<'py, PyAny> {
    PyArray1::from_slice(py, numbers).into_any()
}

/// A float64 array [R, C]; [0, C] where there are no rows.
pub fn array2<'py, const C: usize>(py: Python<'py>, rows: &[[f64; C]]) -> PyResult<Bound<'py, PyAny>> {
    let flat: PyResult<Bound<'py, PyArray2<f64>>> = PyArray1::from_slice(py, rows.as_flattened()).reshape([rows.len(), C]);
    flat.map(Bound::into_any)
}

pub fn shown(value: &Bound<'_, PyAny>) -> std::string::String {
    match value.getattr("shape") {
        Ok(shape) => format!("an array of shape {shape}"),
        Err(_) => value.repr().map_or_else(|_| "something else".into(), |text| text.to_string().chars().take(60).collect()),
    }
}
