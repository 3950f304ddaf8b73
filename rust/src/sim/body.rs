//! A ball in the air: gravity, quadratic drag, Magnus lift.

use crate::math::Vec3;

/// Density of air near the ground, kg/m³.
const AIR_DENSITY: f64 = 1.2;

/// What a ball is made of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ball {
    /// Radius, m.
    pub radius: f64,
    /// Mass, kg.
    pub mass: f64,
    /// Moment of inertia over mass · radius²: 0.4 for a solid ball, about 0.55 for a tennis ball.
    pub inertia: f64,
    /// Of quadratic drag; 0 for none.
    pub drag_coefficient: f64,
    /// Whether spin bends the flight.
    pub magnus: bool,
}

/// Where a ball is and how it moves, world frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// Center, m.
    pub position: Vec3,
    /// Of the center, m/s.
    pub velocity: Vec3,
    /// Angular velocity, rad/s; it keeps its value in the air.
    pub spin: Vec3,
}

impl Ball {
    /// Acceleration in the air, m/s². Lift as measured on tennis balls: `C_l = 1 / (2.022 + 0.981 v / (ω R))`.
    pub fn acceleration(&self, gravity: &Vec3, velocity: &Vec3, spin: &Vec3) -> Vec3 {
        let pressure_area = 0.5 * AIR_DENSITY * core::f64::consts::PI * self.radius * self.radius / self.mass;
        let speed = velocity.norm();
        let drag = velocity * (-pressure_area * self.drag_coefficient * speed);
        let across = spin.cross(velocity);
        let turning = spin.norm() * self.radius;
        if !self.magnus || across.norm() < 1e-9 {
            return gravity + drag;
        }
        let lift = pressure_area / (2.022 + 0.981 * speed / turning) * speed * speed;
        gravity + drag + across.normalize() * lift
    }

    /// The motion `h` seconds later, by one Runge–Kutta step of fourth order.
    pub fn fly(&self, gravity: &Vec3, m: &Motion, h: f64) -> Motion {
        let a = |v: &Vec3| self.acceleration(gravity, v, &m.spin);
        let (v1, a1) = (m.velocity, a(&m.velocity));
        let v2 = m.velocity + a1 * (0.5 * h);
        let a2 = a(&v2);
        let v3 = m.velocity + a2 * (0.5 * h);
        let a3 = a(&v3);
        let v4 = m.velocity + a3 * h;
        let a4 = a(&v4);
        Motion {
            position: m.position + (v1 + v2 * 2.0 + v3 * 2.0 + v4) * (h / 6.0),
            velocity: m.velocity + (a1 + a2 * 2.0 + a3 * 2.0 + a4) * (h / 6.0),
            spin: m.spin,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BALL: Ball = Ball { radius: 0.033, mass: 0.057, inertia: 0.55, drag_coefficient: 0.53, magnus: true };

    #[test]
    fn drag_slows_and_topspin_pulls_down() {
        let v = Vec3::new(6.0, 0.0, 0.0);
        let drag = BALL.acceleration(&Vec3::zeros(), &v, &Vec3::zeros());
        assert!((drag.x + 0.69).abs() < 0.03 && drag.y == 0.0 && drag.z == 0.0, "{drag}");
        let lift = BALL.acceleration(&Vec3::zeros(), &v, &Vec3::new(0.0, 100.0, 0.0));
        assert!(lift.z < -0.1 && lift.y == 0.0, "{lift}");
    }

    #[test]
    fn steps_agree_with_finer_steps() {
        let g = Vec3::new(0.0, 0.0, -9.81);
        let start = Motion { position: Vec3::zeros(), velocity: Vec3::new(3.0, 1.0, 4.0), spin: Vec3::new(50.0, 0.0, 9.0) };
        let run = |n: u32| (0..n).fold(start, |m, _| BALL.fly(&g, &m, 1.0 / f64::from(n)));
        assert!((run(500).position - run(2000).position).norm() < 1e-9);
    }
}
