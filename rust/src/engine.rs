//! Packets, frames or positions to events: assembling, seeing and reasoning in one, and the stream's time watched.

use crate::attention::Attention;
use crate::config::{Config, SceneAssumption};
use crate::detect::{Blob, Detection};
use crate::error::ConfigError;
use crate::event::{Counters, Event, Gap, GapReason, Kind};
use crate::geometry::camera::{Camera, DepthCode, Pose};
use crate::geometry::environment::Environment;
use crate::kinect::disparity::{HEIGHT, Packing, WIDTH};
use crate::kinect::packet::FRAMES_PER_SECOND;
#[cfg(feature = "std")]
use crate::physics::own::OwnLaw;
use crate::reasoning::{Predictor, Reasoning};
use crate::seeing::{Buffers, Image, Scope, SeeError, Seeing, Slice};
use crate::stream::assembler::Assembler;
use crate::stream::frame;
use crate::time::{after, seconds_between};
use crate::timeline::Timeline;
use crate::track::Measurement;
use core::ops::Range;
use heapless::Vec;

/// Where events go.
pub(crate) type Sink<'s> = dyn FnMut(Event) + 's;

/// Reasoning is some hundred KB: too much to be handed on by value where there is a heap.
#[cfg(feature = "std")]
type Mind = std::boxed::Box<Reasoning>;
#[cfg(not(feature = "std"))]
type Mind = Reasoning;

/// What a frame comes without.
#[derive(Default)]
struct Loss<'l> {
    /// Ranges of its samples, ascending.
    missing: &'l [Range<usize>],
    /// Packets, since the frame before.
    packets: u64,
}

/// Packets, frames or positions to events.
///
/// It is handed its input with the input's time, and hands its events to a sink. It opens nothing, reads no clock and allocates
/// nothing, so the same input gives the same events to the last bit.
pub struct Engine<'b> {
    assembler: Option<Assembler<Slice<'b, u8>>>,
    /// Packets lost that no gap has told of.
    untold: u64,
    /// The device was away since the frame before.
    was_away: bool,
    seeing: Option<Seeing<'b>>,
    attention: Attention,
    camera: Option<Camera>,
    reasoning: Mind,
    #[cfg(feature = "std")]
    own: Option<std::boxed::Box<dyn OwnLaw + Send>>,
    timeline: Timeline,
    inputs: u64,
}

impl<'b> Engine<'b> {
    /// For depth images of `camera`, in `buffers` of its size (see [`Buffers::required`]).
    ///
    /// # Errors
    /// A value of the configuration that can't be, or buffers that are too small.
    pub fn for_frames(config: &Config, camera: &Camera, buffers: Buffers<'b>) -> Result<Self, ConfigError> {
        let seeing = see(config, camera, buffers)?;
        Ok(Self::with(config, Some(camera), Some(seeing), None))
    }

    /// For the packets of a Kinect's depth endpoint, whose frames are packed as `packing` and seen by `camera`: in `buffers` as of
    /// [`Engine::for_frames`], and `packed` of [`Packing::frame_bytes`] at least.
    ///
    /// # Errors
    /// A value of the configuration that can't be, a camera that is no Kinect's, or buffers that are too small.
    pub fn for_packets(
        config: &Config,
        camera: &Camera,
        packing: Packing,
        buffers: Buffers<'b>,
        packed: Slice<'b, u8>,
    ) -> Result<Self, ConfigError> {
        if (camera.width, camera.height) != (WIDTH, HEIGHT) || !matches!(camera.code, DepthCode::Disparity { .. }) {
            return Err(ConfigError {
                key: "camera.width",
                value: camera.width as f64,
                expected: "640 (height 480) of a Kinect's disparity",
            });
        }
        let (key, value) = ("packed", packed.len() as f64);
        let assembler = Assembler::new(packing, packed).map_err(|_| ConfigError {
            key,
            value,
            expected: "as many bytes as `Packing::frame_bytes` says, at least",
        })?;
        let seeing = see(config, camera, buffers)?;
        Ok(Self::with(config, Some(camera), Some(seeing), Some(assembler)))
    }

