//! A known body of any shape, by the triangles of its surface.

use super::sweep::first_touch;
use super::topology::{MeshError, body};
use crate::math::Vec3;
use parry3d::bounding_volume::{Aabb, BoundingVolume};
use parry3d::math::Vec3 as Single;
use parry3d::query::details::RayCullingMode;
use parry3d::query::{PointQuery, PointQueryWithLocation, Ray};
use parry3d::shape::{TriMesh, TriMeshFlags, Triangle};
use std::vec::Vec;

/// Triangles that bound a body. Points and ways are in its own frame, m.
pub struct Mesh {
    triangles: TriMesh,
}

impl Mesh {
    /// Of `vertices` (m) and `triangles` of them, counter-clockwise as seen from outside. Vertices at the same place are one.
    ///
    /// # Errors
    /// Why they bound no body.
    pub fn new(vertices: &[[f64; 3]], triangles: &[[u32; 3]]) -> Result<Self, MeshError> {
        let (vertices, triangles) = body(vertices, triangles)?;
        let vertices: Vec<Single> = vertices.into_iter().map(Single::from).collect();
        let triangles = TriMesh::with_flags(vertices, triangles, TriMeshFlags::ORIENTED).map_err(|_| MeshError::Empty)?;
        Ok(Self { triangles })
    }

    /// How many triangles.
    pub fn len(&self) -> usize {
        self.triangles.indices().len()
    }

    /// Never: there is no such body.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The face that looks most towards `up` (unit), the uppermost of those: its normal (unit), and a point of it.
    pub(super) fn top(&self, up: &Vec3) -> Option<(Vec3, Vec3)> {
        let faces = || {
            self.triangles.triangles().filter_map(|t| {
                let normal = double(t.scaled_normal()).try_normalize(1e-12)?;
                Some((normal, double(t.center())))
            })
        };
        let most = faces().map(|(normal, _)| normal.dot(up)).fold(-1.0, f64::max);
        faces().filter(|(normal, _)| normal.dot(up) > most - 1e-6).max_by(|f, g| f.1.dot(up).total_cmp(&g.1.dot(up)))
    }

    /// How many times `ray` a ray from `origin` goes until it meets the body from outside, at most `longest` times.
    pub(super) fn cast(&self, origin: &Vec3, ray: &Vec3, longest: f64) -> Option<f64> {
        let ray = Ray::new(single(origin), single(ray));
        let hit = self.triangles.cast_local_ray_with_culling(&ray, longest as f32, RayCullingMode::IgnoreBackfaces)?;
        Some(hit.time_of_impact.into())
    }

    /// Distance of `p`, negative inside, and the unit normal towards `p` there.
    pub(super) fn distance(&self, p: &Vec3) -> (f64, Vec3) {
        let (projected, (triangle, _)) = self.triangles.project_local_point_and_get_location(single(p), false);
        let away = p - double(projected.point);
        let side = if projected.is_inside { -1.0 } else { 1.0 };
        let face = || double(self.triangles.triangle(triangle).scaled_normal()).try_normalize(1e-12).unwrap_or_else(Vec3::z);
        // On the surface itself, to a few roundings, the way from it says nothing.
        (side * away.norm(), away.try_normalize(1e-6).map_or_else(face, |n| n * side))
    }

    /// The first touch of a ball of `radius` (m) that starts `from` there: fraction of its `way`, and the normal.
    pub(super) fn sweep(&self, from: &Vec3, way: &Vec3, radius: f64) -> Option<(f64, Vec3)> {
        let (distance, normal) = self.distance(from);
        if distance < 0.0 {
            return (normal.dot(way) < 0.0).then_some((0.0, normal));
        }
        let (p, q) = (single(from), single(&(from + way)));
        let reach = Aabb::new(p.min(q), p.max(q)).loosened(radius as f32);
        let touches = self.triangles.bvh().intersect_aabb(&reach).filter_map(|id| {
            let triangle = self.triangles.triangle(id);
            // What is touched from outside first is never only a face that looks away.
            if double(triangle.scaled_normal()).dot(way) >= 0.0 {
                return None;
            }
            // About its first corner, where single precision is finest.
            let (corner, start) = (triangle.a, from - double(triangle.a));
            let triangle = Triangle::new(Single::ZERO, triangle.b - corner, triangle.c - corner);
            first_touch(way, |fraction| {
                let center = start + way * fraction;
                let away = center - double(triangle.project_local_point(single(&center), false).point);
                (away.norm() - radius, away.try_normalize(1e-12).unwrap_or_else(Vec3::zeros))
            })
        });
        touches.min_by(|a, b| a.0.total_cmp(&b.0))
    }
}

