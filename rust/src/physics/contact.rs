//! A contact: two flights that share a point and a time (sec. 3.2 of the paper, solved jointly).
//!
//! The ball arrives at `center` with `before`, touches for a while, and leaves with `after`: from a center as far from the
//! surface, moved along it by the mean velocity. A touch that is taken for an instant puts the surface millimetres too low.

use crate::math::{Mat3, Vec3};
use crate::physics::Sample;
use crate::physics::accumulator::{Accumulator, Estimate};
use crate::physics::flight::{Flight, VELOCITY_SD};
use crate::physics::gravity::Gravity;
use crate::physics::law::{Law, State};
use crate::physics::moments::{Moments, Pulls, add_powers};
use nalgebra::SMatrix;

/// Unknowns of a contact: center, velocity before, velocity after (three each), time, gravity (three).
const UNKNOWNS: usize = 13;
const CENTER: usize = 0;
const BEFORE: usize = 3;
const AFTER: usize = 6;
const TIME: usize = 9;
const GRAVITY: usize = 10;

/// How far friction turns an impulse away from the normal, rad (standard deviation).
const FRICTION_ANGLE: f64 = 0.2;
/// Restitution of a ball of which nothing is known: mean and standard deviation.
pub const RESTITUTION: (f64, f64) = (0.6, 0.25);

/// A fitted contact.
#[derive(Clone, Debug, PartialEq)]
pub struct Contact {
    /// Time of first touch, s.
    pub time: f64,
    /// Center of the ball at first touch, m.
    pub center: Vec3,
    /// Velocity at first touch, m/s.
    pub before: Vec3,
    /// Velocity at last touch, m/s.
    pub after: Vec3,
    /// Gravity, m/s².
    pub gravity: Vec3,
    /// Of (center, before, after), 9×9.
    pub covariance: SMatrix<f64, 9, 9>,
    /// Standard deviation of `time`, s.
    pub time_sd: f64,
    /// Weighted sum of squared residuals, priors included.
    pub chi2: f64,
    /// Log of the marginal likelihood, linear about the solution.
    pub log_evidence: f64,
    /// Measurements before first and after last touch.
    pub counts: [usize; 2],
}

impl Contact {
    /// When the ball is back at the height of the contact, s; `None` where it did not come down and go up again, as off a wall.
    pub fn returns(&self) -> Option<f64> {
        let [fall, rise] = [self.before, -self.after].map(|v| v.dot(&self.gravity));
        (fall > 0.0 && rise > 0.0).then(|| self.time + 2.0 * rise / self.gravity.norm_squared())
    }

    /// Covariance of `center`, m².
    pub fn center_covariance(&self) -> Mat3 {
        self.covariance.fixed_view::<3, 3>(0, 0).into()
    }

    /// χ² of the impulse against none, of three degrees of freedom.
    pub fn significance(&self) -> f64 {
        let block = |i: usize, j: usize| -> Mat3 { self.covariance.fixed_view::<3, 3>(3 * i, 3 * j).into() };
        let spread = block(1, 1) + block(2, 2) - block(1, 2) - block(2, 1);
        let impulse = self.after - self.before;
        spread.try_inverse().map_or(0.0, |weight| impulse.dot(&(weight * impulse)))
    }

    /// Direction of the impulse, which is the surface's normal where there is no friction; `None` where there was no impulse.
    pub fn impulse_direction(&self) -> Option<Vec3> {
        (self.after - self.before).try_normalize(1e-9)
    }

    /// The surface's normal as this contact alone shows it. Without friction it is the impulse's direction; for any friction and spin,
    /// after + e · before lies in the surface. The first holds to about 0.2 rad, the second as well as `restitution` (mean, sd) is known.
    pub fn normal(&self, restitution: (f64, f64)) -> Option<Vec3> {
        let impulse = self.impulse_direction()?;
        let within = self.after + self.before * restitution.0;
        let along = within.dot(&impulse);
        let Some(across) = (within - impulse * along).try_normalize(1e-9) else { return Some(impulse) };
        let q = within.dot(&across);
        let sd = restitution.1 * self.before.dot(&impulse).abs() + 1e-6;
        let angle = -along * q / (q * q + sd * sd / (FRICTION_ANGLE * FRICTION_ANGLE));
        (impulse + across * angle).try_normalize(1e-9)
    }

