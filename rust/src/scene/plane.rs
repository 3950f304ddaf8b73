//! A plane from the contacts with it: their points carry it, their velocities help.
//!
//! Each contact says three things of a plane with normal n, offset d and restitution e: its center is one radius away,
//! n·c = d + R; after + e·before lies in it, whatever friction and spin; and, without spin across the motion, the motion stays in
//! one plane with the normal, n·(before × after) = 0. A fourth thing has no equality: friction slows a ball along the plane, without spin it
//! neither speeds it up nor turns it back.

use crate::event;
use crate::math::{Mat3, Vec3, rows, sqrt};
use crate::physics::accumulator::{Accumulator, Solution};
use crate::physics::contact::{Contact, RESTITUTION};
use crate::scene::outline::tangents;
use crate::track::hypothesis::AFTER_SIDE;
use nalgebra::{Matrix4, Matrix4x3, SMatrix, SVector, Vector4};

/// Scatter of one ball's restitution from bounce to bounce.
const RESTITUTION_SCATTER: f64 = 0.03;
/// Roughness of a floor, and what a ball is not round, m.
const ROUGHNESS: f64 = 7e-4;
/// What bends a bounce out of its plane besides spin, rad.
const DEFLECTION: f64 = 0.03;
/// Most surfaces are level, to within this, rad.
const LEVEL_SD: f64 = 0.01;
/// What one that is not costs, as χ²: so much rarer it is.
const TILTED: f64 = 20.0;

/// What a contact says of the surface it touched.
#[derive(Clone, Debug, PartialEq)]
pub struct Patch {
    /// The contact.
    pub center: Vec3,
    /// Velocity at first touch, m/s.
    pub before: Vec3,
    /// Velocity at last touch, m/s.
    pub after: Vec3,
    /// Of (center, before, after).
    pub covariance: SMatrix<f64, 9, 9>,
    /// Radius of the ball, m.
    pub radius: f64,
    /// Standard deviation of an unknown spin, rad/s.
    pub spin_sd: f64,
    /// The contact's own normal.
    pub normal: Vec3,
}

impl Patch {
    /// Of a contact of a ball of `radius` (m); `None` where it has no normal or no covariance.
    pub fn new(contact: &Contact, radius: f64, spin_sd: f64) -> Option<Self> {
        let finite = contact.covariance.iter().all(|x| x.is_finite());
        Some(Self {
            center: contact.center,
            before: contact.before,
            after: contact.after,
            covariance: contact.covariance,
            radius,
            spin_sd,
            normal: contact.normal(RESTITUTION).filter(|_| finite)?,
        })
    }

    /// Of a contact as it was told, without the covariance of its velocities: they are taken for those of straight-line fits over
    /// [`AFTER_SIDE`] on either side that share the center, 6/T² times its covariance and independent of it. `None` where a velocity or
    /// the center's covariance is unknown.
    pub fn told(contact: &event::Contact, radius: f64, spin_sd: f64) -> Option<Self> {
        let of_center = Mat3::from_fn(|i, j| contact.covariance[i][j]);
        let mut covariance = SMatrix::<f64, 9, 9>::zeros();
        for (block, scale) in [1.0, 6.0 / (AFTER_SIDE * AFTER_SIDE), 6.0 / (AFTER_SIDE * AFTER_SIDE)].into_iter().enumerate() {
            covariance.fixed_view_mut::<3, 3>(3 * block, 3 * block).copy_from(&(of_center * scale));
        }
        let contact = Contact {
            time: 0.0,
            center: contact.center.into(),
            before: contact.velocity_before?.into(),
            after: contact.velocity_after?.into(),
            gravity: Vec3::zeros(),
            covariance,
            time_sd: 0.0,
            chi2: 0.0,
            log_evidence: 0.0,
            counts: [0, 0],
        };
        Self::new(&contact, radius, spin_sd)
    }

