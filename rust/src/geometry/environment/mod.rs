//! The known environment E: planes, boxes, spheres and meshes, what a camera sees behind the objects, which of them a ball touches, and how far a
//! ray sees.

#[cfg(feature = "std")]
mod mesh;
mod relief;
mod sweep;
#[cfg(feature = "std")]
mod topology;

#[cfg(feature = "std")]
pub use mesh::Mesh;
pub use relief::{Cell, Plane, Relief, Space};
pub use sweep::Sweep;
#[cfg(feature = "std")]
pub use topology::MeshError;

use crate::config::{EnvironmentConfig, Kind, KnownBox, KnownPlane, KnownSphere, Name};
use crate::math::{Mat3, Vec3, sqrt};
use heapless::Vec;
use nalgebra::{Quaternion, UnitQuaternion};
use parry3d::math::Vec3 as Single;
use parry3d::query::{Ray, RayCast};
use parry3d::shape::{Ball, Cuboid, HalfSpace};

/// A mesh, read once and shared by whoever knows it.
#[cfg(feature = "std")]
pub type SharedMesh = std::sync::Arc<Mesh>;
/// Without `std` there are no meshes.
#[cfg(not(feature = "std"))]
pub type SharedMesh = core::convert::Infallible;

/// What a surface is known to be.
#[derive(Clone, Debug, PartialEq)]
enum Shape {
    Plane,
    Box {
        center: Vec3,
        half: Vec3,
        rotation: Mat3,
    },
    Sphere {
        center: Vec3,
        radius: f64,
    },
    #[cfg(feature = "std")]
    Mesh {
        mesh: SharedMesh,
        origin: Vec3,
        rotation: Mat3,
    },
}

/// A known surface.
#[derive(Clone, Debug, PartialEq)]
pub struct KnownSurface {
    /// As configured.
    pub name: Name,
    /// Unit normal: a plane's, or that at the top of a body.
    pub normal: Vec3,
    /// normal · p = offset there, m.
    pub offset: f64,
    shape: Shape,
}

/// All known surfaces; ids are their places. What a camera sees besides can be touched like them, but has no id that is told: its planes are counted
/// on from the last one.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Environment {
    surfaces: Vec<KnownSurface, { Environment::CAPACITY }>,
    relief: Option<Relief>,
}

/// How far a real surface may be from where it is said to be, m.
pub const SURVEY_SD: f64 = 0.003;

impl Environment {
    /// Surfaces that are told at the most.
    pub const CAPACITY: usize = 28;
    /// And with planes that a camera sees.
    pub const ALL: usize = Self::CAPACITY + Relief::PLANES;

    /// The environment of a valid configuration.
    pub fn new(config: &EnvironmentConfig) -> Self {
        let mut planes = config.plane.iter().map(KnownSurface::plane);
        let mut boxes = config.r#box.iter().map(KnownSurface::cuboid);
        let mut spheres = config.sphere.iter().map(KnownSurface::sphere);
        #[cfg(feature = "std")]
        let mut meshes = config.mesh.iter().filter_map(KnownSurface::mesh);
        let surfaces = config.kinds().filter_map(|kind| match kind {
            Kind::Plane => planes.next(),
            Kind::Box => boxes.next(),
            Kind::Sphere => spheres.next(),
            #[cfg(feature = "std")]
            Kind::Mesh => meshes.next(),
            #[cfg(not(feature = "std"))]
            Kind::Mesh => None,
        });
        // There is room for all that a configuration has room for.
        Self { surfaces: surfaces.take(Self::CAPACITY).collect(), relief: None }
    }

    /// Learns what a camera sees, in place of what it saw before.
    pub fn see(&mut self, relief: Relief) {
        self.relief = Some(relief);
    }

    /// Turns the plane of this id to its other side, where it was touched.
    pub fn turn(&mut self, id: u32) {
        if let Some(plane) = self.surfaces.get_mut(id as usize).filter(|surface| matches!(surface.shape, Shape::Plane)) {
            (plane.normal, plane.offset) = (-plane.normal, -plane.offset);
        }
    }

    /// The surfaces that were told.
    pub fn surfaces(&self) -> &[KnownSurface] {
        &self.surfaces
    }

    /// What a camera sees, once that is learned.
    pub fn relief(&self) -> Option<&Relief> {
        self.relief.as_ref()
    }

    /// Surfaces that were told and planes that are seen.
    pub fn count(&self) -> usize {
        self.surfaces.len() + self.relief.as_ref().map_or(0, |relief| relief.planes().len())
    }

    /// Whether something other than the known surfaces may be within `reach` (m) of `p` (world, m) even where the scene is known: a thing that the camera
    /// sees, or, where no surface was told and all that is known is what it sees, anything that it does not.
    pub fn is_open(&self, p: &Vec3, reach: f64) -> bool {
        self.relief.as_ref().is_some_and(|relief| match relief.space(p, reach) {
            Space::Free => false,
            Space::Unseen => self.surfaces.is_empty(),
            Space::Thing => true,
        })
    }

