//! Active or passive by a sequential test: an onset that no passive motion explains, in spite of all that may have happened there, is one of a
//! force of the object's own; it lasts until a passive motion explains the newest samples again.

use crate::config::LawName;
use crate::math::{Mat3, Vec3, exp, sqrt};
use crate::physics::contact::Contact;
use crate::physics::law::FreeFall;
use crate::physics::onset::{LONGEST, Onset, Side};
use crate::physics::sequential::{Allowance, OF_EXACT, OF_LOOSE};
use crate::physics::{Sample, between};
use crate::track::hypothesis::{LONGEST_BRIDGE, SWING, limit};
use crate::track::interval::{Intervals, Told};
use crate::track::passive::{Circumstances, Explanation, FRICTION, MODES, Mode};

/// A doubt waits so long for what explains it, s: contacts take as long to be found.
const PATIENCE: f64 = 0.12;
/// An object is seen to be passive again after so long, s, and so many samples; what does not show in the longer time is taken for none.
const CALM: (f64, f64, usize) = (0.2, 0.8, 5);
/// An acceleration would show if it were so many times its standard deviation.
const TELLING: f64 = 6.0;
/// What a true explanation does not exceed but once in a hundred: a χ² of 3 degrees of freedom.
const ACCEPTED: f64 = 11.34;
/// χ² up to which two velocities may be one: among many pairs, some are far apart by chance.
const SAME: f64 = 30.0;
/// χ² beyond which one sample alone is no noise.
const WILD: f64 = 60.0;
/// Whatever happens faster than this, s, is an impact.
const IMPACT: f64 = 0.1;
/// Velocities may be one if they differ by no more than noise and this, m/s an axis (standard deviation).
const SAME_VELOCITY: f64 = 0.02;
/// One hop takes no more than this part of the speed along the surface: then a hollow ball rolls.
const GRIP: f64 = 0.4;
/// What has risen by this, m, is not carried by something of which nothing is known.
const RISEN: f64 = 0.05;
/// Log of odds that leave no doubt.
const CERTAIN: f64 = 300.0;
/// How far before a window that is passive the beginning of it is looked for, s.
const LOOK_BACK: f64 = 0.35;

#[derive(Clone, Copy, Debug)]
enum Phase {
    Passive,
    /// No passive motion holds: what the last one lacked, when that came out (s), and what the test had been allowed to spend.
    Doubtful(Onset, f64, f64),
    /// It moves by itself: how strongly, m/s², and where it was at first.
    Active(f64, Vec3),
}

/// The decision on one track.
#[derive(Clone, Debug)]
pub struct Decision {
    allowance: Allowance,
    phase: Phase,
    /// The passive motion began here, s.
    since: f64,
    /// What ruled out each passive motion since then.
    ruled_out: [Option<Onset>; MODES.len()],
    /// A sample that was wild, s.
    wild: Option<f64>,
    /// Something in this interval may have been either.
    tied: bool,
    log_odds: f64,
    newest: f64,
    /// The present interval is passive, after one that was active.
    returned: bool,
    /// Newest sample that a passive motion explained, s, and which acceleration would have shown there, m/s² (standard deviation).
    held: (f64, f64),
    /// The same of the passive motions of this interval that are over.
    shown: f64,
}

/// Where decisions go.
pub struct Ledger<'a> {
    /// The track's.
    pub intervals: &'a mut Intervals,
    /// Newest id.
    pub ids: &'a mut u32,
    /// What is to be told.
    pub told: &'a mut Told,
}

impl Decision {
    /// `false_alarm`: probability that a passive track is ever doubted.
    pub fn new(false_alarm: f64) -> Self {
        Self {
            allowance: Allowance::new(false_alarm),
            phase: Phase::Passive,
            since: f64::NEG_INFINITY,
            ruled_out: [None; MODES.len()],
            wild: None,
            tied: false,
            log_odds: 0.0,
            newest: f64::NEG_INFINITY,
            returned: false,
            held: (f64::NEG_INFINITY, f64::INFINITY),
            shown: f64::INFINITY,
        }
    }

