//! The paper's own estimators, for comparison: finite differences, one-step predictions, two free parabolas.

use crate::math::{Mat3, Vec3};
use crate::physics::Sample;
use crate::physics::contact::Contact;
use heapless::Vec;
use nalgebra::{Matrix3, SMatrix, Vector3};

/// Eq. 4: the velocity between two measurements, m/s; `None` where no time passed.
pub fn velocity(a: &Sample, b: &Sample) -> Option<Vec3> {
    let dt = b.t - a.t;
    (dt > 0.0).then(|| (b.position - a.position) / dt)
}

/// Eq. 4 twice: the frame-wise acceleration at the last of three measurements, m/s².
pub fn acceleration(a: &Sample, b: &Sample, c: &Sample) -> Option<Vec3> {
    Some((velocity(b, c)? - velocity(a, b)?) / (c.t - b.t))
}

/// The mean of the frame-wise accelerations (m/s²) of a flight, and its covariance. It telescopes: of equally spaced measurements only the first two
/// and the last two count. `None` for fewer than 4 or more than 128, or where time stands still.
pub fn mean_acceleration(samples: &[Sample]) -> Option<(Vec3, Mat3)> {
    // How much each measurement weighs in it.
    let mut weights: Vec<f64, 128> = samples.iter().map(|_| 0.0).take(128).collect();
    let count = samples.len().checked_sub(2).filter(|count| *count >= 2 && weights.len() == samples.len())? as f64;
    for (pieces, w) in samples.windows(3).zip(0..) {
        let (first, second) = (pieces[1].t - pieces[0].t, pieces[2].t - pieces[1].t);
        for (weight, gain) in weights.iter_mut().skip(w).zip([1.0 / first, -1.0 / first - 1.0 / second, 1.0 / second]) {
            *weight += gain / (second * count);
        }
    }
    let mean: Vec3 = samples.iter().zip(&weights).map(|(s, w)| s.position * *w).sum();
    let covariance = samples.iter().zip(&weights).map(|(s, w)| s.covariance() * (w * w)).sum();
    mean.iter().all(|x| x.is_finite()).then_some((mean, covariance))
}

/// Eq. 5: the center at time `t` (s) from the last two measurements and `gravity` (m/s²).
pub fn predict(a: &Sample, b: &Sample, t: f64, gravity: &Vec3) -> Option<Vec3> {
    let dt = t - b.t;
    Some(b.position + velocity(a, b)? * dt + gravity * (0.5 * dt * dt))
}

/// A parabola through measurements, every axis free: c0 + c1 (t − epoch) + c2 (t − epoch)².
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parabola {
    /// Reference time, s.
    pub epoch: f64,
    /// Columns c0, c1, c2.
    pub coefficients: Matrix3<f64>,
}

impl Parabola {
    /// Unweighted least squares; `None` for fewer than three distinct times.
    pub fn fit(samples: &[Sample]) -> Option<Self> {
        let epoch = samples.first()?.t;
        let (mut normal, mut right) = (Matrix3::zeros(), Matrix3::zeros());
        for sample in samples {
            let s = sample.t - epoch;
            let row = Vector3::new(1.0, s, s * s);
            normal += row * row.transpose();
            right += sample.position * row.transpose();
        }
        let inverse = normal.try_inverse().filter(|_| samples.len() >= 3)?;
        Some(Self { epoch, coefficients: right * inverse })
    }

    /// Center at `t`, m.
    pub fn position(&self, t: f64) -> Vec3 {
        let s = t - self.epoch;
        self.coefficients * Vec3::new(1.0, s, s * s)
    }

    /// Velocity at `t`, m/s.
    pub fn velocity(&self, t: f64) -> Vec3 {
        let s = t - self.epoch;
        self.coefficients * Vec3::new(0.0, 1.0, 2.0 * s)
    }
}

/// Measurements on each side that its parabolas are fitted to ("a few").
pub const SIDE: usize = 8;

/// The paper's contact: parabolas of a few measurements before and after, their closest points, the tangents there.
/// It knows no uncertainty: its covariance is infinite.
pub fn contact(before: &[Sample], after: &[Sample]) -> Option<Contact> {
    let before = &before[before.len().saturating_sub(SIDE)..];
    let after = &after[..after.len().min(SIDE)];
    let (p, q) = (Parabola::fit(before)?, Parabola::fit(after)?);
    let (last, first) = (before.last()?.t, after.first()?.t);
    let t = closest_approach(&p, &q, last, first);
    Some(Contact {
        time: t,
        center: (p.position(t) + q.position(t)) * 0.5,
        before: p.velocity(t),
        after: q.velocity(t),
        gravity: p.coefficients.column(2) + q.coefficients.column(2),
        covariance: SMatrix::from_diagonal_element(f64::INFINITY),
        time_sd: f64::INFINITY,
        chi2: f64::NAN,
        log_evidence: f64::NAN,
        counts: [before.len(), after.len()],
    })
}

