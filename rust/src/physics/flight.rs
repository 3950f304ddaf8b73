//! A flight: measurements that one law explains from one position and one velocity.

use crate::math::{Mat3, Vec3, sqrt};
use crate::physics::Sample;
use crate::physics::accumulator::Accumulator;
use crate::physics::gravity::Gravity;
use crate::physics::law::{Law, State};
use nalgebra::{SMatrix, SVector};

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
        let (mut flight, mut spread) = Self::start(samples, gravity)?;
        // Drag bends by what the velocity is, gravity's size acts along what its direction is: twice is to a few µm.
        for _ in 0..3 {
            let step = flight.improve(law, samples, gravity, &mut spread)?;
            if step.fixed_rows::<6>(0).norm() < 1e-6 {
                break;
            }
        }
        Some(flight)
    }

    /// Like [`Flight::fit`], until no unknown moves by more than a thousandth of its standard deviation: for any law, and for gravity
    /// of which nothing is known. `None` also where that never happens.
    pub fn fit_fully(law: &dyn Law, samples: &[Sample], gravity: &Gravity) -> Option<Self> {
        let (mut flight, mut spread) = Self::start(samples, gravity)?;
        for _ in 0..60 {
            let step = flight.improve(law, samples, gravity, &mut spread)?;
            let within = |i: usize| step[i] * step[i] <= 1e-6 * flight.covariance[(i, i)];
            if (0..9).all(within) {
                return Some(flight);
            }
        }
        None
    }

    /// [`Flight::fit_fully`] for samples with one unknown standard deviation (m), which their residuals tell: they are weighted by it,
    /// and it is returned. It is taken for no less than 1 µm. `None` also where nothing is left over to tell it.
    pub fn fit_with_noise(law: &dyn Law, samples: &mut [Sample], gravity: &Gravity) -> Option<(Self, f64)> {
        let freedom = 3.0 * samples.len() as f64 - 6.0 - gravity.unknowns();
        let mut sd: f64 = 1e-3;
        let mut flight = None;
        for _ in 0..6 {
            let weight = Mat3::from_diagonal_element(1.0 / (sd * sd));
            for sample in samples.iter_mut() {
                sample.weight = weight;
            }
            let fit = Self::fit_fully(law, samples, gravity).filter(|_| freedom > 0.0)?;
            let squares: f64 = fit.residuals(law, samples).map(|r| r.norm_squared()).sum();
            let (previous, estimate) = (sd, sqrt(squares / freedom).max(1e-6));
            flight = Some((fit, sd));
            sd = estimate;
            if (estimate - previous).abs() < 1e-3 * previous {
                break;
            }
        }
        flight
    }

    /// Begins at the last sample.
    fn start(samples: &[Sample], gravity: &Gravity) -> Option<(Self, f64)> {
        let last = samples.last()?;
        let flight = Self {
            state: State { t: last.t, position: last.position, velocity: first_velocity(samples, &gravity.mean) },
            gravity: gravity.mean,
            covariance: SMatrix::zeros(),
            chi2: 0.0,
            log_evidence: 0.0,
            count: samples.len(),
        };
        Some((flight, gravity.spread()))
    }

    /// One Gauss–Newton step, which is returned. `spread` is gravity's variance along one axis before, and then after it.
    fn improve(&mut self, law: &dyn Law, samples: &[Sample], gravity: &Gravity, spread: &mut f64) -> Option<SVector<f64, 9>> {
        let mut fit = self.observe(law, samples);
        fit_priors(&mut fit, gravity, &self.gravity, *spread);
        let solution = fit.solve()?;
        let mut before = solution.mean;
        before.fixed_rows_mut::<3>(0).copy_from(&self.state.position);
        before.fixed_rows_mut::<3>(3).copy_from(&self.state.velocity);
        before.fixed_rows_mut::<3>(6).copy_from(&self.gravity);
        self.state.position = solution.mean.fixed_rows::<3>(0).into();
        self.state.velocity = solution.mean.fixed_rows::<3>(3).into();
        self.gravity = solution.mean.fixed_rows::<3>(6).into();
        self.covariance = solution.covariance;
        self.chi2 = solution.chi2;
        self.log_evidence = solution.log_evidence;
        *spread = solution.covariance.fixed_view::<3, 3>(6, 6).trace() / 3.0;
        Some(solution.mean - before)
    }

    /// How far the samples are from the flight, m, from the last to the first.
    pub fn residuals<'a>(&self, law: &'a dyn Law, samples: &'a [Sample]) -> impl Iterator<Item = Vec3> + 'a {
        let gravity = self.gravity;
        samples.iter().rev().scan(self.state, move |state, sample| {
            *state = state.at(sample.t, law, &gravity);
            Some(sample.position - state.position)
        })
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
    fn the_size_of_gravity_comes_out_where_nothing_is_known_of_it() {
        let law = FreeFallWithDrag { drag: 0.02 };
        let moon = Vec3::new(0.3, 0.2, -1.6);
        for (size, within) in [(None, 1e-5), (Some(moon.norm()), 1e-5)] {
            let (flight, sd) = Flight::fit_with_noise(&law, &mut fly(&law, &moon), &Gravity::free(size)).unwrap();
            assert!((flight.gravity - moon).norm() < within && sd < 2e-6, "{flight:?}");
        }
        assert!(Flight::fit_with_noise(&law, &mut fly(&law, &moon)[..3], &Gravity::free(None)).is_none());
    }

    #[test]
    fn noise_is_told_by_the_residuals() {
        let mut samples = fly(&FreeFall, &G);
        for (i, sample) in samples.iter_mut().enumerate() {
            // Alternating: nothing that a parabola could follow.
            sample.position.x += if i % 2 == 0 { 2e-3 } else { -2e-3 };
        }
        let (flight, sd) = Flight::fit_with_noise(&FreeFall, &mut samples, &Gravity::known(G)).unwrap();
        let expected = sqrt(15.0 * 4e-6 / 39.0);
        assert!((sd / expected - 1.0).abs() < 0.03, "{sd}");
        assert!((flight.chi2 / 39.0 - 1.0).abs() < 0.01);
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
