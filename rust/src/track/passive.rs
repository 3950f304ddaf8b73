//! What may move an object that has no motor: gravity and the air, or a surface that carries it, along which it rests, rolls or slides.

use crate::config::{Config, LawName, SceneAssumption, Shape};
use crate::math::{Mat3, Vec3, sqrt};
use crate::physics::Sample;
use crate::physics::flight::Flight;
use crate::physics::gravity::Gravity;
use crate::physics::law::FreeFall;
use crate::physics::onset::{LONGEST, Onset, Side, onset};
use crate::track::hypothesis::Surroundings;
use crate::track::noise::SLOWLY;
use heapless::Vec;

/// A drag coefficient is known to this part: tennis balls were measured at 0.507 ± 0.024 and at 0.55.
const DRAG_SD: f64 = 0.1;
/// Lift across the way that spin may cause, as part of drag (standard deviation): a tennis ball's coefficient, 1 / (2.022 + 0.981 v / ω R), nears
/// that of its drag, on either side, the faster it spins.
const SPIN_SD: f64 = 0.5;
/// How far up may be off, rad (standard deviation): somebody levelled the axes.
const LEVEL_SD: f64 = 0.5_f64.to_radians();
/// Friction reaches μ g, with μ of rubber on a dry floor.
pub const FRICTION: f64 = 1.0;
/// Deceleration of what rolls or slides, m/s² (standard deviation).
const DECELERATION_SD: f64 = 2.0;
/// A ball this far above a known surface may be carried by it, in hops that frames don't resolve, m.
const HOP: f64 = 0.03;
/// An object of any shape is carried if its reference point is within so many radii (half extents) of a known surface.
const EXTENT: f64 = 3.0;
/// A surface carries what moves along it, but for this, m/s.
const ALONG: f64 = 0.03;
/// Surfaces carry if their normal's upward part exceeds this.
const LEVEL: f64 = 0.3;
/// Acceleration that counts as none, m/s² (standard deviation): of a law that is exact.
const EXACT: f64 = 1e-4;
/// A hidden surface explains impulses larger than this alone, m/s, as a contact found in flight does.
const SMALLEST_IMPULSE: f64 = 0.4;

/// Where and how an object lives.
#[derive(Clone, Copy)]
pub struct Circumstances<'a> {
    /// The law of objects in the air, and gravity.
    pub around: &'a Surroundings<'a>,
    /// Which law objects obey.
    pub law: LawName,
    /// Distance (m) and unit normal of the nearest known surface.
    pub nearest: &'a dyn Fn(&Vec3) -> Option<(f64, Vec3)>,
    /// There are no other surfaces,
    pub closed: bool,
    /// but where this holds of the space within a distance (m) of a place.
    pub open: &'a dyn Fn(&Vec3, f64) -> bool,
    /// Radius of the ball, or half the extent of an object of any shape, m.
    pub radius: f64,
    /// It may be of any shape, its reference point anywhere within.
    pub any_shape: bool,
    /// Where positions come without covariance: standard deviations of what changes from one to the next and of what does so slowly, m.
    pub untold: Option<(f64, f64)>,
}

/// A kind of passive motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// It falls, through air.
    Falling,
    /// A surface carries it.
    Carried,
}

/// All kinds.
pub const MODES: [Mode; 2] = [Mode::Falling, Mode::Carried];

/// Samples under a law.
#[derive(Clone, Debug)]
pub struct Explanation {
    /// By which kind of motion.
    pub mode: Mode,
    /// The fit; its "gravity" is the acceleration that the law leaves open.
    pub flight: Flight,
    /// What speaks against it.
    pub onset: Onset,
    /// It rests on a surface of which nothing is known.
    pub hidden: bool,
}

impl<'a> Circumstances<'a> {
    /// As configured, for an object of `radius` (m).
    pub fn new(
        config: &Config,
        around: &'a Surroundings<'a>,
        nearest: &'a dyn Fn(&Vec3) -> Option<(f64, Vec3)>,
        open: &'a dyn Fn(&Vec3, f64) -> bool,
        radius: f64,
        untold: Option<(f64, f64)>,
    ) -> Self {
        let (closed, any_shape) = (config.assume.scene == SceneAssumption::Known, config.object.shape == Shape::Any);
        Self { around, law: config.laws.law, nearest, closed, open, radius, any_shape, untold }
    }

