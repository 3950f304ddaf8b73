//! How balls are thrown in each scene.

use super::SimError;
use super::body::{Ball, Motion};
use super::impact::{Shape, Solid};
use super::moves::Move;
use super::parameters::{Kind, Parameters};
use super::path::{Path, Stage};
use super::rigid::{Rigid, State};
use crate::geometry::camera::{Camera, Pose};
use crate::math::Vec3;
use rand::RngExt;
use rand::rngs::Xoshiro256PlusPlus;
use rand_distr::{Distribution, StandardNormal};
use std::vec::Vec;

/// Throws tried before a scene is given up.
const TRIES: u32 = 20_000;
/// Flight that must be in view before the first touch and after the last, s.
const CLEAR: f64 = 0.2;
/// Where a flight is to show a camera's orientation it stays in view for so many frames: one more than is promised.
const FREE_FRAMES: f64 = 16.0;
/// Height of the box and half its other edges, m.
const BOX: Vec3 = Vec3::new(0.22, 0.17, 0.045);

/// What surrounds the balls of a scene.
pub(super) fn stage(kind: Kind, p: &Parameters) -> Stage {
    let room = kind == Kind::Room;
    let structure = p.structure.unwrap_or_default();
    let (restitution, friction) = (p.restitution, p.friction);
    let plane = |name, normal, offset, visible| Solid { name, shape: Shape::Plane { normal, offset }, restitution, friction, visible };
    let mut solids = std::vec![plane("ground", Vec3::z(), 0.0, room || structure.has_floor())];
    if matches!(kind, Kind::Bounce | Kind::Room) {
        let (center, rotation) = (Vec3::new(0.15, p.distance, BOX.z), *nalgebra::Rotation3::from_euler_angles(0.0, 0.0, 0.1).matrix());
        solids.push(Solid {
            name: "box",
            shape: Shape::Box { center, half: BOX, rotation },
            restitution: restitution - 0.05,
            friction,
            visible: false,
        });
    }
    if room || structure.has_wall() {
        solids.push(plane("wall", -Vec3::y(), -(p.distance + 1.2), true));
    }
    Stage { gravity: Vec3::new(0.0, 0.0, -p.gravity), solids, contact_duration: p.contact_duration, restitution_sd: p.restitution_sd }
}

/// Who throws.
pub(super) struct Thrower<'a> {
    pub(super) kind: Kind,
    pub(super) parameters: &'a Parameters,
    pub(super) stage: &'a Stage,
    pub(super) camera: &'a Camera,
    pub(super) pose: &'a Pose,
    pub(super) rng: &'a mut Xoshiro256PlusPlus,
    /// How the camera is moved, in the order of time.
    pub(super) moves: Vec<Move>,
    /// What isn't a ball.
    pub(super) things: Vec<Rigid>,
}

