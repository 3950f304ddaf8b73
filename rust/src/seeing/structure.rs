//! Static planes that a camera of fixed orientation sees, and how far it has moved along their normals since the first frame.
//!
//! Along a plane inverse depth is linear in the pixel's ray, 1/z = w · ray with w = n/h, and its noise is even. A camera that moves without turning
//! changes h alone: w keeps its direction, and one number is left to be found in each frame.

use super::Seeing;
use super::image::Source;
use super::planes::Sums;
use crate::detect::background;
use crate::detect::foreground::{Sample, first_key_beyond};
use crate::detect::noise::Noise;
use crate::geometry::camera::{Camera, Pose};
use crate::geometry::environment::Plane;
use crate::math::{Mat3, Vec3, sqrt};
use heapless::Vec;

/// Planes at the most: three tie the camera down.
const PLANES: usize = 3;
/// Columns and rows that are looked at for planes: every so manyth, px; and to measure them.
const SPARSE: usize = 8;
const DENSE: usize = 4;
/// A plane is seen by this part of what is looked at, at least.
const SMALLEST: f64 = 0.04;
/// Tries, each with three pixels, to find a plane.
const TRIES: u32 = 150;
/// Pixels of one try lie apart by this, px.
const APART: (f64, f64) = (16.0, 160.0);
/// What is farther than so many standard deviations from a plane is something else.
pub(super) const GATE: f64 = 3.5;
/// Samples `DENSE` pixels apart of a matching window of 9 are worth as many independent ones as these, less this factor.
const CORRELATED: f64 = 5.0;
/// Planes are looked for in so many first frames.
const FIRST: u32 = 15;
/// No displacement is known better than this, m: a sensor's own warp moves with what it sees.
const WARP: f64 = 2e-4;

/// Of each plane the unit normal (camera axes), how far the camera has moved along it (m), and the standard deviation of that.
pub(super) type Shown = Vec<(Vec3, f64, f64), PLANES>;

/// Inverse depths, from 0 to that of the nearest reading, of which limits are kept.
const LEVELS: usize = 2048;
const NEAREST: f64 = 0.4;

/// The planes that the first frames showed, as those did.
#[derive(Clone, Debug)]
pub struct Structure {
    planes: Vec<Plane, PLANES>,
    frames: u32,
    /// For each level of inverse depth, the first key that is background where a plane is so far.
    limits: [u16; LEVELS],
}

impl Structure {
    fn new() -> Self {
        Self { planes: Vec::new(), frames: 0, limits: [0; LEVELS] }
    }
}

/// The level of inverse depth `q`, 1/m.
fn level(q: f64) -> usize {
    (q * NEAREST * (LEVELS - 1) as f64).clamp(0.0, (LEVELS - 1) as f64) as usize
}

