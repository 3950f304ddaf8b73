//! The newest depth image as numpy arrays.

use crate::run::{Picture, Samples};
use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;
use std::format;
use std::string::String;
use std::vec::Vec;

/// A depth image, copied: it stays as it is.
#[pyclass(frozen, module = "physinc")]
pub struct Frame(Picture);

impl Frame {
    pub fn new(picture: Picture) -> Self {
        Self(picture)
    }

    fn image<'py>(&self, py: Python<'py>, samples: Vec<u16>) -> PyResult<Bound<'py, PyArray2<u16>>> {
        PyArray1::from_vec(py, samples).reshape([self.0.camera.height, self.0.camera.width])
    }
}

#[pymethods]
impl Frame {
    /// Its stamp, ns on the stream's clock.
    #[getter]
    fn timestamp_ns(&self) -> i64 {
        self.0.timestamp_ns
    }

    /// Its index as delivered, from 0.
    #[getter]
    fn frame(&self) -> u64 {
        self.0.frame
    }

    /// Depth [H, W], uint16, mm; 0 where there is no reading.
    #[getter]
    fn depth_mm<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u16>>> {
        self.image(py, py.detach(|| self.0.depth_mm()))
    }

    /// What the camera sent [H, W], uint16: raw disparity, 2047 where there is no reading; `None` where its images are depth.
    #[getter]
    fn disparity<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray2<u16>>>> {
        match &self.0.samples {
            Samples::U16(samples) if self.0.is_disparity() => self.image(py, samples.clone()).map(Some),
            _ => Ok(None),
        }
    }

    fn __repr__(&self) -> String {
        let Picture { timestamp_ns, frame, camera, .. } = &self.0;
        format!("Frame(timestamp_ns={timestamp_ns}, frame={frame}, {} × {})", camera.width, camera.height)
    }
}
