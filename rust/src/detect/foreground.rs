//! What was not there before: samples as keys that grow with depth, and the depth of the scene without the ball.

use super::components::Marks;
use crate::geometry::camera::{Camera, DepthCode, NO_DISPARITY};
use core::cell::Cell;
use core::ops::Range;

/// The key of a pixel that shows nothing is never below any limit.
pub const NO_KEY: u16 = u16::MAX;

/// How many keys a floating-point image has up to the camera's `max_depth`.
const FLOAT_KEYS: f32 = 60_000.0;

/// How samples become keys and depths. A key is a sample turned so that it grows with depth and is largest where there is no reading:
/// a single comparison then tells foreground.
#[derive(Clone, Copy, Debug)]
pub struct Coding {
    code: DepthCode,
    flip: u16,
    offset: u16,
    max_depth: f64,
    metres_per_unit: f64,
}

impl Coding {
    /// The coding of `camera`'s images.
    pub fn new(camera: &Camera) -> Self {
        let (flip, offset, metres_per_unit) = match camera.code {
            DepthCode::Depth { units_per_metre } => (0, NO_KEY, 1.0 / units_per_metre),
            DepthCode::Disparity { law } if law[1] < 0.0 => (0, 0, 0.0),
            DepthCode::Disparity { .. } => (NO_KEY, NO_DISPARITY, 0.0),
        };
        Self { code: camera.code, flip, offset, max_depth: camera.max_depth, metres_per_unit }
    }

    /// Fills a table of the depth of every disparity, 0 where there is none.
    pub fn tabulate(&self, depths: &mut [f32]) {
        for (sample, depth) in (0_u16..).zip(depths) {
            *depth = self.code.depth(sample).filter(|z| *z <= self.max_depth).unwrap_or(0.0) as f32;
        }
    }
}

/// A pixel's type: `u16` in the camera's code, or `f32` in metres.
pub trait Sample: Copy {
    /// Its key.
    fn key(self, coding: &Coding) -> u16;
    /// Its depth, m, of a sample that has one; `depths` is the table that [`Coding::tabulate`] fills.
    fn depth(self, coding: &Coding, depths: &[f32]) -> f64;
    /// The depth of a key, m, if it has one within the camera's `max_depth`.
    fn depth_of_key(key: u16, coding: &Coding) -> Option<f64>;
    /// The same, 0 where there is none; `depths` is the table that [`Coding::tabulate`] fills.
    fn depth_at(key: u16, coding: &Coding, depths: &[f32]) -> f64;
    /// The change of depth over one key at depth `z`, m.
    fn step(z: f64, coding: &Coding) -> f64;
}

impl Sample for u16 {
    #[inline]
    fn key(self, coding: &Coding) -> u16 {
        (self ^ coding.flip).wrapping_add(coding.offset)
    }

    #[inline]
    fn depth(self, coding: &Coding, depths: &[f32]) -> f64 {
        match coding.code {
            DepthCode::Depth { .. } => f64::from(self) * coding.metres_per_unit,
            DepthCode::Disparity { .. } => f64::from(depths.get(usize::from(self)).copied().unwrap_or(0.0)),
        }
    }

    fn depth_of_key(key: u16, coding: &Coding) -> Option<f64> {
        let sample = key.wrapping_sub(coding.offset) ^ coding.flip;
        coding.code.depth(sample).filter(|z| *z <= coding.max_depth)
    }

    #[inline]
    fn depth_at(key: u16, coding: &Coding, depths: &[f32]) -> f64 {
        let z = (key.wrapping_sub(coding.offset) ^ coding.flip).depth(coding, depths);
        if z <= coding.max_depth { z } else { 0.0 }
    }

    fn step(z: f64, coding: &Coding) -> f64 {
        coding.code.step(z)
    }
}

impl Sample for f32 {
    #[inline]
    fn key(self, coding: &Coding) -> u16 {
        // The conversion saturates and makes NaN 0, which becomes the largest key.
        ((self * (FLOAT_KEYS / coding.max_depth as f32)) as u16).wrapping_sub(1)
    }

    #[inline]
    fn depth(self, _: &Coding, _: &[f32]) -> f64 {
        f64::from(self)
    }

    fn depth_of_key(key: u16, coding: &Coding) -> Option<f64> {
        let z = (f64::from(key) + 1.0) * coding.max_depth / f64::from(FLOAT_KEYS);
        (z <= coding.max_depth).then_some(z)
    }

    #[inline]
    fn depth_at(key: u16, coding: &Coding, _: &[f32]) -> f64 {
        Self::depth_of_key(key, coding).unwrap_or(0.0)
    }

    fn step(_: f64, coding: &Coding) -> f64 {
        coding.max_depth / f64::from(FLOAT_KEYS)
    }
}

/// The nearest key of some samples.
#[inline(always)]
#[allow(clippy::inline_always)] // So that it is compiled for its caller's registers.
pub fn nearest<S: Sample>(samples: &[S], coding: &Coding) -> u16 {
    samples.iter().fold(NO_KEY, |nearest, sample| nearest.min(sample.key(coding)))
}

