//! Active or passive as the paper tells it: the moving average of one-step predictions' residuals against θ (sec. 3.3).

use crate::config::LawName;
use crate::math::Vec3;
use crate::physics::Sample;
use crate::physics::inconsistency::MovingAverage;
use crate::physics::paper::predict;
use crate::track::interval::{Intervals, Told};

/// The paper's decision.
#[derive(Clone, Debug)]
pub struct PaperDecision {
    theta: f64,
    average: MovingAverage,
}

impl PaperDecision {
    /// `theta`: θ, m.
    pub fn new(theta: f64) -> Self {
        Self { theta, average: MovingAverage::default() }
    }

    /// Takes in the last of `samples`; by Eq. 5 with `gravity`, and without it where a plane balances it. θ knows no probability.
    pub fn push(&mut self, samples: &[Sample], law: LawName, gravity: &Vec3, intervals: &mut Intervals, ids: &mut u32, told: &mut Told) {
        let Some([a, b, c]) = samples.last_chunk() else { return };
        let pull = if law == LawName::ConstantVelocity { Vec3::zeros() } else { *gravity };
        let Some(predicted) = predict(a, b, c.t, &pull) else { return };
        let active = self.average.push((c.position - predicted).norm()) > self.theta;
        let probability = f64::from(u8::from(active));
        if active == intervals.is_active() {
            intervals.go_on(probability, ids, told);
        } else {
            intervals.turn(c.t, active, probability, ids, told);
        }
    }
}
