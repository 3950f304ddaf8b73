//! The seen surface of one object as a small image of cells: where it is, how it faces, and how far it reaches.
//!
//! A cell is the mean of a square of pixels, so many that the object fits into [`EDGE`] of them. Neighbours in the image are neighbours on the
//! surface, or nearly: normals need no search, and what a point of another cloud meets is found by projecting it.

#![allow(clippy::inline_always)] // So that loops are compiled for the registers of `widest`.

use super::foreground::Area;
use super::icp::{FACING, dot};
use crate::geometry::camera::Camera;
use crate::math::{Vec3, sqrt, sqrtf};
use crate::simd::widest;
use heapless::Vec;

/// Columns and rows of cells.
pub const EDGE: usize = 80;
/// Cells.
pub const CELLS: usize = EDGE * EDGE;
/// Empty cells around the object, in which its silhouette fades.
const MARGIN: usize = 2;
/// So many cells of 2 × 2 pixels across the object tell as much as twice as many of one, which share their noise.
const ENOUGH: usize = 26;
/// Points of the silhouette at the most.
const OUTLINE: usize = 400;
/// Pixels over which a normal is taken, at the least: as many as the matching window has.
const NORMAL_PX: usize = 7;
/// Slope, depth a distance across, above which neighbours are two surfaces; and the step in depth, m, that noise may make besides.
const STEEPEST: (f32, f32) = (2.0, 0.01);
/// Cells that are covered more than this, with those around them, are not at the rim.
const INSIDE: f32 = 0.95;
/// At the rim a surface bends on no further than so many times as far as it is known to;
const FURTHEST: f32 = 2.0;
/// and no further than until it is seen edge-on, nearly: cosine of the angle between its normal and the ray.
const EDGE_ON: f32 = 0.1;
/// Cells over which a silhouette fades.
const REACH: f32 = 2.0;

/// Cells whose normals are taken at once: a wide register's.
const LANES: usize = 8;
/// Room before the first cell and after the last, of which none is seen.
const PAD: usize = 3 * EDGE + LANES;
const PADDED: usize = CELLS + 2 * PAD;
const _: () = assert!(EDGE.is_multiple_of(LANES));
/// x/z, y/z and 1/z of each cell: that of a plane is linear in the first two. 1/z is 0 where nothing is seen. Row follows on row: beside one
/// is the margin of another.
type Rays = [[f32; PADDED]; 3];
/// How far the cells through which a cell's plane was laid lie aside of it in the mean, as x/z, y/z and 1/z; 0 where they surround it.
type Asides = [[f32; 3]; CELLS];

/// The mean of a square of pixels.
#[derive(Clone, Copy, Debug, Default)]
pub struct Cell {
    /// Mean of their points, camera frame, m; all 0 where there are too few.
    pub point: [f32; 3],
    /// How much of the square, and of those around it, the object covers: 0 to 1. While points are added, how many pixels.
    pub cover: f32,
    /// Unit normal, towards the camera; all 0 where it can't be told.
    pub normal: [f32; 3],
    /// Views of which `point` is the mean; 0 where nothing is seen.
    pub views: f32,
    /// 1/z of the surface in its middle, 1/m; 0 where its normal can't be told.
    inverse: f32,
}

impl Cell {
    /// Whether it shows a surface.
    #[inline(always)]
    pub fn is_seen(&self) -> bool {
        self.point[2] > 0.0
    }

    /// Whether it is known how that surface faces.
    #[inline(always)]
    pub fn has_normal(&self) -> bool {
        self.normal[2] < 0.0
    }
}

/// The point that lies so far `aside` of a cell's, m.
fn midst(cell: &Cell, aside: &[f32; 3]) -> [f32; 3] {
    let (w, z) = (1.0 / cell.point[2], 1.0 / (1.0 / cell.point[2] + aside[2]));
    [(cell.point[0] * w + aside[0]) * z, (cell.point[1] * w + aside[1]) * z, z]
}

