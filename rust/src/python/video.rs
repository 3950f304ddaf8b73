//! The newest video image as a numpy array.

use crate::kinect::video::Video;
use crate::source::VideoImage;
use numpy::{PyArray1, PyArrayMethods};
use pyo3::prelude::*;
use std::format;
use std::string::String;
use std::vec::Vec;

/// An image of the colour or the infra-red camera, copied: it stays as it is.
#[pyclass(frozen, module = "physinc")]
pub struct VideoFrame(VideoImage);

impl VideoFrame {
    pub fn new(image: VideoImage) -> Self {
        Self(image)
    }
}

#[pymethods]
impl VideoFrame {
    /// Its stamp, ns on the stream's clock.
    #[getter]
    fn timestamp_ns(&self) -> i64 {
        self.0.timestamp_ns
    }

    /// Which camera's: "color" or "infrared".
    #[getter]
    fn kind(&self) -> &'static str {
        match self.0.video {
            Video::Color => "color",
            Video::Infrared => "infrared",
        }
    }

    /// The image.
    ///
    /// Colour: a Bayer mosaic [480, 640], uint8 (rows begin green, red and blue, green). Infra-red: [488, 640], uint16, 0 to 1023.
    #[getter]
    fn pixels<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let shape = self.0.video.shape();
        let samples = &self.0.samples;
        Ok(match self.0.video {
            Video::Color => {
                let bytes: Vec<u8> = samples.iter().map(|sample| *sample as u8).collect();
                PyArray1::from_vec(py, bytes).reshape(shape)?.into_any()
            }
            Video::Infrared => PyArray1::from_slice(py, samples).reshape(shape)?.into_any(),
        })
    }

    /// What was lost on the way, and is all ones: ranges (start, end) of pixels, counted row by row.
    #[getter]
    fn missing(&self) -> Vec<(usize, usize)> {
        self.0.missing.iter().map(|range| (range.start, range.end)).collect()
    }

    fn __repr__(&self) -> String {
        let lost: usize = self.0.missing.iter().map(ExactSizeIterator::len).sum();
        format!("VideoFrame(timestamp_ns={}, {}, {lost} pixels missing)", self.0.timestamp_ns, self.kind())
    }
}
