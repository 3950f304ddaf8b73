//! Positions to events: tracks, what interrupts their flights, and what that says of the scene.

mod predictor;
mod telling;

pub use predictor::Predictor;

use crate::config::{CameraAssumption, Config, LawName, ObjectsAssumption, SceneAssumption};
use crate::event::{self, Event, TrackReason};
use crate::geometry::camera::{Camera, Pose};
use crate::geometry::environment::{Environment, Relief};
use crate::math::{Mat3, Vec3, rows};
use crate::physics::between;
use crate::physics::contact::Contact;
use crate::physics::gravity::Gravity;
use crate::physics::law::{FreeFallWithDrag, Law, State};
use crate::physics::own::{Motion, OwnLaw, Tabulated};
use crate::scene::camera_motion::CameraMotion;
use crate::scene::level::Level;
use crate::scene::plane::Up;
use crate::scene::surfaces::Surfaces;
use crate::track::Measurement;
use crate::track::activity::Activity;
use crate::track::association::{MEASUREMENTS, Sight, TRACKS, associate};
use crate::track::hypothesis::Surroundings;
use crate::track::interval::Told;
use crate::track::motion::{Finding, Findings};
use crate::track::noise::Noise;
use crate::track::object::{Track, Watch};
use crate::track::passive::Circumstances;
use heapless::Vec;

/// An object unseen for this long is lost, s: the longest gap that may hide a contact, and what it takes to see that it doesn't.
const LOST: f64 = 0.25;
/// One that should be out of the image has left after this, s: until then it may bounce back.
const LEFT: f64 = 0.2;
/// One that hides behind or within another may do so for this long, s.
const HIDDEN: f64 = 0.6;

/// Stamps that went through seconds are off by no more than this, ns.
const ROUNDING_NS: i64 = 1_000;

/// Positions to events. It opens nothing, reads no clock and allocates nothing.
#[derive(Debug)]
pub struct Reasoning {
    config: Config,
    camera: Option<Camera>,
    pose: Pose,
    /// Known gravity, or what flights have shown of it so far.
    gravity: Gravity,
    /// No gravity, in its place where the law is that a plane balances it.
    balanced: Option<Gravity>,
    /// What flights alone have shown, its size kept, and how many.
    measured: (Gravity, u32),
    /// The accelerometer's, in the world.
    level: Option<Level>,
    /// The camera's path, where it moves, and where static structure shows it in this frame.
    motion: Option<CameraMotion>,
    structure: (Vec3, Mat3),
    noise: Noise,
    tracks: Vec<Track, TRACKS>,
    surfaces: Surfaces,
    /// Newest stamp, ns.
    now: i64,
    announced: bool,
    /// The user's own law gave no answer.
    lawless: bool,
    last_track: u32,
    last_contact: u32,
    last_orientation: u32,
    last_motion: u32,
    last_activity: u32,
    homeless: u64,
}

impl Reasoning {
    /// `camera` is the one that sees the objects; `None` where positions come from elsewhere.
    pub fn new(config: &Config, camera: Option<&Camera>) -> Self {
        let pose = camera.map_or(Pose { rotation: Mat3::identity(), translation: Vec3::zeros() }, Camera::world);
        let vector = Vec3::from(config.laws.gravity);
        let pose_is_known = camera.is_none_or(|c| c.pose.is_some());
        let assumed = config.camera_assumption(pose_is_known);
        let tilted = matches!(assumed, CameraAssumption::Tilted | CameraAssumption::Unknown);
        Self {
            config: config.clone(),
            camera: camera.copied(),
            pose,
            gravity: if tilted { Gravity::of_known_size(vector) } else { Gravity::known(vector) },
            balanced: (config.laws.law == LawName::ConstantVelocity).then(|| Gravity::known(Vec3::zeros())),
            measured: (Gravity { mean: vector, information: Mat3::from_diagonal_element(1e-4), size: None }, 0),
            level: camera.and_then(|c| c.gravity).and_then(|gravity| Level::new(&(pose.rotation * gravity))),
            motion: assumed.moves().then(CameraMotion::default),
            structure: (Vec3::zeros(), Mat3::zeros()),
            noise: Noise::new(config.tracking.position_sd),
            tracks: Vec::new(),
            surfaces: Surfaces::new(&config.environment, config.assume.scene == SceneAssumption::Known),
            now: 0,
            announced: false,
            lawless: false,
            last_track: 0,
            last_contact: 0,
            last_orientation: 0,
            last_motion: 0,
            last_activity: 0,
            homeless: 0,
        }
    }

