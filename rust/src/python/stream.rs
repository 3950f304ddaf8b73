//! `physinc.stream` from below: an iterator of events over a source on its own thread, or over a Python iterable.

use super::array::{array1, array2};
use super::config;
use super::error::StreamTimeoutError;
use super::event::{self, Counters};
use super::frame::Frame;
use super::iterable::Iterable;
use super::law::{Raised, StreamLaw};
use super::video::VideoFrame;
use super::waiting::{SLICE, check_patience, wait_for};
use crate::event::Event;
use crate::geometry::environment::Environment;
use crate::math::rows;
use crate::reasoning::Predictor;
use crate::run::{Latest, Next, Options, Reader, Run, Step};
use crate::source::{LatestVideo, Recorder, Tape, Taped};
use crate::time;
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use std::boxed::Box;
use std::collections::{BTreeMap, VecDeque};
use std::format;
use std::path::PathBuf;
use std::string::String;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use std::vec::Vec;

/// An iterator of events, and a context manager.
#[pyclass(frozen, weakref, module = "physinc")]
pub struct Stream {
    feed: Feed,
    timeout: Option<Duration>,
    closed: AtomicBool,
    interrupted: AtomicBool,
    now: Mutex<Now>,
    shown: Option<Shown<Latest, Frame>>,
    filmed: Option<Shown<LatestVideo, VideoFrame>>,
    tape: Option<Tape>,
    /// What the user's own law raised, if there is one.
    raised: Option<Raised>,
}

/// Where images come from, if they are wanted, and the newest that was handed out.
struct Shown<L, F> {
    latest: Arc<L>,
    newest: Mutex<Option<Py<F>>>,
}

impl<L, F> Shown<L, F> {
    fn new(latest: Arc<L>) -> Self {
        Self { latest, newest: Mutex::new(None) }
    }

    /// The newest, which `take` makes of what is there anew.
    fn newest(&self, py: Python<'_>, take: impl FnOnce(&L) -> PyResult<Option<Py<F>>>) -> PyResult<Option<Py<F>>> {
        let mut newest = self.newest.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(image) = take(&self.latest)? {
            *newest = Some(image);
        }
        Ok(newest.as_ref().map(|image| image.clone_ref(py)))
    }
}

#[allow(clippy::large_enum_variant)] // There are few streams.
enum Feed {
    Reader(Reader),
    Iterable(Mutex<Iterable>),
}

/// After the last step that was handed out.
#[derive(Default)]
struct Now {
    events: VecDeque<Event>,
    predictors: Vec<Predictor>,
    environment: Arc<Environment>,
    counters: crate::event::Counters,
    busy: Duration,
    arrival_ns: Option<i64>,
}

