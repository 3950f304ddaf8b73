//! The motion between two views of one object: iterated closest points, point to plane (Chen and Medioni 1992), and its silhouette.
//!
//! What a point meets in the other view is found by projecting it there (Blais and Levine 1995). Surfaces tell little of a motion along
//! themselves: across the line of sight most of what is known comes from the silhouette, which is met likewise, point to line.

#![allow(clippy::inline_always)] // So that loops are compiled for the registers of `widest`.

use super::cloud::{Cell, Cloud};
use super::noise::Noise;
use crate::geometry::motion::Motion;
use crate::math::{Mat3, Vec3, sqrt, symmetric};
use crate::simd::widest;
use nalgebra::{Matrix3x6, Matrix6, Vector6};

/// From coarse to fine.
const LEVELS: [Level; 2] = [
    Level { step: 4, rim: false, cutoff: 15.0, rounds: 9, settled: 2.0 },
    // Of Gaussian residuals Tukey's weights then keep 95 % of what they tell.
    Level { step: 2, rim: true, cutoff: 4.685, rounds: 8, settled: 0.3 },
];
/// What fills fewer cells than this is not thinned.
const THINNED: usize = 200;
/// What is known before, as standard deviations of a round's step: it keeps a turn that can't be seen (of a ball) from running off. rad, m.
const PRIOR: (f64, f64) = (0.5, 0.5);
/// Cosine of the angle by which two normals of one surface may differ, by noise and by motion.
pub(super) const FACING: f32 = 0.3;
/// Cosine below which a surface is seen at a grazing angle, where noise is larger than along the ray.
pub(super) const GRAZING: f32 = 0.25;
/// The rim of a round body is not the same line of it in both views: this part of its radius times the turn between them, all of it at once.
const RIM: f64 = 0.1;
/// A cell at the rim shares its noise with fewer around it, and counts more: as if this part were covered, at the least.
const LONELY: f32 = 0.7;
/// Sides of a silhouette, as far as they are off independently.
const SIDES: f32 = 4.0;
/// Equations below which nothing is determined.
const FEWEST: f32 = 20.0;

struct Level {
    /// One of so many cells,
    step: usize,
    /// which stands for them; but of the rim all, and cells so large that each has noise of its own. Else the silhouette counts more.
    rim: bool,
    /// Residuals above so many standard deviations count nothing.
    cutoff: f32,
    /// Linearisations at most.
    rounds: usize,
    /// A step of no more than so many standard deviations ends it: the next would be a small part of that.
    settled: f64,
}

/// How one view of an object comes to lie on another.
#[derive(Clone, Copy, Debug)]
pub struct Alignment {
    /// From the source's view to the target's, camera frame.
    pub target_from_source: Motion,
    /// Of the motion's error: turn (rad) about `middle` and shift (m); the noise of both views, and its correlation between neighbouring pixels, included.
    pub covariance: Matrix6<f64>,
    /// What that turn is about, in the target's view, m.
    pub middle: Vec3,
    /// Root mean square of the distances of the source's points from the target's planes, m.
    pub residual_rms: f64,
    /// Their mean square in units of its expectation.
    pub chi_square: f64,
    /// Cells that took part.
    pub inliers: u32,
    /// That as a part of the source's cells.
    pub overlap: f64,
    /// What part of `covariance` is due to the source's noise: another view at its place shares the target's.
    pub own: f64,
    /// Linearisations.
    pub iterations: u32,
}

impl Alignment {
    /// Covariance of where `p`, a point of the object in the target's view, comes to, m².
    pub fn covariance_at(&self, p: &Vec3) -> Mat3 {
        let mut jacobian = Matrix3x6::zeros();
        jacobian.fixed_view_mut::<3, 3>(0, 0).copy_from(&-(p - self.middle).cross_matrix());
        jacobian.fixed_view_mut::<3, 3>(0, 3).copy_from(&Mat3::identity());
        symmetric(&(jacobian * self.covariance * jacobian.transpose()))
    }
}

/// An equation: what six unknowns, the residual, and nothing count; as many numbers as a wide register holds.
type Row = [f32; 8];

