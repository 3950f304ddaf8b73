//! Planes in a grid of inverse depths: they grow from flat blocks of cells.
//!
//! As in [`super::structure`] they are looked for where noise is even, in inverse depth: 1/z = w · ray. There random tries find the few largest
//! planes in one frame, before the camera has moved on; here it stands still, and the small ones that a ball may touch count as well: they grow
//! one after the other over many frames.

use super::structure::{GATE, noise};
use crate::geometry::camera::Camera;
use crate::geometry::environment::{Cell, Plane, Relief};
use crate::math::{Mat3, Vec3};

/// Columns and rows of the blocks from which planes grow: first the large ones, then what is left.
const BLOCKS: [usize; 2] = [12, 4];
/// Blocks that may grow in one frame.
const A_FRAME: u32 = 6;
/// Each time that a plane grows, every so manyth cell counts.
const GROWTHS: [usize; 5] = [3, 3, 3, 3, 1];
/// A plane is seen by this part of all cells, at least.
const SMALLEST: f64 = 0.008;
/// While planes are looked for, cells that none has claimed hold the inverse depth in their middle, in this unit, 1/m.
const UNIT: f64 = 1.0 / 16384.0;

/// A cell with this inverse depth (1/m) in its middle.
pub(super) fn unclaimed(q: f64) -> Cell {
    Cell::Thing((q / UNIT) as u16)
}

/// Sums for the least squares of a plane.
#[derive(Clone, Copy, Default)]
pub(super) struct Sums {
    normal: Mat3,
    right: Vec3,
    squares: f64,
    count: f64,
}

impl Sums {
    /// Takes in the inverse depth `q` (1/m) along a ray.
    pub fn add(&mut self, ray: &Vec3, q: f64) {
        self.normal += ray * ray.transpose();
        self.right += ray * q;
        self.squares += q * q;
        self.count += 1.0;
    }

    /// The plane, where so many readings are worth one; `None` where they tell of none.
    pub fn plane(&self, correlated: f64) -> Option<Plane> {
        let inverse = self.normal.try_inverse().filter(|_| self.count > 3.0)?;
        let w = inverse * self.right;
        let variance = (self.squares - w.dot(&self.right)).max(0.0) / (self.count - 3.0);
        Some(Plane { w, covariance: inverse * (variance * correlated) })
    }
}

/// Looks for planes from this block on for one frame; returns the block to go on with, if any is left.
pub(super) fn find(relief: &mut Relief, camera: &Camera, mut block: usize) -> Option<usize> {
    let mut grown = 0;
    while grown < A_FRAME {
        let (first, size) = place(relief, block).filter(|_| relief.planes().len() < Relief::PLANES)?;
        block += 1;
        let view = View::new(relief, camera);
        let Some(mut plane) = view.seed(first, size) else { continue };
        grown += 1;
        // Some of the cells tell where it goes, all of them where it is.
        for stride in GROWTHS {
            plane = view.fit(&plane, cells(relief).step_by(stride)).map_or(plane, |(plane, _)| plane);
        }
        // What only meets a plane does so along a line.
        let fits = |(column, row): &(usize, usize)| view.fits(&plane, *column, *row);
        let broad =
            cells(relief).filter(|(column, row)| [(*column, *row), (column + 1, *row), (*column, row + 1)].iter().all(fits)).count();
        if broad as f64 > SMALLEST * cells(relief).count() as f64 {
            let number = relief.planes().len() as u8;
            for (column, row) in cells(relief) {
                if View::new(relief, camera).fits(&plane, column, row) {
                    relief.show(column, row, Cell::Plane(number));
                }
            }
            // There is room: the line at the top saw to it.
            let _ = relief.planes_mut().push(plane);
        }
    }
    Some(block)
}

/// Columns and rows of all cells.
pub(super) fn cells(relief: &Relief) -> impl Iterator<Item = (usize, usize)> + use<> {
    let (columns, rows) = (relief.columns(), relief.rows());
    (0..rows).flat_map(move |row| (0..columns).map(move |column| (column, row)))
}

/// Column and row (px) in the middle of a cell.
pub(super) fn middle(relief: &Relief, column: usize, row: usize) -> (usize, usize) {
    let edge = relief.edge();
    (column * edge + edge / 2, row * edge + edge / 2)
}

/// First cell and size of a block: they overlap by half.
fn place(relief: &Relief, mut block: usize) -> Option<((usize, usize), usize)> {
    for size in BLOCKS {
        let [across, down] = [relief.columns(), relief.rows()].map(|cells| (2 * cells / size).saturating_sub(1));
        if block < across * down {
            return Some(((block % across * (size / 2), block / across * (size / 2)), size));
        }
        block -= across * down;
    }
    None
}

/// Cells while planes are looked for.
struct View<'a> {
    relief: &'a Relief,
    /// Ray of the first cell, and from one to the next.
    first: Vec3,
    step: [f64; 2],
}

impl<'a> View<'a> {
    fn new(relief: &'a Relief, camera: &Camera) -> Self {
        let (edge, (x, y)) = (relief.edge() as f64, middle(relief, 0, 0));
        Self { relief, first: camera.deproject(x as f64, y as f64, 1.0), step: [edge / camera.fx, edge / camera.fy] }
    }

    /// Ray and inverse depth of a cell that no plane has taken yet.
    fn reading(&self, column: usize, row: usize) -> Option<(Vec3, f64)> {
        let Some(Cell::Thing(q)) = self.relief.cell(column, row) else { return None };
        let ray = self.first + Vec3::new(column as f64 * self.step[0], row as f64 * self.step[1], 0.0);
        Some((ray, f64::from(q) * UNIT))
    }

    fn fits(&self, plane: &Plane, column: usize, row: usize) -> bool {
        self.reading(column, row).is_some_and(|(ray, q)| (q - plane.w.dot(&ray)).abs() < GATE * noise(q))
    }

    /// The plane through those of `cells` that fit `plane`, and how many they are.
    fn fit(&self, plane: &Plane, cells: impl Iterator<Item = (usize, usize)>) -> Option<(Plane, f64)> {
        let mut sums = Sums::default();
        let readings = cells.filter_map(|(column, row)| self.reading(column, row));
        readings.filter(|(ray, q)| (q - plane.w.dot(ray)).abs() < GATE * noise(*q)).for_each(|(ray, q)| sums.add(&ray, q));
        Some((sums.plane(1.0)?, sums.count))
    }

    /// The plane of a block that is flat.
    fn seed(&self, (column, row): (usize, usize), size: usize) -> Option<Plane> {
        let block = || (row..row + size).flat_map(|row| (column..column + size).map(move |column| (column, row)));
        let least = (size * size * 7 / 8) as f64;
        let mut sums = Sums::default();
        block().filter_map(|(column, row)| self.reading(column, row)).for_each(|(ray, q)| sums.add(&ray, q));
        let plane = sums.plane(1.0).filter(|_| sums.count >= least)?;
        self.fit(&plane, block()).filter(|(_, count)| *count >= least).map(|(plane, _)| plane)
    }
}
