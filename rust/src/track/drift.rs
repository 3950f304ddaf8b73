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

/// The same for what a flight can do without.
const STRAY: f64 = 6.0;

/// A track's motion before a camera that moves.
#[derive(Clone, Debug)]
pub struct Drift {
    /// Start of the present flight, s.
    since: f64,
    /// Of the newest samples the first that is in doubt, s.
    doubt: Option<f64>,
    fit: Option<Flight>,
}

impl Drift {
    /// Begins with a flight at time `since` (s).
    pub fn new(since: f64) -> Self {
        Self { since, doubt: None, fit: None }
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
        let lost = sample.t - last > LONGEST_BRIDGE;
        if lost || distance.is_some_and(|d| d > JERK.0) {
            // A bounce right before the newest sample has hardly moved it yet: that one is of neither flight.
            let end = self.doubt.unwrap_or(if lost { sample.t } else { last });
            Self::land(window, self.since, end, findings);
            Self::land(window, end, sample.t, findings);
            (self.since, self.doubt, self.fit) = (sample.t, None, None);
        } else if distance.is_some_and(|d| d > JERK.1) {
            self.doubt = self.doubt.or(Some(sample.t));
        } else {
            self.doubt = None;
        }
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
        let end = self.doubt.unwrap_or(f64::INFINITY);
        Self::land(window, self.since, end, findings);
        Self::land(window, end, f64::INFINITY, findings);
    }

    fn land(window: &Window, from: f64, until: f64, findings: &mut Findings) {
        let piece = between(window.samples(), from, until);
        if let (Some(first), Some(last)) = (piece.first(), piece.last()) {
            let _ = findings.push(Finding::Drifted(first.t, last.t));
        }
    }
}

/// A flight less those samples at its ends that a hand has hardly done: the ball may have bounced between them and the others.
pub fn trim<'a>(mut samples: &'a [Sample], gravity: &Vec3) -> &'a [Sample] {
    while let [first, rest @ ..] = samples
        && let [a, b, ..] = rest
        && strays(first, a, b, gravity)
    {
        samples = rest;
    }
    while let [rest @ .., last] = samples
        && let [.., b, a] = rest
        && strays(last, a, b, gravity)
    {
        samples = rest;
    }
    samples
}

/// Whether a sample is not where it would be by the next one of its flight, `a`, and the one beyond, `b`, as far as a hand moves the camera meanwhile.
fn strays(sample: &Sample, a: &Sample, b: &Sample, gravity: &Vec3) -> bool {
    let (before, after) = (a.t - b.t, sample.t - a.t);
    let (ratio, time2) = (after / before, 0.5 * after * (before + after));
    let off = sample.position - a.position - (a.position - b.position) * ratio - gravity * time2;
    let loose = Mat3::from_diagonal_element((ACCELERATION * time2) * (ACCELERATION * time2));
    let noise = sample.covariance() + a.covariance() * ((1.0 + ratio) * (1.0 + ratio)) + b.covariance() * (ratio * ratio);
    (noise + loose).try_inverse().is_some_and(|inverse| off.dot(&(inverse * off)) > STRAY)
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
