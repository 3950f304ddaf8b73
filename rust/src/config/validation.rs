//! Which values a configuration can't have.

use super::{CameraAssumption, CameraConfig, Config, EnvironmentConfig, LawName, Method, ObjectConfig, ObjectsAssumption};
use crate::error::ConfigError;

/// `Ok` where `value` lies in `low..=high`.
fn within(key: &'static str, value: f64, low: f64, high: f64, expected: &'static str) -> Result<(), ConfigError> {
    if value >= low && value <= high { Ok(()) } else { Err(ConfigError { key, value, expected }) }
}

fn finite(key: &'static str, values: &[f64]) -> Result<(), ConfigError> {
    match values.iter().find(|x| !x.is_finite()) {
        None => Ok(()),
        Some(_) => Err(ConfigError { key, value: f64::NAN, expected: "finite numbers" }),
    }
}

fn unit(key: &'static str, values: &[f64]) -> Result<(), ConfigError> {
    let square: f64 = values.iter().map(|x| x * x).sum();
    within(key, square, 1.0 - 1e-6, 1.0 + 1e-6, "a vector of length 1 (the value shown is its length squared)")
}

/// `Ok` for a pose that is one, or none.
fn rigid(key: &'static str, pose: Option<&[[f64; 4]; 4]>) -> Result<(), ConfigError> {
    match pose {
        Some(pose) if crate::geometry::camera::Pose::from_rows(pose).is_none() => {
            Err(ConfigError { key, value: f64::NAN, expected: "4 rows of 4, a rotation and a translation" })
        }
        _ => Ok(()),
    }
}

/// The first of these (whether it is asked for, key, what is expected) that is asked for.
fn refuse(cases: &[(bool, &'static str, &'static str)]) -> Result<(), ConfigError> {
    match cases.iter().find(|(asked, ..)| *asked) {
        Some(&(_, key, expected)) => Err(ConfigError { key, value: f64::NAN, expected }),
        None => Ok(()),
    }
}

impl CameraConfig {
    /// # Errors
    /// The first key whose value can't be.
    pub fn validate(&self) -> Result<(), ConfigError> {
        let size = |key, n: Option<u32>| n.map_or(Ok(()), |n| within(key, f64::from(n), 16.0, 8192.0, "16 to 8192 px"));
        let number = |key, x: Option<f64>, low, high, expected| x.map_or(Ok(()), |x| within(key, x, low, high, expected));
        size("camera.width", self.width)?;
        size("camera.height", self.height)?;
        number("camera.fx", self.fx, 10.0, 1e5, "a focal length of 10 to 100000 px")?;
        number("camera.fy", self.fy, 10.0, 1e5, "a focal length of 10 to 100000 px")?;
        number("camera.cx", self.cx, -8192.0, 16384.0, "a column, px")?;
        number("camera.cy", self.cy, -8192.0, 16384.0, "a row, px")?;
        number("camera.depth_scale", self.depth_scale, 1.0, 1e6, "1 to 1000000 units a metre")?;
        number("camera.max_depth", self.max_depth, 0.1, 1000.0, "0.1 to 1000 m")?;
        number("camera.readout", self.readout, 0.0, 1.0, "0 to 1 s")?;
        if let Some([c0, c1]) = self.disparity_law {
            finite("camera.disparity_law", &[c0, c1])?;
            if c1 == 0.0 || (c0 <= 0.0 && c1 < 0.0) {
                return Err(ConfigError {
                    key: "camera.disparity_law",
                    value: c1,
                    expected: "[c0, c1] that make 1/z = c0 + c1 · raw positive",
                });
            }
        }
        rigid("camera.world_from_camera", self.world_from_camera.as_ref())?;
        if let Some(gravity) = &self.gravity_in_camera {
            finite("camera.gravity_in_camera", gravity)?;
            let size = crate::math::Vec3::from(*gravity).norm();
            within("camera.gravity_in_camera", size, 0.1, 100.0, "a vector of 0.1 to 100 m/s² (the value shown is its length)")?;
        }
        Ok(())
    }
}