/// Normal equations of one linearisation: Σ weight · row of unknowns · row.
#[derive(Default)]
struct System {
    products: [Row; 6],
    /// Σ weight · squared residual, and its expectation; Σ squared residual, m², and how many.
    squares: [f32; 2],
    distances: f32,
    /// Σ weight of all equations over their variance, and of the source's part of that variance.
    shares: [f32; 2],
    /// Cells that took part and that could, with those they stand for.
    inliers: f32,
    seen: f32,
}

impl System {
    /// Takes in a residual of `jacobian` · step.
    #[inline(always)]
    fn add(&mut self, jacobian: &[f32; 6], residual: f32, weight: f32) {
        let [a, b, c, d, e, f] = *jacobian;
        let row: Row = [a, b, c, d, e, f, residual, 0.0];
        for (products, unknown) in self.products.iter_mut().zip(jacobian) {
            let weighted = weight * unknown;
            for (product, other) in products.iter_mut().zip(row) {
                *product += weighted * other;
            }
        }
    }

    /// An equation with this weight, and what part of its variance is the source's.
    #[inline(always)]
    fn share(&mut self, weight: f32, own: f32) {
        self.shares = [self.shares[0] + weight, self.shares[1] + weight * own];
    }

    fn gradient(&self) -> Vector6<f64> {
        Vector6::from_fn(|i, _| f64::from(self.products[i][6]))
    }

    fn matrix(&self) -> Matrix6<f64> {
        let mut matrix = Matrix6::from_fn(|i, j| f64::from(self.products[i.min(j)][i.max(j)]));
        for i in 0..3 {
            matrix[(i, i)] += 1.0 / (PRIOR.0 * PRIOR.0);
            matrix[(i + 3, i + 3)] += 1.0 / (PRIOR.1 * PRIOR.1);
        }
        matrix
    }

    /// Mean square of the residuals in units of its expectation.
    fn chi_square(&self) -> f64 {
        f64::from(self.squares[0]) / f64::from(self.squares[1]).max(1e-30)
    }
}

/// A motion in the numbers of a cloud, about a pivot in the target's view.
pub(super) struct Moved {
    rotation: [[f32; 3]; 3],
    translation: [f32; 3],
    pivot: [f32; 3],
}

impl Moved {
    pub(super) fn new(motion: &Motion, pivot: &Vec3) -> Self {
        let row = |i: usize| [0, 1, 2].map(|j| motion.rotation[(i, j)] as f32);
        Self {
            rotation: [row(0), row(1), row(2)],
            translation: [0, 1, 2].map(|i| motion.translation[i] as f32),
            pivot: [0, 1, 2].map(|i| pivot[i] as f32),
        }
    }

    #[inline(always)]
    pub(super) fn turned(&self, v: &[f32; 3]) -> [f32; 3] {
        [dot(&self.rotation[0], v), dot(&self.rotation[1], v), dot(&self.rotation[2], v)]
    }

    /// By how much it turns, rad, where that is little.
    fn angle(&self) -> f32 {
        let r = &self.rotation;
        let twice_sin = [r[2][1] - r[1][2], r[0][2] - r[2][0], r[1][0] - r[0][1]];
        0.5 * crate::math::sqrtf(dot(&twice_sin, &twice_sin))
    }

    #[inline(always)]
    pub(super) fn of(&self, p: &[f32; 3]) -> [f32; 3] {
        let turned = self.turned(p);
        [turned[0] + self.translation[0], turned[1] + self.translation[1], turned[2] + self.translation[2]]
    }

    /// How a distance of `p` along `n` changes by a turn about the pivot and by a shift.
    #[inline(always)]
    fn jacobian(&self, p: &[f32; 3], n: &[f32; 3]) -> [f32; 6] {
        let [x, y, z] = [p[0] - self.pivot[0], p[1] - self.pivot[1], p[2] - self.pivot[2]];
        [y * n[2] - z * n[1], z * n[0] - x * n[2], x * n[1] - y * n[0], n[0], n[1], n[2]]
    }
}

