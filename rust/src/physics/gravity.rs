//! What is known of gravity: its vector, or only its size.

use crate::math::{Mat3, Vec3, sqrt};
use crate::physics::accumulator::Accumulator;
use nalgebra::SVector;

/// Gaussian knowledge of the gravity vector, and perhaps of its size.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gravity {
    /// Best guess, m/s².
    pub mean: Vec3,
    /// Inverse of the guess's covariance, (s²/m)².
    pub information: Mat3,
    /// |g| where that is known, m/s².
    pub size: Option<f64>,
}

/// Gravity varies by this much on Earth and so may the size that was told, m/s².
const SIZE_SD: f64 = 0.02;
/// How far the direction may be from the guess before any flight was seen, m/s² an axis: upside down is 2 · 9.81.
const UNKNOWN_SD: f64 = 10.0;
/// Of a gravity of which nothing is known, m/s² an axis.
const ANY_SD: f64 = 1e3;

impl Gravity {
    /// The vector is known.
    pub fn known(vector: Vec3) -> Self {
        Self { mean: vector, information: Mat3::from_diagonal_element(1e8), size: None }
    }

    /// Only the size is known, and `guess` is a first direction.
    pub fn of_known_size(guess: Vec3) -> Self {
        Self { mean: guess, information: Mat3::from_diagonal_element(1.0 / (UNKNOWN_SD * UNKNOWN_SD)), size: Some(guess.norm()) }
    }

    /// Nothing is known but, perhaps, the size.
    pub fn free(size: Option<f64>) -> Self {
        Self { mean: Vec3::zeros(), information: Mat3::from_diagonal_element(1.0 / (ANY_SD * ANY_SD)), size }
    }

    /// How many numbers about it a fit has to find out.
    pub fn unknowns(&self) -> f64 {
        match self.size {
            _ if self.spread() < 1.0 => 0.0,
            Some(_) => 2.0,
            None => 3.0,
        }
    }

    /// Adds this knowledge to the normal equations of a fit whose unknowns from `first` on are gravity.
    pub fn constrain<const N: usize>(&self, fit: &mut Accumulator<N>, first: usize, direction: &Vec3, spread: f64) {
        fit.expect_block(first, &self.mean, &self.information);
        self.constrain_size(fit, first, direction, spread);
    }

    /// Adds what is known of the size. That is no linear observation: it is one along `direction`, the present estimate, as exactly as
    /// `spread`, its variance along one axis, permits.
    pub fn constrain_size<const N: usize>(&self, fit: &mut Accumulator<N>, first: usize, direction: &Vec3, spread: f64) {
        let (Some(size), norm) = (self.size, direction.norm()) else { return };
        // Along a direction that may as well be the opposite one, the size says nothing.
        if norm > 0.0 && spread < 0.25 * size * size {
            let mut row = SVector::<f64, N>::zeros();
            row.fixed_rows_mut::<3>(first).copy_from(&(direction / norm));
            let curvature = spread / size;
            fit.observe(&row, size, sqrt(SIZE_SD * SIZE_SD + curvature * curvature));
        }
    }

    /// Variance along one axis before any flight of this fit.
    pub fn spread(&self) -> f64 {
        3.0 / self.information.trace()
    }

    /// Squared Mahalanobis distance of what one flight says, `information` · g = `vector`, from what is known.
    pub fn disagreement(&self, information: &Mat3, vector: &Vec3) -> f64 {
        let (mean, covariance) = self.estimate();
        let flight = information.try_inverse().unwrap_or_else(|| Mat3::from_diagonal_element(f64::INFINITY));
        let difference = flight * vector - mean;
        (flight + covariance).cholesky().map_or(f64::INFINITY, |c| difference.dot(&c.solve(&difference)))
    }

    /// Adds what one flight says, `information` · g = `vector`, to the knowledge of the vector (not of the size).
    pub fn learn(&mut self, information: &Mat3, vector: &Vec3) {
        let sum = crate::math::symmetric(&(self.information + information));
        if let Some(cholesky) = sum.cholesky() {
            self.mean = cholesky.solve(&(self.information * self.mean + vector));
            self.information = sum;
        }
    }

    /// The best estimate with the size put in, and its covariance.
    pub fn estimate(&self) -> (Vec3, Mat3) {
        let (mut mean, mut spread) = (self.mean, self.spread());
        let mut covariance = Mat3::from_diagonal_element(spread);
        for _ in 0..4 {
            let mut fit = Accumulator::<3>::default();
            self.constrain(&mut fit, 0, &mean, spread);
            let Some(solution) = fit.solve() else { break };
            (mean, covariance) = (solution.mean, solution.covariance);
            spread = covariance.trace() / 3.0;
        }
        (mean, covariance)
    }
}
