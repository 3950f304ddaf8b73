//! What may explain a track's samples: a free flight, being carried, a contact.

use crate::math::{Mat3, Vec3, sqrt};
use crate::physics::contact::{Contact, RESTITUTION, Solver};
use crate::physics::flight::Flight;
use crate::physics::gravity::Gravity;
use crate::physics::law::{FreeFall, Law};
use crate::physics::{Sample, between};

/// A contact is final when its after-side is this long, s.
pub const AFTER_SIDE: f64 = 0.27;
/// Its before-side reaches back this far, s.
pub const BEFORE_SIDE: f64 = 0.5;
/// A contact hides in a gap no longer than this, s: 150 ms and the frames beside it.
pub const LONGEST_BRIDGE: f64 = 0.22;
/// A contact needs so many measurements before it, over so much time (s), unless another contact began that flight.
const BEFORE_CONTACT: (usize, f64) = (3, 0.06);
/// The same behind it.
pub const AFTER_CONTACT: (usize, f64) = (2, 0.03);
/// Two contacts of one ball are further apart than this, s: what comes sooner is its swing after the first.
pub const CHAIN: f64 = 0.05;
/// Impulses smaller than this are none, m/s.
const SMALLEST_IMPULSE: f64 = 0.4;
/// How much of a supported object's acceleration friction may cause, m/s² (standard deviation).
const FRICTION: f64 = 1.5;
/// A real ball swings after an impact, m per m/s of impulse, and for so long, s. Set by looking at motion capture of soft juggling balls, for
/// want of a source; simulated balls don't swing.
pub const SWING: (f64, f64) = (6e-4, 0.1);

/// What surrounds a motion: the same for all tracks of a stream.
#[derive(Clone, Copy)]
pub struct Surroundings<'a> {
    /// How a free ball moves.
    pub law: &'a dyn Law,
    /// What is known of gravity.
    pub gravity: &'a Gravity,
    /// How long a bounce touches, s.
    pub duration: f64,
    /// Normal of the known or found surface that this contact was with.
    pub normal_at: &'a dyn Fn(&Contact) -> Option<Vec3>,
    /// Whether the ball would have been partly behind such a surface then.
    pub beyond: &'a dyn Fn(&Contact) -> bool,
}

/// A motion that a surface carries: no acceleration but friction's. Small hops are within what is allowed.
pub fn supported(samples: &[Sample]) -> Option<Flight> {
    let carried = Gravity { mean: Vec3::zeros(), information: Mat3::from_diagonal_element(1.0 / (FRICTION * FRICTION)), size: None };
    // Many samples outvote a prior; that something falls must not be among what they say.
    Flight::fit(&FreeFall, samples, &carried).filter(|f| f.gravity.norm() < 3.0 * FRICTION && f.chi2 < limit(f.dof()))
}

/// The flight with nothing known of gravity.
pub fn free_flight(samples: &[Sample], around: &Surroundings) -> Option<Flight> {
    let free = Gravity { information: Mat3::from_diagonal_element(1e-4), size: None, ..*around.gravity };
    Flight::fit(around.law, samples, &free)
}

/// Which part of gravity the samples show, with its standard deviation: 1 falls, 0 is carried.
fn fall(samples: &[Sample], around: &Surroundings) -> Option<(f64, f64)> {
    let flight = free_flight(samples, around)?;
    let known = around.gravity;
    let anywhere = known.size.is_some() && known.spread() > 0.01 * known.mean.norm_squared();
    let gravity = if anywhere { flight.gravity.try_normalize(1e-9)? * known.mean.norm() } else { known.mean };
    Some((flight.gravity.dot(&gravity) / gravity.norm_squared(), flight.gravity_sd() * sqrt(flight.excess()) / gravity.norm()))
}

/// χ² that a true model with `dof` degrees of freedom does not exceed but once in ten thousand, with room for what real balls do
/// beyond the model (they swing, they are not round, their markers sit beside the center).
pub fn limit(dof: f64) -> f64 {
    1.5 * (dof + 3.7 * sqrt(2.0 * dof.max(1.0)) + 7.0)
}

/// The contact, if it explains its samples: as well as their noise lets it, or with an error that is small beside the impact; then
/// its covariance is as much larger.
pub fn plausible(mut contact: Contact, samples: &[Sample]) -> Option<Contact> {
    let dof = 3.0 * (contact.counts[0] + contact.counts[1]) as f64 - 10.0;
    if contact.counts[0] < 2 || contact.counts[1] < AFTER_CONTACT.0 {
        return None;
    }
    if contact.chi2 < limit(dof) {
        return Some(contact);
    }
    let excess = contact.chi2 / dof.max(1.0);
    let precision = samples.iter().map(|s| s.weight.trace() / 3.0).sum::<f64>() / samples.len() as f64;
    let swing = SWING.0 * (contact.after - contact.before).norm();
    contact.covariance *= excess;
    contact.time_sd *= sqrt(excess);
    (excess / precision < swing * swing).then_some(contact)
}