#[pymethods]
impl Stream {
    fn __iter__(slf: PyRef<'_, Self>) -> PyRef<'_, Self> {
        slf
    }

    fn __next__(&self, py: Python<'_>) -> PyResult<Option<Py<PyAny>>> {
        while !self.closed.load(Ordering::Relaxed) {
            if let Some(event) = self.now().events.pop_front() {
                return event::to_python(py, event).map(Some);
            }
            let outcome = match &self.feed {
                Feed::Reader(reader) => self.wait(py, reader),
                Feed::Iterable(iterable) => match iterable.try_lock() {
                    Ok(mut iterable) => iterable.step(py, self.interrupted.load(Ordering::Relaxed)),
                    // Whoever iterates goes on.
                    Err(_) => return Err(PyValueError::new_err("the stream is already being iterated")),
                },
            };
            match outcome {
                Ok(Some(Step { events, predictors, environment, counters, busy, arrival_ns })) => {
                    *self.now() = Now { events: events.into(), predictors, environment, counters, busy, arrival_ns };
                }
                Ok(None) => {
                    let closed = self.close(py);
                    return self.raised().map_or(closed.map(|()| None), Err);
                }
                Err(error) => {
                    // Silence and Ctrl-C leave the stream as it is, what else went wrong ends it.
                    if !error.is_instance_of::<StreamTimeoutError>(py) && !error.is_instance_of::<pyo3::exceptions::PyKeyboardInterrupt>(py)
                    {
                        // What went wrong first is told.
                        let _ = self.close(py);
                    }
                    return Err(error);
                }
            }
        }
        self.raised().map_or(Ok(None), Err)
    }

    fn __enter__(slf: PyRef<'_, Self>) -> PyRef<'_, Self> {
        slf
    }

    #[pyo3(signature = (*_exception))]
    fn __exit__(&self, py: Python<'_>, _exception: &Bound<'_, pyo3::types::PyTuple>) -> PyResult<()> {
        self.close(py)
    }

    /// Stops reading; no more events. A device can be opened again afterwards, and a recording is complete.
    fn close(&self, py: Python<'_>) -> PyResult<()> {
        self.closed.store(true, Ordering::Relaxed);
        self.interrupted.store(true, Ordering::Relaxed);
        py.detach(|| self.release());
        py.detach(|| self.tape.as_ref().map_or(Ok(()), Tape::finish))?;
        Ok(())
    }

    /// Ends the stream as Ctrl-C does: what is known becomes final, and `stream_ended` is the last event.
    fn interrupt(&self, py: Python<'_>) {
        self.interrupted.store(true, Ordering::Relaxed);
        if let Feed::Reader(reader) = &self.feed {
            // A frame that is being reasoned about may wait for the interpreter, which the user's own law needs.
            py.detach(|| reader.interrupt());
        }
    }

    /// What went through up to the last event.
    #[getter]
    fn stats(&self) -> Counters {
        Counters(self.now().counters)
    }

    /// How long the engine worked up to the last event, s.
    #[getter]
    fn busy(&self) -> f64 {
        self.now().busy.as_secs_f64()
    }

    /// When the last packet arrived of the frame that the last event came with, ns; `None` where no packets come.
    ///
    /// Of a live Kinect it is comparable with `time.time_ns()`.
    #[getter]
    fn arrival_ns(&self) -> Option<i64> {
        self.now().arrival_ns
    }

    /// What the user should know of the source, once the stream is over, a line each.
    #[getter]
    fn remarks(&self) -> Vec<String> {
        match &self.feed {
            Feed::Reader(reader) => reader.remarks(),
            Feed::Iterable(_) => Vec::new(),
        }
    }

    /// The newest image of a stream with `frames=True`, if there was one; it may be ahead of the events.
    ///
    /// Raises `ValueError` where images were not asked for.
    #[getter]
    fn frame(&self, py: Python<'_>) -> PyResult<Option<Py<Frame>>> {
        let Some(shown) = &self.shown else {
            return Err(PyValueError::new_err("images are handed out by physinc.stream(..., frames=True)"));
        };
        shown.newest(py, |latest| latest.take().map(|picture| Py::new(py, Frame::new(picture))).transpose())
    }

    /// The newest image of `stream("kinect?video=color")`, or `infrared`, if there was one; it may be ahead of the events.
    ///
    /// Raises `ValueError` where video was not asked for.
    #[getter]
    fn video(&self, py: Python<'_>) -> PyResult<Option<Py<VideoFrame>>> {
        let Some(filmed) = &self.filmed else {
            let what = "video comes from physinc.stream(\"kinect?video=color\"), or video=infrared";
            return Err(PyValueError::new_err(what));
        };
        filmed.newest(py, |latest| latest.take().map(|image| Py::new(py, VideoFrame::new(image))).transpose())
    }

    /// The live tracks by number, as of the last event.
    #[getter]
    fn tracks(&self) -> BTreeMap<u32, Track> {
        let now = self.now();
        let track = |predictor: &Predictor| Track { predictor: predictor.clone(), environment: Arc::clone(&now.environment) };
        now.predictors.iter().map(|predictor| (predictor.track(), track(predictor))).collect()
    }
}

impl Stream {
    fn new(
        feed: Feed,
        timeout: Option<Duration>,
        latest: Option<Arc<Latest>>,
        video: Option<Arc<LatestVideo>>,
        tape: Option<Tape>,
        raised: Option<Raised>,
    ) -> Self {
        Self {
            feed,
            timeout,
            closed: AtomicBool::new(false),
            interrupted: AtomicBool::new(false),
            now: Mutex::default(),
            shown: latest.map(Shown::new),
            filmed: video.map(Shown::new),
            tape,
            raised,
        }
    }

    /// Lets go of the source.
    fn release(&self) {
        if let Feed::Reader(reader) = &self.feed {
            reader.release();
        }
    }

    fn now(&self) -> MutexGuard<'_, Now> {
        self.now.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// What the user's own law raised, once.
    fn raised(&self) -> Option<PyErr> {
        self.raised.as_ref().and_then(Raised::take)
    }

    fn wait(&self, py: Python<'_>, reader: &Reader) -> PyResult<Option<Step>> {
        let mut start = Instant::now();
        loop {
            match py.detach(|| reader.next(SLICE)) {
                Next::Step(step) => return Ok(Some(step)),
                Next::Over(outcome) => return outcome.map(|()| None).map_err(PyErr::from),
                // Whoever said how long it may be away does not mind the silence.
                Next::Silence if reader.is_away() => start = Instant::now(),
                Next::Silence => {}
            }
            py.check_signals()?;
            check_patience(start, self.timeout)?;
        }
    }
}

impl Drop for Stream {
    /// Not with the interpreter in hand, which the user's own law may be waiting for on the reader's thread.
    fn drop(&mut self) {
        Python::try_attach(|py| py.detach(|| self.release()));
    }
}

/// A live track.
#[pyclass(frozen, module = "physinc")]
pub struct Track {
    predictor: Predictor,
    environment: Arc<Environment>,
}

#[pymethods]
impl Track {
    /// Its number in the stream.
    #[getter]
    fn track(&self) -> u32 {
        self.predictor.track()
    }

    /// Where it will be by the laws of physics: center [3] (m, world) and covariance [3, 3] (m²).
    ///
    /// Where the environment is known, told or seen behind all objects, it bounces off what it meets there, and rolls where it bounces no more.
    /// `t` is in seconds on the stream's clock, `timestamp_ns` the same in ns. Raises `ValueError` where that is so far away that no finite
    /// numbers tell it.
    #[pyo3(signature = (t=None, *, timestamp_ns=None))]
    fn predict<'py>(&self, py: Python<'py>, t: Option<f64>, timestamp_ns: Option<i64>) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
        let timestamp_ns = match (t, timestamp_ns) {
            (Some(t), None) if t.is_finite() => time::after(0, t),
            (None, Some(timestamp_ns)) => timestamp_ns,
            _ => return Err(PyTypeError::new_err("predict takes t (s on the stream's clock, finite) or timestamp_ns")),
        };
        let (center, covariance) = self.predictor.predict_among(&self.environment, timestamp_ns);
        if !center.iter().chain(&covariance).all(|x| x.is_finite()) {
            let t = timestamp_ns as f64 / 1e9;
            return Err(PyValueError::new_err(format!("t = {t} s is too far from where track {} was seen to be predicted", self.track())));
        }
        Ok((array1(py, center.as_slice()), array2(py, &rows(&covariance))?))
    }

