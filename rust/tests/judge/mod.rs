//! Holds the engine's events against a simulated scene's truth.
#![allow(dead_code)] // Each test and bench uses what it needs.

pub mod identity;

use physinc::config::{Config, Method};
use physinc::engine::Engine;
use physinc::event::{CameraOrientation, Contact, Event, Inconsistency, Kind, Surface, TrackStarted};
use physinc::geometry::camera::Pose;
use physinc::math::{Mat3, Vec3};
use physinc::seeing::Image;
use physinc::sim::Scene;
use physinc::sim::truth::{ContactTruth, SurfaceTruth, Truth};

/// A contact found is one that happened when their times differ by no more than this, ns.
pub const MATCH_NS: i64 = 50_000_000;
/// Height of the box, m.
const BOX: f64 = 0.09;

/// The events of one kind, final ones alone.
macro_rules! finals {
    ($events:expr, $kind:ident) => {
        $events
            .iter()
            .filter(|e| e.is_final)
            .filter_map(|e| if let Kind::$kind(x) = &e.kind { Some((e, x)) } else { None })
            .collect::<Vec<(&physinc::event::Event, &$kind)>>()
    };
}
#[allow(unused_imports)] // As above.
pub(crate) use finals;

/// Sums over scenes.
#[derive(Default)]
pub struct Score {
    pub countable: usize,
    pub matched: usize,
    pub wrong: usize,
    pub minutes: f64,
    pub center: Vec<f64>,
    pub time: Vec<f64>,
    pub nees: Vec<f64>,
    pub height: Vec<f64>,
    pub plane: Vec<f64>,
    pub gravity: Vec<f64>,
    pub surfaces: Vec<usize>,
    pub tracks: usize,
    pub alarms: usize,
}

/// Root mean square.
pub fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|x| x * x).sum::<f64>() / values.len() as f64).sqrt()
}

/// The mean.
pub fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// Runs `scene` through the engine; all events, and the world's pose.
pub fn run(scene: &Scene, config: &Config) -> (Vec<Event>, Pose) {
    let mut engine = Engine::new(config, Some(&scene.camera())).expect("a valid configuration");
    let mut events = Vec::new();
    let mut frames = scene.frames();
    while let Some(frame) = frames.next_frame() {
        engine.frame(frame.timestamp_ns, Image::U16(frame.samples), &mut |e| events.push(e)).expect("the camera's image");
    }
    engine.finish(&mut |e| events.push(e));
    (events, engine.world_from_camera())
}

/// What a user would tell of a scene: how long its ball touches and spins, and that its first frames may show it.
pub fn config(scene: &Scene, method: Method) -> Config {
    let mut config = Config::default();
    let p = &scene.truth().parameters;
    config.object.contact_duration = p.contact_duration;
    config.object.spin_sd = p.spin_sd;
    config.laws.method = method;
    config.tracking.background_frames = 0;
    config
}

/// Whether each contact has 4 frames with 60 % of the disc in view on either side, after the contact before and before the one after.
pub fn countable(truth: &Truth) -> Vec<bool> {
    let seen = |c: &ContactTruth, from: i64, to: i64| {
        let balls = truth.frames.iter().flat_map(|f| &f.balls);
        balls.filter(|b| b.ball == c.ball && b.in_view >= 0.6 && b.time_ns > from && b.time_ns < to).count() >= 4
    };
    let both = |c: &ContactTruth| {
        let others = || truth.contacts.iter().filter(|o| o.ball == c.ball).map(|o| o.time_ns);
        let before = others().filter(|t| *t < c.time_ns).max().unwrap_or(i64::MIN);
        let after = others().filter(|t| *t > c.time_ns).min().unwrap_or(i64::MAX);
        seen(c, before, c.time_ns) && seen(c, c.time_ns, after)
    };
    truth.contacts.iter().map(both).collect()
}

fn angle_deg(a: &Vec3, b: &Vec3) -> f64 {
    a.angle(b).to_degrees()
}

impl Score {
    /// Adds what the engine makes of `scene`.
    pub fn add(&mut self, scene: &str, method: Method) {
        let scene = Scene::parse(scene).expect(scene);
        let (events, pose) = run(&scene, &config(&scene, method));
        self.judge(&scene, &events, &pose);
    }

    /// Adds `events` that the engine told of `scene`.
    pub fn judge(&mut self, scene: &Scene, events: &[Event], pose: &Pose) {
        let truth = scene.truth();
        let contacts = finals!(events, Contact);
        self.tracks += finals!(events, TrackStarted).len();
        self.alarms += finals!(events, Inconsistency).len();
        if let (Some(a), Some(b)) = (truth.frames.first(), truth.frames.last()) {
            self.minutes += (b.timestamp_ns - a.timestamp_ns) as f64 / 60e9;
        }
        self.wrong += contacts.iter().filter(|(_, c)| !truth.contacts.iter().any(|t| (t.time_ns - c.time_ns).abs() < MATCH_NS)).count();
        for (t, _) in truth.contacts.iter().zip(countable(truth)).filter(|(_, yes)| *yes) {
            self.countable += 1;
            let gap = |c: &Contact| (t.time_ns - c.time_ns).abs();
            if let Some((_, c)) = contacts.iter().filter(|(_, c)| gap(c) < MATCH_NS).min_by_key(|(_, c)| gap(c)) {
                self.compare(c, t, pose);
            }
        }
        self.compare_surfaces(events, truth, pose);
        if let Some((_, o)) = finals!(events, CameraOrientation).last() {
            self.gravity.push(angle_deg(&Vec3::from(o.gravity_in_camera), &Vec3::from(truth.gravity_in_camera)));
        }
    }

