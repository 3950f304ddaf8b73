//! Where measurement and prediction disagree (Eq. 3): by θ, or by a whitened test at a stated false-alarm rate.

use crate::math::{Mat3, Vec3, chi2_3_isf, chi2_3_sf, sqrt};
use crate::physics::flight::Prediction;

/// A disagreement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Inconsistency {
    /// Predicted center, m.
    pub predicted: Vec3,
    /// Measured center, m.
    pub measured: Vec3,
    /// Between the two, m.
    pub distance: f64,
    /// What the distance exceeded, m.
    pub threshold: f64,
    /// Probability of such a distance without a cause; `None` with a fixed θ.
    pub p_value: Option<f64>,
}

/// Tests innovations one after the other so that a whole track raises a false alarm with the stated probability, however long it is:
/// the i-th test may spend 1/(i (i + 1)) of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WhitenedTest {
    false_alarm: f64,
    tests: f64,
}

impl WhitenedTest {
    /// `false_alarm`: probability that a passive track ever alarms.
    pub fn new(false_alarm: f64) -> Self {
        Self { false_alarm, tests: 0.0 }
    }

    /// Squared Mahalanobis distance of a measured center with `covariance` (m²) from its prediction.
    pub fn distance2(prediction: &Prediction, measured: &Vec3, covariance: &Mat3) -> f64 {
        let innovation = measured - prediction.state.position;
        (prediction.covariance + covariance).cholesky().map_or(f64::INFINITY, |c| innovation.dot(&c.solve(&innovation)))
    }

    /// Spends the next test on `measured`; `None` where it agrees.
    pub fn test(&mut self, prediction: &Prediction, measured: &Vec3, covariance: &Mat3) -> Option<Inconsistency> {
        let outcome = self.spend(prediction, measured, covariance);
        outcome.alarms().then(|| outcome.inconsistency(prediction, measured))
    }

    /// Spends the next test on `measured`, and tells of the distance whether it alarms or not.
    pub fn assess(&mut self, prediction: &Prediction, measured: &Vec3, covariance: &Mat3) -> (Inconsistency, bool) {
        let outcome = self.spend(prediction, measured, covariance);
        (outcome.inconsistency(prediction, measured), outcome.alarms())
    }

    fn spend(&mut self, prediction: &Prediction, measured: &Vec3, covariance: &Mat3) -> Outcome {
        self.tests += 1.0;
        let d2 = Self::distance2(prediction, measured, covariance);
        Outcome { d2, p_value: chi2_3_sf(d2), allowance: self.false_alarm / (self.tests * (self.tests + 1.0)) }
    }
}

/// What one test gave.
struct Outcome {
    d2: f64,
    p_value: f64,
    allowance: f64,
}

impl Outcome {
    fn alarms(&self) -> bool {
        self.p_value < self.allowance
    }

    fn inconsistency(&self, prediction: &Prediction, measured: &Vec3) -> Inconsistency {
        let distance = (measured - prediction.state.position).norm();
        Inconsistency {
            predicted: prediction.state.position,
            measured: *measured,
            distance,
            // The same direction, at the edge of the test.
            threshold: if self.d2.is_finite() { distance * sqrt(chi2_3_isf(self.allowance) / self.d2) } else { 0.0 },
            p_value: Some(self.p_value),
        }
    }
}

/// The paper's moving average over the last residuals, which steadies Eq. 3.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MovingAverage {
    last: [f64; MovingAverage::LENGTH],
    seen: usize,
}

impl MovingAverage {
    /// How many residuals it averages.
    pub const LENGTH: usize = 5;

    /// Takes one residual (m) and returns the mean of the last ones.
    pub fn push(&mut self, residual: f64) -> f64 {
        self.last[self.seen % Self::LENGTH] = residual;
        self.seen += 1;
        let count = self.seen.min(Self::LENGTH);
        self.last[..count].iter().sum::<f64>() / count as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::physics::law::State;

    fn at_origin() -> Prediction {
        let state = State { t: 0.0, position: Vec3::zeros(), velocity: Vec3::zeros() };
        Prediction { state, covariance: Mat3::from_diagonal_element(1e-6) }
    }

    #[test]
    fn the_threshold_is_where_the_test_turns() {
        let covariance = Mat3::from_diagonal_element(3e-6);
        let direction = Vec3::new(0.6, 0.0, 0.8);
        let alarm = WhitenedTest::new(1e-3).test(&at_origin(), &(direction * 0.1), &covariance).unwrap();
        let edge = |factor: f64| WhitenedTest::new(1e-3).test(&at_origin(), &(direction * alarm.threshold * factor), &covariance);
        assert!(edge(0.999).is_none() && edge(1.001).is_some());
    }

    #[test]
    fn a_track_spends_its_allowance_once() {
        let spent: f64 = (1..100_000).map(|i| 1.0 / (f64::from(i) * (f64::from(i) + 1.0))).sum();
        assert!(spent < 1.0 && spent > 0.9999);
    }

    #[test]
    fn moving_average_of_the_last_five() {
        let mut average = MovingAverage::default();
        assert_eq!(average.push(1.0), 1.0);
        for x in [2.0, 3.0, 4.0, 5.0] {
            average.push(x);
        }
        assert_eq!(average.push(6.0), 4.0);
    }
}
