//! Which law a track obeys at the moment, and what happened where it stopped obeying: a wild frame, a contact, support by a
//! surface, or something that no law explains.

use crate::math::{Mat3, Vec3, exp, sqrt};
use crate::physics::contact::{Contact, Solver};
use crate::physics::flight::{Flight, Prediction};
use crate::physics::inconsistency::{Inconsistency, WhitenedTest};
use crate::physics::law::FreeFall;
use crate::physics::{Sample, between};
use crate::track::hypothesis::{
    AFTER_CONTACT, AFTER_SIDE, BEFORE_SIDE, CHAIN, LONGEST_BRIDGE, SWING, Surroundings, admissible, best_contact, free_flight, limit,
    may_be_two, plausible, supported,
};
use crate::track::window::Window;
use heapless::Vec;

/// A flight that predicts reaches back this far, s: what the law leaves out (spin, a drag coefficient that is off, axes that lean)
/// grows with the square of it.
const HISTORY: f64 = 0.3;
/// What has no explanation after this, s, gets none.
const PATIENCE: f64 = 0.12;
/// What a new sample brought to light.
#[derive(Clone, Debug)]
#[allow(clippy::large_enum_variant)] // No heap to put the larger ones on.
pub enum Finding {
    /// The measurement is not where the law puts it.
    Inconsistent(Inconsistency),
    /// A contact, which later samples will refine; `true` where it replaces the one before.
    Touched(Contact, bool),
    /// The last contact, for good.
    Settled(Contact),
    /// A flight is over: the flight, and from when to when (s) the samples are its own.
    Flown(Flight, f64, f64),
    /// The samples from this time on belong to something else, which no contact connects with what was before.
    Parted(f64),
    /// From when to when (s) it flew before a camera that may have moved.
    Drifted(f64, f64),
    /// From when to when (s) it flew, as the paper sees it.
    Fell(f64, f64),
}

/// Findings of one sample.
pub type Findings = Vec<Finding, 6>;

/// What the object does.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Phase {
    /// It flies, by the law.
    Flying,
    /// It flew, and the samples from this time on disagree.
    Doubtful(f64),
    /// A surface carries it.
    Supported,
    /// No law is known to hold.
    Unknown,
}

/// The contact that is not final yet.
#[derive(Clone, Debug)]
struct Pending {
    contact: Contact,
    /// Start of the flight before it, s.
    since: f64,
}

/// A track's motion.
#[derive(Clone, Debug)]
pub struct Motion {
    phase: Phase,
    /// Start of the present phase, s.
    since: f64,
    test: WhitenedTest,
    fit: Option<Flight>,
    pending: Option<Pending>,
    rebound: Option<(f64, Vec3)>,
    /// It is in the flight with which it began, or a surface may have carried it since.
    lies: bool,
}

impl Motion {
    /// Begins with a flight at time `since` (s), unless a surface turns out to carry it, where it may (`lies`); `false_alarm` is the whitened test's,
    /// for the whole track.
    pub fn new(since: f64, false_alarm: f64, lies: bool) -> Self {
        Self { phase: Phase::Flying, since, test: WhitenedTest::new(false_alarm), fit: None, pending: None, rebound: None, lies }
    }

    /// The state by the law that holds now, with its uncertainty; `None` where none does.
    pub fn fit(&self) -> Option<(&Flight, bool)> {
        self.fit.as_ref().map(|fit| (fit, self.phase == Phase::Supported))
    }

    /// When (s) and how fast (m/s) the present flight began, if a contact began it.
    pub fn rebound(&self) -> Option<(f64, Vec3)> {
        self.rebound
    }

    /// Samples from this time (s) on agree with no law.
    pub fn explained_until(&self) -> f64 {
        match self.phase {
            Phase::Flying | Phase::Supported if self.fit.is_some() => f64::INFINITY,
            Phase::Flying | Phase::Supported | Phase::Unknown => self.since,
            Phase::Doubtful(at) => at,
        }
    }

    /// Where the object will be at `t` (s).
    pub fn predict(&self, around: &Surroundings, t: f64) -> Option<Prediction> {
        let (fit, supported) = self.fit()?;
        Some(if supported { fit.predict(&FreeFall, t) } else { fit.predict(around.law, t) })
    }