    /// The samples as a motion of this kind, whether or not they agree; `None` where it isn't possible there, or can't be told.
    pub fn explain(&self, mode: Mode, samples: &[Sample], side: Side) -> Option<Explanation> {
        let samples = samples.get(samples.len().saturating_sub(LONGEST)..).filter(|s| s.len() >= 3)?;
        let weighed = self.weighed(samples);
        let samples = weighed.as_slice();
        match mode {
            Mode::Falling if self.law == LawName::ConstantVelocity => None,
            Mode::Falling => {
                let flight = Flight::fit(self.around.law, samples, &self.fall(samples))?;
                let onset = onset(&flight, self.around.law, samples, side)?;
                Some(Explanation { mode, flight, onset, hidden: false })
            }
            Mode::Carried => self.carried(samples, side),
        }
    }

    /// Standard deviation of samples, m an axis, as if their errors had nothing to do with each other.
    pub fn sd(&self, samples: &[Sample]) -> f64 {
        let (Some((white, slow)), [first, .., last]) = (self.untold, samples) else {
            return samples.last().map_or(f64::INFINITY, |s| sqrt(3.0 / s.weight.trace()));
        };
        let rate = (samples.len() - 1) as f64 / (last.t - first.t);
        sqrt(white * white + slow * slow * (SLOWLY * rate).max(1.0))
    }

    fn weighed(&self, samples: &[Sample]) -> Vec<Sample, LONGEST> {
        let sd = self.sd(samples);
        let weight = |s: &Sample| if self.untold.is_some() { Mat3::from_diagonal_element(1.0 / (sd * sd)) } else { s.weight };
        samples.iter().map(|s| Sample { weight: weight(s), ..*s }).collect()
    }

    /// Gravity as it is known, with what no covariance of a position tells: axes that lean, drag that is off, spin.
    fn fall(&self, samples: &[Sample]) -> Gravity {
        let (mean, covariance) = self.around.gravity.estimate();
        let (velocity, at) = mean_velocity(samples);
        let ahead = velocity.try_normalize(1e-9).unwrap_or_else(Vec3::zeros);
        let drag = self.around.law.acceleration(&Vec3::zeros(), at.t, &at.position, &velocity).dot(&ahead);
        let [leaning, slowed, curved] = [LEVEL_SD * mean.norm(), DRAG_SD * drag, SPIN_SD * drag].map(|sd| sd * sd);
        let spread = covariance + Mat3::from_diagonal_element(leaning + curved) + ahead * ahead.transpose() * (slowed - curved);
        Gravity { mean, information: spread.try_inverse().unwrap_or_else(Mat3::zeros), size: None }
    }

    fn carried(&self, samples: &[Sample], side: Side) -> Option<Explanation> {
        let (first, last) = (samples.first()?, samples.last()?);
        let up = -self.around.gravity.mean.try_normalize(1e-9)?;
        let known = self.support(&last.position, &up).filter(|_| self.support(&first.position, &up).is_some());
        let somewhere = self.law == LawName::ConstantVelocity && (self.nearest)(&last.position).is_none();
        if known.is_none() && !somewhere && self.is_closed(&last.position) {
            return None;
        }
        let normal = known.unwrap_or(up);
        // Hops off a known surface are passive, so only what it does along it counts. Of a shape it is not known how far its reference point is off.
        let hops = known.is_some() && !self.any_shape;
        let loose: Vec<Sample, LONGEST> = if hops { samples.iter().map(|s| without(s, &normal)).collect() } else { Vec::new() };
        let samples = if hops { loose.as_slice() } else { samples };
        let slope = up - normal * up.dot(&normal);
        let downhill = slope * slope.transpose() * self.around.gravity.mean.norm_squared();
        let exact = Mat3::from_diagonal_element(EXACT * EXACT) + downhill;
        let steady = fit(samples, &exact)?;
        let leaves = steady.state.velocity.dot(&normal).abs();
        let tilt = sqrt(self.around.gravity.spread() / self.around.gravity.mean.norm_squared());
        let bound =
            ALONG + 4.0 * sqrt(steady.covariance.fixed_view::<3, 3>(3, 3).trace() / 3.0) + 4.0 * tilt * steady.state.velocity.norm();
        if !hops && leaves > bound {
            return None;
        }
        let rubbed = (known.is_some() || self.law == LawName::Auto).then(|| self.rubbed(samples, &normal, &exact)).flatten();
        let flight = rubbed.unwrap_or(steady);
        let onset = onset(&flight, &FreeFall, samples, side)?;
        Some(Explanation { mode: Mode::Carried, flight, onset, hidden: known.is_none() && self.law != LawName::ConstantVelocity })
    }

