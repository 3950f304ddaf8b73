//! Flights during which a hand moves the camera (sec. 3.1 (ii) of the paper).

use super::SimError;
use super::moves::Move;
use super::path::Path;
use super::throws::Thrower;
use crate::geometry::camera::Pose;
use crate::math::Vec3;

/// So many frames show the flight before the camera moves, and after: one more than is promised, as time is not counted in frames.
const STILL_FRAMES: f64 = 7.0;
/// At least for so long, however fast frames come, s.
const STILL: f64 = 0.2;
/// How long a motion lasts, if that is not told, s.
const DURATION: core::ops::Range<f64> = 0.25..0.45;
/// A hand strays from the straight line by up to this part of the way.
const BOW: f64 = 0.03;
/// How finely times are looked at, s.
const STEP: f64 = 5e-3;

impl Thrower<'_> {
    /// A flight that begins at `time`, while a motion joins `self.moves`: away at every first throw, back at every second.
    pub(super) fn while_carried(&mut self, time: f64) -> Result<Path, SimError> {
        let rest = self.moves.iter().fold(self.pose.translation, |sum, m| sum + m.by);
        let back = self.moves.last().filter(|_| self.moves.len() % 2 == 1).map(|m| -m.by);
        let (path, moved) = self.try_until(|thrower| {
            let by = back.unwrap_or_else(|| thrower.sideways());
            thrower.seen_while_carried(&rest, &by)
        })?;
        self.moves.push(Move { start: moved.start + time, ..moved });
        Ok(path)
    }

    /// Mostly to a side of the camera, as far as is told.
    fn sideways(&mut self) -> Vec3 {
        let side = if self.uniform(0.0, 1.0) < 0.5 { -1.0 } else { 1.0 };
        let direction = Vec3::new(side, self.uniform(-0.35, 0.35), self.uniform(-0.35, 0.35)).normalize();
        self.pose.rotation * direction * self.parameters.travel.unwrap_or_default()
    }

    /// A flight without a touch, all of it in view from before to after a motion from `rest` by `by`.
    fn seen_while_carried(&mut self, rest: &Vec3, by: &Vec3) -> Option<(Path, Move)> {
        let p = self.parameters;
        let rotation = self.pose.rotation;
        let middle = p.distance + self.uniform(-0.2, 0.3);
        let side = if self.uniform(0.0, 1.0) < 0.5 { -1.0 } else { 1.0 };
        // It rises to near the upper edge of the view, from as far below that it stays long, beside the view.
        let (ray, rise) = (Vec3::new(0.0, -self.uniform(0.2, 0.38), 1.0), self.uniform(0.35, 0.55));
        let drop = -Vec3::z() * (0.5 * p.gravity * rise * rise);
        // Before a tilted camera it is farther away below: by a third of that in the mean.
        let top = ray * (middle - rotation.tr_mul(&drop).z / 3.0);
        let below = rotation.tr_mul(&(rotation * top + drop));
        let start = rest + rotation * Vec3::new(side * (0.56 * below.z + 0.05), below.y, below.z);
        let velocity = Vec3::new(-side * self.uniform(0.9, 1.8), self.uniform(-0.2, 0.2), p.gravity * rise);
        let whole = |thrower: &Self, center: &Vec3, camera: Vec3| {
            thrower.inside_from(&Pose { rotation, translation: rest + camera }, center, p.radius)
        };
        if whole(self, &start, Vec3::zeros()) > -1.0 || start.z < 2.0 * p.radius {
            return None;
        }
        let duration = p.move_seconds.filter(|s| *s > 0.0).unwrap_or_else(|| self.uniform(DURATION.start, DURATION.end));
        let stray = by.cross(&Vec3::from_fn(|_, _| self.uniform(-1.0, 1.0))) * BOW;
        let late = self.uniform(0.0, 1.0);
        let path = self.fly(start, velocity, 1.6);
        let free = path.touches.first().map_or(path.end(), |t| t.time) - 0.05;
        let times = |from: f64, to: f64| (0..((to - from) / STEP).max(0.0) as u32).map(move |i| from + f64::from(i) * STEP);
        let seen = |t: f64, camera: Vec3| path.at(t).is_some_and(|(center, _)| whole(self, &center, camera) > 1.0);
        let still = (STILL_FRAMES / p.fps).max(STILL);
        let enter = times(0.0, free).find(|t| seen(*t, Vec3::zeros()))?;
        let spare = free - enter - duration - 2.0 * still;
        if spare < 0.0 {
            return None;
        }
        let begin = enter + still + spare * late;
        let moved = Move { start: begin, duration, by: *by, bow: stray };
        let in_view = |t: f64| seen(t, moved.at(t)[0]);
        let leave = times(enter, free).find(|t| !in_view(*t)).unwrap_or(free);
        (leave > moved.end() + still).then(|| (path.caught(free.min(leave + 0.2)), moved))
    }
}
