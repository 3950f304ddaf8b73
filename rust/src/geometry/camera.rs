//! Pinhole camera: pixels and depth to points, and where the camera stands.

use crate::config::CameraConfig;
use crate::error::ConfigError;
use crate::math::{Mat3, Vec3};

/// How a sample of the depth image encodes the depth z.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum DepthCode {
    /// z = sample / `units_per_metre`; 0 is no reading.
    Depth {
        /// Samples per metre: 1000 for millimetres, 5000 in the TUM layout.
        units_per_metre: f64,
    },
    /// 1/z = c0 + c1 · sample, z in metres; 2047 is no reading.
    Disparity {
        /// `[c0, c1]`, both in 1/m.
        law: [f64; 2],
    },
}

/// A raw disparity sample that carries no reading.
pub const NO_DISPARITY: u16 = 2047;

/// `[c0, c1]` of 1/z = c0 + c1 · raw, in 1/m, of a Kinect v1 with this zero plane: distance of its projector, distance of the plane,
/// size of a pixel there (all cm), and `const_shift`. It is libfreenect's m = ((raw − 4 s) / 4 − 0.375) · p, z = m · r / (b − m) + r.
pub const fn disparity_law(emitter: f64, reference: f64, pixel: f64, shift: f64) -> [f64; 2] {
    [100.0 * (emitter + (shift + 0.375) * pixel) / (reference * emitter), -100.0 * pixel / 4.0 / (reference * emitter)]
}

/// The law of one real Kinect v1.
pub const KINECT_DISPARITY_LAW: [f64; 2] = disparity_law(7.5, 120.0, 0.1042, 200.0);

impl DepthCode {
    /// Depth z in metres of a sample, or `None` where there is no reading or none that can be (z ≤ 0).
    #[inline]
    pub fn depth(self, sample: u16) -> Option<f64> {
        let z = match self {
            Self::Depth { units_per_metre } => f64::from(sample) / units_per_metre,
            Self::Disparity { .. } if sample >= NO_DISPARITY => return None,
            Self::Disparity { law } => 1.0 / (law[0] + law[1] * f64::from(sample)),
        };
        (z > 0.0 && z.is_finite()).then_some(z)
    }

    /// The change of z, in metres, over one unit of the sample, at depth `z`.
    pub fn step(self, z: f64) -> f64 {
        match self {
            Self::Depth { units_per_metre } => 1.0 / units_per_metre,
            Self::Disparity { law } => law[1].abs() * z * z,
        }
    }
}

/// A pose: x in the world = rotation · x in the camera + translation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Rotation, camera axes to world axes.
    pub rotation: Mat3,
    /// The optical center in the world, m.
    pub translation: Vec3,
}

impl Pose {
    /// The world that is the camera's axes renamed: x right, y forward, z up.
    pub fn renamed_axes() -> Self {
        Self { rotation: Mat3::new(1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, -1.0, 0.0), translation: Vec3::zeros() }
    }

    /// The world of a camera in which gravity pulls along `gravity` (not zero): z up, y as forward as a level direction can be.
    pub fn level(gravity: &Vec3) -> Self {
        let up = -gravity.normalize();
        // Where it looks straight down the top of the image is forward, where it looks up the bottom.
        let forward = if up.z.abs() < 1.0 - 1e-9 { Vec3::z() } else { Vec3::new(0.0, up.z, 0.0) };
        Self { rotation: upright(&up, &forward), translation: Vec3::zeros() }
    }

    /// This pose, turned so that `gravity` (camera frame, not zero) pulls down the world's z: its heading and its place stay.
    pub fn levelled(&self, gravity: &Vec3) -> Self {
        let up = -gravity.normalize();
        let [x, y] = [0, 1].map(|axis| self.rotation.row(axis).transpose());
        // Where y is nearly upright, x tells the heading better.
        let forward = if up.dot(&y).abs() > 0.9 { up.cross(&x) } else { y };
        Self { rotation: upright(&up, &forward), translation: self.translation }
    }

