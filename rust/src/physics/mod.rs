//! How a passive object moves, and how measurements disagree with it.

pub mod accumulator;
pub mod contact;
pub mod course;
pub mod factor;
pub mod flight;
pub mod gravity;
pub mod inconsistency;
pub mod law;
pub mod moments;
pub mod onset;
pub mod own;
pub mod paper;
pub mod restitution;
pub mod scale;
pub mod sequential;
pub mod split;
pub mod translation;
pub mod watch;

use crate::math::{Mat3, Vec3};

/// A measured center at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Time, s.
    pub t: f64,
    /// Center, m.
    pub position: Vec3,
    /// Inverse of the covariance of `position`, 1/m².
    pub weight: Mat3,
    /// Half the time over which it is a mean, s; 0 for a single measurement.
    pub half_span: f64,
}

/// The part of `samples` (sorted by time) with `from` ≤ t < `to`.
pub fn between(samples: &[Sample], from: f64, to: f64) -> &[Sample] {
    let start = samples.partition_point(|s| s.t < from);
    let end = samples.partition_point(|s| s.t < to);
    samples.get(start..end).unwrap_or_default()
}

impl Sample {
    /// Covariance of `position`, m².
    pub fn covariance(&self) -> Mat3 {
        self.weight.try_inverse().unwrap_or_else(|| Mat3::from_diagonal_element(f64::INFINITY))
    }

    /// A sample with the same standard deviation `sd` (m) along each axis.
    pub fn isotropic(t: f64, position: Vec3, sd: f64) -> Self {
        Self { t, position, weight: Mat3::from_diagonal_element(1.0 / (sd * sd)), half_span: 0.0 }
    }
}
