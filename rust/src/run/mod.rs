//! One stream from its first input to its last event: the engine, what the user wants to hear of it, and where it stops.

mod picture;
mod queue;
mod reader;
mod step;

pub use picture::{Latest, Picture, Samples};
pub use reader::{Next, Reader};
pub use step::Step;

use crate::config::Config;
use crate::engine::{Engine, Sink};
use crate::error::ConfigError;
use crate::event::{CameraModel, Counters, Disconnected, EndReason, Event, Kind, Reconnected, StreamEnded, StreamStarted};
use crate::geometry::camera::Camera;
use crate::geometry::environment::Environment;
use crate::physics::own::OwnLaw;
use crate::reasoning::Predictor;
use crate::seeing::{Image, SeeError};
use crate::source::{Input, Source};
use crate::time::seconds_between;
use std::boxed::Box;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// What is told, and how much is read.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Options {
    /// Tell every position.
    pub positions: bool,
    /// Tell events that a later one will replace.
    pub provisional: bool,
    /// Stop after so many frames, or instants of positions.
    pub frames: Option<u64>,
    /// Stop before the first input that is later than this after the first, s.
    pub duration: Option<f64>,
    /// A live source waits for whoever listens instead of dropping what he is too slow for.
    pub every_frame: bool,
}

/// The engine between `stream_started` and `stream_ended`.
pub struct Run {
    /// Large, and handed from thread to thread.
    engine: Box<Engine<'static>>,
    /// What the engine knows of the scene, to be handed out.
    environment: Arc<Environment>,
    options: Options,
    started: StreamStarted,
    span_ns: Option<(i64, i64)>,
    told: u64,
    busy: Duration,
    arrival_ns: Option<i64>,
    over: bool,
    /// Where each image goes that somebody wants to look at.
    latest: Option<Arc<Latest>>,
    camera: Option<Camera>,
}

impl Run {
    /// A stream of frames of `camera`, or of positions, that calls itself `source` (cut after 512 bytes).
    ///
    /// # Errors
    /// The first key of the configuration whose value can't be.
    pub fn new(source: &str, config: &Config, camera: Option<Camera>, options: Options) -> Result<Self, ConfigError> {
        Ok(Self::with(Box::new(Engine::new(config, camera.as_ref())?), source, camera.as_ref(), options))
    }

    /// A stream of what `source` delivers, that calls itself `name`.
    ///
    /// # Errors
    /// As of [`Run::new`].
    pub fn of(source: &dyn Source, name: &str, config: &Config, options: Options) -> Result<Self, ConfigError> {
        let camera = source.camera();
        let engine = match (&camera, source.kinect()) {
            (Some(camera), Some(kinect)) => Engine::new_for_packets(config, camera, kinect.packing),
            (camera, _) => Engine::new(config, camera.as_ref()),
        };
        Ok(Self::with(Box::new(engine?), name, camera.as_ref(), options))
    }

    fn with(engine: Box<Engine<'static>>, name: &str, camera: Option<&Camera>, options: Options) -> Self {
        let mut source = heapless::String::new();
        // What doesn't fit is cut: a name is there to be recognised.
        let _ = name.chars().try_for_each(|c| source.push(c));
        let world_from_camera = engine.world_from_camera().to_rows();
        let environment = Arc::new(engine.environment().clone());
        let started = StreamStarted { source, camera: camera.map(CameraModel::from), world_from_camera };
        Self {
            engine,
            environment,
            options,
            started,
            span_ns: None,
            told: 0,
            busy: Duration::ZERO,
            arrival_ns: None,
            over: false,
            latest: None,
            camera: camera.copied(),
        }
    }

    /// From now on the newest image is in `latest`, too.
    pub fn show(&mut self, latest: Arc<Latest>) {
        self.latest = Some(latest);
    }

    /// Objects that nobody touches move by `law` ([`Engine::obey`]); where it gives no answer the stream ends, as if its source had broken.
    pub fn obey(&mut self, law: Box<dyn OwnLaw + Send>) {
        self.engine.obey(law);
    }