    /// For positions by any tracker.
    ///
    /// # Errors
    /// A value of the configuration that can't be.
    pub fn for_positions(config: &Config) -> Result<Self, ConfigError> {
        config.validate()?;
        Ok(Self::with(config, None, None, None))
    }

    /// In one place and inlined: an engine is large, and each call that hands it on may copy it.
    #[inline]
    fn with(config: &Config, camera: Option<&Camera>, seeing: Option<Seeing<'b>>, assembler: Option<Assembler<Slice<'b, u8>>>) -> Self {
        Self {
            assembler,
            untold: 0,
            was_away: false,
            seeing,
            attention: Attention::new(config),
            camera: camera.copied(),
            reasoning: mind(config, camera),
            #[cfg(feature = "std")]
            own: None,
            timeline: Timeline::default(),
            inputs: 0,
        }
    }

    /// The pose that fixes the stream's world.
    pub fn world_from_camera(&self) -> Pose {
        self.reasoning.world_from_camera()
    }

    /// Takes in a packet of the depth endpoint that arrived at `arrival_ns` on the host's clock. A frame that it ends is seen; what of it
    /// is missing is known to be, and what was lost before it is told as a gap.
    ///
    /// # Errors
    /// The engine is not for packets.
    pub fn packet(&mut self, bytes: &[u8], arrival_ns: i64, sink: &mut dyn FnMut(Event)) -> Result<(), SeeError> {
        self.packet_if(bytes, arrival_ns, &mut |_, _, _| true, sink)
    }

    /// Takes in a packet; a frame that it ends is passed over unless `wanted`, handed its stamp, itself and the sink, says so.
    pub(crate) fn packet_if(
        &mut self,
        bytes: &[u8],
        arrival_ns: i64,
        wanted: &mut dyn FnMut(i64, Image<'_>, &mut Sink<'_>) -> bool,
        sink: &mut dyn FnMut(Event),
    ) -> Result<(), SeeError> {
        // The frame is seen in the assembler's buffer, while the rest of the engine is at work.
        let Some(mut assembler) = self.assembler.take() else { return Err(SeeError::NoPackets) };
        let mut outcome = Ok(());
        assembler.push(bytes, arrival_ns, &mut |frame| {
            if wanted(frame.timestamp_ns, Image::Packed { packed: frame.packed, packing: frame.packing }, sink) {
                outcome = self.assembled(&frame, sink);
            }
        });
        self.assembler = Some(assembler);
        outcome
    }

    fn assembled(&mut self, frame: &frame::Frame<'_>, sink: &mut dyn FnMut(Event)) -> Result<(), SeeError> {
        let missing: Vec<Range<usize>, { frame::MOST_HOLES }> = frame.missing().collect();
        let image = Image::Packed { packed: frame.packed, packing: frame.packing };
        self.take_in(frame.timestamp_ns, image, &Loss { missing: &missing, packets: frame.lost }, sink)
    }

    /// The device of the packets was away, and is back: its next frame ends a gap.
    pub fn begin_anew(&mut self) {
        self.was_away = true;
        if let Some(assembler) = &mut self.assembler {
            assembler.begin_anew();
        }
    }

    /// Takes in the next depth image. One whose stamp is not later than the last one's is counted and not used.
    ///
    /// # Errors
    /// The image is not the camera's, or there is no camera; nothing has changed then.
    pub fn frame(&mut self, timestamp_ns: i64, image: Image<'_>, sink: &mut dyn FnMut(Event)) -> Result<(), SeeError> {
        self.take_in(timestamp_ns, image, &Loss::default(), sink)
    }

    /// Whether [`Engine::frame`] would take `image`.
    ///
    /// # Errors
    /// The image is not the camera's, or there is no camera.
    pub fn check(&self, image: Image<'_>) -> Result<(), SeeError> {
        self.seeing.as_ref().ok_or(SeeError::NoCamera)?.check(image)
    }