    /// The pose that fixes the world.
    pub fn world_from_camera(&self) -> Pose {
        self.pose
    }

    /// Static structure shows the camera so far from where it was in the first frame (world axes, m), with this information (1/m²), in the frame
    /// that is pushed next.
    pub fn see_structure(&mut self, (displacement, information): (Vec3, Mat3)) {
        self.structure = (displacement, information);
    }

    /// The camera sees this behind all objects, from now on.
    pub fn see_relief(&mut self, relief: Relief) {
        self.surfaces.see(relief);
    }

    /// Takes in what was seen at one instant, `frame` of the stream; stamps increase.
    pub fn push(&mut self, timestamp_ns: i64, frame: u64, measured: &[Measurement], sink: &mut dyn FnMut(Event)) {
        self.push_by(None, timestamp_ns, frame, measured, sink);
    }

    /// The same under a user's own law, the same in every frame, instead of gravity and the air: it is asked for each object that is measured,
    /// once. Gravity is taken as known then. Where the law gives no answer nothing more is taken in ([`Reasoning::is_lawless`]).
    pub fn push_by(
        &mut self,
        mut own: Option<&mut dyn OwnLaw>,
        timestamp_ns: i64,
        frame: u64,
        measured: &[Measurement],
        sink: &mut dyn FnMut(Event),
    ) {
        if self.lawless {
            return;
        }
        if own.is_some() {
            self.gravity = Gravity::known(Vec3::from(self.config.laws.gravity));
        }
        self.now = timestamp_ns;
        self.announce(sink);
        // What is no number tells nothing.
        let sane = |m: &&Measurement| m.center.iter().chain(m.covariance.iter().flatten()).all(|x| x.is_finite());
        let measured: Vec<Measurement, MEASUREMENTS> = measured.iter().filter(sane).take(MEASUREMENTS).copied().map(proper).collect();
        let measured = measured.as_slice();
        let law = self.law(measured.first().map_or(0.0, |m| m.radius));
        let association = associate(&self.tracks, measured, self.sight(), &self.around(&law));
        let excused: Vec<u32, TRACKS> = self.tracks.iter().zip(association.excused).filter(|(_, e)| *e).map(|(t, _)| t.id).collect();
        for (track, blob) in self.tracks.iter_mut().zip(association.blurred) {
            if let Some(blob) = blob.and_then(|j| measured.get(j)) {
                track.hint(blob);
            }
        }
        let mut assigned = association.tracks;
        for (i, m) in measured.iter().enumerate().take(assigned.len()).filter(|(_, m)| m.whole) {
            // One ball told twice is one: two can't be where one is.
            if m.label.is_none() && measured[..i].iter().any(|o| o.whole && o.label.is_none() && (o.center - m.center).norm() < m.radius) {
                continue;
            }
            assigned[i] = assigned[i].or_else(|| self.adopt(m, &assigned)).or_else(|| self.begin(m, &assigned, sink));
            match assigned[i] {
                Some(id) => {
                    if let Some(own) = &mut own {
                        self.ask(&mut **own, id, m);
                        if self.lawless {
                            return;
                        }
                    }
                    self.extend(id, m, frame, sink);
                }
                None => self.homeless += 1,
            }
        }
        let ids: Vec<u32, TRACKS> = self.tracks.iter().map(|t| t.id).collect();
        for id in ids {
            self.with_track(id, sink, false, |track, _, around, findings| track.tick(track.seconds(timestamp_ns), around, findings));
            if self.camera.is_some() {
                self.look_after(id, timestamp_ns, excused.contains(&id), sink);
            }
        }
        self.tell_motion(sink);
    }

    /// Makes everything final.
    pub fn finish(&mut self, sink: &mut dyn FnMut(Event)) {
        while let Some(id) = self.tracks.first().map(|t| t.id) {
            self.end(id, TrackReason::StreamEnded, sink);
        }
        self.tell_motion(sink);
        self.tell_surfaces(true, sink);
    }

