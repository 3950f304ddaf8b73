//! The laws 𝓛 of the paper: how an object that nobody touches moves.

use crate::config::{LawName, LawsConfig, ObjectConfig};
use crate::math::{Vec3, ceil};

/// A law of motion.
pub trait Law {
    /// Acceleration (m/s²) at time `t` (s) of an object at `position` (m) with `velocity` (m/s), under `gravity` (m/s²), which may be
    /// the unknown of a fit. All in one frame, which is inertial.
    fn acceleration(&self, gravity: &Vec3, t: f64, position: &Vec3, velocity: &Vec3) -> Vec3;

    /// The state `h` (s) later, by one step of the classical Runge–Kutta rule.
    fn step(&self, gravity: &Vec3, s: &State, h: f64) -> State {
        let a = |dt: f64, p: &Vec3, v: &Vec3| self.acceleration(gravity, s.t + dt, p, v);
        let (p1, v1) = (s.position, s.velocity);
        let a1 = a(0.0, &p1, &v1);
        let (p2, v2) = (p1 + v1 * (0.5 * h), v1 + a1 * (0.5 * h));
        let a2 = a(0.5 * h, &p2, &v2);
        let (p3, v3) = (p1 + v2 * (0.5 * h), v1 + a2 * (0.5 * h));
        let a3 = a(0.5 * h, &p3, &v3);
        let (p4, v4) = (p1 + v3 * h, v1 + a3 * h);
        let a4 = a(h, &p4, &v4);
        State {
            t: s.t + h,
            position: p1 + (v1 + 2.0 * v2 + 2.0 * v3 + v4) * (h / 6.0),
            velocity: v1 + (a1 + 2.0 * a2 + 2.0 * a3 + a4) * (h / 6.0),
        }
    }
}

/// Gravity alone: the paper's law.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FreeFall;

impl Law for FreeFall {
    fn acceleration(&self, gravity: &Vec3, _: f64, _: &Vec3, _: &Vec3) -> Vec3 {
        *gravity
    }
}

/// Gravity and the quadratic drag of still air: a = g − k |v| v.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FreeFallWithDrag {
    /// k = ½ ρ `C_d` A / m, 1/m.
    pub drag: f64,
}

impl FreeFallWithDrag {
    /// Of a ball of `radius` (m); no drag where the laws say so, or that it moves at constant velocity.
    pub fn of(object: &ObjectConfig, laws: &LawsConfig, radius: f64) -> Self {
        let area = core::f64::consts::PI * radius * radius;
        let drag = 0.5 * laws.air_density * object.drag_coefficient * area / object.mass;
        Self { drag: if laws.drag && laws.law != LawName::ConstantVelocity { drag } else { 0.0 } }
    }
}

impl Law for FreeFallWithDrag {
    fn acceleration(&self, gravity: &Vec3, _: f64, _: &Vec3, velocity: &Vec3) -> Vec3 {
        gravity - velocity * (self.drag * velocity.norm())
    }
}

/// Where an object is, and how fast.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct State {
    /// Time, s.
    pub t: f64,
    /// Position, m.
    pub position: Vec3,
    /// Velocity, m/s.
    pub velocity: Vec3,
}

/// Steps no longer than this, s: the truncation error of a ball's drag stays below a micrometre a second.
const LONGEST_STEP: f64 = 0.04;
/// More steps than this (2.6 s) are not taken: the last ones grow instead.
const MOST_STEPS: f64 = 64.0;

impl State {
    /// The state at time `t`, before or after, in steps that are short enough: Eq. 5, for any law.
    #[must_use]
    pub fn at(self, t: f64, law: &dyn Law, gravity: &Vec3) -> Self {
        let span = t - self.t;
        if span.abs() <= LONGEST_STEP {
            return Self { t, ..law.step(gravity, &self, span) };
        }
        let steps = ceil(span.abs() / LONGEST_STEP).clamp(1.0, MOST_STEPS);
        let mut s = self;
        for _ in 0..steps as usize {
            s = law.step(gravity, &s, span / steps);
        }
        Self { t, ..s }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn free_fall_is_eq_5_to_rounding() {
        let g = Vec3::new(0.0, 0.0, -9.81);
        let s = State { t: 1.0, position: Vec3::new(0.1, 1.0, 2.0), velocity: Vec3::new(1.0, -2.0, 3.0) };
        for t in [1.3, 0.2] {
            let dt: f64 = t - 1.0;
            let expected = s.position + s.velocity * dt + 0.5 * g * dt * dt;
            assert!((s.at(t, &FreeFall, &g).position - expected).norm() < 1e-12);
        }
    }

    #[test]
    fn drag_reaches_terminal_speed_and_runs_backwards() {
        let g = Vec3::new(0.0, 0.0, -9.81);
        let law = FreeFallWithDrag { drag: 0.02 };
        let start = State { t: 0.0, position: Vec3::zeros(), velocity: Vec3::new(4.0, 0.0, 2.0) };
        let mut s = start;
        for i in 1..=100 {
            s = s.at(f64::from(i) * 0.2, &law, &g);
        }
        assert!((s.velocity.norm() - libm::sqrt(9.81 / 0.02)).abs() < 1e-3);
        let there = start.at(0.5, &law, &g);
        assert!((there.at(0.0, &law, &g).position - start.position).norm() < 1e-7);
    }
}
