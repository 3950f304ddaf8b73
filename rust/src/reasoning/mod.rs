//! Positions to events: tracks, what interrupts their flights, and what that says of the scene.

mod predictor;
mod telling;

pub use predictor::Predictor;

use crate::config::{CameraAssumption, Config};
use crate::event::{self, Event, TrackReason};
use crate::geometry::camera::{Camera, Pose};
use crate::math::{Mat3, Vec3, rows, sqrt};
use crate::physics::between;
use crate::physics::contact::Contact;
use crate::physics::gravity::Gravity;
use crate::physics::law::{FreeFallWithDrag, State};
use crate::scene::plane::Up;
use crate::scene::surfaces::Surfaces;
use crate::track::Measurement;
use crate::track::association::{MEASUREMENTS, TRACKS, associate};
use crate::track::hypothesis::Surroundings;
use crate::track::motion::{Finding, Findings};
use crate::track::noise::Noise;
use crate::track::object::Track;
use heapless::Vec;

/// An object unseen for this long is lost, s: the longest gap that may hide a contact, and what it takes to see that it doesn't.
const LOST: f64 = 0.25;
/// One that should be out of the image has left after this, s: until then it may bounce back.
const LEFT: f64 = 0.2;
/// One that hides behind or within another may do so for this long, s.
const HIDDEN: f64 = 0.6;

/// Positions to events. It opens nothing, reads no clock and allocates nothing.
#[derive(Debug)]
pub struct Reasoning {
    config: Config,
    camera: Option<Camera>,
    pose: Pose,
    /// Known gravity, or what flights have shown of it so far.
    gravity: Gravity,
    /// What flights alone have shown, its size kept, and how many.
    measured: (Gravity, u32),
    noise: Noise,
    tracks: Vec<Track, TRACKS>,
    surfaces: Surfaces,
    /// Newest stamp, ns.
    now: i64,
    announced: bool,
    last_track: u32,
    last_contact: u32,
    last_orientation: u32,
}

impl Reasoning {
    /// `camera` is the one that sees the objects; `None` where positions come from elsewhere.
    pub fn new(config: &Config, camera: Option<&Camera>) -> Self {
        let pose = world_of(camera);
        let vector = Vec3::from(config.laws.gravity);
        let pose_is_known = camera.is_none_or(|c| c.pose.is_some());
        let tilted = config.camera_assumption(pose_is_known) != CameraAssumption::Static;
        Self {
            config: config.clone(),
            camera: camera.copied(),
            pose,
            gravity: if tilted { Gravity::of_known_size(vector) } else { Gravity::known(vector) },
            measured: (Gravity { mean: vector, information: Mat3::from_diagonal_element(1e-4), size: None }, 0),
            noise: Noise::new(config.tracking.position_sd),
            tracks: Vec::new(),
            surfaces: Surfaces::new(&config.environment),
            now: 0,
            announced: false,
            last_track: 0,
            last_contact: 0,
            last_orientation: 0,
        }
    }

    /// The pose that fixes the world.
    pub fn world_from_camera(&self) -> Pose {
        self.pose
    }

    /// Takes in what was seen at one instant, `frame` of the stream; stamps increase.
    pub fn push(&mut self, timestamp_ns: i64, frame: u64, measured: &[Measurement], sink: &mut dyn FnMut(Event)) {
        self.now = timestamp_ns;
        self.announce(sink);
        // What is no number tells nothing.
        let sane = |m: &&Measurement| m.center.iter().chain(m.covariance.iter().flatten()).all(|x| x.is_finite());
        let measured: Vec<Measurement, MEASUREMENTS> = measured.iter().filter(sane).take(MEASUREMENTS).copied().map(proper).collect();
        let measured = measured.as_slice();
        let law = self.law(measured.first().map_or(0.0, |m| m.radius));
        let mut assigned = associate(&self.tracks, measured, &self.around(&law));
        for (i, m) in measured.iter().enumerate().take(assigned.len()).filter(|(_, m)| m.whole) {
            let place = assigned[i].or_else(|| self.adopt(m, &assigned)).or_else(|| self.begin(m, sink));
            assigned[i] = place;
            if let Some(place) = place {
                self.extend(place, m, frame, sink);
            }
        }
        if self.camera.is_some() {
            self.end_lost(timestamp_ns, measured, sink);
        }
    }

    /// Makes everything final.
    pub fn finish(&mut self, sink: &mut dyn FnMut(Event)) {
        while !self.tracks.is_empty() {
            self.end(0, TrackReason::StreamEnded, sink);
        }
        self.tell_surfaces(true, sink);
    }

