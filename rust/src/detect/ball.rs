//! A ball of known radius in one image: the depth of its cap and its silhouette, in one set of normal equations.

use super::foreground::{Frame, Sample};
use super::noise::{Factors, Noise, Score, ScoreCovariance, Scores};
use super::{Blob, Detection};
use crate::geometry::camera::Camera;
use crate::math::{Mat3, Vec3, ceil, floor, sqrt, symmetric};
use nalgebra::Vector2;

/// Residuals beyond this many standard deviations count linearly only (Huber).
const HUBER: f64 = 2.0;
/// Part of the radius within which depth is compared: nearer to the edge, noise decides which pixels show the ball.
const CAP: f64 = 0.85;
/// Half the width over which the silhouette's edge is compared, px: wide enough for its noise, narrow enough to see nothing else.
const BAND: f64 = 2.0;
/// Prior of how far the silhouette falls short of the disc because grazing rays return nothing: mean and standard deviation, px.
const SHORTFALL: (f64, f64) = (0.5, 1.0);
/// Pixels across, above which only every second, third, … pixel of a ball is read.
pub const PATCH: usize = 96;

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

/// Normal equations of one kind of evidence, H · step = g, and its residuals' part in two patterns that no ball has.
#[derive(Default)]
struct Equations {
    hessian: Mat3,
    gradient: Vec3,
    patterns: Vector2<f64>,
}

impl Equations {
    /// Adds a pixel; its score is what it would add to `gradient` and `patterns` for a residual of `sd`.
    fn add(&mut self, jacobian: &Vec3, pattern: &Vector2<f64>, residual: f64, weight: f64, sd: f64) -> Score {
        self.hessian += jacobian * jacobian.transpose() * weight;
        self.gradient += jacobian * (weight * residual);
        self.patterns += pattern * (weight * residual);
        Score::new(jacobian.x, jacobian.y, jacobian.z, pattern.x, pattern.y) * (weight * sd)
    }

    /// `scores` is the covariance of `gradient` as the correlated noise makes it. The estimate that these equations give has the information
    /// H S⁻¹ H, so that is what they count when they are joined with others.
    fn informed(&self, scores: &ScoreCovariance, factor: f64) -> Option<Self> {
        let scores: Mat3 = scores.fixed_view::<3, 3>(0, 0) * factor;
        let to_information = self.hessian * scores.try_inverse()?;
        let hessian = symmetric(&(to_information * self.hessian));
        Some(Self { hessian, gradient: to_information * self.gradient, patterns: self.patterns })
    }

    /// The patterns' mean square over its expectation: 1 where the noise is as modelled.
    fn check(&self, scores: &ScoreCovariance) -> f64 {
        let expected = scores.diagonal();
        0.5 * (self.patterns.x * self.patterns.x / expected[3] + self.patterns.y * self.patterns.y / expected[4])
    }
}

/// The twofold pattern of a direction (x, y): what an ellipse or a saddle has, and a ball has not.
fn twofold(x: f64, y: f64) -> Vector2<f64> {
    Vector2::new(x * x - y * y, 2.0 * x * y)
}

