//! The depth endpoint: the packets of a scene or a recording while the stream is on, empty ones else.

use super::truth::{FrameSent, Recorder};
use crate::capture;
use crate::kinect::calibration::ZeroPlane;
use crate::kinect::disparity::Packing;
use crate::kinect::packet::{Header, Packet, Place};
use crate::sim::packets::{Packets, zero_plane};
use crate::sim::{Scene, SimError};
use std::boxed::Box;
use std::vec::Vec;

/// What follows the last frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Ending {
    /// The first again, time and sequence going on.
    #[default]
    Again,
    /// Empty packets for ever.
    Silence,
}

/// What the camera sees.
enum View {
    Scene(Box<Packets>),
    Recording(Box<capture::Packets>),
}

/// The stream of depth.
pub struct Depth {
    view: View,
    zero_plane: ZeroPlane,
    /// How it is packed if it is on.
    packing: Option<Packing>,
    /// Nothing of a frame that began before the stream was turned on is sent.
    awaits_first: bool,
    ended: bool,
    recorder: Recorder,
    packet: Vec<u8>,
}

impl Depth {
    /// Of a scene, `NAME?key=value&…`.
    ///
    /// # Errors
    /// As of [`Scene::parse`].
    pub fn scene(scene: &str, ending: Ending) -> Result<Self, SimError> {
        let scene = Scene::parse_for_packets(scene)?;
        let packets = if ending == Ending::Again { Packets::endless(&scene) } else { Packets::new(&scene) };
        Ok(Self::new(View::Scene(Box::new(packets)), zero_plane()))
    }

    /// Of a recording, with that unit's zero plane if it tells; then silence.
    pub fn recording(packets: capture::Packets) -> Self {
        let plane = packets.zero_plane().unwrap_or_else(zero_plane);
        Self::new(View::Recording(Box::new(packets)), plane)
    }

    fn new(view: View, zero_plane: ZeroPlane) -> Self {
        Self { view, zero_plane, packing: None, awaits_first: true, ended: false, recorder: Recorder::default(), packet: Vec::new() }
    }

    pub(super) fn zero_plane(&self) -> ZeroPlane {
        self.zero_plane
    }

    pub(super) fn is_on(&self) -> bool {
        self.packing.is_some() && !self.ended
    }

    pub(super) fn turn(&mut self, packing: Option<Packing>) {
        if self.packing != packing {
            self.packing = packing;
            self.awaits_first = true;
        }
    }

    pub(super) fn next_packet(&mut self) -> &[u8] {
        self.packet.clear();
        if let Some(packing) = self.packing
            && !self.ended
        {
            self.ended = self.fill(packing).is_none();
            self.recorder.packet(&self.packet, packing);
        }
        &self.packet
    }

    /// The next packet of the view; `None` after the last one, and where the recording is broken.
    fn fill(&mut self, packing: Packing) -> Option<()> {
        loop {
            let bytes = match &mut self.view {
                View::Scene(packets) => {
                    packets.set_packing(packing);
                    packets.next_packet()?.0
                }
                View::Recording(packets) => packets.next_packet().ok()??.0,
            };
            let begins = bytes.is_empty() || is_first(bytes);
            if !self.awaits_first || begins {
                self.awaits_first &= bytes.is_empty();
                self.packet.extend(bytes);
                return Some(());
            }
        }
    }

    pub(super) fn frame_sent(&mut self) -> Option<FrameSent> {
        self.recorder.take()
    }
}

fn is_first(bytes: &[u8]) -> bool {
    Packet::new(bytes).is_ok_and(|packet| Header::parse(&packet).is_ok_and(|header| header.place == Place::First))
}