    fn sd(&self, center: &Vec3, before: &Vec3, after: &Vec3, extra: f64) -> f64 {
        let mut h = SVector::<f64, 9>::zeros();
        h.fixed_rows_mut::<3>(0).copy_from(center);
        h.fixed_rows_mut::<3>(3).copy_from(before);
        h.fixed_rows_mut::<3>(6).copy_from(after);
        sqrt(h.dot(&(self.covariance * h)).max(0.0) + extra * extra)
    }

    /// The three observations about the plane (`n`, its tangents `u` and `v`, offset from `origin`, restitution `e`), each as row, value and standard
    /// deviation. Unknowns: turn of the normal along u, along v, offset, restitution.
    fn observations(&self, origin: &Vec3, n: &Vec3, u: &Vec3, v: &Vec3, e: f64) -> [(Vector4<f64>, f64, f64); 3] {
        let (zero, center) = (Vec3::zeros(), self.center - origin);
        let within = self.after + self.before * e;
        let bend = self.before.cross(&self.after);
        let scatter = RESTITUTION_SCATTER * n.dot(&self.before).abs();
        let spin = self.spin_speed() * (self.after - self.before).norm();
        let deflection = DEFLECTION * self.before.norm() * self.after.norm();
        let swerve = sqrt(spin * spin + deflection * deflection);
        [
            (Vector4::new(u.dot(&center), v.dot(&center), -1.0, 0.0), self.radius - n.dot(&center), self.sd(n, &zero, &zero, ROUGHNESS)),
            (
                Vector4::new(u.dot(&within), v.dot(&within), 0.0, n.dot(&self.before)),
                -n.dot(&self.after),
                self.sd(&zero, &(n * e), n, scatter),
            ),
            (
                Vector4::new(u.dot(&bend), v.dot(&bend), 0.0, 0.0),
                -n.dot(&bend),
                self.sd(&zero, &self.after.cross(n), &n.cross(&self.before), swerve),
            ),
        ]
    }
}

impl Patch {
    /// How much of its speed along a surface a ball may owe to its spin, m/s (standard deviation): what a hollow ball's grip makes of it.
    fn spin_speed(&self) -> f64 {
        0.355 * self.radius * self.spin_sd
    }

    /// What friction on a surface with the normal `n` (its tangents `u` and `v`) can't have done, that it sped the ball up along it or turned it back,
    /// in the form of [`Patch::observations`]; `None` where it has not.
    fn slip(&self, n: &Vec3, u: &Vec3, v: &Vec3) -> Option<(Vector4<f64>, f64, f64)> {
        let [before, after] = [self.before, self.after].map(|w| w - n * n.dot(&w));
        let along = if before.norm_squared() > after.norm_squared() { before } else { after }.try_normalize(1e-9)?;
        let (fast, left) = (along.dot(&before), along.dot(&after));
        let allowed = left.clamp(fast.min(0.0), fast.max(0.0));
        if allowed == left {
            return None;
        }
        // As fast as it came, or not at all.
        let came = if allowed == 0.0 { 0.0 } else { 1.0 };
        let turned = n.dot(&(self.before * came - self.after));
        let deflection = DEFLECTION * self.before.norm();
        let sd = self.sd(&Vec3::zeros(), &(along * -came), &along, sqrt(self.spin_speed() * self.spin_speed() + deflection * deflection));
        Some((Vector4::new(along.dot(u) * turned, along.dot(v) * turned, 0.0, 0.0), allowed - left, sd))
    }

    /// Whether the ball came from the side that `normal` shows to.
    fn faces(&self, normal: &Vec3) -> bool {
        normal.dot(&self.before) < 0.0
    }
}

/// A fitted plane.
#[derive(Clone, Debug, PartialEq)]
pub struct Plane {
    /// Unit normal, to the contacts' side.
    pub normal: Vec3,
    /// normal · p = offset, m.
    pub offset: f64,
    /// Restitution of the ball on it.
    pub restitution: f64,
    /// Of (turn along the first tangent, along the second, offset, restitution).
    parameters: Matrix4<f64>,
    /// Weighted sum of squared residuals, and what the plane's kind costs.
    pub chi2: f64,
    /// It is taken for level.
    pub level: bool,
}