    fn take_in(&mut self, timestamp_ns: i64, image: Image<'_>, loss: &Loss<'_>, sink: &mut dyn FnMut(Event)) -> Result<(), SeeError> {
        self.check(image)?;
        let (Some(seeing), Some(camera)) = (&mut self.seeing, &self.camera) else { return Err(SeeError::NoCamera) };
        let frame = self.inputs;
        self.inputs += 1;
        self.untold += loss.packets;
        let before = self.timeline.newest();
        let Some(mut gaps) = self.timeline.advance(timestamp_ns) else { return Ok(()) };
        let was_away = core::mem::take(&mut self.was_away);
        if was_away || self.untold > 0 || !loss.missing.is_empty() {
            let packets = core::mem::take(&mut self.untold);
            let gap = packets_lost(before, timestamp_ns, packets, loss.missing);
            gaps[1] = Some(if was_away { Gap { reason: GapReason::Disconnected, packets: None, ..gap } } else { gap });
        }
        let mut detections: Vec<Detection, 16> = Vec::new();
        let bands = self.attention.bands(timestamp_ns, camera, &self.reasoning);
        let whole =
            seeing.see_in(image, Scope { missing: loss.missing, bands: &bands, timestamp_ns: Some(timestamp_ns) }, &mut detections)?;
        let pose = self.reasoning.world_from_camera();
        let row_time = camera.row_time();
        let measured: Vec<Measurement, 16> = detections
            .iter()
            .map(|d| Measurement {
                time_ns: after(timestamp_ns, d.row * row_time),
                center: pose.to_world(&d.center),
                covariance: Some(pose.covariance_to_world(&d.covariance)),
                drift: pose.covariance_to_world(&d.drift),
                center_in_camera: Some(d.center),
                label: d.shape,
                radius: d.radius,
                points: Some(d.points),
                residual_rms: Some(d.residual_rms),
                whole: d.blob == Blob::Whole,
            })
            .collect();
        tell_gaps(gaps, timestamp_ns, sink);
        self.reasoning.see_structure(seeing.structure(&pose));
        if let Some(relief) = seeing.surveyed() {
            self.reasoning.see_relief(relief);
        }
        self.reason(timestamp_ns, frame, &measured, sink);
        self.attention.saw(timestamp_ns, whole, &detections, self.reasoning.tracks());
        Ok(())
    }

    /// Takes in all positions of one instant, at most 16 of them; none is an instant in which nothing was seen.
    pub fn positions(&mut self, timestamp_ns: i64, positions: &[Measurement], sink: &mut dyn FnMut(Event)) {
        let frame = self.inputs;
        self.inputs += 1;
        let Some(gaps) = self.timeline.advance(timestamp_ns) else { return };
        tell_gaps(gaps, timestamp_ns, sink);
        self.reason(timestamp_ns, frame, positions, sink);
    }

    fn reason(&mut self, timestamp_ns: i64, frame: u64, measured: &[Measurement], sink: &mut dyn FnMut(Event)) {
        #[cfg(feature = "std")]
        if let Some(own) = &mut self.own {
            return self.reasoning.push_by(Some(&mut **own), timestamp_ns, frame, measured, sink);
        }
        self.reasoning.push(timestamp_ns, frame, measured, sink);
    }

    /// Makes everything final.
    pub fn finish(&mut self, sink: &mut dyn FnMut(Event)) {
        if let Some(now) = self.timeline.newest() {
            tell_gaps([self.timeline.stall(now), None], now, sink);
        }
        self.reasoning.finish(sink);
    }

    /// Frames (or instants) taken in, of these dropped (stamps that are not later, frames too cluttered to be used), and positions of more
    /// balls than are told apart in a frame, or tracked, at once.
    pub fn counters(&self) -> Counters {
        Counters {
            frames: self.inputs,
            frames_dropped: self.timeline.dropped + self.seeing.as_ref().map_or(0, Seeing::cluttered),
            events_dropped: self.reasoning.homeless() + self.seeing.as_ref().map_or(0, Seeing::surplus),
            ..self.assembler.as_ref().map(Assembler::counters).unwrap_or_default()
        }
    }

