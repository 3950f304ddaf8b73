//! Smooth motions from rest to rest: how a hand carries a camera, and a robot itself.

use crate::math::Vec3;

/// Greatest acceleration of a straight motion over distance / duration².
pub const PEAK: f64 = 5.773_502_691_896_258;

/// A motion from rest to rest with the least jerk (Flash and Hogan, J. Neurosci. 5, 1985), a little beside the straight line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Move {
    /// When it begins, s.
    pub start: f64,
    /// s.
    pub duration: f64,
    /// From where it begins to where it ends, m.
    pub by: Vec3,
    /// How far from the straight line it is in the middle, m.
    pub bow: Vec3,
}

impl Move {
    /// How far it has come at time `t`, its velocity and its acceleration.
    pub fn at(&self, t: f64) -> [Vec3; 3] {
        let s = (t - self.start) / self.duration;
        if s <= 0.0 {
            return [Vec3::zeros(); 3];
        }
        if s >= 1.0 {
            return [self.by, Vec3::zeros(), Vec3::zeros()];
        }
        let (q, turn) = (s * (1.0 - s), 1.0 - 2.0 * s);
        let along = [s * s * s * (10.0 - 15.0 * s + 6.0 * s * s), 30.0 * q * q, 60.0 * q * turn];
        let beside = [64.0 * q * q * q, 192.0 * q * q * turn, 384.0 * q * (turn * turn - q)];
        core::array::from_fn(|i| (self.by * along[i] + self.bow * beside[i]) / self.duration.powi(i as i32))
    }

    /// When it ends, s.
    pub fn end(&self) -> f64 {
        self.start + self.duration
    }
}

/// How far all of `moves` have come at time `t`, their velocity and their acceleration.
pub fn together(moves: &[Move], t: f64) -> [Vec3; 3] {
    moves.iter().map(|m| m.at(t)).fold([Vec3::zeros(); 3], |sum, m| core::array::from_fn(|i| sum[i] + m[i]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_move_arrives_and_its_derivatives_are_its_own() {
        let moved = Move { start: 1.0, duration: 0.4, by: Vec3::new(0.155, 0.0, 0.01), bow: Vec3::new(0.0, 0.004, 0.0) };
        assert_eq!(moved.at(0.99), [Vec3::zeros(); 3]);
        assert_eq!(moved.at(1.5)[0], moved.by);
        let peak = (0..400).map(|i| moved.at(1.0 + 1e-3 * f64::from(i))[2].x).fold(0.0, f64::max);
        assert!((peak / (PEAK * 0.155 / 0.16) - 1.0).abs() < 1e-4, "{peak}");
        for t in [1.03, 1.2, 1.31, 1.399] {
            let [before, now, after] = [t - 1e-5, t, t + 1e-5].map(|t| moved.at(t));
            for i in 0..2 {
                assert!(((after[i] - before[i]) / 2e-5 - now[i + 1]).norm() < 1e-6 * 100_f64.powi(i as i32), "{t} {i}");
            }
        }
        assert!((moved.at(1.2)[0] - moved.by * 0.5 - moved.bow).norm() < 1e-12);
    }
}
