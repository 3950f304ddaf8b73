//! Normal equations under noise that neighbouring pixels share, and how to see whether it is as large as thought.

use super::noise::{Score, ScoreCovariance};
use crate::math::{Mat3, Vec3, symmetric};
use nalgebra::Vector2;

/// Normal equations of one kind of evidence, H · step = g, and its residuals' part in two patterns that no ball has.
#[derive(Default)]
pub struct Equations {
    /// H.
    pub hessian: Mat3,
    /// g.
    pub gradient: Vec3,
    /// Sums over the residuals, weighted alike.
    pub patterns: Vector2<f64>,
}

impl Equations {
    /// Adds a pixel; its score is what it would add to `gradient` and `patterns` for a residual of `sd`.
    pub fn add(&mut self, jacobian: &Vec3, pattern: &Vector2<f64>, residual: f64, weight: f64, sd: f64) -> Score {
        self.hessian += jacobian * jacobian.transpose() * weight;
        self.gradient += jacobian * (weight * residual);
        self.patterns += pattern * (weight * residual);
        Score::new(jacobian.x, jacobian.y, jacobian.z, pattern.x, pattern.y) * (weight * sd)
    }

    /// `scores` is the covariance of `gradient` as the correlated noise makes it. The estimate that these equations give has the information
    /// H S⁻¹ H, so that is what they count when they are joined with others.
    pub fn informed(&self, scores: &ScoreCovariance, factor: f64) -> Option<Self> {
        let scores: Mat3 = scores.fixed_view::<3, 3>(0, 0) * factor;
        let to_information = self.hessian * scores.try_inverse()?;
        let hessian = symmetric(&(to_information * self.hessian));
        Some(Self { hessian, gradient: to_information * self.gradient, patterns: self.patterns })
    }

    /// The patterns' mean square over its expectation: 1 where the noise is as modelled.
    pub fn check(&self, scores: &ScoreCovariance) -> f64 {
        let expected = scores.diagonal();
        0.5 * (self.patterns.x * self.patterns.x / expected[3] + self.patterns.y * self.patterns.y / expected[4])
    }
}

/// The twofold pattern of a direction (x, y): what an ellipse or a saddle has, and a ball has not.
pub fn twofold(x: f64, y: f64) -> Vector2<f64> {
    Vector2::new(x * x - y * y, 2.0 * x * y)
}

/// The threefold pattern of a direction: what a triangle has. Square windows leave twofold traces in a silhouette, but none of these.
pub fn threefold(x: f64, y: f64) -> Vector2<f64> {
    Vector2::new(x * (x * x - 3.0 * y * y), y * (3.0 * x * x - y * y))
}