/// What is thought of "up": the direction, and its variance along one axis, rad².
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Up {
    /// Unit vector against gravity.
    pub direction: Vec3,
    /// rad².
    pub variance: f64,
}

impl Plane {
    /// The plane that all `patches` lie on, level if that explains them about as well; `None` without patches or where they do not tell.
    #[allow(clippy::needless_pass_by_value)] // An iterator is small; callers read better without a borrow.
    pub fn fit<'a>(patches: impl Iterator<Item = &'a Patch> + Clone, up: Option<&Up>) -> Option<Self> {
        let first = patches.clone().next()?;
        let free = Self::converge(&patches, first.normal, 1.0)?;
        let Some(up) = up else { return Some(free) };
        // A ceiling is level, too.
        let side = if first.before.dot(&up.direction) < 0.0 { up.direction } else { -up.direction };
        let level = Self::converge(&patches, side, sqrt(LEVEL_SD * LEVEL_SD + up.variance));
        let tilted = Self { chi2: free.chi2 + TILTED, ..free };
        level.filter(|l| l.chi2 < tilted.chi2 && l.restitution > 0.0).map(|l| Self { level: true, ..l }).or(Some(tilted))
    }

    /// Gauss–Newton from, and with the prior of, `normal` to within `sd` (rad).
    fn converge<'a>(patches: &(impl Iterator<Item = &'a Patch> + Clone), normal: Vec3, sd: f64) -> Option<Self> {
        let prior = normal;
        // Far from the origin, offset and turn would be one thing: both are about the first contact.
        let origin = patches.clone().next()?.center;
        let mut plane = Self { normal, offset: 0.0, restitution: RESTITUTION.0, parameters: Matrix4::zeros(), chi2: 0.0, level: false };
        for _ in 0..6 {
            let (u, v) = tangents(&plane.normal);
            let mut fit = Accumulator::<4>::default();
            fit.expect(0, u.dot(&prior), sd);
            fit.expect(1, v.dot(&prior), sd);
            fit.expect(2, 0.0, 1e3);
            fit.expect(3, RESTITUTION.0, RESTITUTION.1);
            for patch in patches.clone() {
                if !patch.faces(&plane.normal) {
                    return None;
                }
                let slip = patch.slip(&plane.normal, &u, &v);
                for (row, value, sd) in patch.observations(&origin, &plane.normal, &u, &v, plane.restitution).into_iter().chain(slip) {
                    fit.observe(&row, value, sd);
                }
            }
            let Solution { mean, covariance, chi2, .. } = fit.solve()?;
            plane.normal = (plane.normal + u * mean[0] + v * mean[1]).try_normalize(1e-9)?;
            let turned = Matrix4::from_fn(|i, j| match (i, j) {
                (2, 0) => u.dot(&origin),
                (2, 1) => v.dot(&origin),
                _ => f64::from(u8::from(i == j)),
            });
            plane.offset = mean[2] + plane.normal.dot(&origin);
            (plane.restitution, plane.parameters, plane.chi2) = (mean[3], turned * covariance * turned.transpose(), chi2);
            if mean.fixed_rows::<2>(0).norm() < 1e-9 {
                break;
            }
        }
        Some(plane)
    }

    /// χ² of the four things that `patch` says, the plane's own uncertainty included.
    pub fn disagreement(&self, patch: &Patch) -> f64 {
        let (u, v) = tangents(&self.normal);
        let now = Vector4::new(0.0, 0.0, self.offset, self.restitution);
        let square = |(row, value, sd): (Vector4<f64>, f64, f64)| {
            let r = row.dot(&now) - value;
            r * r / (sd * sd + row.dot(&(self.parameters * row)))
        };
        if !patch.faces(&self.normal) {
            return f64::INFINITY;
        }
        let slip = patch.slip(&self.normal, &u, &v);
        patch.observations(&Vec3::zeros(), &self.normal, &u, &v, self.restitution).into_iter().chain(slip).map(square).sum()
    }

    /// Squared Mahalanobis distance between the normal and `direction`, which has `variance` (rad²) itself.
    pub fn turn_to(&self, direction: &Vec3, variance: f64) -> f64 {
        let (u, v) = tangents(&self.normal);
        let r = nalgebra::Vector2::new(u.dot(direction), v.dot(direction));
        let c = self.parameters.fixed_view::<2, 2>(0, 0) + nalgebra::Matrix2::identity() * variance;
        let facing = self.normal.dot(direction) > 0.0;
        c.try_inverse().filter(|_| facing).map_or(f64::INFINITY, |i| r.dot(&(i * r)))
    }

    /// Covariance of the normal.
    pub fn normal_covariance(&self) -> Mat3 {
        self.covariance().fixed_view::<3, 3>(0, 0).into()
    }

    /// Covariance of (normal, offset).
    pub fn covariance(&self) -> Matrix4<f64> {
        let (u, v) = tangents(&self.normal);
        let mut j = Matrix4x3::zeros();
        j.fixed_view_mut::<3, 1>(0, 0).copy_from(&u);
        j.fixed_view_mut::<3, 1>(0, 1).copy_from(&v);
        j[(3, 2)] = 1.0;
        crate::math::symmetric(&(j * self.parameters.fixed_view::<3, 3>(0, 0) * j.transpose()))
    }

    /// [`Plane::covariance`] as rows.
    pub fn covariance_rows(&self) -> [[f64; 4]; 4] {
        rows(&self.covariance())
    }

    /// This plane's part of a pair that is known to be parallel: with its normal told by both, its offset and normal follow.
    pub fn parallel_to(&self, other: &Self) -> Self {
        let (u, v) = tangents(&self.normal);
        // Two more observations: the other's normal, as uncertain as it is.
        let turn = nalgebra::Vector2::new(u.dot(&other.normal), v.dot(&other.normal));
        let c = other.normal_covariance();
        let noise = nalgebra::Matrix2::new(u.dot(&(c * u)), u.dot(&(c * v)), v.dot(&(c * u)), v.dot(&(c * v)));
        let h = SMatrix::<f64, 2, 4>::identity();
        let Some(inverse) = (h * self.parameters * h.transpose() + noise).try_inverse() else { return self.clone() };
        let gain = self.parameters * h.transpose() * inverse;
        let moved = gain * turn;
        Self {
            normal: (self.normal + u * moved[0] + v * moved[1]).normalize(),
            offset: self.offset + moved[2],
            restitution: self.restitution + moved[3],
            parameters: crate::math::symmetric(&((Matrix4::identity() - gain * h) * self.parameters)),
            ..*self
        }
    }

    /// Height of the point `p` (m) over the plane, and its variance from the plane's uncertainty.
    pub fn height(&self, p: &Vec3) -> (f64, f64) {
        let row = nalgebra::Vector4::new(p.x, p.y, p.z, -1.0);
        (self.normal.dot(p) - self.offset, row.dot(&(self.covariance() * row)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const UP: Up = Up { direction: Vec3::new(0.0, 0.0, 1.0), variance: 0.0 };

    fn patch(x: f64, y: f64, normal: Vec3, height: f64, before: Vec3) -> Patch {
        let (into, e) = (before.dot(&normal), 0.7);
        let along = before - normal * into;
        let center = Vec3::new(x, y, 0.0);
        Patch {
            center: center + normal * (height + 0.033 - normal.dot(&center)),
            before,
            after: along * 0.7 - normal * (e * into),
            covariance: SMatrix::from_fn(|i, j| {
                if i != j {
                    0.0
                } else if i < 3 {
                    1e-6
                } else {
                    4e-4
                }
            }),
            radius: 0.033,
            spin_sd: 0.0,
            normal,
        }
    }

    #[test]
    fn contacts_along_one_line_leave_the_turn_to_the_dynamics() {
        let tilted = Vec3::new(0.2, 0.1, 1.0).normalize();
        let patches: [Patch; 4] = core::array::from_fn(|i| patch(0.3 * i as f64, 1.5, tilted, 0.2, Vec3::new(1.0, 0.3, -3.0)));
        let plane = Plane::fit(patches.iter(), Some(&UP)).unwrap();
        assert!((plane.normal - tilted).norm() < 0.02 && (plane.restitution - 0.7).abs() < 0.03, "{plane:?}");
        // Along the line the points tell, across it only the velocities do.
        let c = plane.normal_covariance();
        assert!(c[(1, 1)] > 4.0 * c[(0, 0)]);
    }

    #[test]
    fn one_contact_that_may_be_on_a_level_surface_is() {
        let one = [patch(0.0, 1.5, Vec3::z(), 0.0, Vec3::new(1.0, 0.3, -3.0))];
        let plane = Plane::fit(one.iter(), Some(&UP)).unwrap();
        assert!((plane.normal - Vec3::z()).norm() < 0.01 && plane.offset.abs() < 0.02);
        let wall = [patch(0.0, 1.5, -Vec3::y(), -2.0, Vec3::new(0.3, 3.0, -1.0))];
        // One contact leaves the restitution open, and with it the turn along the motion.
        assert!((Plane::fit(wall.iter(), Some(&UP)).unwrap().normal + Vec3::y()).norm() < 0.25);
    }

    #[test]
    fn a_ramp_is_not_level_and_a_ceiling_is() {
        let drop = Vec3::new(0.05, -0.1, -4.9);
        let pushed = Vec3::new(1.4, 0.2, -4.0);
        for (degrees, before) in [(10.0_f64, drop), (20.0, drop), (45.0, drop), (20.0, pushed), (30.0, pushed), (45.0, pushed)] {
            let (sin, cos) = degrees.to_radians().sin_cos();
            let ramp = Vec3::new(sin, 0.0, cos);
            let plane = Plane::fit([patch(0.0, 1.5, ramp, 0.0, before)].iter(), Some(&UP)).unwrap();
            assert!(!plane.level && (plane.normal - ramp).norm() < 0.2, "{degrees}° {before}: {plane:?}");
        }
        let ceiling = Plane::fit([patch(0.0, 1.5, -Vec3::z(), -1.6, Vec3::new(1.0, 0.3, 3.0))].iter(), Some(&UP)).unwrap();
        assert!(ceiling.level && (ceiling.normal + Vec3::z()).norm() < 0.01 && (ceiling.offset + 1.6).abs() < 0.02, "{ceiling:?}");
    }

    #[test]
    fn friction_slows_and_spin_may_do_more() {
        let bounce = |after: f64, spin_sd: f64| Patch {
            after: Vec3::new(after, 0.0, 2.0),
            spin_sd,
            ..patch(0.0, 1.5, Vec3::z(), 0.0, Vec3::new(1.0, 0.0, -3.0))
        };
        let slip = |patch: &Patch| patch.slip(&Vec3::z(), &Vec3::x(), &Vec3::y()).map_or(0.0, |(_, excess, sd)| (excess / sd).powi(2));
        for after in [0.0, 0.5, 1.0] {
            assert_eq!(slip(&bounce(after, 0.0)), 0.0);
        }
        for after in [-1.0, 2.0] {
            let (without, with) = (slip(&bounce(after, 0.0)), slip(&bounce(after, 100.0)));
            assert!(without > 50.0 && with < 1.0, "{after}: {without} {with}");
        }
    }

    #[test]
    fn disagreement_tells_the_box_from_the_floor() {
        let floor: [Patch; 3] =
            core::array::from_fn(|i| patch(0.2 * i as f64, 1.4 + 0.1 * (i * i) as f64, Vec3::z(), 0.0, Vec3::new(1.0, 0.3, -3.0)));
        let plane = Plane::fit(floor.iter(), Some(&UP)).unwrap();
        assert!(plane.disagreement(&patch(0.3, 1.5, Vec3::z(), 0.09, Vec3::new(-1.0, 0.2, -2.0))) > 1000.0);
        assert!(plane.disagreement(&patch(0.3, 1.5, Vec3::z(), 0.0, Vec3::new(-1.0, 0.2, -2.0))) < 5.0);
    }
}
