//! Whether each track is one ball's, and each ball's one track's.

use super::{countable, finals};
use physinc::event::{Contact, Event, Kind, Position, TrackStarted};
use physinc::math::Vec3;
use physinc::sim::truth::{FrameTruth, Truth};
use std::collections::{HashMap, HashSet};

/// A position is a ball's that is no farther away than this, m; balls are farther apart.
const NEAR: f64 = 0.033;

/// Sums over scenes.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Identities {
    pub scenes: usize,
    pub balls: usize,
    pub tracks: usize,
    /// Tracks whose positions are one ball's first and another's later.
    pub swapped: usize,
    /// Positions where no ball is.
    pub ghosts: usize,
    /// Balls in a frame with 95 % of their disc in view, and of these with a position.
    pub shown: usize,
    pub measured: usize,
    /// Contacts that could be found, that were, and told ones that never were.
    pub countable: usize,
    pub matched: usize,
    pub wrong: usize,
}

impl Identities {
    /// Adds what was told of a scene.
    pub fn add(&mut self, events: &[Event], truth: &Truth) {
        self.scenes += 1;
        self.balls += truth.frames.iter().flat_map(|f| &f.balls).map(|b| b.ball).collect::<HashSet<_>>().len();
        self.tracks += finals!(events, TrackStarted).len();
        let mut owners: HashMap<u32, HashSet<usize>> = HashMap::new();
        let mut told: HashSet<(u64, usize)> = HashSet::new();
        for (e, p) in finals!(events, Position) {
            match owner(&truth.frames[p.frame as usize], &p.center.into()) {
                Some(ball) => {
                    owners.entry(e.track.unwrap_or(0)).or_default().insert(ball);
                    told.insert((p.frame, ball));
                }
                None => self.ghosts += 1,
            }
        }
        self.swapped += owners.values().filter(|balls| balls.len() > 1).count();
        for (i, frame) in truth.frames.iter().enumerate() {
            for ball in frame.balls.iter().filter(|b| b.in_view > 0.95) {
                self.shown += 1;
                self.measured += usize::from(told.contains(&(i as u64, ball.ball)));
            }
        }
        let contacts = finals!(events, Contact);
        let is = |c: &Contact, time_ns: i64, center: &[f64; 3]| {
            (c.time_ns - time_ns).abs() < super::MATCH_NS && (Vec3::from(c.center) - Vec3::from(*center)).norm() < 0.1
        };
        self.wrong += contacts.iter().filter(|(_, c)| !truth.contacts.iter().any(|t| is(c, t.time_ns, &t.center))).count();
        for (t, _) in truth.contacts.iter().zip(countable(truth)).filter(|(_, yes)| *yes) {
            self.countable += 1;
            self.matched += usize::from(contacts.iter().any(|(_, c)| is(c, t.time_ns, &t.center)));
        }
    }

    /// Head of the table.
    pub const HEAD: &str =
        "| scene | scenes | balls | tracks | swapped | ghosts | measured | contacts | false |\n|---|---|---|---|---|---|---|---|---|";

    /// One line of it.
    pub fn row(&self, scene: &str) -> String {
        let percent = 100.0 * self.measured as f64 / self.shown as f64;
        let Self { scenes, balls, tracks, swapped, ghosts, matched, countable, wrong, .. } = self;
        format!("| {scene} | {scenes} | {balls} | {tracks} | {swapped} | {ghosts} | {percent:.2} % | {matched}/{countable} | {wrong} |")
    }
}

/// The ball that is at `center` (world; the scene's pose is told) in a frame.
pub fn owner(frame: &FrameTruth, center: &Vec3) -> Option<usize> {
    let distance = |c: &[f64; 3]| (Vec3::from(*c) - center).norm();
    let near = frame.balls.iter().filter(|b| distance(&b.center) < NEAR);
    near.min_by(|a, b| distance(&a.center).total_cmp(&distance(&b.center))).map(|b| b.ball)
}
