//! What an object can touch of a learned background, surveyed over some frames: planes, and what else stands there.

use super::Seeing;
use super::image::Source;
use super::planes::{Sums, cells, find, middle, unclaimed};
use super::structure::{GATE, noise};
use crate::detect::foreground::{NO_KEY, Sample};
use crate::detect::noise::Noise;
use crate::geometry::camera::Camera;
use crate::geometry::environment::{Cell, Relief};
use crate::math::Vec3;

/// So many of a cell's eight neighbours show its plane, or it is something else that happens to meet the plane; where a cell shows nothing, so many
/// make it a part of theirs.
const NEIGHBOURS: (usize, usize) = (3, 5);
/// Pixels of a cell, of those that are looked at, that stand before its plane where something else does.
const BEFORE: u32 = 3;
/// Pixels that are looked at: every so manyth column and row.
const STRIDE: usize = 2;

/// How far the survey is.
#[allow(clippy::large_enum_variant)] // No heap to put the larger ones on.
pub(super) enum Survey {
    /// The background is not learned yet.
    Awaited,
    /// Planes are looked for, from this block on.
    Begun(Relief, usize),
    /// All of it is there.
    Done(Relief),
    /// It was handed out, or there is none.
    Over,
}

impl Seeing<'_> {
    /// Hands out the survey of the background, once.
    pub fn surveyed(&mut self) -> Option<Relief> {
        if !matches!(self.survey, Survey::Done(_)) {
            return None;
        }
        match core::mem::replace(&mut self.survey, Survey::Over) {
            Survey::Done(relief) => Some(relief),
            Survey::Awaited | Survey::Begun(..) | Survey::Over => None,
        }
    }

    /// Does one frame's part of the survey.
    pub(super) fn survey<S: Sample>(&mut self, source: &mut impl Source<S>) {
        if matches!(self.survey, Survey::Done(_) | Survey::Over) {
            return;
        }
        let Survey::Begun(mut relief, block) = core::mem::replace(&mut self.survey, Survey::Over) else {
            let mut relief = Relief::new(&self.camera);
            self.sound(source, &mut relief, |relief, (column, row), _, q| relief.show(column, row, unclaimed(q)));
            let shows_nothing = cells(&relief).all(|(column, row)| relief.cell(column, row) == Some(Cell::Nothing));
            self.survey = if shows_nothing { Survey::Done(relief) } else { Survey::Begun(relief, 0) };
            return;
        };
        self.survey = if let Some(next) = find(&mut relief, &self.camera, block) {
            Survey::Begun(relief, next)
        } else {
            self.complete(source, &mut relief);
            Survey::Done(relief)
        };
    }

    /// Calls `look` with the column and row of each cell in whose middle the background is known, its ray, and its inverse depth, 1/m.
    fn sound<S: Sample>(
        &self,
        source: &mut impl Source<S>,
        relief: &mut Relief,
        mut look: impl FnMut(&mut Relief, (usize, usize), &Vec3, f64),
    ) {
        let Camera { width, max_depth, .. } = self.camera;
        for row in 0..relief.rows() {
            let y = middle(relief, 0, row).1;
            let pixels = y * width..(y + 1) * width;
            let (Some(limits), Some(shown)) = (self.buffers.limits.get(pixels.clone()), self.buffers.farthest.get(pixels)) else { return };
            let now = source.glance(y, 0..width);
            for column in 0..relief.columns() {
                let x = middle(relief, column, row).0;
                let (Some(limit), Some(shown), Some(now)) = (limits.get(x), shown.get(x), now.get(x)) else { continue };
                // What was learned is one of the farthest readings; this frame's errs to either side.
                let now = (now.key(&self.coding) >= *limit).then(|| now.depth(&self.coding, &self.buffers.depths));
                let now = now.filter(|z| *z > 0.0 && *z <= max_depth);
                if let Some(z) = now.or_else(|| Some(S::depth_at(*shown, &self.coding, &self.buffers.depths)).filter(|z| *z > 0.0)) {
                    look(relief, (column, row), &self.camera.deproject(x as f64, y as f64, 1.0), 1.0 / z);
                }
            }
        }
    }

    /// Puts in what there is beside planes, and measures these where they are seen by themselves.
    fn complete<S: Sample>(&self, source: &mut impl Source<S>, relief: &mut Relief) {
        cells(relief).for_each(|(column, row)| relief.show(column, row, Cell::Nothing));
        // Where planes meet, the first that was found took too much.
        self.sound(source, relief, |relief, (column, row), ray, q| {
            let off = relief.planes().iter().map(|plane| (q - plane.w.dot(ray)).abs()).enumerate().min_by(|a, b| a.1.total_cmp(&b.1));
            let plane = off.filter(|(_, off)| *off < GATE * noise(q)).map(|(number, _)| Cell::Plane(number as u8));
            relief.show(column, row, plane.unwrap_or(Cell::Thing(0)));
        });
        cells(relief).for_each(|(column, row)| self.look_closely::<S>(relief, column, row));
        for (column, row) in cells(relief) {
            let around = |number: u8| neighbours(relief, (column, row), number);
            match relief.cell(column, row) {
                Some(Cell::Plane(number)) if around(number) < NEIGHBOURS.0 => {
                    relief.show(column, row, self.nearest::<S>(relief, column, row));
                }
                Some(Cell::Nothing) => {
                    if let Some(number) = (0..relief.planes().len() as u8).find(|number| around(*number) >= NEIGHBOURS.1) {
                        relief.show(column, row, Cell::Plane(number));
                    }
                }
                _ => {}
            }
        }
        let mut sums = [Sums::default(); Relief::PLANES];
        self.sound(source, relief, |relief, place, ray, q| {
            let Some(Cell::Plane(number)) = relief.cell(place.0, place.1) else { return };
            let near = relief.planes().get(usize::from(number)).is_some_and(|plane| (q - plane.w.dot(ray)).abs() < GATE * noise(q));
            if let Some(sums) = sums.get_mut(usize::from(number)).filter(|_| near && neighbours(relief, place, number) == 8) {
                sums.add(ray, q);
            }
        });
        // Readings share the noise of their matching windows.
        let correlated = Noise::default().window.iter().map(|window| (*window as f64 / relief.edge() as f64).max(1.0)).product();
        for (plane, sums) in relief.planes_mut().iter_mut().zip(sums) {
            *plane = sums.plane(correlated).unwrap_or(*plane);
        }
    }

    /// Whether a cell shows nothing, or something before its plane.
    fn look_closely<S: Sample>(&self, relief: &mut Relief, column: usize, row: usize) {
        let Some(shown) = relief.cell(column, row) else { return };
        let plane = if let Cell::Plane(number) = shown { relief.planes().get(usize::from(number)) } else { None };
        // Beyond this inverse depth something stands before the plane, at the cell's first pixel; from pixel to pixel it changes evenly.
        let edge = relief.edge();
        let (left, top) = (column * edge, row * edge);
        let first = plane.map(|plane| {
            let q = plane.w.dot(&self.camera.deproject(left as f64, top as f64, 1.0));
            (q + GATE * noise(q), plane.w.x / self.camera.fx, plane.w.y / self.camera.fy)
        });
        let (mut pixels, mut readings, mut before) = (0, 0, 0);
        self.pixels(relief, column, row, |x, y, index| {
            pixels += 1;
            let z = self.buffers.farthest.get(index).map_or(0.0, |key| S::depth_at(*key, &self.coding, &self.buffers.depths));
            readings += u32::from(z > 0.0);
            if let Some((q, right, down)) = first {
                let edge = z * (q + right * (x - left) as f64 + down * (y - top) as f64);
                before += u32::from(z > 0.0 && edge < 1.0);
            }
        });
        let plane = plane.is_some();
        if 2 * readings < pixels {
            relief.show(column, row, Cell::Nothing);
        } else if !plane || before >= BEFORE {
            relief.show(column, row, self.nearest::<S>(relief, column, row));
        }
    }

    /// The nearest thing that the background may be in a cell.
    fn nearest<S: Sample>(&self, relief: &Relief, column: usize, row: usize) -> Cell {
        let mut nearest = NO_KEY;
        self.pixels(relief, column, row, |_, _, index| nearest = nearest.min(self.buffers.limits.get(index).copied().unwrap_or(nearest)));
        S::depth_of_key(nearest, &self.coding).map_or(Cell::Nothing, |z| Cell::Thing((z * 1e3) as u16))
    }

    /// Calls `look` with column, row and index of a cell's pixels, [`STRIDE`] apart.
    fn pixels(&self, relief: &Relief, column: usize, row: usize, mut look: impl FnMut(usize, usize, usize)) {
        let edge = relief.edge();
        for y in (row * edge..(row + 1) * edge).step_by(STRIDE) {
            (column * edge..(column + 1) * edge).step_by(STRIDE).for_each(|x| look(x, y, y * self.camera.width + x));
        }
    }
}

/// How many of a cell's eight neighbours show the plane of a number.
fn neighbours(relief: &Relief, (column, row): (usize, usize), number: u8) -> usize {
    let around = (row.saturating_sub(1)..=row + 1).flat_map(|row| (column.saturating_sub(1)..=column + 1).map(move |column| (column, row)));
    around.filter(|place| *place != (column, row) && relief.cell(place.0, place.1) == Some(Cell::Plane(number))).count()
}