/// When two parabolas are closest, in and around `from..=to`. (Closest as curves, without time, they are badly determined where
/// the ball bounces back the way it came.)
fn closest_approach(p: &Parabola, q: &Parabola, from: f64, to: f64) -> f64 {
    const GRID: i32 = 60;
    let margin = 0.5 * (to - from);
    let (low, high) = (from - margin, to + margin);
    let distance = |t: &f64| (p.position(*t) - q.position(*t)).norm_squared();
    let grid = (0..=GRID).map(|i| low + (high - low) * f64::from(i) / f64::from(GRID));
    let mut t = grid.min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap_or(from);
    for _ in 0..10 {
        let (r, v) = (p.position(t) - q.position(t), p.velocity(t) - q.velocity(t));
        t = (t - r.dot(&v) / v.norm_squared().max(1e-12)).clamp(low, high);
    }
    t
}

/// The normal of the paper's little surface, which lies along the motion just before and after: halfway between the reversed
/// tangent before and the tangent after.
pub fn normal(contact: &Contact) -> Option<Vec3> {
    (contact.after.try_normalize(1e-9)? - contact.before.try_normalize(1e-9)?).try_normalize(1e-9)
}

#[cfg(test)]
mod tests {
    use super::*;

    const G: Vec3 = Vec3::new(0.0, 0.0, -9.81);

    fn throw(t: f64, from: Vec3, v: Vec3) -> Sample {
        Sample::isotropic(t, from + v * t + 0.5 * G * t * t, 1e-3)
    }

    #[test]
    fn eq_4_and_eq_5_hold_on_a_parabola() {
        let s: [Sample; 3] = core::array::from_fn(|i| throw(i as f64 / 30.0, Vec3::zeros(), Vec3::new(1.0, 2.0, 3.0)));
        assert!((acceleration(&s[0], &s[1], &s[2]).unwrap() - G).norm() < 1e-9);
        // Eq. 5 with the mean velocity of the last step lags by g dt²/2 · 2: the paper's own approximation.
        let lag = predict(&s[0], &s[1], s[2].t, &G).unwrap() - s[2].position;
        assert!((lag - G * (-0.5 / 900.0)).norm() < 1e-9);
        assert_eq!(acceleration(&s[0], &s[1], &s[1]), None);
    }

    #[test]
    fn the_mean_of_frame_wise_accelerations_telescopes() {
        let s: [Sample; 20] = core::array::from_fn(|i| throw(i as f64 / 30.0, Vec3::zeros(), Vec3::new(1.0, 2.0, 3.0)));
        let (mean, covariance) = mean_acceleration(&s).unwrap();
        assert!((mean - G).norm() < 1e-9);
        // ((p₂₀ − p₁₉) − (p₂ − p₁)) / (18 dt²)
        assert!((covariance[(0, 0)] / (4.0 * (1e-3 * 900.0 / 18.0_f64).powi(2)) - 1.0).abs() < 1e-9);
        let mut moved = s;
        moved[9].position.x += 1.0;
        assert!((mean_acceleration(&moved).unwrap().0 - G).norm() < 1e-9);
        assert!(mean_acceleration(&s[..3]).is_none() && mean_acceleration(&[s[0]; 5]).is_none());
    }

    #[test]
    fn two_parabolas_meet_at_the_bounce() {
        let hit = Vec3::new(0.2, 1.5, 0.033);
        let sample = |i: i32| {
            let t = f64::from(i) / 30.0 - 0.2811;
            throw(t, hit, if t < 0.0 { Vec3::new(1.0, 0.2, -3.0) } else { Vec3::new(0.7, 0.1, 2.2) })
        };
        let all: heapless::Vec<Sample, 16> = (0..16).map(sample).collect();
        let c = contact(&all[..9], &all[9..]).unwrap();
        assert!((c.center - hit).norm() < 1e-6 && c.time.abs() < 1e-6, "{c:?}");
        assert!(normal(&c).unwrap().z > 0.99);
    }
}
