//! What a camera that stands still sees behind all objects: planes as far as they are seen, other things, and where it sees nothing.

use crate::geometry::camera::{Camera, Pose};
use crate::math::{Mat3, Vec3, floor, sqrt};
use heapless::Vec;

/// Columns and rows of cells at the most.
const MOST: [usize; 2] = [80, 60];
/// What is farther behind a plane than this has nothing to do with it, m: that may be a table's top.
const BEHIND: f64 = 0.1;

/// What a cell of the image, a square of pixels, shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cell {
    /// Nothing: there is no reading.
    Nothing,
    /// The plane of this number.
    Plane(u8),
    /// Something else, at this depth or behind it, mm.
    Thing(u16),
}

/// A plane, camera frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plane {
    /// w · p = 1 for its points p: its unit normal, away from the camera, over its distance from there, 1/m.
    pub w: Vec3,
    /// Of w, 1/m².
    pub covariance: Mat3,
}

/// What the space around an object shows of what it may touch.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Space {
    /// The camera sees that it is empty, or holds nothing but planes.
    Free,
    /// It does not see all of it.
    Unseen,
    /// Something that is no plane is there, or before it.
    Thing,
}

/// Planes and other things as a camera sees them.
#[derive(Clone, Debug, PartialEq)]
pub struct Relief {
    camera: Camera,
    pose: Pose,
    /// Columns and rows of pixels a cell.
    edge: usize,
    columns: usize,
    rows: usize,
    cells: Vec<Cell, { MOST[0] * MOST[1] }>,
    planes: Vec<Plane, { Relief::PLANES }>,
}

impl Relief {
    /// Planes at the most.
    pub const PLANES: usize = 12;

    /// Of a camera that has seen nothing yet.
    pub fn new(camera: &Camera) -> Self {
        let edge = camera.width.div_ceil(MOST[0]).max(camera.height.div_ceil(MOST[1])).max(1);
        let (columns, rows) = (camera.width / edge, camera.height / edge);
        let cells = (0..columns * rows).map(|_| Cell::Nothing).collect();
        Self { camera: *camera, pose: camera.world(), edge, columns, rows, cells, planes: Vec::new() }
    }

    /// Columns and rows of pixels a cell.
    pub fn edge(&self) -> usize {
        self.edge
    }

    /// Columns of cells.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// Rows of cells.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// The planes by their numbers.
    pub fn planes(&self) -> &[Plane] {
        &self.planes
    }

    /// The planes by their numbers, to be learned.
    pub fn planes_mut(&mut self) -> &mut Vec<Plane, { Relief::PLANES }> {
        &mut self.planes
    }

    /// The cell in a column and row of cells.
    pub fn cell(&self, column: usize, row: usize) -> Option<Cell> {
        self.cells.get(row * self.columns + column).copied().filter(|_| column < self.columns)
    }

    /// Learns what the cell in a column and row of cells shows.
    pub fn show(&mut self, column: usize, row: usize, shown: Cell) {
        if let Some(cell) = self.cells.get_mut(row * self.columns + column) {
            *cell = shown;
        }
    }

    /// A plane of this number in the world: unit normal, towards the camera, and normal · p there, m.
    pub fn plane(&self, number: usize) -> Option<(Vec3, f64)> {
        let plane = self.planes.get(number)?;
        let (normal, distance) = plane.facing();
        let normal = self.pose.rotation * normal;
        Some((normal, normal.dot(&self.pose.translation) - distance))
    }

    /// How well it is known where a plane of this number is at the point `p` of it (world, m): standard deviation, m.
    pub fn sd(&self, number: usize, p: &Vec3) -> f64 {
        let p = self.pose.to_camera(p);
        self.planes.get(number).map_or(f64::INFINITY, |plane| sqrt(p.dot(&(plane.covariance * p))) / plane.w.norm())
    }

