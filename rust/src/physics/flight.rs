//! A flight: measurements that one law explains from one position and one velocity.

use crate::math::{Mat3, Vec3};
use crate::physics::Sample;
use crate::physics::accumulator::Accumulator;
use crate::physics::gravity::Gravity;
use crate::physics::law::{Law, State};
use nalgebra::SMatrix;

/// Standard deviation of a velocity that nothing is known of, m/s an axis.
pub const VELOCITY_SD: f64 = 15.0;

/// A fitted flight. Unknowns, in the order of its covariance: position and velocity at the reference time, gravity.
#[derive(Clone, Debug, PartialEq)]
pub struct Flight {
    /// Position and velocity at the reference time, which is the last measurement's.
    pub state: State,
    /// Gravity, m/s².
    pub gravity: Vec3,
    /// 9×9, of (position, velocity, gravity).
    pub covariance: SMatrix<f64, 9, 9>,
    /// Weighted sum of squared residuals, priors included.
    pub chi2: f64,
    /// Log of the marginal likelihood.
    pub log_evidence: f64,
    /// How many measurements.
    pub count: usize,
}

/// Where an object should be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prediction {
    /// Center and velocity.
    pub state: State,
    /// Covariance of the center, m².
    pub covariance: Mat3,
}

impl Flight {
    /// The flight that explains `samples` (sorted by time) best under `law`, with what is known of gravity.
    /// `None` without samples, or where they are not finite.
    pub fn fit(law: &dyn Law, samples: &[Sample], gravity: &Gravity) -> Option<Self> {
        let last = samples.last()?;
        let mut flight = Self {
            state: State { t: last.t, position: last.position, velocity: first_velocity(samples, &gravity.mean) },
            gravity: gravity.mean,
            covariance: SMatrix::zeros(),
            chi2: 0.0,
            log_evidence: 0.0,
            count: samples.len(),
        };
        let mut spread = gravity.spread();
        // Drag bends by what the velocity is, gravity's size acts along what its direction is: twice is to a few µm.
        for _ in 0..3 {
            let mut fit = flight.observe(law, samples);
            fit_priors(&mut fit, gravity, &flight.gravity, spread);
            let solution = fit.solve()?;
            let step = solution.mean.fixed_rows::<3>(0).into_owned();
            flight.state.position = step;
            flight.state.velocity = solution.mean.fixed_rows::<3>(3).into();
            flight.gravity = solution.mean.fixed_rows::<3>(6).into();
            flight.covariance = solution.covariance;
            flight.chi2 = solution.chi2;
            flight.log_evidence = solution.log_evidence;
            spread = solution.covariance.fixed_view::<3, 3>(6, 6).trace() / 3.0;
        }
        Some(flight)
    }

    /// The normal equations of position, velocity (at the reference time) and gravity, linear about the present estimate.
    fn observe(&self, law: &dyn Law, samples: &[Sample]) -> Accumulator<9> {
        let mut fit = Accumulator::<9>::default();
        let mut state = self.state;
        for sample in samples.iter().rev() {
            state = state.at(sample.t, law, &self.gravity);
            let s = sample.t - self.state.t;
            let linear = self.state.position + self.state.velocity * s + self.gravity * (0.5 * s * s);
            // What the law bends beyond the linear model moves over to the measurement's side.
            let y = sample.position - (state.position - linear);
            fit.observe_point(&[1.0, s, 0.5 * s * s], &y, &sample.weight);
        }
        fit
    }

    /// What these measurements say about gravity when nothing else is known: (information, information · g).
    pub fn gravity_information(&self, law: &dyn Law, samples: &[Sample]) -> Option<(Mat3, Vec3)> {
        self.observe(law, samples).marginal(6)
    }

    /// Where the object is at time `t` (s) by Eq. 2: f of its history and the law, with the history's uncertainty.
    pub fn predict(&self, law: &dyn Law, t: f64) -> Prediction {
        let s = t - self.state.t;
        let c = |i: usize, j: usize| -> Mat3 { self.covariance.fixed_view::<3, 3>(3 * i, 3 * j).into() };
        let (a, b) = (s, 0.5 * s * s);
        let cross = c(0, 1) * a + c(0, 2) * b + c(1, 2) * (a * b);
        let covariance = c(0, 0) + c(1, 1) * (a * a) + c(2, 2) * (b * b) + cross + cross.transpose();
        Prediction { state: self.state.at(t, law, &self.gravity), covariance }
    }

