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

/// The scale at which `samples` (in units, sorted by time) fall at `gravity` (m/s²) in air of `drag` (k of a = g − k |v| v, 1/m). With
/// `noise_known` their weights hold, else their residuals tell one standard deviation for all. `scratch` takes 3 numbers for each sample;
/// `samples` become metres about the first of them.
///
/// Drag is known in metres, so the scale is found by turns: the flight in metres of the last turn tells by its own gravity how wrong those
/// metres were. The size of gravity and the drag are taken for exact: 9.81 is within 0.3 % anywhere on Earth.
///
/// # Errors
/// What isn't a flight.
pub fn fit_scale(samples: &mut [Sample], gravity: f64, drag: f64, noise_known: bool, scratch: &mut [f64]) -> Result<Scale, NoScale> {
    let law = FreeFallWithDrag { drag };
    let noise = if noise_known { None } else { watch::noise(samples, scratch) };
    let extent = extent(samples);
    let parabola = Parabola::fit(samples).ok_or(NoScale::Straight)?;
    let (bend, origin) = (2.0 * parabola.coefficients.column(2).norm(), samples[0].position);
    let span = samples[samples.len() - 1].t - samples[0].t;
    // Less than this is rounding.
    if !(bend * span * span > 1e-9 * extent) {
        return Err(NoScale::Straight);
    }
    for sample in samples.iter_mut() {
        sample.position -= origin;
    }
    let mut scale = 1.0;
    let mut next = gravity / bend;
    let mut fall = None;
    for _ in 0..30 {
        stretch(samples, next);
        scale *= next;
        let found = Fall::fit(&law, samples, noise_known).ok_or(NoScale::Straight)?;
        next = gravity / found.size;
        fall = Some(found);
        if (next - 1.0).abs() < (1e-3 * found.relative_sd).max(1e-12) {
            break;
        }
    }
    let fall = fall
        .filter(|f| f.relative_sd * SIGNIFICANT < 1.0 && (next - 1.0).abs() < 0.1 * f.relative_sd.max(1e-6))
        .ok_or(NoScale::Straight)?;
    let residual_sd = fall.residual_sd / scale;
    let noise = noise.unwrap_or(if noise_known { residual_sd / sqrt(fall.excess) } else { residual_sd });
    if residual_sd > MISFIT * if noise_known { noise } else { noise.max(SMOOTH * extent) } {
        return Err(NoScale::NoFlight { residual_sd, noise });
    }
    // How gravity's size follows the scale: in proportion, and a little more by drag.
    const STEP: f64 = 0.01;
    stretch(samples, 1.0 + STEP);
    let moved = Fall::fit(&law, samples, noise_known).ok_or(NoScale::Straight)?;
    let slope = log(moved.size / fall.size) / log(1.0 + STEP);
    let dof = 3 * samples.len() - 9;
    // Noise that its own few residuals tell may be larger (Student's t).
    let widened = if noise_known { fall.excess.max(1.0) } else { dof as f64 / (dof as f64 - 2.0) };
    let relative = fall.relative_sd * sqrt(widened) / slope.max(0.5);
    Ok(Scale { scale, sd: scale * relative, down: fall.down, residual_sd, dof })
}

/// What one flight says of gravity.
#[derive(Clone, Copy)]
struct Fall {
    size: f64,
    /// Of `size`, over it.
    relative_sd: f64,
    down: Vec3,
    residual_sd: f64,
    /// Squared residuals over what the noise that was told lets expect.
    excess: f64,
}

impl Fall {
    fn fit(law: &FreeFallWithDrag, samples: &mut [Sample], noise_known: bool) -> Option<Self> {
        let free = Gravity::free(None);
        let flight = if noise_known { Flight::fit_fully(law, samples, &free)? } else { Flight::fit_with_noise(law, samples, &free)?.0 };
        let size = flight.gravity.norm();
        let down = flight.gravity.try_normalize(1e-9)?;
        let covariance: Mat3 = flight.covariance.fixed_view::<3, 3>(6, 6).into();
        let dof = 3.0 * samples.len() as f64 - 9.0;
        let squares: f64 = flight.residuals(law, samples).map(|r| r.norm_squared()).sum();
        let relative_sd = sqrt(down.dot(&(covariance * down))) / size;
        Some(Self { size, relative_sd, down, residual_sd: sqrt(squares / dof), excess: flight.chi2 / dof })
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
                    let found = fit_scale(&mut thrown(scale, drag), 9.81, drag, known, &mut [0.0; 60]).unwrap();
                    assert!((found.scale / scale - 1.0).abs() < 2e-5, "{scale} {drag} {known}: {found:?}");
                    assert!((found.down - down).norm() < 1e-4, "{}", found.down);
                }
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
        assert_eq!(fit_scale(&mut straight.clone(), 9.81, 0.0, true, &mut [0.0; 60]), Err(NoScale::Straight));
        assert_eq!(fit_scale(&mut straight, 9.81, 0.0, false, &mut [0.0; 60]), Err(NoScale::Straight));
        let mut bouncing = thrown(0.5, 0.0);
        let mirror = bouncing[10].position;
        for sample in &mut bouncing[11..] {
            sample.position = mirror + (mirror - sample.position) * 0.8;
        }
        for known in [false, true] {
            let found = fit_scale(&mut bouncing.clone(), 9.81, 0.0, known, &mut [0.0; 60]);
            assert!(matches!(found, Err(NoScale::NoFlight { .. })), "{found:?}");
        }
    }
}
