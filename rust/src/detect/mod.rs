//! From a depth image to the balls in it.

pub mod background;
pub mod ball;
pub mod cloud;
pub mod compare;
pub mod components;
pub mod equations;
pub mod foreground;
pub mod icp;
pub mod noise;
pub mod patch;
pub mod sphere;
pub mod window;

use crate::math::{Mat3, Vec3};

/// What a blob of foreground turned out to be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Blob {
    /// A ball, all of it in view.
    Whole,
    /// A ball of which something hides a part: the edge of the image, another object.
    Cut,
    /// More than one ball, or a ball and something else.
    Merged,
}

/// A ball as one frame shows it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Detection {
    /// Center, camera frame, m.
    pub center: Vec3,
    /// Of `center`, camera frame, m²; the noise's correlation between neighbouring pixels included.
    pub covariance: Mat3,
    /// The ball's radius, m.
    pub radius: f64,
    /// Pixels that took part in the fit.
    pub points: u32,
    /// Root mean square of their distances from the sphere, m.
    pub residual_rms: f64,
    /// Row of its center, px: with a rolling readout it tells when it was seen.
    pub row: f64,
    /// Only whole balls are measured; the others say that something is there.
    pub blob: Blob,
}