    /// The paper's direction: the normalised mean of the two unit tangents along the motion; `None` where they cancel.
    pub fn direction(&self) -> Option<Vec3> {
        let mean = self.before.try_normalize(1e-9)? + self.after.try_normalize(1e-9)?;
        mean.try_normalize(1e-2)
    }

    /// Speed away from a surface with `normal` over speed into it; `None` where the ball did not move into it.
    pub fn restitution(&self, normal: &Vec3) -> Option<f64> {
        let into = -self.before.dot(normal);
        (into > 1e-6).then(|| self.after.dot(normal) / into)
    }
}

/// Solves contacts of one kind of ball.
#[derive(Clone, Copy)]
pub struct Solver<'a> {
    /// How the ball flies.
    pub law: &'a dyn Law,
    /// What is known of gravity.
    pub gravity: &'a Gravity,
    /// How long a bounce touches, s.
    pub duration: f64,
}

impl Solver<'_> {
    /// The contact between the flights of `samples[..split]` and `samples[split..]`, or `None` where the two do not meet in
    /// between. `normal` of the surface where it is known; otherwise the contact's own serves.
    pub fn solve(&self, samples: &[Sample], split: usize, normal: Option<&Vec3>) -> Option<Contact> {
        let (before, after) = samples.split_at_checked(split)?;
        let (last, first) = (before.last()?.t, after.first()?.t);
        let (f, h) = (Flight::fit(self.law, before, self.gravity)?, Flight::fit(self.law, after, self.gravity)?);
        let time = self.closest_approach(&f, &h, last - self.duration, first);
        let (p, q) = (f.state.at(time, self.law, &f.gravity), h.state.at(time + self.duration, self.law, &h.gravity));
        let mut contact = Contact {
            time,
            center: p.position,
            before: p.velocity,
            after: q.velocity,
            gravity: f.gravity,
            covariance: SMatrix::zeros(),
            time_sd: f64::INFINITY,
            chi2: f64::INFINITY,
            log_evidence: f64::NEG_INFINITY,
            counts: [before.len(), after.len()],
        };
        let (mut spread, mut solution) = (self.gravity.spread(), None);
        for _ in 0..12 {
            let estimate = self.step(samples, &mut contact, normal, spread)?;
            let before = contact.time;
            // A time outside the two neighbours is no contact of these two flights: it stays there.
            contact.time = (before + estimate.mean[TIME]).clamp(last - self.duration - 0.01, first + 0.01);
            let unknown = |i: usize| -> Vec3 { estimate.mean.fixed_rows::<3>(i).into() };
            (contact.center, contact.before, contact.after, contact.gravity) =
                (unknown(CENTER), unknown(BEFORE), unknown(AFTER), unknown(GRAVITY));
            if self.gravity.size.is_some() {
                spread = estimate.covariance()?.fixed_view::<3, 3>(GRAVITY, GRAVITY).trace() / 3.0;
            }
            solution = Some(estimate);
            if (contact.time - before).abs() < 1e-7 {
                break;
            }
        }
        let estimate = solution?;
        let covariance = estimate.covariance()?;
        contact.covariance = covariance.fixed_view::<9, 9>(0, 0).into();
        contact.time_sd = crate::math::sqrt(covariance[(TIME, TIME)]);
        (contact.chi2, contact.log_evidence) = (estimate.chi2, estimate.log_evidence);
        Some(contact)
    }

    /// Standard deviation (m) of samples of which it is unknown, as the residuals of both flights tell it; the samples are weighted by
    /// it. `None` where nothing is left over to tell it.
    pub fn noise(&self, samples: &mut [Sample], split: usize) -> Option<f64> {
        let (before, after) = samples.split_at_mut_checked(split)?;
        let (mut squares, mut freedom) = (0.0, 0.0);
        for side in [before, after] {
            let (flight, sd) = Flight::fit_with_noise(self.law, side, self.gravity)?;
            let free = flight.dof() - self.gravity.unknowns();
            squares += free * sd * sd;
            freedom += free;
        }
        let variance = squares / freedom;
        for sample in samples {
            sample.weight = Mat3::from_diagonal_element(1.0 / variance);
        }
        Some(crate::math::sqrt(variance))
    }

    /// When the extrapolated flights are closest, in `from..=to`.
    fn closest_approach(&self, f: &Flight, h: &Flight, from: f64, to: f64) -> f64 {
        const STEPS: i32 = 24;
        let distance = |t: f64| {
            let p = f.state.at(t, self.law, &f.gravity).position;
            (h.state.at(t + self.duration, self.law, &h.gravity).position - p).norm_squared()
        };
        let grid = (0..=STEPS).map(|i| from + (to - from) * f64::from(i) / f64::from(STEPS));
        grid.map(|t| (distance(t), t)).min_by(|a, b| a.0.total_cmp(&b.0)).map_or(from, |(_, t)| t)
    }

    /// One Gauss–Newton step: all unknowns absolute but the time, which is a correction.
    fn step(&self, samples: &[Sample], c: &mut Contact, normal: Option<&Vec3>, spread: f64) -> Option<Estimate<UNKNOWNS>> {
        let n = normal.copied().or_else(|| c.normal(RESTITUTION)).unwrap_or_else(Vec3::zeros);
        let along = (Mat3::identity() - n * n.transpose()) * (0.5 * self.duration);
        let mut fit = Accumulator::<UNKNOWNS>::default();
        let arrival = State { t: c.time, position: c.center, velocity: c.before };
        let before = Side::new(self.law, arrival, &c.gravity, samples.iter().rev().skip_while(|s| s.t + s.half_span > c.time));
        before.tell(&mut fit, None);
        let departure = State { t: c.time + self.duration, position: c.center + along * (c.before + c.after), velocity: c.after };
        let after = Side::new(self.law, departure, &c.gravity, samples.iter().skip_while(|s| s.t - s.half_span < departure.t));
        after.tell(&mut fit, Some(&along));
        c.counts = [before.count, after.count];
        let wide = Mat3::from_diagonal_element(1.0 / (VELOCITY_SD * VELOCITY_SD));
        fit.expect_block(3, &Vec3::zeros(), &wide);
        fit.expect_block(6, &Vec3::zeros(), &wide);
        self.gravity.constrain(&mut fit, GRAVITY, &c.gravity, spread);
        // At an impact so slow that the time is hardly determined, the step stays a step.
        fit.expect(TIME, 0.0, 0.05);
        fit.estimate()
    }
}

