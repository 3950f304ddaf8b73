//! Rigid things other than balls: what they look like, and where they are over time.

use super::car::Drive;
use super::robot::Flight;
use super::sensor::Form;
use crate::math::{Mat3, Vec3};
use serde::Serialize;
use std::vec::Vec;

/// What a thing is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Thing {
    /// It lifts and steers itself.
    Robot,
    /// It drives on the floor.
    Car,
}

/// A convex part, in the frame of its thing: x forward, y left, z up, from the middle of the thing's bounding box.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Part {
    /// What it is.
    pub form: Form,
    /// Its middle, m.
    pub center: Vec3,
    /// Its axes to the thing's.
    pub axes: Mat3,
}

impl Part {
    pub(super) fn sphere(radius: f64, center: [f64; 3]) -> Self {
        Self { form: Form::Sphere { radius }, center: center.into(), axes: Mat3::identity() }
    }

    /// A box with these half edges, turned by `yaw`.
    pub(super) fn block(half: [f64; 3], center: [f64; 3], yaw: f64) -> Self {
        let axes = *nalgebra::Rotation3::from_axis_angle(&Vec3::z_axis(), yaw).matrix();
        Self { form: Form::Box { half: half.into() }, center: center.into(), axes }
    }

    /// Half of its bounding box's edges along the thing's axes.
    fn half(&self) -> Vec3 {
        match self.form {
            Form::Sphere { radius } => Vec3::repeat(radius),
            Form::Box { half } => self.axes.abs() * half,
        }
    }
}

/// How a thing moves, world frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct State {
    /// The middle of its bounding box, m.
    pub position: Vec3,
    /// m/s.
    pub velocity: Vec3,
    /// m/s².
    pub acceleration: Vec3,
    /// Its axes to the world's.
    pub rotation: Mat3,
    /// Whether a motor of its own moves it otherwise than gravity, floor and inertia would.
    pub active: bool,
}

/// How it moves.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Course {
    Flight(Flight),
    Drive(Drive),
}

/// A rigid thing.
#[derive(Clone, Debug, PartialEq)]
pub struct Rigid {
    /// What it is.
    pub kind: Thing,
    /// All of its surface.
    pub parts: Vec<Part>,
    /// When it appears, s.
    pub start: f64,
    /// When it is gone, s.
    pub end: f64,
    /// Since it appeared.
    pub(super) course: Course,
}

impl Rigid {
    /// How it moves at `time`; `None` before it appears and when it is gone.
    pub fn at(&self, time: f64) -> Option<State> {
        (self.start..self.end).contains(&time).then(|| match &self.course {
            Course::Flight(flight) => flight.at(time - self.start),
            Course::Drive(drive) => drive.at(time - self.start),
        })
    }

    /// Half the diagonal of its bounding box, m.
    pub fn reach(&self) -> f64 {
        self.bounds().iter().fold(Vec3::zeros(), |most, corner| most.sup(&corner.abs())).norm()
    }

    /// Its bounding box: least and greatest coordinates, own frame, m.
    fn bounds(&self) -> [Vec3; 2] {
        let low = self.parts.iter().map(|p| p.center - p.half()).fold(Vec3::repeat(f64::INFINITY), |a, b| a.inf(&b));
        let high = self.parts.iter().map(|p| p.center + p.half()).fold(Vec3::repeat(f64::NEG_INFINITY), |a, b| a.sup(&b));
        [low, high]
    }
}

#[cfg(test)]
mod tests {
    use super::super::{car, robot};
    use super::*;

    #[test]
    fn positions_are_the_middles_of_bounding_boxes() {
        let thing = |parts| Rigid { kind: Thing::Car, parts, start: 0.0, end: 1.0, course: Course::Drive(Drive::default()) };
        for (parts, low, high, height) in [(robot::parts(), 0.2, 0.35, robot::STANDING), (car::parts(), 0.1, 0.21, car::STANDING)] {
            let [least, most] = thing(parts).bounds();
            assert!((least + most).norm() < 1e-12, "{least} {most}");
            assert!((low..high).contains(&(most.x - least.x)) && (-least.z - height).abs() < 1e-12);
        }
    }
}
