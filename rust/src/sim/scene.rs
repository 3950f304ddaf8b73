//! A scene from its name: who stands where, what flies, and when the camera looks.

use super::SimError;
use super::parameters::{Parameters, Samples};
use super::path::{Path, Stage, Touch};
use super::sensor::{Errors, FOCAL, MAX_BALLS, Sensor, Target, disparity_law};
use super::throws::{Thrower, stage};
use super::truth::{BallTruth, ContactTruth, FrameTruth, RollTruth, SurfaceTruth, Truth};
use crate::geometry::camera::{Camera, DepthCode, NO_DISPARITY, Pose};
use crate::math::{Mat3, Vec3};
use crate::time::after;
use rand::rngs::Xoshiro256PlusPlus;
use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use std::borrow::ToOwned;
use std::string::ToString;
use std::vec::Vec;

/// Time before the first throw, in which a background can be learned, s.
const LEAD: f64 = 0.9;
/// Jitter of the frames, s; stamps tell it.
const JITTER: f64 = 2e-5;
/// Ticks of the device's clock in a second.
const TICKS: f64 = 60e6;

/// A simulated scene.
#[derive(Clone, Debug)]
pub struct Scene {
    /// Its true camera; `camera.pose` is always there.
    sight: Camera,
    stage: Stage,
    paths: Vec<Path>,
    start_ns: i64,
    shots: Vec<Shot>,
    truth: Truth,
    sensor_seed: u64,
    position_seed: u64,
}

/// When a frame is taken.
#[derive(Clone, Copy, Debug)]
struct Shot {
    number: u64,
    /// Not wrapped.
    ticks: u64,
    /// Since the scene began, s.
    t: f64,
}

/// A frame, borrowed from [`Frames`].
#[derive(Clone, Copy, Debug)]
pub struct Frame<'a> {
    /// Stamp of its first row.
    pub timestamp_ns: i64,
    /// The same on the device's clock, modulo 2³².
    pub ticks: u32,
    /// Counts the frames that the device sent, the lost ones too.
    pub number: u64,
    /// Raw samples as the scene's `kind` says, row-major, width · height.
    pub samples: &'a [u16],
    /// What is really there.
    pub truth: &'a FrameTruth,
}

/// A position as some tracker would measure it, world frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Position {
    /// When.
    pub timestamp_ns: i64,
    /// Index of the throw.
    pub ball: usize,
    /// With its noise, m.
    pub center: Vec3,
}

impl Scene {
    /// The scene that `NAME?key=value&…` tells of.
    ///
    /// # Errors
    /// An unknown name or key, a value that can't be, or a geometry in which no throw is in view.
    pub fn parse(scene: &str) -> Result<Self, SimError> {
        let (kind, parameters) = Parameters::parse(scene)?;
        let mut seeds = Xoshiro256PlusPlus::seed_from_u64(parameters.seed);
        let (mut thrower_rng, mut clock_rng) =
            (Xoshiro256PlusPlus::seed_from_u64(seeds.random()), Xoshiro256PlusPlus::seed_from_u64(seeds.random()));
        let pose = pose(&parameters);
        let sight = camera(&parameters, parameters.focal_factor, Some(pose));
        let stage = stage(kind, &parameters);
        let paths =
            Thrower { kind, parameters: &parameters, stage: &stage, camera: &sight, pose: &pose, rng: &mut thrower_rng }.throw_all(LEAD)?;
        let start_ticks = clock_rng.random_range(6_000_000_u32..=u32::MAX / 2);
        let start_ns = stamp_ns(start_ticks.into());
        let end = paths.iter().map(Path::end).fold(0.0, f64::max) + 0.5;
        let mut truth = truth(scene, parameters, &pose, &stage, &paths, start_ns);
        let shots: Vec<Shot> = times(&truth.parameters, end, &mut clock_rng)
            .map(|(number, ticks)| Shot { number, ticks: u64::from(start_ticks) + ticks, t: ticks as f64 / TICKS })
            .collect();
        truth.frames = shots.iter().map(|shot| frame_truth(&sight, &pose, &paths, start_ns, shot)).collect();
        Ok(Self { sight, stage, paths, start_ns, shots, truth, sensor_seed: seeds.random(), position_seed: seeds.random() })
    }

