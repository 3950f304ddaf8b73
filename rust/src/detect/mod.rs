//! From a depth image to the balls in it, or to things of any shape.

pub mod background;
pub mod ball;
pub mod cloud;
pub mod compare;
pub mod components;
pub mod equations;
pub mod foreground;
pub mod fusion;
pub mod icp;
pub mod matching;
pub mod noise;
pub mod patch;
pub mod shape;
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

/// A ball, or a thing of any shape, as one frame shows it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Detection {
    /// Center, camera frame, m. Of any shape: the point that was its middle when it was first seen, as far as could be told, carried along by its
    /// motion. What only its far side would tell of the middle (the mean of what is seen lies before it) is taken from a ball of its size.
    pub center: Vec3,
    /// Of `center`, camera frame, m², as this view's noise makes it; the noise's correlation between neighbouring pixels included.
    pub covariance: Mat3,
    /// Of any shape: covariance of an error besides, camera frame, m², which its positions have in common: its first view's noise, and what each change
    /// of keyframe added. Of where it is `covariance` + `drift` tells, of how it moved `covariance`. 0 of a ball.
    pub drift: Mat3,
    /// The ball's radius, m; of any shape that of a ball that filled as many pixels when it was first seen.
    pub radius: f64,
    /// Pixels that took part in the fit.
    pub points: u32,
    /// Root mean square of their distances from the sphere, or from the keyframe's surface, m.
    pub residual_rms: f64,
    /// Row of its center, px: with a rolling readout it tells when it was seen.
    pub row: f64,
    /// Only whole balls are measured; the others say that something is there.
    pub blob: Blob,
    /// Number of the thing of any shape that it is, where shapes are followed.
    pub shape: Option<u32>,
}
