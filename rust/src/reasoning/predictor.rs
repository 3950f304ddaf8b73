//! A live track, to be asked where it will be.

use crate::config::ObjectConfig;
use crate::geometry::environment::Environment;
use crate::math::{Mat3, Vec3};
use crate::physics::contact::RESTITUTION;
use crate::physics::course::Course;
use crate::physics::own::Motion;
use crate::scene::surfaces::Restitutions;
use crate::time::seconds_between;
use crate::track::object::{Outlook, Track};

/// A track as it is now, to be asked where the object will be: Eq. 2.
#[derive(Clone, Debug)]
pub struct Predictor {
    track: u32,
    epoch_ns: i64,
    outlook: Outlook,
    law: Motion<1>,
    gravity: Vec3,
    radius: f64,
    duration: f64,
    spin_sd: f64,
    restitutions: Restitutions,
}

impl Predictor {
    pub(super) fn new(
        track: &Track,
        outlook: Outlook,
        law: Motion<1>,
        gravity: Vec3,
        object: &ObjectConfig,
        restitutions: Restitutions,
    ) -> Self {
        let (duration, spin_sd) = (object.contact_duration, object.spin_sd);
        Self { track: track.id, epoch_ns: track.epoch_ns, outlook, law, gravity, radius: track.radius, duration, spin_sd, restitutions }
    }

    /// The track's number.
    pub fn track(&self) -> u32 {
        self.track
    }

    /// Center (world, m) at `timestamp_ns`, and its covariance (m²), if it touches nothing. What a user's own law answered last holds from
    /// then on.
    pub fn predict(&self, timestamp_ns: i64) -> (Vec3, Mat3) {
        let prediction = self.outlook.predict(&self.law, seconds_between(self.epoch_ns, timestamp_ns));
        (prediction.state.position, prediction.covariance)
    }

    /// The same in a known environment, the stream's ([`crate::reasoning::Reasoning::environment`]): the object bounces where it meets a
    /// surface, with the restitution that it showed there so far, and rolls where it bounces no more.
    pub fn predict_among(&self, environment: &Environment, timestamp_ns: i64) -> (Vec3, Mat3) {
        let course = Course {
            environment,
            law: &self.law,
            gravity: self.gravity,
            radius: self.radius,
            duration: self.duration,
            spin_sd: self.spin_sd,
            restitution: &|surface| self.restitutions.get(surface as usize).copied().unwrap_or(RESTITUTION),
        };
        let prediction = self.outlook.predict_among(&course, seconds_between(self.epoch_ns, timestamp_ns));
        (prediction.state.position, prediction.covariance)
    }
}
