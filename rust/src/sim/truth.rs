//! What really happened in a scene.

use super::parameters::Parameters;
use serde::Serialize;
use std::string::String;
use std::vec::Vec;

/// All of it. World frame (z up, floor z = 0) unless a name says camera; m, s, m/s, ns of the stream's clock.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Truth {
    /// As it was asked for.
    pub scene: String,
    /// What was in force.
    pub parameters: Parameters,
    /// The true pose at the first frame, rows; told to an estimator only with `pose`.
    pub world_from_camera: [[f64; 4]; 4],
    /// m/s², camera frame.
    pub gravity_in_camera: [f64; 3],
    /// What can be touched.
    pub surfaces: Vec<SurfaceTruth>,
    /// In the order of time.
    pub contacts: Vec<ContactTruth>,
    /// When balls ceased to bounce.
    pub rolling: Vec<RollTruth>,
    /// The frames that were not lost, in order.
    pub frames: Vec<FrameTruth>,
}

/// A face: normal · p = offset.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SurfaceTruth {
    /// `ground`, `box top`, …
    pub name: String,
    /// Out of the solid.
    pub normal: [f64; 3],
    /// m.
    pub offset: f64,
    /// Camera frame, as at the first frame.
    pub normal_in_camera: [f64; 3],
    /// As at the first frame, m.
    pub offset_in_camera: f64,
}

/// A touch.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ContactTruth {
    /// Index of the throw, as in [`BallTruth::ball`].
    pub ball: usize,
    /// First touch.
    pub time_ns: i64,
    /// Of the ball at first touch.
    pub center: [f64; 3],
    /// The same, camera frame.
    pub center_in_camera: [f64; 3],
    /// center − radius · normal.
    pub point: [f64; 3],
    /// Unit, to the ball's side.
    pub normal: [f64; 3],
    /// At first touch.
    pub velocity_before: [f64; 3],
    /// At last touch.
    pub velocity_after: [f64; 3],
    /// Of this touch.
    pub restitution: f64,
    /// Name of the face, or of the solid on an edge.
    pub surface: String,
    /// Whether an edge or a corner was hit.
    pub on_edge: bool,
}

/// The moment from which a ball stays on a surface.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RollTruth {
    /// Index of the throw.
    pub ball: usize,
    /// When.
    pub time_ns: i64,
    /// On what.
    pub surface: String,
}

/// A frame.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FrameTruth {
    /// Its stamp: the time of its first row.
    pub timestamp_ns: i64,
    /// Where the camera is moved: how far it has come then since the first frame, m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub camera_displacement: Option<[f64; 3]>,
    /// Those of which a part is in view.
    pub balls: Vec<BallTruth>,
}

/// A ball in a frame, at the time of the row of its center.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct BallTruth {
    /// Index of the throw: each throw is a ball of its own.
    pub ball: usize,
    /// Of its row.
    pub time_ns: i64,
    /// m.
    pub center: [f64; 3],
    /// Camera frame.
    pub center_in_camera: [f64; 3],
    /// m/s.
    pub velocity: [f64; 3],
    /// m/s².
    pub acceleration: [f64; 3],
    /// Whether it moves by a force of its own: never.
    pub active: bool,
    /// Part of its disc inside the image and behind nothing.
    pub in_view: f64,
}