    /// The same, with packets: a Kinect's disparity at its rate.
    ///
    /// # Errors
    /// As of [`Scene::parse`]; and keys that no Kinect's packets can have.
    pub fn parse_for_packets(scene: &str) -> Result<Self, SimError> {
        let joint = if scene.contains('?') { '&' } else { '?' };
        let told = scene.contains("packets=");
        Self::parse(&if told { scene.to_owned() } else { std::format!("{scene}{joint}packets=1") })
    }

    /// The camera as an estimator is told of it: without pose where `pose` is 0, without `focal_factor`.
    pub fn camera(&self) -> Camera {
        let parameters = &self.truth.parameters;
        camera(parameters, 1.0, self.sight.pose.filter(|_| parameters.pose))
    }

    /// Whether the camera sees nothing but balls.
    pub fn is_blank(&self) -> bool {
        self.stage.solids.iter().all(|s| !s.visible)
    }

    /// What really happens.
    pub fn truth(&self) -> &Truth {
        &self.truth
    }

    /// The frames, from the first.
    pub fn frames(&self) -> Frames {
        let p = &self.truth.parameters;
        let errors = Errors { sigma: p.sigma, window: p.window as usize, white: p.white };
        let sensor = Sensor::new(self.sight, errors, &self.stage.solids, self.sensor_seed);
        Frames { scene: self.clone(), sensor, samples: std::vec![0; self.sight.width * self.sight.height], next: 0, passed: (0, 0) }
    }

    /// Positions of all balls at `rate_hz`, in the order of time, each coordinate with independent noise of `sd`, m; whether the camera sees them or not.
    pub fn positions(&self, rate_hz: f64, sd: f64) -> impl Iterator<Item = Position> {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(self.position_seed);
        let end = self.paths.iter().map(Path::end).fold(0.0, f64::max);
        let times = (0..).map(move |i| f64::from(i) / rate_hz).take_while(move |t| *t < end);
        let centers = times.flat_map(|t| self.paths.iter().enumerate().filter_map(move |(ball, path)| Some((t, ball, path.at(t)?.0))));
        centers.map(move |(t, ball, center)| {
            let noise = Vec3::from_fn(|_, _| StandardNormal.sample(&mut rng));
            Position { timestamp_ns: after(self.start_ns, t), ball, center: center + noise * sd }
        })
    }
}

/// Renders a scene frame by frame into one buffer.
#[derive(Clone, Debug)]
pub struct Frames {
    scene: Scene,
    sensor: Sensor,
    samples: Vec<u16>,
    next: usize,
    /// Number and ticks that are added, since the scene has begun again.
    passed: (u64, u64),
}

impl Frames {
    /// The next frame, until the scene ends.
    pub fn next_frame(&mut self) -> Option<Frame<'_>> {
        let scene = &self.scene;
        let truth = scene.truth.frames.get(self.next)?;
        let Shot { number, ticks, t } = scene.shots[self.next];
        self.next += 1;
        let (readout, height) = (scene.sight.readout, scene.sight.height);
        let rows = if readout > 0.0 { height } else { 1 };
        let present: Vec<(Vec<Vec3>, f64)> = (scene.paths.iter())
            .filter(|path| path.start() < t + readout + 1e-9 && path.end() > t)
            .take(MAX_BALLS)
            .map(|path| {
                (
                    (0..rows).map(|row| center_in_camera(&scene.sight, path, t + readout * row as f64 / (height - 1) as f64)).collect(),
                    path.ball.radius,
                )
            })
            .collect();
        let targets: Vec<Target> = present.iter().map(|(centers, radius)| Target { centers, radius: *radius }).collect();
        self.sensor.expose(&targets, &mut self.samples);
        if let DepthCode::Depth { units_per_metre } = scene.sight.code {
            let [c0, c1] = disparity_law();
            for sample in &mut self.samples {
                *sample = if *sample == NO_DISPARITY { 0 } else { (units_per_metre / (c0 + c1 * f64::from(*sample))).round() as u16 };
            }
        }
        let (number, ticks) = (number + self.passed.0, ticks + self.passed.1);
        Some(Frame { timestamp_ns: stamp_ns(ticks), ticks: ticks as u32, number, samples: &self.samples, truth })
    }

    /// After the last frame, begins with the first again; number and time go on.
    pub fn begin_again_at_end(&mut self) {
        let [first, .., last] = &self.scene.shots[..] else { return };
        if self.next == self.scene.shots.len() {
            self.next = 0;
            self.passed.0 += last.number + 1;
            self.passed.1 += last.ticks - first.ticks + (TICKS / self.scene.truth.parameters.fps) as u64;
        }
    }

    /// How many frames there are in all.
    pub fn count(&self) -> usize {
        self.scene.truth.frames.len()
    }
}

