//! Where a track's object may be at some instant, as a density: by the law that held last, by its newest samples alone, or after a contact.

use crate::math::{Mat3, Vec3, exp, sqrt};
use crate::physics::Sample;
use crate::physics::contact::RESTITUTION;
use crate::physics::flight::{Flight, Prediction};
use crate::physics::inconsistency::WhitenedTest;
use crate::physics::law::{FreeFall, Law};
use crate::track::hypothesis::Surroundings;
use crate::track::object::{HINTS, Track, blur};
use heapless::Vec;

/// Contacts a second.
const CONTACT_RATE: f64 = 1.0;
/// Part of all motions that a law describes only roughly: its error, m, and its growth with the way since the last sample.
const ROUGH: (f64, f64, f64) = (0.1, 0.01, 0.1);
/// Speeds of an object that was seen once, m/s an axis.
const SPEED: f64 = 4.0;
/// A contact leaves a ball no faster than before, but for this, m/s, and gravity.
const FASTER: f64 = 0.3;

/// Part of all contacts that are with level surfaces.
const LEVEL: f64 = 0.7;
/// They take such a part of the velocity along them, more or less all of it.
const GRIP: f64 = 0.2;
/// Moments at which such a contact is thought of.
const MOMENTS: u32 = 6;

/// Samples that no law explains are looked at so many together.
const NEWEST: usize = 3;

/// A track's object as it is awaited.
#[derive(Clone, Debug)]
pub struct Expectation {
    /// Flights that may hold, their probabilities, and whether a surface carries it.
    flights: [Option<(Flight, f64, bool)>; 2],
    last: Vec3,
    since: f64,
    /// Newest measurement, s.
    measured: f64,
    /// Gravity, and the variance of its direction, rad².
    gravity: (Vec3, f64),
    /// When a ball that bounces on may have bounced twice since, s.
    twice: f64,
    /// Standard deviation of `last`, m: a blob's center is not a ball's.
    blurred: f64,
    speed: f64,
    /// Of an object with one sample since the law ceased to hold, m/s an axis.
    velocity_sd: f64,
    /// Its newest samples are explained by no law.
    doubtful: bool,
    /// Only the newest sample is known, nothing of its velocity.
    young: bool,
    /// Contacts are thought of.
    touches: bool,
}

impl Expectation {
    /// Of an object that has samples.
    pub fn new(track: &Track, around: &Surroundings, touches: bool) -> Option<Self> {
        let lawful = track.lawful(around);
        // Blobs where the law has them say nothing new.
        let known = lawful.as_ref().is_some_and(|(fit, carried)| agrees(fit, *carried, around, track.hints()));
        let hints = if known { &[] } else { track.hints() };
        let last = track.hints().last().or(track.samples().last())?;
        let unexplained = track.unexplained();
        let newest = unexplained.get(unexplained.len().saturating_sub(NEWEST)..).unwrap_or(unexplained);
        let fresh: Vec<Sample, { NEWEST + HINTS }> = newest.iter().chain(hints).copied().collect();
        let young = lawful.as_ref().map_or(fresh.len() < 2, |(fit, _)| fit.count < 2);
        let newest = Flight::fit(around.law, &fresh, around.gravity).filter(|_| !fresh.is_empty());
        let share = if lawful.is_some() && newest.is_some() { 0.5 } else { 1.0 };
        // The last step may have been a bounce, there and back: the fastest of a few counts.
        let speeds = track.samples().windows(2).rev().take(4).map(|w| (w[1].position - w[0].position).norm() / (w[1].t - w[0].t));
        let speed = speeds.fold(0.0, f64::max);
        let bounced = track.samples().len() > NEWEST && !unexplained.is_empty();
        Some(Self {
            flights: [lawful.map(|(fit, carried)| (fit, share, carried)), newest.map(|fit| (fit, share, false))],
            last: last.position,
            since: last.t,
            measured: track.samples().last().map_or(last.t, |s| s.t),
            gravity: (around.gravity.mean, around.gravity.spread() / around.gravity.mean.norm_squared()),
            twice: track.rebound().map_or(f64::INFINITY, |(time, velocity)| {
                // Up and down again, and then once more with less.
                let flight = 2.0 * -around.gravity.mean.dot(&velocity) / around.gravity.mean.norm_squared();
                time + (1.0 + RESTITUTION.0) * flight.max(0.0)
            }),
            blurred: if track.hints().is_empty() { 0.0 } else { sqrt(blur(track.radius)) },
            speed,
            velocity_sd: if bounced { (speed / sqrt(3.0) + FASTER).min(SPEED) } else { SPEED },
            doubtful: !fresh.is_empty(),
            young,
            touches,
        })
    }

    /// Where it most probably is at `t` (s).
    pub fn prediction(&self, law: &dyn Law, t: f64) -> Option<Prediction> {
        self.predictions(law, t).next().map(|(prediction, _)| prediction)
    }

