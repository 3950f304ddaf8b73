//! A scene from its name: who stands where, what flies, and when the camera looks.

use super::SimError;
use super::parameters::Parameters;
use super::path::{Path, Stage};
use super::rig::{Rig, camera, pose};
use super::rigid::{Rigid, State};
use super::sensor::{Errors, Form, MAX_TARGETS, Place, Sensor, Target, disparity_law};
use super::throws::{Thrower, stage};
use super::truth::{FrameTruth, Truth};
use super::witness::Witness;
use crate::geometry::camera::{Camera, DepthCode, NO_DISPARITY, Pose};
use crate::math::{Mat3, Vec3};
use crate::time::after;
use rand::rngs::Xoshiro256PlusPlus;
use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use std::borrow::ToOwned;
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
    /// Its true camera; `camera.pose`, at the first frame, is always there.
    sight: Camera,
    rig: Rig,
    stage: Stage,
    paths: Vec<Path>,
    things: Vec<Rigid>,
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
    /// Index of the throw, or of the robot or car.
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
        let mut sight = camera(&parameters, parameters.focal_factor, Some(pose));
        let stage = stage(kind, &parameters);
        let mut thrower = Thrower {
            kind,
            parameters: &parameters,
            stage: &stage,
            camera: &sight,
            pose: &pose,
            rng: &mut thrower_rng,
            moves: Vec::new(),
            things: Vec::new(),
        };
        let paths = thrower.throw_all(LEAD)?;
        let (moves, things) = (thrower.moves, thrower.things);
        let start_ticks = clock_rng.random_range(6_000_000_u32..=u32::MAX / 2);
        let start_ns = stamp_ns(start_ticks.into());
        let end = last(&paths, &things) + 0.5;
        let shots: Vec<Shot> = times(&parameters, end, &mut clock_rng)
            .map(|(number, ticks)| Shot { number, ticks: u64::from(start_ticks) + ticks, t: ticks as f64 / TICKS })
            .collect();
        let rig = Rig::new(&pose, moves, shots.first().map_or(0.0, |shot| shot.t));
        sight.pose = Some(rig.pose);
        let witness = Witness { camera: &sight, rig: &rig, stage: &stage, paths: &paths, things: &things, start_ns };
        let frames = shots.iter().map(|shot| witness.frame(stamp_ns(shot.ticks), shot.t)).collect();
        let truth = Truth { frames, ..witness.scene(scene, parameters) };
        Ok(Self { sight, rig, stage, paths, things, start_ns, shots, truth, sensor_seed: seeds.random(), position_seed: seeds.random() })
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

    /// Whether the camera sees nothing but what moves.
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

    /// Positions of all balls, robots and cars at `rate_hz`, in the order of time, each coordinate with independent noise of `sd`, m; whether the camera sees them or not.
    pub fn positions(&self, rate_hz: f64, sd: f64) -> impl Iterator<Item = Position> {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(self.position_seed);
        let end = last(&self.paths, &self.things);
        let times = (0..).map(move |i| f64::from(i) / rate_hz).take_while(move |t| *t < end);
        let balls = move |t: f64| self.paths.iter().map(move |path| Some(path.at(t)?.0));
        let things = move |t: f64| self.things.iter().map(move |thing| Some(thing.at(t)?.position));
        let centers =
            times.flat_map(move |t| balls(t).chain(things(t)).enumerate().filter_map(move |(ball, center)| Some((t, ball, center?))));
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
        let rows: Vec<(f64, Pose)> =
            (0..rows).map(|row| t + readout * row as f64 / (height - 1) as f64).map(|t| (t, scene.rig.at(t))).collect();
        let there = |start: f64, end: f64| start < t + readout + 1e-9 && end > t;
        // What is not there is behind the camera.
        let nowhere = Place { center: -Vec3::z(), axes: Mat3::identity() };
        let balls = scene.paths.iter().filter(|path| there(path.start(), path.end())).map(|path| {
            let place = |(t, pose): &(f64, Pose)| path.at(*t).map_or(nowhere, |(p, _)| Place { center: pose.to_camera(&p), ..nowhere });
            (Form::Sphere { radius: path.ball.radius }, rows.iter().map(place).collect())
        });
        let parts = scene.things.iter().filter(|thing| there(thing.start, thing.end)).flat_map(|thing| {
            let states: Vec<_> = rows.iter().map(|(t, pose)| Some((thing.at(*t)?, pose))).collect();
            thing.parts.iter().map(move |part| {
                let place = |(state, pose): &(State, &Pose)| Place {
                    center: pose.to_camera(&(state.position + state.rotation * part.center)),
                    axes: pose.rotation.transpose() * state.rotation * part.axes,
                };
                (part.form, states.iter().map(|seen| seen.as_ref().map_or(nowhere, place)).collect())
            })
        });
        let present: Vec<(Form, Vec<Place>)> = balls.chain(parts).take(MAX_TARGETS).collect();
        let targets: Vec<Target> = present.iter().map(|(form, places)| Target { form: *form, places }).collect();
        let eyes: Vec<Vec3> = rows.iter().map(|(_, pose)| scene.rig.pose.to_camera(&pose.translation)).collect();
        self.sensor.expose(&targets, &eyes, &mut self.samples);
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

/// When the last of all that moves is gone, s.
fn last(paths: &[Path], things: &[Rigid]) -> f64 {
    paths.iter().map(Path::end).chain(things.iter().map(|t| t.end)).fold(0.0, f64::max)
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