    /// Where each tracked object is by the laws of physics.
    pub fn predictors(&self) -> impl Iterator<Item = Predictor> + '_ {
        self.tracks.iter().map(|track| {
            let law = self.law(track.radius);
            Predictor { track: track.id, epoch_ns: track.epoch_ns, outlook: track.outlook(&self.around(&law)), law }
        })
    }

    fn law(&self, radius: f64) -> FreeFallWithDrag {
        FreeFallWithDrag::of(&self.config.object, &self.config.laws, radius)
    }

    fn around<'a>(&'a self, law: &'a FreeFallWithDrag) -> Surroundings<'a> {
        Surroundings { law, gravity: &self.gravity, duration: self.config.object.contact_duration, normal_at: &|_| None }
    }

    fn up(&self) -> Up {
        let (gravity, covariance) = self.gravity.estimate();
        let size = gravity.norm();
        let direction = gravity.try_normalize(1e-9).map_or_else(Vec3::z, |g| -g);
        let across = covariance.trace() - direction.dot(&(covariance * direction));
        Up { direction, variance: 0.5 * across / (size * size) }
    }

    /// Positions of another tracker belong to a silent track rather than to a new one: gaps don't end tracks there.
    fn adopt(&self, m: &Measurement, assigned: &[Option<usize>]) -> Option<usize> {
        if self.camera.is_some() || m.label.is_some() {
            return None;
        }
        let silent = self.tracks.iter().enumerate().filter(|(i, t)| {
            t.label.is_none() && !assigned.contains(&Some(*i)) && t.seconds(m.time_ns) - t.last > 0.0 && t.radius == m.radius
        });
        let rested = silent.filter(|(_, t)| t.seconds(m.time_ns) - t.last > LOST);
        rested.max_by(|a, b| (a.1.seconds(m.time_ns) - a.1.last).total_cmp(&(b.1.seconds(m.time_ns) - b.1.last))).map(|(i, _)| i)
    }

    fn begin(&mut self, m: &Measurement, sink: &mut dyn FnMut(Event)) -> Option<usize> {
        if self.tracks.is_full() {
            // There is room for so many: the one that was silent for longest goes.
            let silence = |t: &Track| t.seconds(m.time_ns) - t.last;
            let quietest = (0..self.tracks.len()).max_by(|&i, &j| silence(&self.tracks[i]).total_cmp(&silence(&self.tracks[j])))?;
            if silence(&self.tracks[quietest]) < LOST {
                return None;
            }
            self.end(quietest, TrackReason::Lost, sink);
        }
        self.last_track += 1;
        let laws = &self.config.laws;
        let track = Track::new(self.last_track, m, laws.method, laws.false_alarm, laws.theta);
        self.emit(Some(track.id), true, event::TrackStarted { reason: TrackReason::Appeared }, sink);
        let _ = self.tracks.push(track);
        Some(self.tracks.len() - 1)
    }

    fn extend(&mut self, place: usize, m: &Measurement, frame: u64, sink: &mut dyn FnMut(Event)) {
        let Some(id) = self.tracks.get(place).map(|t| t.id) else { return };
        let variance = self.noise.sd() * self.noise.sd();
        let position = event::Position {
            frame,
            center: m.center.into(),
            center_in_camera: m.center_in_camera.map(Into::into),
            covariance: rows(&m.covariance.unwrap_or_else(|| Mat3::from_diagonal_element(variance))),
            points: m.points,
            residual_rms: m.residual_rms,
        };
        self.emit(Some(id), true, position, sink);
        self.with_track(place, sink, |track, noise, around, findings| track.push(m, noise, around, findings));
    }

    /// Runs `f` on a track in its surroundings, and tells what came to light.
    fn with_track(
        &mut self,
        place: usize,
        sink: &mut dyn FnMut(Event),
        f: impl FnOnce(&mut Track, &mut Noise, &Surroundings, &mut Findings),
    ) {
        let mut findings = Findings::new();
        let Some(radius) = self.tracks.get(place).map(|t| t.radius) else { return };
        let law = self.law(radius);
        {
            let Self { tracks, noise, gravity, surfaces, config, .. } = self;
            let duration = config.object.contact_duration;
            let normal_at = |c: &Contact| surfaces.touched(&c.center, &c.center_covariance(), radius).map(|(_, normal)| normal);
            let around = Surroundings { law: &law, gravity, duration, normal_at: &normal_at };
            if let Some(track) = tracks.get_mut(place) {
                f(track, noise, &around, &mut findings);
            }
        }
        for finding in findings {
            match finding {
                Finding::Inconsistent(alarm) => self.tell_inconsistency(place, &alarm, sink),
                Finding::Touched(contact, again) => self.tell_touch(place, &contact, again, sink),
                Finding::Settled(contact) => self.tell_contact(place, &contact, sink),
                Finding::Flown(flight, since, until) => self.learn(place, law, &flight, since, until, sink),
                Finding::Parted(at) => self.part(place, at, sink),
            }
        }
    }

    /// What a track holds from `at` (s) on is another object: the camera lost the one and found the other.
    fn part(&mut self, place: usize, at: f64, sink: &mut dyn FnMut(Event)) {
        let Some(track) = self.tracks.get(place).filter(|_| self.camera.is_some()) else { return };
        let samples: Vec<_, { crate::track::window::CAPACITY }> = between(track.samples(), at, f64::INFINITY).iter().copied().collect();
        let Some(first) = samples.first() else { return };
        let m = Measurement {
            time_ns: track.epoch_ns,
            center: first.position,
            covariance: None,
            center_in_camera: None,
            label: track.label,
            radius: track.radius,
            points: None,
            residual_rms: None,
            whole: true,
        };
        let (last, sign) = (track.last, track.sign);
        self.end(place, TrackReason::Lost, sink);
        let Some(new) = self.begin(&m, sink) else { return };
        if let Some(track) = self.tracks.get_mut(new) {
            (track.last, track.sign) = (last, sign);
        }
        for sample in samples {
            self.with_track(new, sink, |track, _, around, findings| track.push_sample(sample, around, findings));
        }
    }

    /// Ends the tracks of which nothing was seen for too long. A blob that can't be measured is a sign of life where one should be.
    fn end_lost(&mut self, timestamp_ns: i64, measured: &[Measurement], sink: &mut dyn FnMut(Event)) {
        let mut place = 0;
        while let Some(track) = self.tracks.get(place) {
            let now = track.seconds(timestamp_ns);
            let law = self.law(track.radius);
            let prediction = track.predict(&self.around(&law), now);
            let reach = 3.0 * track.radius + 3.0 * sqrt(prediction.covariance.trace()).min(0.1);
            let sign = measured.iter().any(|m| !m.whole && (m.center - prediction.state.position).norm() < reach);
            let unseen = now - track.last;
            let in_view = self.sees(&prediction.state, track.radius);
            let reason = match () {
                () if unseen > HIDDEN => Some(if track.sign > track.last { TrackReason::Merged } else { TrackReason::Lost }),
                () if unseen > LEFT && !in_view => Some(TrackReason::LeftView),
                () if now - track.sign > LOST && !sign => Some(TrackReason::Lost),
                () => None,
            };
            if let Some(reason) = reason {
                self.end(place, reason, sink);
                continue;
            }
            if let Some(track) = self.tracks.get_mut(place).filter(|_| sign) {
                track.sign = now;
            }
            place += 1;
        }
    }

    /// Whether a ball there would be in the image, all of it.
    fn sees(&self, state: &State, radius: f64) -> bool {
        let Some(camera) = &self.camera else { return true };
        let p = self.pose.to_camera(&state.position);
        let Some((column, row)) = camera.project(&p) else { return false };
        let (rx, ry) = (radius / p.z * camera.fx, radius / p.z * camera.fy);
        column > rx && row > ry && column < camera.width as f64 - 1.0 - rx && row < camera.height as f64 - 1.0 - ry
    }

    fn end(&mut self, place: usize, reason: TrackReason, sink: &mut dyn FnMut(Event)) {
        let id = self.tracks.get(place).map(|t| t.id);
        self.with_track(place, sink, |track, _, around, findings| track.finish(around, findings));
        self.emit(id, true, event::TrackEnded { reason }, sink);
        if place < self.tracks.len() {
            self.tracks.remove(place);
        }
    }
}

/// Without a covariance that is none.
fn proper(mut m: Measurement) -> Measurement {
    m.covariance = m.covariance.filter(|c| c.cholesky().is_some());
    m
}

/// The world of a stream: that of the configured pose; else the camera's axes renamed; for positions, their own.
fn world_of(camera: Option<&Camera>) -> Pose {
    camera.map_or(Pose { rotation: Mat3::identity(), translation: Vec3::zeros() }, |c| c.pose.unwrap_or_else(Pose::renamed_axes))
}