/// What the samples on one side of a contact say of the flight there.
struct Side {
    moments: Moments,
    points: Pulls,
    /// Σ sᵏ W times how the point moves as the contact's time does, and that motion's weighted square and product with the points.
    motions: [Vec3; 3],
    motion: (f64, f64),
    count: usize,
}

impl Side {
    /// About the flight that begins or ends with `state`; `samples` go away from it.
    fn new<'a>(law: &dyn Law, state: State, gravity: &Vec3, samples: impl Iterator<Item = &'a Sample>) -> Self {
        let mut side =
            Self { moments: Moments::default(), points: Pulls::default(), motions: [Vec3::zeros(); 3], motion: (0.0, 0.0), count: 0 };
        let mut now = state;
        for sample in samples {
            now = now.at(sample.t, law, gravity);
            let s = sample.t - state.t;
            let linear = state.position + state.velocity * s + gravity * (0.5 * s * s);
            let y = sample.position - (now.position - linear);
            side.moments.add(s, &sample.weight);
            side.points.add(s, &y, &sample.weight);
            let pull = -(sample.weight * now.velocity);
            add_powers(&mut side.motions, s, &pull);
            side.motion.0 -= now.velocity.dot(&pull);
            side.motion.1 += y.dot(&pull);
            side.count += 1;
        }
        side
    }

    /// The side before a contact begins at its center with its velocity before; the one after begins `along` · (before + after) from there, with its
    /// velocity after.
    fn tell(&self, fit: &mut Accumulator<UNKNOWNS>, along: Option<&Mat3>) {
        let weight = |k: usize, factor: f64| self.moments.weight(k) * factor;
        // Of the position p, the velocity v and gravity g: information of one with the other.
        let (pp, pv, vv, pg, vg) = (weight(0, 1.0), weight(1, 1.0), weight(2, 1.0), weight(2, 0.5), weight(3, 0.5));
        let (p, v, [pt, vt, gt]) =
            (self.points.powers[0], self.points.powers[1], [self.motions[0], self.motions[1], self.motions[2] * 0.5]);
        fit.add_block(CENTER, CENTER, &pp);
        fit.add_block(GRAVITY, CENTER, &pg);
        fit.add_block(GRAVITY, GRAVITY, &weight(4, 0.25));
        fit.pull(CENTER, &p);
        fit.pull(GRAVITY, &(self.points.powers[2] * 0.5));
        fit.pull_single(TIME, self.motion.1);
        match along {
            None => {
                fit.add_block(BEFORE, CENTER, &pv);
                fit.add_block(BEFORE, BEFORE, &vv);
                fit.add_block(GRAVITY, BEFORE, &vg);
                fit.add_single(TIME, self.motion.0, &[(CENTER, pt), (BEFORE, vt), (GRAVITY, gt)]);
                fit.pull(BEFORE, &v);
            }
            Some(along) => {
                let (ap, av) = (along * pp, along * pv);
                fit.add_block(BEFORE, CENTER, &ap);
                fit.add_block(BEFORE, BEFORE, &(ap * along));
                fit.add_block(AFTER, CENTER, &(ap + pv));
                fit.add_block(AFTER, BEFORE, &((ap + pv) * along));
                fit.add_block(AFTER, AFTER, &(ap * along + av + av.transpose() + vv));
                fit.add_block(GRAVITY, BEFORE, &(pg * along));
                fit.add_block(GRAVITY, AFTER, &(pg * along + vg));
                let at = along * pt;
                fit.add_single(TIME, self.motion.0, &[(CENTER, pt), (BEFORE, at), (AFTER, at + vt), (GRAVITY, gt)]);
                fit.pull(BEFORE, &(along * p));
                fit.pull(AFTER, &(along * p + v));
            }
        }
        fit.square(self.points.square);
        self.moments.count(fit);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::physics::law::FreeFallWithDrag;
    use heapless::Vec;

    const G: Vec3 = Vec3::new(0.0, 0.0, -9.81);
    const LAW: FreeFallWithDrag = FreeFallWithDrag { drag: 0.02 };

    fn bounce(duration: f64) -> (Vec<Sample, 20>, f64) {
        let time = 0.2617;
        let hit = State { t: time, position: Vec3::new(0.1, 1.6, 0.033), velocity: Vec3::new(1.2, 0.4, -3.1) };
        let off =
            State { t: time + duration, position: hit.position + Vec3::new(1.0, 0.35, 0.0) * duration, velocity: Vec3::new(0.8, 0.3, 2.3) };
        let samples = (0..18).map(|i| {
            let t = f64::from(i) / 30.0;
            let from = if t < time { hit } else { off };
            Sample::isotropic(t, from.at(t, &LAW, &G).position, 1e-3)
        });
        (samples.collect(), time)
    }

    #[test]
    fn an_exact_bounce_is_found_exactly_and_the_touch_matters() {
        for duration in [0.0, 0.0045] {
            let (samples, time) = bounce(duration);
            let gravity = Gravity::known(G);
            let solver = Solver { law: &LAW, gravity: &gravity, duration };
            let c = solver.solve(&samples, 8, Some(&Vec3::z())).unwrap();
            assert!((c.time - time).abs() < 2e-6 && (c.center.z - 0.033).abs() < 5e-6, "{duration} {c:?}");
            assert!((c.restitution(&Vec3::z()).unwrap() - 2.3 / 3.1).abs() < 1e-4);
            assert!((c.returns().unwrap() - time - 2.0 * 2.3 / 9.81).abs() < 1e-4);
            // Off a wall, on its way up.
            assert_eq!(Contact { before: c.after, ..c }.returns(), None);
        }
        let (samples, _) = bounce(0.0045);
        let c = Solver { law: &LAW, gravity: &Gravity::known(G), duration: 0.0 }.solve(&samples, 8, None).unwrap();
        // v_n e T / (1 + e): the surface comes out too low.
        assert!((0.033 - c.center.z - 3.1 * 0.0045 * 2.3 / 5.4).abs() < 3e-4, "{}", c.center.z);
    }

    #[test]
    fn the_split_may_be_off_by_a_frame() {
        let (samples, time) = bounce(0.0045);
        let c = Solver { law: &LAW, gravity: &Gravity::known(G), duration: 0.0045 }.solve(&samples, 7, None).unwrap();
        assert!((c.time - time).abs() < 0.04);
    }

    #[test]
    fn a_vertical_drop_has_no_direction_and_a_normal() {
        let c = Contact {
            time: 0.0,
            center: Vec3::zeros(),
            before: Vec3::new(0.0, 0.0, -3.0),
            after: Vec3::new(0.0, 0.0, 2.0),
            gravity: G,
            covariance: SMatrix::zeros(),
            time_sd: 0.0,
            chi2: 0.0,
            log_evidence: 0.0,
            counts: [5, 5],
        };
        assert_eq!(c.direction(), None);
        assert_eq!(c.impulse_direction(), Some(Vec3::z()));
    }
}
