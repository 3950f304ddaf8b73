//! The depth endpoint: the packets of a scene or a recording while the stream is on, empty ones else.

use super::faults::{Arrival, Faults, Way};
use super::truth::{FrameSent, Recorder};
use super::{MICROFRAMES_PER_SECOND, Slot};
use crate::capture;
use crate::kinect::calibration::ZeroPlane;
use crate::kinect::disparity::Packing;
use crate::kinect::packet::{Header, Packet, Place};
use crate::sim::packets::{Packets, zero_plane};
use crate::sim::{Scene, SimError};
use std::boxed::Box;
use std::vec::Vec;

/// What the camera sees.
enum View {
    Scene(Box<Packets>),
    Recording(Box<capture::Packets>),
}

/// The stream of depth.
pub struct Depth {
    view: View,
    zero_plane: ZeroPlane,
    way: Way,
    recorder: Recorder,
    /// How it is packed if it is on.
    packing: Option<Packing>,
    /// Nothing of a frame that began before the stream was turned on is sent.
    awaits_first: bool,
    ended: bool,
    /// Microframes in which nothing more comes.
    silent: u64,
    has_been_silent: bool,
    /// Microframes that faults took.
    behind: u64,
    packet: Vec<u8>,
    arrival: Arrival,
}

impl Depth {
    /// Of a scene, `NAME?key=value&…`, over and over; time and sequence go on.
    ///
    /// # Errors
    /// As of [`Scene::parse`].
    pub fn scene(scene: &str, faults: Faults) -> Result<Self, SimError> {
        let packets = Packets::endless(&Scene::parse_for_packets(scene)?);
        Ok(Self::new(View::Scene(Box::new(packets)), zero_plane(), faults))
    }

    /// Of a recording, with that unit's zero plane if it tells; then nothing but empty packets.
    pub fn recording(packets: capture::Packets, faults: Faults) -> Self {
        let plane = packets.zero_plane().unwrap_or_else(zero_plane);
        Self::new(View::Recording(Box::new(packets)), plane, faults)
    }

    fn new(view: View, zero_plane: ZeroPlane, faults: Faults) -> Self {
        Self {
            view,
            zero_plane,
            way: Way::new(faults),
            recorder: Recorder::default(),
            packing: None,
            awaits_first: true,
            ended: false,
            silent: 0,
            has_been_silent: false,
            behind: 0,
            packet: Vec::new(),
            arrival: (Vec::new(), None),
        }
    }

    pub(super) fn zero_plane(&self) -> ZeroPlane {
        self.zero_plane
    }

    pub(super) fn is_on(&self) -> bool {
        self.packing.is_some() && !self.ended && self.silent == 0
    }

    pub(super) fn turn(&mut self, packing: Option<Packing>) {
        if self.packing != packing {
            self.packing = packing;
            self.awaits_first = true;
            self.way.arrivals.clear();
        }
    }

    pub(super) fn frames(&self) -> u64 {
        self.recorder.frames()
    }

    pub(super) fn frames_sent(&mut self) -> Vec<FrameSent> {
        self.recorder.take()
    }

    pub(super) fn next_packet(&mut self) -> Slot<'_> {
        self.arrival = (Vec::new(), None);
        if let Some(packing) = self.packing
            && !self.ended
        {
            self.ended = self.advance(packing).is_none();
        }
        Slot { bytes: &self.arrival.0, trouble: self.arrival.1 }
    }

    /// To the next microframe; `None` after the last packet of a recording, and where it is broken.
    fn advance(&mut self, packing: Packing) -> Option<()> {
        while self.way.arrivals.is_empty() {
            self.fill(packing)?;
            if self.packet.is_empty() {
                if self.behind == 0 {
                    return Some(());
                }
                self.behind -= 1;
                continue;
            }
            self.fall_silent();
            self.silent = self.silent.saturating_sub(1);
            let arrives = self.silent == 0 && self.way.send(&self.packet, self.recorder.frames());
            self.recorder.packet(&self.packet, packing, arrives);
            if self.silent > 0 {
                return Some(());
            }
        }
        self.arrival = self.way.arrivals.pop_front()?;
        self.behind += self.way.arrivals.len() as u64;
        Some(())
    }

    fn fall_silent(&mut self) {
        let faults = self.way.faults();
        let is_time = self.recorder.frames() as f64 >= faults.from && is_first(&self.packet);
        if faults.silence > 0.0 && !self.has_been_silent && is_time {
            self.has_been_silent = true;
            self.silent = (faults.silence * MICROFRAMES_PER_SECOND) as u64 + 1;
        }
    }

    /// The next packet of the view.
    fn fill(&mut self, packing: Packing) -> Option<()> {
        loop {
            let bytes = match &mut self.view {
                View::Scene(packets) => {
                    packets.set_packing(packing);
                    packets.next_packet()?.0
                }
                View::Recording(packets) => packets.next_packet().ok()??.0,
            };
            self.packet.clear();
            self.packet.extend(bytes);
            if !self.awaits_first || bytes.is_empty() {
                return Some(());
            }
            if is_first(bytes) {
                self.awaits_first = false;
                for _ in 0..self.way.faults().begin as u64 {
                    self.fill(packing)?;
                }
                return Some(());
            }
        }
    }
}

fn is_first(bytes: &[u8]) -> bool {
    Packet::new(bytes).is_ok_and(|packet| Header::parse(&packet).is_ok_and(|header| header.place == Place::First))
}