    fn __repr__(&self) -> String {
        format!("Track({})", self.predictor.track())
    }
}

/// Opens a source by name. `name` is what the stream calls it, `gravity` what an accelerometer in its camera tells; what it
/// delivers is recorded in `record`, in TUM's layout with `tum`.
#[pyfunction]
#[pyo3(signature = (source, *, name, config, camera, positions, provisional, images, gravity, frames, duration, every_frame, reconnect, record, tum, timeout, law))]
#[allow(clippy::too_many_arguments, clippy::fn_params_excessive_bools)] // They are Python's.
pub fn open_source(
    py: Python<'_>,
    source: &str,
    name: Option<&str>,
    config: Option<&Bound<'_, PyAny>>,
    camera: Option<&Bound<'_, PyAny>>,
    positions: bool,
    provisional: bool,
    images: bool,
    gravity: Option<[f64; 3]>,
    frames: Option<u64>,
    duration: Option<f64>,
    every_frame: bool,
    reconnect: Option<f64>,
    record: Option<PathBuf>,
    tum: bool,
    timeout: Option<f64>,
    law: Option<&Bound<'_, PyAny>>,
) -> PyResult<Stream> {
    let timeout = match timeout {
        None => None,
        Some(seconds) if seconds > 0.0 => Duration::try_from_secs_f64(seconds).ok(),
        Some(seconds) => return Err(PyValueError::new_err(format!("timeout = {seconds}: expected seconds above 0, or None"))),
    };
    let mut config = config::config(config)?;
    let camera = config::camera(camera)?;
    config.camera.gravity_in_camera = gravity.or(config.camera.gravity_in_camera);
    let (law, raised) = law.map(|law| StreamLaw::new(law, &config)).transpose()?.unzip();
    let (named, theirs) = (String::from(source), config.clone());
    let patience = timeout.filter(|_| crate::source::may_be_silent(&named));
    let mut source = wait_for(py, patience, move || crate::source::open(&named, &theirs, camera.read()?.as_ref()))??;
    if let Some(seconds) = reconnect {
        source.wait_for_return(Duration::try_from_secs_f64(seconds).unwrap_or(Duration::MAX));
    }
    let tape = record.map(|out| Recorder::new(&*source, &out, tum)).transpose()?.map(Tape::new);
    if let Some(tape) = &tape {
        source = Box::new(Taped::new(source, tape.clone()));
    }
    let options = Options { positions, provisional, frames, duration, every_frame };
    let mut run = Run::of(&*source, name.unwrap_or(source.name()), &config, options)?;
    let latest = images.then(Arc::<Latest>::default);
    if let Some(latest) = &latest {
        run.show(Arc::clone(latest));
    }
    if let Some(law) = law {
        run.obey(Box::new(law));
    }
    let video = source.video();
    Ok(Stream::new(Feed::Reader(Reader::spawn(source, run)), timeout, latest, video, tape, raised))
}

/// Takes frames or positions from a Python iterable.
#[pyfunction]
#[pyo3(signature = (items, *, config, camera, positions, provisional, images, law))]
pub fn open_iterable(
    items: &Bound<'_, PyAny>,
    config: Option<&Bound<'_, PyAny>>,
    camera: Option<&Bound<'_, PyAny>>,
    positions: bool,
    provisional: bool,
    images: bool,
    law: Option<&Bound<'_, PyAny>>,
) -> PyResult<Stream> {
    let mut config = config::config(config)?;
    if let Some(camera) = config::camera(camera)?.read()? {
        config.camera = config.camera.or(&camera);
    }
    config.validate()?;
    let (law, raised) = law.map(|law| StreamLaw::new(law, &config)).transpose()?.unzip();
    let options = Options { positions, provisional, ..Options::default() };
    let latest = images.then(Arc::<Latest>::default);
    let feed = Feed::Iterable(Mutex::new(Iterable::new(items, config, options, latest.clone(), law)?));
    Ok(Stream::new(feed, None, latest, None, None, raised))
}
