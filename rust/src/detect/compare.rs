//! What an image shows where a ball is thought to be: depth against the cap's, pixels against the silhouette's.

#![allow(clippy::inline_always)] // So that loops are compiled for the registers of `widest`.

use super::ball::View;
use super::foreground::{Sample, key_at};
use super::patch::{Patch, Surface};
use super::window::{Grid, Plane, Planes};
use crate::math::{Vec3, round, sqrt, sqrtf};

/// Half the width over which the silhouette's edge is compared, px: wide enough for its noise, narrow enough to see nothing else.
pub const BAND: f64 = 2.0;

/// A guess that is being refined: center, and the silhouette's shortfall, m.
#[derive(Clone, Copy)]
pub struct Guess {
    /// Camera frame.
    pub center: Vec3,
    /// How much smaller than the disc the silhouette is.
    pub shortfall: f64,
}

/// One kind of evidence, linear in what is to be found.
pub struct Linear<'p> {
    /// Three derivatives, and a pattern that no ball has.
    pub jacobian: Planes<'p>,
    /// What was measured less what was expected.
    pub residual: &'p mut Plane,
}

impl<'p> Linear<'p> {
    /// In five planes, of which all but the pixels' rows become 0.
    pub fn new(grid: &Grid, mut planes: [&'p mut Plane; 5]) -> Self {
        for plane in &mut planes {
            grid.clear_ends(plane, 0.0);
        }
        let [right, down, along, pattern, residual] = planes;
        Self { jacobian: [right, down, along, pattern], residual }
    }

    /// Its derivatives, to read.
    pub fn planes(&self) -> [&Plane; 4] {
        self.jacobian.each_ref().map(|plane| &**plane)
    }

    /// Fills the planes of `to`, of a thinned grid, with means over blocks of `STRIDE` × `STRIDE` pixels: over those that take part, where the third
    /// plane of the jacobian is not 0.
    #[inline(always)]
    pub fn thin<const STRIDE: usize>(&self, grid: &Grid, to: &mut Linear, room: [&mut Plane; 2]) {
        let [counts, row] = room;
        let thinned = grid.thinned(STRIDE);
        let counts = counts.get_mut(thinned.pixels()).unwrap_or_default();
        add_up::<STRIDE>(grid, &thinned, self.jacobian[2], |along| if along == 0.0 { 0.0 } else { 1.0 }, row, counts);
        let [right, down, along, pattern] = self.planes();
        let [to_right, to_down, to_along, to_pattern] = to.jacobian.each_mut().map(|plane| &mut **plane);
        let pairs = [(right, to_right), (down, to_down), (along, to_along), (pattern, to_pattern), (&*self.residual, &mut *to.residual)];
        for (from, to) in pairs {
            let to = to.get_mut(thinned.pixels()).unwrap_or_default();
            add_up::<STRIDE>(grid, &thinned, from, |value| value, row, to);
            for (to, count) in to.iter_mut().zip(&*counts) {
                *to = if *count == 0.0 { 0.0 } else { *to / count };
            }
        }
    }
}

/// Sums of what is made `of` each cell, over blocks of `STRIDE` × `STRIDE` pixels. `row` is room to work in.
#[inline(always)]
fn add_up<const STRIDE: usize>(grid: &Grid, thinned: &Grid, from: &Plane, of: impl Fn(f32) -> f32, row: &mut Plane, sums: &mut Plane) {
    let width = grid.width();
    let rows = from.get(grid.pixels()).unwrap_or_default().chunks(STRIDE * width);
    let down = row.get_mut(..width).unwrap_or_default();
    for (rows, sums) in rows.zip(sums.chunks_exact_mut(thinned.width())) {
        down.fill(0.0);
        for row in rows.chunks_exact(width) {
            for (value, sum) in row.iter().zip(&mut *down) {
                *sum += of(*value);
            }
        }
        sums.fill(0.0);
        for (values, sum) in down.as_chunks::<STRIDE>().0.iter().zip(sums) {
            *sum = values.iter().sum();
        }
    }
}

/// How many pixels around a ball show what.
#[derive(Clone, Copy, Default)]
pub struct Evidence {
    /// Pixels whose depth takes part, and those that show something near the ball, but no ball.
    pub points: u32,
    /// See `points`.
    pub wild: u32,
    /// Pixels well inside the disc; of those, the ones that show the ball, and the ones that the background may hide.
    pub disc: u32,
    /// See `disc`.
    pub seen: u32,
    /// See `disc`.
    pub hidden: u32,
    /// Pixels of foreground at the ball's depth, in the disc or on its edge.
    pub mask: u32,
}

/// Squares of distances from the center's ray, m².
struct Rings {
    /// Silhouettes are compared from `inner` to `outer`.
    inner: f32,
    outer: f32,
    /// Within, the disc is surely seen.
    disc: f32,
}

impl<S: Sample> View<'_, S> {
    /// Fills a plane with the depths that the image shows as foreground, less that of `center`; infinite where it shows none.
    #[inline(always)]
    pub fn read(&self, patch: &Patch, center: &Vec3, readings: &mut Plane) {
        let grid = &patch.grid;
        let rows = readings.get_mut(grid.pixels()).unwrap_or_default().chunks_exact_mut(grid.width()).enumerate();
        for (y, readings) in rows {
            let (first, row) = patch.pixel(0, y);
            let last = patch.pixel(grid.columns.saturating_sub(1), y).0;
            let (samples, limits) = self.frame.row(row, first..last + 1).unwrap_or_default();
            readings.fill(f32::INFINITY);
            let pixels = samples.iter().step_by(patch.stride).zip(limits.iter().step_by(patch.stride));
            for (reading, (sample, limit)) in readings.iter_mut().zip(pixels) {
                if let Some(z) = self.frame.shown(*sample, *limit) {
                    *reading = (z - center.z) as f32;
                }
            }
        }
    }

