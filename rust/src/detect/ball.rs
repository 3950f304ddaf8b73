//! A ball of known radius in one image: the depth of its cap and its silhouette, in one set of normal equations.
//!
//! Across the line of sight the silhouette and the cap's slope tell about as much. The cap is fitted by generalised least squares: with noise that
//! neighbours share, weights as if it were independent would lose half of what its slope tells.

use super::equations::{Equations, Normal};
use super::foreground::{Frame, Sample, key_at};
use super::noise::{Factors, Noise, Shares};
use super::patch::{Patch, Surface};
use super::window::{CELLS, Lanes, moments, products};
use super::{Blob, Detection};
use crate::geometry::camera::Camera;
use crate::math::{Mat3, Vec3, round, sqrt, sqrtf, symmetric};
use nalgebra::{Matrix3x2, SVector};

/// Half the width over which the silhouette's edge is compared, px: wide enough for its noise, narrow enough to see nothing else.
const BAND: f64 = 2.0;
/// Prior of how far the silhouette falls short of the disc because grazing rays return nothing: mean and standard deviation, px.
const SHORTFALL: (f64, f64) = (0.5, 1.0);
/// A guess is linear to well below the noise within this many pixels across, and this part of the radius along.
const LINEAR: (f64, f64) = (0.5, 0.1);
/// Linearisations at most.
const ROUNDS: usize = 5;

/// [`Lanes`] and single numbers that a fit needs room for.
pub const ROOM: (usize, usize) = (8 * CELLS, 3 * CELLS);

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
}

/// A guess that is being refined: center, and the silhouette's shortfall, m.
#[derive(Clone, Copy)]
struct Guess {
    center: Vec3,
    shortfall: f64,
}

/// What the pixels around a ball say, given a guess of it.
#[derive(Default)]
struct Evidence {
    /// Σ of the outline's jacobian times its residual.
    outline: [f32; 4],
    /// Pixels whose depth takes part, and those that show something near the ball, but no ball.
    points: u32,
    wild: u32,
    /// Pixels well inside the disc; of those, the ones that show the ball, and the ones that the background may hide.
    disc: u32,
    seen: u32,
    hidden: u32,
    /// Pixels of foreground at the ball's depth, in the disc or on its edge.
    mask: u32,
}

/// Two unit vectors across the line of sight to `center`.
fn across(center: &Vec3) -> [Vec3; 2] {
    let sight = center.normalize();
    let right = Vec3::y().cross(&sight).normalize();
    [right, sight.cross(&right)]
}

/// Sum of the squared residuals that a step leaves.
fn squares_after(step: &Vec3, jacobian: &[Lanes], residuals: &[f32]) -> f64 {
    let [right, down, along] = [step.x, step.y, step.z].map(|x| x as f32);
    let left = jacobian.iter().zip(residuals).map(|(j, r)| r - j[0] * right - j[1] * down - j[2] * along);
    f64::from(left.fold(0.0_f32, |sum, left| sum + left * left))
}

