//! When an acceleration set in that a law doesn't know of: a generalised likelihood ratio over its onset, on the residuals of the law's fit.
//!
//! The null hypothesis is a fitted [`Flight`], the alternative adds a · ½ (t − τ)² from τ on (or, looking back, up to τ). Both are linear, so
//! the ratio is the fall of χ² by fitting a, three degrees of freedom, and all τ are had in one pass over the moments of the weights.

use crate::math::{Mat3, Vec3, exp, log, sqrt};
use crate::physics::Sample;
use crate::physics::flight::Flight;
use crate::physics::law::Law;
use heapless::Vec;
use nalgebra::SMatrix;

/// Samples that are looked at, at the most.
pub const LONGEST: usize = 48;
/// Accelerations of what moves by itself, m/s² an axis: the prior of [`Onset::log_odds`].
const STRENGTH: f64 = 3.0;

/// On which side of τ the acceleration is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// From τ on: something began.
    After,
    /// Up to τ: something ended.
    Before,
}

/// The acceleration that explains best what the law does not.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Onset {
    /// τ, s.
    pub time: f64,
    /// It, m/s².
    pub acceleration: Vec3,
    /// How far χ² falls by it: by chance it is the largest of a few χ² variables of 3 degrees of freedom.
    pub chi2: f64,
    /// Log of the odds, with all τ as likely and even odds before, that there is such an acceleration.
    pub log_odds: f64,
    /// Standard deviation (m/s², an axis) to which an acceleration of all samples would be known; axes of which nothing is known don't count.
    pub sd: f64,
}

/// Σ uᵏ W and Σ uᵏ W r over samples at u (s).
#[derive(Default)]
struct Moments {
    weights: [Mat3; 5],
    residuals: [Vec3; 3],
}

impl Moments {
    fn add(&mut self, u: f64, weight: &Mat3, residual: &Vec3) {
        let (mut power, pull) = (1.0, weight * residual);
        for (k, m) in self.weights.iter_mut().enumerate() {
            *m += weight * power;
            if let Some(r) = self.residuals.get_mut(k) {
                *r += pull * power;
            }
            power *= u;
        }
    }

    /// What these samples tell of an acceleration since (or until) w, beside the unknowns of the fit: information and vector. With
    /// ½ (u − w)² as its shape every sum is a polynomial of w.
    fn marginal(&self, w: f64, covariance: &SMatrix<f64, 9, 9>) -> (Mat3, Vec3) {
        let [m0, m1, m2, m3, m4] = &self.weights;
        let [r0, r1, r2] = &self.residuals;
        let mut cross = SMatrix::<f64, 9, 3>::zeros();
        cross.fixed_view_mut::<3, 3>(0, 0).copy_from(&((m2 - m1 * (2.0 * w) + m0 * (w * w)) * 0.5));
        cross.fixed_view_mut::<3, 3>(3, 0).copy_from(&((m3 - m2 * (2.0 * w) + m1 * (w * w)) * 0.5));
        cross.fixed_view_mut::<3, 3>(6, 0).copy_from(&((m4 - m3 * (2.0 * w) + m2 * (w * w)) * 0.25));
        let own = (m4 - m3 * (4.0 * w) + m2 * (6.0 * w * w) - m1 * (4.0 * w * w * w) + m0 * (w * w * w * w)) * 0.25;
        let information = own - cross.transpose() * (covariance * cross);
        (crate::math::symmetric(&information), (r2 - r1 * (2.0 * w) + r0 * (w * w)) * 0.5)
    }
}