fn center_in_camera(camera: &Camera, path: &Path, t: f64) -> Vec3 {
    let pose = camera.pose.unwrap_or_else(Pose::renamed_axes);
    // A ball that is not there is behind the camera.
    path.at(t).map_or(-Vec3::z(), |(p, _)| pose.to_camera(&p))
}

/// Turned by the tilt around a point at the lens's height, `distance` before it, so that the scene stays in view.
fn pose(p: &Parameters) -> Pose {
    let (sin, cos) = p.tilt_deg.to_radians().sin_cos();
    let forward = Vec3::new(0.0, cos, -sin);
    let down = Vec3::new(0.0, -sin, -cos);
    let level = Mat3::from_columns(&[Vec3::x(), down, forward]);
    let turn = *nalgebra::Rotation3::from_axis_angle(&Vec3::z_axis(), p.roll_deg.to_radians()).matrix();
    Pose { rotation: level * turn, translation: Vec3::new(0.0, p.distance, p.height) - forward * p.distance }
}

fn camera(p: &Parameters, focal_factor: f64, pose: Option<Pose>) -> Camera {
    let code = match p.kind {
        Samples::Disparity => DepthCode::Disparity { law: disparity_law() },
        Samples::Depth => DepthCode::Depth { units_per_metre: 1000.0 },
    };
    let focal = FOCAL * focal_factor;
    Camera {
        width: 640,
        height: 480,
        fx: focal,
        fy: focal,
        cx: 319.5,
        cy: 239.5,
        code,
        max_depth: 10.0,
        readout: p.readout,
        pose,
        gravity: None,
    }
}

/// The stamp of unwrapped ticks, ns.
fn stamp_ns(ticks: u64) -> i64 {
    ((ticks * 100 + 3) / 6) as i64
}

/// The frames that are not lost: their number, and when they begin, ticks.
fn times(p: &Parameters, end: f64, rng: &mut Xoshiro256PlusPlus) -> impl Iterator<Item = (u64, u64)> {
    (0..(end * p.fps) as u64).filter_map(move |i| {
        let (jitter, lost): (f64, f64) = (StandardNormal.sample(rng), rng.random());
        let ticks = (((i + 1) as f64 / p.fps + JITTER * jitter) * TICKS).round();
        (lost >= p.loss).then_some((i, ticks as u64))
    })
}

