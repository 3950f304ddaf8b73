//! One tracked object: its recent past, its motion, and when it was seen last.

use crate::config::{LawsConfig, Method};
use crate::math::{Mat3, Vec3};
use crate::physics::course::Course;
use crate::physics::flight::{Flight, Prediction, VELOCITY_SD};
use crate::physics::inconsistency::WhitenedTest;
use crate::physics::law::{FreeFall, Law, State};
use crate::physics::own::Tabulated;
use crate::physics::{Sample, between};
use crate::time::{after, seconds_between};
use crate::track::Measurement;
use crate::track::activity::Activity;
use crate::track::drift::Drift;
use crate::track::hypothesis::Surroundings;
use crate::track::motion::{Findings, Motion};
use crate::track::noise::Noise;
use crate::track::paper::PaperMotion;
use crate::track::window::Window;
use heapless::Vec;

/// The method that watches a track's motion.
#[derive(Clone, Debug)]
#[allow(clippy::large_enum_variant)] // No heap to put the larger one on.
pub enum Watch {
    /// Whitened tests and joint fits.
    Best(Motion),
    /// The paper's θ and parabolas; predictions for association are ours.
    Paper(PaperMotion),
    /// Before a camera that moves.
    Drift(Drift),
}

impl Watch {
    /// How a new track is watched: by `laws`, before a camera that stands or `moves`; it may be carried where it begins (`lies`).
    pub fn new(laws: &LawsConfig, moves: bool, lies: bool) -> Self {
        match laws.method {
            _ if moves => Self::Drift(Drift::new(0.0)),
            Method::Best => Self::Best(Motion::new(0.0, laws.false_alarm, lies)),
            Method::Paper => Self::Paper(PaperMotion::new(0.0, laws.theta)),
        }
    }
}

/// An object that frame after frame did not show for so long, s, was not hidden by lost frames: it is not found again elsewhere.
const MISSED: f64 = 0.07;

/// A measurement this far (squared, whitened) from where the law puts it may still be there: one in 100 of χ² with 3 degrees of freedom.
const AGREES: f64 = 11.3;

/// Blobs that are remembered.
pub const HINTS: usize = 3;

/// Variance along one axis of a blob's center that can't be measured, m²: 0.6 radii.
pub fn blur(radius: f64) -> f64 {
    0.36 * radius * radius
}

/// A tracked object.
#[derive(Clone, Debug)]
pub struct Track {
    /// Counted from 1, never reused.
    pub id: u32,
    /// The number by which another tracker knows it.
    pub label: Option<u32>,
    /// Its time zero, ns.
    pub epoch_ns: i64,
    /// Radius of the ball, m.
    pub radius: f64,
    /// Newest measurement, s.
    pub last: f64,
    /// Newest sign of it, a measurement or a blob where it should be, s.
    pub sign: f64,
    /// First of the frames since then that should have shown it and didn't, s.
    pub missing: Option<f64>,
    /// Id of its newest contact.
    pub contact: u32,
    /// Blobs since the newest measurement, which were its but could not be measured.
    hints: Vec<Sample, HINTS>,
    window: Window,
    watch: Watch,
    /// Of an object that may have a motor.
    pub activity: Option<Activity>,
    /// Its positions come without covariance.
    pub untold: bool,
    /// What the user's own law answered along its way, if there is one.
    pub own: Option<Tabulated>,
}

impl Track {
    /// Begins with its first measurement, which is still to be pushed.
    pub fn new(id: u32, first: &Measurement, watch: Watch) -> Self {
        let (label, epoch_ns, radius) = (first.label, first.time_ns, first.radius);
        Self {
            id,
            label,
            epoch_ns,
            radius,
            last: 0.0,
            sign: 0.0,
            missing: None,
            contact: 0,
            hints: Vec::new(),
            window: Window::default(),
            watch,
            activity: None,
            untold: false,
            own: None,
        }
    }

    /// Seconds since the track's time zero.
    pub fn seconds(&self, time_ns: i64) -> f64 {
        seconds_between(self.epoch_ns, time_ns)
    }

    /// The stamp at `t` seconds since the track's time zero.
    pub fn stamp(&self, t: f64) -> i64 {
        after(self.epoch_ns, t)
    }

    /// The recent past.
    pub fn samples(&self) -> &[Sample] {
        self.window.samples()
    }

    /// Whether it is active, if that is asked, and the recent past.
    pub fn activity(&mut self) -> Option<(&mut Activity, &[Sample])> {
        let Self { activity, window, .. } = self;
        activity.as_mut().map(|activity| (activity, window.samples()))
    }

    /// Takes in a measurement. Where it comes without covariance, `noise` learns from it and tells how good it is.
    pub fn push(&mut self, measured: &Measurement, noise: &mut Noise, around: &Surroundings, findings: &mut Findings) {
        let t = self.seconds(measured.time_ns);
        (self.last, self.sign, self.missing) = (t, t, None);
        self.hints.clear();
        let weight = measured.covariance.and_then(Mat3::try_inverse);
        let known = weight.unwrap_or_else(|| Mat3::from_diagonal_element(1.0 / (noise.sd() * noise.sd())));
        self.untold = weight.is_none();
        if weight.is_none() {
            self.window.reweigh(noise.sd());
        }
        for mut sample in self.window.gather(t, measured.center, known) {
            if weight.is_none() {
                sample.weight = Mat3::from_diagonal_element(1.0 / (noise.sd() * noise.sd()));
            }
            self.push_sample(sample, around, findings);
            if weight.is_none() {
                noise.observe(self.window.samples());
            }
        }
    }