    fn compare(&mut self, c: &Contact, t: &ContactTruth, pose: &Pose) {
        self.matched += 1;
        let error = Vec3::from(c.center) - pose.to_world(&Vec3::from(t.center_in_camera));
        let covariance = Mat3::from_fn(|i, j| c.covariance[i][j]);
        self.nees.push(covariance.try_inverse().map_or(f64::INFINITY, |i| error.dot(&(i * error)) / 3.0));
        self.center.push(error.norm());
        self.time.push((c.time_ns - t.time_ns) as f64 * 1e-9);
    }

    /// Ground and top of the box, each against the surface nearest to it.
    fn compare_surfaces(&mut self, events: &[Event], truth: &Truth, pose: &Pose) {
        let surfaces: Vec<&Surface> = finals!(events, Surface).into_iter().map(|(_, s)| s).filter(|s| s.merged_into.is_none()).collect();
        self.surfaces.push(surfaces.len());
        let level = |t: &&SurfaceTruth| t.name.contains("ground") || t.name.contains("top");
        for t in truth.surfaces.iter().filter(level) {
            let normal = pose.rotation * Vec3::from(t.normal_in_camera);
            let offset = t.offset_in_camera + normal.dot(&pose.translation);
            let miss = |s: &&&Surface| (s.offset - offset).abs();
            let nearest = surfaces.iter().filter(|s| s.contacts >= 3).min_by(|a, b| miss(a).total_cmp(&miss(b)));
            if let Some(s) = nearest {
                self.plane.push(angle_deg(&Vec3::from(s.normal), &normal));
                self.height.extend(s.above.filter(|_| t.name.contains("top")).map(|a| a.height - BOX));
            }
        }
    }

    /// Head of the table.
    pub const HEAD: &str = "| scene | method | found | false/min | center mm | time ms | NEES | box height mm | planes ° | gravity ° | alarms |\n|---|---|---|---|---|---|---|---|---|---|---|";

    /// One line of the table; all errors are rms.
    pub fn row(&self, scene: &str, method: Method) -> String {
        let method = if method == Method::Paper { "paper" } else { "best" };
        let percent = 100.0 * self.matched as f64 / self.countable as f64;
        let gravity = if self.gravity.is_empty() { "–".to_owned() } else { format!("{:.3}", rms(&self.gravity)) };
        format!(
            "| {scene} | {method} | {}/{} ({percent:.1} %) | {:.2} | {:.2} | {:.2} | {:.2} | {:.2} | {:.2} | {gravity} | {} |",
            self.matched,
            self.countable,
            self.wrong as f64 / self.minutes,
            rms(&self.center) * 1e3,
            rms(&self.time) * 1e3,
            mean(&self.nees),
            rms(&self.height) * 1e3,
            rms(&self.plane),
            self.alarms
        )
    }
}

/// What INTERFACE promises of any stream's events: stamps never decrease, tracks live before they are spoken of, every id is final
/// exactly once.
pub fn hold(events: &[Event]) {
    use std::collections::{HashMap, HashSet};
    let mut live = HashSet::new();
    let mut ever = HashSet::new();
    let mut finals: HashMap<(u8, u32), usize> = HashMap::new();
    assert!(events.is_sorted_by_key(|e| e.timestamp_ns), "a stamp goes back");
    for e in events {
        let id = match &e.kind {
            Kind::TrackStarted(_) => {
                assert!(ever.insert(e.track), "{:?} began twice", e.track);
                live.insert(e.track);
                None
            }
            Kind::TrackEnded(_) => {
                assert!(live.remove(&e.track), "{:?} ended without having begun", e.track);
                None
            }
            Kind::Position(p) => {
                assert!(live.contains(&e.track) && p.center.iter().all(|x| x.is_finite()));
                None
            }
            Kind::Contact(c) => {
                assert!(live.contains(&e.track) && c.center.iter().chain(c.covariance.iter().flatten()).all(|x| x.is_finite()), "{c:?}");
                if let (Some(n), Some(v)) = (c.normal, c.velocity_before) {
                    assert!(Vec3::from(n).dot(&Vec3::from(v)) <= 1e-9 && (Vec3::from(n).norm() - 1.0).abs() < 1e-9);
                }
                Some((0, c.id))
            }
            Kind::Surface(s) => {
                let named = s.above.map(|above| above.surface).into_iter().chain(s.merged_into);
                named.for_each(|id| assert!(finals.contains_key(&(1, id)), "{s:?} names one that was not told"));
                Some((1, s.id))
            }
            Kind::CameraOrientation(o) => Some((2, o.id)),
            Kind::CameraMotion(m) => Some((3, m.id)),
            Kind::Activity(a) => Some((4, a.id)),
            _ => None,
        };
        if let Some(id) = id {
            let count = finals.entry(id).or_default();
            assert_eq!(*count, 0, "{id:?} after it was final");
            *count += usize::from(e.is_final);
        }
    }
    assert!(live.is_empty(), "{live:?} never ended");
    assert!(finals.values().all(|n| *n == 1), "not final: {finals:?}");
}