    /// Compares what [`View::read`] read with a guess, of which `surface` was drawn: fills the cap's derivatives by the center, and the outline's
    /// by the directions across the line of sight and by the shortfall.
    #[inline(always)]
    pub fn compare(
        &self,
        patch: &Patch,
        guess: &Guess,
        surface: &Surface,
        readings: &Plane,
        cap: &mut Linear,
        outline: &mut Linear,
    ) -> Evidence {
        let Guess { center, shortfall } = *guess;
        let (camera, scale, axial) = (self.camera, self.scale(center.z), self.noise.axial(center.z));
        // From how far before its surface to how far behind its center the ball may show, and how wild a reading of it may be, m.
        let [near, far, gate] = [2.0, 0.5, 0.5].map(|jumps| (4.0 * axial + jumps * Self::jump(self.radius)) as f32);
        let (edge, outer) = ((self.radius - shortfall) as f32, (self.radius - shortfall + BAND / scale) as f32);
        let [inner, disc] = [BAND, 1.0].map(|pixels| (edge - (pixels / scale) as f32).max(0.0));
        let rings = Rings { inner: inner * inner, outer: outer * outer, disc: disc * disc };
        let pixels = patch.grid.pixels();

        let depth = surface.depth.get(pixels.clone()).unwrap_or_default();
        let offsets = surface.offset_square.get(pixels.clone()).unwrap_or_default();
        let readings = readings.get(pixels.clone()).unwrap_or_default();
        let residual = cap.residual.get_mut(pixels.clone()).unwrap_or_default();
        differ(readings, depth, offsets, rings.outer, [near, far], residual);
        let mut evidence = count(residual, offsets, rings.disc, gate);
        if evidence.seen < evidence.disc {
            evidence.hidden = self.hidden(patch, &center, surface, cap.residual, rings.disc);
        }
        self.silhouette_of(patch, &center, offsets, cap.residual.get(pixels.clone()).unwrap_or_default(), edge, &rings, outline);
        if !self.is_clear(patch, self.keys(&center)) {
            self.blinded(patch, &center, surface, edge, &rings, outline);
        }

        // Moving the ball moves the picture of its cap: by the center's derivatives, the depth changes as it does from pixel to pixel.
        let per_metre = 0.5 / (patch.stride as f64 * center.z);
        let width = patch.grid.width();
        let shifted = |by: isize| {
            let start = pixels.start.wrapping_add_signed(by);
            surface.depth.get(start..start + pixels.len()).unwrap_or_default()
        };
        let [right, down, along, pattern] = cap.jacobian.each_mut().map(|plane| plane.get_mut(pixels.clone()).unwrap_or_default());
        let residual = cap.residual.get_mut(pixels.clone()).unwrap_or_default();
        slopes(shifted(-1), shifted(1), (camera.fx * per_metre) as f32, right);
        slopes(shifted(-(width as isize)), shifted(width as isize), (camera.fy * per_metre) as f32, down);
        derive([(center.x / center.z) as f32, (center.y / center.z) as f32], gate, [right, down, along, pattern], residual);
        evidence.points = along.iter().map(|along| u32::from(*along != 0.0)).sum();
        evidence
    }