fn frame_truth(camera: &Camera, pose: &Pose, paths: &[Path], start_ns: i64, shot: &Shot) -> FrameTruth {
    // The row that shows a ball depends on when it is seen, and the other way round: three rounds settle it.
    let seen = paths.iter().enumerate().filter_map(|(ball, path)| {
        let mut time = shot.t;
        for _ in 0..3 {
            let (_, row) = camera.project(&pose.to_camera(&path.at(time)?.0))?;
            time = shot.t + camera.readout * row.clamp(0.0, camera.height as f64 - 1.0) / (camera.height - 1) as f64;
        }
        let (center, velocity) = path.at(time)?;
        Some((ball, time, center, velocity, pose.to_camera(&center), path.ball.radius))
    });
    let seen: Vec<_> = seen.collect();
    let balls = seen.iter().map(|&(ball, time, center, velocity, c, radius)| {
        let others: Vec<(Vec3, f64)> = seen.iter().filter(|o| o.0 != ball && o.4.z < c.z).map(|o| (o.4, o.5)).collect();
        BallTruth {
            ball,
            time_ns: after(start_ns, time),
            center: center.into(),
            center_in_camera: c.into(),
            velocity: velocity.into(),
            in_view: in_view(camera, &c, radius, &others),
        }
    });
    FrameTruth { timestamp_ns: stamp_ns(shot.ticks), balls: balls.filter(|b| b.in_view > 0.0).collect() }
}

/// Part of a ball's disc that is inside the image and behind none of the nearer balls `others`.
fn in_view(camera: &Camera, center: &Vec3, radius: f64, others: &[(Vec3, f64)]) -> f64 {
    const POINTS: u32 = 200;
    let Some((x, y)) = camera.project(center) else { return 0.0 };
    let disc = camera.fx * radius / center.z;
    // Vogel's spiral: even over the disc.
    let points = (0..POINTS).map(|i| {
        let (r, angle) = (disc * ((f64::from(i) + 0.5) / f64::from(POINTS)).sqrt(), f64::from(i) * 2.399_963_229_728_653);
        (x + r * angle.cos(), y + r * angle.sin())
    });
    let inside = |u: f64, v: f64| u > -0.5 && v > -0.5 && u < camera.width as f64 - 0.5 && v < camera.height as f64 - 0.5;
    let hidden = |u: f64, v: f64| {
        let ray = camera.deproject(u, v, 1.0).normalize();
        others.iter().any(|(c, r)| c.cross(&ray).norm() < *r)
    };
    points.filter(|&(u, v)| inside(u, v) && !hidden(u, v)).count() as f64 / f64::from(POINTS)
}

/// All but the frames.
fn truth(scene: &str, parameters: Parameters, pose: &Pose, stage: &Stage, paths: &[Path], start_ns: i64) -> Truth {
    let faces = stage.solids.iter().flat_map(|s| (0..s.faces()).map(|f| s.face(f)));
    let surfaces = faces.filter(|(name, ..)| *name != "box bottom").map(|(name, normal, offset)| SurfaceTruth {
        name: name.to_string(),
        normal: normal.into(),
        offset,
        normal_in_camera: (pose.rotation.transpose() * normal).into(),
        offset_in_camera: offset - normal.dot(&pose.translation),
    });
    let contact = |ball: usize, radius: f64, t: &Touch| ContactTruth {
        ball,
        time_ns: after(start_ns, t.time),
        center: t.center.into(),
        center_in_camera: pose.to_camera(&t.center).into(),
        point: (t.center - t.normal * radius).into(),
        normal: t.normal.into(),
        velocity_before: t.before.into(),
        velocity_after: t.after.into(),
        restitution: t.restitution,
        surface: t.face.map_or(stage.solids[t.solid].name, |f| stage.solids[t.solid].face(f).0).to_owned(),
        on_edge: t.face.is_none(),
    };
    let balls = || paths.iter().enumerate();
    let mut contacts: Vec<ContactTruth> =
        balls().flat_map(|(i, path)| path.touches.iter().map(move |t| contact(i, path.ball.radius, t))).collect();
    contacts.sort_by_key(|c| c.time_ns);
    let rolling = balls().filter_map(|(ball, path)| {
        path.rolling.map(|(t, solid)| RollTruth { ball, time_ns: after(start_ns, t), surface: stage.solids[solid].name.to_owned() })
    });
    Truth {
        scene: scene.to_owned(),
        parameters,
        world_from_camera: pose.to_rows(),
        gravity_in_camera: (pose.rotation.transpose() * stage.gravity).into(),
        surfaces: surfaces.collect(),
        contacts,
        rolling: rolling.collect(),
        frames: Vec::new(),
    }
}