    /// The planes near which `p` (world, m) is, where they are seen: number, distance (m, negative behind), and the unit normal towards the camera.
    pub fn near<'a>(&'a self, p: &Vec3) -> impl Iterator<Item = (usize, f64, Vec3)> + 'a {
        let p = self.pose.to_camera(p);
        self.planes.iter().enumerate().filter_map(move |(number, plane)| {
            let (normal, distance) = plane.above(&p);
            (distance > -BEHIND && self.is_seen(number, &(p - normal * distance))).then(|| (number, distance, self.pose.rotation * normal))
        })
    }

    /// Fraction of the `way` at which a ball of `radius` (m) that starts `from` there (world, m) first touches each plane, where that is seen, and the
    /// unit normal.
    pub fn sweep<'a>(&'a self, from: &Vec3, way: &Vec3, radius: f64) -> impl Iterator<Item = (usize, f64, Vec3)> + 'a {
        let (from, way) = (self.pose.to_camera(from), self.pose.rotation.transpose() * way);
        self.planes.iter().enumerate().filter_map(move |(number, plane)| {
            let (normal, distance) = plane.above(&from);
            let closing = -normal.dot(&way);
            if closing <= 0.0 || distance < -BEHIND {
                return None;
            }
            let fraction = ((distance - radius) / closing).max(0.0);
            let there = from + way * fraction;
            let touched = there - normal * plane.above(&there).1;
            (fraction <= 1.0 && self.is_seen(number, &touched)).then(|| (number, fraction, self.pose.rotation * normal))
        })
    }

    /// What the space within `reach` (m) of `p` (world, m) shows: a sphere that is projected into the image.
    pub fn space(&self, p: &Vec3, reach: f64) -> Space {
        let p = self.pose.to_camera(p);
        let Some((x, y)) = self.camera.project(&p).filter(|pixel| self.cell_of(*pixel).is_some()) else { return Space::Unseen };
        let span = |middle: f64, focal: f64, end: usize| {
            let [first, last] = [-1.0, 1.0].map(|side| floor((middle + 0.5 + side * reach * focal / p.z) / self.edge as f64));
            first.max(0.0) as usize..(last.max(0.0) as usize + 1).min(end)
        };
        let columns = span(x, self.camera.fx, self.columns);
        let mut space = Space::Free;
        for (column, row) in span(y, self.camera.fy, self.rows).flat_map(|row| columns.clone().map(move |column| (column, row))) {
            match self.cell(column, row) {
                Some(Cell::Thing(nearest)) if f64::from(nearest) * 1e-3 < p.z + reach => return Space::Thing,
                Some(Cell::Thing(_)) => {}
                Some(Cell::Plane(number)) => {
                    let middle = |cell: usize| (cell as f64 + 0.5) * self.edge as f64 - 0.5;
                    let ray = self.camera.deproject(middle(column), middle(row), p.z - reach);
                    let hidden = self.planes.get(usize::from(number)).is_some_and(|plane| plane.w.dot(&ray) > 1.0);
                    space = if hidden { Space::Unseen } else { space };
                }
                Some(Cell::Nothing) | None => space = Space::Unseen,
            }
        }
        space
    }

    /// Whether the plane of a number is seen at a point (camera frame, m).
    fn is_seen(&self, number: usize, p: &Vec3) -> bool {
        self.camera.project(p).and_then(|pixel| self.cell_of(pixel)) == Some(Cell::Plane(number as u8))
    }

    /// The cell of a pixel.
    fn cell_of(&self, (x, y): (f64, f64)) -> Option<Cell> {
        let place = |x: f64| (x > -0.5).then(|| (x + 0.5) as usize / self.edge);
        self.cell(place(x)?, place(y)?)
    }
}

impl Plane {
    /// Unit normal, towards the camera, and the camera's distance, m.
    fn facing(&self) -> (Vec3, f64) {
        let distance = 1.0 / self.w.norm();
        (self.w * -distance, distance)
    }

    /// The normal, and the distance of `p` (camera frame, m), negative behind.
    fn above(&self, p: &Vec3) -> (Vec3, f64) {
        let (normal, distance) = self.facing();
        (normal, normal.dot(p) + distance)
    }
}