/// The first key that shows depth `z` (m) or more.
pub fn key_at<S: Sample>(z: f64, coding: &Coding) -> u16 {
    first_key(|key| S::depth_of_key(key, coding).is_none_or(|depth| depth >= z))
}

/// The first key that is farther than the camera's `max_depth`, or no depth at all.
pub fn first_key_beyond<S: Sample>(coding: &Coding) -> u16 {
    first_key(|key| S::depth_of_key(key, coding).is_none())
}

/// The first key from which on `is` holds.
fn first_key(is: impl Fn(u16) -> bool) -> u16 {
    let (mut low, mut high) = (0, NO_KEY);
    while low < high {
        let mid = low + (high - low) / 2;
        if is(mid) { high = mid } else { low = mid + 1 }
    }
    low
}

/// A rectangle of an image.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Area {
    /// Its rows.
    pub rows: Range<usize>,
    /// Its columns.
    pub columns: Range<usize>,
}

/// One image, read pixel by pixel. What lies at or beyond its limit is background.
#[derive(Clone)]
pub struct Frame<'f, S> {
    /// The samples, row by row.
    pub samples: &'f [S],
    /// Columns of the image.
    pub width: usize,
    /// Where samples are at hand,
    pub at_hand: Area,
    /// and in which of its rows.
    pub marks: &'f [Marks],
    /// Whether one was asked for that is not.
    pub asked_beyond: Cell<bool>,
    /// For each pixel of the image, the first key that is background.
    pub limits: &'f [u16],
    /// Depth of every disparity, m.
    pub depths: &'f [f32],
    /// What samples mean.
    pub coding: Coding,
    /// Ranges of samples that were lost on their way, ascending.
    pub missing: &'f [Range<usize>],
}

impl<S: Sample> Frame<'_, S> {
    #[inline]
    fn sample(&self, column: usize, row: usize) -> Option<S> {
        self.row(row, column..column + 1)?.0.first().copied()
    }

    /// Samples side by side, and their limits; `None` where they are not at hand.
    #[inline]
    pub fn row(&self, row: usize, columns: Range<usize>) -> Option<(&[S], &[u16])> {
        let Area { rows, columns: within } = &self.at_hand;
        let at_hand = row.checked_sub(rows.start).and_then(|row| self.marks.get(row)).is_some_and(|marks| marks.at_hand);
        if !at_hand || columns.start < within.start || columns.end > within.end {
            self.asked_beyond.set(true);
            return None;
        }
        let pixels = row * self.width + columns.start..row * self.width + columns.end;
        Some((self.samples.get(pixels.clone())?, self.limits.get(pixels)?))
    }

    /// Depth of the foreground at a pixel, m.
    #[inline]
    pub fn foreground(&self, column: usize, row: usize) -> Option<f64> {
        let (samples, limits) = self.row(row, column..column + 1)?;
        self.shown(*samples.first()?, *limits.first()?)
    }

    /// Depth of a sample, m, if it is before its limit.
    #[inline]
    pub fn shown(&self, sample: S, limit: u16) -> Option<f64> {
        (sample.key(&self.coding) < limit).then(|| sample.depth(&self.coding, self.depths)).filter(|z| *z > 0.0)
    }

    /// Whether a pixel shows something before the key `before`, or something that begins before the key `behind` would be background there.
    #[inline]
    pub fn hides(&self, column: usize, row: usize, before: u16, behind: u16) -> bool {
        let index = row * self.width + column;
        self.is_missing(index)
            || self.limits.get(index).is_some_and(|limit| *limit < behind)
            || self.sample(column, row).is_some_and(|sample| sample.key(&self.coding) < before)
    }

    /// Whether [`Frame::hides`] may hold of any of these pixels, which are side by side.
    #[inline(always)]
    #[allow(clippy::inline_always)] // So that it is compiled for its caller's registers.
    pub fn may_hide(&self, row: usize, columns: Range<usize>, before: u16, behind: u16) -> bool {
        let asked = self.asked_beyond.get();
        let Some((samples, limits)) = self.row(row, columns) else {
            // None of them may be needed.
            self.asked_beyond.set(asked);
            return true;
        };
        let nearest = nearest(samples, &self.coding);
        let limit = limits.iter().fold(NO_KEY, |nearest, limit| nearest.min(*limit));
        nearest < before || limit < behind
    }

    #[inline]
    fn is_missing(&self, index: usize) -> bool {
        !self.missing.is_empty()
            && self.missing.get(self.missing.partition_point(|hole| hole.end <= index)).is_some_and(|hole| hole.start <= index)
    }

    /// Depth from which on pixel `index` counts as background, m; infinite where there was none, 0 where the sample is missing: it shows
    /// nothing, whatever is there.
    #[inline]
    pub fn limit(&self, index: usize) -> f64 {
        if self.is_missing(index) {
            return 0.0;
        }
        self.limits.get(index).and_then(|limit| S::depth_of_key(*limit, &self.coding)).unwrap_or(f64::INFINITY)
    }
}
