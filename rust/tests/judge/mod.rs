//! Holds the engine's events against a simulated scene's truth.

use physinc::config::{CameraAssumption, Config, Method};
use physinc::engine::Engine;
use physinc::event::{Contact, Event, Kind, Surface};
use physinc::geometry::camera::Pose;
use physinc::math::{Mat3, Vec3};
use physinc::seeing::Image;
use physinc::sim::Scene;
use physinc::sim::truth::{ContactTruth, Truth};

/// A contact found is one that happened when their times differ by no more than this, ns.
const MATCH_NS: i64 = 50_000_000;

/// Sums over scenes.
#[derive(Default)]
pub struct Score {
    pub countable: usize,
    pub found: usize,
    pub matched: usize,
    pub wrong: usize,
    pub minutes: f64,
    pub center: Vec<f64>,
    pub center_axis: [f64; 3],
    pub time: Vec<f64>,
    pub nees: Vec<f64>,
    pub normal: Vec<f64>,
    pub height: Vec<f64>,
    pub height_z: Vec<f64>,
    pub plane: Vec<f64>,
    pub gravity: Vec<f64>,
    pub surfaces: Vec<usize>,
    pub tracks: usize,
    pub inconsistencies: usize,
}

/// Root mean square.
pub fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|x| x * x).sum::<f64>() / values.len().max(1) as f64).sqrt()
}

/// The mean.
pub fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

/// Runs `scene` through the engine; all events, and the world's pose.
pub fn run(scene: &Scene, config: &Config) -> (Vec<Event>, Pose) {
    let camera = scene.camera();
    let mut engine = Engine::new(config, Some(&camera)).expect("a valid configuration");
    let mut events = Vec::new();
    let mut frames = scene.frames();
    while let Some(frame) = frames.next_frame() {
        engine.frame(frame.timestamp_ns, Image::U16(frame.samples), &mut |e| events.push(e)).expect("the camera's image");
    }
    engine.finish(&mut |e| events.push(e));
    (events, engine.world_from_camera())
}

/// Configuration for a scene of the simulator; the duration of the touch is told, as a user would.
pub fn config(scene: &Scene, method: Method) -> Config {
    let mut config = Config::default();
    let p = &scene.truth().parameters;
    config.object.contact_duration = p.contact_duration;
    config.object.spin_sd = p.spin_sd;
    config.laws.method = method;
    config.tracking.background_frames = 0;
    config
}

/// Whether each contact has 4 frames with 60 % of the disc in view on either side, before the contact before and the contact after.
pub fn countable(truth: &Truth) -> Vec<bool> {
    let seen = |c: &ContactTruth, from: i64, to: i64| {
        let balls = truth.frames.iter().flat_map(|f| &f.balls);
        balls.filter(|b| b.ball == c.ball && b.in_view >= 0.6 && b.time_ns > from && b.time_ns < to).count() >= 4
    };
    let neighbour = |c: &ContactTruth, later: bool| {
        let others = truth.contacts.iter().filter(|o| o.ball == c.ball).map(|o| o.time_ns);
        if later { others.filter(|t| *t > c.time_ns).min() } else { others.filter(|t| *t < c.time_ns).max() }
    };
    let both = |c: &ContactTruth| {
        seen(c, neighbour(c, false).unwrap_or(i64::MIN), c.time_ns) && seen(c, c.time_ns, neighbour(c, true).unwrap_or(i64::MAX))
    };
    truth.contacts.iter().map(both).collect()
}