    /// Takes in the last of `samples`.
    pub fn push(&mut self, samples: &[Sample], place: &Circumstances, ledger: &mut Ledger) {
        let Some(last) = samples.last() else { return };
        if last.t - self.newest > LONGEST_BRIDGE {
            // Whatever happened in between, nobody saw it.
            self.begin(last.t);
        }
        self.newest = last.t;
        match self.phase {
            Phase::Passive => self.watch(samples, place),
            Phase::Doubtful(..) => self.resolve(samples, place, false, ledger),
            Phase::Active(strength, from) => self.look_for_calm(samples, place, strength, &from, ledger),
        }
        ledger.intervals.go_on(self.probability(ledger.intervals.is_active()), ledger.ids, ledger.told);
    }

    /// A contact, found in flight: another passive motion begins.
    pub fn touch(&mut self, contact: &Contact, duration: f64, place: &Circumstances, ledger: &mut Ledger) {
        if matches!(self.phase, Phase::Active(..)) {
            return;
        }
        let (before, after) = (contact.before, contact.after);
        match place.may_touch(&contact.center, &before, &after) {
            None if place.closed => {
                // Nothing was there that could have pushed it.
                self.log_odds = (0.5 * contact.significance()).min(CERTAIN);
                self.act((after - before).norm() / IMPACT, contact.time, contact.center, ledger);
            }
            touched => {
                self.tied |= touched != Some(false);
                // A real ball swings for a while.
                self.begin(contact.time + duration + SWING.1);
            }
        }
    }

    /// From `t` (s) on the samples have nothing to do with those before.
    pub fn begin(&mut self, t: f64) {
        (self.since, self.ruled_out, self.wild) = (t, [None; MODES.len()], None);
        (self.shown, self.held.1) = (self.shown.min(self.held.1), f64::INFINITY);
        if let Phase::Doubtful(..) = self.phase {
            self.phase = Phase::Passive;
        }
    }

    /// The track is over.
    pub fn finish(&mut self, samples: &[Sample], place: &Circumstances, ledger: &mut Ledger) {
        if let Phase::Doubtful(..) = self.phase {
            self.resolve(samples, place, true, ledger);
        }
        let probability = self.probability(ledger.intervals.is_active());
        ledger.intervals.go_on(probability, ledger.ids, ledger.told);
        ledger.intervals.tell(true, ledger.ids, ledger.told);
    }

    /// Whether all samples of `since` to `until` (s) are of a passive motion, as far as is known.
    pub fn is_passive(&self, until: f64) -> bool {
        match self.phase {
            Phase::Passive => true,
            Phase::Doubtful(onset, ..) => onset.time > until - IMPACT,
            Phase::Active(..) => false,
        }
    }

    fn probability(&self, active: bool) -> f64 {
        let p = 1.0 / (1.0 + exp(-self.log_odds));
        match (active, self.tied) {
            (true, _) => p,
            // As long as the test has not decided otherwise.
            (false, false) => p.min(0.5),
            (false, true) => 0.5,
        }
    }

    /// The samples of the present passive motion.
    fn stretch(&self, samples: &[Sample], wild: Option<f64>) -> heapless::Vec<Sample, LONGEST> {
        let all = between(samples, self.since, f64::INFINITY);
        let recent = all.get(all.len().saturating_sub(LONGEST)..).unwrap_or(all);
        recent.iter().filter(|s| Some(s.t) != wild && Some(s.t) != self.wild).copied().collect()
    }

