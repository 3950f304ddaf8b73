//! The Kinect's packing for users who have raw dumps.

use crate::kinect::disparity::{HEIGHT, Packing, WIDTH};
use numpy::{PyReadonlyArray1, PyReadwriteArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use std::format;

/// Unpacks a frame of `bits` a sample into `samples` [480, 640].
#[pyfunction]
#[allow(clippy::needless_pass_by_value)] // As Python gives it.
pub fn unpack_disparity(packed: PyReadonlyArray1<'_, u8>, bits: u32, mut samples: PyReadwriteArray2<'_, u16>) -> PyResult<()> {
    let packing = match bits {
        11 => Packing::Eleven,
        10 => Packing::Ten,
        _ => return Err(PyValueError::new_err(format!("bits = {bits}: expected 11 or 10"))),
    };
    let (packed, samples) = (packed.as_slice()?, samples.as_slice_mut()?);
    let expected = packing.frame_bytes();
    if packed.len() != expected {
        let message = format!("packed has {} bytes: expected {expected}, {WIDTH} × {HEIGHT} samples of {bits} bits", packed.len());
        return Err(PyValueError::new_err(message));
    }
    packing.unpack(packed, samples).map_err(|error| PyValueError::new_err(format!("{error}")))
}
