//! Many balls in the air at once, which cross, hide each other and bounce meanwhile.

use super::SimError;
use super::path::Path;
use super::throws::Thrower;
use crate::math::Vec3;
use std::vec::Vec;

/// Balls don't touch each other: their centers stay so many radii apart.
const APART: f64 = 3.0;
/// A ball that is to hide another does so for so long in all, s: four frames of a Kinect, up to fifteen.
const HIDES: core::ops::Range<f64> = 0.13..0.5;
/// All balls are in view together for so long, s.
const TOGETHER: f64 = 0.2;
/// How finely times are looked at, s.
const STEP: f64 = 5e-3;
/// Throws tried for one ball, before the others are thrown anew.
const TRIES: u32 = 400;

impl Thrower<'_> {
    /// `parameters.balls` paths, thrown in from both sides. Every second ball flies along with the one before it, so that for a while one of the two
    /// hides half of the other or more.
    pub(super) fn many(&mut self) -> Result<Vec<Path>, SimError> {
        let count = self.parameters.balls as usize;
        self.try_until(|thrower| {
            let mut paths: Vec<Path> = Vec::new();
            while paths.len() < count {
                let next = (0..TRIES).find_map(|_| thrower.another(&paths))?;
                paths.push(next);
            }
            Some(paths)
        })
    }

    /// One more ball that fits to those in the air.
    fn another(&mut self, others: &[Path]) -> Option<Path> {
        let leader = others.last().filter(|_| others.len() % 2 == 1);
        let path = match leader {
            Some(leader) => self.beside(leader)?,
            None => self.across()?,
        };
        let (enter, leave) = self.stay(&path)?;
        let path = path.caught(leave + 0.2);
        let stays = others.iter().filter_map(|o| self.stay(o));
        let together = stays.fold((enter, leave), |a, b| (a.0.max(b.0), a.1.min(b.1)));
        let radius = self.parameters.radius;
        let free = |o: &Path| times(path.start().max(o.start()), path.end().min(o.end())).all(|t| distance(&path, o, t) > APART * radius);
        let fits = leave - enter > 0.5 && together.1 - together.0 > TOGETHER && others.iter().all(free);
        (fits && leader.is_none_or(|l| HIDES.contains(&self.hidden(&path, l)))).then_some(path)
    }

    /// From one side to the other, high or low.
    fn across(&mut self) -> Option<Path> {
        let side = if self.uniform(0.0, 1.0) < 0.5 { -1.0 } else { 1.0 };
        let y = self.parameters.distance + self.uniform(-0.35, 0.5);
        let start = Vec3::new(side * (0.6 * y + 0.05), y, self.uniform(0.1, 0.8));
        let velocity = Vec3::new(-side * self.uniform(0.8, 2.2), self.uniform(-0.2, 0.2), self.uniform(-0.5, 3.0));
        let wait = self.uniform(0.0, 0.7);
        (self.inside(&start) < -1.0).then(|| self.fly(start, velocity, 2.2).later(wait))
    }

    /// Along with `leader` in the image, nearer or farther.
    fn beside(&mut self, leader: &Path) -> Option<Path> {
        let (start, velocity) = leader.at(leader.start())?;
        let eye = self.pose.translation;
        let farther = 1.0 + self.uniform(0.1, 0.25) * if self.uniform(0.0, 1.0) < 0.5 { -1.0 } else { 1.0 };
        let beside = Vec3::new(self.uniform(-0.1, 0.1), 0.0, self.uniform(-0.1, 0.1));
        let start = eye + (start - eye) * farther + beside;
        let velocity = velocity * farther + Vec3::new(self.uniform(-0.3, 0.3), 0.0, self.uniform(-0.3, 0.3));
        let wait = (leader.start() + self.uniform(-0.05, 0.05)).max(0.0);
        (self.inside(&start) < -1.0 && start.z > 2.0 * self.parameters.radius).then(|| self.fly(start, velocity, 2.2).later(wait))
    }

    /// How long a line of sight to one ball's center meets the other ball too, s.
    fn hidden(&self, a: &Path, b: &Path) -> f64 {
        let sight = |path: &Path, t: f64| path.at(t).map(|(p, _)| self.pose.to_camera(&p));
        let hides = |t: &f64| {
            let (Some(a), Some(b)) = (sight(a, *t), sight(b, *t)) else { return false };
            (a / a.z - b / b.z).norm() * a.z.min(b.z) < self.parameters.radius
        };
        let in_view = |t: &f64| a.at(*t).is_some_and(|(p, _)| self.inside(&p) > 1.0);
        times(a.start().max(b.start()), a.end().min(b.end())).filter(|t| hides(t) && in_view(t)).count() as f64 * STEP
    }
}

fn times(from: f64, to: f64) -> impl Iterator<Item = f64> {
    (0..((to - from) / STEP).max(0.0) as u32).map(move |i| from + f64::from(i) * STEP)
}

fn distance(a: &Path, b: &Path, t: f64) -> f64 {
    a.at(t).zip(b.at(t)).map_or(f64::INFINITY, |((a, _), (b, _))| (a - b).norm())
}