    fn watch(&mut self, samples: &[Sample], place: &Circumstances) {
        let stretch = self.stretch(samples, None);
        let Some((first, last)) = stretch.first().zip(stretch.last()).filter(|_| stretch.len() >= 3) else { return };
        let allowance = self.allowance.spend();
        let (mut best, mut exceeded) = (None::<Explanation>, None::<Onset>);
        for (mode, ruled_out) in MODES.into_iter().zip(&mut self.ruled_out) {
            let Some(explained) = place.explain(mode, &stretch, Side::After).filter(|_| ruled_out.is_none()) else { continue };
            if explained.is_exceeded(allowance) {
                *ruled_out = Some(explained.onset);
                // The motion that held for longest tells best what is new.
                exceeded = exceeded.filter(|e| e.time > explained.onset.time).or(Some(explained.onset));
            } else if best.as_ref().is_none_or(|b| explained.onset.chi2 < b.onset.chi2) {
                best = Some(explained);
            }
        }
        if let Some(explained) = best {
            (self.log_odds, self.held) = (explained.onset.log_odds, (last.t, explained.onset.sd));
            self.tied |= explained.hidden && self.ruled_out[Mode::Falling as usize].is_some();
            return;
        }
        // Where none is possible any more, gravity is overcome.
        let lifted = place.lifted(&stretch).filter(|lifted| Allowance::is_exceeded(allowance, lifted.chi2, OF_EXACT));
        let time = lifted.map_or(self.held.0, |lifted| lifted.time).min(self.held.0).max(first.t);
        let overcome = Onset { time, acceleration: -place.around.gravity.mean, chi2: f64::INFINITY, log_odds: CERTAIN, sd: 0.0 };
        self.phase = Phase::Doubtful(exceeded.unwrap_or(overcome), last.t, allowance);
    }

    /// What explains the doubt? A wild sample, an impact, another passive motion; or a force of its own.
    fn resolve(&mut self, samples: &[Sample], place: &Circumstances, is_last: bool, ledger: &mut Ledger) {
        let (Phase::Doubtful(onset, alarm, allowance), Some(last)) = (self.phase, samples.last().copied()) else { return };
        // A wild sample is one that motions through the others don't miss: gone already, or too far off to be noise.
        let later = between(samples, alarm, f64::INFINITY);
        let gone = later.first().is_none_or(|s| s.t > alarm);
        if gone || (later.len() > 2 && onset.chi2 > WILD) {
            let wild = Some(alarm);
            let stretch = self.stretch(samples, wild);
            let holds = |mode| place.explain(mode, &stretch, Side::After).is_some_and(|e| !e.is_exceeded(allowance));
            let held = MODES.map(holds);
            if held.contains(&true) {
                for (ruled_out, holds) in self.ruled_out.iter_mut().zip(held) {
                    *ruled_out = ruled_out.filter(|_| !holds);
                }
                (self.phase, self.wild) = (Phase::Passive, wild);
                return;
            }
        }
        let stretch = self.stretch(samples, None);
        // An alarm comes early where noise exaggerates: what has come since knows better how strong it is.
        let now = best(place, &stretch).map_or(f64::INFINITY, |e| e.onset.acceleration.norm());
        let strength = onset.acceleration.norm().min(now);
        let before = best(place, between(&stretch, f64::NEG_INFINITY, onset.time + 1e-9));
        let waited = last.t - alarm;
        let mut may_clear_up = false;
        for (k, start) in stretch.iter().enumerate().filter(|(_, s)| s.t >= onset.time && s.t <= alarm.max(onset.time + IMPACT)) {
            let fresh = stretch.get(k..).filter(|fresh| fresh.len() >= 4).unwrap_or_default();
            let previous = k.checked_sub(1).and_then(|k| stretch.get(k)).map_or(start.t, |s| s.t);
            for after in MODES.into_iter().filter_map(|mode| place.explain(mode, fresh, Side::After)).filter(is_accepted) {
                let Some(hidden) = changes(place, before.as_ref(), &after, previous.min(onset.time), start.t) else { continue };
                // So weak a force as does not show in the longer time is none.
                if after.onset.sd < strength / TELLING || waited > CALM.1 {
                    self.tied |= hidden || after.hidden;
                    return self.begin(start.t);
                }
                may_clear_up = true;
            }
        }
        if !is_last && (waited < PATIENCE || (may_clear_up && waited < CALM.1)) {
            return;
        }
        // An impact so late that nothing shows what came of it.
        let impulse = onset.acceleration * (last.t - onset.time);
        let struck = |b: &Explanation| strikes(place, b, &impulse, onset.time, last.t).is_some();
        if is_last && (may_clear_up || (last.t - onset.time < PATIENCE && before.as_ref().is_some_and(struck))) {
            self.tied = true;
            return;
        }
        if let Some(before) = &before {
            self.log_odds = before.onset.log_odds;
            ledger.intervals.assess(self.probability(false));
        }
        // With all samples since, it is known better how the motion before ended.
        let whole = match &before {
            Some(before) => place.explain(before.mode, &stretch, Side::After),
            None => best(place, &stretch),
        };
        let again = whole.filter(|e| onset.chi2.is_finite() && e.is_exceeded(allowance));
        let onset = again.map_or(onset, |e| e.onset);
        let strength = onset.acceleration.norm();
        self.log_odds = onset.log_odds;
        // What would not have shown in so short a rest was not over.
        let rested = before.as_ref().map_or(self.shown, |b| b.onset.sd.min(self.shown)) < strength / TELLING;
        let since = if self.returned && !rested { ledger.intervals.since() } else { f64::INFINITY };
        // The onset is the last sample without it, unless there is none.
        let without = stretch.first().is_some_and(|first| first.t < onset.time);
        let at = if without { onset.time + 1e-6 } else { onset.time }.min(since);
        let from = between(&stretch, at, f64::INFINITY).first().map_or(last.position, |s| s.position);
        self.act(strength, at, from, ledger);
    }

