//! A source that is being recorded.

use super::error::{ConfigError, StreamTimeoutError};
use super::event::Counters;
use super::waiting::wait_for;
use crate::config::Config;
use crate::source::{self, RecordError, Recorded, Recorder};
use pyo3::exceptions::PyOSError;
use pyo3::prelude::*;
use std::format;
use std::path::PathBuf;
use std::string::{String, ToString};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use std::vec::Vec;

/// A live source may be silent for so long.
const PATIENCE: Duration = Duration::from_secs(2);

/// A source that is being recorded, and a context manager: an iterator over how many frames there are, and the newest's stamp, ns.
#[pyclass(frozen, module = "physinc._physinc")]
pub struct Recording(Mutex<Option<source::Recording>>);

#[pymethods]
impl Recording {
    fn __iter__(slf: PyRef<'_, Self>) -> PyRef<'_, Self> {
        slf
    }

    fn __next__(&self, py: Python<'_>) -> PyResult<Option<(u64, i64)>> {
        let mut silent = None;
        loop {
            py.check_signals()?;
            match py.detach(|| self.recording().as_mut().map_or(Ok(None), source::Recording::next_frame))? {
                Some(Recorded::Frame { count, timestamp_ns }) => return Ok(Some((count, timestamp_ns))),
                Some(Recorded::Silence) if silent.get_or_insert_with(Instant::now).elapsed() < PATIENCE => {}
                Some(Recorded::Silence) => {
                    return Err(StreamTimeoutError::new_err(format!("no frame for {} s; `physinc doctor` looks why", PATIENCE.as_secs())));
                }
                None => return Ok(None),
            }
        }
    }

    fn __enter__(slf: PyRef<'_, Self>) -> PyRef<'_, Self> {
        slf
    }

    #[pyo3(signature = (*_exception))]
    fn __exit__(&self, py: Python<'_>, _exception: &Bound<'_, pyo3::types::PyTuple>) -> PyResult<()> {
        self.close(py)
    }

    /// What the user should know of the source so far, a line each.
    #[getter]
    fn remarks(&self) -> Vec<String> {
        self.recording().as_ref().map_or_else(Vec::new, source::Recording::remarks)
    }

    /// Frames, and what was lost of a source of packets.
    #[getter]
    fn counters(&self) -> Counters {
        Counters(self.recording().as_ref().map(source::Recording::counters).unwrap_or_default())
    }

    /// How much was written, bytes.
    #[getter]
    fn bytes(&self) -> u64 {
        self.recording().as_ref().map_or(0, source::Recording::bytes)
    }

    /// Completes what was recorded; no more frames.
    fn close(&self, py: Python<'_>) -> PyResult<()> {
        Ok(py.detach(|| self.recording().take().map_or(Ok(()), source::Recording::finish))?)
    }
}

impl Recording {
    fn recording(&self) -> MutexGuard<'_, Option<source::Recording>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Will record at most `frames` of `source`, in whose camera an accelerometer tells `gravity`, in `out`: a `*.npz`, a folder, in fakenect's layout or, with `tum`, in TUM's, or a capture.
#[pyfunction]
#[pyo3(signature = (source, out, *, gravity, tum, frames))]
#[allow(clippy::needless_pass_by_value)] // As Python gives it.
pub fn open_recording(
    py: Python<'_>,
    source: &str,
    out: PathBuf,
    gravity: Option<[f64; 3]>,
    tum: bool,
    frames: Option<u64>,
) -> PyResult<Recording> {
    let named = String::from(source);
    let mut config = Config::default();
    config.camera.gravity_in_camera = gravity;
    let source = wait_for(py, None, move || source::open(&named, &config, None))??;
    let recorder = Recorder::new(&*source, &out, tum)?;
    Ok(Recording(Mutex::new(Some(source::Recording::new(source, recorder, frames)))))
}

impl From<RecordError> for PyErr {
    fn from(error: RecordError) -> Self {
        match error {
            RecordError::Source(error) => error.into(),
            RecordError::Refused { .. } => ConfigError::new_err(error.to_string()),
            RecordError::Write { .. } => PyOSError::new_err(error.to_string()),
        }
    }
}