    /// A point of the camera frame, in the world.
    pub fn to_world(&self, p: &Vec3) -> Vec3 {
        self.rotation * p + self.translation
    }

    /// A point of the world, in the camera frame.
    pub fn to_camera(&self, p: &Vec3) -> Vec3 {
        self.rotation.transpose() * (p - self.translation)
    }

    /// A covariance of the camera frame, in the world.
    pub fn covariance_to_world(&self, c: &Mat3) -> Mat3 {
        crate::math::symmetric(&(self.rotation * c * self.rotation.transpose()))
    }

    /// The homogeneous 4×4 matrix, as rows.
    pub fn to_rows(&self) -> [[f64; 4]; 4] {
        let (r, t) = (&self.rotation, &self.translation);
        let row = |i: usize| [r[(i, 0)], r[(i, 1)], r[(i, 2)], t[i]];
        [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]]
    }

    /// From a homogeneous 4×4 matrix, as rows; `None` where it is not rigid to 1e-6.
    pub fn from_rows(m: &[[f64; 4]; 4]) -> Option<Self> {
        let rotation = Mat3::from_fn(|i, j| m[i][j]);
        let translation = Vec3::from_fn(|i, _| m[i][3]);
        let rigid = (rotation.transpose() * rotation - Mat3::identity()).abs().max() < 1e-6
            && rotation.determinant() > 0.0
            && m[3] == [0.0, 0.0, 0.0, 1.0]
            && translation.iter().all(|x| x.is_finite());
        rigid.then_some(Self { rotation, translation })
    }
}

/// World axes in the camera: z along `up` (a unit vector), y as near to `forward` as a level direction can be.
fn upright(up: &Vec3, forward: &Vec3) -> Mat3 {
    let y = (forward - up * up.dot(forward)).normalize();
    Mat3::from_rows(&[y.cross(up).transpose(), y.transpose(), up.transpose()])
}

/// A calibrated pinhole camera. Pixel centers are at integers; the camera frame is x right, y down, z forward.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Columns of the image, px.
    pub width: usize,
    /// Rows of the image, px.
    pub height: usize,
    /// Focal length in columns, px.
    pub fx: f64,
    /// Focal length in rows, px.
    pub fy: f64,
    /// Column of the principal point, px.
    pub cx: f64,
    /// Row of the principal point, px.
    pub cy: f64,
    /// How samples encode depth.
    pub code: DepthCode,
    /// Readings beyond this are ignored, m.
    pub max_depth: f64,
    /// Time from the readout of the first row to that of the last, s; a frame's stamp is its first row's.
    pub readout: f64,
    /// Where the camera stands, if that was told.
    pub pose: Option<Pose>,
    /// Where an accelerometer in it says that gravity pulls, camera frame, m/s².
    pub gravity: Option<Vec3>,
}