    /// Keys before which something stands before a ball, and at which its background would be hidden by it.
    fn keys(&self, center: &Vec3) -> [u16; 2] {
        let axial = self.noise.axial(center.z);
        let near = 4.0 * axial + 2.0 * Self::jump(self.radius);
        [center.z - near, center.z + 2.0 * axial].map(|z| key_at::<S>(z, &self.frame.coding))
    }

    /// Pixels in the disc that show no ball where the background may hide it.
    fn hidden(&self, patch: &Patch, center: &Vec3, surface: &Surface, residual: &Plane, disc: f32) -> u32 {
        let axial = self.noise.axial(center.z);
        let is_hidden = |(x, y): (usize, usize)| {
            let i = patch.grid.first() + y * patch.grid.width() + x;
            let (Some(offset_square), Some(depth), Some(residual)) = (surface.offset_square.get(i), surface.depth.get(i), residual.get(i))
            else {
                return false;
            };
            let depth = if depth.is_nan() { 0.0 } else { *depth };
            let (column, row) = patch.pixel(x, y);
            *offset_square < disc
                && residual.is_nan()
                && self.frame.limit(row * self.camera.width + column) - center.z < f64::from(depth) + 2.0 * axial
        };
        patch.places().filter(|place| is_hidden(*place)).count() as u32
    }

    /// Inside the band the share of the ball in a pixel falls linearly from 1 to 0.
    #[inline(always)]
    #[allow(clippy::too_many_arguments)]
    fn silhouette_of(&self, patch: &Patch, center: &Vec3, offsets: &Plane, shown: &Plane, edge: f32, rings: &Rings, outline: &mut Linear) {
        let scale = self.scale(center.z) as f32;
        let slope = scale / (2.0 * BAND as f32);
        let (column, row) = self.camera.project(center).unwrap_or_default();
        let (column, row) = ((patch.left as f64 - column) as f32, (patch.top as f64 - row) as f32);
        let step = patch.stride as f32;
        let grid = &patch.grid;
        let [right, down, less, pattern] = outline.jacobian.each_mut().map(|plane| plane.get_mut(grid.pixels()).unwrap_or_default());
        let residual = outline.residual.get_mut(grid.pixels()).unwrap_or_default();
        for ((less, residual), (offset_square, shown)) in less.iter_mut().zip(residual).zip(offsets.iter().zip(shown)) {
            let in_band = *offset_square >= rings.inner && *offset_square <= rings.outer;
            let inside = (edge - sqrtf(*offset_square)) * scale;
            let shown = if shown.is_nan() { 0.0 } else { 1.0 };
            *less = if in_band { -slope } else { 0.0 };
            *residual = if in_band { shown - (0.5 + inside / (2.0 * BAND as f32)) } else { 0.0 };
        }
        let rows = right.chunks_exact_mut(grid.width()).zip(down.chunks_exact_mut(grid.width())).zip(less.chunks_exact(grid.width()));
        for (y, ((right, down), less)) in rows.enumerate() {
            let dy = row + y as f32 * step;
            for (x, ((right, down), less)) in right.iter_mut().zip(down).zip(less).enumerate() {
                let dx = column + x as i32 as f32 * step;
                let part = -less / sqrtf(dx * dx + dy * dy).max(1e-9);
                (*right, *down) = (dx * part, dy * part);
            }
        }
        // Of a triangle: square windows leave twofold traces in a silhouette, but none of these.
        let unit = 1.0 / slope;
        for ((pattern, right), down) in pattern.iter_mut().zip(&*right).zip(&*down) {
            let (u, v) = (right * unit, down * unit);
            *pattern = right * (u * u - 3.0 * v * v);
        }
    }

    /// Whether every pixel near the ball can tell where its edge is.
    #[inline(always)]
    fn is_clear(&self, patch: &Patch, keys: [u16; 2]) -> bool {
        let margin = BAND as usize;
        let reach = |pixels: usize| (pixels - 1) * patch.stride + 1 + 2 * margin;
        let (Some(left), Some(top)) = (patch.left.checked_sub(margin), patch.top.checked_sub(margin)) else { return false };
        let (columns, rows) = (left..left + reach(patch.grid.columns), top..top + reach(patch.grid.rows));
        columns.end <= self.camera.width && rows.end <= self.camera.height && self.frame.missing.is_empty() && {
            let mut clear = true;
            for row in rows {
                clear &= !self.frame.may_hide(row, columns.clone(), keys[0], keys[1]);
            }
            clear
        }
    }

