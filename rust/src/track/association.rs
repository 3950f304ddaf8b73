//! Which measurement belongs to which track: the pairing of all tracks with all measurements that is most probable as a whole.

use crate::geometry::camera::{Camera, Pose};
use crate::math::{Mat3, Vec3, log, sqrt};
use crate::track::Measurement;
use crate::track::assignment::assign;
use crate::track::expectation::Expectation;
use crate::track::hypothesis::Surroundings;
use crate::track::object::{Track, blur};
use heapless::Vec;

/// Tracks at once.
pub const TRACKS: usize = 16;
/// Measurements of one instant.
pub const MEASUREMENTS: usize = 16;
/// A blob that can't be measured may be of two: it stands in a second column.
const COLUMNS: usize = 2 * MEASUREMENTS;
/// New objects an instant and cubic metre, before a camera. A track that takes up another's ball is worse than two tracks of one ball: so many
/// more of them than there are.
const NEW: f64 = 0.1;
/// The same for each other object that is about: it may come out from behind one.
const REVEALED: f64 = 0.4;
/// So many times as many near the image's edge, and how near, m.
const AT_EDGE: f64 = 10.0;
const ENTRANCE: f64 = 0.15;
/// An object in plain view is not measured, at this rate.
const UNSEEN: f64 = 0.03;
/// One that was not measured a frame ago.
const AGAIN: f64 = 0.5;
/// One that something hides.
const HIDDEN: f64 = 0.9;
/// A ball shows as a blob that can't be measured, at this rate.
const BLURRED: f64 = 0.2;
/// A track goes on where the best pairing is so much (log) more probable than any without it: 4.5 to 1, at rates of new objects that are some
/// hundred times the real ones. 10 to 1 breaks a quarter more tracks.
const BELIEVED: f64 = 1.5;
/// Gain of two labels that agree: more than any probability.
const LABEL: f64 = 1e6;

/// What became of the tracks.
#[derive(Clone, Debug)]
pub struct Association {
    /// For each measurement, the number of its track. A blob that can't be measured has none.
    pub tracks: Vec<Option<u32>, MEASUREMENTS>,
    /// For each track, whether it may be there though it was not measured: something hides it, or a blob that can't be measured is where it should be.
    pub excused: [bool; TRACKS],
    /// For each track, the blob (index of its measurement) that can't be measured and is its.
    pub blurred: [Option<usize>; TRACKS],
}

/// The camera that looks, and where from.
#[derive(Clone, Copy, Debug)]
pub struct Sight<'a> {
    /// Its image.
    pub camera: &'a Camera,
    /// Where it stands.
    pub pose: Pose,
}

/// Pairs `measured` with `tracks`; `sight` is the camera's that measured, if one did.
pub fn associate(tracks: &[Track], measured: &[Measurement], sight: Option<Sight<'_>>, around: &Surroundings) -> Association {
    let measured = measured.get(..MEASUREMENTS).unwrap_or(measured);
    let mut gains: Vec<[f64; COLUMNS], TRACKS> = tracks.iter().take(TRACKS).map(|_| [0.0; COLUMNS]).collect();
    let mut excused = [false; TRACKS];
    for ((track, gains), excused) in tracks.iter().zip(&mut gains).zip(&mut excused) {
        let now = measured.first().map_or(0.0, |m| track.seconds(m.time_ns));
        let around = &track.own.as_ref().map_or(*around, |law| Surroundings { law, ..*around });
        let Some(expected) = Expectation::new(track, around, !track.is_missed(now)) else { continue };
        let place = sight.zip(expected.prediction(around.law, now)).map(|(sight, p)| (sight, p, sight.pose.to_camera(&p.state.position)));
        *excused = place.is_some_and(|(sight, p, center)| {
            let spread = sqrt(p.covariance.trace());
            spread < track.radius && sight.hides(&center, track.radius + spread, measured)
        });
        let unseen = match () {
            () if *excused || place.is_some_and(|(sight, _, center)| sight.cuts(&center, track.radius)) => HIDDEN,
            () if track.is_unmeasured() => AGAIN,
            // Only what goes by the law is known to be in plain view.
            () => UNSEEN + (AGAIN - UNSEEN) * expected.astray(now),
        };
        let new = NEW + REVEALED * (tracks.len() - 1) as f64;
        for (j, m) in measured.iter().enumerate() {
            let at_edge = sight.is_some_and(|s| s.cuts(&s.pose.to_camera(&m.center), ENTRANCE));
            let new = if at_edge { AT_EDGE * new } else { new };
            let gain = gain(track, &expected, m, unseen * new, around);
            gains[j] = gain;
            if !m.whole {
                gains[MEASUREMENTS + j] = gain;
            }
        }
    }
    let mut columns = [None; TRACKS];
    assign(&gains, &mut columns);
    if tracks.len() > 1 || measured.len() > 1 {
        disbelieve(&mut gains, &mut columns);
    }
    let mut association = Association { tracks: measured.iter().map(|_| None).collect(), excused, blurred: [None; TRACKS] };
    for (i, (track, column)) in tracks.iter().zip(columns).enumerate() {
        let Some(j) = column.map(|column| column % MEASUREMENTS) else { continue };
        if measured[j].whole {
            association.tracks[j] = Some(track.id);
        } else {
            (association.excused[i], association.blurred[i]) = (true, Some(j));
        }
    }
    association
}

