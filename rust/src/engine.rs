//! Frames or positions in, events out.

use crate::config::Config;
use crate::error::ConfigError;
use crate::event::{Counters, Event, Kind, Position, TrackReason, TrackStarted};
use crate::geometry::camera::{Camera, Pose};
use crate::math::{Mat3, Vec3, rows};
use crate::seeing::Image;
use crate::track::Measurement;

/// Stand-in.
pub struct Engine {
    pose: Pose,
    counters: Counters,
    newest_ns: Option<i64>,
    started: bool,
}

/// Where a track will be.
#[derive(Clone, Copy, Debug)]
pub struct Predictor {
    /// Its number.
    pub track: u32,
}

impl Predictor {
    /// Center (world, m) and covariance (m²) at a time.
    pub fn predict(&self, _timestamp_ns: i64) -> (Vec3, Mat3) {
        (Vec3::zeros(), Mat3::identity())
    }
}

impl Engine {
    /// # Errors
    /// A configuration that can't be.
    pub fn new(config: &Config, camera: Option<Camera>) -> Result<Self, ConfigError> {
        config.validate()?;
        let pose = camera.map_or(Pose { rotation: Mat3::identity(), translation: Vec3::zeros() }, |camera| {
            camera.pose.unwrap_or_else(Pose::renamed_axes)
        });
        Ok(Self { pose, counters: Counters::default(), newest_ns: None, started: false })
    }

    fn fresh(&mut self, timestamp_ns: i64) -> bool {
        self.counters.frames += 1;
        let fresh = self.newest_ns.is_none_or(|newest| timestamp_ns > newest);
        if fresh {
            self.newest_ns = Some(timestamp_ns)
        } else {
            self.counters.frames_dropped += 1
        }
        fresh
    }

    /// One frame.
    pub fn frame(&mut self, timestamp_ns: i64, _image: Image<'_>, _sink: &mut dyn FnMut(Event)) {
        self.fresh(timestamp_ns);
    }

    /// All positions of one instant.
    pub fn positions(&mut self, timestamp_ns: i64, positions: &[Measurement], sink: &mut dyn FnMut(Event)) {
        if !self.fresh(timestamp_ns) {
            return;
        }
        for measurement in positions {
            if !self.started {
                self.started = true;
                let kind = TrackStarted { reason: TrackReason::Appeared }.into();
                sink(Event { timestamp_ns, track: Some(1), is_final: true, kind });
            }
            let kind = Kind::Position(Position {
                frame: self.counters.frames - 1,
                center: measurement.center.into(),
                center_in_camera: None,
                covariance: rows(&measurement.covariance.unwrap_or_else(|| Mat3::identity() * 1e-6)),
                points: None,
                residual_rms: None,
            });
            sink(Event { timestamp_ns, track: Some(1), is_final: true, kind });
        }
    }

    /// Makes everything final.
    pub fn finish(&mut self, _sink: &mut dyn FnMut(Event)) {}

    /// As the engine saw them.
    pub fn counters(&self) -> Counters {
        self.counters
    }

    /// The stream's world.
    pub fn world_from_camera(&self) -> Pose {
        self.pose
    }

    /// The live tracks.
    pub fn predictors(&self) -> impl Iterator<Item = Predictor> {
        self.started.then_some(Predictor { track: 1 }).into_iter()
    }
}
