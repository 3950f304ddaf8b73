//! A ball of known radius in one image: the depth of its cap and its silhouette, in one set of normal equations.
//!
//! Across the line of sight the silhouette and the cap's slope tell about as much. The cap is fitted by generalised least squares: with noise that
//! neighbours share, weights as if it were independent would lose half of what its slope tells.

#![allow(clippy::inline_always)] // So that loops are compiled for the registers of `widest`.

use super::compare::{BAND, Evidence, Guess, Linear};
use super::equations::{Equations, Normal};
use super::foreground::{Frame, Sample};
use super::noise::{Factors, Noise};
use super::patch::{Patch, Surface};
use super::window::{CELLS, Plane, dot, moments, products};
use super::{Blob, Detection};
use crate::geometry::camera::Camera;
use crate::math::{Mat3, Vec3, sqrt, symmetric};
use crate::simd::widest;
use nalgebra::Matrix3x2;

/// Prior of how far the silhouette falls short of the disc because grazing rays return nothing: mean and standard deviation, px.
const SHORTFALL: (f64, f64) = (0.5, 1.0);
/// A guess is linear to well below the noise within this many pixels across, and this part of the radius along.
const LINEAR: (f64, f64) = (0.5, 0.1);
/// Linearisations at most.
const ROUNDS: usize = 5;

/// Depth counts by its means over blocks of so many columns and rows: these share nearly all of their noise, so that weights of their own would
/// gain nothing (`seeing_accuracy`).
const THIN: usize = 2;

/// Residuals of a ball are no more than so many standard deviations of its depth, root mean square.
pub const LARGEST_RESIDUAL: f64 = 2.0;

/// Numbers that a fit needs room for.
pub const ROOM: usize = 20 * CELLS;

/// What is needed to look for a ball.
pub struct View<'v, S> {
    /// The image.
    pub frame: &'v Frame<'v, S>,
    /// The camera that took it.
    pub camera: &'v Camera,
    /// Its noise.
    pub noise: Noise,
    /// How the noise compares with that.
    pub factors: Factors,
    /// Radius of the ball, m.
    pub radius: f64,
}

/// A ball that was found, and what it tells of the noise: ratios to the modelled variance of its depth and of its silhouette.
pub struct Found {
    /// The ball.
    pub detection: Detection,
    /// Of the depth of its cap.
    pub cap_ratio: f64,
    /// Of its silhouette.
    pub outline_ratio: f64,
    /// Mean squared distance of the points of its cap from the sphere that comes nearest to them, m².
    pub least_square: f64,
}

/// What an image says of a guess.
struct Linearised {
    evidence: Evidence,
    squares: Squares,
    cap: Equations,
    outline: Equations,
}

/// Sum of the squared residuals of the cap's points, by the step that is taken.
struct Squares {
    points: f64,
    constant: f64,
    gradient: Vec3,
    hessian: Mat3,
}

impl Squares {
    fn rms_after(&self, step: &Vec3) -> f64 {
        let squares = self.constant - 2.0 * self.gradient.dot(step) + step.dot(&(self.hessian * step));
        sqrt(squares.max(0.0) / self.points)
    }

    /// Mean square after the step that makes it smallest, m².
    fn least(&self) -> f64 {
        let gained = self.hessian.cholesky().map_or(0.0, |solver| self.gradient.dot(&solver.solve(&self.gradient)));
        (self.constant - gained).max(0.0) / self.points
    }
}

/// Two unit vectors across the line of sight to `center`.
fn across(center: &Vec3) -> [Vec3; 2] {
    let sight = center.normalize();
    let right = Vec3::y().cross(&sight).normalize();
    [right, sight.cross(&right)]
}

/// Planes one after the other.
fn planes<const N: usize>(room: &mut [f32], cells: usize) -> [&mut Plane; N] {
    let mut planes = room.chunks_exact_mut(cells);
    core::array::from_fn(|_| planes.next().unwrap_or_default())
}