    fn act(&mut self, strength: f64, at: f64, from: Vec3, ledger: &mut Ledger) {
        self.phase = Phase::Active(strength, from);
        (self.tied, self.returned) = (false, false);
        self.log_odds = self.log_odds.max(0.0);
        ledger.intervals.turn(at, true, self.probability(true), ledger.ids, ledger.told);
    }

    /// Whether a passive motion explains the newest samples: as many as it takes to see a force as strong as there was.
    fn look_for_calm(&mut self, samples: &[Sample], place: &Circumstances, strength: f64, from: &Vec3, ledger: &mut Ledger) {
        let since = between(samples, self.since.max(ledger.intervals.since()), f64::INFINITY);
        let Some(last) = since.last() else { return };
        let sd = place.sd(since.get(since.len().saturating_sub(LONGEST)..).unwrap_or(since));
        let enough = |k: &usize| {
            let (count, span) = (since.len() - k, since.get(*k).map_or(0.0, |s| last.t - s.t));
            let known = sd * sqrt(720.0 / count as f64) / (span * span).max(1e-9);
            count >= CALM.2 && span >= CALM.0 && (known < strength / TELLING || span >= CALM.1 || count >= LONGEST)
        };
        let Some(start) = (0..since.len()).rev().take(LONGEST).find(enough) else { return };
        let calm = since.get(start..).unwrap_or_default();
        let (Some(first), Some(found)) = (calm.first(), best(place, calm).filter(is_accepted)) else { return };
        let up = -place.around.gravity.mean.try_normalize(1e-9).unwrap_or_else(Vec3::zeros);
        // Who has shown a force of his own may not be held up by luck: not where objects should fall, nor above where he was.
        if found.hidden && (place.law == LawName::FreeFall || (first.position - from).dot(&up) > RISEN) {
            return;
        }
        let wide = between(since, first.t - LOOK_BACK, f64::INFINITY);
        let ended = place.explain(found.mode, wide, Side::Before).filter(|_| wide.len() > calm.len() + 2);
        let boundary = ended.map_or(first.t, |e| e.onset.time.min(first.t));
        // What was over at once was active for a frame, unless it turns out to have been a passive change.
        let began = ledger.intervals.since();
        let before = best(place, between(samples, self.since, began)).filter(|_| boundary <= began);
        let pushed = before.is_some_and(|b| changes(place, Some(&b), &found, b.flight.state.t, first.t).is_none());
        let boundary = if pushed { began + 1e-6 } else { boundary };
        self.phase = Phase::Passive;
        self.begin(first.t);
        (self.tied, self.returned, self.log_odds, self.shown) = (found.hidden, true, found.onset.log_odds, f64::INFINITY);
        ledger.intervals.turn(boundary, false, self.probability(false), ledger.ids, ledger.told);
    }
}

