//! What came to light, told as events, and learned from.

use super::Reasoning;
use crate::config::Method;
use crate::event::{self, Event, Kind, Undetermined};
use crate::math::{Mat3, Vec3, atan2, rows, sqrt};
use crate::physics::contact::{Contact, RESTITUTION};
use crate::physics::flight::Flight;
use crate::physics::gravity::Gravity;
use crate::physics::inconsistency::Inconsistency;
use crate::physics::law::Law;
use crate::physics::translation::Displacement;
use crate::physics::{between, paper};
use crate::scene::camera_motion::Told;
use crate::scene::plane::Patch;

/// A flight tells of the tracker's noise from this long after its beginning, s.
const SETTLED: f64 = 0.1;

impl Reasoning {
    pub(super) fn tell_inconsistency(&mut self, id: u32, alarm: &Inconsistency, sink: &mut dyn FnMut(Event)) {
        let told = event::Inconsistency {
            predicted: alarm.predicted.into(),
            measured: alarm.measured.into(),
            distance: alarm.distance,
            threshold: alarm.threshold,
            p_value: alarm.p_value,
        };
        self.emit(Some(id), true, told, sink);
    }

    pub(super) fn tell_touch(&mut self, id: u32, contact: &Contact, again: bool, sink: &mut dyn FnMut(Event)) {
        self.last_contact += u32::from(!again);
        let number = self.last_contact;
        let Some(track) = self.track_mut(id) else { return };
        if !again {
            track.contact = number;
        }
        let radius = track.radius;
        let surface = self.surfaces.touched(&contact.center, &contact.center_covariance(), radius);
        self.emit_contact(id, contact, surface, false, sink);
    }

    pub(super) fn tell_contact(&mut self, id: u32, contact: &Contact, sink: &mut dyn FnMut(Event)) {
        let Some(radius) = self.track(id).map(|t| t.radius) else { return };
        let up = self.up();
        let surface = Patch::new(contact, radius, self.config.object.spin_sd).and_then(|patch| self.surfaces.add(patch, &up));
        self.emit_contact(id, contact, surface, true, sink);
        self.tell_surfaces(false, sink);
    }

    fn emit_contact(&mut self, id: u32, contact: &Contact, surface: Option<(u32, Vec3)>, last: bool, sink: &mut dyn FnMut(Event)) {
        let Some(track) = self.track(id) else { return };
        let own = match self.config.laws.method {
            Method::Best => contact.normal(RESTITUTION),
            Method::Paper => paper::normal(contact),
        };
        // A surface's normal is known better than one contact's, where the two may be the same and the ball came from its front.
        let agrees = |n: &Vec3| n.dot(&contact.before) < 0.0 && own.is_none_or(|own| own.dot(n) > 0.85);
        let normal = surface.map(|(_, n)| n).filter(|n| self.config.laws.method == Method::Best && agrees(n)).or(own);
        let normal = normal.filter(|n| n.dot(&contact.before) <= 0.0);
        let told = event::Contact {
            id: track.contact,
            time_ns: track.stamp(contact.time),
            time_sd: Some(contact.time_sd).filter(|sd| sd.is_finite()),
            center: contact.center.into(),
            point: normal.map(|n| (contact.center - n * track.radius).into()),
            covariance: rows(&contact.center_covariance()),
            normal: normal.map(Into::into),
            direction: contact.direction().map(Into::into),
            velocity_before: Some(contact.before.into()),
            velocity_after: Some(contact.after.into()),
            restitution: normal.and_then(|n| contact.restitution(&n)),
            surface: surface.map(|(id, _)| id),
        };
        self.emit(Some(id), last, told, sink);
    }

    /// A flight is over: what it says of gravity and of the noise.
    pub(super) fn learn_flight(&mut self, id: u32, law: &dyn Law, flight: &Flight, since: f64, until: f64, sink: &mut dyn FnMut(Event)) {
        let Some(track) = self.tracks.iter().find(|t| t.id == id) else { return };
        let samples = between(track.samples(), since, until);
        // Just after an impact a ball swings.
        let settled = between(samples, since + SETTLED, until);
        self.noise.learn(flight, law, settled);
        // Under a user's own law gravity is known, and a force of its own is not gravity.
        if track.own.is_some() || track.activity.as_ref().is_some_and(|activity| !activity.is_passive(since, until)) {
            return;
        }
        self.noise.learn_passive(law, settled, &self.gravity);
        let Some((information, vector)) = flight.gravity_information(law, samples) else { return };
        self.learn_gravity(&(information / flight.excess()), &(vector / flight.excess()), sink);
    }

    /// Gravity by the paper: the mean of Eq. 4's accelerations. It knows no drag.
    pub(super) fn learn_by_paper(&mut self, id: u32, since: f64, until: f64, sink: &mut dyn FnMut(Event)) {
        let Some(track) = self.tracks.iter().find(|t| t.id == id) else { return };
        let samples = between(track.samples(), since, until + 1e-9);
        let Some((mean, covariance)) = paper::mean_acceleration(samples) else { return };
        // A piece of a flight, or none.
        let size = self.gravity.mean.norm();
        let sure = covariance.trace() < size * size && (mean.norm() / size - 1.0).abs() < 0.5;
        if let Some(information) = covariance.try_inverse().filter(|_| sure) {
            self.learn_gravity(&information, &(information * mean), sink);
        }
    }