    /// Takes in the next sample, which it appends to `window`.
    pub fn push(&mut self, window: &mut Window, sample: Sample, around: &Surroundings, findings: &mut Findings) {
        let gap = window.samples().last().map_or(0.0, |last| sample.t - last.t);
        if gap > LONGEST_BRIDGE && !self.survives(&sample, around) {
            self.finish(window, around, findings);
            let _ = findings.push(Finding::Parted(sample.t));
            self.restart(Phase::Flying, sample.t);
        }
        let alarm = match (self.phase, self.predict(around, sample.t)) {
            (Phase::Flying | Phase::Supported, Some(prediction)) => {
                let swing = Mat3::from_diagonal_element(self.swing(sample.t) * self.swing(sample.t));
                self.test.test(&prediction, &sample.position, &(sample.covariance() + swing))
            }
            _ => None,
        };
        window.push(sample);
        match (self.phase, alarm) {
            (Phase::Flying, Some(_)) if self.lies && self.rest(window) => {}
            (Phase::Flying, Some(alarm)) => {
                let _ = findings.push(Finding::Inconsistent(alarm));
                self.phase = Phase::Doubtful(sample.t);
            }
            (Phase::Supported, Some(alarm)) => {
                let _ = findings.push(Finding::Inconsistent(alarm));
                self.restart(Phase::Unknown, sample.t);
            }
            (Phase::Flying | Phase::Supported, None) => self.refit(window, around),
            (Phase::Doubtful(_) | Phase::Unknown, _) => {}
        }
        match self.phase {
            Phase::Doubtful(at) => self.explain(window, at, around, findings),
            Phase::Unknown => self.recover(window, around),
            Phase::Flying | Phase::Supported => {}
        }
        self.tick(sample.t, window, around, findings);
    }

    /// Time passes: a contact whose after-side is full becomes final.
    pub fn tick(&mut self, t: f64, window: &Window, around: &Surroundings, findings: &mut Findings) {
        if self.pending.as_ref().is_some_and(|p| t >= p.contact.time + AFTER_SIDE) {
            self.settle(window, f64::INFINITY, around, findings);
        }
    }

    /// Ends the motion: everything becomes final.
    pub fn finish(&mut self, window: &Window, around: &Surroundings, findings: &mut Findings) {
        self.settle(window, f64::INFINITY, around, findings);
        if self.phase == Phase::Flying {
            self.land(window, f64::INFINITY, around, findings);
        }
        self.restart(Phase::Unknown, f64::INFINITY);
    }

    fn restart(&mut self, phase: Phase, since: f64) {
        (self.phase, self.since, self.fit, self.rebound, self.lies) = (phase, since, None, None, false);
    }

    /// Whether a surface carried it all the time: then it goes on so.
    fn rest(&mut self, window: &Window) -> bool {
        let fit = supported(between(window.samples(), self.since, f64::INFINITY));
        let rests = fit.is_some();
        if rests {
            self.restart(Phase::Supported, self.since);
            self.fit = fit;
        }
        rests
    }

    /// How far the ball may still swing from its last impact, m.
    fn swing(&self, t: f64) -> f64 {
        self.pending.as_ref().map_or(0.0, |p| {
            let impulse = (p.contact.after - p.contact.before).norm();
            SWING.0 * impulse * exp((p.contact.time - t) / SWING.1)
        })
    }

    /// After a long gap: the object is still where its law puts it.
    fn survives(&self, sample: &Sample, around: &Surroundings) -> bool {
        self.phase == Phase::Flying
            && self.predict(around, sample.t).is_some_and(|p| {
                sqrt(p.covariance.trace()) < 0.05 && WhitenedTest::distance2(&p, &sample.position, &sample.covariance()) < 20.0
            })
    }

    fn refit(&mut self, window: &Window, around: &Surroundings) {
        let Some(last) = window.samples().last() else { return };
        let recent = between(window.samples(), self.since.max(last.t - HISTORY), f64::INFINITY);
        self.fit = match self.phase {
            Phase::Supported => supported(between(recent, last.t - AFTER_SIDE, f64::INFINITY)),
            _ => Flight::fit(around.law, recent, around.gravity),
        };
        if self.phase == Phase::Supported && self.fit.is_none() {
            self.restart(Phase::Unknown, last.t);
        }
    }

    /// The samples from `at` on disagree with the flight before. Why?
    fn explain(&mut self, window: &mut Window, at: f64, around: &Surroundings, findings: &mut Findings) {
        let after = between(window.samples(), at, f64::INFINITY);
        let (Some(first), Some(last), count) = (after.first().copied(), after.last().copied(), after.len()) else { return };
        let back = |p: Prediction| WhitenedTest::distance2(&p, &last.position, &last.covariance()) < 12.0;
        if count == 2 && self.predict(around, last.t).is_some_and(back) {
            window.remove(first.t);
            self.phase = Phase::Flying;
            return self.refit(window, around);
        }
        let whole = between(window.samples(), self.since, f64::INFINITY);
        // Of a row of hops, the last ones together.
        let began = self.pending.as_ref().map_or(self.since, |p| p.since.max(last.t - HISTORY * 0.5).min(self.since));
        if count >= AFTER_CONTACT.0
            && last.t - began >= PATIENCE
            && let Some(fit) = supported(between(window.samples(), began, f64::INFINITY))
        {
            // It never flew: it was held, or lay, and a few samples of that pass for a flight.
            self.settle(window, at, around, findings);
            self.restart(Phase::Supported, began);
            self.fit = Some(fit);
            return;
        }
        let recent = between(whole, last.t - HISTORY, f64::INFINITY);
        let still = Flight::fit(around.law, recent, around.gravity).filter(|f| count >= 3 && f.chi2 < limit(f.dof()));
        if still.is_some() {
            // One flight explains all: the alarm was a false one.
            self.phase = Phase::Flying;
            return self.refit(window, around);
        }
        if count >= AFTER_CONTACT.0 && last.t - first.t >= AFTER_CONTACT.1 {
            if let Some(contact) = self.revised(window, around) {
                return self.touch(contact, true, window, around, findings);
            }
            if let Some(contact) = best_contact(window.samples(), self.since, at, self.pending.as_ref().map(|p| p.contact.time), around) {
                self.settle(window, contact.time, around, findings);
                self.land(window, contact.time, around, findings);
                if may_be_two(&contact, window.samples(), around) {
                    self.restart(Phase::Unknown, contact.time);
                    return self.recover(window, around);
                }
                return self.touch(contact, false, window, around, findings);
            }
        }
        if count >= 4 && last.t - first.t >= PATIENCE {
            let missed = window.samples().iter().rev().find(|s| s.t < first.t).is_some_and(|s| {
                let step = (last.t - first.t) / (count - 1) as f64;
                first.t - s.t > 1.5 * step
            });
            self.settle(window, at, around, findings);
            self.land(window, at, around, findings);
            if missed {
                let _ = findings.push(Finding::Parted(at));
            }
            self.restart(Phase::Unknown, at);
            self.recover(window, around);
        }
    }

