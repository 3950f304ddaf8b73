//! From positions to tracks.

pub mod activity;
pub mod assignment;
pub mod association;
pub mod decision;
pub mod drift;
pub mod expectation;
pub mod hypothesis;
pub mod interval;
pub mod motion;
pub mod noise;
pub mod object;
pub mod paper;
pub mod paper_activity;
pub mod passive;
pub mod window;

use crate::math::{Mat3, Vec3};

/// A ball's center (of any shape, its point of reference) at one instant, by our eyes or by someone else's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measurement {
    /// When it was there, ns: its frame's stamp and, with a rolling readout, its row's delay.
    pub time_ns: i64,
    /// Center, world, m.
    pub center: Vec3,
    /// Of `center`, m²; `None` where nobody knows: then it is estimated from flights.
    pub covariance: Option<Mat3>,
    /// Covariance, m², of an error besides that is common to measurements near in time, as a shape's drift is: it tells where the object is, and
    /// leaves alone how it moves.
    pub drift: Mat3,
    /// Center, camera frame, m; `None` where positions come without a camera.
    pub center_in_camera: Option<Vec3>,
    /// Number by which another tracker knows the object.
    pub label: Option<u32>,
    /// The ball's radius, m.
    pub radius: f64,
    /// Pixels that took part.
    pub points: Option<u32>,
    /// Root mean square of their residuals, m.
    pub residual_rms: Option<f64>,
    /// It can be measured; `false`: something is there, but cut or merged.
    pub whole: bool,
}