impl Config {
    /// # Errors
    /// The first key whose value can't be.
    pub fn validate(&self) -> Result<(), ConfigError> {
        self.camera.validate()?;
        self.object.validate()?;
        self.refuse_what_is_to_come()?;
        let laws = &self.laws;
        finite("laws.gravity", &laws.gravity)?;
        let size = crate::math::Vec3::from(laws.gravity).norm();
        within("laws.gravity", size, 0.1, 100.0, "a vector of 0.1 to 100 m/s² (the value shown is its length)")?;
        within("laws.air_density", laws.air_density, 0.0, 2000.0, "0 to 2000 kg/m³")?;
        within("laws.theta", laws.theta, 1e-6, 10.0, "1e-6 to 10 m")?;
        within("laws.false_alarm", laws.false_alarm, 1e-12, 0.5, "a probability of 1e-12 to 0.5")?;
        within("tracking.background_frames", f64::from(self.tracking.background_frames), 0.0, 10_000.0, "0 to 10000 frames")?;
        if let Some(sd) = self.tracking.position_sd {
            within("tracking.position_sd", sd, 1e-7, 10.0, "1e-7 to 10 m")?;
        }
        self.environment.validate()
    }

    /// Whether a user's own law may stand in for the configuration's.
    ///
    /// # Errors
    /// The first key that says how objects move, or that the camera does.
    pub fn can_obey(&self) -> Result<(), ConfigError> {
        let beside = [
            (self.laws.law != LawName::FreeFall, "laws.law", "\"free_fall\" beside a law of your own, which replaces it"),
            (self.laws.method != Method::Best, "laws.method", "\"best\" beside a law of your own: the paper's method knows free fall only"),
            (
                self.assume.camera.is_some_and(CameraAssumption::moves),
                "assume.camera",
                "\"static\" or \"tilted\" beside a law of your own, which is one of the world",
            ),
        ];
        refuse(&beside)
    }

    /// What the interface names and this version can't do is refused here, in one place, never passed over.
    fn refuse_what_is_to_come(&self) -> Result<(), ConfigError> {
        let to_come = [
            (self.laws.magnus, "laws.magnus", "false: this version has no Magnus force"),
            (
                self.assume.objects == ObjectsAssumption::Unknown && self.assume.camera.is_some_and(CameraAssumption::moves),
                "assume.objects",
                "\"passive\" where the camera moves: which of the two accelerates, physics does not tell",
            ),
        ];
        refuse(&to_come)
    }
}

impl ObjectConfig {
    fn validate(&self) -> Result<(), ConfigError> {
        let radii = self.radius.as_slice();
        if radii.is_empty() {
            return Err(ConfigError { key: "object.radius", value: f64::NAN, expected: "at least one radius" });
        }
        for &radius in radii {
            within("object.radius", radius, 1e-3, 5.0, "0.001 to 5 m")?;
        }
        within("object.mass", self.mass, 1e-6, 1e4, "1e-6 to 10000 kg")?;
        within("object.drag_coefficient", self.drag_coefficient, 0.0, 10.0, "0 to 10")?;
        within("object.contact_duration", self.contact_duration, 0.0, 0.05, "0 to 0.05 s")?;
        within("object.spin_sd", self.spin_sd, 0.0, 1e4, "0 to 10000 rad/s")
    }
}

impl EnvironmentConfig {
    fn validate(&self) -> Result<(), ConfigError> {
        for plane in &self.plane {
            unit("environment.plane.normal", &plane.normal)?;
            finite("environment.plane.offset", &[plane.offset])?;
        }
        for known in &self.r#box {
            finite("environment.box.center", &known.center)?;
            finite("environment.box.yaw", &[known.yaw])?;
            let turned_twice = known.rotation.is_some() && known.yaw != 0.0;
            refuse(&[(turned_twice, "environment.box.yaw", "yaw or rotation, not both")])?;
            for edge in known.size {
                within("environment.box.size", edge, 1e-6, 1e4, "edges of 1e-6 to 10000 m")?;
            }
            if let Some(rotation) = &known.rotation {
                unit("environment.box.rotation", rotation)?;
            }
        }
        for sphere in &self.sphere {
            finite("environment.sphere.center", &sphere.center)?;
            within("environment.sphere.radius", sphere.radius, 1e-6, 1e4, "1e-6 to 10000 m")?;
        }
        for mesh in &self.mesh {
            rigid("environment.mesh.pose", mesh.pose.as_ref())?;
            if mesh.solid.is_none() {
                let expected = "a mesh that is read (`config_file::read_meshes` does; without `std` there are none)";
                return Err(ConfigError { key: "environment.mesh.path", value: f64::NAN, expected });
            }
        }
        Ok(())
    }
}
