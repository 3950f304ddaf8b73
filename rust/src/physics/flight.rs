//! A flight: measurements that one law explains from one position and one velocity.

use crate::math::{Mat3, Vec3, sqrt};
use crate::physics::Sample;
use crate::physics::accumulator::{Accumulator, Estimate};
use crate::physics::gravity::Gravity;
use crate::physics::law::{Law, State};
use crate::physics::moments::{Moments, Pulls};
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
        let problem = Problem::new(law, samples, gravity);
        let (mut flight, mut spread) = problem.start()?;
        // Drag bends by what the velocity is: each step leaves less than a hundredth of what it moved. Gravity's size acts along what its
        // direction is, which is slower.
        let enough = if gravity.size.is_some() { 1e-6 } else { 1e-4 };
        let mut last = None;
        for _ in 0..3 {
            let step = problem.improve(&mut flight, &mut spread, &mut last)?;
            if step.fixed_rows::<6>(0).norm() < enough {
                break;
            }
        }
        flight.covariance = last?.covariance()?;
        Some(flight)
    }

    /// Like [`Flight::fit`], until no unknown moves by more than a thousandth of its standard deviation: for any law, and for gravity
    /// of which nothing is known. `None` also where that never happens.
    pub fn fit_fully(law: &dyn Law, samples: &[Sample], gravity: &Gravity) -> Option<Self> {
        let problem = Problem::new(law, samples, gravity);
        let (mut flight, mut spread) = problem.start()?;
        let mut last = None;
        for _ in 0..60 {
            let step = problem.improve(&mut flight, &mut spread, &mut last)?;
            flight.covariance = last.as_ref()?.covariance()?;
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

    /// How far the samples are from the flight, m, from the last to the first.
    pub fn residuals<'a>(&self, law: &'a dyn Law, samples: &'a [Sample]) -> impl Iterator<Item = Vec3> + 'a {
        let gravity = self.gravity;
        samples.iter().rev().scan(self.state, move |state, sample| {
            *state = state.at(sample.t, law, &gravity);
            Some(sample.position - state.position)
        })
    }

    /// What these measurements say about gravity when nothing else is known: (information, information · g).
    pub fn gravity_information(&self, law: &dyn Law, samples: &[Sample]) -> Option<(Mat3, Vec3)> {
        let mut fit = weighed(samples).normal_equations();
        observe(&mut fit, self, law, samples);
        fit.marginal(6)
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

/// What a flight is fitted to.
struct Problem<'a> {
    law: &'a dyn Law,
    samples: &'a [Sample],
    gravity: &'a Gravity,
    /// What is the same in each step: weights, times, and what was known before.
    known: Accumulator<9>,
}

impl<'a> Problem<'a> {
    fn new(law: &'a dyn Law, samples: &'a [Sample], gravity: &'a Gravity) -> Self {
        let mut known = weighed(samples).normal_equations();
        known.expect_block(3, &Vec3::zeros(), &Mat3::from_diagonal_element(1.0 / (VELOCITY_SD * VELOCITY_SD)));
        known.expect_block(6, &gravity.mean, &gravity.information);
        Self { law, samples, gravity, known }
    }

    /// A flight to linearise about, with gravity's variance along one axis.
    fn start(&self) -> Option<(Flight, f64)> {
        let (first, last, gravity) = (self.samples.first()?, self.samples.last()?, self.gravity.mean);
        let span = last.t - first.t;
        let mut velocity = Vec3::zeros();
        if span > 0.0 {
            let mean = (last.position - first.position) / span;
            let middle = (last.position + first.position) * 0.5;
            velocity = mean + self.law.acceleration(&gravity, last.t - 0.5 * span, &middle, &mean) * (0.5 * span);
        }
        let flight = Flight {
            state: State { t: last.t, position: last.position, velocity },
            gravity,
            covariance: SMatrix::zeros(),
            chi2: 0.0,
            log_evidence: 0.0,
            count: self.samples.len(),
        };
        Some((flight, self.gravity.spread()))
    }

    /// One Gauss–Newton step of `flight`, which is returned; `last` is the estimate before and then after it, and `spread` gravity's variance along
    /// one axis.
    fn improve(&self, flight: &mut Flight, spread: &mut f64, last: &mut Option<Estimate<9>>) -> Option<SVector<f64, 9>> {
        let mut fit = self.known.clone();
        observe(&mut fit, flight, self.law, self.samples);
        self.gravity.constrain_size(&mut fit, 6, &flight.gravity, *spread);
        // Only what is known of the size weighs differently in each step.
        let estimate = match last.take().filter(|_| self.gravity.size.is_none()) {
            Some(last) => fit.estimate_by(last.factor)?,
            None => fit.estimate()?,
        };
        let mut step = estimate.mean;
        for (i, unknown) in [(0, &mut flight.state.position), (3, &mut flight.state.velocity), (6, &mut flight.gravity)] {
            let mut moved = step.fixed_rows_mut::<3>(i);
            moved -= &*unknown;
            *unknown = estimate.mean.fixed_rows::<3>(i).into();
        }
        (flight.chi2, flight.log_evidence) = (estimate.chi2, estimate.log_evidence);
        if self.gravity.size.is_some() {
            *spread = estimate.covariance()?.fixed_view::<3, 3>(6, 6).trace() / 3.0;
        }
        *last = Some(estimate);
        Some(step)
    }
}

/// Weights and times, from the last sample's.
fn weighed(samples: &[Sample]) -> Moments {
    let (mut moments, end) = (Moments::default(), samples.last().map_or(0.0, |last| last.t));
    for sample in samples {
        moments.add(sample.t - end, &sample.weight);
    }
    moments
}

/// Adds the samples to the normal equations of position, velocity (at the last sample) and gravity that [`weighed`] them, linear about `flight`.
fn observe(fit: &mut Accumulator<9>, flight: &Flight, law: &dyn Law, samples: &[Sample]) {
    let (mut pulls, mut state) = (Pulls::default(), flight.state);
    for sample in samples.iter().rev() {
        state = state.at(sample.t, law, &flight.gravity);
        let s = sample.t - flight.state.t;
        let linear = flight.state.position + flight.state.velocity * s + flight.gravity * (0.5 * s * s);
        // What the law bends beyond the linear model moves over to the measurement's side.
        pulls.add(s, &(sample.position - (state.position - linear)), &sample.weight);
    }
    let [p, v, g] = pulls.powers;
    for (i, pull) in [(0, p), (3, v), (6, g * 0.5)] {
        fit.pull(i, &pull);
    }
    fit.square(pulls.square);
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