    /// Standard deviation of gravity along one axis, m/s².
    pub fn gravity_sd(&self) -> f64 {
        crate::math::sqrt(self.covariance.fixed_view::<3, 3>(6, 6).trace() / 3.0)
    }

    /// How much worse the samples are explained than their noise lets expect, as a factor on variances; 1 where they aren't.
    pub fn excess(&self) -> f64 {
        (self.chi2 / (self.dof() - 3.0).max(1.0)).max(1.0)
    }

    /// Degrees of freedom that the fit left over.
    pub fn dof(&self) -> f64 {
        3.0 * self.count as f64 - 6.0
    }
}

fn fit_priors(fit: &mut Accumulator<9>, gravity: &Gravity, direction: &Vec3, spread: f64) {
    fit.expect_block(3, &Vec3::zeros(), &Mat3::from_diagonal_element(1.0 / (VELOCITY_SD * VELOCITY_SD)));
    gravity.constrain(fit, 6, direction, spread);
}

/// A velocity at the last sample to linearise about.
fn first_velocity(samples: &[Sample], gravity: &Vec3) -> Vec3 {
    let (Some(first), Some(last)) = (samples.first(), samples.last()) else { return Vec3::zeros() };
    let span = last.t - first.t;
    if span > 0.0 { (last.position - first.position) / span + gravity * (0.5 * span) } else { Vec3::zeros() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::physics::law::{FreeFall, FreeFallWithDrag};

    const G: Vec3 = Vec3::new(0.0, 0.0, -9.81);

    fn fly(law: &dyn Law, g: &Vec3) -> [Sample; 15] {
        let start = State { t: 0.0, position: Vec3::new(0.1, 1.5, 0.4), velocity: Vec3::new(1.0, -0.5, 3.0) };
        core::array::from_fn(|i| {
            let t = i as f64 / 30.0;
            Sample::isotropic(t, start.at(t, law, g).position, 1e-3)
        })
    }

    #[test]
    fn an_exact_flight_is_found_exactly() {
        let law = FreeFallWithDrag { drag: 0.02 };
        let samples = fly(&law, &G);
        let flight = Flight::fit(&law, &samples[..10], &Gravity::known(G)).unwrap();
        let there = flight.predict(&law, samples[14].t);
        assert!((there.state.position - samples[14].position).norm() < 2e-6);
        assert!(flight.chi2 < 1e-2 && there.covariance.trace() > flight.predict(&law, samples[9].t).covariance.trace());
    }

    #[test]
    fn tilted_gravity_is_found_from_its_size() {
        let tilted = Vec3::new(0.0, 4.4537, -8.7408);
        let samples = fly(&FreeFall, &tilted);
        let flight = Flight::fit(&FreeFall, &samples, &Gravity::of_known_size(G)).unwrap();
        assert!((flight.gravity - tilted).norm() < 0.02, "{}", flight.gravity);
        let (information, vector) = flight.gravity_information(&FreeFall, &samples).unwrap();
        let free = information.try_inverse().unwrap() * vector;
        assert!((free - tilted).norm() < 1e-4, "{free}");
    }

    #[test]
    fn covariances_are_those_of_the_errors() {
        // Errors of a linear fit are linear in the noise: one unit of noise on one sample moves the estimate by C Hᵀ W.
        let samples = fly(&FreeFall, &G);
        let base = Flight::fit(&FreeFall, &samples, &Gravity::known(G)).unwrap();
        let mut sum = Mat3::zeros();
        for i in 0..samples.len() {
            for axis in 0..3 {
                let mut moved = samples;
                moved[i].position[axis] += 1e-3;
                let d = Flight::fit(&FreeFall, &moved, &Gravity::known(G)).unwrap().state.velocity - base.state.velocity;
                sum += d * d.transpose();
            }
        }
        let stated: Mat3 = base.covariance.fixed_view::<3, 3>(3, 3).into();
        assert!((sum - stated).abs().max() < 1e-3 * stated.trace());
    }
}
