//! The way of one ball from throw to catch, as a cubic spline in time: flight, touches, rolling, rest.

use super::body::{Ball, Motion};
use super::impact::{Nearest, Solid, bounce};
use crate::math::Vec3;
use rand::Rng;
use rand_distr::{Distribution, StandardNormal};
use std::vec::Vec;

/// Step of the integration, s.
const STEP: f64 = 2e-3;
/// A ball that meets a face more slowly than this stays on it, m/s.
const ROLL_SPEED: f64 = 0.06;
/// Rolling resistance over weight.
const ROLL_RESISTANCE: f64 = 0.015;

/// What surrounds the balls.
#[derive(Clone, Debug, PartialEq)]
pub struct Stage {
    /// m/s², world.
    pub gravity: Vec3,
    /// What can be touched.
    pub solids: Vec<Solid>,
    /// How long a touch lasts, s.
    pub contact_duration: f64,
    /// Scatter of the restitution from touch to touch.
    pub restitution_sd: f64,
}

/// A touch, world frame; times are seconds of the scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Touch {
    /// First touch.
    pub time: f64,
    /// The ball's center then.
    pub center: Vec3,
    /// Unit, from the surface to the center.
    pub normal: Vec3,
    /// At first touch.
    pub before: Vec3,
    /// At last touch.
    pub after: Vec3,
    /// Of this touch.
    pub restitution: f64,
    /// Index into [`Stage::solids`].
    pub solid: usize,
    /// `None` on an edge.
    pub face: Option<usize>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Knot {
    time: f64,
    position: Vec3,
    velocity: Vec3,
}

/// The way of one ball.
#[derive(Clone, Debug, PartialEq)]
pub struct Path {
    /// What flies.
    pub ball: Ball,
    /// In the order of time.
    pub touches: Vec<Touch>,
    /// When it ceased to bounce, and on which solid.
    pub rolling: Option<(f64, usize)>,
    knots: Vec<Knot>,
}

impl Path {
    /// The way of `ball` over `duration` seconds from `start` at `time`.
    pub fn simulate(ball: Ball, stage: &Stage, time: f64, start: Motion, duration: f64, rng: &mut impl Rng) -> Self {
        let mut path = Self { ball, touches: Vec::new(), rolling: None, knots: Vec::new() };
        let (mut time, end, mut m) = (time, time + duration, start);
        let mut support: Option<usize> = None;
        path.push(time, &m);
        while time < end {
            let (h, hit) = path.advance(stage, &m, support);
            m = path.moved(stage, &m, support, h);
            time += h;
            path.push(time, &m);
            if support.is_some_and(|s| stage.solids[s].nearest(&m.position).face.is_none()) {
                support = None;
            }
            let Some((solid, near)) = hit else { continue };
            let (surface, speed) = (&stage.solids[solid], -near.normal.dot(&m.velocity));
            if speed < ROLL_SPEED && near.face.is_some() {
                m = bounce(&ball, &m, &near.normal, 0.0, f64::INFINITY);
                m.velocity -= near.normal * near.normal.dot(&m.velocity);
                if support.is_none() {
                    support = Some(solid);
                    path.rolling.get_or_insert((time, solid));
                }
                path.push(time, &m);
                continue;
            }
            let scatter: f64 = StandardNormal.sample(rng);
            let restitution = (surface.restitution + stage.restitution_sd * scatter).clamp(0.0, 1.0);
            let after = bounce(&ball, &m, &near.normal, restitution, surface.friction);
            path.touches.push(Touch {
                time,
                center: m.position,
                normal: near.normal,
                before: m.velocity,
                after: after.velocity,
                restitution,
                solid,
                face: near.face,
            });
            // The center sinks in and comes back to one radius, and moves along with the mean of both velocities.
            let mean = (m.velocity + after.velocity) * 0.5;
            let along = mean - near.normal * near.normal.dot(&mean);
            m = Motion { position: m.position + along * stage.contact_duration, ..after };
            time += stage.contact_duration;
            path.push(time, &m);
        }
        path
    }

    /// When it appears, s.
    pub fn start(&self) -> f64 {
        self.knots.first().map_or(0.0, |k| k.time)
    }

    /// When it is gone, s.
    pub fn end(&self) -> f64 {
        self.knots.last().map_or(0.0, |k| k.time)
    }