    /// Whether its user's own law gave no answer: then it takes in nothing more.
    pub fn is_lawless(&self) -> bool {
        self.reasoning.is_lawless()
    }

    /// Where each tracked object is by the laws of physics.
    pub fn predictors(&self) -> impl Iterator<Item = Predictor> + '_ {
        self.reasoning.predictors()
    }

    /// What is known of the scene: what was told, and, once the background is learned, what the camera sees of it.
    pub fn environment(&self) -> &Environment {
        self.reasoning.environment()
    }
}

#[cfg(feature = "std")]
impl Engine<'static> {
    /// With buffers of its own; without a camera, for positions.
    ///
    /// # Errors
    /// A value of the configuration that can't be.
    pub fn new(config: &Config, camera: Option<&Camera>) -> Result<Self, ConfigError> {
        match camera {
            Some(camera) => Self::for_frames(config, camera, Buffers::owned(camera.width, camera.height)),
            None => Self::for_positions(config),
        }
    }

    /// From the first input on, objects that nobody touches move by `law` instead of gravity and the air
    /// (see [`Reasoning::push_by`] and [`Config::can_obey`]).
    pub fn obey(&mut self, law: std::boxed::Box<dyn OwnLaw + Send>) {
        self.own = Some(law);
    }

    /// For packets, with buffers of its own.
    ///
    /// # Errors
    /// As of [`Engine::for_packets`].
    pub fn new_for_packets(config: &Config, camera: &Camera, packing: Packing) -> Result<Self, ConfigError> {
        let packed = Slice::Owned(std::vec![0; packing.frame_bytes()]);
        Self::for_packets(config, camera, packing, Buffers::owned(camera.width, camera.height), packed)
    }
}

#[inline]
fn mind(config: &Config, camera: Option<&Camera>) -> Mind {
    #[cfg(feature = "std")]
    return std::boxed::Box::new(Reasoning::new(config, camera));
    #[cfg(not(feature = "std"))]
    Reasoning::new(config, camera)
}

/// What sees the images of `camera`; with a known scene, before that scene.
fn see<'b>(config: &Config, camera: &Camera, buffers: Buffers<'b>) -> Result<Seeing<'b>, ConfigError> {
    config.validate()?;
    let moves = config.camera_assumption(camera.pose.is_some()).moves();
    // What stands still does so for a camera that does.
    let background_frames = if moves { 0 } else { config.tracking.background_frames };
    let mut seeing = Seeing::new(camera, &config.object, background_frames, buffers)?;
    if moves {
        seeing.watch_structure();
    }
    if config.assume.scene == SceneAssumption::Known {
        let expected = "\"unknown\", or a camera whose world_from_camera is told";
        let pose = camera.pose.ok_or(ConfigError { key: "assume.scene", value: f64::NAN, expected })?;
        seeing.know(Environment::new(&config.environment), pose);
    }
    Ok(seeing)
}

/// The gap that ends with a frame before which, or of which, `packets` were lost. The device sends its frames at an even rate, which tells
/// how many never came.
fn packets_lost(before: Option<i64>, timestamp_ns: i64, packets: u64, missing: &[Range<usize>]) -> Gap {
    let start_ns = before.unwrap_or(timestamp_ns);
    let frames = (libm::round(seconds_between(start_ns, timestamp_ns) * FRAMES_PER_SECOND) as u64).saturating_sub(1);
    let samples = frames * (WIDTH * HEIGHT) as u64 + missing.iter().map(|range| range.len() as u64).sum::<u64>();
    let (frames, packets, samples) = (Some(frames), Some(packets), Some(samples));
    Gap { start_ns, end_ns: timestamp_ns, reason: GapReason::PacketsLost, frames, packets, samples }
}

fn tell_gaps(gaps: [Option<Gap>; 2], timestamp_ns: i64, sink: &mut dyn FnMut(Event)) {
    for gap in gaps.into_iter().flatten() {
        sink(Event { timestamp_ns, track: None, is_final: true, kind: Kind::Gap(gap) });
    }
}
