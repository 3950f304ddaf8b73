//! Where a moving ball meets the environment: swept-shape queries.

#[cfg(feature = "std")]
use super::Shape;
use super::{Environment, KnownSurface, SURVEY_SD};
use crate::math::{Mat3, Vec3, sqrt};

/// A ball closer than this to a surface touches it, m.
const TOUCH: f64 = 1e-9;
/// Newton's steps at the most; only a ball that grazes a surface needs more than a few.
const STEPS: usize = 48;

/// The first touch of a ball on a straight way.
#[derive(Clone, Debug, PartialEq)]
pub struct Sweep {
    /// Of the way, 0 to 1.
    pub fraction: f64,
    /// Center of the ball there, world, m.
    pub center: Vec3,
    /// Unit normal of the surface there, towards the ball.
    pub normal: Vec3,
    /// Id of the surface, or place of a plane that a camera sees after the last of them.
    pub surface: u32,
    /// Standard deviation of where that is, m.
    pub sd: f64,
}

impl Environment {
    /// The first touch of a ball of `radius` (m) whose center moves from `from` to `to` (world, m), whichever surface it is.
    /// A ball that touches at the outset counts (fraction 0) where it moves on into the surface, and is free to leave it.
    pub fn sweep(&self, from: &Vec3, to: &Vec3, radius: f64) -> Option<Sweep> {
        let way = to - from;
        let touches = self.surfaces.iter().enumerate().filter_map(|(id, surface)| {
            let (fraction, normal) = surface.sweep(from, &way, radius)?;
            Some(Sweep { fraction, center: from + way * fraction, normal, surface: id as u32, sd: SURVEY_SD })
        });
        let seen = self.relief.iter().flat_map(|relief| {
            relief.sweep(from, &way, radius).map(move |(number, fraction, normal)| {
                let (center, own) = (from + way * fraction, relief.sd(number, &(from + way * fraction)));
                let (surface, sd) = ((self.surfaces.len() + number) as u32, sqrt(SURVEY_SD * SURVEY_SD + own * own));
                Sweep { fraction, center, normal, surface, sd }
            })
        });
        touches.chain(seen).min_by(|a, b| a.fraction.total_cmp(&b.fraction))
    }

    /// The surface nearest to `p` (world, m): its distance (m, negative inside), the unit normal towards `p`, its id as in [`Sweep`].
    pub fn nearest(&self, p: &Vec3) -> Option<(f64, Vec3, u32)> {
        let surfaces = self.surfaces.iter().enumerate().map(|(id, surface)| {
            let (distance, normal) = surface.distance(p);
            (distance, normal, id as u32)
        });
        let seen = self
            .relief
            .iter()
            .flat_map(|relief| relief.near(p).map(|(number, distance, normal)| (distance, normal, (self.surfaces.len() + number) as u32)));
        surfaces.chain(seen).min_by(|a, b| a.0.total_cmp(&b.0))
    }

    /// Whether an interaction is possible: whether a ball of `radius` (m) may touch a surface on its way from `from` to `to` (world, m),
    /// each known with `covariance` (m²), within four standard deviations of that and of the survey.
    pub fn may_touch(&self, from: &Vec3, to: &Vec3, covariance: &Mat3, radius: f64) -> bool {
        let variance = covariance.symmetric_eigenvalues().max().max(0.0);
        let reach = radius + 4.0 * sqrt(variance + SURVEY_SD * SURVEY_SD);
        self.nearest(from).is_some_and(|(distance, ..)| distance < reach) || self.sweep(from, to, reach).is_some()
    }
}

impl KnownSurface {
    /// Fraction of the `way` at which a ball that starts `from` there first touches, and the normal.
    fn sweep(&self, from: &Vec3, way: &Vec3, radius: f64) -> Option<(f64, Vec3)> {
        #[cfg(feature = "std")]
        if let Shape::Mesh { mesh, origin, rotation } = &self.shape {
            let turn = rotation.transpose();
            let (fraction, normal) = mesh.sweep(&(turn * (from - origin)), &(turn * way), radius)?;
            return Some((fraction, rotation * normal));
        }
        first_touch(way, |fraction| {
            let (distance, normal) = self.distance(&(from + way * fraction));
            (distance - radius, normal)
        })
    }
}

