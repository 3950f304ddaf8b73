//! A live track, to be asked where it will be.

use crate::math::{Mat3, Vec3};
use crate::physics::law::FreeFallWithDrag;
use crate::time::seconds_between;
use crate::track::object::Outlook;

/// A track as it is now, to be asked where the object will be: Eq. 2.
#[derive(Clone, Debug)]
pub struct Predictor {
    pub(super) track: u32,
    pub(super) epoch_ns: i64,
    pub(super) outlook: Outlook,
    pub(super) law: FreeFallWithDrag,
}

impl Predictor {
    /// The track's number.
    pub fn track(&self) -> u32 {
        self.track
    }

    /// Center (world, m) at `timestamp_ns`, and its covariance (m²).
    pub fn predict(&self, timestamp_ns: i64) -> (Vec3, Mat3) {
        let prediction = self.outlook.predict(&self.law, seconds_between(self.epoch_ns, timestamp_ns));
        (prediction.state.position, prediction.covariance)
    }
}
