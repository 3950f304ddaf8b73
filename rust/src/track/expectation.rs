//! Where a track's object may be at some instant, as a density: by the law that held last, by its newest samples alone, or after a contact.

use crate::math::{Mat3, Vec3, exp, sqrt};
use crate::physics::Sample;
use crate::physics::flight::{Flight, Prediction};
use crate::physics::inconsistency::WhitenedTest;
use crate::physics::law::{FreeFall, Law};
use crate::track::hypothesis::Surroundings;
use crate::track::object::{HINTS, Track};
use heapless::Vec;

/// Contacts a second.
const CONTACT_RATE: f64 = 1.0;
/// Part of all motions that a law describes only roughly: its error, m, and its growth with the way since the last sample.
const ROUGH: (f64, f64, f64) = (0.1, 0.01, 0.1);
/// Speeds of an object that was seen once, m/s an axis.
const SPEED: f64 = 4.0;
/// A contact leaves a ball no faster than before, but for this, m/s, and gravity.
const FASTER: f64 = 0.3;

/// Samples that no law explains are looked at so many together.
const NEWEST: usize = 3;

/// A track's object as it is awaited.
#[derive(Clone, Debug)]
pub struct Expectation {
    /// Flights that may hold, their probabilities, and whether a surface carries it.
    flights: [Option<(Flight, f64, bool)>; 2],
    last: Vec3,
    since: f64,
    speed: f64,
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
        Some(Self {
            flights: [lawful.map(|(fit, carried)| (fit, share, carried)), newest.map(|fit| (fit, share, false))],
            last: last.position,
            since: last.t,
            speed: speeds.fold(0.0, f64::max),
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
                let reach = SPEED * (t - self.since);
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
        let touched = if self.touches && !self.young { self.touched(dt, center, own) } else { 0.0 };
        lawful + touched
    }

    /// The density after a contact since the last sample: anywhere as far away as it may have got.
    fn touched(&self, dt: f64, center: &Vec3, own: &Mat3) -> f64 {
        let reach = self.speed * dt + FASTER * dt + 5.0 * dt * dt + 3.0 * sqrt(own.trace());
        let inside = (center - self.last).norm() < reach;
        let chance = (CONTACT_RATE * dt).min(0.5);
        if inside { chance / (4.0 / 3.0 * core::f64::consts::PI * reach * reach * reach) } else { 0.0 }
    }
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
