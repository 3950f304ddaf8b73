//! What really happened in a scene.

use super::parameters::Parameters;
use super::rigid::Thing;
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
    /// What robots and cars look like.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub shapes: Vec<ShapeTruth>,
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
    /// What isn't a ball, likewise.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub objects: Vec<ObjectTruth>,
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

/// A robot or a car in a frame, at the time of the row of its center.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ObjectTruth {
    /// Index of it, as in [`ShapeTruth::object`].
    pub object: usize,
    /// What it is.
    pub kind: Thing,
    /// Of its row.
    pub time_ns: i64,
    /// The middle of its bounding box, m.
    pub center: [f64; 3],
    /// Camera frame.
    pub center_in_camera: [f64; 3],
    /// Its axes (x forward, y left, z up) to the world's, rows.
    pub rotation: [[f64; 3]; 3],
    /// m/s.
    pub velocity: [f64; 3],
    /// m/s².
    pub acceleration: [f64; 3],
    /// Whether a motor of its own moves it otherwise than gravity, floor and inertia would.
    pub active: bool,
    /// Part of the disc around all of it that is inside the image.
    pub in_view: f64,
}

/// The surface of a robot or a car.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ShapeTruth {
    /// Index of it.
    pub object: usize,
    /// What it is.
    pub kind: Thing,
    /// In its own frame.
    pub parts: Vec<PartTruth>,
}

/// A convex part of a thing, in its frame: from the middle of its bounding box, x forward, y left, z up.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(tag = "form", rename_all = "snake_case")]
pub enum PartTruth {
    /// A sphere.
    Sphere {
        /// m.
        center: [f64; 3],
        /// m.
        radius: f64,
    },
    /// A box.
    Box {
        /// m.
        center: [f64; 3],
        /// Half of its edges, m.
        half: [f64; 3],
        /// Its axes to the thing's, rows.
        rotation: [[f64; 3]; 3],
    },
}
