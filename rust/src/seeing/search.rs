//! Foreground to components, components to balls.

use super::image::Source;
use super::{Area, Buffers, Seeing};
use crate::detect::ball::{Found, View};
use crate::detect::components::{CHUNK, Cluttered, Component, Marks, connect};
use crate::detect::foreground::{Frame, Sample};
use crate::detect::matching::WINDOWS;
use crate::detect::noise::Noise;
use crate::geometry::camera::Camera;
use crate::simd::widest;
use core::cell::Cell;
use core::ops::Range;
use heapless::Vec;

/// Smallest component that is looked at, px: below it, depth says too little of a ball.
const FEWEST_PIXELS: u32 = 20;
/// Likewise, rows: discs of so many pixels have more. So no component is missed where at first every so manyth row is looked at.
pub(super) const FEWEST_ROWS: usize = 4;
/// A whole ball that can be measured has more than this part of the rows that it has where noise is as large as its radius.
const OF_FARTHEST: f64 = 0.75;
/// Rows around foreground that are looked at as well: enough to see how a silhouette ends.
pub(super) const AROUND: usize = 12;

impl Seeing<'_> {
    /// Searches `area` for balls that lie wholly in it. False where more of the image is needed to see them as they are.
    pub(super) fn search<S: Sample>(
        &mut self,
        source: &mut impl Source<S>,
        area: &Area,
        missing: &[Range<usize>],
        found: &mut Vec<Found, 16>,
    ) -> Result<bool, Cluttered> {
        let Camera { width, height, .. } = self.camera;
        let Area { rows, columns } = area;
        if rows.start >= rows.end || rows.end > height || columns.start >= columns.end || columns.end > width {
            return Ok(false);
        }
        let columns = columns.start / CHUNK * CHUNK..(columns.end.div_ceil(CHUNK) * CHUNK).min(width);
        let area = Area { rows: rows.clone(), columns };
        let (before, surplus) = (found.len(), self.surplus);
        // Holes leave pieces of a ball.
        let fewest = if missing.is_empty() { self.fewest_rows() } else { FEWEST_ROWS };
        // Some rows around what may be a ball; if that is not enough, all of them.
        for (stride, around) in [(fewest, AROUND), (1, height)] {
            self.look_at(source, &area, stride, stride - 1);
            found.truncate(before);
            self.surplus = surplus;
            if self.search_marked(source, &area, fewest, around, missing, found)? {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// Rows that a ball has, at least.
    fn fewest_rows(&self) -> usize {
        let rows = |radius: f64| 2.0 * radius * self.camera.fy / self.noise.reach(radius).min(self.camera.max_depth);
        let farthest = self.radii.iter().map(|radius| rows(*radius)).fold(f64::INFINITY, f64::min);
        ((OF_FARTHEST * farthest) as usize).max(FEWEST_ROWS)
    }

    /// Marks the foreground in every `stride`th row, and `around` those that show any: with one less than `stride`, all of what is as high as that.
    pub(super) fn look_at<S: Sample>(&mut self, source: &mut impl Source<S>, area: &Area, stride: usize, around: usize) {
        let Buffers { limits, marks, .. } = &mut self.buffers;
        let (width, coding) = (self.camera.width, &self.coding);
        let Area { rows, columns } = area;
        let Some(marks) = marks.get_mut(rows.clone()) else { return };
        let limits_of = |row: usize| limits.get(row * width + columns.start..row * width + columns.end).unwrap_or_default();
        widest(
            #[inline(always)]
            || {
                for (row, marks) in rows.clone().zip(&mut *marks) {
                    *marks = Marks::default();
                    if row % stride == 0 {
                        // What lies so far apart, memory does not bring by itself.
                        if stride > 1 {
                            source.fetch(row + 2 * stride, columns);
                        }
                        *marks = Marks::of(source.glance(row, columns.clone()), limits_of(row), columns.start, width, coding);
                        marks.at_hand = false;
                    }
                }
                for seen in (0..marks.len()).filter(|i| (rows.start + i) % stride == 0) {
                    if marks.get(seen).is_none_or(|marks| marks.is_empty()) {
                        continue;
                    }
                    for (i, marks) in marks.iter_mut().enumerate().take(seen + around + 1).skip(seen.saturating_sub(around)) {
                        if !marks.at_hand {
                            let row = rows.start + i;
                            *marks = Marks::of(source.part(row, columns.clone()), limits_of(row), columns.start, width, coding);
                        }
                    }
                }
            },
        );
    }

    /// Searches what is marked of `area` and has the `fewest` rows, and looks so many rows `around` it.
    fn search_marked<S: Sample>(
        &mut self,
        source: &mut impl Source<S>,
        area: &Area,
        fewest: usize,
        around: usize,
        missing: &[Range<usize>],
        found: &mut Vec<Found, 16>,
    ) -> Result<bool, Cluttered> {
        let Buffers { limits, marks, depths, runs, planes, .. } = &mut self.buffers;
        let Camera { width, height, .. } = self.camera;
        let Some(marks) = marks.get_mut(area.rows.clone()) else { return Ok(false) };
        let blank = Frame {
            samples: &[],
            width,
            at_hand: area.clone(),
            marks: &[],
            asked_beyond: Cell::new(false),
            limits,
            depths,
            coding: self.coding,
            missing,
        };
        let smallest = self.radii.iter().copied().fold(f64::INFINITY, f64::min);
        let jump = View::<S>::jump(smallest);
        let frame = Frame { samples: source.samples(), marks, ..blank.clone() };
        let count = connect(&frame, width, area.rows.start, marks, jump, self.noise, runs)?;
        // What touches an edge may go on beyond.
        let inside = |first_and_last: &[u16; 2], area: &Range<usize>, end: usize| {
            let [first, last] = first_and_last.map(usize::from);
            (first > area.start || area.start == 0) && (last + 1 < area.end || area.end == end)
        };
        let whole = |c: &Component| inside(&c.rows, &area.rows, height) && inside(&c.columns, &area.columns, width);
        let may_be_a_ball = |c: &Component| {
            let rows = usize::from(c.rows[1] - c.rows[0]) + 1;
            c.pixels >= FEWEST_PIXELS && rows >= fewest && whole(c)
        };
        let components = || {
            runs.iter().take(count).enumerate().filter_map(|(index, run)| run.component(index)).filter(|component| may_be_a_ball(component))
        };
        for component in components() {
            let [first, last] = component.rows.map(|row| usize::from(row).saturating_sub(area.rows.start));
            for (i, marks) in marks.iter_mut().enumerate().take(last + around + 1).skip(first.saturating_sub(around)) {
                if !core::mem::replace(&mut marks.at_hand, true) {
                    source.part(area.rows.start + i, area.columns.clone());
                }
            }
        }
        let frame = Frame { samples: source.samples(), marks, ..blank };
        for component in components() {
            let mut look_with = |window| {
                let view = |radius| View { frame: &frame, camera: &self.camera, noise: Noise { window }, factors: self.factors, radius };
                look(view, &self.radii, component, planes)
            };
            let ball = match self.matching.settled() {
                Some(window) => look_with(window),
                None => self.matching.weigh(WINDOWS.map(look_with)),
            };
            let Some(ball) = ball else { continue };
            // Two pieces of one ball, on both sides of a hole.
            let is_known = |known: &Found| (known.detection.center - ball.detection.center).norm() < known.detection.radius;
            if !missing.is_empty() && found.iter().any(is_known) {
                continue;
            }
            self.surplus += u64::from(found.push(ball).is_err());
        }
        Ok(!frame.asked_beyond.get())
    }
}

/// The ball that a component is, if it can be one: the radius whose disc comes nearest in size.
fn look<'v, S: Sample + 'v>(view: impl Fn(f64) -> View<'v, S>, radii: &[f64], component: &Component, room: &mut [f32]) -> Option<Found> {
    let (column, row, depth) = component.mean();
    let pixels = f64::from(component.pixels);
    // Seen from the front, the mean depth of a cap is that of its center less two thirds of the radius.
    let start = |radius: f64| view(radius).camera.deproject(column, row, depth + radius * 2.0 / 3.0);
    let ratio = |radius: f64| pixels / view(radius).disc(&start(radius));
    let mismatch = |radius: f64| crate::math::log(ratio(radius)).abs();
    let radius = radii.iter().copied().min_by(|a, b| mismatch(*a).total_cmp(&mismatch(*b)))?;
    if !(0.25..4.0).contains(&ratio(radius)) {
        return None;
    }
    let view = view(radius);
    let found = view.fit(start(radius), component.pixels, room)?;
    if view.frame.missing.is_empty() {
        return Some(found);
    }
    // A hole may leave only a piece of the ball, whose middle is not the ball's: begin again at what the piece led to.
    view.fit(found.detection.center, component.pixels, room)
}
