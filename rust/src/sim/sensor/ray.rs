//! Ray casting: convex forms and solids, and where rays enter them.

use crate::geometry::camera::Pose;
use crate::math::{Mat3, Vec3};
use crate::sim::impact::Solid;
use std::vec::Vec;

/// A convex form.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Form {
    /// A sphere.
    Sphere {
        /// m.
        radius: f64,
    },
    /// A box.
    Box {
        /// Half of its edges, m.
        half: Vec3,
    },
}

/// Where a form is, camera frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// Its middle, m.
    pub center: Vec3,
    /// Its axes to the camera's.
    pub axes: Mat3,
}

/// Something that moves, as the sensor meets it: a ball, or a part of a rigid thing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Target<'a> {
    /// What it is.
    pub form: Form,
    /// Where it is at each row's time: one per row of the image, or one for all.
    pub places: &'a [Place],
}

impl Target<'_> {
    /// Radius of the sphere around it, m.
    pub(super) fn reach(&self) -> f64 {
        match self.form {
            Form::Sphere { radius } => radius,
            Form::Box { half } => half.norm(),
        }
    }

    /// Where the ray `origin` + s · `ray` enters it at the time of `row`, s > 0, and the cosine of incidence.
    pub(super) fn enter(&self, row: i32, origin: &Vec3, ray: &Vec3) -> Option<(f64, f64)> {
        let place = &self.places[row.clamp(0, self.places.len() as i32 - 1) as usize];
        match self.form {
            Form::Sphere { radius } => enter_sphere(origin, ray, &place.center, radius),
            Form::Box { half } => enter_box(&place.axes.tr_mul(&(origin - place.center)), &place.axes.tr_mul(ray), &half),
        }
    }
}

/// A solid in the camera frame at the first frame: inside is where every half-space holds, normal · p ≤ offset.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Convex {
    pub(super) sides: Vec<(Vec3, f64)>,
}

impl Convex {
    pub(super) fn new(solid: &Solid, pose: &Pose) -> Self {
        let faces = (0..solid.faces()).map(|f| solid.face(f));
        let turned = |n: Vec3, offset: f64| (pose.rotation.transpose() * n, offset - n.dot(&pose.translation));
        Self { sides: faces.map(|(_, n, offset)| turned(n, offset)).collect() }
    }

    /// Where the ray `origin` + s · `ray` enters, s > 0, and the cosine of incidence.
    pub(super) fn enter(&self, origin: &Vec3, ray: &Vec3) -> Option<(f64, f64)> {
        let (mut enter, mut leave, mut cos) = (0.0, f64::INFINITY, 1.0);
        for (normal, offset) in &self.sides {
            let (speed, gap) = (normal.dot(ray), offset - normal.dot(origin));
            if speed < 0.0 && gap / speed > enter {
                (enter, cos) = (gap / speed, -speed / ray.norm());
            } else if speed > 0.0 {
                leave = f64::min(leave, gap / speed);
            } else if gap < 0.0 && speed == 0.0 {
                return None;
            }
        }
        (enter > 0.0 && enter < leave).then_some((enter, cos))
    }
}

/// Where the ray s · `ray` from `origin` enters a sphere, s > 0, and the cosine of incidence.
fn enter_sphere(origin: &Vec3, ray: &Vec3, center: &Vec3, radius: f64) -> Option<(f64, f64)> {
    let (to, a) = (center - origin, ray.norm_squared());
    let b = to.dot(ray);
    let discriminant = b * b - a * (to.norm_squared() - radius * radius);
    if discriminant <= 0.0 {
        return None;
    }
    let root = discriminant.sqrt();
    let s = (b - root) / a;
    (s > 0.0).then(|| (s, root / (a.sqrt() * radius)))
}

/// Where the ray `origin` + s · `ray` enters the box of these half edges around the origin, s > 0, and the cosine of incidence.
fn enter_box(origin: &Vec3, ray: &Vec3, half: &Vec3) -> Option<(f64, f64)> {
    let (mut enter, mut leave, mut speed) = (0.0, f64::INFINITY, 0.0);
    // Most rays miss the sphere around it, which is cheaper.
    if origin.cross(ray).norm_squared() > half.norm_squared() * ray.norm_squared() {
        return None;
    }
    for i in 0..3 {
        // Infinite where the ray runs along the faces, with signs that make it miss or not.
        let (a, b) = ((-half[i] - origin[i]) / ray[i], (half[i] - origin[i]) / ray[i]);
        if a.min(b) > enter {
            (enter, speed) = (a.min(b), ray[i].abs());
        }
        leave = f64::min(leave, a.max(b));
    }
    (enter > 0.0 && enter < leave).then(|| (enter, speed / ray.norm()))
}
