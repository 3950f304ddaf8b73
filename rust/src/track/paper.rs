//! Tracks by the paper's own method: one-step predictions by Eq. 5 against θ, contacts from two parabolas.

use crate::physics::inconsistency::Inconsistency;
use crate::physics::paper::{SIDE, contact, predict};
use crate::physics::{Sample, between};
use crate::track::hypothesis::Surroundings;
use crate::track::motion::{Finding, Findings};
use crate::track::window::Window;
use nalgebra::SMatrix;

/// A track's motion as the paper sees it.
#[derive(Clone, Debug)]
pub struct PaperMotion {
    theta: f64,
    /// Start of the present flight, s.
    since: f64,
    /// The most inconsistent sample after it, s, and how far it was off, m.
    at: Option<(f64, f64)>,
}

impl PaperMotion {
    /// `theta`: θ of Eq. 3, m.
    pub fn new(since: f64, theta: f64) -> Self {
        Self { theta, since, at: None }
    }

    /// Takes in the next sample, which it appends to `window`.
    pub fn push(&mut self, window: &mut Window, sample: Sample, around: &Surroundings, findings: &mut Findings) {
        let last = between(window.samples(), self.since, f64::INFINITY);
        let predicted = match last {
            [.., a, b] => predict(a, b, sample.t, &around.gravity.mean),
            _ => None,
        };
        window.push(sample);
        if let Some(predicted) = predicted {
            let distance = (sample.position - predicted).norm();
            if distance > self.theta {
                let measured = sample.position;
                let alarm = Inconsistency { predicted, measured, distance, threshold: self.theta, p_value: None };
                let _ = findings.push(Finding::Inconsistent(alarm));
                // Alarms come in rows, most of them noise: the worst one stands for its row.
                if self.at.is_none_or(|(_, worst)| distance > worst) {
                    self.at = Some((sample.t, distance));
                }
            }
        }
        if let Some((at, _)) = self.at
            && between(window.samples(), at, f64::INFINITY).len() >= SIDE
        {
            self.conclude(window, at, findings);
        }
    }

    /// Ends the motion.
    pub fn finish(&mut self, window: &Window, findings: &mut Findings) {
        if let Some((at, _)) = self.at {
            self.conclude(window, at, findings);
        }
        self.land(window, f64::INFINITY, findings);
    }

    /// What was consistent up to `until` (s) shows gravity: the paper averages over a time without interactions.
    fn land(&self, window: &Window, until: f64, findings: &mut Findings) {
        if let [first, .., last] = between(window.samples(), self.since, until) {
            let _ = findings.push(Finding::Fell(first.t, last.t));
        }
    }

    /// An inconsistency is a contact. The paper says nothing of noise; without asking for an impulse against the motion
    /// most of its contacts would be none.
    fn conclude(&mut self, window: &Window, at: f64, findings: &mut Findings) {
        self.at = None;
        let before = between(window.samples(), self.since, at);
        let after = between(window.samples(), at, f64::INFINITY);
        let (Some(mut contact), Some(span)) = (contact(before, after), before.first().zip(before.last()).map(|(a, b)| b.t - a.t)) else {
            return;
        };
        let impulse = contact.after - contact.before;
        if impulse.norm() > 0.4 && impulse.dot(&contact.before) < 0.0 {
            // θ is all that the paper says of its uncertainty: over one side's time it makes the velocity's.
            let speed = self.theta * SIDE as f64 / span;
            let sd = |i: usize| if i < 3 { self.theta } else { speed };
            contact.covariance = SMatrix::from_fn(|i, j| if i == j { sd(i) * sd(i) } else { 0.0 });
            self.land(window, at, findings);
            self.since = at;
            let _ = findings.push(Finding::Touched(contact.clone(), false));
            let _ = findings.push(Finding::Settled(contact));
        }
    }
}