impl Camera {
    /// The camera of `keys`, with the Kinect v1's values where a key is left out. Samples are disparity where the source says so by `code`,
    /// or the keys by `disparity = true`: then `disparity_law` holds, before the law of `code`. Else they are depth, and `depth_scale` holds.
    /// At another size than the Kinect's 640 × 480 its intrinsics would be wrong: they must be told then.
    ///
    /// # Errors
    /// A key whose value can't be, or that is missing.
    pub fn from_config(keys: &CameraConfig, code: DepthCode) -> Result<Self, ConfigError> {
        keys.validate()?;
        let (width, height) = (keys.width.unwrap_or(640), keys.height.unwrap_or(480));
        let intrinsics = [("camera.fx", keys.fx), ("camera.fy", keys.fy), ("camera.cx", keys.cx), ("camera.cy", keys.cy)];
        let missing = intrinsics.into_iter().find(|(_, value)| value.is_none());
        if let Some((key, _)) = missing.filter(|_| (width, height) != (640, 480)) {
            let expected = "fx, fy, cx and cy, the intrinsics of a camera that is not 640 × 480";
            return Err(ConfigError { key, value: f64::NAN, expected });
        }
        let (cx, cy) = (keys.cx.unwrap_or(319.5), keys.cy.unwrap_or(239.5));
        for (key, value, size) in [("camera.cx", cx, width), ("camera.cy", cy, height)] {
            let size = f64::from(size);
            if !(-size..=2.0 * size).contains(&value) {
                return Err(ConfigError { key, value, expected: "a principal point at most one image outside of the image, px" });
            }
        }
        let disparity = |law| DepthCode::Disparity { law: keys.disparity_law.unwrap_or(law) };
        let code = match code {
            DepthCode::Disparity { law } => disparity(law),
            DepthCode::Depth { .. } if keys.disparity == Some(true) => disparity(KINECT_DISPARITY_LAW),
            DepthCode::Depth { units_per_metre } => DepthCode::Depth { units_per_metre: keys.depth_scale.unwrap_or(units_per_metre) },
        };
        Ok(Self {
            width: width as usize,
            height: height as usize,
            fx: keys.fx.unwrap_or(575.8),
            fy: keys.fy.unwrap_or(575.8),
            cx,
            cy,
            code,
            max_depth: keys.max_depth.unwrap_or(10.0),
            readout: keys.readout.unwrap_or(0.0),
            pose: keys.world_from_camera.as_ref().and_then(Pose::from_rows),
            gravity: keys.gravity_in_camera.map(Vec3::from),
        })
    }

    /// The keys that tell of this camera: [`Camera::from_config`] makes it of them again.
    pub fn to_config(&self) -> CameraConfig {
        let (depth_scale, disparity_law) = match self.code {
            DepthCode::Depth { units_per_metre } => (Some(units_per_metre), None),
            DepthCode::Disparity { law } => (None, Some(law)),
        };
        CameraConfig {
            width: Some(self.width as u32),
            height: Some(self.height as u32),
            fx: Some(self.fx),
            fy: Some(self.fy),
            cx: Some(self.cx),
            cy: Some(self.cy),
            depth_scale,
            disparity: disparity_law.is_some().then_some(true),
            disparity_law,
            max_depth: Some(self.max_depth),
            readout: Some(self.readout),
            world_from_camera: self.pose.map(|pose| pose.to_rows()),
            gravity_in_camera: self.gravity.map(Into::into),
        }
    }

    /// The world of its stream: that of its pose; else level, as far as it is told where gravity pulls; else its axes renamed.
    pub fn world(&self) -> Pose {
        let level = || self.gravity.as_ref().map(Pose::level);
        self.pose.or_else(level).unwrap_or_else(Pose::renamed_axes)
    }

    /// The point at depth `z` (m) on the ray of pixel (`column`, `row`), camera frame.
    #[inline]
    pub fn deproject(&self, column: f64, row: f64, z: f64) -> Vec3 {
        Vec3::new((column - self.cx) / self.fx * z, (row - self.cy) / self.fy * z, z)
    }

    /// Time from one row's readout to the next one's, s.
    #[inline]
    pub fn row_time(&self) -> f64 {
        self.readout / (self.height as f64 - 1.0).max(1.0)
    }

