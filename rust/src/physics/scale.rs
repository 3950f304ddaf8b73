//! Metres per unit of a trajectory that is known up to scale, as structure from motion knows it: what falls, falls at |g| (sec. 3.1's
//! remark on structure from motion).

use crate::math::{Mat3, Vec3, log, sqrt};
use crate::physics::Sample;
use crate::physics::flight::Flight;
use crate::physics::gravity::Gravity;
use crate::physics::law::FreeFallWithDrag;
use crate::physics::paper::Parabola;
use crate::physics::watch;

/// A trajectory's scale.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scale {
    /// Metres per unit.
    pub scale: f64,
    /// Its standard deviation, m per unit.
    pub sd: f64,
    /// Where gravity pulls, unit vector in the trajectory's axes.
    pub down: Vec3,
    /// The drag it holds with, 1/m.
    pub drag: f64,
    /// What positions are off the flight, units an axis.
    pub residual_sd: f64,
    /// Numbers measured, less those that were found out.
    pub dof: usize,
}

/// Why a trajectory has no scale.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum NoScale {
    /// Its acceleration can't be told from none: it moves at constant velocity, or wasn't seen long enough.
    Straight,
    /// No one flight fits: `residual_sd` off it, where its noise is `noise`, units an axis.
    NoFlight {
        /// Off the best flight.
        residual_sd: f64,
        /// As told, or as the third differences show it.
        noise: f64,
    },
}

/// An acceleration must be so many standard deviations from none: its chance is below 1e-6, and σ of the scale below 17 %.
const SIGNIFICANT: f64 = 6.0;
/// What is off a flight by more than so many times its noise is none; up to there the standard deviation is widened.
const MISFIT: f64 = 3.0;
/// A part of a flight's extent by which a tracker may be off smoothly, which third differences don't show.
pub const SMOOTH: f64 = 2e-3;
/// By how much a scale is varied to see what follows.
const STEP: f64 = 0.01;
/// More drag than this has no ball, 1/m: it would fall no faster than 3 m/s.
const MOST_DRAG: f64 = 1.0;

/// What is known of an object's drag: k of a = g − k |v| v, 1/m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drag {
    /// Best guess.
    pub mean: f64,
    /// Its standard deviation; 0 where it is known.
    pub sd: f64,
}

impl Drag {
    /// Of some thing that is thrown: a stone has next to none, a football 0.013, a tennis ball 0.019; of lighter ones the flight itself tells.
    pub const UNKNOWN: Self = Self { mean: 0.02, sd: 0.02 };
}

/// The scale at which `samples` (in units, sorted by time) fall at `gravity` (m/s²) with `drag`. With `noise_known` their weights hold, else
/// their residuals tell one standard deviation for all. `scratch` takes 3 numbers for each sample; `samples` are moved to the first of them.
///
/// Drag is known in metres, so the scale is found by turns: the flight in metres of the last turn tells by its own gravity how wrong those
/// metres were. Drag that isn't known is found along, by how well the flight fits, and what is left open of it widens the scale's standard
/// deviation. The size of gravity is taken for exact: 9.81 is within 0.3 % anywhere on Earth.
///
/// # Errors
/// What isn't a flight.
pub fn fit_scale(samples: &mut [Sample], gravity: f64, drag: Drag, noise_known: bool, scratch: &mut [f64]) -> Result<Scale, NoScale> {
    let noise = if noise_known { None } else { watch::noise(samples, scratch) };
    let extent = extent(samples);
    let parabola = Parabola::fit(samples).ok_or(NoScale::Straight)?;
    let (bend, origin) = (2.0 * parabola.coefficients.column(2).norm(), samples[0].position);
    let span = samples[samples.len() - 1].t - samples[0].t;
    // Less than this is rounding.
    if bend * span * span <= 1e-9 * extent {
        return Err(NoScale::Straight);
    }
    for sample in samples.iter_mut() {
        sample.position -= origin;
    }
    let dof = 3 * samples.len() - 9;
    let mut problem = Problem { samples, gravity, noise_known, guess: gravity / bend };
    let (drag, open) = problem.drag(drag).ok_or(NoScale::Straight)?;
    let found = problem.at(drag).ok_or(NoScale::Straight)?;
    let residual_sd = sqrt(found.squares / dof as f64);
    let noise = noise.unwrap_or(if noise_known { residual_sd / sqrt(found.excess) } else { residual_sd });
    if residual_sd > MISFIT * if noise_known { noise } else { noise.max(SMOOTH * extent) } {
        return Err(NoScale::NoFlight { residual_sd, noise });
    }
    // Noise that its own few residuals tell may be larger (Student's t).
    let widened = if noise_known { found.excess.max(1.0) } else { dof as f64 / (dof as f64 - 2.0) };
    let sd = found.scale * sqrt(found.relative_sd * found.relative_sd + open * open) * sqrt(widened);
    Ok(Scale { scale: found.scale, sd, down: found.down, drag, residual_sd, dof })
}