    /// One flight says that `information` · g = `vector`.
    fn learn_gravity(&mut self, information: &Mat3, vector: &Vec3, sink: &mut dyn FnMut(Event)) {
        // A throw, a catch or a piece of one frame may pass for a flight; gravity does not change.
        if self.gravity.size.is_some() && self.gravity.disagreement(information, vector) > 30.0 {
            return;
        }
        if self.gravity.size.is_some() {
            self.gravity.learn(information, vector);
        }
        self.measured.0.learn(information, vector);
        self.measured.1 += 1;
        let Some(covariance) = self.measured.0.information.try_inverse() else { return };
        let to_camera = self.pose.rotation.transpose();
        let g = to_camera * self.measured.0.mean;
        let told = event::CameraOrientation {
            id: self.last_orientation,
            gravity_in_camera: g.into(),
            roll: atan2(g.x, g.y),
            pitch: atan2(-g.z, sqrt(g.x * g.x + g.y * g.y)),
            covariance: rows(&crate::math::symmetric(&(to_camera * covariance * self.pose.rotation))),
            flights: self.measured.1,
            undetermined: [Undetermined::Heading].into_iter().collect(),
        };
        self.last_orientation += 1;
        self.emit(None, true, told, sink);
        self.tell_level(&covariance, sink);
    }

    /// The camera's path, as far as it is due.
    pub(super) fn tell_motion(&mut self, sink: &mut dyn FnMut(Event)) {
        let (now, idle) = (self.now, self.tracks.is_empty());
        let Some(mut motion) = self.motion.take_if(|motion| {
            motion.land_silent(now);
            motion.is_due(now, idle)
        }) else {
            return;
        };
        let laws = &self.config.laws;
        let (method, gravity) = ((laws.method, laws.theta), self.gravity);
        let law = self.law(self.config.object.radius.as_slice().first().copied().unwrap_or_default());
        motion.tell(method, &law, &gravity, idle, |told| match told {
            Told::Moved(frame, displacement, tied) => self.tell_displacement(frame, &displacement, tied, sink),
            Told::Flown(samples) => {
                let free = Gravity { information: Mat3::from_diagonal_element(1e-4), size: None, ..gravity };
                let flight = Flight::fit(&law, samples, &free);
                if let Some((flight, (information, vector))) = flight.and_then(|f| Some((f.clone(), f.gravity_information(&law, samples)?)))
                {
                    self.learn_gravity(&(information / flight.excess()), &(vector / flight.excess()), sink);
                }
            }
        });
        self.motion = Some(motion);
    }

    fn tell_displacement(&mut self, frame: u64, displacement: &Displacement, tied: bool, sink: &mut dyn FnMut(Event)) {
        let untied = [Undetermined::Velocity, Undetermined::UnseenMotion].into_iter().filter(|_| !tied);
        let level = (self.gravity.size.is_some() && !tied).then_some(Undetermined::AccelerationOrGravity);
        let told = event::CameraMotion {
            id: self.last_motion,
            frame,
            displacement: displacement.mean.into(),
            covariance: rows(&displacement.covariance),
            undetermined: untied.chain(level).collect(),
        };
        self.last_motion += 1;
        self.emit(None, true, told, sink);
    }

    /// Whether the accelerometer agrees with all flights so far.
    fn tell_level(&mut self, covariance: &Mat3, sink: &mut dyn FnMut(Event)) {
        let (gravity, flights) = (self.measured.0.mean, self.measured.1);
        let found = self.level.as_mut().and_then(|level| level.test(&gravity, covariance, self.config.laws.false_alarm));
        let (Some(found), Some(told)) = (found, self.camera.and_then(|camera| camera.gravity)) else { return };
        let told = event::LevelDisagreement {
            gravity_in_camera: (self.pose.rotation.transpose() * gravity).into(),
            gravity_by_accelerometer: told.into(),
            angle: found.angle,
            sd: found.sd,
            p_value: found.p_value,
            flights,
        };
        self.emit(None, true, told, sink);
    }

    pub(super) fn announce(&mut self, sink: &mut dyn FnMut(Event)) {
        if !core::mem::replace(&mut self.announced, true) {
            self.tell_surfaces(false, sink);
        }
    }

    pub(super) fn tell_surfaces(&mut self, last: bool, sink: &mut dyn FnMut(Event)) {
        let (up, now) = (self.up(), self.now);
        self.surfaces.tell(&up, last, |surface, is_final| {
            sink(Event { timestamp_ns: now, track: None, is_final, kind: surface.into() });
        });
    }

    pub(super) fn emit(&self, track: Option<u32>, is_final: bool, kind: impl Into<Kind>, sink: &mut dyn FnMut(Event)) {
        sink(Event { timestamp_ns: self.now, track, is_final, kind: kind.into() });
    }
}
