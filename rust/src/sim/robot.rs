//! A flying robot: it stands, takes off, hovers, flies around and lands.

use super::SimError;
use super::moves::{Move, PEAK, together};
use super::rigid::{Course, Part, Rigid, State, Thing};
use super::throws::Thrower;
use crate::math::{Mat3, Vec3};
use nalgebra::{Rotation3, UnitVector3};
use rand::RngExt;
use std::vec::Vec;

/// Height of its middle where it stands, m.
pub(super) const STANDING: f64 = 0.08;
/// Its greatest acceleration in each motion, m/s²; what it strays from a straight line comes on top, up to 3.
const ACCELERATION: core::ops::Range<f64> = 0.5..2.7;
/// It strays from a straight line by up to this part of the way.
const BOW: f64 = 0.08;
/// All of it lasts so long, s.
const DURATION: core::ops::Range<f64> = 6.0..10.0;

/// Its hull, two crossed arms with a motor at each end, a battery at the back, and below a camera in front and a foot behind.
pub(super) fn parts() -> Vec<Part> {
    let eighth = core::f64::consts::FRAC_PI_4;
    let mut parts = std::vec![
        Part::block([0.07, 0.05, 0.035], [0.0; 3], 0.0),
        Part::block([0.15, 0.015, 0.012], [0.0, 0.0, 0.01], eighth),
        Part::block([0.15, 0.015, 0.012], [0.0, 0.0, 0.01], -eighth),
        Part::block([0.035, 0.03, 0.0225], [-0.03, 0.0, 0.0575], 0.0),
        Part::sphere(0.035, [0.05, 0.0, -0.04]),
        Part::block([0.03, 0.045, 0.0225], [-0.035, 0.0, -0.0575], 0.0),
    ];
    parts.extend([(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)].map(|(x, y)| Part::sphere(0.03, [0.11 * x, 0.11 * y, 0.015])));
    parts
}

/// Its way, in seconds since it appeared.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Flight {
    stand: Vec3,
    heading: f64,
    gravity: f64,
    /// The first is the take-off, the last the landing.
    moves: Vec<Move>,
    /// About the vertical, as rotation vectors, rad.
    turns: Vec<Move>,
}

impl Flight {
    pub(super) fn at(&self, t: f64) -> State {
        let [moved, velocity, acceleration] = together(&self.moves, t);
        let [turned, ..] = together(&self.turns, t);
        // Rotors push along its own z.
        let up = UnitVector3::new_normalize(acceleration + Vec3::z() * self.gravity);
        let tilt = Rotation3::rotation_between(&Vec3::z(), &up).unwrap_or_default();
        let yaw = Rotation3::from_axis_angle(&Vec3::z_axis(), self.heading + turned.z);
        let [begin, end] = [self.moves.first().map(|m| m.start), self.moves.last().map(Move::end)].map(Option::unwrap_or_default);
        State { position: self.stand + moved, velocity, acceleration, rotation: Mat3::from(tilt * yaw), active: (begin..end).contains(&t) }
    }
}

impl Thrower<'_> {
    /// A robot that appears at `time`.
    pub(super) fn robot(&mut self, time: f64) -> Result<Rigid, SimError> {
        let robot = self.try_until(Self::flight)?;
        Ok(Rigid { start: time, end: time + robot.end, ..robot })
    }

    /// All of it in view all the time.
    fn flight(&mut self) -> Option<Rigid> {
        let stand = self.around_middle(0.4, 0.25, STANDING);
        let (heading, mut time) = (self.uniform(0.0, core::f64::consts::TAU), self.uniform(0.8, 1.3));
        let (mut position, mut moves, mut turns) = (stand, Vec::new(), Vec::new());
        let height = self.uniform(0.3, 0.5);
        let mut stops = std::vec![stand + Vec3::z() * height];
        for _ in 0..self.rng.random_range(3..=5) {
            let height = STANDING + self.uniform(0.2, 0.7);
            stops.push(self.around_middle(0.6, 0.4, height));
        }
        stops.extend(stops.last().map(|last| Vec3::new(last.x, last.y, STANDING)));
        let landing = stops.len() - 1;
        for (i, stop) in stops.into_iter().enumerate() {
            let by = stop - position;
            let duration = (PEAK * by.norm() / self.uniform(ACCELERATION.start, ACCELERATION.end)).sqrt();
            // Up and down it goes straight, the rest of the way by a bow, while it turns.
            let level = (1..landing).contains(&i);
            let bow = by.cross(&Vec3::from_fn(|_, _| self.uniform(-1.0, 1.0)).normalize()) * if level { BOW } else { 0.0 };
            moves.push(Move { start: time, duration, by, bow });
            if level {
                let turn = Vec3::z() * self.uniform(-2.5, 2.5);
                turns.push(Move { start: time, duration: duration.max(0.8), by: turn, bow: Vec3::zeros() });
            }
            position = stop;
            // It hovers.
            time += duration + if i == 0 { self.uniform(0.5, 1.0) } else { self.uniform(0.0, 0.5) };
        }
        let end = moves.last()?.end() + self.uniform(0.8, 1.2);
        let flight = Flight { stand, heading, gravity: self.parameters.gravity, moves, turns };
        let robot = Rigid { kind: Thing::Robot, parts: parts(), start: 0.0, end, course: Course::Flight(flight) };
        (DURATION.contains(&end) && self.stays_in_view(&robot)).then_some(robot)
    }
}