/// Samples in units about the first of them, and what is known.
struct Problem<'a> {
    samples: &'a mut [Sample],
    gravity: f64,
    noise_known: bool,
    /// The newest scale.
    guess: f64,
}

/// The scale under one drag.
struct Found {
    scale: f64,
    /// Of `scale`, over it.
    relative_sd: f64,
    down: Vec3,
    /// Sum of squared residuals, units².
    squares: f64,
    /// Squared residuals over what the noise that was told lets expect.
    excess: f64,
}

impl Problem<'_> {
    /// The scale under drag `k` (1/m); `None` where there is none to speak of.
    fn at(&mut self, k: f64) -> Option<Found> {
        let law = FreeFallWithDrag { drag: k };
        let (mut scale, mut next, mut fall) = (1.0, self.guess, None);
        for _ in 0..30 {
            stretch(self.samples, next);
            scale *= next;
            fall = Fall::fit(law, self.samples, self.noise_known);
            let Some(found) = fall else { break };
            next = self.gravity / found.size;
            if (next - 1.0).abs() < (1e-3 * found.relative_sd).max(1e-12) {
                break;
            }
        }
        // How gravity's size follows the scale: in proportion, and a little more by drag.
        stretch(self.samples, 1.0 + STEP);
        let moved = Fall::fit(law, self.samples, self.noise_known);
        stretch(self.samples, 1.0 / (scale * (1.0 + STEP)));
        let (fall, moved) = (fall?, moved?);
        if !(fall.relative_sd * SIGNIFICANT < 1.0 && (next - 1.0).abs() < 0.1 * fall.relative_sd.max(1e-6)) {
            return None;
        }
        let slope = log(moved.size / fall.size) / log(1.0 + STEP);
        self.guess = scale;
        let squares = fall.squares / (scale * scale);
        Some(Found { scale, relative_sd: fall.relative_sd / slope.max(0.5), down: fall.down, squares, excess: fall.excess })
    }

    /// The most probable drag, 1/m, and by how much what is left open of it moves the scale (standard deviation over the scale).
    fn drag(&mut self, known: Drag) -> Option<(f64, f64)> {
        if known.sd <= 0.0 {
            return Some((known.mean, 0.0));
        }
        let dof = 3.0 * self.samples.len() as f64 - 9.0;
        let (mut k, step) = (known.mean, 0.1 * known.sd);
        let mut open = 0.0;
        // Newton's steps: the cost is nearly a parabola.
        for _ in 0..8 {
            let [less, here, more] = [self.at(k - step)?, self.at(k)?, self.at(k + step)?];
            // As of a flight's noise: no less than 1 µm.
            let variance = (here.squares / dof).max(1e-12 / (here.scale * here.scale));
            let cost = |found: &Found, k: f64| {
                let misfit = if self.noise_known { found.excess * dof / here.excess.max(1.0) } else { found.squares / variance };
                let off = (k - known.mean) / known.sd;
                misfit + off * off
            };
            let [a, b, c] = [cost(&less, k - step), cost(&here, k), cost(&more, k + step)];
            let curvature = ((a - 2.0 * b + c) / (step * step)).max(2.0 / (known.sd * known.sd));
            let sd = sqrt(2.0 / curvature);
            open = sd * (log(more.scale / less.scale) / (2.0 * step)).abs();
            let next = (k - (c - a) / (2.0 * step) / curvature).clamp(0.0, MOST_DRAG);
            let moved = (next - k).abs();
            k = next;
            if moved < 0.02 * sd {
                break;
            }
        }
        Some((k, open))
    }
}

/// What one flight says of gravity.
#[derive(Clone, Copy)]
struct Fall {
    size: f64,
    /// Of `size`, over it.
    relative_sd: f64,
    down: Vec3,
    /// Sum of squared residuals, m².
    squares: f64,
    /// Squared residuals over what the noise that was told lets expect.
    excess: f64,
}