    /// The contact before was young when doubt came up: perhaps it was only solved from too little.
    fn revised(&self, window: &Window, around: &Surroundings) -> Option<Contact> {
        let pending = self.pending.as_ref().filter(|p| {
            let young = between(window.samples(), self.since, f64::INFINITY);
            young.len() <= 8 && young.last().is_some_and(|s| s.t - p.contact.time < AFTER_SIDE)
        })?;
        best_contact(window.samples(), pending.since, self.since, Some(pending.since - CHAIN), around)
    }

    fn touch(&mut self, contact: Contact, again: bool, window: &Window, around: &Surroundings, findings: &mut Findings) {
        let since = if again { self.pending.as_ref().map_or(self.since, |p| p.since) } else { self.since };
        let _ = findings.push(Finding::Touched(contact.clone(), again));
        self.restart(Phase::Flying, contact.time + around.duration);
        self.rebound = Some((contact.time, contact.after));
        self.pending = Some(Pending { contact, since });
        self.refit(window, around);
    }

    /// Solves the pending contact for the last time, with all samples up to `until`.
    fn settle(&mut self, window: &Window, until: f64, around: &Surroundings, findings: &mut Findings) {
        let Some(Pending { contact, since }) = self.pending.take() else { return };
        // A hop may be too low to show where it ended: what comes after its time is another's.
        let hop = contact.returns().filter(|end| between(window.samples(), contact.time, *end).len() >= AFTER_CONTACT.0);
        let until = until.min(contact.time + AFTER_SIDE + 1e-3).min(hop.unwrap_or(f64::INFINITY));
        let samples = between(window.samples(), since.max(contact.time - BEFORE_SIDE), until);
        let split = samples.partition_point(|s| s.t <= contact.time);
        let normal = (around.normal_at)(&contact);
        let solver = Solver { law: around.law, gravity: around.gravity, duration: around.duration };
        let last = solver.solve(samples, split, normal.as_ref()).and_then(|c| plausible(c, samples)).filter(admissible);
        let _ = findings.push(Finding::Settled(last.unwrap_or(contact)));
    }

    /// The flight of the present phase is over: if it was one, it tells of gravity and of the noise.
    fn land(&mut self, window: &Window, until: f64, around: &Surroundings, findings: &mut Findings) {
        let samples = between(window.samples(), self.since, until);
        let (Some(last), Some(flight)) = (samples.last(), free_flight(samples, around)) else { return };
        let size = around.gravity.mean.norm();
        let spread = flight.gravity_sd() * sqrt(flight.excess());
        if samples.len() >= 5 && (flight.gravity.norm() / size - 1.0).abs() < 0.3 && spread < 0.15 * size {
            let _ = findings.push(Finding::Flown(flight, self.since, last.t + 1e-9));
        }
    }

    /// Looks for a law that holds again.
    fn recover(&mut self, window: &Window, around: &Surroundings) {
        let Some(last) = window.samples().last() else { return };
        let recent = |span: f64| between(window.samples(), self.since.max(last.t - span), f64::INFINITY);
        let long_enough =
            |samples: &[Sample], span: f64| samples.len() >= 4 && samples.first().is_some_and(|s| last.t - s.t >= 0.75 * span);
        let fall = recent(0.135);
        let flight = Flight::fit(around.law, fall, around.gravity).filter(|f| f.chi2 < limit(f.dof()));
        if let Some(flight) = flight.filter(|_| long_enough(fall, 0.135)) {
            self.restart(Phase::Flying, fall.first().map_or(last.t, |s| s.t));
            self.fit = Some(flight);
            return;
        }
        let rest = recent(0.2);
        if let Some(carried) = supported(rest).filter(|_| long_enough(rest, 0.2)) {
            self.restart(Phase::Supported, rest.first().map_or(last.t, |s| s.t));
            self.fit = Some(carried);
        }
    }
}
