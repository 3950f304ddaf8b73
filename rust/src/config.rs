//! What the user may tell: plain structs with defaults that work, the same keys in TOML and in Python.

mod validation;

use crate::geometry::environment::SharedMesh;
use heapless::{String, Vec};

#[cfg(feature = "std")]
use serde::{Deserialize, Serialize};

/// A short name, at most 64 bytes.
pub type Name = String<64>;

/// Declares a section: public fields with defaults, mirrored in TOML; unknown keys are errors.
macro_rules! section {
    ($(#[$meta:meta])* $name:ident { $($(#[$field_meta:meta])* $field:ident: $type:ty = $default:expr,)* }) => {
        $(#[$meta])*
        #[derive(Clone, Debug, PartialEq)]
        #[cfg_attr(feature = "std", derive(Serialize, Deserialize), serde(default, deny_unknown_fields))]
        pub struct $name { $($(#[$field_meta])* pub $field: $type,)* }
        impl Default for $name {
            fn default() -> Self { Self { $($field: $default,)* } }
        }
    };
}

section! {
    /// Everything that can be configured.
    Config {
        /// The camera; wins over `camera.toml`.
        camera: CameraConfig = CameraConfig::default(),
        /// The tracked object.
        object: ObjectConfig = ObjectConfig::default(),
        /// The laws of physics, and how disagreement with them is tested.
        laws: LawsConfig = LawsConfig::default(),
        /// From frames to tracks.
        tracking: TrackingConfig = TrackingConfig::default(),
        /// What is taken for granted.
        assume: AssumeConfig = AssumeConfig::default(),
        /// What is known of the scene.
        environment: EnvironmentConfig = EnvironmentConfig::default(),
    }
}

section! {
    /// `[camera]` and `camera.toml`: every key may be left out.
    CameraConfig {
        /// Columns, px (640).
        width: Option<u32> = None,
        /// Rows, px (480).
        height: Option<u32> = None,
        /// Focal length in columns, px (575.8).
        fx: Option<f64> = None,
        /// Focal length in rows, px (575.8).
        fy: Option<f64> = None,
        /// Principal point, column, px (319.5).
        cx: Option<f64> = None,
        /// Principal point, row, px (239.5).
        cy: Option<f64> = None,
        /// Units a metre of a depth image; of disparity it says nothing.
        depth_scale: Option<f64> = None,
        /// Samples are raw disparity, also where the source takes them for depth; what it knows to be disparity stays so.
        disparity: Option<bool> = None,
        /// `[c0, c1]` of 1/z = c0 + c1 · raw, in 1/m.
        disparity_law: Option<[f64; 2]> = None,
        /// Readings beyond this are ignored, m (10).
        max_depth: Option<f64> = None,
        /// Seconds from the first row's readout to the last's (0).
        readout: Option<f64> = None,
        /// Pose, 4 rows of 4, rigid.
        world_from_camera: Option<[[f64; 4]; 4]> = None,
        /// Where an accelerometer in the camera says that gravity pulls, m/s²; without a pose the world is level by it.
        gravity_in_camera: Option<[f64; 3]> = None,
    }
}

section! {
    /// `[object]`: the tracked object.
    ObjectConfig {
        /// `sphere`, or `any`: whatever the background does not tell of, followed by ICP; `radius` then has no part.
        shape: Shape = Shape::Sphere,
        /// Radius of the ball, m; a list for several kinds.
        radius: Radii = Radii::one(0.033),
        /// Mass, kg.
        mass: f64 = 0.057,
        /// Drag coefficient, of the cross section.
        drag_coefficient: f64 = 0.53,
        /// How long a bounce touches, s; 0 is an ideal impact.
        contact_duration: f64 = 0.0045,
        /// Prior of an unknown spin, rad/s; 0 is no spin.
        spin_sd: f64 = 0.0,
    }
}

section! {
    /// `[laws]`: the laws of physics, and how disagreement is tested.
    LawsConfig {
        /// Gravity in the world, m/s².
        gravity: [f64; 3] = [0.0, 0.0, -9.81],
        /// The law of motion.
        law: LawName = LawName::FreeFall,
        /// Air drag acts.
        drag: bool = true,
        /// The Magnus force acts.
        magnus: bool = false,
        /// Density of the air, kg/m³.
        air_density: f64 = 1.2,
        /// θ of Eq. 3, m.
        theta: f64 = 0.006,
        /// False alarms of the whitened test, a track.
        false_alarm: f64 = 1e-3,
        /// The best we can, or the paper's own method.
        method: Method = Method::Best,
    }
}

section! {
    /// `[tracking]`: from frames to tracks.
    TrackingConfig {
        /// First frames, which show no object; 0 for none.
        background_frames: u32 = 15,
        /// Standard deviation of positions that come without covariance, m; left out: estimated from flights.
        position_sd: Option<f64> = None,
    }
}

section! {
    /// `[assume]`: what is taken for granted.
    AssumeConfig {
        /// What is known of the camera's pose; left out: `static` where `world_from_camera` is given, else `tilted`.
        camera: Option<CameraAssumption> = None,
        /// Whether the environment is all there is: what was told of it, and what a learned background shows.
        scene: SceneAssumption = SceneAssumption::Unknown,
        /// Whether objects may have a motor.
        objects: ObjectsAssumption = ObjectsAssumption::Passive,
    }
}

section! {
    /// `[[environment.*]]`: known surfaces, world frame. Their ids are their places in [`EnvironmentConfig::kinds`].
    EnvironmentConfig {
        /// Planes.
        #[cfg_attr(feature = "std", serde(deserialize_with = "as_many_as_fit"))]
        plane: Vec<KnownPlane, 8> = Vec::new(),
        /// Boxes.
        #[cfg_attr(feature = "std", serde(deserialize_with = "as_many_as_fit"))]
        r#box: Vec<KnownBox, 8> = Vec::new(),
        /// Spheres.
        #[cfg_attr(feature = "std", serde(deserialize_with = "as_many_as_fit"))]
        sphere: Vec<KnownSphere, 8> = Vec::new(),
        /// Meshes.
        #[cfg_attr(feature = "std", serde(deserialize_with = "as_many_as_fit"))]
        mesh: Vec<KnownMesh, 4> = Vec::new(),
        /// Of which kind each is, in the file's order; `config_file` tells it.
        #[cfg_attr(feature = "std", serde(skip))]
        order: Vec<Kind, 28> = Vec::new(),
    }
}

/// A list that there may be no room for.
#[cfg(feature = "std")]
fn as_many_as_fit<'de, D: serde::Deserializer<'de>, T: Deserialize<'de>, const N: usize>(deserializer: D) -> Result<Vec<T, N>, D::Error> {
    let all = std::vec::Vec::deserialize(deserializer)?;
    let too_many = std::format!("there are {} of these, and room for {N}", all.len());
    let mut list = Vec::new();
    for item in all {
        list.push(item).map_err(|_| serde::de::Error::custom(&too_many))?;
    }
    Ok(list)
}

/// Kinds of known surfaces.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs)] // As they are called.
pub enum Kind {
    Plane,
    Box,
    Sphere,
    Mesh,
}

impl Kind {
    /// All there are.
    pub const ALL: [Self; 4] = [Self::Plane, Self::Box, Self::Sphere, Self::Mesh];

    /// What it is called in a configuration.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Plane => "plane",
            Self::Box => "box",
            Self::Sphere => "sphere",
            Self::Mesh => "mesh",
        }
    }
}

section! {
    /// A known plane: normal · p = offset.
    KnownPlane {
        /// What to call it.
        name: Name = Name::new(),
        /// Unit normal; either sign is the same plane, with `offset` turned as well.
        normal: [f64; 3] = [0.0, 0.0, 1.0],
        /// Offset along the normal, m.
        offset: f64 = 0.0,
    }
}

section! {
    /// A known box.
    KnownBox {
        /// What to call it.
        name: Name = Name::new(),
        /// Its middle, m.
        center: [f64; 3] = [f64::NAN; 3],
        /// Full edges, m.
        size: [f64; 3] = [f64::NAN; 3],
        /// Turn about world z, rad; 0 beside `rotation`.
        yaw: f64 = 0.0,
        /// Or the whole rotation, as a unit quaternion w, x, y, z.
        rotation: Option<[f64; 4]> = None,
    }
}

section! {
    /// A known sphere.
    KnownSphere {
        /// What to call it.
        name: Name = Name::new(),
        /// Its middle, m.
        center: [f64; 3] = [f64::NAN; 3],
        /// Its radius, m.
        radius: f64 = f64::NAN,
    }
}

section! {
    /// A known mesh: a closed surface, its triangles counter-clockwise as seen from outside.
    KnownMesh {
        /// What to call it.
        name: Name = Name::new(),
        /// File (OBJ, STL or PLY, units metres), relative to the configuration's, or where there is none to the working directory.
        path: String<256> = String::new(),
        /// Pose in the world, 4 rows of 4, rigid; left out: the mesh is in world coordinates.
        pose: Option<[[f64; 4]; 4]> = None,
        /// What the file holds; `config_file` reads it.
        #[cfg_attr(feature = "std", serde(skip))]
        solid: Option<SharedMesh> = None,
    }
}

/// Declares a choice between names.
macro_rules! choice {
    ($(#[$meta:meta])* $name:ident { $($(#[$variant_meta:meta])* $variant:ident,)* }) => {
        $(#[$meta])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        #[cfg_attr(feature = "std", derive(Serialize, Deserialize), serde(rename_all = "snake_case"))]
        pub enum $name { $($(#[$variant_meta])* $variant,)* }
    };
}

choice! {
    /// How an object is tracked.
    Shape {
        /// A ball of known radius.
        Sphere,
        /// Anything, by ICP.
        Any,
    }
}
choice! {
    /// A law of motion.
    LawName {
        /// Gravity and, with `drag`, the air.
        FreeFall,
        /// Constant velocity on a horizontal plane.
        ConstantVelocity,
        /// Whatever the evidence tells.
        Auto,
    }
}
choice! {
    /// Which estimators answer.
    Method {
        /// Whitened tests and joint fits.
        Best,
        /// θ on one-step predictions triggers, the paper's solvers answer.
        Paper,
    }
}
choice! {
    /// What is known of the camera's pose.
    CameraAssumption {
        /// Pose as configured.
        Static,
        /// Fixed, the direction of gravity to be found, its size known.
        Tilted,
        /// Orientation as configured, translation free.
        Moving,
        /// Both free.
        Unknown,
    }
}
choice! {
    /// Whether the environment is all there is.
    SceneAssumption {
        /// It is.
        Known,
        /// There may be more.
        Unknown,
    }
}
choice! {
    /// Whether objects may have a motor.
    ObjectsAssumption {
        /// They have none.
        Passive,
        /// They may.
        Unknown,
    }
}

impl CameraAssumption {
    /// Whether the camera's place is free.
    pub fn moves(self) -> bool {
        matches!(self, Self::Moving | Self::Unknown)
    }
}

/// One radius, or one for each kind of ball, m.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "std", derive(Serialize, Deserialize), serde(untagged, expecting = "expected a number, or a list of up to 4"))]
pub enum Radii {
    /// All balls are alike.
    One(f64),
    /// Several kinds.
    Many(Vec<f64, 4>),
}

impl Radii {
    /// All balls have this radius, m.
    pub const fn one(radius: f64) -> Self {
        Self::One(radius)
    }

    /// The radii, m.
    pub fn as_slice(&self) -> &[f64] {
        match self {
            Self::One(radius) => core::slice::from_ref(radius),
            Self::Many(radii) => radii,
        }
    }
}

impl CameraConfig {
    /// These keys, and where one is left out, that of `other`.
    #[must_use]
    pub fn or(&self, other: &Self) -> Self {
        Self {
            width: self.width.or(other.width),
            height: self.height.or(other.height),
            fx: self.fx.or(other.fx),
            fy: self.fy.or(other.fy),
            cx: self.cx.or(other.cx),
            cy: self.cy.or(other.cy),
            depth_scale: self.depth_scale.or(other.depth_scale),
            disparity: self.disparity.or(other.disparity),
            disparity_law: self.disparity_law.or(other.disparity_law),
            max_depth: self.max_depth.or(other.max_depth),
            readout: self.readout.or(other.readout),
            world_from_camera: self.world_from_camera.or(other.world_from_camera),
            gravity_in_camera: self.gravity_in_camera.or(other.gravity_in_camera),
        }
    }
}

impl Config {
    /// What is assumed of the camera, where the pose is given or not.
    pub fn camera_assumption(&self, pose_is_given: bool) -> CameraAssumption {
        self.assume.camera.unwrap_or(if pose_is_given { CameraAssumption::Static } else { CameraAssumption::Tilted })
    }
}

impl EnvironmentConfig {
    /// Of which kind each known surface is: in the file's order, then, kind by kind, those of which it says nothing.
    pub fn kinds(&self) -> impl Iterator<Item = Kind> {
        let lengths = [self.plane.len(), self.r#box.len(), self.sphere.len(), self.mesh.len()];
        let rest = Kind::ALL.into_iter().zip(lengths).flat_map(|(kind, length)| {
            let told = self.order.iter().filter(|told| **told == kind).count();
            core::iter::repeat_n(kind, length.saturating_sub(told))
        });
        self.order.iter().copied().chain(rest)
    }
}
