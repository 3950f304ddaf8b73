//! What a ball can touch, and what a touch does to it.

use super::body::{Ball, Motion};
use crate::math::{Mat3, Vec3};

/// Geometry of something solid, world frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shape {
    /// The half-space normal · p < offset.
    Plane {
        /// Unit, out of the solid.
        normal: Vec3,
        /// m.
        offset: f64,
    },
    /// A box.
    Box {
        /// Its middle, m.
        center: Vec3,
        /// Half of its edges, m.
        half: Vec3,
        /// Its axes to the world's.
        rotation: Mat3,
    },
}

/// Something solid that a ball can bounce off.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Solid {
    /// Its name, or its faces' first word.
    pub name: &'static str,
    /// Where it is.
    pub shape: Shape,
    /// Mean restitution.
    pub restitution: f64,
    /// Coefficient of Coulomb friction.
    pub friction: f64,
    /// Whether the sensor can see it.
    pub visible: bool,
}

/// The point of a solid that is nearest to a ball's center.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Nearest {
    /// From the surface to the center, m; negative inside.
    pub distance: f64,
    /// From the surface to the center, unit.
    pub normal: Vec3,
    /// The face, an index for [`Solid::face`]; `None` on an edge or a corner.
    pub face: Option<usize>,
}

impl Solid {
    /// Faces: 1 of a plane; 6 of a box (−x, +x, −y, +y, −z, +z of its own axes).
    pub fn faces(&self) -> usize {
        match self.shape {
            Shape::Plane { .. } => 1,
            Shape::Box { .. } => 6,
        }
    }

    /// What a face is called, its outward normal, and its offset along it.
    pub fn face(&self, face: usize) -> (&'static str, Vec3, f64) {
        match self.shape {
            Shape::Plane { normal, offset } => (self.name, normal, offset),
            Shape::Box { center, half, rotation } => {
                let axis = face / 2 % 3;
                let normal = rotation.column(axis) * if face.is_multiple_of(2) { -1.0 } else { 1.0 };
                let name = ["box left", "box right", "box front", "box back", "box bottom", "box top"][face % 6];
                (name, normal, normal.dot(&center) + half[axis])
            }
        }
    }

    /// The nearest point of the surface to `p`.
    pub fn nearest(&self, p: &Vec3) -> Nearest {
        match self.shape {
            Shape::Plane { normal, offset } => Nearest { distance: normal.dot(p) - offset, normal, face: Some(0) },
            Shape::Box { center, half, rotation } => {
                let q = rotation.transpose() * (p - center);
                let beyond = q.abs() - half;
                let outside = beyond.map(|d| d.max(0.0));
                let axis = beyond.imax();
                if outside.iter().filter(|&&d| d > 0.0).count() < 2 {
                    let face = 2 * axis + usize::from(q[axis] > 0.0);
                    return Nearest { distance: beyond[axis], normal: self.face(face).1, face: Some(face) };
                }
                let away = outside.zip_map(&q, f64::copysign);
                Nearest { distance: away.norm(), normal: rotation * away.normalize(), face: None }
            }
        }
    }
}

/// The motion after a touch: restitution along `normal`, and Coulomb friction that stops the slip of the ball's skin
/// if it can (grip: `v_t' = v_t / (1 + β)` for a ball without spin, β its [`Ball::inertia`]).
pub fn bounce(ball: &Ball, m: &Motion, normal: &Vec3, restitution: f64, friction: f64) -> Motion {
    let normal_speed = -normal.dot(&m.velocity);
    let lever = normal * -ball.radius;
    let skin = m.velocity + m.spin.cross(&lever);
    let slip = skin - normal * normal.dot(&skin);
    let grip = slip * (-ball.inertia / (1.0 + ball.inertia));
    let limit = friction * (1.0 + restitution) * normal_speed;
    let kick = if grip.norm() > limit { grip * (limit / grip.norm()) } else { grip };
    Motion {
        position: m.position,
        velocity: m.velocity + normal * ((1.0 + restitution) * normal_speed) + kick,
        spin: m.spin + lever.cross(&kick) / (ball.inertia * ball.radius * ball.radius),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BALL: Ball = Ball { radius: 0.033, mass: 0.057, inertia: 0.55, drag_coefficient: 0.0, magnus: false };

    fn crate_of(yaw: f64) -> Solid {
        let shape = Shape::Box {
            center: Vec3::new(1.0, 2.0, 0.5),
            half: Vec3::new(0.3, 0.2, 0.5),
            rotation: *nalgebra::Rotation3::from_euler_angles(0.0, 0.0, yaw).matrix(),
        };
        Solid { name: "box", shape, restitution: 0.7, friction: 0.5, visible: false }
    }

    #[test]
    fn nearest_point_of_a_box_is_on_its_face_or_edge() {
        let top = crate_of(0.3).nearest(&Vec3::new(1.05, 2.05, 1.2));
        assert!((top.distance - 0.2).abs() < 1e-12 && crate_of(0.3).face(top.face.unwrap()).0 == "box top", "{top:?}");
        let edge = crate_of(0.0).nearest(&Vec3::new(1.33, 2.0, 1.04));
        assert!((edge.distance - 0.05).abs() < 1e-12 && edge.face.is_none(), "{edge:?}");
        assert!((edge.normal - Vec3::new(0.6, 0.0, 0.8)).norm() < 1e-12);
    }

    #[test]
    fn a_gripping_bounce_ends_in_rolling_and_keeps_what_it_must() {
        let before = Motion { position: Vec3::zeros(), velocity: Vec3::new(1.0, 0.0, -4.0), spin: Vec3::zeros() };
        let after = bounce(&BALL, &before, &Vec3::z(), 0.75, 0.6);
        assert!((after.velocity - Vec3::new(1.0 / 1.55, 0.0, 3.0)).norm() < 1e-12, "{after:?}");
        let skin = after.velocity + after.spin.cross(&Vec3::new(0.0, 0.0, -BALL.radius));
        assert!(skin.x.abs() < 1e-12, "the skin still slips: {skin}");
    }

    #[test]
    fn friction_has_its_limit_and_none_takes_no_energy() {
        let before = Motion { position: Vec3::zeros(), velocity: Vec3::new(9.0, 0.0, -1.0), spin: Vec3::zeros() };
        let after = bounce(&BALL, &before, &Vec3::z(), 0.75, 0.5);
        assert!((after.velocity.x - (9.0 - 0.5 * 1.75)).abs() < 1e-12);
        let smooth = bounce(&BALL, &before, &Vec3::z(), 1.0, 0.0);
        assert!((smooth.velocity.norm() - before.velocity.norm()).abs() < 1e-12);
    }
}
