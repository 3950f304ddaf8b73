//! Tracks by the paper's own method: one-step predictions by Eq. 5 against θ, contacts from two parabolas.

use crate::math::Mat3;
use crate::physics::inconsistency::Inconsistency;
use crate::physics::paper::{SIDE, contact, predict};
use crate::physics::{Sample, between};
use crate::track::motion::{Finding, Findings, Surroundings};
use crate::track::window::Window;

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
    }

    /// An inconsistency is a contact. The paper says nothing of noise; without asking for an impulse against the motion
    /// most of its contacts would be none.
    fn conclude(&mut self, window: &Window, at: f64, findings: &mut Findings) {
        self.at = None;
        let before = between(window.samples(), self.since, at);
        let after = between(window.samples(), at, f64::INFINITY);
        let Some(mut contact) = contact(before, after) else { return };
        let impulse = contact.after - contact.before;
        if impulse.norm() > 0.4 && impulse.dot(&contact.before) < 0.0 {
            // θ is all that the paper says of its uncertainty.
            let theta = Mat3::from_diagonal_element(self.theta * self.theta);
            contact.covariance.fixed_view_mut::<3, 3>(0, 0).copy_from(&theta);
            self.since = at;
            let _ = findings.push(Finding::Touched(contact.clone(), false));
            let _ = findings.push(Finding::Settled(contact));
        }
    }
}