fn distance_square(a: &[f32; 3], b: &[f32; 3]) -> f32 {
    let between = [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
    dot(&between, &between)
}

/// The seen surface of one object.
#[derive(Clone, Debug)]
pub struct Cloud {
    cells: [Cell; CELLS],
    outline: Vec<[f32; 3], OUTLINE>,
    /// Cells in use.
    columns: usize,
    rows: usize,
    /// Columns and rows of pixels a cell.
    stride: usize,
    /// First pixel, column and row; before the image's where the object is at its edge.
    first: [isize; 2],
    /// Column and row in cells = scale · (x/z, y/z) + offset; the middle of cell i is at i + ½.
    scale: [f32; 2],
    offset: [f32; 2],
    pixels: u32,
    sum: Vec3,
    /// Columns and rows, in cells, between which the silhouette is the object's own: beyond them the image's edge may cut it off.
    own: [[f32; 2]; 2],
    at_edge: bool,
    intact: bool,
}

impl Default for Cloud {
    #[allow(clippy::large_stack_arrays)] // Where it is made, not where it is used.
    fn default() -> Self {
        Self {
            cells: [Cell::default(); CELLS],
            outline: Vec::new(),
            columns: 0,
            rows: 0,
            stride: 1,
            first: [0; 2],
            scale: [1.0; 2],
            offset: [0.0; 2],
            pixels: 0,
            sum: Vec3::zeros(),
            own: [[0.0; 2]; 2],
            at_edge: false,
            intact: false,
        }
    }
}

impl Cloud {
    /// Makes it the empty cloud of an object that is seen in `area` of `camera`'s image.
    pub fn clear(&mut self, camera: &Camera, area: &Area) {
        let inside = EDGE - 2 * MARGIN;
        let [width, height] = [area.columns.len(), area.rows.len()];
        let extent = width.max(height);
        self.stride = extent.div_ceil(inside).max((extent / ENOUGH).clamp(1, 2));
        (self.columns, self.rows) = (width.div_ceil(self.stride) + 2 * MARGIN, height.div_ceil(self.stride) + 2 * MARGIN);
        let margin = (MARGIN * self.stride) as isize;
        self.first = [area.columns.start as isize - margin, area.rows.start as isize - margin];
        let stride = self.stride as f64;
        self.scale = [camera.fx, camera.fy].map(|focal| (focal / stride) as f32);
        let offset = |middle: f64, first: isize| ((middle + 0.5 - first as f64) / stride) as f32;
        self.offset = [offset(camera.cx, self.first[0]), offset(camera.cy, self.first[1])];
        self.cells.iter_mut().take(self.rows * EDGE).for_each(|cell| *cell = Cell::default());
        (self.pixels, self.sum, self.intact) = (0, Vec3::zeros(), false);
        // A cell's cover is a mean with its neighbours', and read between two.
        let own = |first: isize, end: usize| [-first as f64, end as f64 - first as f64].map(|edge| (edge / stride) as f32);
        let [across, down] = [own(self.first[0], camera.width), own(self.first[1], camera.height)];
        self.own = [[across[0] + REACH, across[1] - REACH], [down[0] + REACH, down[1] - REACH]];
        let Area { rows, columns } = area;
        self.at_edge = rows.start == 0 || columns.start == 0 || rows.end >= camera.height || columns.end >= camera.width;
        self.outline.clear();
    }

    /// Takes in pixels side by side in `row`, from column `start` on: their depths, m. Those outside its area are passed over.
    pub fn add(&mut self, row: usize, start: usize, depths: impl Iterator<Item = f64>) {
        let [first_column, first_row] = self.first;
        let Ok(down) = usize::try_from(row as isize - first_row) else { return };
        let Ok(across) = usize::try_from(start as isize - first_column) else { return };
        let line = down / self.stride;
        let (mut column, mut within) = (across / self.stride, across % self.stride);
        let stride = self.stride as f32;
        let y = ((down as f32 + 0.5) / stride - self.offset[1]) / self.scale[1];
        let (mut x, pitch) = (((across as f32 + 0.5) / stride - self.offset[0]) / self.scale[0], 1.0 / (stride * self.scale[0]));
        let cells = self.cells.get_mut(line * EDGE..(line + 1) * EDGE).unwrap_or_default();
        let mut sum = [0.0; 3];
        for z in depths {
            let Some(cell) = cells.get_mut(column) else { break };
            let z = z as f32;
            let point = [x * z, y * z, z];
            for i in 0..3 {
                cell.point[i] += point[i];
                sum[i] += point[i];
            }
            cell.cover += 1.0;
            self.pixels += 1;
            x += pitch;
            within += 1;
            if within == self.stride {
                (column, within) = (column + 1, 0);
            }
        }
        self.sum += Vec3::from(sum.map(f64::from));
    }

    /// Takes means, normals and the silhouette from what was added. `intact`: no samples are missing, so that where the object ends in the image
    /// it ends.
    #[allow(clippy::large_stack_arrays)] // 26 KB while it runs.
    pub fn finish(&mut self, intact: bool) {
        let mut covers = [0.0; CELLS];
        let area = (self.stride * self.stride) as f32;
        for (cell, cover) in self.cells.iter_mut().zip(&mut covers).take(self.rows * EDGE) {
            let pixels = core::mem::take(&mut cell.cover);
            *cover = pixels / area;
            (cell.point, cell.views) = if pixels > 0.0 { (cell.point.map(|sum| sum / pixels), 1.0) } else { ([0.0; 3], 0.0) };
        }
        self.take_surface();
        self.blur(&covers);
        self.intact = intact;
        if intact {
            self.take_outline();
        }
    }

    /// Takes normals and depths of the surface from the cells' points.
    #[allow(clippy::large_stack_arrays)] // 160 KB while it runs.
    pub(super) fn take_surface(&mut self) {
        let mut rays = [[0.0; PADDED]; 3];
        for (i, cell) in self.cells.iter_mut().take(self.rows * EDGE).enumerate() {
            let inverse = if cell.is_seen() { 1.0 / cell.point[2] } else { 0.0 };
            let ray = [cell.point[0] * inverse, cell.point[1] * inverse, inverse];
            (cell.normal, cell.inverse) = ([0.0; 3], 0.0);
            rays.iter_mut().zip(ray).for_each(|(parts, part)| parts[PAD + i] = part);
        }
        let mut asides = [[0.0; 3]; CELLS];
        let reach = (NORMAL_PX.div_ceil(self.stride) / 2).max(1);
        widest(
            #[inline(always)]
            || self.take_normals(&rays, &mut asides, reach),
        );
        self.bend_rim(&mut asides, reach);
    }

    /// Normals of planes through the cells around each, by least squares.
    #[inline(always)]
    fn take_normals(&mut self, rays: &Rays, asides: &mut Asides, reach: usize) {
        let steepest = STEEPEST.0 * self.pitch()[0] * reach as f32;
        let lanes = |i: usize| rays.each_ref().map(|parts| parts.get(i..).and_then(<[f32]>::first_chunk).copied().unwrap_or([0.0; LANES]));
        for row in 0..self.rows {
            for column in (0..self.columns).step_by(LANES) {
                let first = row * EDGE + column;
                let [x, y, w] = lanes(PAD + first);
                if w.iter().all(|w| *w <= 0.0) {
                    continue;
                }
                // A difference of depth as one of 1/z.
                let most = w.map(|w| (steepest + STEEPEST.1 * w) * w);
                let mut sums = [[0.0; LANES]; 9];
                for down in 0..=2 * reach {
                    for across in 0..=2 * reach {
                        let around = lanes(PAD + first + down * EDGE + across - reach * (EDGE + 1));
                        for i in 0..LANES {
                            let (dx, dy, dw) = (around[0][i] - x[i], around[1][i] - y[i], around[2][i] - w[i]);
                            let counts = if around[2][i] > 0.0 && dw.abs() < most[i] { 1.0 } else { 0.0 };
                            let (dx, dy, dw) = (counts * dx, counts * dy, counts * dw);
                            let terms = [counts, dx, dy, dw, dx * dx, dx * dy, dy * dy, dx * dw, dy * dw];
                            sums.iter_mut().zip(terms).for_each(|(sum, term)| sum[i] += term);
                        }
                    }
                }
                for i in (0..LANES).filter(|i| w[*i] > 0.0) {
                    asides[first + i] = self.take_normal(first + i, reach, sums.each_ref().map(|sum| sum[i]));
                }
            }
        }
    }

    /// The plane of a cell, from sums over those around it: how many, their differences to it, and these' products. How far they lie aside.
    #[inline(always)]
    fn take_normal(&mut self, i: usize, reach: usize, [n, dx, dy, dw, dxx, dxy, dyy, dxw, dyw]: [f32; 9]) -> [f32; 3] {
        if n < 6.0 {
            return [0.0; 3];
        }
        let [mx, my, mw] = [dx / n, dy / n, dw / n];
        let (xx, xy, yy) = (dxx - n * mx * mx, dxy - n * mx * my, dyy - n * my * my);
        let (xw, yw) = (dxw - n * mx * mw, dyw - n * my * mw);
        let determinant = xx * yy - xy * xy;
        // Neighbours along one line tell nothing across it.
        if determinant < 0.05 * xx * yy || determinant <= 0.0 {
            return [0.0; 3];
        }
        let (along, down) = ((xw * yy - yw * xy) / determinant, (yw * xx - xw * xy) / determinant);
        // What is bent lies on one side of its neighbours' plane, by r (r + 1) / 6 of its second derivatives, and linear interpolation on the
        // other side of it: by 1/12 of them, on average between two cells.
        let bent = 0.5 / (reach * (reach + 1)) as f32 * (mw - along * mx - down * my);
        self.face(i, [along, down], bent);
        if n < ((2 * reach + 1) * (2 * reach + 1)) as f32 { [mx, my, mw] } else { [0.0; 3] }
    }

    /// Lays a plane through a cell's point, by how 1/z changes with x/z and y/z, which is less by `bent` than that point tells.
    #[inline(always)]
    fn face(&mut self, i: usize, [along, down]: [f32; 2], bent: f32) {
        let cell = &mut self.cells[i];
        let w = 1.0 / cell.point[2];
        let [x, y] = [cell.point[0] * w, cell.point[1] * w];
        // 1/z = m · (x/z, y/z, 1) is m · p = 1.
        let away = [along, down, w - along * x - down * y];
        let length = sqrtf(dot(&away, &away));
        cell.normal = away.map(|part| -part / length);
        // A cell that is filled in part has its point aside of its middle.
        let middle = |k: usize, place: usize| (place as f32 + 0.5 - self.offset[k]) / self.scale[k];
        cell.inverse = w + along * (middle(0, i % EDGE) - x) + down * (middle(1, i / EDGE) - y) - bent;
    }

    /// Turns the normals of cells at the rim. The plane of cells that lie to one side faces as the surface does in their midst, and from there on
    /// the surface bends as it did up to there.
    fn bend_rim(&mut self, asides: &mut Asides, reach: usize) {
        for row in 0..self.rows {
            for i in row * EDGE..row * EDGE + self.columns {
                let aside = asides[i];
                let inwards = [0, 1].map(|k| aside[k] * self.scale[k]);
                let half = 0.5 * inwards[0].abs().max(inwards[1].abs());
                if half == 0.0 {
                    continue;
                }
                let [across, down] = inwards.map(|part| reach as isize * (isize::from(part > half) - isize::from(part < -half)));
                let Some(inner) = i.checked_add_signed(down * EDGE as isize + across) else { continue };
                let (Some(met), Some(beside)) = (self.cells.get(inner).filter(|met| met.has_normal()), asides.get(inner)) else { continue };
                let cell = &self.cells[i];
                if dot(&cell.normal, &met.normal) < FACING {
                    continue;
                }
                let (here, before) = (midst(cell, &aside), midst(met, beside));
                let further = sqrtf(distance_square(&cell.point, &here) / distance_square(&here, &before)).min(FURTHEST);
                let [a, b] = [cell.normal, met.normal];
                let normal = [0, 1, 2].map(|k| a[k] + further * (a[k] - b[k]));
                let along = dot(&normal, &cell.point);
                if -along > EDGE_ON * sqrtf(dot(&normal, &normal)) * cell.point[2] {
                    self.face(i, [normal[0] / along, normal[1] / along], 0.0);
                    asides[i] = [0.0; 3];
                }
            }
        }
    }

    /// Means over 3 × 3 cells, so that a silhouette fades over as many.
    fn blur(&mut self, covers: &[f32; CELLS]) {
        for row in 1..self.rows - 1 {
            for column in 1..self.columns - 1 {
                let i = row * EDGE + column;
                let line = |i: usize| covers[i - 1] + covers[i] + covers[i + 1];
                self.cells[i].cover = (line(i - EDGE) + line(i) + line(i + EDGE)) / 9.0;
            }
        }
    }

    /// Points of the silhouette: where half is covered, at the depth of the cell there.
    fn take_outline(&mut self) {
        for row in 1..self.rows - 1 {
            for column in 1..self.columns - 1 {
                let i = row * EDGE + column;
                let cell = self.cells[i];
                if !cell.is_seen() || !(0.5..0.95).contains(&cell.cover) {
                    continue;
                }
                let slope = [(i + 1, i - 1), (i + EDGE, i - EDGE)].map(|(a, b)| 0.5 * (self.cells[a].cover - self.cells[b].cover));
                let square = slope[0] * slope[0] + slope[1] * slope[1];
                if square < 0.15 * 0.15 {
                    continue;
                }
                let step = (0.5 - cell.cover) / square;
                let place = [column as f32 + 0.5 + step * slope[0], row as f32 + 0.5 + step * slope[1]];
                let met = self.at(place).filter(|met| met.is_seen()).unwrap_or(&cell);
                let ray = [0, 1].map(|k| (place[k] - self.offset[k]) / self.scale[k]);
                // A round body's rim is farther away than what is seen next to it: in that one's plane.
                let most = STEEPEST.0 * self.pitch()[0] * met.point[2] + STEEPEST.1;
                let along = dot(&met.normal, &met.point) / dot(&met.normal, &[ray[0], ray[1], 1.0]);
                let z = if met.has_normal() && along > 0.0 { along.clamp(met.point[2] - most, met.point[2] + most) } else { met.point[2] };
                if self.is_own(place) && self.outline.push([ray[0] * z, ray[1] * z, z]).is_err() {
                    return;
                }
            }
        }
    }

    /// Its cells, row by row.
    pub fn cells(&self) -> impl Iterator<Item = &Cell> {
        self.cells.chunks_exact(EDGE).take(self.rows).flat_map(|line| line.iter().take(self.columns))
    }

    /// Cells that show a surface, one of `step`; if asked, each standing for as many, but of the `rim` all.
    pub(super) fn samples(&self, step: usize, rim: bool) -> impl Iterator<Item = (&Cell, f32)> {
        let every = if rim { 1 } else { step };
        let lines = self.cells.chunks_exact(EDGE).take(self.rows).enumerate();
        let cells = lines.flat_map(move |(row, line)| {
            let first = (every - row % every) % every;
            line.iter().take(self.columns).enumerate().skip(first).step_by(every).map(move |(column, cell)| (row + column, cell))
        });
        cells.filter(|(_, cell)| cell.is_seen()).filter_map(move |(place, cell)| {
            let stands = if rim && cell.cover >= INSIDE { step } else { 1 };
            (place % step == 0 || rim && cell.cover < INSIDE).then_some((cell, stands as f32))
        })
    }

    /// All its cells, seen or not. After their points were changed, [`Cloud::take_surface`].
    pub(super) fn cells_mut(&mut self) -> impl Iterator<Item = &mut Cell> {
        self.cells.iter_mut().take(self.rows * EDGE)
    }

    /// Points of its silhouette, camera frame, m; none where something cuts it off.
    pub fn outline(&self) -> &[[f32; 3]] {
        &self.outline
    }

    /// Whether nothing cuts it off: no edge of the image, no missing samples.
    pub fn is_whole(&self) -> bool {
        self.intact && !self.at_edge
    }

    #[inline(always)]
    fn is_own(&self, place: [f32; 2]) -> bool {
        self.intact && place.iter().zip(&self.own).all(|(place, [first, end])| place > first && place < end)
    }

    /// Column and row, in cells, of a point before the camera.
    #[inline(always)]
    pub fn project(&self, p: &[f32; 3]) -> [f32; 2] {
        let inverse = 1.0 / p[2];
        [p[0] * inverse * self.scale[0] + self.offset[0], p[1] * inverse * self.scale[1] + self.offset[1]]
    }

    /// The cell at a column and row, in cells.
    #[inline(always)]
    pub fn at(&self, place: [f32; 2]) -> Option<&Cell> {
        let [column, row] = place;
        // NaN is not within either.
        let inside = column >= 0.0 && row >= 0.0 && column < self.columns as f32 && row < self.rows as f32;
        if inside { self.cells.get(row as usize * EDGE + column as usize) } else { None }
    }

    /// 1/z of the surface at a column and row, in cells, 1/m: linear between the middles of four cells, as a plane is. `None` where one of them
    /// shows nothing, or another surface.
    #[inline(always)]
    pub fn inverse_depth(&self, place: [f32; 2]) -> Option<f32> {
        let [column, row] = place.map(|middle| middle - 0.5);
        if !(column >= 0.0 && row >= 0.0 && column < (self.columns - 1) as f32 && row < (self.rows - 1) as f32) {
            return None;
        }
        let i = row as usize * EDGE + column as usize;
        let (x, y) = (column - column as usize as f32, row - row as usize as f32);
        let [a, b, c, d] = [i, i + 1, i + EDGE, i + EDGE + 1].map(|i| self.cells.get(i).map_or(0.0, |cell| cell.inverse));
        let (least, most) = (a.min(b).min(c.min(d)), a.max(b).max(c.max(d)));
        if least <= 0.0 || (most - least) > (STEEPEST.0 * self.pitch()[0] + STEEPEST.1 * least) * least {
            return None;
        }
        let (top, bottom) = (a + (b - a) * x, c + (d - c) * x);
        Some(top + (bottom - top) * y)
    }

    /// How much is covered at a column and row, in cells, and how that changes with either; `None` where something else may cut it off.
    #[inline(always)]
    pub fn cover(&self, place: [f32; 2]) -> Option<(f32, [f32; 2])> {
        if !self.is_own(place) {
            return None;
        }
        let [column, row] = place.map(|middle| middle - 0.5);
        if !(column >= 0.0 && row >= 0.0 && column < (self.columns - 1) as f32 && row < (self.rows - 1) as f32) {
            return None;
        }
        let i = row as usize * EDGE + column as usize;
        let (x, y) = (column - column as usize as f32, row - row as usize as f32);
        let [a, b, c, d] = [i, i + 1, i + EDGE, i + EDGE + 1].map(|i| self.cells.get(i).map_or(0.0, |cell| cell.cover));
        let (top, bottom) = (a + (b - a) * x, c + (d - c) * x);
        Some((top + (bottom - top) * y, [(b - a) * (1.0 - y) + (d - c) * y, bottom - top]))
    }

    /// Pixels.
    pub fn pixels(&self) -> u32 {
        self.pixels
    }

    /// Columns and rows of pixels a cell.
    pub fn stride(&self) -> usize {
        self.stride
    }

    /// Length of a cell across the ray at a depth of 1 m, m.
    pub fn pitch(&self) -> [f32; 2] {
        self.scale.map(|scale| 1.0 / scale)
    }

    /// Mean of its points, camera frame, m.
    pub fn mean(&self) -> Vec3 {
        self.sum / f64::from(self.pixels.max(1))
    }

    /// Radius of the ball that would fill as many pixels, m: two thirds of it behind the mean of its points.
    pub fn radius(&self) -> f64 {
        let [x, y] = self.pitch().map(|pitch| f64::from(pitch) / self.stride as f64);
        let at_1_m = sqrt(f64::from(self.pixels) * x * y / core::f64::consts::PI);
        at_1_m * self.mean().z / (1.0 - 2.0 / 3.0 * at_1_m).max(0.1)
    }

    /// Makes it a copy of `other`, in place.
    pub fn copy_from(&mut self, other: &Self) {
        let Self { cells, outline, columns, rows, stride, first, scale, offset, pixels, sum, own, at_edge, intact } = self;
        cells.copy_from_slice(&other.cells);
        outline.clone_from(&other.outline);
        (*columns, *rows, *stride, *first) = (other.columns, other.rows, other.stride, other.first);
        (*scale, *offset, *pixels, *sum) = (other.scale, other.offset, other.pixels, other.sum);
        (*own, *at_edge, *intact) = (other.own, other.at_edge, other.intact);
    }
}