/// The best onset in the last [`LONGEST`] of the `samples` that `flight` was fitted to, under the same law; `None` where they are too few to tell.
pub fn onset(flight: &Flight, law: &dyn Law, samples: &[Sample], side: Side) -> Option<Onset> {
    let samples = samples.get(samples.len().saturating_sub(LONGEST)..)?;
    let reference = flight.state.t;
    // From the last to the first.
    let residuals: Vec<Vec3, LONGEST> = flight.residuals(law, samples).collect();
    let (mut moments, mut best, mut odds, mut count, mut sd) = (Moments::default(), None::<Onset>, 0.0, 0.0, f64::INFINITY);
    let last = samples.len().checked_sub(1)?;
    for i in 0..last {
        let (added, edge) = if side == Side::After { (last - i, last - i - 1) } else { (i, i + 1) };
        let (Some(sample), Some(at), Some(residual)) = (samples.get(added), samples.get(edge), residuals.get(last - added)) else { break };
        moments.add(sample.t - reference, &sample.weight, residual);
        let (information, vector) = moments.marginal(at.t - reference, &flight.covariance);
        let Some(cholesky) = information.cholesky() else { continue };
        let acceleration = cholesky.solve(&vector);
        let found = Onset { time: at.t, acceleration, chi2: vector.dot(&acceleration), log_odds: 0.0, sd: 0.0 };
        // The last one is that of all samples.
        sd = sqrt(3.0 / information.trace());
        if best.is_none_or(|b| found.chi2 > b.chi2) {
            best = Some(found);
        }
        let prior = 1.0 / (STRENGTH * STRENGTH);
        if let Some(c) = (information + Mat3::from_diagonal_element(prior)).cholesky() {
            let log_factor = 0.5 * vector.dot(&c.solve(&vector)) - log(c.l_dirty().diagonal().product()) + 1.5 * log(prior);
            // Beyond e^300 nothing is added by the others.
            odds += exp(log_factor.min(300.0));
            count += 1.0;
        }
    }
    best.map(|best| Onset { log_odds: log(odds / f64::max(count, 1.0)), sd, ..best })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::physics::accumulator::Accumulator;
    use crate::physics::flight::VELOCITY_SD;
    use crate::physics::gravity::Gravity;
    use crate::physics::law::FreeFall;
    use nalgebra::SMatrix;

    const G: Vec3 = Vec3::new(0.0, 0.0, -9.81);

    /// 16 samples with uneven weights and times, which accelerate by `a` from 0.2 s on.
    fn samples(a: Vec3) -> [Sample; 16] {
        core::array::from_fn(|i| {
            let t = i as f64 / 30.0 + 0.004 * f64::from(i as u32 % 3);
            let late = (t - 0.2).max(0.0);
            let noise = Vec3::new(libm::sin(7.0 * i as f64), libm::cos(5.0 * i as f64), libm::sin(3.0 * i as f64)) * 1e-3;
            let position = Vec3::new(t, 1.0 - t, 2.0 * t) + G * (0.5 * t * t) + a * (0.5 * late * late) + noise;
            let weight = Mat3::new(9e5, 1e5, 0.0, 1e5, 5e5, 0.0, 0.0, 0.0, 8e5 + 1e4 * i as f64);
            Sample { t, position, weight, half_span: 0.0 }
        })
    }

    /// χ² of the fit with an acceleration of the shape `h` of time beside the null's unknowns, by normal equations of all twelve.
    fn chi2(samples: &[Sample], reference: f64, information: f64, h: impl Fn(f64) -> f64) -> Option<f64> {
        let mut fit = Accumulator::<12>::default();
        fit.expect_block(3, &Vec3::zeros(), &Mat3::from_diagonal_element(1.0 / (VELOCITY_SD * VELOCITY_SD)));
        fit.expect_block(6, &G, &Mat3::from_diagonal_element(information));
        for s in samples {
            let u = s.t - reference;
            let coefficients = [1.0, u, 0.5 * u * u, h(s.t)];
            let design = SMatrix::<f64, 3, 12>::from_fn(|i, j| if j % 3 == i { coefficients[j / 3] } else { 0.0 });
            fit.observe_design(&design, &s.position, &s.weight);
        }
        Some(fit.solve()?.chi2)
    }

    #[test]
    fn the_ratio_is_that_of_two_fits() {
        for (side, information) in [(Side::After, 1e8), (Side::After, 2.0), (Side::Before, 1e8)] {
            let samples = samples(Vec3::new(0.3, -0.2, 0.9));
            let gravity = Gravity { mean: G, information: Mat3::from_diagonal_element(information), size: None };
            let flight = Flight::fit(&FreeFall, &samples, &gravity).unwrap();
            let found = onset(&flight, &FreeFall, &samples, side).unwrap();
            let shape = |tau: f64| {
                move |t: f64| {
                    let inside = if side == Side::After { (t - tau).max(0.0) } else { (tau - t).max(0.0) };
                    0.5 * inside * inside
                }
            };
            let falls = samples.iter().map(|s| flight.chi2 - chi2(&samples, samples[15].t, information, shape(s.t)).unwrap_or(f64::NAN));
            let deepest = falls.enumerate().filter(|(_, fall)| fall.is_finite()).max_by(|a, b| a.1.total_cmp(&b.1)).unwrap();
            assert!((found.chi2 / deepest.1 - 1.0).abs() < 1e-3, "{side:?}: {found:?} {deepest:?}");
            assert_eq!(found.time, samples[deepest.0].t);
        }
    }

    #[test]
    fn a_step_is_found_where_it_is() {
        let a = Vec3::new(0.0, 4.0, 2.0);
        let samples = samples(a);
        let flight = Flight::fit(&FreeFall, &samples, &Gravity::known(G)).unwrap();
        let found = onset(&flight, &FreeFall, &samples, Side::After).unwrap();
        assert!((found.time - 0.2).abs() < 0.04 && (found.acceleration - a).norm() < 0.4 && found.log_odds > 20.0, "{found:?}");
        let still = super::tests::samples(Vec3::zeros());
        let flight = Flight::fit(&FreeFall, &still, &Gravity::known(G)).unwrap();
        let none = onset(&flight, &FreeFall, &still, Side::After).unwrap();
        assert!(none.log_odds < -3.0, "{none:?}");
        assert!(onset(&flight, &FreeFall, &still[..1], Side::After).is_none());
    }

    #[test]
    fn the_accuracy_is_the_textbooks() {
        // A parabola through n even samples of sd σ over T: 720 σ² / n T⁴, for many.
        let sd = 1e-3;
        let even: [Sample; 40] = core::array::from_fn(|i| Sample::isotropic(i as f64 / 40.0, Vec3::zeros(), sd));
        let flight = Flight::fit(&FreeFall, &even, &Gravity::known(Vec3::zeros())).unwrap();
        let found = onset(&flight, &FreeFall, &even, Side::After).unwrap();
        assert!((found.sd / (sd * sqrt(720.0 / 40.0)) - 1.0).abs() < 0.1, "{}", found.sd);
    }
}