/// The passive motion that explains the samples best.
fn best(place: &Circumstances, samples: &[Sample]) -> Option<Explanation> {
    let all = MODES.into_iter().filter_map(|mode| place.explain(mode, samples, Side::After));
    all.min_by(|a, b| a.onset.chi2.total_cmp(&b.onset.chi2))
}

fn is_accepted(explained: &Explanation) -> bool {
    explained.onset.chi2 < ACCEPTED && explained.flight.chi2 < limit(explained.flight.dof())
}

/// Whether one passive motion may have followed on the other between `from` and `to` (s), and whether by a surface of which nothing is known.
fn changes(place: &Circumstances, before: Option<&Explanation>, after: &Explanation, from: f64, to: f64) -> Option<bool> {
    let Some(before) = before else {
        // Too short to tell.
        return (!place.closed).then_some(true);
    };
    let (was, is) = (before.at(place, to), after.at(place, to));
    let spread = |e: &Explanation| -> Mat3 { e.flight.covariance.fixed_view::<3, 3>(3, 3).into() };
    let spread = spread(before) + spread(after) + Mat3::from_diagonal_element(SAME_VELOCITY * SAME_VELOCITY);
    let weight = spread.try_inverse()?;
    // Friction and hops take of the speed along a surface, and turn nothing.
    let carried = [before, after].map(|e| e.mode == Mode::Carried);
    let rubbed = FRICTION * place.around.gravity.mean.norm() * (to - from) / was.norm().max(1e-9);
    let least = if carried == [true; 2] { (1.0 - rubbed.max(GRIP)).max(0.0) } else { 1.0 };
    let kept = (was.dot(&(weight * is)) / was.dot(&(weight * was)).max(1e-9)).clamp(least, 1.0);
    let off = is - was * kept;
    if off.dot(&(weight * off)) < SAME {
        // It rolls off, comes to rest, slides no more; but what falls goes on falling.
        return carried.contains(&true).then_some(after.hidden);
    }
    strikes(place, before, &(is - was), from, to)
}

/// Whether a surface in its way between `from` and `to` (s) may have changed its velocity by `impulse`, and whether one of which nothing is known.
fn strikes(place: &Circumstances, before: &Explanation, impulse: &Vec3, from: f64, to: f64) -> Option<bool> {
    const STEPS: i32 = 8;
    let law = if before.mode == Mode::Falling { place.around.law } else { &FreeFall };
    let touched = (0..=STEPS).filter_map(|i| {
        let state = before.flight.state.at(from + (to - from) * f64::from(i) / f64::from(STEPS), law, &before.flight.gravity);
        place.may_touch(&state.position, &state.velocity, &(state.velocity + impulse))
    });
    touched.min()
}

impl Explanation {
    /// Whether what speaks against it is too much for a test that may spend `allowance`.
    fn is_exceeded(&self, allowance: f64) -> bool {
        let multiplicity = if self.mode == Mode::Falling { OF_LOOSE } else { OF_EXACT };
        Allowance::is_exceeded(allowance, self.onset.chi2, multiplicity)
    }

    /// Velocity at `t` (s), m/s.
    fn at(&self, place: &Circumstances, t: f64) -> Vec3 {
        let law = if self.mode == Mode::Falling { place.around.law } else { &FreeFall };
        self.flight.state.at(t, law, &self.flight.gravity).velocity
    }
}