impl Fall {
    fn fit(law: FreeFallWithDrag, samples: &mut [Sample], noise_known: bool) -> Option<Self> {
        let law = &law;
        let free = Gravity::free(None);
        let flight = if noise_known { Flight::fit_fully(law, samples, &free)? } else { Flight::fit_with_noise(law, samples, &free)?.0 };
        let size = flight.gravity.norm();
        let down = flight.gravity.try_normalize(1e-9)?;
        let covariance: Mat3 = flight.covariance.fixed_view::<3, 3>(6, 6).into();
        let dof = 3.0 * samples.len() as f64 - 9.0;
        let squares: f64 = flight.residuals(law, samples).map(|r| r.norm_squared()).sum();
        let relative_sd = sqrt(down.dot(&(covariance * down))) / size;
        Some(Self { size, relative_sd, down, squares, excess: flight.chi2 / dof })
    }
}

/// Largest distance from the first sample, units.
pub fn extent(samples: &[Sample]) -> f64 {
    samples.first().map_or(0.0, |first| samples.iter().map(|s| (s.position - first.position).norm()).fold(0.0, f64::max))
}

fn stretch(samples: &mut [Sample], factor: f64) {
    for sample in samples {
        sample.position *= factor;
        sample.weight /= factor * factor;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::physics::law::State;

    /// 20 frames of a thrown ball in units of `scale` metres, in turned axes.
    fn thrown(scale: f64, drag: f64) -> [Sample; 20] {
        let turn = nalgebra::Rotation3::from_euler_angles(0.4, -1.1, 2.0);
        let start = State { t: 3.0, position: Vec3::new(0.5, 2.0, 1.0), velocity: Vec3::new(2.0, -1.0, 3.0) };
        let law = FreeFallWithDrag { drag };
        core::array::from_fn(|i| {
            let t = 3.0 + i as f64 / 30.0;
            let position = turn * start.at(t, &law, &Vec3::new(0.0, 0.0, -9.81)).position / scale + Vec3::new(70.0, -3.0, 8.0) / scale;
            Sample::isotropic(t, position, 1e-3 / scale)
        })
    }

    #[test]
    fn an_exact_flight_has_its_scale_whatever_its_units() {
        let down = nalgebra::Rotation3::from_euler_angles(0.4, -1.1, 2.0) * -Vec3::z();
        for scale in [1e-4, 0.37, 1.0, 52.0] {
            for drag in [0.0, 0.019, 0.13] {
                for known in [false, true] {
                    let found = fit_scale(&mut thrown(scale, drag), 9.81, Drag { mean: drag, sd: 0.0 }, known, &mut [0.0; 60]).unwrap();
                    assert!((found.scale / scale - 1.0).abs() < 2e-5, "{scale} {drag} {known}: {found:?}");
                    assert!((found.down - down).norm() < 1e-4, "{}", found.down);
                }
            }
        }
    }

    const NONE: Drag = Drag { mean: 0.0, sd: 0.0 };

    #[test]
    fn an_exact_flight_tells_its_drag_too() {
        for drag in [0.0, 0.019, 0.13] {
            for known in [false, true] {
                let found = fit_scale(&mut thrown(0.4, drag), 9.81, Drag::UNKNOWN, known, &mut [0.0; 60]).unwrap();
                // With noise of a millimetre, as some are told, the guess counts.
                let within = if known { 2.0 * found.sd } else { 1e-4 * 0.4 };
                assert!((found.scale - 0.4).abs() < within, "{drag} {known}: {found:?}");
                assert!(known || (found.drag - drag).abs() < 1e-3, "{found:?}");
            }
        }
    }

    #[test]
    fn what_moves_straight_or_bounces_has_none() {
        let mut straight: [Sample; 20] = core::array::from_fn(|i| {
            let t = i as f64 / 30.0;
            let wobble = if i % 3 == 0 { 1e-3 } else { -1e-3 };
            Sample::isotropic(t, Vec3::new(1.0 + 2.0 * t, wobble, -t), 1e-3)
        });
        assert_eq!(fit_scale(&mut straight.clone(), 9.81, NONE, true, &mut [0.0; 60]), Err(NoScale::Straight));
        assert_eq!(fit_scale(&mut straight, 9.81, NONE, false, &mut [0.0; 60]), Err(NoScale::Straight));
        let mut bouncing = thrown(0.5, 0.0);
        let mirror = bouncing[10].position;
        for sample in &mut bouncing[11..] {
            sample.position = mirror + (mirror - sample.position) * 0.8;
        }
        for known in [false, true] {
            let found = fit_scale(&mut bouncing.clone(), 9.81, NONE, known, &mut [0.0; 60]);
            assert!(matches!(found, Err(NoScale::NoFlight { .. })), "{found:?}");
        }
    }
}
