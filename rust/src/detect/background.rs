//! The depth of the scene without the ball: learned from first frames, known from the environment, and followed as it changes.
//!
//! Each pixel has a limit, the first key that is background, and the key of what it is taken to show, which the limit keeps its distance from.

#![allow(clippy::inline_always)] // So that loops are compiled for the registers of `widest`.

use super::foreground::{Coding, NO_KEY, Sample, first_key_beyond, key_at, nearest};
use super::noise::Noise;
use crate::geometry::environment::SURVEY_SD;
use crate::simd::widest;
use core::ops::Range;

/// Frames in which each pixel is looked at once for change: 2 s at 30 Hz.
pub const ROUND: usize = 60;
/// Looks that must agree before what has been put down, or taken away, is background: 10 s at 30 Hz.
const STAY: u16 = 5;
/// A limit lies this many standard deviations before the background.
const SIGMAS: f64 = 4.0;
/// Columns of a hole that is bridged, at most: two matching windows.
const HOLE: usize = 2 * Noise::KINECT[0];
/// Pixels that are looked at together where nothing happens.
const CHUNK: usize = 128;

/// What a pixel shows in place of its background: a key, and in how many looks.
pub type Stranger = [u16; 2];

/// Learns the farthest but one reading of each pixel. A ball that rolls through is nearer than what it hides, so it can't burn in, and a
/// single wild reading is left out. Both slices hold key + 1, and 0 where there was no reading. `beyond` is [`first_key_beyond`].
pub fn learn<S: Sample>(samples: &[S], coding: &Coding, beyond: u16, second: &mut [u16], farthest: &mut [u16]) {
    widest(
        #[inline(always)]
        || {
            let chunks = samples.chunks(CHUNK).zip(second.chunks_mut(CHUNK).zip(farthest.chunks_mut(CHUNK)));
            // Where nothing is seen, nothing is learned, and nothing has to come from memory.
            for (samples, (second, farthest)) in chunks.filter(|(samples, _)| nearest(samples, coding) < beyond) {
                for ((sample, second), farthest) in samples.iter().zip(second).zip(farthest) {
                    let key = sample.key(coding);
                    let key = if key < beyond { key + 1 } else { 0 };
                    *second = (*second).max(key.min(*farthest));
                    *farthest = (*farthest).max(key);
                }
            }
        },
    );
}

/// Turns what `frames` frames taught into limits and shown keys: both behind everything where there was nothing.
pub fn limit<S: Sample>(coding: &Coding, frames: u32, limits: &mut [u16], shown: &mut [u16]) {
    let beyond = first_key_beyond::<S>(coding);
    let behind = (NO_KEY, [beyond; 2]);
    // Neighbours show much the same: each key's limit and itself, where it was had before.
    let mut known = [behind; 64];
    for (limits, shown) in limits.chunks_mut(CHUNK).zip(shown.chunks_mut(CHUNK)) {
        // Where nothing was seen at all, it was so side by side.
        if shown.iter().fold(0, |any, key| any | key) == 0 {
            limits.fill(beyond);
            shown.fill(beyond);
            continue;
        }
        for (second, farthest) in limits.iter_mut().zip(shown) {
            // Nothing learned becomes NO_KEY.
            let key = (if frames < 3 { *farthest } else { *second }).wrapping_sub(1);
            let last = &mut known[usize::from(key) % 64];
            if last.0 != key {
                *last = (key, margin::<S>(key, coding, 0.0).map_or(behind.1, |margin| [key.saturating_sub(margin), key]));
            }
            [*second, *farthest] = last.1;
        }
    }
}

/// Bridges the holes of a row, up to `HOLE` wide, that have the same surface on both sides: what is read there now and then is that surface.
pub fn bridge(beyond: u16, limits: &mut [u16], shown: &mut [u16]) {
    let mut start = 0;
    while let Some(width) = shown.get(start..).and_then(|rest| rest.iter().position(|key| *key >= beyond)) {
        let first = start + width;
        let Some(hole) = shown.get(first..).and_then(|rest| rest.iter().position(|key| *key < beyond)) else { return };
        start = first + hole;
        let Some(left) = first.checked_sub(1).filter(|_| hole <= HOLE) else { continue };
        let side = |i: usize| Some((*limits.get(i)?, *shown.get(i)?));
        let (Some((limit, key)), Some((other_limit, other_key))) = (side(left), side(start)) else { return };
        if is_near(key, other_limit, other_key)
            && let (Some(limits), Some(shown)) = (limits.get_mut(first..start), shown.get_mut(first..start))
        {
            limits.fill(limit.min(other_limit));
            shown.fill(key.min(other_key));
        }
    }
}

