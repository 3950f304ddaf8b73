//! Where a motion of which nothing is known, not even its unit, consists of several flights: between them it is kicked.

use crate::math::Vec3;
use crate::physics::scale::{SMOOTH, extent};
use crate::physics::{Sample, watch};
use core::ops::Range;
use nalgebra::{SMatrix, SVector};

/// A flight has at least so many positions.
pub const LEAST: usize = 6;
/// By how much two curves must explain more than one, in units of the noise's variance: twelve numbers more gain as much by chance in one
/// of 1e7 places.
const GAIN: f64 = 60.0;

/// Hands out the flights among `samples` (sorted by time), in order, as ranges of at least [`LEAST`]. Over a flight every coordinate is a
/// cubic, gravity bent by drag; where two cubics explain much more than one, there was a kick between. `scratch` takes 3 numbers a sample.
pub fn flights(samples: &[Sample], scratch: &mut [f64], out: &mut impl FnMut(Range<usize>)) {
    // Too few to tell their noise: two flights can't be told from one.
    let noise = watch::noise(samples, scratch).unwrap_or(f64::INFINITY);
    let mut open = 0..0;
    let mut close = |range: &Range<usize>| {
        if range.len() >= LEAST {
            out(range.clone());
        }
    };
    // Of two kicks the first cut may fall between: what it parted without need is joined again.
    divide(samples, 0..samples.len(), noise, scratch, &mut |range: Range<usize>| {
        let both = &samples[open.start..range.end];
        let parts = left_over(both, open.len()..both.len()) + left_over(both, 0..open.len());
        if !open.is_empty() && !is_kick(both, left_over(both, 0..both.len()) - parts, noise) {
            open.end = range.end;
        } else {
            close(&open);
            open = range;
        }
    });
    close(&open);
}

/// Whether two cubics that leave over so much less (units²) than one are two flights.
fn is_kick(samples: &[Sample], gain: f64, noise: f64) -> bool {
    let least = noise.max(SMOOTH * extent(samples));
    gain > GAIN * least * least
}

/// Cuts where kicks are most probable, and hands out the parts.
fn divide(samples: &[Sample], range: Range<usize>, noise: f64, scratch: &mut [f64], out: &mut impl FnMut(Range<usize>)) {
    let part = &samples[range.clone()];
    match kick(part, scratch).filter(|(_, gain)| is_kick(part, *gain, noise)) {
        None => out(range),
        Some((at, _)) => {
            let middle = range.start + at;
            divide(samples, range.start..middle, noise, scratch, out);
            divide(samples, middle..range.end, noise, scratch, out);
        }
    }
}

/// What a cubic through a part of `samples` leaves over, units².
fn left_over(samples: &[Sample], part: Range<usize>) -> f64 {
    let mut cubic = Cubic::default();
    for sample in &samples[part] {
        cubic.observe(scaled(samples, sample));
    }
    cubic.left_over()
}

/// Times from −1 to 1 over all `samples`, positions about the first: cubics stay well conditioned.
fn scaled(samples: &[Sample], s: &Sample) -> (f64, Vec3) {
    let (first, last) = (&samples[0], &samples[samples.len() - 1]);
    ((2.0 * s.t - first.t - last.t) / (last.t - first.t), s.position - first.position)
}

/// The first sample after the most probable kick, and how much less two cubics leave over than one, units².
fn kick(samples: &[Sample], scratch: &mut [f64]) -> Option<(usize, f64)> {
    let mut cubic = Cubic::default();
    for (left, sample) in scratch.iter_mut().zip(samples) {
        cubic.observe(scaled(samples, sample));
        *left = cubic.left_over();
    }
    let whole = cubic.left_over();
    let mut cubic = Cubic::default();
    let mut best: Option<(usize, f64)> = None;
    for (i, sample) in samples.iter().enumerate().rev() {
        cubic.observe(scaled(samples, sample));
        if i >= 4 && samples.len() - i >= 4 {
            let gain = whole - scratch.get(i - 1)? - cubic.left_over();
            if best.is_none_or(|(_, most)| gain > most) {
                best = Some((i, gain));
            }
        }
    }
    best
}

/// Normal equations of a cubic a coordinate.
#[derive(Default)]
struct Cubic {
    information: SMatrix<f64, 4, 4>,
    right: SMatrix<f64, 4, 3>,
    square: f64,
}

impl Cubic {
    fn observe(&mut self, (t, p): (f64, Vec3)) {
        let row = SVector::<f64, 4>::new(1.0, t, t * t, t * t * t);
        self.information += row * row.transpose();
        self.right += row * p.transpose();
        self.square += p.norm_squared();
    }

    /// Sum of squared residuals; 0 where the cubic is not determined yet.
    fn left_over(&self) -> f64 {
        self.information.cholesky().map_or(0.0, |c| (self.square - self.right.dot(&c.solve(&self.right))).max(0.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn split(samples: &[Sample]) -> heapless::Vec<Range<usize>, 8> {
        let mut found = heapless::Vec::new();
        flights(samples, &mut [0.0; 180], &mut |range| found.push(range).unwrap());
        found
    }

    /// 60 frames of a ball that is kicked at each of `kicks`, with a little noise.
    fn kicked(kicks: &[usize]) -> [Sample; 60] {
        let (mut p, mut v) = (Vec3::zeros(), Vec3::new(1.0, 0.5, 3.0));
        let mut seed = 1_u64;
        let mut noise = || {
            // Twelve uniform numbers make a normal one.
            let uniform = (0..12).map(|_| {
                seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                (seed >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
            });
            1e-3 * uniform.sum::<f64>()
        };
        core::array::from_fn(|i| {
            if kicks.contains(&i) {
                v = Vec3::new(0.8 * v.x, -v.y, 2.5);
            }
            let dt = 1.0 / 30.0;
            p += v * dt - Vec3::z() * (0.5 * 9.81 * dt * dt);
            v.z -= 9.81 * dt;
            Sample::isotropic(dt * i as f64, p + Vec3::new(noise(), noise(), noise()), 1e-3)
        })
    }

    #[test]
    fn kicks_part_flights_and_a_flight_stays_whole() {
        let whole = split(&kicked(&[]));
        assert_eq!((whole.len(), whole.first()), (1, Some(&(0..60))));
        assert_eq!(split(&kicked(&[20, 38])), [0..20, 20..38, 38..60]);
        // What is too short is no flight.
        assert_eq!(split(&kicked(&[20, 24])), [0..20, 24..60]);
    }
}
