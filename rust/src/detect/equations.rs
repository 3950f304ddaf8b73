//! Estimating equations under noise that neighbouring pixels share, and how to see whether it is as large as thought.

use super::window::Products;
use crate::math::{Mat3, Vec3, symmetric};
use nalgebra::{Matrix4x3, SVector};

/// weightsᵀ · residual = (weightsᵀ · jacobian) · step of one kind of evidence, for three unknowns; the fourth row weighs a pattern that no ball has.
pub struct Equations {
    /// weightsᵀ · jacobian.
    pub response: Matrix4x3<f64>,
    /// weightsᵀ · residual.
    pub moments: SVector<f64, 4>,
    /// Covariance of `moments` as the noise makes it.
    pub covariance: Products,
}

/// Normal equations, information · step = gradient.
pub struct Normal {
    /// Inverse covariance of the estimate.
    pub information: Mat3,
    /// See there.
    pub gradient: Vec3,
}

impl Equations {
    /// What they count when they are joined with others; `factor` on the noise's variance. `None` where they determine nothing.
    pub fn normal(&self, factor: f64) -> Option<Normal> {
        let response: Mat3 = self.response.fixed_rows::<3>(0).into_owned();
        let covariance: Mat3 = self.covariance.fixed_view::<3, 3>(0, 0) * factor;
        let to_information = response.transpose() * covariance.try_inverse()?;
        let gradient = to_information * self.moments.fixed_rows::<3>(0);
        Some(Normal { information: symmetric(&(to_information * response)), gradient })
    }

    /// The pattern's square over its expectation, after `step`: 1 in the mean where the noise is as modelled.
    pub fn check(&self, step: &Vec3) -> f64 {
        let left = self.moments[3] - (self.response.row(3) * step)[0];
        left * left / self.covariance[(3, 3)]
    }
}