impl Seeing<'_> {
    /// From now on static planes are watched: the camera moves, and does not turn.
    pub fn watch_structure(&mut self) {
        self.structure = Some(Structure::new());
    }

    /// Where the newest frame's static planes show the camera, from a first frame at `pose`: its displacement (world axes, m), and the information of
    /// that (1/m²), none along what no plane tells.
    pub fn structure(&self, pose: &Pose) -> (Vec3, Mat3) {
        let (mut information, mut pull) = (Mat3::zeros(), Vec3::zeros());
        for (normal, displacement, sd) in &self.shown {
            let n = pose.rotation * normal;
            information += n * n.transpose() / (sd * sd);
            pull += n * (displacement / (sd * sd));
        }
        let ridge = 1e-9 * information.trace();
        let held = information + Mat3::from_diagonal_element(ridge.max(f64::MIN_POSITIVE));
        (held.try_inverse().map_or(Vec3::zeros(), |inverse| inverse * pull), information)
    }

    /// Measures the planes in a frame, or looks for them in one of the first.
    pub(super) fn measure_structure<S: Sample>(&mut self, source: &mut impl Source<S>) {
        self.shown.clear();
        let Some(mut structure) = self.structure.take() else { return };
        if structure.frames == 0 {
            let beyond = first_key_beyond::<S>(&self.coding);
            for (i, limit) in structure.limits.iter_mut().enumerate() {
                *limit = beyond;
                let z = (LEVELS - 1) as f64 * NEAREST / (i as f64 + 0.5);
                background::know::<S>(&self.coding, z, limit, &mut 0);
            }
        }
        if structure.planes.is_empty() && structure.frames < FIRST {
            self.find(source, &mut structure);
        }
        structure.frames = structure.frames.saturating_add(1);
        let mut there: Vec<Vec3, PLANES> = Vec::new();
        for plane in &structure.planes {
            if let Some(shown) = self.follow_plane(source, plane) {
                let _ = there.push(shown.0 / (1.0 / plane.w.norm() - shown.1));
                let _ = self.shown.push(shown);
            }
        }
        if !structure.planes.is_empty() {
            self.hide_behind(&there, &structure.limits);
        }
        self.structure = Some(structure);
    }

    /// What lies on the planes `there` (n/h each) or behind them is background in this frame.
    fn hide_behind(&mut self, there: &[Vec3], limits: &[u16; LEVELS]) {
        let Camera { width, height, .. } = self.camera;
        let Some(pixels) = self.buffers.limits.get_mut(..width * height) else { return };
        let (left, right) = (self.camera.deproject(0.0, 0.0, 1.0), self.camera.deproject(1.0, 0.0, 1.0));
        for (row, pixels) in pixels.chunks_exact_mut(width).enumerate() {
            let ray = Vec3::new(left.x, self.camera.deproject(0.0, row as f64, 1.0).y, 1.0);
            let lines: Vec<(f64, f64), PLANES> = there.iter().map(|w| (w.dot(&ray), w.x * (right.x - left.x))).collect();
            for (column, pixel) in pixels.iter_mut().enumerate() {
                let nearest = lines.iter().map(|(first, step)| first + step * column as f64).fold(0.0, f64::max);
                *pixel = limits.get(level(nearest)).copied().unwrap_or(0);
            }
        }
    }

    /// Calls `look` with the ray and the inverse depth of every pixel, `stride` apart.
    fn each<S: Sample>(&self, source: &mut impl Source<S>, stride: usize, mut look: impl FnMut(Vec3, f64)) {
        let Camera { width, height, max_depth, .. } = self.camera;
        for row in (stride / 2..height).step_by(stride) {
            for (column, sample) in source.part(row, 0..width).iter().enumerate().skip(stride / 2).step_by(stride) {
                let z = sample.depth(&self.coding, &self.buffers.depths);
                if z > 0.0 && z <= max_depth {
                    look(self.camera.deproject(column as f64, row as f64, 1.0), 1.0 / z);
                }
            }
        }
    }

    /// The largest planes, one after the other, by random tries and least squares.
    fn find<S: Sample>(&self, source: &mut impl Source<S>, structure: &mut Structure) {
        let Camera { width, height, .. } = self.camera;
        let least = SMALLEST * (width / SPARSE * (height / SPARSE)) as f64;
        let mut seed = 1_u64;
        let mut random = |end: f64| {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (seed >> 11) as f64 / (1_u64 << 53) as f64 * end
        };
        while !structure.planes.is_full() {
            let known = structure.planes.clone();
            let free = |ray: &Vec3, q: f64| !known.iter().any(|plane| (q - plane.w.dot(ray)).abs() < GATE * noise(q));
            let mut best = (least, Vec3::zeros());
            for _ in 0..TRIES {
                let (x, y) = (random(width as f64), random(height as f64));
                let mut corner = |dx: f64, dy: f64| {
                    let (column, row) = (x + dx, y + dy);
                    let inside = column >= 0.0 && row >= 0.0 && column < width as f64 && row < height as f64;
                    let (column, row) = (column as usize, row as usize);
                    let sample =
                        inside.then(|| source.part(row, column / 8 * 8..(column / 8 * 8 + 8).min(width)).get(column % 8).copied())??;
                    let (z, ray) =
                        (sample.depth(&self.coding, &self.buffers.depths), self.camera.deproject(column as f64, row as f64, 1.0));
                    (z > 0.0 && free(&ray, 1.0 / z)).then_some((ray, 1.0 / z))
                };
                let (dx, dy) = (APART.0 + random(APART.1), APART.0 + random(APART.1));
                let (Some(a), Some(b), Some(c)) = (corner(0.0, 0.0), corner(dx, 0.0), corner(0.0, dy)) else { continue };
                let Some(inverse) = Mat3::from_rows(&[a.0.transpose(), b.0.transpose(), c.0.transpose()]).try_inverse() else { continue };
                let w = inverse * Vec3::new(a.1, b.1, c.1);
                let mut count = 0.0;
                self.each(source, 2 * SPARSE, |ray, q| {
                    count += if free(&ray, q) && (q - w.dot(&ray)).abs() < GATE * noise(q) { 4.0 } else { 0.0 };
                });
                if count > best.0 {
                    best = (count, w);
                }
            }
            let mut plane = Some(Plane { w: best.1, covariance: Mat3::zeros() });
            for _ in 0..3 {
                let Some(Plane { w, .. }) = plane else { break };
                let mut sums = Sums::default();
                self.each(source, DENSE, |ray, q| {
                    if (q - w.dot(&ray)).abs() < GATE * noise(q) && free(&ray, q) {
                        sums.add(&ray, q);
                    }
                });
                plane = sums.plane(CORRELATED);
            }
            let Some(plane) = plane else { break };
            let _ = structure.planes.push(plane);
        }
    }

    /// Unit normal (camera axes), how far the camera has moved along it (m), and the standard deviation of that.
    fn follow_plane<S: Sample>(&self, source: &mut impl Source<S>, plane: &Plane) -> Option<(Vec3, f64, f64)> {
        let Camera { width, height, .. } = self.camera;
        let size = plane.w.norm();
        let mut factor = self.factor(source, plane)?;
        let (mut squares, mut count) = (0.0, 0.0);
        let mut weight = 0.0;
        for _ in 0..3 {
            let mut sum = 0.0;
            (squares, weight, count) = (0.0, 0.0, 0.0);
            self.each(source, DENSE, |ray, q| {
                let expected = plane.w.dot(&ray);
                let off = q - factor * expected;
                if off.abs() < GATE * noise(q) {
                    sum += expected * q;
                    weight += expected * expected;
                    squares += off * off;
                    count += 1.0;
                }
            });
            if count < SMALLEST * (width / DENSE * (height / DENSE)) as f64 {
                return None;
            }
            factor = sum / weight;
        }
        let distance = 1.0 / (size * factor);
        let sd = distance / factor * sqrt(CORRELATED * squares / count / weight);
        Some((plane.w / size, 1.0 / size - distance, sqrt(sd * sd + WARP * WARP)))
    }

    /// By how much nearer the plane is than at first, roughly: where most of what may be it agrees.
    fn factor<S: Sample>(&self, source: &mut impl Source<S>, plane: &Plane) -> Option<f64> {
        // Up to half as far again or as near, in steps that are small beside the gate.
        const BINS: usize = 128;
        let mut votes = [0_u32; BINS];
        self.each(source, SPARSE, |ray, q| {
            let ratio = q / plane.w.dot(&ray);
            let bin = crate::math::log(ratio) * 128.0 + 64.0;
            if bin.is_finite()
                && (0.0..BINS as f64).contains(&bin)
                && let Some(votes) = votes.get_mut(bin as usize)
            {
                *votes += 1;
            }
        });
        let (bin, votes) = votes.iter().enumerate().max_by_key(|(_, votes)| **votes)?;
        (*votes > 0).then(|| crate::math::exp((bin as f64 + 0.5 - 64.0) / 128.0))
    }
}

/// Standard deviation of the inverse depth `q`, 1/m.
pub(super) fn noise(q: f64) -> f64 {
    Noise::default().axial(1.0 / q) * q * q
}