impl PartialEq for Mesh {
    fn eq(&self, other: &Self) -> bool {
        self.triangles.vertices() == other.triangles.vertices() && self.triangles.indices() == other.triangles.indices()
    }
}

impl core::fmt::Debug for Mesh {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "Mesh({} triangles)", self.len())
    }
}

fn single(v: &Vec3) -> Single {
    Single::new(v.x as f32, v.y as f32, v.z as f32)
}

fn double(v: Single) -> Vec3 {
    Vec3::new(v.x.into(), v.y.into(), v.z.into())
}

#[cfg(test)]
mod tests {
    use super::super::{Environment, SharedMesh};
    use super::*;
    use crate::config::{EnvironmentConfig, KnownBox, KnownMesh};
    use crate::math::Mat3;
    use parry3d::shape::{Ball, Cuboid};
    use proptest::prelude::*;
    use std::vec;

    type Soup = (Vec<[f64; 3]>, Vec<[u32; 3]>);

    fn soup((vertices, triangles): (Vec<Single>, Vec<[u32; 3]>)) -> Soup {
        (vertices.iter().map(|v| double(*v).into()).collect(), triangles)
    }

    fn cuboid() -> Soup {
        soup(Cuboid::new(Single::new(0.2, 0.15, 0.1)).to_trimesh())
    }

    fn error_of((vertices, triangles): &Soup) -> MeshError {
        Mesh::new(vertices, triangles).unwrap_err()
    }

    /// The same body as a box and as a mesh.
    fn both(yaw: f64) -> [std::boxed::Box<Environment>; 2] {
        let (center, (s, c)) = ([0.3, 1.5, 0.2], (libm::sin(yaw), libm::cos(yaw)));
        let mut boxes = EnvironmentConfig::default();
        boxes.r#box.push(KnownBox { center, size: [0.4, 0.3, 0.2], yaw, ..KnownBox::default() }).unwrap();
        let (vertices, triangles) = cuboid();
        let solid = Some(SharedMesh::new(Mesh::new(&vertices, &triangles).unwrap()));
        let pose = Some([[c, -s, 0.0, center[0]], [s, c, 0.0, center[1]], [0.0, 0.0, 1.0, center[2]], [0.0, 0.0, 0.0, 1.0]]);
        let mut meshes = EnvironmentConfig::default();
        meshes.mesh.push(KnownMesh { pose, solid, ..KnownMesh::default() }).unwrap();
        [&boxes, &meshes].map(|config| std::boxed::Box::new(Environment::new(config)))
    }