    /// Column and row (px) of a point of the camera frame; `None` where it is not in front of the camera.
    #[inline]
    pub fn project(&self, p: &Vec3) -> Option<(f64, f64)> {
        (p.z > 0.0).then(|| (p.x / p.z * self.fx + self.cx, p.y / p.z * self.fy + self.cy))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_kinects_own_law_gives_the_known_depths() {
        let code = DepthCode::Disparity { law: KINECT_DISPARITY_LAW };
        for (raw, mm) in [(600, 705.0), (700, 887.0), (800, 1193.0), (900, 1824.0), (1000, 3864.0), (1050, 8767.0)] {
            assert!((code.depth(raw).unwrap() * 1000.0 - mm).abs() < 1.0, "{raw}");
        }
        assert_eq!(code.depth(1090), None);
        assert_eq!(code.depth(2047), None);
    }

    #[test]
    fn a_level_world_is_upright_and_looks_forward() {
        let world = |x, y, z| Pose::level(&Vec3::new(x, y, z));
        assert_eq!(world(0.0, 9.81, 0.0), Pose::renamed_axes());
        for (x, y, z) in [(0.0, 0.0, 9.8), (0.0, 0.0, -9.8), (0.0, 1e-7, 9.8), (3.0, 9.0, 1.0), (-9.8, 0.0, 0.0), (0.1, -9.8, 0.3)] {
            let (pose, gravity) = (world(x, y, z), Vec3::new(x, y, z));
            assert!((pose.rotation * gravity - Vec3::new(0.0, 0.0, -gravity.norm())).norm() < 1e-12, "{gravity}");
            assert!(Pose::from_rows(&pose.to_rows()).is_some(), "{gravity}");
            let forward = pose.rotation * Vec3::z();
            assert!(forward.x.abs() < 1e-12 && forward.y >= 0.0, "{gravity}");
        }
        // Down: what is at the top of the image is in front.
        assert!((world(0.0, 0.0, 9.8).rotation * -Vec3::y() - Vec3::y()).norm() < 1e-12);
        assert!((world(0.0, 1e-3, 9.8).rotation * -Vec3::y() - Vec3::y()).norm() < 1e-3);
    }

    #[test]
    fn disparity_is_what_the_source_or_the_keys_say() {
        let code = |disparity, depth_scale, law: Option<[f64; 2]>, code| {
            let keys = CameraConfig { disparity, depth_scale, disparity_law: law, ..CameraConfig::default() };
            Camera::from_config(&keys, code).unwrap().code
        };
        let (own, told) = ([3.0, -0.003], [4.0, -0.004]);
        let (depth, raw) = (DepthCode::Depth { units_per_metre: 1000.0 }, DepthCode::Disparity { law: own });
        for disparity in [None, Some(false), Some(true)] {
            for scale in [None, Some(5000.0)] {
                assert_eq!(code(disparity, scale, None, raw), raw);
                assert_eq!(code(disparity, scale, Some(told), raw), DepthCode::Disparity { law: told });
            }
        }
        assert_eq!(code(Some(true), Some(5000.0), None, depth), DepthCode::Disparity { law: KINECT_DISPARITY_LAW });
        assert_eq!(code(Some(true), None, Some(told), depth), DepthCode::Disparity { law: told });
        for disparity in [None, Some(false)] {
            assert_eq!(code(disparity, None, Some(told), depth), depth);
            assert_eq!(code(disparity, Some(5000.0), None, depth), DepthCode::Depth { units_per_metre: 5000.0 });
        }
    }

    #[test]
    fn only_at_its_own_size_is_a_camera_a_kinect() {
        let wrong = |keys: &CameraConfig| Camera::from_config(keys, DepthCode::Depth { units_per_metre: 1000.0 }).err().map(|e| e.key);
        let small = CameraConfig { width: Some(320), height: Some(240), fx: Some(288.0), fy: Some(288.0), ..CameraConfig::default() };
        let whole = CameraConfig { cx: Some(160.0), cy: Some(120.0), ..small.clone() };
        assert_eq!(wrong(&CameraConfig::default()), None);
        assert_eq!(wrong(&CameraConfig { width: Some(320), ..CameraConfig::default() }), Some("camera.fx"));
        assert_eq!(wrong(&small), Some("camera.cx"));
        assert_eq!(wrong(&whole), None);
        assert_eq!(wrong(&CameraConfig { cx: Some(-320.0), cy: Some(480.0), ..whole.clone() }), None);
        assert_eq!(wrong(&CameraConfig { cx: Some(640.5), ..whole.clone() }), Some("camera.cx"));
        assert_eq!(wrong(&CameraConfig { cy: Some(-240.5), ..whole }), Some("camera.cy"));
    }
}