impl Score {
    /// Adds what the engine made of `scene`.
    pub fn add(&mut self, text: &str, method: Method) {
        let scene = Scene::parse(text).expect(text);
        let (events, pose) = run(&scene, &config(&scene, method));
        let truth = scene.truth();
        let contacts: Vec<&Contact> =
            events.iter().filter(|e| e.is_final).filter_map(|e| if let Kind::Contact(c) = &e.kind { Some(c) } else { None }).collect();
        let surfaces: Vec<&Surface> =
            events.iter().filter(|e| e.is_final).filter_map(|e| if let Kind::Surface(s) = &e.kind { Some(s) } else { None }).collect();
        let count = |f: fn(&Kind) -> bool| events.iter().filter(|e| f(&e.kind)).count();
        self.tracks += count(|k| matches!(k, Kind::TrackStarted(_)));
        self.inconsistencies += count(|k| matches!(k, Kind::Inconsistency(_)));
        if let (Some(a), Some(b)) = (truth.frames.first(), truth.frames.last()) {
            self.minutes += (b.timestamp_ns - a.timestamp_ns) as f64 / 60e9;
        }
        self.found += contacts.len();
        self.wrong += contacts.iter().filter(|c| !truth.contacts.iter().any(|t| (t.time_ns - c.time_ns).abs() < MATCH_NS)).count();
        for (t, _) in truth.contacts.iter().zip(countable(truth)).filter(|(_, yes)| *yes) {
            self.countable += 1;
            let nearest =
                contacts.iter().filter(|c| (t.time_ns - c.time_ns).abs() < MATCH_NS).min_by_key(|c| (t.time_ns - c.time_ns).abs());
            let Some(c) = nearest else {
                if std::env::var_os("VERBOSE").is_some() {
                    println!(
                        "  missed {text} ball {} t {:.3} at {:.3?} v {:.2?} edge {}",
                        t.ball,
                        t.time_ns as f64 * 1e-9,
                        t.center,
                        t.velocity_before,
                        t.on_edge
                    );
                }
                continue;
            };
            self.matched += 1;
            let error = Vec3::from(c.center) - pose.to_world(&Vec3::from(t.center_in_camera));
            let covariance = Mat3::from_fn(|i, j| c.covariance[i][j]);
            self.nees.push(covariance.try_inverse().map_or(f64::INFINITY, |i| error.dot(&(i * error)) / 3.0));
            self.center.push(error.norm());
            for (sum, e) in self.center_axis.iter_mut().zip(error.iter()) {
                *sum += e * e;
            }
            self.time.push((c.time_ns - t.time_ns) as f64 * 1e-9);
            if std::env::var_os("VERBOSE").is_some() && error.norm() > 0.004 {
                println!(
                    "  off {text} ball {} t {:.3} by {:.1?} mm {:.2} ms nees {:.1} edge {} surface {:?} {}",
                    t.ball,
                    t.time_ns as f64 * 1e-9,
                    (error * 1e3).as_slice(),
                    (c.time_ns - t.time_ns) as f64 * 1e-6,
                    self.nees.last().unwrap(),
                    t.on_edge,
                    c.surface,
                    t.surface
                );
            }
            let world_from_true = pose.rotation * Pose::from_rows(&truth.world_from_camera).expect("rigid").rotation.transpose();
            let normal = world_from_true * Vec3::from(t.normal);
            if !t.on_edge
                && let Some(n) = c.normal
            {
                self.normal.push(Vec3::from(n).dot(&normal).clamp(-1.0, 1.0).acos().to_degrees());
            }
        }
        let live: Vec<&&Surface> = surfaces.iter().filter(|s| s.merged_into.is_none()).collect();
        self.surfaces.push(live.len());
        for t in &truth.surfaces {
            let normal = pose.rotation * Vec3::from(t.normal_in_camera);
            let offset = t.offset_in_camera + normal.dot(&pose.translation);
            let nearest = live.iter().filter(|s| s.contacts >= 3 && Vec3::from(s.normal).dot(&normal) > 0.9).min_by(|a, b| {
                let miss = |s: &Surface| (s.offset - offset).abs();
                miss(a).total_cmp(&miss(b))
            });
            if let Some(s) = nearest {
                let angle = Vec3::from(s.normal).dot(&normal).clamp(-1.0, 1.0).acos().to_degrees();
                let height = if t.name.contains("top") { Some(0.09) } else { None };
                if let (Some(h), Some(a)) = (height, s.above) {
                    self.height.push(a.height - h);
                    self.height_z.push((a.height - h) / a.sd.unwrap_or(f64::NAN));
                    self.plane.push(angle);
                } else if height.is_none() && t.name.contains("ground") {
                    self.plane.push(angle);
                }
                if std::env::var_os("VERBOSE").is_some() {
                    println!(
                        "  {text} {}: {} contacts, {angle:.2}°, offset {:+.2} mm, above {:?}",
                        t.name,
                        s.contacts,
                        (s.offset - offset) * 1e3,
                        s.above
                    );
                }
            }
        }
        let orientation = events.iter().rev().find_map(|e| if let Kind::CameraOrientation(o) = &e.kind { Some(o) } else { None });
        if let Some(o) = orientation {
            self.gravity.push(Vec3::from(o.gravity_in_camera).angle(&Vec3::from(truth.gravity_in_camera)).to_degrees());
        }
    }

    /// One line.
    pub fn line(&self) -> String {
        let n = self.matched.max(1) as f64;
        let axis = self.center_axis.map(|s| (s / n).sqrt() * 1e3);
        format!(
            "found {}/{} ({:.1} %), false {} ({:.2}/min), center {:.2} mm rms ({:.2} {:.2} {:.2}), time {:.2} ms rms, NEES {:.2}, normal {:.2}°, height {:.2} mm rms (z {:.2}), planes {:.2}° rms, gravity {:.3}° rms, surfaces {:?}, tracks {}, alarms {}",
            self.matched,
            self.countable,
            100.0 * self.matched as f64 / self.countable.max(1) as f64,
            self.wrong,
            self.wrong as f64 / self.minutes,
            rms(&self.center) * 1e3,
            axis[0],
            axis[1],
            axis[2],
            rms(&self.time) * 1e3,
            mean(&self.nees),
            rms(&self.normal),
            rms(&self.height) * 1e3,
            rms(&self.height_z),
            rms(&self.plane),
            rms(&self.gravity),
            self.surfaces,
            self.tracks,
            self.inconsistencies
        )
    }
}

/// Gravity is to be found.
pub fn tilted(mut config: Config) -> Config {
    config.assume.camera = Some(CameraAssumption::Tilted);
    config
}