    /// Takes out of the outline what can't tell where the ball's edge is. What hides a pixel takes its mirror image too, or else what is left
    /// would pull.
    #[inline(never)]
    fn blinded(&self, patch: &Patch, center: &Vec3, surface: &Surface, edge: f32, rings: &Rings, outline: &mut Linear) {
        let scale = self.scale(center.z);
        let keys = self.keys(center);
        let (column, row) = self.camera.project(center).unwrap_or_default();
        for (x, y) in patch.places() {
            let i = patch.grid.first() + y * patch.grid.width() + x;
            let Some(offset_square) = surface.offset_square.get(i).filter(|square| (rings.inner..=rings.outer).contains(*square)) else {
                continue;
            };
            let (pixel_x, pixel_y) = patch.pixel(x, y);
            let (pixel_x, pixel_y) = (pixel_x as f64, pixel_y as f64);
            let inside = f64::from(edge - sqrtf(*offset_square)) * scale;
            let (dx, dy) = (pixel_x - column, pixel_y - row);
            let length = sqrt(dx * dx + dy * dy).max(1e-9);
            let mirror = [pixel_x + 2.0 * inside * dx / length, pixel_y + 2.0 * inside * dy / length].map(round);
            if self.blind(pixel_x, pixel_y, keys) || self.blind(mirror[0], mirror[1], keys) {
                let planes = outline.jacobian.each_mut().map(|plane| &mut **plane);
                planes.into_iter().chain([&mut *outline.residual]).filter_map(|plane| plane.get_mut(i)).for_each(|value| *value = 0.0);
            }
        }
    }

    /// Whether a pixel can't tell where the ball's edge is: outside of the image, or what is behind or before the ball, at these keys, comes
    /// too near.
    fn blind(&self, column: f64, row: f64, [before, behind]: [u16; 2]) -> bool {
        let inside = column >= 0.0 && row >= 0.0 && column < self.camera.width as f64 && row < self.camera.height as f64;
        !inside || self.frame.hides(column as usize, row as usize, before, behind)
    }
}

/// How far readings are behind the ball's surface; NaN where they don't show the ball.
#[inline(always)]
fn differ(readings: &Plane, depth: &Plane, offsets: &Plane, outer: f32, [near, far]: [f32; 2], residual: &mut Plane) {
    for (((residual, reading), depth), offset_square) in residual.iter_mut().zip(readings).zip(depth).zip(offsets) {
        let depth = if depth.is_nan() { 0.0 } else { *depth };
        let shows = *offset_square <= outer && *reading > depth - near && *reading < far;
        *residual = if shows { reading - depth } else { f32::NAN };
    }
}

#[inline(always)]
fn count(residual: &Plane, offsets: &Plane, disc: f32, gate: f32) -> Evidence {
    let (mut mask, mut wild, mut inside, mut seen) = (0, 0, 0, 0);
    for (residual, offset_square) in residual.iter().zip(offsets) {
        let (shows, in_disc) = (u32::from(!residual.is_nan()), u32::from(*offset_square < disc));
        mask += shows;
        wild += u32::from(residual.abs() >= gate);
        inside += in_disc;
        seen += in_disc & shows;
    }
    Evidence { mask, wild, disc: inside, seen, ..Evidence::default() }
}

#[inline(always)]
fn slopes(before: &Plane, behind: &Plane, factor: f32, slopes: &mut Plane) {
    for ((slope, before), behind) in slopes.iter_mut().zip(before).zip(behind) {
        *slope = (before - behind) * factor;
    }
}

/// From the slopes of the cap's depth in the picture to its derivatives by the center, of which the third is along the line of sight (through `column`
/// and `row` at depth 1), and the pattern; all 0 where the reading is wild or shows no ball.
#[inline(always)]
fn derive([column, row]: [f32; 2], gate: f32, [right, down, along, pattern]: Planes, residual: &mut Plane) {
    for ((((right, down), along), pattern), residual) in right.iter_mut().zip(down).zip(along).zip(pattern).zip(residual) {
        let value = 1.0 - *right * column - *down * row;
        // Neither holds of NaN.
        let used = residual.abs() < gate && value.abs() < f32::INFINITY;
        let keep = |value: f32| if used { value } else { 0.0 };
        (*right, *down, *along, *residual) = (keep(*right), keep(*down), keep(value), keep(*residual));
        *pattern = *right * *down;
    }
}
