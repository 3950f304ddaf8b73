//! The motion of an object before a camera that moves: by the law, and by the camera's accelerations, which nobody knows. No hand jerks a camera as
//! a bounce does a ball: there a flight ends and another begins.

use crate::math::{Mat3, Vec3};
use crate::physics::flight::Flight;
use crate::physics::inconsistency::WhitenedTest;
use crate::physics::translation::ACCELERATION;
use crate::physics::{Sample, between};
use crate::track::hypothesis::{LONGEST_BRIDGE, Surroundings};
use crate::track::motion::{Finding, Findings};
use crate::track::window::Window;

/// Squared Mahalanobis distance beyond which no hand did it, and from which on it is doubtful.
const JERK: (f64, f64) = (30.0, 9.0);
/// A flight has so many samples at the least.
const FEWEST: usize = 5;

/// A track's motion before a camera that moves.
#[derive(Clone, Debug)]
pub struct Drift {
    /// Start of the present flight, s.
    since: f64,
    /// The newest sample was in doubt.
    doubtful: bool,
    fit: Option<Flight>,
}

impl Drift {
    /// Begins with a flight at time `since` (s).
    pub fn new(since: f64) -> Self {
        Self { since, doubtful: false, fit: None }
    }

    /// What tells where it is next: the newest step, and how far the camera may go meanwhile.
    pub fn fit(&self) -> Option<&Flight> {
        self.fit.as_ref()
    }

    /// Takes in the next sample, which it appends to `window`.
    pub fn push(&mut self, window: &mut Window, sample: Sample, around: &Surroundings, findings: &mut Findings) {
        let last = window.samples().last().map_or(sample.t, |last| last.t);
        let distance = self.fit.as_ref().filter(|fit| fit.count > 1).map(|fit| {
            let prediction = fit.predict(around.law, sample.t);
            WhitenedTest::distance2(&prediction, &sample.position, &sample.covariance())
        });
        if sample.t - last > LONGEST_BRIDGE || distance.is_some_and(|d| d > JERK.0) {
            let end = if self.doubtful { last } else { sample.t };
            self.land(window, end, findings);
            (self.since, self.fit) = (end, None);
        }
        self.doubtful = distance.is_some_and(|d| d > JERK.1);
        window.push(sample);
        let step = between(window.samples(), self.since, f64::INFINITY);
        let step = step.last_chunk::<2>().map_or(step, |pair| pair);
        self.fit = Flight::fit(around.law, step, around.gravity).map(|mut fit| {
            // Over a step and a half: from the middle of the one that it rests on to the end of the next.
            let span = step.first().zip(step.last()).map_or(0.0, |(a, b)| b.t - a.t);
            let loose = 1.5 * ACCELERATION * span;
            let mut velocity = fit.covariance.fixed_view_mut::<3, 3>(3, 3);
            velocity += Mat3::from_diagonal_element(loose * loose);
            fit
        });
    }

    /// Ends the motion.
    pub fn finish(&mut self, window: &Window, findings: &mut Findings) {
        self.land(window, f64::INFINITY, findings);
    }

    fn land(&mut self, window: &Window, until: f64, findings: &mut Findings) {
        let samples = between(window.samples(), self.since, until);
        if let (Some(first), Some(last), FEWEST..) = (samples.first(), samples.last(), samples.len()) {
            let _ = findings.push(Finding::Drifted(first.t, last.t));
        }
    }
}

/// Whether samples may be a flight at all, whatever the camera did: something that falls, not a piece of the scene.
pub fn falls(samples: &[Sample], gravity: &Vec3) -> bool {
    let [first, between @ .., last] = samples else { return false };
    let half = 0.5 * (first.t + last.t);
    let Some(middle) = between.iter().min_by(|a, b| (a.t - half).abs().total_cmp(&(b.t - half).abs())) else { return false };
    let (before, after) = (middle.t - first.t, last.t - middle.t);
    let mean = ((last.position - middle.position) / after - (middle.position - first.position) / before) * (2.0 / (before + after));
    mean.dot(gravity) > 0.5 * gravity.norm_squared()
}
