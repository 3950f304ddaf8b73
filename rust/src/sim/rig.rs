//! The camera of a scene: where it stands, and how a hand moves it.

use super::moves::{Move, together};
use super::parameters::{Parameters, Samples};
use super::sensor::{FOCAL, disparity_law};
use crate::geometry::camera::{Camera, DepthCode, Pose};
use crate::math::{Mat3, Vec3};
use std::vec::Vec;

/// Where a camera is over time; its orientation stays.
#[derive(Clone, Debug, PartialEq)]
pub struct Rig {
    /// At the first frame.
    pub pose: Pose,
    moves: Vec<Move>,
    /// How far it had come by then.
    origin: Vec3,
}

impl Rig {
    /// A camera that stands at `pose` before it is moved, and whose first frame is taken at time `first`.
    pub fn new(pose: &Pose, moves: Vec<Move>, first: f64) -> Self {
        let [origin, ..] = together(&moves, first);
        Self { pose: Pose { rotation: pose.rotation, translation: pose.translation + origin }, moves, origin }
    }

    /// How far it has come since the first frame, world axes, m; `None` where it never moves.
    pub fn displacement(&self, t: f64) -> Option<Vec3> {
        (!self.moves.is_empty()).then(|| together(&self.moves, t)[0] - self.origin)
    }

    /// Where it is at time `t`.
    pub fn at(&self, t: f64) -> Pose {
        let displacement = self.displacement(t).unwrap_or_default();
        Pose { rotation: self.pose.rotation, translation: self.pose.translation + displacement }
    }
}

/// Turned by the tilt around a point at the lens's height, `distance` before it, so that the scene stays in view.
pub(super) fn pose(p: &Parameters) -> Pose {
    let (sin, cos) = p.tilt_deg.to_radians().sin_cos();
    let forward = Vec3::new(0.0, cos, -sin);
    let down = Vec3::new(0.0, -sin, -cos);
    let level = Mat3::from_columns(&[Vec3::x(), down, forward]);
    let turn = *nalgebra::Rotation3::from_axis_angle(&Vec3::z_axis(), p.roll_deg.to_radians()).matrix();
    Pose { rotation: level * turn, translation: Vec3::new(0.0, p.distance, p.height) - forward * p.distance }
}

pub(super) fn camera(p: &Parameters, focal_factor: f64, pose: Option<Pose>) -> Camera {
    let code = match p.kind {
        Samples::Disparity => DepthCode::Disparity { law: disparity_law() },
        Samples::Depth => DepthCode::Depth { units_per_metre: 1000.0 },
    };
    let focal = FOCAL * focal_factor;
    Camera {
        width: 640,
        height: 480,
        fx: focal,
        fy: focal,
        cx: 319.5,
        cy: 239.5,
        code,
        max_depth: 10.0,
        readout: p.readout,
        pose,
        gravity: None,
    }
}
