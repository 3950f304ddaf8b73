//! Which measurement belongs to which track: by prediction, nearest first.

use crate::math::Mat3;
use crate::physics::inconsistency::WhitenedTest;
use crate::track::Measurement;
use crate::track::hypothesis::Surroundings;
use crate::track::object::Track;
use heapless::Vec;

/// Tracks at once.
pub const TRACKS: usize = 8;
/// Measurements of one instant.
pub const MEASUREMENTS: usize = 16;
/// Squared Mahalanobis distance up to which a measurement is where the law puts the object.
const GATE: f64 = 30.0;

/// For each measurement, the place of its track in `tracks`.
pub fn associate(tracks: &[Track], measured: &[Measurement], around: &Surroundings) -> Vec<Option<usize>, MEASUREMENTS> {
    let mut assigned: Vec<Option<usize>, MEASUREMENTS> = measured.iter().take(MEASUREMENTS).map(|_| None).collect();
    let mut pairs: Vec<(f64, usize, usize), { TRACKS * MEASUREMENTS }> = Vec::new();
    for (i, track) in tracks.iter().enumerate() {
        for (j, m) in measured.iter().enumerate().take(MEASUREMENTS).filter(|(_, m)| m.whole) {
            let labels = match (track.label, m.label) {
                (Some(a), Some(b)) if a == b => Some(0.0),
                (None, None) => cost(track, m, around),
                _ => None,
            };
            if let Some(cost) = labels {
                let _ = pairs.push((cost, i, j));
            }
        }
    }
    pairs.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    let mut taken = [false; TRACKS];
    for (_, i, j) in pairs {
        if !taken[i] && assigned[j].is_none() {
            taken[i] = true;
            assigned[j] = Some(i);
        }
    }
    assigned
}

/// How badly `m` fits `track`: the squared Mahalanobis distance; beyond the gate, where the object can only be after a contact,
/// more than any that is inside.
fn cost(track: &Track, m: &Measurement, around: &Surroundings) -> Option<f64> {
    let t = track.seconds(m.time_ns);
    let prediction = track.predict(around, t);
    let own = m.covariance.unwrap_or_else(|| Mat3::from_diagonal_element(1e-4));
    let d2 = WhitenedTest::distance2(&prediction, &m.center, &own);
    let same_kind = (m.radius - track.radius).abs() < 1e-9;
    if !same_kind {
        None
    } else if d2 < GATE {
        Some(d2)
    } else {
        track.reaches(&m.center, t).then(|| GATE + (m.center - prediction.state.position).norm() * 1e3)
    }
}