impl<S: Sample> View<'_, S> {
    /// Pixels a metre across the ray, at depth `z`.
    pub fn scale(&self, z: f64) -> f64 {
        sqrt(self.camera.fx * self.camera.fy) / z
    }

    /// Pixels that the whole disc of a ball with this center fills.
    pub fn disc(&self, center: &Vec3) -> f64 {
        let r = self.radius * self.scale(center.z);
        core::f64::consts::PI * r * r
    }

    /// Differences in depth that one ball can show to neighbouring pixels, besides noise, m.
    pub fn jump(radius: f64) -> f64 {
        0.5 * radius
    }

    /// What the image says of a guess: of the cap, the sum of its squared residuals as a function of the step, and of the outline.
    #[inline(always)]
    fn linearise(&self, patch: &Patch, guess: &Guess, room: &mut [f32]) -> Option<Linearised> {
        let (center, grid) = (guess.center, &patch.grid);
        let (cells, thinned) = (grid.cells(), grid.thinned(THIN));
        let room = room.get_mut(..20 * cells)?;
        let (outline, room) = room.split_at_mut(5 * cells);
        let (cap, room) = room.split_at_mut(5 * thinned.cells());
        let mut cap = Linear::new(&thinned, planes(cap, thinned.cells()));
        let [depth, offset_square, readings, right, down, along, pattern, residual] = planes(room, cells);
        let mut surface = Surface { depth, offset_square };
        patch.draw(self.camera, &center, self.radius, &mut surface, planes(outline, cells));
        self.read(patch, &center, readings);
        let mut whole_cap = Linear::new(grid, [right, down, along, pattern, residual]);
        let mut outline = Linear::new(grid, planes(outline, cells));
        let evidence = self.compare(patch, guess, &surface, readings, &mut whole_cap, &mut outline);
        let residual = grid.inside(whole_cap.residual);
        let (constant, gradient) = (dot(residual, residual), moments(whole_cap.planes().map(|plane| grid.inside(plane)), residual));
        whole_cap.thin::<THIN>(grid, &mut cap, [offset_square, readings]);

        let blocks = f64::from(cap.jacobian[2].iter().map(|along| u32::from(*along != 0.0)).sum::<u32>().max(1));
        let (axial, step) = (self.noise.axial(center.z), S::step(center.z, &self.frame.coding));
        let shares = grid.shares_of_blocks(self.noise.shares(center.z, step), THIN);
        let whitened = thinned.whiten(shares, cap.planes(), cap.residual, room);
        let sd = self.noise.lateral() / (2.0 * BAND);
        let planes = outline.planes();
        let inside = planes.map(|plane| grid.inside(plane));
        Some(Linearised {
            evidence,
            squares: Squares {
                points: f64::from(evidence.points),
                constant,
                gradient: gradient.xyz(),
                hessian: whitened.products.fixed_view::<3, 3>(0, 0) * (f64::from(evidence.points) / blocks),
            },
            cap: Equations {
                response: whitened.response.fixed_columns::<3>(0).into_owned(),
                moments: whitened.moments,
                covariance: whitened.covariance * (axial * axial),
            },
            outline: Equations {
                response: products(inside, inside).fixed_columns::<3>(0).into_owned(),
                moments: moments(inside, grid.inside(outline.residual)),
                covariance: grid.covariance(planes, room) * (sd * sd),
            },
        })
    }

    /// Fits the ball from a first guess of its center, camera frame, m; `pixels` is how many its component has. `room` is to work in, see [`ROOM`].
    /// `None` where no ball of this radius looks like that.
    pub fn fit(&self, start: Vec3, pixels: u32, room: &mut [f32]) -> Option<Found> {
        let mut guess = Guess { center: start, shortfall: SHORTFALL.0 / self.scale(start.z) };
        for round in 1.. {
            let center = guess.center;
            let scale = self.scale(center.z);
            let patch = Patch::around(self.camera, &center, self.radius, BAND, self.noise.window)?;
            let Linearised { evidence, squares, cap: cap_equations, outline } = widest(
                #[inline(always)]
                || self.linearise(&patch, &guess, room),
            )?;
            let mut normal = cap_equations.normal(self.factors.cap.value() * self.noise.larger_window())?;
            let across = across(&center);
            let silhouette = self.silhouette(&outline, &guess, &across);
            if let Some((outline, _)) = &silhouette {
                normal.information += outline.information;
                normal.gradient += outline.gradient;
            }
            let solver = normal.information.cholesky()?;
            let step = solver.solve(&normal.gradient);
            let flattening = self.noise.flattening_sd(scale, self.radius);
            let sight = center.normalize();
            let covariance = symmetric(&(solver.inverse() + sight * sight.transpose() * (flattening * flattening)));
            guess.center = self.moved(&center, &step)?;
            let sideways = [across[0].dot(&step), across[1].dot(&step)];
            let shrink = silhouette.map_or(0.0, |(_, shortfall)| shortfall.dot(&Vec3::new(sideways[0], sideways[1], 1.0)));
            guess.shortfall += shrink;
            let sideways_square = sideways[0] * sideways[0] + sideways[1] * sideways[1];
            if round < ROUNDS && (sqrt(sideways_square) * scale > LINEAR.0 || step.z.abs() > LINEAR.1 * self.radius) {
                continue;
            }
            let detection = self.judge(&evidence, &guess, covariance, squares.rms_after(&step), &patch, pixels)?;
            let outline_ratio = outline.check(&Vec3::new(sideways[0], sideways[1], shrink));
            return Some(Found { detection, cap_ratio: cap_equations.check(&step), outline_ratio, least_square: squares.least() });
        }
        None
    }

    /// What the silhouette says of the center, whatever its shortfall; and the shortfall's step: its product with (step of the
    /// center `across`, 1), m.
    fn silhouette(&self, equations: &Equations, guess: &Guess, across: &[Vec3; 2]) -> Option<(Normal, Vec3)> {
        let mut normal = equations.normal(self.factors.outline.value())?;
        let scale = self.scale(guess.center.z);
        let prior = scale * scale / (SHORTFALL.1 * SHORTFALL.1);
        normal.information[(2, 2)] += prior;
        normal.gradient.z += prior * (SHORTFALL.0 / scale - guess.shortfall);
        let (h, g) = (normal.information, normal.gradient);
        let to_camera = Matrix3x2::from_columns(across);
        let coupling = h.fixed_view::<2, 1>(0, 2) / h[(2, 2)];
        let information = h.fixed_view::<2, 2>(0, 0) - coupling * h.fixed_view::<1, 2>(2, 0);
        let gradient = g.fixed_rows::<2>(0) - coupling * g.z;
        let information = symmetric(&(to_camera * information * to_camera.transpose()));
        let shortfall = Vec3::new(-h[(2, 0)], -h[(2, 1)], g.z) / h[(2, 2)];
        Some((Normal { information, gradient: to_camera * gradient }, shortfall))
    }

    /// The center after a step; `None` where it leaves what can be.
    fn moved(&self, center: &Vec3, step: &Vec3) -> Option<Vec3> {
        let moved = center + step;
        (step.norm() < 2.0 * self.radius && moved.z > self.radius && moved.z < self.camera.max_depth + self.radius).then_some(moved)
    }

    fn judge(
        &self,
        evidence: &Evidence,
        guess: &Guess,
        covariance: Mat3,
        residual_rms: f64,
        patch: &Patch,
        pixels: u32,
    ) -> Option<Detection> {
        let thinned = (patch.stride * patch.stride) as f64;
        let disc = f64::from(evidence.disc);
        let finite = guess.center.iter().chain(covariance.iter()).all(|x| x.is_finite());
        if evidence.points < 6
            || 4 * evidence.wild > evidence.points
            || residual_rms > LARGEST_RESIDUAL * self.noise.axial(guess.center.z)
            || f64::from(evidence.seen) < 0.25 * disc
            || !finite
        {
            return None;
        }
        let missing = f64::from(evidence.disc - evidence.seen - evidence.hidden);
        let extra = f64::from(pixels) - f64::from(evidence.mask) * thinned;
        let blob = if extra > 0.15 * self.disc(&guess.center) {
            Blob::Merged
        } else if patch.cut || missing > 0.08 * disc || f64::from(evidence.hidden) > 0.4 * disc {
            Blob::Cut
        } else {
            Blob::Whole
        };
        let (_, row) = self.camera.project(&guess.center)?;
        Some(Detection {
            center: guess.center,
            covariance,
            drift: Mat3::zeros(),
            radius: self.radius,
            points: evidence.points,
            residual_rms,
            row,
            blob,
            shape: None,
        })
    }
}