    /// How many times `ray` (m) a ray from `origin` (m, both world frame) goes until it meets a surface that was told, at most `longest` times.
    pub fn cast(&self, origin: &Vec3, ray: &Vec3, longest: f64) -> Option<f64> {
        self.surfaces.iter().filter_map(|surface| surface.cast(origin, ray, longest)).min_by(f64::total_cmp)
    }

    /// Id of the surface that a ball of `radius` (m) at `center` (with covariance, m²) touches, of those that were told, and the normal there.
    pub fn touched(&self, center: &Vec3, covariance: &Mat3, radius: f64) -> Option<(u32, Vec3)> {
        let nearest = self.surfaces.iter().enumerate().map(|(id, s)| {
            let (distance, normal) = s.distance(center);
            ((distance - radius).abs(), id as u32, normal)
        });
        let (miss, id, normal) = nearest.min_by(|a, b| a.0.total_cmp(&b.0))?;
        let sd = sqrt(normal.dot(&(covariance * normal)) + SURVEY_SD * SURVEY_SD);
        (miss < 4.0 * sd).then_some((id, normal))
    }

    /// The same of the planes that a camera sees.
    pub fn seen_touched(&self, center: &Vec3, covariance: &Mat3, radius: f64) -> Option<(u32, Vec3)> {
        let relief = self.relief.as_ref()?;
        let nearest = relief.near(center).min_by(|a, b| (a.1 - radius).abs().total_cmp(&(b.1 - radius).abs()));
        let (number, distance, normal) = nearest?;
        let own = relief.sd(number, center);
        let sd = sqrt(normal.dot(&(covariance * normal)) + SURVEY_SD * SURVEY_SD + own * own);
        ((distance - radius).abs() < 4.0 * sd).then_some(((self.surfaces.len() + number) as u32, normal))
    }
}

impl KnownSurface {
    fn plane(known: &KnownPlane) -> Self {
        Self { name: known.name.clone(), normal: known.normal.into(), offset: known.offset, shape: Shape::Plane }
    }