    fn predictions<'a>(&'a self, law: &'a dyn Law, t: f64) -> impl Iterator<Item = (Prediction, f64)> + 'a {
        self.flights.iter().flatten().map(move |(fit, share, carried)| {
            let mut prediction = if *carried { fit.predict(&FreeFall, t) } else { fit.predict(law, t) };
            if fit.count < 2 {
                let reach = self.velocity_sd * (t - self.since);
                prediction.covariance = Mat3::from_diagonal_element(reach * reach + 1e-6);
            }
            (prediction, *share)
        })
    }

    /// The density, 1/m³, with which a measurement with covariance `own` shows it at `center` at time `t` (s).
    pub fn density(&self, law: &dyn Law, t: f64, center: &Vec3, own: &Mat3) -> f64 {
        let dt = (t - self.since).max(0.0);
        let way = self.speed * dt;
        let lawful: f64 = (self.predictions(law, t))
            .map(|(prediction, share)| {
                let off = center - prediction.state.position;
                let rough = ROUGH.1 + ROUGH.2 * way;
                let wide = prediction.covariance + own + Mat3::from_diagonal_element(rough * rough);
                share * ((1.0 - ROUGH.0) * normal_density(&off, &(prediction.covariance + own)) + ROUGH.0 * normal_density(&off, &wide))
            })
            .sum();
        if !self.touches || self.young {
            return lawful;
        }
        let touched = self.touched(dt, center, own);
        lawful + self.bounced(law, t, center, own).map_or(touched, |bounced| (1.0 - LEVEL) * touched + LEVEL * bounced)
    }

    /// The density after a bounce off a level surface since the last measurement: from then on the ball is as far from where the law has it as
    /// the impulse takes it. `None` where no law held before, or there may have been two.
    fn bounced(&self, law: &dyn Law, t: f64, center: &Vec3, own: &Mat3) -> Option<f64> {
        let [Some((fit, _, false)), None] = &self.flights else { return None };
        let up = -self.gravity.0.try_normalize(1e-9).filter(|_| t < self.twice)?;
        let (by_law, dt) = (fit.predict(law, t), t - self.measured);
        let off = center - by_law.state.position;
        let step = dt / f64::from(MOMENTS);
        let density = |k: u32| {
            let since = step * (f64::from(k) + 0.5);
            let velocity = by_law.state.velocity - self.gravity.0 * since;
            let fall = -up.dot(&velocity);
            if fall <= 0.0 {
                return 0.0;
            }
            let impulse = up * ((1.0 + RESTITUTION.0) * fall) - (velocity + up * fall) * GRIP;
            let (along, across) = (0.5 * step * impulse.norm(), RESTITUTION.1 * fall * since);
            let astray = (GRIP * GRIP + self.gravity.1) * velocity.norm_squared() * since * since;
            let spread = Mat3::from_diagonal_element(astray) + up * up.transpose() * (along * along + across * across);
            normal_density(&(off - impulse * since), &(by_law.covariance + own + spread))
        };
        Some(contact_chance(dt) * (0..MOMENTS).map(density).sum::<f64>() / f64::from(MOMENTS))
    }

    /// The density after a contact since the last sample: anywhere as far away as it may have got.
    fn touched(&self, dt: f64, center: &Vec3, own: &Mat3) -> f64 {
        let spread = sqrt(own.trace() + 3.0 * self.blurred * self.blurred);
        let reach = self.speed * dt + FASTER * dt + 5.0 * dt * dt + 3.0 * spread;
        let inside = (center - self.last).norm() < reach;
        if inside { contact_chance(dt) / (4.0 / 3.0 * core::f64::consts::PI * reach * reach * reach) } else { 0.0 }
    }

    /// The probability that the law does not tell where it is at `t` (s).
    pub fn astray(&self, t: f64) -> f64 {
        if self.doubtful { 1.0 } else { contact_chance(t - self.since) }
    }
}

/// The probability of a contact within `dt` (s).
fn contact_chance(dt: f64) -> f64 {
    (CONTACT_RATE * dt).clamp(0.0, 0.5)
}

/// Whether blobs since the last measurement are where the law has the object.
fn agrees(fit: &Flight, carried: bool, around: &Surroundings, hints: &[Sample]) -> bool {
    hints.iter().all(|hint| {
        let prediction = if carried { fit.predict(&FreeFall, hint.t) } else { fit.predict(around.law, hint.t) };
        WhitenedTest::distance2(&prediction, &hint.position, &hint.covariance()) < 12.0
    })
}

/// Of a normal distribution, 1/m³.
fn normal_density(off: &Vec3, covariance: &Mat3) -> f64 {
    // Farther out than ten standard deviations of the widest axis there is nothing.
    if off.norm_squared() > 100.0 * covariance.trace() {
        return 0.0;
    }
    let Some(cholesky) = covariance.cholesky() else { return 0.0 };
    let whitened = cholesky.l_dirty().solve_lower_triangular(off).map_or(f64::INFINITY, |w| w.norm_squared());
    let scale = cholesky.l_dirty().diagonal().product() * 15.749_609_945_722_419;
    exp(-0.5 * whitened) / scale
}