impl Thrower<'_> {
    /// All paths of the scene, the first after `lead` seconds.
    pub(super) fn throw_all(&mut self, lead: f64) -> Result<Vec<Path>, SimError> {
        let mut paths: Vec<Path> = Vec::new();
        let mut time = lead;
        for i in 0..self.parameters.throws {
            let thrown = match self.kind {
                Kind::Bounce | Kind::Room => std::vec![self.try_until(|t| t.over_the_box(i % 2 == 1))?],
                Kind::PassiveFlight => std::vec![self.try_until(|t| t.past_everything(0.33))?],
                Kind::RotatedCamera => std::vec![self.try_until(|t| t.past_everything(FREE_FRAMES / t.parameters.fps.min(30.0)))?],
                Kind::TranslatingCamera => std::vec![self.while_carried(time)?],
                Kind::TwoBalls => self.try_until(Self::crossing)?.into(),
                Kind::Many => self.many()?,
                Kind::Drop => std::vec![self.dropped()],
                Kind::Roll => std::vec![self.try_until(Self::rolling)?],
                Kind::FlyingRobot | Kind::ToyCar => {
                    let thing = if self.kind == Kind::ToyCar { self.car(time)? } else { self.robot(time)? };
                    self.things.push(thing);
                    Vec::new()
                }
            };
            let gone = self.things.last().map_or(0.0, |thing| thing.end - time);
            let end = thrown.iter().map(Path::end).fold(gone, f64::max);
            paths.extend(thrown.into_iter().map(|p| p.later(time)));
            time += end + self.uniform(0.1, 0.8);
        }
        Ok(paths)
    }

    pub(super) fn try_until<T>(&mut self, mut throw: impl FnMut(&mut Self) -> Option<T>) -> Result<T, SimError> {
        (0..TRIES).find_map(|_| throw(self)).ok_or(SimError::NoThrow { tried: TRIES })
    }

    pub(super) fn uniform(&mut self, from: f64, to: f64) -> f64 {
        self.rng.random_range(from..to)
    }

    fn normal(&mut self) -> f64 {
        StandardNormal.sample(self.rng)
    }

    pub(super) fn fly(&mut self, position: Vec3, velocity: Vec3, duration: f64) -> Path {
        let p = self.parameters;
        let drag_coefficient = if p.drag_coefficient > 0.0 { (p.drag_coefficient + p.drag_sd * self.normal()).max(0.0) } else { 0.0 };
        let ball = Ball { radius: p.radius, mass: p.mass, inertia: p.inertia, drag_coefficient, magnus: p.magnus };
        let spin = Vec3::new(self.normal(), self.normal(), self.normal()) * p.spin_sd;
        Path::simulate(ball, self.stage, 0.0, Motion { position, velocity, spin }, duration, self.rng)
    }

    /// Signed distance of the ball's rim from the edge of the image, in its radii: below −1 nothing of it is in view, above 1 all of it.
    pub(super) fn inside(&self, center: &Vec3) -> f64 {
        self.inside_from(self.pose, center, self.parameters.radius)
    }

    /// The same for a camera that has been moved to `pose`, and a sphere of this radius.
    pub(super) fn inside_from(&self, pose: &Pose, center: &Vec3, radius: f64) -> f64 {
        let c = pose.to_camera(center);
        let Some((x, y)) = self.camera.project(&c) else { return -9.0 };
        let (width, height) = (self.camera.width as f64, self.camera.height as f64);
        let margin = (x + 0.5).min(width - 0.5 - x).min(y + 0.5).min(height - 0.5 - y);
        margin / (self.camera.fx * radius / c.z)
    }

    /// From when to when all of the ball is in view, the first time it is.
    pub(super) fn stay(&self, path: &Path) -> Option<(f64, f64)> {
        let whole = |t: &f64| path.at(*t).is_some_and(|(p, _)| self.inside(&p) > 1.0);
        let times = || (0..(path.end() / 5e-3) as u32).map(|i| f64::from(i) * 5e-3);
        let enter = times().find(whole)?;
        let leave = times().skip_while(|t| *t < enter).find(|t| !whole(t)).unwrap_or(path.end());
        Some((enter, leave))
    }

    /// Whether all of a thing is in view all the time.
    pub(super) fn stays_in_view(&self, thing: &Rigid) -> bool {
        let reach = thing.reach();
        let whole = |state: State| self.inside_from(self.pose, &state.position, reach) > 1.0;
        (0..((thing.end - thing.start) / 2e-2) as u32).all(|i| thing.at(thing.start + f64::from(i) * 2e-2).is_none_or(whole))
    }

    /// A point in the middle of the scene, `height` over the floor.
    pub(super) fn around_middle(&mut self, x: f64, y: f64, height: f64) -> Vec3 {
        let middle = self.parameters.distance;
        Vec3::new(self.uniform(-x, x), middle + self.uniform(-y, y), height)
    }

    /// Thrown into view from outside, two to four bounces, then out of view or caught in mid-air.
    fn over_the_box(&mut self, onto_box: bool) -> Option<Path> {
        let (p, radius) = (self.parameters, self.parameters.radius);
        let target = if onto_box {
            Vec3::new(0.15, p.distance, 2.0 * BOX.z + radius) + Vec3::new(self.uniform(-0.19, 0.19), self.uniform(-0.14, 0.14), 0.0)
        } else {
            self.around_middle(0.6, 0.35, radius)
        };
        let (fall, drop) = (self.uniform(0.25, 0.65), self.uniform(0.2, 1.3));
        let (speed, angle) = (self.uniform(0.2, 1.8), self.uniform(0.0, core::f64::consts::TAU));
        let across = Vec3::new(angle.cos(), angle.sin(), 0.0) * speed;
        let start = target - across * fall + Vec3::z() * drop;
        if self.inside(&start) > -1.0 {
            return None;
        }
        let up = 0.5 * p.gravity * fall - drop / fall;
        let path = self.fly(start, across + Vec3::z() * up, 2.4);
        let (enter, leave) = self.stay(&path)?;
        let seen = path.touches.iter().take_while(|t| t.time < leave).count();
        if seen < 2 || path.touches[0].time < enter + CLEAR {
            return None;
        }
        let wanted = self.rng.random_range(2..=seen.min(4));
        let last = path.touches[wanted - 1];
        let next = path.touches.get(wanted).map_or(path.end(), |t| t.time);
        let caught = if wanted == seen && leave < next { leave + 0.2 } else { last.time + self.uniform(CLEAR, 0.45) }.min(next - 0.03);
        let touches = &path.touches[..wanted];
        let on_box = touches.iter().any(|t| t.solid == 1);
        let fits = caught.min(leave) - last.time > CLEAR
            && on_box == onto_box
            && touches.iter().all(|t| t.face.is_some() && (t.center.y - p.distance).abs() < 0.45)
            && touches.windows(2).all(|t| t[1].time - t[0].time > CLEAR);
        fits.then(|| path.caught(caught))
    }

    /// Thrown through the view, where it stays for more than `least` s; caught before it touches anything.
    fn past_everything(&mut self, least: f64) -> Option<Path> {
        let (middle, fall) = (self.around_middle(0.3, 0.3, 0.0), self.uniform(0.2, 0.6));
        let (speed, angle) = (self.uniform(0.5, 3.0), self.uniform(0.0, core::f64::consts::TAU));
        let velocity = Vec3::new(angle.cos(), angle.sin(), 0.0) * speed + Vec3::z() * self.uniform(0.0, 4.0);
        let up = Vec3::z() * self.uniform(0.1, 1.0);
        let start = middle + up - Vec3::new(velocity.x, velocity.y, 0.0) * fall;
        if self.inside(&start) > -1.0 || start.z < 2.0 * self.parameters.radius {
            return None;
        }
        let path = self.fly(start, velocity, 1.5);
        let free = path.touches.first().map_or(path.end(), |t| t.time) - 0.05;
        let (enter, leave) = self.stay(&path)?;
        (leave.min(free) - enter > least).then(|| path.caught(free.min(leave + 0.2)))
    }

    /// Two balls from either side, the nearer before the other for a moment.
    fn crossing(&mut self) -> Option<[Path; 2]> {
        let (middle, gap) = (self.parameters.distance, self.uniform(0.08, 0.2));
        let height = self.uniform(0.5, 0.7);
        let mut from = |side: f64, y: f64| {
            let (across, up, drift) = (self.uniform(1.5, 2.0), self.uniform(0.8, 1.6), self.uniform(-0.1, 0.1));
            let start = Vec3::new(side * (0.62 * y + 0.05), y, height + self.uniform(-0.04, 0.04));
            (start, Vec3::new(-side * across, drift, up))
        };
        let (left, right) = (from(-1.0, middle - gap), from(1.0, middle + gap));
        let paths = [self.fly(left.0, left.1, 2.4), self.fly(right.0, right.1, 2.4)];
        let stays = [self.stay(&paths[0])?, self.stay(&paths[1])?];
        let meet = (stays[0].0.max(stays[1].0), stays[0].1.min(stays[1].1));
        let apart = |t: f64| Some((self.pose.to_camera(&paths[0].at(t)?.0), self.pose.to_camera(&paths[1].at(t)?.0)));
        let closest = (0..200)
            .filter_map(|i| apart(meet.0 + (meet.1 - meet.0) * f64::from(i) / 200.0))
            .map(|(a, b)| (a / a.z - b / b.z).norm() * middle);
        let crosses = closest.fold(f64::INFINITY, f64::min) < self.parameters.radius;
        let long = stays.iter().all(|s| s.1 - s.0 > 0.6);
        (crosses && long).then(|| {
            let mut ends = stays.iter().map(|s| s.1 + 0.2);
            paths.map(|p| p.caught(ends.next().unwrap_or(f64::INFINITY)))
        })
    }

    /// Let go in view, never caught.
    fn dropped(&mut self) -> Path {
        let start = self.around_middle(0.3, 0.15, 0.0) + Vec3::z() * self.uniform(0.55, 0.8);
        self.fly(start, Vec3::zeros(), 6.0)
    }

    /// Thrown low, seen until it rolls.
    fn rolling(&mut self) -> Option<Path> {
        let y = self.parameters.distance + self.uniform(-0.2, 0.2);
        let start = Vec3::new(-0.62 * y - 0.05, y, self.uniform(0.1, 0.3));
        let velocity = Vec3::new(self.uniform(0.4, 0.9), self.uniform(-0.1, 0.1), self.uniform(0.0, 0.6));
        let path = self.fly(start, velocity, 9.0);
        let (_, leave) = self.stay(&path)?;
        let (rolling, _) = path.rolling?;
        (rolling + 0.5 < leave).then(|| path.caught(leave + 0.2))
    }
}