    /// Center and velocity at `time`, world; `None` before the throw and after the catch.
    pub fn at(&self, time: f64) -> Option<(Vec3, Vec3)> {
        let after = self.knots.partition_point(|k| k.time <= time);
        let (a, b) = (self.knots.get(after.checked_sub(1)?)?, self.knots.get(after)?);
        let h = b.time - a.time;
        let s = (time - a.time) / h;
        let (r, q) = (1.0 - s, s * (1.0 - s));
        let position = a.position * (r * r * (1.0 + 2.0 * s)) + a.velocity * (h * q * r) + b.position * (s * s * (1.0 + 2.0 * r))
            - b.velocity * (h * q * s);
        let velocity = (b.position - a.position) * (6.0 * q / h) + a.velocity * (r * (1.0 - 3.0 * s)) + b.velocity * (s * (1.0 - 3.0 * r));
        Some((position, velocity))
    }

    /// Acceleration at `time`, world; `None` where it is not there.
    pub fn acceleration(&self, time: f64) -> Option<Vec3> {
        let after = self.knots.partition_point(|k| k.time <= time);
        let (a, b) = (self.knots.get(after.checked_sub(1)?)?, self.knots.get(after)?);
        let h = b.time - a.time;
        let s = (time - a.time) / h;
        Some((b.position - a.position) * ((6.0 - 12.0 * s) / (h * h)) + (a.velocity * (6.0 * s - 4.0) + b.velocity * (6.0 * s - 2.0)) / h)
    }

    /// Ends the path at `time`: somebody catches the ball.
    #[must_use]
    pub fn caught(mut self, time: f64) -> Self {
        if let Some((position, velocity)) = self.at(time) {
            self.knots.retain(|k| k.time < time);
            self.knots.push(Knot { time, position, velocity });
        }
        self.touches.retain(|t| t.time < time);
        self.rolling = self.rolling.filter(|r| r.0 < time);
        self
    }

    /// The same, `seconds` later.
    #[must_use]
    pub fn later(mut self, seconds: f64) -> Self {
        self.knots.iter_mut().for_each(|k| k.time += seconds);
        self.touches.iter_mut().for_each(|t| t.time += seconds);
        self.rolling = self.rolling.map(|(t, s)| (t + seconds, s));
        self
    }

    fn push(&mut self, time: f64, m: &Motion) {
        self.knots.push(Knot { time, position: m.position, velocity: m.velocity });
    }

    /// The motion after `h` seconds with nothing in the way.
    fn moved(&self, stage: &Stage, m: &Motion, support: Option<usize>, h: f64) -> Motion {
        let Some(solid) = support else { return self.ball.fly(&stage.gravity, m, h) };
        let normal = stage.solids[solid].nearest(&m.position).normal;
        let weight = stage.gravity.dot(&normal);
        let air = self.ball.acceleration(&Vec3::zeros(), &m.velocity, &Vec3::zeros());
        let pull = (stage.gravity - normal * weight + air) / (1.0 + self.ball.inertia);
        let pushed = m.velocity + pull * h;
        let brake = ROLL_RESISTANCE * weight.abs() * h;
        let velocity = if pushed.norm() > brake { pushed * (1.0 - brake / pushed.norm()) } else { Vec3::zeros() };
        Motion { position: m.position + (m.velocity + velocity) * (0.5 * h), velocity, spin: normal.cross(&velocity) / self.ball.radius }
    }

    /// The solid that a ball in this motion presses into.
    fn pressed(&self, stage: &Stage, m: &Motion) -> Option<(usize, Nearest)> {
        stage
            .solids
            .iter()
            .map(|s| s.nearest(&m.position))
            .enumerate()
            .find(|(_, near)| near.distance < self.ball.radius && near.normal.dot(&m.velocity) < -1e-9)
    }

    /// How far time can go before something is touched: a full step, or the moment of first touch and what is touched.
    fn advance(&self, stage: &Stage, m: &Motion, support: Option<usize>) -> (f64, Option<(usize, Nearest)>) {
        let Some(mut hit) = self.pressed(stage, &self.moved(stage, m, support, STEP)) else { return (STEP, None) };
        let (mut free, mut touching) = (0.0, STEP);
        for _ in 0..48 {
            let h = 0.5 * (free + touching);
            match self.pressed(stage, &self.moved(stage, m, support, h)) {
                Some(earlier) => (touching, hit) = (h, earlier),
                None => free = h,
            }
        }
        // Time must go on, however small the last bounces of an edge become.
        (touching.max(1e-5), Some(hit))
    }
}