    /// When what no passive motion explains any more ceased to be carried.
    pub fn lifted(&self, samples: &[Sample]) -> Option<Onset> {
        let exact = Mat3::from_diagonal_element(EXACT * EXACT);
        onset(&fit(samples, &exact)?, &FreeFall, samples, Side::After)
    }

    /// Slowed down by friction, and by no more than it can.
    fn rubbed(&self, samples: &[Sample], normal: &Vec3, exact: &Mat3) -> Option<Flight> {
        let (velocity, _) = mean_velocity(samples);
        let along = (velocity - normal * velocity.dot(normal)).try_normalize(ALONG)?;
        let flight = fit(samples, &(exact + along * along.transpose() * (DECELERATION_SD * DECELERATION_SD)))?;
        let gained = flight.gravity.dot(&along);
        let reach = FRICTION * self.around.gravity.mean.norm();
        (gained < 2.0 * flight.gravity_sd() && -gained < reach).then_some(flight)
    }

    /// Normal of the known surface that carries what is at `place`.
    pub fn support(&self, place: &Vec3, up: &Vec3) -> Option<Vec3> {
        let (distance, normal) = (self.nearest)(place)?;
        (distance < self.reach() && normal.dot(up) > LEVEL).then_some(normal)
    }

    /// A surface that it touches is no farther away than this, m.
    fn reach(&self) -> f64 {
        if self.any_shape { EXTENT * self.radius } else { self.radius + HOP }
    }

    /// Whether nothing but known surfaces can touch what is at `place`.
    fn is_closed(&self, place: &Vec3) -> bool {
        self.closed && !(self.open)(place, self.reach())
    }

    /// Whether something may have touched the object at `place` and changed its velocity so, and whether that is a surface of which nothing is known.
    pub fn may_touch(&self, place: &Vec3, before: &Vec3, after: &Vec3) -> Option<bool> {
        let impulse = after - before;
        // In a corner what pushed it is that of the surfaces which lies against the impulse.
        let back = impulse.try_normalize(1e-9).unwrap_or_else(Vec3::zeros) * (0.5 * self.radius);
        let in_reach = (self.nearest)(&(place - back)).filter(|(distance, normal)| distance + normal.dot(&back) < self.reach());
        // Within the cone of friction about the normal, and no faster away than into it.
        let pushed = |n: &Vec3| {
            let along = impulse.dot(n);
            along * sqrt(1.0 + FRICTION * FRICTION) > impulse.norm() && after.dot(n) < 1.05 * before.dot(n).abs() + 0.1
        };
        if in_reach.is_some_and(|(_, normal)| pushed(&normal)) {
            return Some(false);
        }
        let slower = impulse.dot(before) < 0.0 && after.norm() < 1.05 * before.norm() + 0.2;
        (impulse.norm() > SMALLEST_IMPULSE && slower && !self.is_closed(place)).then_some(true)
    }
}

/// A motion with no acceleration but one of this covariance ((m/s²)²) that stays the same.
fn fit(samples: &[Sample], spread: &Mat3) -> Option<Flight> {
    Flight::fit(&FreeFall, samples, &Gravity { mean: Vec3::zeros(), information: spread.try_inverse()?, size: None })
}

/// Velocity from the first to the last of samples, and the one in the middle.
fn mean_velocity(samples: &[Sample]) -> (Vec3, Sample) {
    let middle = samples.get(samples.len() / 2).copied().unwrap_or_else(|| Sample::isotropic(0.0, Vec3::zeros(), 1.0));
    let velocity = samples.first().zip(samples.last()).filter(|(a, b)| b.t > a.t).map(|(a, b)| (b.position - a.position) / (b.t - a.t));
    (velocity.unwrap_or_else(Vec3::zeros), middle)
}

/// A sample of which nothing is told along `normal` but a metre.
fn without(sample: &Sample, normal: &Vec3) -> Sample {
    let pull = sample.weight * normal;
    let weight = sample.weight - pull * pull.transpose() / (normal.dot(&pull) + 1.0);
    Sample { weight: crate::math::symmetric(&weight), ..*sample }
}