#[inline(always)]
pub(super) fn dot(a: &[f32; 3], b: &[f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Tukey's biweight of a residual whose square is this part of the cutoff's.
#[inline(always)]
fn tukey(part: f32) -> f32 {
    if part < 1.0 { (1.0 - part) * (1.0 - part) } else { 0.0 }
}

/// What noise does to the equations of two clouds.
struct Weighing {
    /// Along the ray at depth z, as [`Noise::axial`]; what a cell's equation counts, as it shares noise with its neighbours'.
    surface: f32,
    /// Standard deviation of a silhouette's edge, px; likewise.
    lateral: f32,
    outline: f32,
    /// Variance of a whole side of the silhouette, times the points on one, m² a rad².
    rim: f32,
}

impl Weighing {
    fn new(noise: Noise, source: &Cloud, target: &Cloud, step: f64) -> Self {
        let depth = target.mean().z;
        let shares = noise.shares(depth, step);
        let [columns, rows] = noise.window.map(|edge| edge as f64);
        let pixels = (source.stride() * source.stride()) as f64;
        // Readings of N pixels that share their noise over windows are worth as much as N / window.
        let surface = (pixels / (shares.shared * columns * rows + shares.own)).min(1.0);
        let outline = (2.0 * source.stride() as f64 / (columns + rows)).min(1.0);
        let rim = RIM * source.radius();
        Self {
            surface: surface as f32,
            lateral: noise.lateral() as f32,
            outline: outline as f32,
            rim: (rim * rim) as f32 * source.outline().len() as f32 / SIDES,
        }
    }
}

/// The motion that brings `source` onto `target`, beginning at `start`; `step` is the change of depth over one step of its code where they are, m.
/// `None` where they don't lie on each other.
pub fn align(source: &Cloud, target: &Cloud, start: &Motion, noise: Noise, step: f64) -> Option<Alignment> {
    let weighing = Weighing::new(noise, source, target, step);
    let (mut motion, mut iterations, mut spread) = (*start, 0, 1.0);
    let thinned = source.pixels() as usize >= THINNED * source.stride() * source.stride();
    let mut outcome = None;
    for level in &LEVELS {
        for _ in 0..level.rounds {
            let pivot = motion.of(&source.mean());
            let moved = Moved::new(&motion, &pivot);
            let mut system = System::default();
            let cutoff = level.cutoff * spread;
            let alike = 2 * source.stride() <= noise.window[0].min(noise.window[1]);
            let step = if thinned && (alike || !level.rim) { level.step } else { 1 };
            widest(
                #[inline(always)]
                || {
                    surfaces(&mut system, source, target, &moved, noise, &weighing, step, level.rim, cutoff);
                    outlines(&mut system, source, target, &moved, &weighing, cutoff);
                },
            );
            if system.inliers < FEWEST {
                return None;
            }
            let information = system.matrix();
            let solver = information.cholesky()?;
            let delta = solver.solve(&system.gradient());
            let (turn, shift) = (Vec3::new(delta[0], delta[1], delta[2]), Vec3::new(delta[3], delta[4], delta[5]));
            if !delta.iter().all(|x| x.is_finite()) || turn.norm() > 1.0 {
                return None;
            }
            motion = Motion::about(&pivot, &turn, &shift).after(&motion);
            iterations += 1;
            // Noise that is larger than thought, or a surface that is not what it was.
            let chi_square = system.chi_square();
            spread = sqrt(chi_square.clamp(1.0, 9.0)) as f32;
            let size = delta.dot(&(information * delta));
            outcome = Some((system, solver.inverse(), pivot + shift, chi_square));
            if size < level.settled * level.settled {
                break;
            }
        }
    }
    let (system, covariance, middle, chi_square) = outcome?;
    Some(Alignment {
        target_from_source: motion,
        covariance: symmetric(&(covariance * chi_square.max(1.0))),
        middle,
        residual_rms: sqrt(f64::from(system.distances) / f64::from(system.inliers.max(1.0))),
        chi_square,
        inliers: system.inliers as u32,
        overlap: f64::from(system.inliers / system.seen.max(1.0)),
        own: f64::from(system.shares[1]) / f64::from(system.shares[0]).max(1e-30),
        iterations,
    })
}

/// Adds what the source's surface says: each of its cells lies in the plane of the cell that it meets.
#[inline(always)]
#[allow(clippy::too_many_arguments)]
fn surfaces(
    system: &mut System,
    source: &Cloud,
    target: &Cloud,
    moved: &Moved,
    noise: Noise,
    weighing: &Weighing,
    step: usize,
    rim: bool,
    cutoff: f32,
) {
    let within = cutoff * cutoff;
    for (cell, stands) in source.samples(step, rim) {
        system.seen += stands;
        let p = moved.of(&cell.point);
        if p[2] <= 0.0 {
            continue;
        }
        let place = target.project(&p);
        let Some(Cell { point: q, normal, views, .. }) = target.at(place).filter(|met| met.has_normal()) else { continue };
        // All 0 where it is not known.
        let turned = moved.turned(&cell.normal);
        if cell.has_normal() && dot(&turned, normal) < FACING {
            continue;
        }
        // How both face in the mean, whose noise is less; and between two points of a round surface it is the chord's. Its length cancels out.
        let normal = [turned[0] + normal[0], turned[1] + normal[1], turned[2] + normal[2]];
        let length_square = dot(&normal, &normal);
        // How much the surface faces the ray, and how far it is along the ray: by its cells, or by the plane of one.
        let facing = dot(&normal, &p) * (1.0 / p[2]);
        let residual = match target.inverse_depth(place) {
            Some(inverse) => facing * (1.0 / inverse - p[2]),
            None => dot(&normal, &[q[0] - p[0], q[1] - p[1], q[2] - p[2]]),
        };
        let axial = noise.axial(f64::from(q[2])) as f32;
        let variance = axial * axial * (facing * facing).max(GRAZING * GRAZING * length_square);
        let own = views / (cell.views + views);
        let precision = own * cell.views / variance;
        let square = residual * residual * precision;
        let weight = tukey(square / within);
        if weight > 0.0 {
            let weighed = weight * precision * (stands * weighing.surface / cell.cover.max(LONELY)).min(1.0);
            system.add(&moved.jacobian(&p, &normal), residual, weighed);
            system.share(weighed * length_square, own);
            system.squares = [system.squares[0] + stands * weight * square, system.squares[1] + stands * weight];
            system.distances += stands * residual * residual / length_square;
            system.inliers += stands;
        }
    }
}

/// Adds what the source's silhouette says: its points lie on the target's.
#[inline(always)]
fn outlines(system: &mut System, source: &Cloud, target: &Cloud, moved: &Moved, weighing: &Weighing, cutoff: f32) {
    let (pitch, turn) = (target.pitch(), moved.angle());
    let px = pitch.map(|pitch| pitch / target.stride() as f32);
    for point in source.outline() {
        let p = moved.of(point);
        if p[2] <= 0.0 {
            continue;
        }
        let place = target.project(&p);
        let Some((cover, slope)) = target.cover(place).filter(|(cover, _)| (0.05..0.95).contains(cover)) else { continue };
        let square = slope[0] * slope[0] + slope[1] * slope[1];
        if square < 0.01 {
            continue;
        }
        // Across the outline, in cells, and from there in metres.
        let step = (0.5 - cover) / square;
        let away = [step * slope[0] * pitch[0] * p[2], step * slope[1] * pitch[1] * p[2]];
        let gradient = [slope[0] / pitch[0], slope[1] / pitch[1]];
        let length = crate::math::sqrtf(gradient[0] * gradient[0] + gradient[1] * gradient[1]);
        let across = gradient.map(|part| part / length);
        // The rim of another surface is not its rim.
        let inside = target.at([0, 1].map(|i| place[i] + slope[i] / crate::math::sqrtf(square)));
        if inside.is_none_or(|met| !met.is_seen() || (met.point[2] - p[2]).abs() > 0.02 + 4.0 * pitch[0] * p[2]) {
            continue;
        }
        let residual = across[0] * away[0] + across[1] * away[1];
        let sd = weighing.lateral * px[0] * p[2];
        let variance = 2.0 * sd * sd;
        let weight = tukey(residual * residual / variance / (cutoff * cutoff));
        if weight > 0.0 {
            // x/z changes with depth as well.
            let n = [across[0], across[1], -(across[0] * p[0] + across[1] * p[1]) / p[2]];
            let weighed = weight / (variance / weighing.outline + weighing.rim * turn * turn);
            system.add(&moved.jacobian(&p, &n), residual, weighed);
            system.share(weighed, 0.5);
        }
    }
}