    /// One input through the engine; its events go to `sink`. After the end nothing happens. Whether anything came of it: most packets
    /// only become a part of a frame.
    ///
    /// # Errors
    /// An image that is not the camera's, or not of the kind that the stream began with.
    pub fn push(&mut self, input: Input<'_>, sink: &mut dyn FnMut(Event)) -> Result<bool, SeeError> {
        if self.over {
            return Ok(false);
        }
        let Self { engine, options, started, span_ns, told, latest, camera, .. } = self;
        let frame = latest.as_ref().map_or(0, |_| engine.counters().frames);
        let mut tell = |event: Event| tell(event, options, told, sink);
        // When the frame that the input is, or completes, was handed over; and whether it is later than wanted.
        let (mut begun, mut late) = (None, false);
        let mut admit = |timestamp_ns: i64, image: Option<Image<'_>>, sink: &mut Sink<'_>| {
            let (first_ns, newest_ns) = span_ns.map_or((timestamp_ns, timestamp_ns), |(first, newest)| (first, newest.max(timestamp_ns)));
            late = options.duration.is_some_and(|duration| seconds_between(first_ns, timestamp_ns) > duration);
            if !late && span_ns.replace((first_ns, newest_ns)).is_none() {
                sink(Event { timestamp_ns, track: None, is_final: true, kind: started.clone().into() });
            }
            begun = Some(Instant::now());
            if let (Some(latest), Some(image), Some(camera), false) = (&latest, image, *camera, late) {
                latest.put(timestamp_ns, frame, image, camera);
            }
            !late
        };
        // What can't be seen begins no stream.
        if let Input::Frame { image, .. } = input {
            engine.check(image)?;
        }
        let mut arrival = None;
        match input {
            Input::Frame { timestamp_ns, image } if admit(timestamp_ns, Some(image), &mut tell) => {
                engine.frame(timestamp_ns, image, &mut tell)?;
            }
            Input::Positions { timestamp_ns, positions } if admit(timestamp_ns, None, &mut tell) => {
                engine.positions(timestamp_ns, positions, &mut tell);
            }
            Input::Packet { bytes, arrival_ns } => {
                arrival = Some(arrival_ns);
                engine.packet_if(bytes, arrival_ns, &mut |stamp_ns, image, sink| admit(stamp_ns, Some(image), sink), &mut tell)?;
            }
            Input::Disconnected(reason) => return Ok(self.remark(Disconnected { reason }, sink)),
            Input::Reconnected(reason) => {
                engine.begin_anew();
                return Ok(self.remark(Reconnected { reason }, sink));
            }
            Input::Silence | Input::Frame { .. } | Input::Positions { .. } => {}
        }
        let Some(begun) = begun else { return Ok(false) };
        self.busy += begun.elapsed();
        // That is learned once.
        if self.engine.environment().relief().is_some() && self.environment.relief().is_none() {
            self.environment = Arc::new(self.engine.environment().clone());
        }
        self.arrival_ns = arrival;
        if self.engine.is_lawless() {
            self.end(EndReason::Disconnected, sink);
        }
        if late || self.options.frames.is_some_and(|frames| self.engine.counters().frames >= frames) {
            self.end(EndReason::Limit, sink);
        }
        Ok(true)
    }

    /// Tells what happened to the device, if the stream has begun.
    fn remark(&mut self, kind: impl Into<Kind>, sink: &mut dyn FnMut(Event)) -> bool {
        let Some((_, timestamp_ns)) = self.span_ns else { return false };
        tell(Event { timestamp_ns, track: None, is_final: true, kind: kind.into() }, &self.options, &mut self.told, sink);
        true
    }

    /// Makes everything final and tells that the stream is over, once. A stream that never began tells nothing.
    pub fn end(&mut self, reason: EndReason, sink: &mut dyn FnMut(Event)) {
        if core::mem::replace(&mut self.over, true) {
            return;
        }
        let Some((_, timestamp_ns)) = self.span_ns else { return };
        let Self { engine, options, told, .. } = self;
        engine.finish(&mut |event| tell(event, options, told, sink));
        let counters = Counters { events: self.told + 1, ..self.engine.counters() };
        let kind = StreamEnded { reason, counters }.into();
        tell(Event { timestamp_ns, track: None, is_final: true, kind }, &self.options, &mut self.told, sink);
    }

    /// The camera of its frames; `None` for positions.
    pub fn camera(&self) -> Option<CameraModel> {
        self.started.camera
    }

    /// What is told, and how much is read.
    pub fn options(&self) -> Options {
        self.options
    }

    /// Some input came.
    pub fn has_begun(&self) -> bool {
        self.span_ns.is_some()
    }

    /// Nothing more will be told.
    pub fn is_over(&self) -> bool {
        self.over
    }

    /// What went through so far.
    pub fn counters(&self) -> Counters {
        Counters { events: self.told, ..self.engine.counters() }
    }

    /// How long the engine worked, but for putting packets together. No event says it: they are the same on every machine.
    pub fn busy(&self) -> Duration {
        self.busy
    }

    /// When the packet arrived that completed the newest frame, ns on the host's clock; `None` where no packets come.
    pub fn arrival_ns(&self) -> Option<i64> {
        self.arrival_ns
    }

    /// What is known of the scene.
    pub fn environment(&self) -> &Arc<Environment> {
        &self.environment
    }

    /// Where each live track will be.
    pub fn predictors(&self) -> impl Iterator<Item = Predictor> {
        self.engine.predictors()
    }
}

fn tell(event: Event, options: &Options, told: &mut u64, sink: &mut dyn FnMut(Event)) {
    let wanted = match event.kind {
        Kind::Position(_) => options.positions,
        _ => event.is_final || options.provisional,
    };
    if wanted {
        *told += 1;
        sink(event);
    }
}