    /// Takes in a blob that is its, but can't be measured.
    pub fn hint(&mut self, blob: &Measurement) {
        let t = self.seconds(blob.time_ns);
        if self.hints.is_full() {
            self.hints.remove(0);
        }
        let weight = Mat3::from_diagonal_element(1.0 / blur(self.radius));
        // There is room: the line above made it.
        let _ = self.hints.push(Sample { t, position: blob.center, weight, half_span: 0.0 });
    }

    /// Blobs since the newest measurement.
    pub fn hints(&self) -> &[Sample] {
        &self.hints
    }

    /// Takes in a sample of another track, which turned out to be of this one.
    pub fn push_sample(&mut self, sample: Sample, around: &Surroundings, findings: &mut Findings) {
        match &mut self.watch {
            Watch::Best(motion) => motion.push(&mut self.window, sample, around, findings),
            Watch::Paper(motion) => motion.push(&mut self.window, sample, around, findings),
            Watch::Drift(motion) => motion.push(&mut self.window, sample, around, findings),
        }
    }

    /// It is `t` (s), whether the object was seen or not.
    pub fn tick(&mut self, t: f64, around: &Surroundings, findings: &mut Findings) {
        if let Watch::Best(motion) = &mut self.watch {
            motion.tick(t, &self.window, around, findings);
        }
    }

    /// Ends the track: everything becomes final.
    pub fn finish(&mut self, around: &Surroundings, findings: &mut Findings) {
        match &mut self.watch {
            Watch::Best(motion) => motion.finish(&self.window, around, findings),
            Watch::Paper(motion) => motion.finish(&self.window, findings),
            Watch::Drift(motion) => motion.finish(&self.window, findings),
        }
    }

    /// What tells where the object will be.
    pub fn outlook(&self, around: &Surroundings) -> Outlook {
        let lawful = match &self.watch {
            Watch::Best(motion) => motion.fit().map(|(fit, carried)| (fit.clone(), carried)),
            Watch::Paper(_) => {
                let recent = self.samples().last_chunk::<6>().map_or(self.samples(), |c| c);
                Flight::fit(around.law, recent, around.gravity).map(|fit| (fit, false))
            }
            Watch::Drift(motion) => motion.fit().map(|fit| (fit.clone(), false)),
        };
        Outlook { lawful, last: self.samples().last().copied() }
    }

    /// Where the object is at `t` (s).
    pub fn predict(&self, around: &Surroundings, t: f64) -> Prediction {
        self.outlook(around).predict(around.law, t)
    }

    /// Where it is at `t` (s), and how fast: by the law, unless that has ceased to hold and a measurement at `center` (m) with `covariance` (m²)
    /// disagrees with it; then there, and as fast as it came from the last one.
    pub fn state(&self, around: &Surroundings, t: f64, center: &Vec3, covariance: &Mat3) -> State {
        let by_law = self.lawful(around).filter(|(fit, _)| fit.count > 1).map(|_| self.predict(around, t));
        let holds = |p: &Prediction| self.unexplained().is_empty() || WhitenedTest::distance2(p, center, covariance) < AGREES;
        by_law.filter(holds).map_or_else(
            || {
                let before = self.samples().last().filter(|s| s.t < t);
                let velocity = before.map_or_else(Vec3::zeros, |s| (center - s.position) / (t - s.t));
                State { t, position: *center, velocity }
            },
            |prediction| prediction.state,
        )
    }

    /// The law that holds for it, and whether a surface carries it.
    pub fn lawful(&self, around: &Surroundings) -> Option<(Flight, bool)> {
        self.outlook(around).lawful
    }

    /// The newest samples, as far as no law explains them.
    pub fn unexplained(&self) -> &[Sample] {
        match &self.watch {
            Watch::Best(motion) => between(self.samples(), motion.explained_until(), f64::INFINITY),
            Watch::Paper(_) => self.samples(),
            Watch::Drift(_) => &[],
        }
    }

    /// When (s) and how fast (m/s) its present flight began, if a contact began it.
    pub fn rebound(&self) -> Option<(f64, Vec3)> {
        match &self.watch {
            Watch::Best(motion) => motion.rebound(),
            Watch::Paper(_) | Watch::Drift(_) => None,
        }
    }

    /// Whether it was not measured in the newest frame.
    pub fn is_unmeasured(&self) -> bool {
        self.missing.is_some() || self.sign > self.last
    }

    /// Whether frame after frame did not show it up to `t` (s): then it is not found again elsewhere.
    pub fn is_missed(&self, t: f64) -> bool {
        self.missing.is_some_and(|since| t - since > MISSED)
    }
}

/// What tells where an object will be: the law that holds for it now, or only where it was last.
#[derive(Clone, Debug)]
pub struct Outlook {
    /// And whether a surface carries it.
    lawful: Option<(Flight, bool)>,
    last: Option<Sample>,
}

impl Outlook {
    /// Center and covariance at `t` (s): by the law that holds, else as far as a ball may have got.
    pub fn predict(&self, law: &dyn Law, t: f64) -> Prediction {
        match &self.lawful {
            Some((fit, true)) => fit.predict(&FreeFall, t),
            Some((fit, false)) => fit.predict(law, t),
            None => {
                let (position, since) = self.last.map_or((Vec3::zeros(), t), |s| (s.position, s.t));
                let reach = VELOCITY_SD * (t - since);
                let state = State { t, position, velocity: Vec3::zeros() };
                Prediction { state, covariance: Mat3::from_diagonal_element(reach * reach + 1e-4) }
            }
        }
    }

    /// The same among known surfaces, which it bounces off and rolls on.
    pub fn predict_among(&self, course: &Course, t: f64) -> Prediction {
        let met = self.lawful.as_ref().and_then(|(fit, carried)| course.predict(fit, *carried, t));
        met.unwrap_or_else(|| self.predict(course.law, t))
    }
}