/// The threefold pattern of a direction: what a triangle has. Square windows leave twofold traces in a silhouette, but none of these.
fn threefold(x: f64, y: f64) -> Vector2<f64> {
    Vector2::new(x * (x * x - 3.0 * y * y), y * (3.0 * x * x - y * y))
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

/// What the pixels around a ball say, given a guess of it.
#[derive(Default)]
struct Evidence {
    cap: Equations,
    outline: Equations,
    /// Pixels that took part in `cap`, sums of their squared residuals: m², and in units of their variances.
    points: u32,
    squares: f64,
    normalized: f64,
    /// Pixels well inside the disc; of those, the ones that show the ball, and the ones that the background may hide.
    disc: u32,
    seen: u32,
    hidden: u32,
    /// Pixels of foreground at the ball's depth, in the disc or on its edge.
    mask: u32,
}

/// Pixels to look at: a rectangle, thinned where it is large.
struct Patch {
    left: usize,
    top: usize,
    columns: usize,
    rows: usize,
    stride: usize,
    cut: bool,
}

/// A guess that is being refined: center, and the silhouette's shortfall, m.
#[derive(Clone, Copy)]
struct Guess {
    center: Vec3,
    shortfall: f64,
}

/// How a ray passes a ball: the ray's length at which it is nearest to the center, how near it comes, m, and half its way inside (in lengths).
struct Chord {
    along: f64,
    offset: f64,
    half: f64,
}

impl Chord {
    #[inline]
    fn new(ray: &Vec3, center: &Vec3, radius: f64) -> Self {
        let ray_square = ray.norm_squared();
        let along = ray.dot(center) / ray_square;
        let offset_square = (center.norm_squared() - along * along * ray_square).max(0.0);
        Self { along, offset: sqrt(offset_square), half: sqrt(((radius * radius - offset_square) / ray_square).max(0.0)) }
    }
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

    fn patch(&self, center: &Vec3) -> Option<Patch> {
        let camera = self.camera;
        let (column, row) = camera.project(center)?;
        // The disc of a ball off the axis is an ellipse, longer by 1/cos of the angle; squared, it is on the safe side.
        let margin = self.radius * center.norm_squared() / (center.z * center.z * center.z);
        let (half_width, half_height) = (margin * camera.fx, margin * camera.fy);
        let span = |middle: f64, half: f64, size: usize| {
            let (low, high) = (floor(middle - half - BAND - 1.0), ceil(middle + half + BAND + 2.0));
            let range = low.clamp(0.0, size as f64) as usize..high.clamp(0.0, size as f64) as usize;
            (range, middle - half < 0.0 || middle + half > size as f64 - 1.0)
        };
        let (columns, cut_x) = span(column, half_width, camera.width);
        let (rows, cut_y) = span(row, half_height, camera.height);
        if columns.is_empty() || rows.is_empty() {
            return None;
        }
        let stride = columns.len().max(rows.len()).div_ceil(PATCH);
        Some(Patch {
            left: columns.start,
            top: rows.start,
            columns: columns.len().div_ceil(stride),
            rows: rows.len().div_ceil(stride),
            stride,
            cut: cut_x || cut_y,
        })
    }

    /// The ray through a pixel of the patch, and the pixel's index.
    #[inline]
    fn ray(&self, patch: &Patch, x: usize, y: usize) -> (Vec3, usize) {
        let (column, row) = (patch.left + x * patch.stride, patch.top + y * patch.stride);
        (self.camera.deproject(column as f64, row as f64, 1.0), row * self.camera.width + column)
    }

    /// Fills `cap` with the depth that each pixel of the patch shows, less the center's, m: the mean of the surface over the matching window.
    fn render(&self, patch: &Patch, center: &Vec3, scores: &mut [[f32; 5]], cap: &mut [f32]) -> Option<()> {
        let mut surface = Scores::<2>::new(scores, patch.columns, patch.rows, self.window(patch))?;
        for y in 0..patch.rows {
            for x in 0..patch.columns {
                let chord = Chord::new(&self.ray(patch, x, y).0, center, self.radius);
                if chord.half > 0.0 {
                    surface.set(x, y, [chord.along - chord.half - center.z, 1.0]);
                }
            }
        }
        surface.means(|x, y, mean| {
            if let Some(depth) = cap.get_mut(y * patch.columns + x) {
                *depth = mean;
            }
        });
        Some(())
    }

    /// The matching window, in pixels of the patch.
    fn window(&self, patch: &Patch) -> [usize; 2] {
        self.noise.window.map(|edge| edge.div_ceil(patch.stride))
    }

    /// The depth that a pixel of the patch shows, less the center's, and its derivatives by the center; `None` at the edge.
    fn surface(&self, patch: &Patch, center: &Vec3, cap: &[f32], x: usize, y: usize) -> Option<(f64, Vec3)> {
        let at = |x: usize, y: usize| cap.get(y * patch.columns + x).map(|z| f64::from(*z)).filter(|z| !z.is_nan());
        // Moving the ball moves the picture of its cap: by the center's derivatives, the depth changes as it does from pixel to pixel.
        let slope = |before: Option<f64>, after: Option<f64>, f: f64| Some((before? - after?) * f / (2.0 * patch.stride as f64 * center.z));
        let right = slope(at(x.checked_sub(1)?, y), at(x + 1, y), self.camera.fx)?;
        let down = slope(at(x, y.checked_sub(1)?), at(x, y + 1), self.camera.fy)?;
        let along = 1.0 - (right * center.x + down * center.y) / center.z;
        Some((at(x, y)?, Vec3::new(right, down, along)))
    }

    /// Compares the image with a guess. `cap` is what [`View::render`] made of it. `score` is told, for each pixel of the patch, its part in the
    /// two gradients times the standard deviation of its noise. `across` are two directions across the line of sight, in which the silhouette
    /// is measured.
    fn compare(
        &self,
        patch: &Patch,
        guess: &Guess,
        across: &[Vec3; 2],
        cap: &[f32],
        mut score: impl FnMut(usize, usize, &Score, &Score),
    ) -> Evidence {
        let (noise, radius) = (self.noise, self.radius);
        let Guess { center, shortfall } = *guess;
        let scale = self.scale(center.z);
        let near = 2.0 * Self::jump(radius) + 4.0 * noise.axial(center.z);
        let mut evidence = Evidence::default();
        for y in 0..patch.rows {
            for x in 0..patch.columns {
                let (ray, index) = self.ray(patch, x, y);
                let Chord { along, offset, half } = Chord::new(&ray, &center, radius);
                let inside = (radius - shortfall - offset) * scale;
                if inside < -BAND {
                    continue;
                }
                let reading = self.frame.foreground(index);
                let surface = along - half;
                let shows = reading.is_some_and(|z| z > surface - near && z < center.z + near);
                evidence.mask += u32::from(shows);
                let mut scores = [Score::zeros(); 2];

                if let (Some(z), Some((depth, jacobian))) = (reading, self.surface(patch, &center, cap, x, y))
                    && offset < CAP * radius
                {
                    let residual = z - center.z - depth;
                    let slope_square = jacobian.x * jacobian.x + jacobian.y * jacobian.y;
                    let (axial, lateral) = (noise.axial(center.z), noise.lateral(1.0 / sqrt(1.0 + slope_square)) / scale);
                    let variance = axial * axial + lateral * lateral * slope_square;
                    if residual.abs() < near {
                        let normalized = residual.abs() / sqrt(variance);
                        let weight = (HUBER / normalized).min(1.0) / variance;
                        let radial = (ray * along - center) / radius;
                        let pattern = twofold(radial.dot(&across[0]), radial.dot(&across[1]));
                        scores[0] = evidence.cap.add(&jacobian, &pattern, residual, weight, sqrt(variance));
                        evidence.points += 1;
                        evidence.squares += residual * residual;
                        evidence.normalized += normalized * normalized;
                    }
                }

                let hidden = || self.frame.limit(index) < surface + 2.0 * noise.axial(surface);
                if inside > 1.0 {
                    evidence.disc += 1;
                    evidence.seen += u32::from(shows);
                    evidence.hidden += u32::from(!shows && hidden());
                } else if inside < BAND
                    && offset > 0.0
                    && (shows || !(hidden() || self.frame.reading(index).is_some_and(|z| z < surface - near)))
                {
                    // Inside the band the share of the ball in a pixel falls linearly from 1 to 0.
                    let slope = scale / (2.0 * BAND);
                    let residual = f64::from(u8::from(shows)) - (0.5 + inside / (2.0 * BAND));
                    let outward = (ray * along - center) / offset;
                    let (right, down) = (outward.dot(&across[0]), outward.dot(&across[1]));
                    let jacobian = Vec3::new(right, down, -1.0) * slope;
                    let sd = noise.lateral(1.0) / (2.0 * BAND);
                    scores[1] = evidence.outline.add(&jacobian, &(threefold(right, down) * slope), residual, 1.0, sd);
                }
                score(x, y, &scores[0], &scores[1]);
            }
        }
        evidence
    }

    /// Fits the ball from a first guess of its center, camera frame, m; `pixels` is how many its component has. `None` where no ball of this
    /// radius looks like that.
    pub fn fit(&self, start: Vec3, pixels: u32, scores: &mut [[f32; 5]], cap: &mut [f32]) -> Option<Found> {
        let mut guess = Guess { center: start, shortfall: SHORTFALL.0 / self.scale(start.z) };
        for _ in 0..2 {
            let patch = self.patch(&guess.center)?;
            self.render(&patch, &guess.center, scores, cap)?;
            let evidence = self.compare(&patch, &guess, &across(&guess.center), cap, |_, _, _, _| ());
            // Along the line of sight only: across it, the silhouette knows better.
            let sight = guess.center.normalize();
            let information = sight.dot(&(evidence.cap.hessian * sight));
            guess.center = self.moved(&guess.center, &(sight * (sight.dot(&evidence.cap.gradient) / information)))?;
        }
        let across = across(&guess.center);
        let patch = self.patch(&guess.center)?;
        self.render(&patch, &guess.center, scores, cap)?;
        let mut pixel_scores = Scores::new(scores, patch.columns, patch.rows, self.window(&patch))?;
        self.compare(&patch, &guess, &across, cap, |x, y, cap, _| pixel_scores.set(x, y, (*cap).into()));
        let cap_scores = pixel_scores.covariance();
        let mut pixel_scores = Scores::new(scores, patch.columns, patch.rows, self.window(&patch))?;
        let mut evidence = self.compare(&patch, &guess, &across, cap, |x, y, _, outline| pixel_scores.set(x, y, (*outline).into()));
        let outline_scores = pixel_scores.covariance();
        let mut covariance = Mat3::zeros();
        for _ in 0..3 {
            let mut joint = evidence.cap.informed(&cap_scores, self.factors.cap.value())?;
            if let Some((outline, shortfall)) = self.outline(&evidence.outline, &outline_scores, &guess, &across) {
                joint.hessian += outline.hessian;
                joint.gradient += outline.gradient;
                guess.shortfall += shortfall;
            }
            let solver = joint.hessian.cholesky()?;
            covariance = symmetric(&solver.inverse());
            let step = solver.solve(&joint.gradient);
            guess.center = self.moved(&guess.center, &step)?;
            self.render(&patch, &guess.center, scores, cap)?;
            evidence = self.compare(&patch, &guess, &across, cap, |_, _, _, _| ());
            if step.norm() < 1e-2 * sqrt(covariance.trace()) {
                break;
            }
        }
        let detection = self.judge(&evidence, &guess, covariance, &patch, pixels)?;
        Some(Found { detection, cap_ratio: evidence.cap.check(&cap_scores), outline_ratio: evidence.outline.check(&outline_scores) })
    }

    /// What the silhouette says of the center, after its shortfall has been estimated too; and that estimate's step, m.
    fn outline(&self, equations: &Equations, scores: &ScoreCovariance, guess: &Guess, across: &[Vec3; 2]) -> Option<(Equations, f64)> {
        let mut informed = equations.informed(scores, self.factors.outline.value())?;
        let scale = self.scale(guess.center.z);
        let prior = scale * scale / (SHORTFALL.1 * SHORTFALL.1);
        informed.hessian[(2, 2)] += prior;
        informed.gradient.z += prior * (SHORTFALL.0 / scale - guess.shortfall);
        let (h, g) = (&informed.hessian, &informed.gradient);
        let step = h.cholesky()?.solve(g);
        let to_camera = nalgebra::Matrix3x2::from_columns(across);
        let coupling = h.fixed_view::<2, 1>(0, 2) / h[(2, 2)];
        let hessian = h.fixed_view::<2, 2>(0, 0) - coupling * h.fixed_view::<1, 2>(2, 0);
        let gradient = g.fixed_rows::<2>(0) - coupling * g.z;
        let hessian = to_camera * hessian * to_camera.transpose();
        Some((Equations { hessian, gradient: to_camera * gradient, patterns: Vector2::zeros() }, step.z))
    }

    /// The center after a step; `None` where it leaves what can be.
    fn moved(&self, center: &Vec3, step: &Vec3) -> Option<Vec3> {
        let moved = center + step;
        (step.norm() < 2.0 * self.radius && moved.z > self.radius && moved.z < self.camera.max_depth + self.radius).then_some(moved)
    }

    fn judge(&self, evidence: &Evidence, guess: &Guess, covariance: Mat3, patch: &Patch, pixels: u32) -> Option<Detection> {
        let thinned = (patch.stride * patch.stride) as f64;
        let (points, disc) = (f64::from(evidence.points), f64::from(evidence.disc));
        let finite = guess.center.iter().chain(covariance.iter()).all(|x| x.is_finite());
        if evidence.points < 6 || evidence.normalized > 6.0 * points || f64::from(evidence.seen) < 0.25 * disc || !finite {
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
            radius: self.radius,
            points: evidence.points,
            residual_rms: sqrt(evidence.squares / points),
            row,
            blob,
        })
    }
}

/// Two unit vectors across the line of sight to `center`.
fn across(center: &Vec3) -> [Vec3; 2] {
    let sight = center.normalize();
    let right = Vec3::y().cross(&sight).normalize();
    [right, sight.cross(&right)]
}
