//! Frames or positions to events: seeing and reasoning in one, and the stream's time watched.

use crate::config::Config;
use crate::detect::{Blob, Detection};
use crate::error::ConfigError;
use crate::event::{Counters, Event, Kind};
use crate::geometry::camera::{Camera, Pose};
use crate::reasoning::{Predictor, Reasoning};
use crate::seeing::{Buffers, Image, SeeError, Seeing};
use crate::time::after;
use crate::timeline::Timeline;
use crate::track::Measurement;
use heapless::Vec;

/// Frames or positions to events.
///
/// It is handed its input with the input's time, and hands its events to a sink. It opens nothing, reads no clock and allocates
/// nothing, so the same input gives the same events to the last bit.
pub struct Engine<'b> {
    seeing: Option<Seeing<'b>>,
    camera: Option<Camera>,
    reasoning: Reasoning,
    timeline: Timeline,
    inputs: u64,
}

impl<'b> Engine<'b> {
    /// For depth images of `camera`, in `buffers` of its size (see [`Buffers::required`]).
    ///
    /// # Errors
    /// A value of the configuration that can't be, or buffers that are too small.
    pub fn for_frames(config: &Config, camera: &Camera, buffers: Buffers<'b>) -> Result<Self, ConfigError> {
        config.validate()?;
        let seeing = Seeing::new(camera, &config.object, config.tracking.background_frames, buffers)?;
        let reasoning = Reasoning::new(config, Some(camera));
        Ok(Self { seeing: Some(seeing), camera: Some(*camera), reasoning, timeline: Timeline::default(), inputs: 0 })
    }

    /// For positions by any tracker.
    ///
    /// # Errors
    /// A value of the configuration that can't be.
    pub fn for_positions(config: &Config) -> Result<Self, ConfigError> {
        config.validate()?;
        let reasoning = Reasoning::new(config, None);
        Ok(Self { seeing: None, camera: None, reasoning, timeline: Timeline::default(), inputs: 0 })
    }

    /// The pose that fixes the stream's world.
    pub fn world_from_camera(&self) -> Pose {
        self.reasoning.world_from_camera()
    }

    /// Takes in the next depth image. One whose stamp is not later than the last one's is counted and not used.
    ///
    /// # Errors
    /// The image is not the camera's, or there is no camera; nothing has changed then.
    pub fn frame(&mut self, timestamp_ns: i64, image: Image<'_>, sink: &mut dyn FnMut(Event)) -> Result<(), SeeError> {
        let (Some(seeing), Some(camera)) = (&mut self.seeing, &self.camera) else { return Err(SeeError::Kind) };
        seeing.check(image)?;
        let frame = self.inputs;
        self.inputs += 1;
        let Some(gaps) = self.timeline.advance(timestamp_ns) else { return Ok(()) };
        let mut detections: Vec<Detection, 16> = Vec::new();
        seeing.see(image, &mut detections)?;
        let pose = self.reasoning.world_from_camera();
        let readout = camera.readout / (camera.height as f64 - 1.0);
        let measured: Vec<Measurement, 16> = detections
            .iter()
            .map(|d| Measurement {
                time_ns: after(timestamp_ns, d.row * readout),
                center: pose.to_world(&d.center),
                covariance: Some(pose.covariance_to_world(&d.covariance)),
                center_in_camera: Some(d.center),
                label: None,
                radius: d.radius,
                points: Some(d.points),
                residual_rms: Some(d.residual_rms),
                whole: d.blob == Blob::Whole,
            })
            .collect();
        tell_gaps(gaps, timestamp_ns, sink);
        self.reasoning.push(timestamp_ns, frame, &measured, sink);
        Ok(())
    }

    /// Takes in all positions of one instant, at most 16 of them; none is an instant in which nothing was seen.
    pub fn positions(&mut self, timestamp_ns: i64, positions: &[Measurement], sink: &mut dyn FnMut(Event)) {
        let frame = self.inputs;
        self.inputs += 1;
        let Some(gaps) = self.timeline.advance(timestamp_ns) else { return };
        tell_gaps(gaps, timestamp_ns, sink);
        self.reasoning.push(timestamp_ns, frame, positions, sink);
    }

    /// Makes everything final.
    pub fn finish(&mut self, sink: &mut dyn FnMut(Event)) {
        if let Some(now) = self.timeline.newest() {
            tell_gaps([self.timeline.stall(now), None], now, sink);
        }
        self.reasoning.finish(sink);
    }

    /// Frames (or instants) taken in, of these dropped (stamps that are not later, frames too cluttered to be used), and positions for
    /// which there was no track left.
    pub fn counters(&self) -> Counters {
        Counters {
            frames: self.inputs,
            frames_dropped: self.timeline.dropped + self.seeing.as_ref().map_or(0, Seeing::cluttered),
            events_dropped: self.reasoning.homeless(),
            ..Counters::default()
        }
    }

    /// Where each tracked object is by the laws of physics.
    pub fn predictors(&self) -> impl Iterator<Item = Predictor> + '_ {
        self.reasoning.predictors()
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
}

fn tell_gaps(gaps: [Option<crate::event::Gap>; 2], timestamp_ns: i64, sink: &mut dyn FnMut(Event)) {
    for gap in gaps.into_iter().flatten() {
        sink(Event { timestamp_ns, track: None, is_final: true, kind: Kind::Gap(gap) });
    }
}
