//! A toy car: straight on, a turn, straight on, at one speed (sec. 3.3 of the paper).

use super::SimError;
use super::rigid::{Course, Part, Rigid, State, Thing};
use super::throws::Thrower;
use crate::math::{Mat3, Vec3};
use nalgebra::Rotation3;
use std::vec::Vec;

/// Height of its middle, m.
pub(super) const STANDING: f64 = 0.05;

/// Body, cabin, and what shows of four wheels.
pub(super) fn parts() -> Vec<Part> {
    let mut parts =
        std::vec![Part::block([0.1, 0.05, 0.025], [0.0, 0.0, -0.015], 0.0), Part::block([0.05, 0.042, 0.02], [-0.02, 0.0, 0.03], 0.0)];
    parts.extend([(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)].map(|(x, y)| Part::sphere(0.018, [0.06 * x, 0.032 * y, -0.032])));
    parts
}

/// Its way, in seconds since it appeared.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Drive {
    from: Vec3,
    /// From the world's x, rad.
    heading: f64,
    /// m/s.
    speed: f64,
    /// Of the turn, rad/s, to the left.
    rate: f64,
    /// When the turn begins, and how long it lasts, s.
    turn: [f64; 2],
}

impl Drive {
    pub(super) fn at(&self, t: f64) -> State {
        let [begin, lasts] = self.turn;
        let turned = self.rate * (t - begin).clamp(0.0, lasts);
        let along = |heading: f64| Vec3::new(heading.cos(), heading.sin(), 0.0);
        let (first, now) = (along(self.heading), along(self.heading + turned));
        let left = |direction: Vec3| Vec3::z().cross(&direction);
        // About the turn's middle the car is to the right, and so it began.
        let arc = if self.rate == 0.0 { Vec3::zeros() } else { (left(first) - left(now)) * (self.speed / self.rate) };
        let straight = first * t.min(begin) + now * (t - begin - lasts).max(0.0);
        let active = (begin..begin + lasts).contains(&t);
        State {
            position: self.from + straight * self.speed + arc,
            velocity: now * self.speed,
            acceleration: if active { left(now) * (self.speed * self.rate) } else { Vec3::zeros() },
            rotation: Mat3::from(Rotation3::from_axis_angle(&Vec3::z_axis(), self.heading + turned)),
            active,
        }
    }
}

impl Thrower<'_> {
    /// A car that appears at `time`, already at its speed.
    pub(super) fn car(&mut self, time: f64) -> Result<Rigid, SimError> {
        let car = self.try_until(Self::drive)?;
        Ok(Rigid { start: time, end: time + car.end, ..car })
    }

    /// All of it in view all the time.
    fn drive(&mut self) -> Option<Rigid> {
        let (speed, radius, angle) = (self.uniform(0.3, 0.6), self.uniform(0.25, 0.5), self.uniform(60.0, 120.0).to_radians());
        let side = if self.uniform(0.0, 1.0) < 0.5 { -1.0 } else { 1.0 };
        let turn = [self.uniform(0.9, 1.8), angle * radius / speed];
        let heading = self.uniform(0.0, core::f64::consts::TAU);
        let drive = Drive { from: Vec3::zeros(), heading, speed, rate: side * speed / radius, turn };
        let from = self.around_middle(0.4, 0.4, STANDING) - drive.at(turn[0] + 0.5 * turn[1]).position;
        let end = turn[0] + turn[1] + self.uniform(0.9, 1.8);
        let car = Rigid { kind: Thing::Car, parts: parts(), start: 0.0, end, course: Course::Drive(Drive { from, ..drive }) };
        self.stays_in_view(&car).then_some(car)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_drive_is_smooth_but_for_its_acceleration() {
        let drive = Drive { from: Vec3::zeros(), heading: 0.7, speed: 0.5, rate: -1.6, turn: [1.0, 0.9] };
        for i in 1..290 {
            let t = 0.01 * f64::from(i);
            let [before, now, after] = [t - 1e-6, t, t + 1e-6].map(|t| drive.at(t));
            assert!((now.velocity.norm() - 0.5).abs() < 1e-12);
            assert!(((after.position - before.position) / 2e-6 - now.velocity).norm() < 1e-5, "{t}");
            if before.active == after.active {
                assert!(((after.velocity - before.velocity) / 2e-6 - now.acceleration).norm() < 1e-5, "{t}");
            }
            assert!((now.rotation * Vec3::x() * 0.5 - now.velocity).norm() < 1e-12);
        }
    }
}
