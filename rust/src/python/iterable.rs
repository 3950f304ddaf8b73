//! A Python iterable of frames or positions as a source. It is pulled on the caller's thread; what it raises ends the stream, then reaches
//! the caller. Positions of equal stamps are one instant, so that the last one waits for the item after it.

use super::array::timestamp_ns;
use super::error::RecordingError;
use super::event::Position;
use super::law::StreamLaw;
use crate::config::{CameraConfig, Config};
use crate::event::EndReason;
use crate::geometry::camera::{Camera, DepthCode};
use crate::math::Mat3;
use crate::run::{Latest, Options, Run, Step};
use crate::seeing::Image;
use crate::source::{Input, MOST_POSITIONS, measurement};
use crate::track::Measurement;
use numpy::{PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::exceptions::{PyException, PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyIterator, PyList, PyTuple};
use std::borrow::Cow;
use std::boxed::Box;
use std::format;
use std::string::ToString;
use std::sync::Arc;
use std::vec::Vec;

const EXPECTED: &str =
    "an iterable of (timestamp_ns, depth [H, W] uint16 mm or float32 m), of Position, or of lists of Position is expected";

/// The iterable and what it goes through.
pub struct Iterable {
    items: Py<PyIterator>,
    config: Config,
    options: Options,
    run: Option<Run>,
    /// What was pulled after the last instant, already.
    ahead: Option<Pulled>,
    /// What broke the stream, once it has told its end.
    failure: Option<PyErr>,
    /// Where images go, if they are wanted.
    latest: Option<Arc<Latest>>,
    /// The user's own law, until the run has it.
    law: Option<StreamLaw>,
}

/// An item, `None` after the last, or what the iterable raised.
type Pulled = PyResult<Option<Py<PyAny>>>;

impl Iterable {
    pub fn new(
        items: &Bound<'_, PyAny>,
        config: Config,
        options: Options,
        latest: Option<Arc<Latest>>,
        law: Option<StreamLaw>,
    ) -> PyResult<Self> {
        let items = items.try_iter().map_err(|_| PyTypeError::new_err(format!("{} is no source: {EXPECTED}", items.get_type())))?;
        Ok(Self { items: items.unbind(), config, options, run: None, ahead: None, failure: None, latest, law })
    }

    /// Pulls one instant; `None` after the last. What goes wrong is told after the end of the stream, if that has begun.
    pub fn step(&mut self, py: Python<'_>, interrupted: bool) -> PyResult<Option<Step>> {
        if self.run.as_ref().is_some_and(Run::is_over) || (interrupted && self.run.is_none()) {
            return self.failure.take().map_or(Ok(None), Err);
        }
        let outcome = if interrupted { Ok(None) } else { self.instant(py) };
        let reason = match outcome {
            Ok(Some(step)) => return Ok(Some(step)),
            Ok(None) if interrupted => EndReason::Interrupted,
            Ok(None) => EndReason::EndOfSource,
            // Ctrl-C and the like pass at once.
            Err(error) if self.run.is_none() || !error.is_instance_of::<PyException>(py) => return Err(error),
            Err(error) => {
                self.failure = Some(error);
                EndReason::Disconnected
            }
        };
        let Some(run) = &mut self.run else { return Err(RecordingError::new_err(format!("the iterable is empty: {EXPECTED}"))) };
        Ok(Some(Step::end(run, reason)))
    }

    /// The next frame, or all positions of the next instant, through the engine; `None` after the last.
    fn instant(&mut self, py: Python<'_>) -> PyResult<Option<Step>> {
        let Some(item) = self.ahead.take().unwrap_or_else(|| self.pull(py))? else { return Ok(None) };
        let item = item.into_bound(py);
        if let Ok(first) = item.cast::<Position>() {
            let mut positions = std::vec![first.clone()];
            while positions.len() <= MOST_POSITIONS {
                let ahead = self.pull(py);
                let next = ahead.as_ref().ok().and_then(|item| item.as_ref()?.bind(py).cast::<Position>().ok());
                let Some(next) = next.filter(|next| next.get().timestamp_ns() == first.get().timestamp_ns()) else {
                    self.ahead = Some(ahead);
                    break;
                };
                positions.push(next.clone());
            }
            return self.positions(&positions).map(Some);
        }
        if let Ok(list) = item.cast::<PyList>() {
            let positions = list.iter().map(|item| item.cast_into().map_err(|_| unexpected(list))).collect::<PyResult<Vec<_>>>()?;
            return self.positions(&positions).map(Some);
        }
        match item.cast::<PyTuple>().map(|pair| pair.extract::<(Bound<'_, PyAny>, Bound<'_, PyAny>)>()) {
            Ok(Ok((stamp, depth))) => self.frame(timestamp_ns(&stamp)?, &depth).map(Some),
            _ => Err(unexpected(&item)),
        }
    }

    fn pull(&self, py: Python<'_>) -> Pulled {
        self.items.bind(py).clone().next().transpose().map(|item| item.map(Bound::unbind))
    }

    fn positions(&mut self, positions: &[Bound<'_, Position>]) -> PyResult<Step> {
        if positions.len() > MOST_POSITIONS {
            let what = format!("more than {MOST_POSITIONS} positions of one instant: does timestamp_ns stand still?");
            return Err(PyValueError::new_err(what));
        }
        let Some(first) = positions.first() else {
            return Err(PyValueError::new_err(
                "an empty list has no time: for an instant at which nothing was seen, give a Position with NaN",
            ));
        };
        let timestamp_ns = first.get().timestamp_ns();
        if positions.iter().any(|position| position.get().timestamp_ns() != timestamp_ns) {
            return Err(PyValueError::new_err("the positions of one list must have the same timestamp_ns"));
        }
        let radius = self.config.object.radius.as_slice().first().copied().unwrap_or(f64::NAN);
        let seen = positions.iter().map(Bound::get).filter(|position| !position.fields.center.iter().any(|x| x.is_nan()));
        let measurements: Vec<Measurement> = seen
            .map(|position| {
                let covariance = Some(Mat3::from_fn(|i, j| position.fields.covariance[i][j])).filter(|c| !c[(0, 0)].is_nan());
                measurement(timestamp_ns, position.fields.center.into(), covariance, position.track(), radius)
                    .map_err(PyValueError::new_err)
            })
            .collect::<PyResult<_>>()?;
        self.push(None, Input::Positions { timestamp_ns, positions: &measurements })
    }

    fn frame(&mut self, timestamp_ns: i64, depth: &Bound<'_, PyAny>) -> PyResult<Step> {
        if let Ok(depth) = depth.extract::<PyReadonlyArray2<'_, u16>>() {
            return self.push(Some(depth.shape()), Input::Frame { timestamp_ns, image: Image::U16(&rows(&depth)) });
        }
        if let Ok(depth) = depth.extract::<PyReadonlyArray2<'_, f32>>() {
            return self.push(Some(depth.shape()), Input::Frame { timestamp_ns, image: Image::F32(&rows(&depth)) });
        }
        let got = match (depth.getattr("dtype"), depth.getattr("shape")) {
            (Ok(dtype), Ok(shape)) => format!("{dtype} {shape}"),
            _ => depth.get_type().to_string(),
        };
        Err(PyTypeError::new_err(format!("depth must be an array [H, W] of uint16 (mm) or float32 (m), got {got}")))
    }

    fn push(&mut self, shape: Option<&[usize]>, input: Input<'_>) -> PyResult<Step> {
        if self.run.is_none() {
            let camera = shape.map(|shape| self.camera(shape)).transpose()?;
            let run = self.run.insert(Run::new("iterable", &self.config, camera, self.options)?);
            if let Some(latest) = &self.latest {
                run.show(Arc::clone(latest));
            }
            if let Some(law) = self.law.take() {
                run.obey(Box::new(law));
            }
        }
        let Some(run) = &mut self.run else { return Err(PyValueError::new_err(EXPECTED)) };
        let expected = run.camera().map(|camera| [camera.height as usize, camera.width as usize]);
        if shape != expected.as_ref().map(<[usize; 2]>::as_slice) {
            return Err(PyValueError::new_err(match (shape, expected) {
                (Some(shape), Some(expected)) => format!("depth is {shape:?}, the camera is {expected:?} (rows, columns)"),
                _ => format!("frames and positions can't be mixed: {EXPECTED}"),
            }));
        }
        Step::input(run, input).map(Option::unwrap_or_default).map_err(|error| PyValueError::new_err(error.to_string()))
    }

    /// The camera in force, of the first frame's size where nothing else is said.
    fn camera(&self, shape: &[usize]) -> PyResult<Camera> {
        let size = CameraConfig { height: Some(shape[0] as u32), width: Some(shape[1] as u32), ..CameraConfig::default() };
        let keys = self.config.camera.or(&size);
        Ok(Camera::from_config(&keys, DepthCode::Depth { units_per_metre: 1000.0 })?)
    }
}

/// Row by row: in another order of memory, as a transposed array's, it is copied.
fn rows<'a, T: numpy::Element + Copy>(array: &'a PyReadonlyArray2<'_, T>) -> Cow<'a, [T]> {
    let borrowed = if array.is_c_contiguous() { array.as_slice().ok() } else { None };
    borrowed.map_or_else(|| Cow::Owned(array.as_array().iter().copied().collect()), Cow::Borrowed)
}

fn unexpected(item: &Bound<'_, PyAny>) -> PyErr {
    PyTypeError::new_err(format!("can't use {}: {EXPECTED}", item.get_type()))
}