    #[test]
    fn a_body_is_closed_and_looks_outwards() {
        let good = cuboid();
        assert_eq!(Mesh::new(&good.0, &good.1).unwrap().len(), 12);
        let without_one = (good.0.clone(), good.1[1..].to_vec());
        let MeshError::Open { edges: 3, at } = error_of(&without_one) else { panic!() };
        let [a, b, c] = good.1[0].map(|v| Vec3::from(good.0[v as usize]));
        let middles = [0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a)];
        assert!(middles.iter().any(|m| (m - Vec3::from(at.map(f64::from))).norm() < 1e-6));
        let flip = |[a, b, c]: [u32; 3]| [a, c, b];
        let mut twisted = good.clone();
        twisted.1[0] = flip(twisted.1[0]);
        assert!(matches!(error_of(&twisted), MeshError::Twisted { edges: 3, .. }));
        let inwards = (good.0.clone(), good.1.iter().copied().map(flip).collect());
        let MeshError::InsideOut(volume) = error_of(&inwards) else { panic!() };
        assert!((volume + 0.4 * 0.3 * 0.2).abs() < 1e-7);
        let thrice = (good.0.clone(), good.1.iter().copied().chain([good.1[0]]).collect());
        assert!(matches!(error_of(&thrice), MeshError::Open { edges: 3, .. }));
        let sheet = (vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], vec![[0, 1, 2], [0, 2, 1]]);
        assert_eq!(error_of(&sheet), MeshError::Flat);
    }

    #[test]
    fn what_can_be_no_mesh_is_told_so() {
        let good = cuboid();
        assert_eq!(error_of(&(good.0.clone(), Vec::new())), MeshError::Empty);
        for bad in [f64::NAN, f64::INFINITY] {
            let mut broken = good.clone();
            broken.0[3][1] = bad;
            assert_eq!(error_of(&broken), MeshError::NotFinite(1));
        }
        let mut astray = good.clone();
        astray.1[2][1] = 99;
        assert_eq!(error_of(&astray), MeshError::NoSuchVertex { triangle: 2, vertex: 99, vertices: 8 });
        let millimetres = (good.0.iter().map(|v| v.map(|x| 1e4 * x)).collect(), good.1.clone());
        assert!(matches!(error_of(&millimetres), MeshError::TooLarge(reach) if (reach - 2000.0).abs() < 1.0));
        let many = (good.0, vec![[0, 1, 2]; 1_000_001]);
        assert_eq!(error_of(&many), MeshError::TooMany(1_000_001));
    }

    #[test]
    fn triangles_that_each_have_their_own_corners_are_joined() {
        let (vertices, triangles) = cuboid();
        let apart: Vec<[f64; 3]> = triangles.iter().flatten().map(|&v| vertices[v as usize]).collect();
        let numbered: Vec<[u32; 3]> = (0..12).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        assert!(Mesh::new(&apart, &numbered).unwrap().triangles.vertices().len() == 8);
    }

    #[test]
    fn a_ball_of_triangles_is_nearly_one() {
        let (vertices, triangles) = soup(Ball::new(0.3).to_trimesh(40, 40));
        let ball = Mesh::new(&vertices, &triangles).unwrap();
        let outside = Vec3::new(0.3, -0.5, 0.4);
        let (distance, normal) = ball.distance(&outside);
        assert!((distance - (outside.norm() - 0.3)).abs() < 2e-3 && (normal - outside.normalize()).norm() < 0.05, "{distance} {normal}");
        let (depth, outwards) = ball.distance(&(0.1 * outside));
        assert!(depth < -0.2 && outwards.dot(&outside) > 0.0);
        let (fraction, _) = ball.sweep(&outside, &-outside, 0.1).unwrap();
        assert!((fraction * outside.norm() - (outside.norm() - 0.4)).abs() < 2e-3);
    }

    #[test]
    fn a_mesh_is_a_surface_like_any_other() {
        let [box_, mesh] = both(0.4).map(|e| e.surfaces()[0].clone());
        assert!((box_.normal - mesh.normal).norm() < 1e-6 && (box_.offset - mesh.offset).abs() < 1e-6);
        // Before an eye within there is nothing.
        assert_eq!(both(0.4).map(|e| e.cast(&Vec3::new(0.3, 1.5, 0.2), &Vec3::x(), 10.0)), [None, None]);
    }

    fn point() -> impl Strategy<Value = Vec3> {
        (-0.5..1.1, 0.7..2.3, -0.4..0.8).prop_map(|(x, y, z)| Vec3::new(x, y, z))
    }

    proptest! {
        #[test]
        fn a_box_of_triangles_is_a_box(from in point(), to in point(), yaw in -3.0..3.0, radius in 0.01..0.2) {
            let [of_faces, of_triangles] = both(yaw);
            let ((d, n, _), (e, m, _)) = (of_faces.nearest(&from).unwrap(), of_triangles.nearest(&from).unwrap());
            prop_assert!((d - e).abs() < 1e-5);
            // Where two faces are as near, either is right.
            let near_another = of_faces.nearest(&(from - 1e-4 * (n - m))).unwrap().0;
            prop_assert!((n - m).norm() < 1e-2 || (d < 0.0 && (near_another - d).abs() < 3e-4), "{n} {m} {d}");
            let ray = to - from;
            match (of_faces.cast(&from, &ray, 1.0), of_triangles.cast(&from, &ray, 1.0)) {
                (Some(a), Some(b)) => prop_assert!((a - b).abs() < 1e-4),
                (None, None) => {}
                (a, b) => prop_assert!(a.or(b).is_some_and(|t| of_faces.nearest(&(from + ray * t)).unwrap().0.abs() < 1e-4)),
            }
            match (of_faces.sweep(&from, &to, radius), of_triangles.sweep(&from, &to, radius)) {
                (Some(a), Some(b)) => prop_assert!((a.center - b.center).norm() < 1e-3, "{a:?} {b:?}"),
                (None, None) => {}
                // A hair from grazing, or from where they end, or from leaving.
                (Some(a), None) | (None, Some(a)) => {
                    let closing = -a.normal.dot(&ray.normalize());
                    let overlaps = d < radius;
                    prop_assert!(closing < 1e-2 || a.fraction > 1.0 - 1e-4 || (overlaps && near_another - d < 3e-4), "{a:?} {d}");
                }
            }
            let covariance = Mat3::from_diagonal_element(1e-4);
            prop_assert_eq!(of_faces.touched(&from, &covariance, radius).is_some(), of_triangles.touched(&from, &covariance, radius).is_some());
        }
    }
}