/// The first touch of a convex body. The gap to one is a convex function of the way, and the body lies behind the plane through its
/// nearest point: Newton's steps come nearer from one side and never pass through.
pub(super) fn first_touch(way: &Vec3, gap_at: impl Fn(f64) -> (f64, Vec3)) -> Option<(f64, Vec3)> {
    let mut fraction = 0.0;
    for _ in 0..STEPS {
        let (gap, normal) = gap_at(fraction);
        let closing = -normal.dot(way);
        if closing <= 0.0 {
            return None;
        }
        if gap <= TOUCH {
            return Some((fraction, normal));
        }
        fraction += gap / closing;
        if fraction > 1.0 {
            return None;
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{EnvironmentConfig, KnownBox, KnownPlane, KnownSphere};
    use proptest::prelude::*;

    const RADIUS: f64 = 0.033;

    fn plane() -> KnownPlane {
        KnownPlane::default()
    }

    fn a_box(yaw: f64) -> KnownBox {
        KnownBox { center: [0.3, 1.5, 0.2], size: [0.4, 0.3, 0.4], yaw, ..KnownBox::default() }
    }

    fn sphere() -> KnownSphere {
        KnownSphere { center: [-0.5, 1.5, 0.4], radius: 0.3, ..KnownSphere::default() }
    }

    fn environment(planes: &[KnownPlane], boxes: &[KnownBox], spheres: &[KnownSphere]) -> Environment {
        let mut config = EnvironmentConfig::default();
        config.plane.extend_from_slice(planes).unwrap();
        config.r#box.extend_from_slice(boxes).unwrap();
        config.sphere.extend_from_slice(spheres).unwrap();
        Environment::new(&config)
    }

    fn close(a: f64, b: f64) -> bool {
        (a - b).abs() < 1e-7
    }

    #[test]
    fn an_edge_of_a_box_is_met_at_its_radius() {
        let e = environment(&[], &[a_box(0.0)], &[]);
        // Down past the edge x = 0.5, z = 0.4, with the center 0.02 beyond it.
        let hit = e.sweep(&Vec3::new(0.52, 1.5, 1.0), &Vec3::new(0.52, 1.5, 0.0), RADIUS).unwrap();
        let height = sqrt(RADIUS * RADIUS - 0.02 * 0.02);
        assert!(close(hit.center.z, 0.4 + height) && close(hit.normal.x, 0.02 / RADIUS) && hit.surface == 0, "{hit:?}");
        assert_eq!(e.sweep(&Vec3::new(0.534, 1.5, 1.0), &Vec3::new(0.534, 1.5, 0.0), RADIUS), None);
    }

    #[test]
    fn the_first_of_several_surfaces_is_met() {
        let e = environment(&[plane()], &[a_box(0.3)], &[sphere()]);
        assert_eq!(e.sweep(&Vec3::new(0.3, 1.5, 1.0), &Vec3::new(0.3, 1.5, -1.0), RADIUS).unwrap().surface, 1);
        assert_eq!(e.sweep(&Vec3::new(-0.5, 1.5, 1.0), &Vec3::new(-0.5, 1.5, -1.0), RADIUS).unwrap().surface, 2);
        assert_eq!(e.sweep(&Vec3::new(0.0, 0.5, 1.0), &Vec3::new(0.0, 0.5, -1.0), RADIUS).unwrap().surface, 0);
        assert_eq!(Environment::default().sweep(&Vec3::zeros(), &Vec3::z(), RADIUS), None);
    }

    #[test]
    fn what_touches_may_leave_or_slide_but_not_sink() {
        let e = environment(&[plane()], &[], &[]);
        let rests = Vec3::new(0.0, 1.0, RADIUS);
        assert_eq!(e.sweep(&rests, &(rests + Vec3::new(0.1, 0.0, 0.1)), RADIUS), None);
        assert_eq!(e.sweep(&rests, &(rests + Vec3::x()), RADIUS), None);
        assert_eq!(e.sweep(&rests, &(rests - Vec3::z()), RADIUS).unwrap().fraction, 0.0);
        assert_eq!(e.sweep(&rests, &rests, RADIUS), None);
    }

    #[test]
    fn an_interaction_is_possible_within_what_is_known() {
        let e = environment(&[plane()], &[], &[]);
        let (fine, coarse) = (Mat3::from_diagonal_element(1e-6), Mat3::from_diagonal_element(1e-2));
        let (above, aside) = (Vec3::new(0.0, 1.0, 0.1), Vec3::new(0.3, 1.0, 0.1));
        assert!(!e.may_touch(&above, &aside, &fine, RADIUS));
        assert!(e.may_touch(&above, &aside, &coarse, RADIUS));
        // Down and, unseen, up again; and off a surface that it may have touched before.
        assert!(e.may_touch(&above, &Vec3::new(0.3, 1.0, 0.04), &fine, RADIUS));
        assert!(e.may_touch(&Vec3::new(0.0, 1.0, 0.04), &above, &fine, RADIUS));
        assert!(!Environment::default().may_touch(&above, &-above, &coarse, RADIUS));
    }

    fn point() -> impl Strategy<Value = Vec3> {
        (-1.5..1.5, 0.0..3.0, -0.2..1.5).prop_map(|(x, y, z)| Vec3::new(x, y, z))
    }

    proptest! {
        #[test]
        fn a_plane_is_met_where_the_height_is_the_radius(from in point(), to in point()) {
            let hit = environment(&[plane()], &[], &[]).sweep(&from, &to, RADIUS);
            // It has two sides.
            let (height, end) = (from.z.abs(), to.z * from.z.signum());
            if height > RADIUS && end < RADIUS {
                prop_assert!(close(hit.unwrap().fraction * (height - end), height - RADIUS));
            } else {
                prop_assert_eq!(hit.is_some(), height <= RADIUS && end < height);
            }
        }

        #[test]
        fn a_sphere_is_met_where_the_quadratic_says(from in point(), to in point()) {
            let (way, away, reach) = (to - from, from - Vec3::from(sphere().center), sphere().radius + RADIUS);
            prop_assume!(away.norm() > reach);
            let (a, b, c) = (way.norm_squared(), way.dot(&away), away.norm_squared() - reach * reach);
            let met = (b * b > a * c && b < 0.0).then(|| (-b - sqrt(b * b - a * c)) / a).filter(|fraction| *fraction <= 1.0);
            match (environment(&[], &[], &[sphere()]).sweep(&from, &to, RADIUS), met) {
                (Some(hit), Some(fraction)) => prop_assert!((hit.fraction - fraction).abs() < 1e-5),
                // Within a hair of grazing, or of ending there, either is right.
                (None, Some(fraction)) => prop_assert!(fraction > 1.0 - 1e-6 || b * b - a * c < 1e-8),
                (hit, None) => prop_assert_eq!(hit, None),
            }
        }

        #[test]
        fn before_the_touch_there_is_none_and_there_it_is(from in point(), to in point(), yaw in -3.0..3.0, radius in 0.01..0.2) {
            let e = environment(&[plane()], &[a_box(yaw)], &[sphere()]);
            let gap = |fraction: f64| e.nearest(&(from + (to - from) * fraction)).unwrap().0 - radius;
            prop_assume!(gap(0.0) > 0.0);
            let until = match e.sweep(&from, &to, radius) {
                Some(hit) => {
                    prop_assert!(gap(hit.fraction).abs() < 1e-6 && (hit.normal.norm() - 1.0).abs() < 1e-9);
                    hit.fraction
                }
                None => 1.0,
            };
            for i in 0..200 {
                prop_assert!(gap(until * f64::from(i) / 200.0) > -1e-6);
            }
        }
    }
}
