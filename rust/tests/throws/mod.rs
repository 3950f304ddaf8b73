//! Simulated throws as positions, passive or with an acceleration of their own from some frame on, and what the engine says of them.
#![allow(dead_code)] // Each test and bench uses what it needs.

use physinc::config::{Config, Method, ObjectsAssumption};
use physinc::engine::Engine;
use physinc::event::{Activity, Event, Kind};
use physinc::math::{Mat3, Vec3};
use physinc::physics::Sample;
use physinc::track::Measurement;
use rand::rngs::Xoshiro256PlusPlus;
use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};

/// Of a ball's center at 1.5 m: across, in depth, up (ACCURACY's table), m.
pub const SD: [f64; 3] = [0.80e-3, 1.03e-3, 0.80e-3];
/// ½ ρ `C_d` A / m of the default ball, 1/m.
const DRAG: f64 = 0.5 * 1.2 * 0.53 * std::f64::consts::PI * 0.033 * 0.033 / 0.057;
const FRAME: f64 = 1.0 / 30.0;

/// A throw from about 1.5 m before a camera.
pub struct Throw {
    seed: u64,
    position: Vec3,
    velocity: Vec3,
    /// Direction of its own acceleration.
    direction: Vec3,
    /// Frame after which that begins.
    pub onset: u32,
    /// m/s².
    pub gravity: Vec3,
    /// 1/m.
    pub drag: f64,
}

impl Throw {
    pub fn new(seed: u64) -> Self {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
        let mut uniform = |low: f64, high: f64| random.random_range(low..high);
        let position = Vec3::new(uniform(-0.4, 0.4), 1.5, uniform(0.5, 1.0));
        let velocity = Vec3::new(uniform(-1.5, 1.5), uniform(-0.5, 0.5), uniform(1.5, 4.0));
        let direction = Vec3::from_fn(|_, _| StandardNormal.sample(&mut random)).normalize();
        let gravity = Vec3::new(0.0, 0.0, -9.81);
        Self { seed, position, velocity, direction, onset: 6 + (seed % 4) as u32, gravity, drag: DRAG }
    }

    /// `count` measured frames; with an acceleration (m/s²) of its own after the frame `onset`. Integrated in steps of a hundredth of a frame.
    pub fn samples(&self, count: usize, own: Option<f64>) -> Vec<Sample> {
        const STEPS: u32 = 100;
        let mut random = Xoshiro256PlusPlus::seed_from_u64(self.seed ^ 0x5eed_0000_0000);
        let (mut p, mut v) = (self.position, self.velocity);
        let weight = Mat3::from_diagonal(&Vec3::from(SD).map(|sd| 1.0 / (sd * sd)));
        (0..count as u32)
            .map(|i| {
                let noise = Vec3::from_fn(|axis, _| {
                    let n: f64 = StandardNormal.sample(&mut random);
                    SD[axis] * n
                });
                let sample = Sample { t: f64::from(i) * FRAME, position: p + noise, weight, half_span: 0.0 };
                let h = FRAME / f64::from(STEPS);
                for _ in 0..STEPS {
                    let extra = own.filter(|_| i >= self.onset).map_or_else(Vec3::zeros, |a| self.direction * a);
                    let force = |v: &Vec3| self.gravity - v * (self.drag * v.norm()) + extra;
                    let middle = v + force(&v) * (0.5 * h);
                    p += middle * h;
                    v += force(&middle) * h;
                }
                sample
            })
            .collect()
    }
}

/// A measurement by another tracker at `t` (s).
pub fn measurement(t: f64, center: Vec3, covariance: Option<Mat3>) -> Measurement {
    Measurement {
        time_ns: (t * 1e9).round() as i64,
        center,
        covariance,
        drift: Mat3::zeros(),
        center_in_camera: None,
        label: None,
        radius: 0.033,
        points: None,
        residual_rms: None,
        whole: true,
    }
}

/// What a stream of one position an instant tells.
pub fn events(config: &Config, positions: &[Measurement]) -> Vec<Event> {
    let mut engine = Engine::for_positions(config).expect("valid");
    let mut events = Vec::new();
    for m in positions {
        engine.positions(m.time_ns, &[*m], &mut |e| events.push(e));
    }
    engine.finish(&mut |e| events.push(e));
    events
}

/// Final activities, in order.
pub fn activities(events: &[Event]) -> Vec<Activity> {
    let finals = events.iter().filter(|e| e.is_final);
    finals.filter_map(|e| if let Kind::Activity(a) = &e.kind { Some(a.clone()) } else { None }).collect()
}

/// Number of the frame in which the engine said first that the object is active; at its end counts as one frame later.
pub fn first_active(throw: &Throw, count: usize, own: Option<f64>, method: Method) -> Option<f64> {
    let mut config = Config::default();
    config.assume.objects = ObjectsAssumption::Unknown;
    config.laws.method = method;
    let positions: Vec<Measurement> =
        throw.samples(count, own).iter().map(|s| measurement(s.t, s.position, Some(s.covariance()))).collect();
    let events = events(&config, &positions);
    let told = events.iter().find(|e| matches!(&e.kind, Kind::Activity(a) if a.active))?;
    Some((told.timestamp_ns as f64 * 1e-9 / FRAME).round())
}