/// Takes those pairs back without which the best pairing would be nearly as probable: a track that ends and another that begins tell less than a
/// wrong one, but nothing wrong.
fn disbelieve(gains: &mut [[f64; COLUMNS]], columns: &mut [Option<usize>; TRACKS]) {
    let total = |gains: &[[f64; COLUMNS]], columns: &[Option<usize>; TRACKS]| -> f64 {
        gains.iter().zip(columns).filter_map(|(gains, column)| column.map(|column| gains[column])).sum()
    };
    let (all, best) = (total(gains, columns), *columns);
    for (i, column) in best.iter().enumerate().take(gains.len()) {
        let Some(j) = column.map(|column| column % MEASUREMENTS) else { continue };
        // A blob has two columns, of which either will do.
        let (gain, again) = (gains[i][j], gains[i][MEASUREMENTS + j]);
        (gains[i][j], gains[i][MEASUREMENTS + j]) = (0.0, 0.0);
        let mut without = [None; TRACKS];
        assign(gains, &mut without);
        if all - total(gains, &without) < BELIEVED {
            columns[i] = None;
        }
        (gains[i][j], gains[i][MEASUREMENTS + j]) = (gain, again);
    }
}

/// By how much (log) more probable it is that `m` shows `track` than that it shows something new and the track is not seen.
fn gain(track: &Track, expected: &Expectation, m: &Measurement, otherwise: f64, around: &Surroundings) -> f64 {
    let labels = (track.label, m.label);
    if labels != (None, None) {
        return if labels.0 == labels.1 { LABEL } else { 0.0 };
    }
    // Kinds that are nearly of one size are not told apart from frame to frame.
    if m.whole && (m.radius / track.radius - 1.0).abs() > 0.2 {
        return 0.0;
    }
    let own = m.covariance.unwrap_or_else(|| Mat3::from_diagonal_element(1e-4));
    let (shown, own) = if m.whole { (1.0 - UNSEEN, own) } else { (BLURRED, own + Mat3::from_diagonal_element(blur(track.radius))) };
    let density = expected.density(around.law, track.seconds(m.time_ns), &m.center, &own);
    log(shown * density / otherwise)
}

impl Sight<'_> {
    /// Whether something measured hides a ball at `center` (camera frame), or a part of it.
    fn hides(&self, center: &Vec3, radius: f64, measured: &[Measurement]) -> bool {
        let disc = radius / center.z;
        measured.iter().any(|m| {
            let front = self.pose.to_camera(&m.center);
            front.z < center.z - 0.5 * radius && (front / front.z - center / center.z).norm() < m.radius / front.z + disc
        })
    }

    /// Whether the image's edge cuts a ball at `center` (camera frame), or it is outside.
    pub fn cuts(&self, center: &Vec3, radius: f64) -> bool {
        let Some((column, row)) = self.camera.project(center) else { return true };
        let (rx, ry) = (radius / center.z * self.camera.fx, radius / center.z * self.camera.fy);
        column < rx || row < ry || column > self.camera.width as f64 - 1.0 - rx || row > self.camera.height as f64 - 1.0 - ry
    }
}