impl From<&Camera> for CameraModel {
    fn from(camera: &Camera) -> Self {
        let &Camera { width, height, fx, fy, cx, cy, .. } = camera;
        Self { width: width as u32, height: height as u32, fx, fy, cx, cy }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::CameraConfig;
    use crate::geometry::camera::DepthCode;
    use crate::math::Vec3;
    use crate::source::measurement;
    use std::vec::Vec;

    fn names(options: Options, stamps: &[i64]) -> Vec<(Kind, i64)> {
        let mut run = Run::new("test", &Config::default(), None, options).unwrap();
        let mut events = Vec::new();
        for &timestamp_ns in stamps {
            run.push(Input::Positions { timestamp_ns, positions: &[] }, &mut |e| events.push((e.kind, e.timestamp_ns))).unwrap();
        }
        run.end(EndReason::EndOfSource, &mut |e| events.push((e.kind, e.timestamp_ns)));
        run.end(EndReason::Interrupted, &mut |_| panic!("a stream ends once"));
        events
    }

    fn ended(options: Options, stamps: &[i64]) -> (EndReason, u64, i64) {
        match names(options, stamps).pop() {
            Some((Kind::StreamEnded(end), timestamp_ns)) => (end.reason, end.counters.frames, timestamp_ns),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn begins_and_ends_once_and_counts_what_it_told() {
        let events = names(Options::default(), &[5, 7]);
        assert!(matches!(&events[0], (Kind::StreamStarted(e), 5) if e.source == "test" && e.camera.is_none()));
        let (Kind::StreamEnded(end), 7) = events.last().unwrap() else { panic!() };
        assert_eq!((end.reason, end.counters.events), (EndReason::EndOfSource, events.len() as u64));
    }

    #[test]
    fn stops_at_its_limits() {
        let frames = Options { frames: Some(2), ..Options::default() };
        assert_eq!(ended(frames, &[0, 1, 2, 3]), (EndReason::Limit, 2, 1));
        let duration = Options { duration: Some(0.5), ..Options::default() };
        assert_eq!(ended(duration, &[0, 500_000_000, 500_000_001]), (EndReason::Limit, 2, 500_000_000));
    }

    #[test]
    fn a_law_that_has_no_answer_ends_the_stream() {
        struct Mute(u32);
        impl OwnLaw for Mute {
            fn acceleration(&mut self, _: f64, _: &Vec3, _: &Vec3) -> Option<Vec3> {
                self.0 = self.0.checked_sub(1)?;
                Some(Vec3::zeros())
            }
        }
        let mut run = Run::new("test", &Config::default(), None, Options { positions: true, ..Options::default() }).unwrap();
        run.obey(Box::new(Mute(3)));
        let mut events = Vec::new();
        for timestamp_ns in (0..9).map(|i| i * 33_333_333) {
            let center = measurement(timestamp_ns, Vec3::zeros(), None, None, 0.03).unwrap();
            run.push(Input::Positions { timestamp_ns, positions: &[center] }, &mut |e| events.push(e.kind)).unwrap();
        }
        assert_eq!(events.iter().filter(|kind| matches!(kind, Kind::Position(_))).count(), 3);
        assert!(matches!(events.last(), Some(Kind::StreamEnded(end)) if end.reason == EndReason::Disconnected && end.counters.frames == 4));
    }

    #[test]
    fn a_stream_without_input_tells_nothing() {
        assert!(names(Options::default(), &[]).is_empty());
    }

    #[test]
    fn a_stream_begins_with_the_first_image_that_can_be_seen() {
        let keys = CameraConfig {
            width: Some(16),
            height: Some(16),
            fx: Some(20.0),
            fy: Some(20.0),
            cx: Some(7.5),
            cy: Some(7.5),
            ..CameraConfig::default()
        };
        let camera = Camera::from_config(&keys, DepthCode::Depth { units_per_metre: 1000.0 }).unwrap();
        let mut run = Run::new("test", &Config::default(), Some(camera), Options::default()).unwrap();
        let frame = |timestamp_ns, samples| Input::Frame { timestamp_ns, image: Image::U16(samples) };
        assert_eq!(Step::input(&mut run, frame(3, &[0; 255])).unwrap_err(), SeeError::Size { expected: 256, found: 255 });
        assert!(!run.has_begun() && run.counters() == Counters::default());
        let first = Step::input(&mut run, frame(5, &[0; 256])).unwrap().unwrap();
        assert!(matches!(&first.events[..], [Event { timestamp_ns: 5, kind: Kind::StreamStarted(_), .. }]));
        assert!(Step::input(&mut run, frame(7, &[])).is_err());
        let last = Step::end(&mut run, EndReason::Disconnected);
        assert!(
            matches!(last.events.last(), Some(Event { timestamp_ns: 5, kind: Kind::StreamEnded(end), .. }) if end.counters.events == 2)
        );
    }
}