impl<S: Sample> View<'_, S> {
    /// Pixels a metre across the ray, at depth `z`.
    fn scale(&self, z: f64) -> f64 {
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

    /// Whether a pixel can't tell where the ball's edge is: outside of the image, or what is behind or before the ball, at these keys, comes
    /// too near.
    fn blind(&self, column: f64, row: f64, [before, behind]: [u16; 2]) -> bool {
        let inside = column >= 0.0 && row >= 0.0 && column < self.camera.width as f64 && row < self.camera.height as f64;
        !inside || self.frame.hides(row as usize * self.camera.width + column as usize, before, behind)
    }

    /// Compares the image with a guess, of which `surface` was drawn: fills the cap's jacobian and residual, and the outline's jacobian (in
    /// the directions `across`, and of the shortfall), each with a pattern that no ball has.
    fn compare(
        &self,
        patch: &Patch,
        guess: &Guess,
        surface: &Surface,
        cap: &mut [Lanes],
        outline: &mut [Lanes],
        residuals: &mut [f32],
    ) -> Evidence {
        let Guess { center, shortfall } = *guess;
        let (camera, scale, axial) = (self.camera, self.scale(center.z), self.noise.axial(center.z));
        // From how far before its surface to how far behind its center the ball may show, and how wild a reading of it may be, m.
        let [near, far, gate] = [2.0, 0.5, 0.5].map(|jumps| (4.0 * axial + jumps * Self::jump(self.radius)) as f32);
        let (edge, outer) = ((self.radius - shortfall) as f32, (self.radius - shortfall + BAND / scale) as f32);
        let [inner, well_inside] = [BAND, 1.0].map(|pixels| (edge - (pixels / scale) as f32).max(0.0));
        let slope = (scale / (2.0 * BAND)) as f32;
        let keys = [center.z - f64::from(near), center.z + 2.0 * axial].map(|z| key_at::<S>(z, &self.frame.coding));
        let (column, row) = camera.project(&center).unwrap_or_default();
        let mut evidence = Evidence::default();
        cap.fill([0.0; 4]);
        outline.fill([0.0; 4]);
        for y in 0..patch.grid.rows {
            for x in 0..patch.grid.columns {
                let i = y * patch.grid.width() + x;
                let offset_square = surface.offset_square[i];
                if offset_square > outer * outer {
                    continue;
                }
                let (pixel_x, pixel_y) = patch.pixel(x, y);
                let index = pixel_y * camera.width + pixel_x;
                let depth = if surface.depth[i].is_nan() { 0.0 } else { surface.depth[i] };
                let reading = self.frame.foreground(index).map(|z| (z - center.z) as f32);
                let shows = reading.is_some_and(|z| z > depth - near && z < far);
                evidence.mask += u32::from(shows);

                let residual = reading.filter(|_| shows).map(|z| z - depth);
                evidence.wild += u32::from(residual.is_some_and(|r| r.abs() >= gate));
                if let Some(residual) = residual.filter(|r| r.abs() < gate)
                    && let Some((_, [right, down, along])) = patch.depth(camera, &center, surface, x, y)
                {
                    let pattern = right * down;
                    cap[i] = [right, down, along, pattern];
                    residuals[i] = residual;
                    evidence.points += 1;
                }

                if offset_square < well_inside * well_inside {
                    evidence.disc += 1;
                    evidence.seen += u32::from(shows);
                    let hidden = || self.frame.limit(index) - center.z < f64::from(depth) + 2.0 * axial;
                    evidence.hidden += u32::from(!shows && hidden());
                }
                if offset_square < inner * inner {
                    continue;
                }
                // Inside the band the share of the ball in a pixel falls linearly from 1 to 0. What hides a pixel of it takes its mirror image too,
                // or else what is left would pull.
                let inside = f64::from(edge - sqrtf(offset_square)) * scale;
                let (dx, dy) = (pixel_x as f64 - column, pixel_y as f64 - row);
                let length = sqrt(dx * dx + dy * dy).max(1e-9);
                let (right, down) = (dx / length, dy / length);
                let mirror = [pixel_x as f64 + 2.0 * inside * right, pixel_y as f64 + 2.0 * inside * down].map(round);
                if self.blind(pixel_x as f64, pixel_y as f64, keys) || self.blind(mirror[0], mirror[1], keys) {
                    continue;
                }
                let residual = f32::from(u8::from(shows)) - (0.5 + inside / (2.0 * BAND)) as f32;
                let (right, down) = (right as f32, down as f32);
                // Of a triangle: square windows leave twofold traces in a silhouette, but none of these.
                let pattern = right * (right * right - 3.0 * down * down);
                outline[i] = [right, down, -1.0, pattern].map(|j| j * slope);
                evidence.outline.iter_mut().zip(outline[i]).for_each(|(sum, j)| *sum += j * residual);
            }
        }
        evidence
    }

    /// Fits the ball from a first guess of its center, camera frame, m; `pixels` is how many its component has. `lanes` and `numbers` are room to
    /// work in, see [`ROOM`]. `None` where no ball of this radius looks like that.
    pub fn fit(&self, start: Vec3, pixels: u32, lanes: &mut [Lanes], numbers: &mut [f32]) -> Option<Found> {
        let mut guess = Guess { center: start, shortfall: SHORTFALL.0 / self.scale(start.z) };
        for round in 1.. {
            let center = guess.center;
            let scale = self.scale(center.z);
            let patch = Patch::around(self.camera, &center, self.radius, BAND, self.noise.window)?;
            let cells = patch.grid.cells();
            let (cap, lanes) = lanes.get_mut(..8 * cells)?.split_at_mut(cells);
            let (outline, lanes) = lanes.split_at_mut(cells);
            let (weights, scratch) = lanes.split_at_mut(cells);
            let (depth, numbers) = numbers.get_mut(..3 * cells)?.split_at_mut(cells);
            let (offset_square, residuals) = numbers.split_at_mut(cells);
            let mut surface = Surface { depth, offset_square };
            let pairs = scratch.as_flattened_mut().as_chunks_mut().0.get_mut(..cells)?;
            patch.draw(self.camera, &center, self.radius, pairs, &mut surface);
            residuals.fill(0.0);
            let evidence = self.compare(&patch, &guess, &surface, cap, outline, residuals);

            let (axial, step) = (self.noise.axial(center.z), S::step(center.z, &self.frame.coding));
            let shares = self.noise.shares(center.z, step);
            let whitened = patch.grid.whiten(shares, cap, weights, scratch);
            let cap_equations = Equations {
                response: whitened.response.fixed_columns::<3>(0).into_owned(),
                moments: moments(weights, residuals),
                covariance: whitened.covariance * (axial * axial),
            };
            let sd = self.noise.lateral() / (2.0 * BAND);
            let outline = Equations {
                response: products(outline, outline).fixed_columns::<3>(0).into_owned(),
                moments: SVector::from(evidence.outline.map(f64::from)),
                covariance: patch.grid.covariance(Shares { shared: 1.0, own: 0.0 }, outline) * (sd * sd),
            };
            let mut normal = cap_equations.normal(self.factors.cap.value() * Noise::LARGER_WINDOW)?;
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
            let squares = squares_after(&step, cap, residuals);
            let detection = self.judge(&evidence, &guess, covariance, squares, &patch, pixels)?;
            let outline_ratio = outline.check(&Vec3::new(sideways[0], sideways[1], shrink));
            return Some(Found { detection, cap_ratio: cap_equations.check(&step), outline_ratio });
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

    fn judge(&self, evidence: &Evidence, guess: &Guess, covariance: Mat3, squares: f64, patch: &Patch, pixels: u32) -> Option<Detection> {
        let thinned = (patch.stride * patch.stride) as f64;
        let (points, disc) = (f64::from(evidence.points), f64::from(evidence.disc));
        let finite = guess.center.iter().chain(covariance.iter()).all(|x| x.is_finite());
        let residual_rms = sqrt(squares / points);
        if evidence.points < 6
            || 4 * evidence.wild > evidence.points
            || residual_rms > 2.0 * self.noise.axial(guess.center.z)
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
        Some(Detection { center: guess.center, covariance, radius: self.radius, points: evidence.points, residual_rms, row, blob })
    }
}