/// Puts a known surface at depth `z` (m) in; where something nearer was learned, that stays.
pub fn know<S: Sample>(coding: &Coding, z: f64, limit: &mut u16, shown: &mut u16) {
    let key = key_at::<S>(z, coding);
    if let Some(margin) = margin::<S>(key, coding, SURVEY_SD)
        && key.saturating_sub(margin) < *limit
    {
        (*limit, *shown) = (key.saturating_sub(margin), key);
    }
}

/// Looks at the pixels of one row for change. Small differences are followed by one key a look; what shows the same for long enough, and is
/// in none of the columns that are `kept` out, becomes background. `beyond` is [`first_key_beyond`].
pub fn follow<S: Sample>(
    samples: &[S],
    coding: &Coding,
    beyond: u16,
    limits: &mut [u16],
    shown: &mut [u16],
    strangers: &mut [Stranger],
    kept: &[Range<usize>],
) {
    let chunks = samples.chunks(CHUNK).zip(limits.chunks_mut(CHUNK)).zip(shown.chunks_mut(CHUNK)).zip(strangers.chunks_mut(CHUNK));
    for (chunk, (((samples, limits), shown), strangers)) in chunks.enumerate() {
        let first = chunk * CHUNK;
        if !kept.iter().any(|columns| columns.start < first + CHUNK && columns.end > first)
            && widest(
                #[inline(always)]
                || drift(samples, coding, beyond, limits, shown, strangers),
            )
        {
            continue;
        }
        for (i, (((sample, limit), shown), stranger)) in samples.iter().zip(limits).zip(shown).zip(strangers).enumerate() {
            let key = sample.key(coding);
            if key < beyond && !kept.iter().any(|columns| columns.contains(&(first + i))) {
                look::<S>(key, coding, limit, shown, stranger);
            }
        }
    }
}

/// Whether `key` differs from the background by noise.
#[inline(always)]
fn is_near(key: u16, limit: u16, shown: u16) -> bool {
    key.abs_diff(shown) <= (shown - limit.min(shown)).max(1)
}

/// To where as many readings are nearer as are farther.
#[inline(always)]
fn step(key: u16, shown: u16) -> u16 {
    u16::from(key > shown).wrapping_sub(u16::from(key < shown))
}

/// Follows pixels of which none shows a stranger, nor did; false, and nothing done, where one does. Loops without branches: a few wide
/// instructions.
#[inline(always)]
fn drift<S: Sample>(samples: &[S], coding: &Coding, beyond: u16, limits: &mut [u16], shown: &mut [u16], strangers: &[Stranger]) -> bool {
    if nearest(samples, coding) >= beyond {
        return true;
    }
    let calm = (samples.iter().zip(&*limits).zip(&*shown)).fold(true, |calm, ((sample, limit), shown)| {
        let key = sample.key(coding);
        calm & ((key >= beyond) | is_near(key, *limit, *shown))
    });
    if !calm || strangers.as_flattened().iter().fold(0, |any, part| any | part) != 0 {
        return false;
    }
    for ((sample, limit), shown) in samples.iter().zip(limits).zip(shown) {
        let key = sample.key(coding);
        let step = if key < beyond { step(key, *shown) } else { 0 };
        (*limit, *shown) = (limit.wrapping_add(step), shown.wrapping_add(step));
    }
    true
}

/// Looks at one pixel.
fn look<S: Sample>(key: u16, coding: &Coding, limit: &mut u16, shown: &mut u16, stranger: &mut Stranger) {
    if is_near(key, *limit, *shown) {
        let step = step(key, *shown);
        (*limit, *shown, *stranger) = (limit.wrapping_add(step), shown.wrapping_add(step), [0; 2]);
    } else if let Some(margin) = margin::<S>(key, coding, 0.0) {
        let [before, looks] = *stranger;
        *stranger = if looks > 0 && key.abs_diff(before) <= margin { [before, looks + 1] } else { [key, 1] };
        if stranger[1] >= STAY {
            (*limit, *shown, *stranger) = (key.saturating_sub(margin), key, [0; 2]);
        }
    }
}