/// A passive ball on a passive surface: pushed against its motion, and not faster afterwards.
pub fn admissible(contact: &Contact) -> bool {
    let impulse = contact.after - contact.before;
    let (before, after) = (contact.before.norm(), contact.after.norm());
    let Some(normal) = contact.normal(RESTITUTION) else { return false };
    let restitution = contact.restitution(&normal).unwrap_or(-1.0);
    impulse.norm() > SMALLEST_IMPULSE
        && impulse.dot(&contact.before) < 0.0
        && after < 1.05 * before + 0.2
        && (0.0..1.05).contains(&restitution)
}

/// The contact, moved up to the floor on which two bounces, which give back the same part of the speed, would do as well; `None` where one of
/// them would have been seen, `room` (s) before or after the gap.
///
/// At speeds f and r down to the one and up from it, and with restitution e, the two would be met at u = (f + r) / (1 + e)² and left at e² u, where
/// (f − r) / (f + r) = (1 − e) (1 + e²) / (1 + e)³: gravity alone acts beside them.
fn as_two(contact: &Contact, samples: &[Sample], room: f64) -> Option<Contact> {
    let split = samples.partition_point(|s| s.t <= contact.time);
    let (last, next, g) = (samples.get(split.checked_sub(1)?)?, samples.get(split)?, contact.gravity.norm());
    let down = contact.gravity / g;
    let [fall, rise] = [contact.before, -contact.after].map(|v| v.dot(&down));
    if rise <= 0.0 || fall <= rise {
        return None;
    }
    let lost = |e: f64| (1.0 - e) * (1.0 + e * e) / ((1.0 + e) * (1.0 + e) * (1.0 + e));
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..30 {
        let e = 0.5 * (low + high);
        if lost(e) > (fall - rise) / (fall + rise) { low = e } else { high = e }
    }
    let met = (fall + rise) / ((1.0 + low) * (1.0 + low));
    let [first, second] = [contact.time - (fall - met) / g, contact.time + (rise - low * low * met) / g];
    let center = contact.center - down * (0.5 * (fall * fall - met * met) / g);
    (last.t < first + room && second < next.t + room).then(|| Contact { center, ..contact.clone() })
}

/// Whether the ball may have bounced twice while it was not seen, and was not there then: two bounces explain what was seen as well, unless this
/// one is with a known surface and they are not; or it would have been behind such a surface, and a sample before or after may be of the hop.
pub fn may_be_two(contact: &Contact, samples: &[Sample], around: &Surroundings) -> bool {
    let touches = |contact: &Contact| (around.normal_at)(contact).is_some();
    let split = samples.partition_point(|s| s.t <= contact.time);
    let gap = split.checked_sub(1).and_then(|last| Some(samples.get(split)?.t - samples.get(last)?.t)).unwrap_or(0.0);
    as_two(contact, samples, 0.0).is_some_and(|higher| !touches(contact) || touches(&higher))
        || ((around.beyond)(contact) && as_two(contact, samples, gap).is_some())
}

/// The best contact between the flight that began at `since` and the samples from about `at` on: the doubt may have come a frame
/// late, or early and for nothing.
pub fn best_contact(samples: &[Sample], since: f64, at: f64, previous: Option<f64>, around: &Surroundings) -> Option<Contact> {
    let samples = between(samples, since.max(at - BEFORE_SIDE), at + AFTER_SIDE);
    let split = samples.partition_point(|s| s.t < at);
    let solver = Solver { law: around.law, gravity: around.gravity, duration: around.duration };
    let proven = |before: &[Sample]| match before {
        [first, .., last] => {
            let enough = before.len() >= BEFORE_CONTACT.0 && last.t - first.t >= BEFORE_CONTACT.1;
            previous.is_some() || (enough && fall(before, around).is_some_and(|(part, sd)| part > 0.5 && sd < 0.4))
        }
        _ => false,
    };
    let carried = |after: &[Sample]| fall(after, around).is_some_and(|(part, sd)| part < 0.5 && sd < 0.2);
    let score = |c: &Contact| c.chi2 - 3.0 * (c.counts[0] + c.counts[1]) as f64;
    (split.saturating_sub(2)..=samples.len().saturating_sub(AFTER_CONTACT.0))
        .filter(|&k| k > 0 && samples[k].t - samples[k - 1].t < LONGEST_BRIDGE && proven(&samples[..k]) && !carried(&samples[k..]))
        .filter_map(|k| {
            let contact = solver.solve(samples, k, None)?;
            let contact = plausible(contact, samples)?;
            let inside = contact.time > samples[k - 1].t - around.duration - 2e-3 && contact.time < samples[k].t + 2e-3;
            let apart = previous.is_none_or(|time| contact.time > time + CHAIN);
            (inside && apart && admissible(&contact)).then_some(contact)
        })
        .min_by(|a, b| score(a).total_cmp(&score(b)))
}