    fn cuboid(known: &KnownBox) -> Self {
        let turn = known.rotation.map_or_else(
            || UnitQuaternion::from_axis_angle(&Vec3::z_axis(), known.yaw),
            |[w, x, y, z]| UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z)),
        );
        let rotation = turn.to_rotation_matrix().into_inner();
        let (center, half) = (Vec3::from(known.center), Vec3::from(known.size) * 0.5);
        // The face that looks up most.
        let face = (0..3).max_by(|&i, &j| rotation[(2, i)].abs().total_cmp(&rotation[(2, j)].abs())).unwrap_or(2);
        let normal: Vec3 = rotation.column(face) * 1f64.copysign(rotation[(2, face)]);
        let offset = normal.dot(&center) + half[face];
        Self { name: known.name.clone(), normal, offset, shape: Shape::Box { center, half, rotation } }
    }

    fn sphere(known: &KnownSphere) -> Self {
        let (center, radius) = (Vec3::from(known.center), known.radius);
        Self { name: known.name.clone(), normal: Vec3::z(), offset: center.z + radius, shape: Shape::Sphere { center, radius } }
    }

    /// `None` where it is not read: a valid configuration's are.
    #[cfg(feature = "std")]
    fn mesh(known: &crate::config::KnownMesh) -> Option<Self> {
        let mesh = known.solid.clone()?;
        let pose = known.pose.unwrap_or([[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]);
        let (origin, rotation) = (Vec3::from_fn(|i, _| pose[i][3]), Mat3::from_fn(|i, j| pose[i][j]));
        let (normal, point) = mesh.top(&rotation.row(2).transpose()).unwrap_or((Vec3::z(), Vec3::zeros()));
        let normal = rotation * normal;
        let offset = normal.dot(&(origin + rotation * point));
        Some(Self { name: known.name.clone(), normal, offset, shape: Shape::Mesh { mesh, origin, rotation } })
    }

    fn cast(&self, origin: &Vec3, ray: &Vec3, longest: f64) -> Option<f64> {
        let single = |v: Vec3| Single::new(v.x as f32, v.y as f32, v.z as f32);
        let local = |origin: Vec3, ray: Vec3| Ray::new(single(origin), single(ray));
        let longest = longest as f32;
        let times = match &self.shape {
            Shape::Plane => {
                let (height, normal) = self.distance(origin);
                HalfSpace::new(single(normal)).cast_local_ray(&local(normal * height, *ray), longest, true)
            }
            Shape::Sphere { center, radius } => Ball::new(*radius as f32).cast_local_ray(&local(origin - center, *ray), longest, true),
            Shape::Box { center, half, rotation } => {
                let turn = rotation.transpose();
                Cuboid::new(single(*half)).cast_local_ray(&local(turn * (origin - center), turn * ray), longest, true)
            }
            #[cfg(feature = "std")]
            Shape::Mesh { mesh, origin: own, rotation } => {
                let turn = rotation.transpose();
                return mesh.cast(&(turn * (origin - own)), &(turn * ray), longest.into());
            }
        }?;
        // Who stands inside sees nothing of it.
        (times > 0.0).then_some(times.into())
    }

    /// Distance of `p` from the surface, negative inside, and the unit normal towards `p` there. A plane has two sides and no inside.
    fn distance(&self, p: &Vec3) -> (f64, Vec3) {
        match &self.shape {
            Shape::Plane => {
                let height = self.normal.dot(p) - self.offset;
                (height.abs(), self.normal * 1f64.copysign(height))
            }
            Shape::Sphere { center, radius } => {
                let away = p - center;
                (away.norm() - radius, away.try_normalize(1e-12).unwrap_or(self.normal))
            }
            Shape::Box { center, half, rotation } => {
                let local = rotation.transpose() * (p - center);
                let outside = local - local.zip_map(half, |x, h| x.clamp(-h, h));
                if let Some(normal) = outside.try_normalize(1e-12) {
                    return (outside.norm(), rotation * normal);
                }
                let depth = |i: usize| half[i] - local[i].abs();
                let face = (0..3).min_by(|&i, &j| depth(i).total_cmp(&depth(j))).unwrap_or(2);
                (-depth(face), rotation.column(face) * 1f64.copysign(local[face]))
            }
            #[cfg(feature = "std")]
            Shape::Mesh { mesh, origin, rotation } => {
                let (distance, normal) = mesh.distance(&(rotation.transpose() * (p - origin)));
                (distance, rotation * normal)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{KnownBox, KnownPlane, KnownSphere};

    #[test]
    fn a_ball_touches_what_is_one_radius_away() {
        let mut config = EnvironmentConfig::default();
        config.plane.push(KnownPlane::default()).unwrap();
        let known = KnownBox { center: [1.0, 2.0, 0.045], size: [0.44, 0.34, 0.09], yaw: 0.1, ..KnownBox::default() };
        config.r#box.push(known).unwrap();
        config.sphere.push(KnownSphere { center: [-1.0, 0.0, 0.5], radius: 0.5, ..KnownSphere::default() }).unwrap();
        let e = Environment::new(&config);
        let c = Mat3::from_diagonal_element(1e-6);
        assert_eq!(e.surfaces()[1].offset, 0.09);
        assert_eq!(e.touched(&Vec3::new(0.0, 1.0, 0.033), &c, 0.033), Some((0, Vec3::z())));
        assert_eq!(e.touched(&Vec3::new(1.0, 2.0, 0.123), &c, 0.033).unwrap().0, 1);
        let (id, normal) = e.touched(&Vec3::new(1.0 + 0.253, 2.0253, 0.05), &c, 0.033).unwrap();
        assert!(id == 1 && (normal.x - libm::cos(0.1)).abs() < 1e-9);
        assert_eq!(e.touched(&Vec3::new(-1.0, 0.0, 1.033), &c, 0.033).unwrap().0, 2);
        assert_eq!(e.touched(&Vec3::new(0.0, 1.0, 0.5), &c, 0.033), None);
    }
    #[test]
    fn a_ray_ends_at_the_nearest_surface() {
        let mut config = EnvironmentConfig::default();
        config.plane.push(KnownPlane::default()).unwrap();
        let known = KnownBox { center: [0.0, 2.0, 0.5], size: [1.0, 1.0, 1.0], yaw: core::f64::consts::FRAC_PI_4, ..KnownBox::default() };
        config.r#box.push(known).unwrap();
        config.sphere.push(KnownSphere { center: [-3.0, 2.0, 1.0], radius: 0.5, ..KnownSphere::default() }).unwrap();
        let e = Environment::new(&config);
        let eye = Vec3::new(0.0, 0.0, 1.0);
        let meets = |ray: Vec3, times: Option<f64>| match (e.cast(&eye, &ray, 10.0), times) {
            (Some(got), Some(times)) => assert!((got - times).abs() < 1e-5, "{ray} {got}"),
            (got, times) => assert_eq!(got, times, "{ray}"),
        };
        meets(Vec3::new(0.0, 2.0, -0.5), Some(1.0 - sqrt(0.125)));
        meets(Vec3::new(2.0, 1.0, -0.2), Some(5.0));
        meets(Vec3::new(2.0, 1.0, -0.05), None);
        meets(Vec3::new(-3.0, 2.0, 0.0), Some(1.0 - 0.5 / sqrt(13.0)));
        meets(Vec3::new(0.0, 0.0, 1.0), None);
    }
}