/// How many keys before background at `key` its limit lies.
fn margin<S: Sample>(key: u16, coding: &Coding, sd: f64) -> Option<u16> {
    let z = S::depth_of_key(key, coding)?;
    Some(libm::ceil(SIGMAS * libm::hypot(Noise::default().axial(z), sd) / S::step(z, coding)) as u16)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::CameraConfig;
    use crate::geometry::camera::{Camera, DepthCode};

    /// Millimetres, one pixel: learns a wall at 2 m, then looks at what follows. Returns the depths of its limit.
    fn limits(looks: impl Iterator<Item = (u16, bool)>) -> std::vec::Vec<u16> {
        let camera = Camera::from_config(&CameraConfig::default(), DepthCode::Depth { units_per_metre: 1000.0 }).unwrap();
        let coding = Coding::new(&camera);
        let (mut limit_, mut shown, mut stranger) = ([0], [0], [[0; 2]]);
        (0..15).for_each(|_| learn(&[2000_u16], &coding, first_key_beyond::<u16>(&coding), &mut limit_, &mut shown));
        limit::<u16>(&coding, 15, &mut limit_, &mut shown);
        let look = |(sample, kept): (u16, bool)| {
            let columns = 0..usize::from(kept);
            follow(
                &[sample],
                &coding,
                first_key_beyond::<u16>(&coding),
                &mut limit_,
                &mut shown,
                &mut stranger,
                if kept { core::slice::from_ref(&columns) } else { &[] },
            );
            limit_[0] + 1
        };
        looks.map(look).collect()
    }

    #[test]
    fn a_hole_in_a_surface_is_that_surface_and_one_at_an_edge_stays() {
        const BEYOND: u16 = 5000;
        let wall = |keys: &[u16]| keys.iter().map(|key| if *key < BEYOND { key - 30 } else { BEYOND }).collect::<std::vec::Vec<_>>();
        let bridged = |keys: &[u16]| {
            let (mut limits, mut shown) = (wall(keys), keys.to_vec());
            bridge(BEYOND, &mut limits, &mut shown);
            assert_eq!(limits, wall(&shown));
            shown
        };
        assert_eq!(bridged(&[2000, BEYOND, BEYOND, 2010, BEYOND]), [2000, 2000, 2000, 2010, BEYOND]);
        for kept in [&[BEYOND, 2000, BEYOND, 2500][..], &[BEYOND; 4], &[2000; 4], &[]] {
            assert_eq!(bridged(kept), kept);
        }
        let mut wide = [BEYOND; HOLE + 3];
        (wide[0], wide[HOLE + 2]) = (2000, 2000);
        assert_eq!(bridged(&wide), wide);
        wide[HOLE + 1] = 2000;
        assert_eq!(bridged(&wide), [2000; HOLE + 3]);
    }

    #[test]
    fn slow_drift_is_followed() {
        let margin = 2000 - limits([(2000, false)].into_iter())[0];
        assert!((15..40).contains(&margin));
        let drifted = limits((0..200).map(|i| (2000 - i / 2, false)));
        assert!(drifted.last().unwrap().abs_diff(1901 - margin) <= 1);
        assert!(limits((0..200).map(|i| (2000 + i / 2, false))).last().unwrap().abs_diff(2099 - margin) <= 1);
    }

    #[test]
    fn what_stays_becomes_background_and_what_moves_or_is_a_ball_does_not() {
        let box_put_down = limits((0..STAY).map(|_| (1500, false)));
        assert!(box_put_down[usize::from(STAY) - 2] > 1900 && *box_put_down.last().unwrap() < 1500);
        let taken_away = limits((0..STAY).map(|_| (3000, false)));
        assert!((2800..3000).contains(taken_away.last().unwrap()));
        assert!(limits((0..100).map(|i| (1000 + 100 * (i % 7), false))).iter().all(|z| *z > 1900));
        assert!(limits((0..100).map(|_| (1500, true))).iter().all(|z| *z > 1900));
        assert!(limits((0..100).map(|_| (0, false))).iter().all(|z| *z > 1900));
    }
}