    /// Where each tracked object is by the laws of physics.
    pub fn predictors(&self) -> impl Iterator<Item = Predictor> + '_ {
        self.tracks.iter().map(|track| {
            let law = self.motion_of(track);
            let outlook = track.outlook(&self.around(&law));
            Predictor::new(track, outlook, law.ahead(), self.pull().mean, &self.config.object, self.surfaces.restitutions())
        })
    }

    /// What is known of the scene.
    pub fn environment(&self) -> &Environment {
        self.surfaces.environment()
    }

    /// Whether a user's own law gave no answer: then nothing more is taken in.
    pub fn is_lawless(&self) -> bool {
        self.lawless
    }

    /// Objects that are tracked.
    pub fn tracks(&self) -> usize {
        self.tracks.len()
    }

    /// Positions that found no track because all were taken.
    pub fn homeless(&self) -> u64 {
        self.homeless
    }

    fn track(&self, id: u32) -> Option<&Track> {
        self.tracks.iter().find(|t| t.id == id)
    }

    fn track_mut(&mut self, id: u32) -> Option<&mut Track> {
        self.tracks.iter_mut().find(|t| t.id == id)
    }

    fn law(&self, radius: f64) -> FreeFallWithDrag {
        FreeFallWithDrag::of(&self.config.object, &self.config.laws, radius)
    }

    /// What pulls at objects that nobody touches.
    fn pull(&self) -> &Gravity {
        self.balanced.as_ref().unwrap_or(&self.gravity)
    }

    fn motion_of(&self, track: &Track) -> Motion {
        track.own.clone().map_or_else(|| Motion::Fall(self.law(track.radius)), Motion::Own)
    }

    fn around<'a>(&'a self, law: &'a dyn Law) -> Surroundings<'a> {
        let duration = self.config.object.contact_duration;
        Surroundings { law, gravity: self.pull(), duration, normal_at: &|_| None, beyond: &|_| false }
    }

    fn up(&self) -> Up {
        let (gravity, covariance) = self.gravity.estimate();
        let size = gravity.norm();
        let direction = gravity.try_normalize(1e-9).map_or_else(Vec3::z, |g| -g);
        let across = covariance.trace() - direction.dot(&(covariance * direction));
        Up { direction, variance: 0.5 * across / (size * size) }
    }

    /// Positions of another tracker belong to a silent track rather than to a new one: gaps don't end tracks there.
    fn adopt(&self, m: &Measurement, assigned: &[Option<u32>]) -> Option<u32> {
        if self.camera.is_some() || m.label.is_some() {
            return None;
        }
        let silence = |t: &Track| t.seconds(m.time_ns) - t.last;
        let silent = self.tracks.iter().filter(|t| t.label.is_none() && !assigned.contains(&Some(t.id)) && silence(t) > LOST);
        silent.max_by(|a, b| silence(a).total_cmp(&silence(b))).map(|t| t.id)
    }

    fn begin(&mut self, m: &Measurement, assigned: &[Option<u32>], sink: &mut dyn FnMut(Event)) -> Option<u32> {
        if self.tracks.is_full() {
            // There is room for so many: the one that was silent for longest, and still is, goes.
            let silence = |t: &Track| t.seconds(m.time_ns) - t.last;
            let silent = self.tracks.iter().filter(|t| silence(t) > LOST && !assigned.contains(&Some(t.id)));
            let quietest = silent.max_by(|a, b| silence(a).total_cmp(&silence(b)))?.id;
            self.end(quietest, TrackReason::Lost, sink);
        }
        self.last_track += 1;
        let id = self.last_track;
        let lies = self.config.laws.law == LawName::Auto || self.may_lie(m);
        let mut track = Track::new(id, m, Watch::new(&self.config.laws, self.motion.is_some(), lies));
        track.activity = (self.config.assume.objects == ObjectsAssumption::Unknown).then(|| Activity::new(&self.config.laws));
        self.emit(Some(id), true, event::TrackStarted { reason: TrackReason::Appeared }, sink);
        let _ = self.tracks.push(track);
        Some(id)
    }

    /// Whether a known surface may carry what is measured there.
    fn may_lie(&self, m: &Measurement) -> bool {
        let (law, nearest) = (self.law(m.radius), |p: &Vec3| self.surfaces.nearest(p));
        let around = self.around(&law);
        let place = Circumstances::new(&self.config, &around, &nearest, &|_, _| false, m.radius, None);
        place.support(&m.center, &self.up().direction).is_some()
    }

    fn extend(&mut self, id: u32, m: &Measurement, frame: u64, sink: &mut dyn FnMut(Event)) {
        let variance = self.noise.sd() * self.noise.sd();
        let position = event::Position {
            frame,
            center: m.center.into(),
            center_in_camera: m.center_in_camera.map(Into::into),
            covariance: rows(&(m.covariance.unwrap_or_else(|| Mat3::from_diagonal_element(variance)) + m.drift)),
            points: m.points,
            residual_rms: m.residual_rms,
        };
        self.emit(Some(id), true, position, sink);
        if let Some(motion) = &mut self.motion {
            let weight = m.covariance.and_then(Mat3::try_inverse).unwrap_or_else(|| Mat3::from_diagonal_element(1.0 / variance));
            motion.begin(self.now, frame, self.structure);
            motion.see(id, m.time_ns, m.center, weight);
        }
        let now = self.now;
        if let Some(track) = self.track_mut(id) {
            let t = track.seconds(m.time_ns);
            if let Some(activity) = &mut track.activity {
                activity.frame(t, now);
            }
        }
        self.with_track(id, sink, false, |track, noise, around, findings| track.push(m, noise, around, findings));
    }

    /// Asks the user's law about an object that is being measured.
    fn ask(&mut self, own: &mut dyn OwnLaw, id: u32, m: &Measurement) {
        let Some(track) = self.track(id) else { return };
        let (law, young) = (self.motion_of(track), track.samples().len() < 2);
        let covariance = m.covariance.unwrap_or_else(|| Mat3::from_diagonal_element(self.noise.sd() * self.noise.sd()));
        let state = track.state(&self.around(&law), track.seconds(m.time_ns), &m.center, &covariance);
        let answer = own.acceleration(state.t, &state.position, &state.velocity).filter(|a| a.iter().all(|x| x.is_finite()));
        self.lawless = answer.is_none();
        let gravity = self.gravity.mean;
        let (Some(acceleration), Some(track)) = (answer, self.track_mut(id)) else { return };
        let table = track.own.get_or_insert_with(|| Tabulated::new(gravity));
        if young {
            // What was asked before had no velocity.
            table.clear();
        }
        table.push(state.t, acceleration);
    }

    /// Runs `f` on a track in its surroundings, for the last time perhaps, and tells what came to light.
    fn with_track(
        &mut self,
        id: u32,
        sink: &mut dyn FnMut(Event),
        is_last: bool,
        f: impl FnOnce(&mut Track, &mut Noise, &Surroundings, &mut Findings),
    ) {
        let (mut findings, mut told) = (Findings::new(), Told::new());
        let Some((radius, law)) = self.track(id).map(|t| (t.radius, self.motion_of(t))) else { return };
        {
            let Self { tracks, noise, gravity, balanced, surfaces, config, last_activity, .. } = self;
            let duration = config.object.contact_duration;
            let normal_at = |c: &Contact| surfaces.touched(&c.center, &c.center_covariance(), radius).map(|(_, normal)| normal);
            let beyond = |c: &Contact| surfaces.is_beyond(&c.center, &c.center_covariance(), radius);
            let pull = balanced.as_ref().unwrap_or(gravity);
            let around = Surroundings { law: &law, gravity: pull, duration, normal_at: &normal_at, beyond: &beyond };
            if let Some(track) = tracks.iter_mut().find(|t| t.id == id) {
                f(track, noise, &around, &mut findings);
                let around = Surroundings { gravity, ..around };
                let nearest = |p: &Vec3| surfaces.nearest(p);
                let open = |p: &Vec3, reach: f64| surfaces.environment().is_open(p, reach);
                let place = Circumstances::new(config, &around, &nearest, &open, radius, track.untold.then(|| noise.parts()));
                if let Some((activity, samples)) = track.activity() {
                    activity.push(samples, &findings, &place, last_activity, &mut told);
                    if is_last {
                        activity.finish(samples, &place, last_activity, &mut told);
                    }
                }
            }
        }
        for (activity, is_final) in told {
            self.emit(Some(id), is_final, activity, sink);
        }
        for finding in findings {
            match finding {
                Finding::Inconsistent(alarm) => self.tell_inconsistency(id, &alarm, sink),
                Finding::Touched(contact, again) => self.tell_touch(id, &contact, again, sink),
                Finding::Settled(contact) => self.tell_contact(id, &contact, sink),
                Finding::Flown(flight, since, until) => self.learn_flight(id, &law, &flight, since, until, sink),
                Finding::Parted(at) => self.part(id, at, sink),
                Finding::Fell(since, until) => self.learn_by_paper(id, since, until, sink),
                Finding::Drifted(since, until) => {
                    let span = self.track(id).map(|track| (track.stamp(since), track.stamp(until)));
                    if let (Some(motion), Some((from_ns, to_ns))) = (&mut self.motion, span) {
                        motion.land(id, from_ns - ROUNDING_NS, to_ns + ROUNDING_NS);
                    }
                }
            }
        }
    }

    /// What a track holds from `at` (s) on is another object: the camera lost the one and found the other.
    fn part(&mut self, id: u32, at: f64, sink: &mut dyn FnMut(Event)) {
        // A thing of any shape is known by its shape.
        let Some(track) = self.track(id).filter(|track| self.camera.is_some() && track.label.is_none()) else { return };
        let samples: Vec<_, { crate::track::window::CAPACITY }> = between(track.samples(), at, f64::INFINITY).iter().copied().collect();
        let Some(first) = samples.first() else { return };
        let m = Measurement {
            time_ns: track.epoch_ns,
            center: first.position,
            covariance: None,
            drift: Mat3::zeros(),
            center_in_camera: None,
            label: track.label,
            radius: track.radius,
            points: None,
            residual_rms: None,
            whole: true,
        };
        let (last, sign, own) = (track.last, track.sign, track.own.clone());
        self.end(id, TrackReason::Lost, sink);
        let Some(new) = self.begin(&m, &[], sink) else { return };
        if let Some(track) = self.track_mut(new) {
            (track.last, track.sign, track.own) = (last, sign, own);
        }
        for sample in samples {
            self.with_track(new, sink, false, |track, _, around, findings| track.push_sample(sample, around, findings));
        }
    }

    /// Ends a track of which nothing was seen for too long. It is `excused` where something hides it, or a blob that can't be measured is
    /// where it should be.
    fn look_after(&mut self, id: u32, timestamp_ns: i64, excused: bool, sink: &mut dyn FnMut(Event)) {
        let Some(track) = self.track(id) else { return };
        let now = track.seconds(timestamp_ns);
        let law = self.motion_of(track);
        let prediction = track.predict(&self.around(&law), now);
        let unseen = now - track.last;
        let reason = match () {
            () if unseen > HIDDEN => Some(if track.sign > track.last { TrackReason::Merged } else { TrackReason::Lost }),
            () if now - track.sign > LEFT && !self.sees(&prediction.state, track.radius) => Some(TrackReason::LeftView),
            () if now - track.sign > LOST && !excused => Some(TrackReason::Lost),
            () => None,
        };
        if let Some(reason) = reason {
            self.end(id, reason, sink);
        } else if let Some(track) = self.track_mut(id).filter(|t| t.last < now) {
            if excused {
                track.sign = now;
            } else {
                track.missing.get_or_insert(now);
            }
        }
    }

    fn sight(&self) -> Option<Sight<'_>> {
        self.camera.as_ref().map(|camera| Sight { camera, pose: self.pose })
    }

    /// Whether a ball there would be in the image, all of it.
    fn sees(&self, state: &State, radius: f64) -> bool {
        self.sight().is_none_or(|sight| !sight.cuts(&self.pose.to_camera(&state.position), radius))
    }

    fn end(&mut self, id: u32, reason: TrackReason, sink: &mut dyn FnMut(Event)) {
        self.with_track(id, sink, true, |track, _, around, findings| track.finish(around, findings));
        self.emit(Some(id), true, event::TrackEnded { reason }, sink);
        self.tracks.retain(|t| t.id != id);
    }
}

/// Without a covariance that is none.
fn proper(mut m: Measurement) -> Measurement {
    m.covariance = m.covariance.filter(|c| c.cholesky().is_some());
    m
}