#[cfg(test)]
mod tests {
    use super::super::impact::Shape;
    use super::*;
    use rand::SeedableRng;
    use rand::rngs::Xoshiro256PlusPlus;

    const BALL: Ball = Ball { radius: 0.033, mass: 0.057, inertia: 0.55, drag_coefficient: 0.0, magnus: false };

    fn stage(restitution: f64, friction: f64, contact_duration: f64) -> Stage {
        let ground =
            Solid { name: "ground", shape: Shape::Plane { normal: Vec3::z(), offset: 0.0 }, restitution, friction, visible: false };
        Stage { gravity: Vec3::new(0.0, 0.0, -9.81), solids: std::vec![ground], contact_duration, restitution_sd: 0.0 }
    }

    fn path(stage: &Stage, velocity: Vec3, duration: f64) -> Path {
        let start = Motion { position: Vec3::new(0.0, 0.0, 1.0), velocity, spin: Vec3::zeros() };
        Path::simulate(BALL, stage, 0.5, start, duration, &mut Xoshiro256PlusPlus::seed_from_u64(1))
    }

    #[test]
    fn nothing_lossy_loses_no_energy() {
        let path = path(&stage(1.0, 0.0, 0.0), Vec3::new(1.0, 0.5, 0.0), 5.0);
        assert!(path.touches.len() > 5);
        for i in 0..50 {
            let (p, v) = path.at(0.5 + 0.0999 * f64::from(i)).unwrap();
            assert!((0.5 * v.norm_squared() + 9.81 * p.z - 0.625 - 9.81).abs() < 1e-6, "{i}: {p} {v}");
        }
    }

    #[test]
    fn the_first_touch_is_one_radius_away_and_the_center_sinks_from_there() {
        let duration = 0.0045;
        let path = path(&stage(0.75, 0.6, duration), Vec3::new(1.0, 0.0, -2.0), 0.6);
        let touch = path.touches[0];
        assert!((touch.center.z - BALL.radius).abs() < 1e-9);
        let (deepest, _) = path.at(touch.time + 0.5 * duration).unwrap();
        let (last, after) = path.at(touch.time + duration + 1e-9).unwrap();
        assert!(deepest.z < BALL.radius - 0.003 && (last.z - BALL.radius).abs() < 1e-6);
        assert!((after - touch.after).norm() < 1e-6);
        // The two flights, prolonged into the touch, meet below the surface.
        let speed = -touch.before.z;
        let meeting = touch.after.z * duration / (speed + touch.after.z);
        assert!((speed * meeting - speed * 0.75 * duration / 1.75).abs() < 1e-12);
        assert!((last.x - touch.center.x - duration * 0.5 * (touch.before.x + touch.after.x)).abs() < 1e-6);
    }

    #[test]
    fn a_ball_comes_to_rest_on_the_floor() {
        let path = path(&stage(0.75, 0.6, 0.0045), Vec3::zeros(), 12.0);
        let (rolling, _) = path.rolling.unwrap();
        assert!((3.4..3.8).contains(&rolling) && path.touches.len() < 40, "{rolling} {}", path.touches.len());
        let (p, v) = path.at(12.0).unwrap();
        assert!((p.z - BALL.radius).abs() < 1e-6 && v.norm() < 1e-9);
    }

    #[test]
    fn a_ball_rolls_off_the_box_and_bounces_on() {
        let mut stage = stage(0.75, 0.6, 0.0);
        let shape = Shape::Box { center: Vec3::new(0.0, 0.0, 0.4), half: Vec3::repeat(0.4), rotation: crate::math::Mat3::identity() };
        stage.solids.push(Solid { name: "box", shape, restitution: 0.7, friction: 0.5, visible: false });
        let start = Motion { position: Vec3::new(0.0, 0.0, 0.834), velocity: Vec3::new(0.6, 0.0, 0.0), spin: Vec3::zeros() };
        let path = Path::simulate(BALL, &stage, 0.0, start, 3.0, &mut Xoshiro256PlusPlus::seed_from_u64(1));
        assert_eq!(path.rolling.unwrap().1, 1);
        let hit = path.touches.iter().find(|t| t.solid == 0).unwrap();
        assert!(hit.center.x > 0.433 && (hit.center.z - BALL.radius).abs() < 1e-9, "{hit:?}");
        let lowest = (0..3000).filter_map(|i| path.at(f64::from(i) * 1e-3)).map(|(p, _)| p.z).fold(1.0, f64::min);
        assert!(lowest > BALL.radius - 1e-4, "{lowest}");
    }
}
