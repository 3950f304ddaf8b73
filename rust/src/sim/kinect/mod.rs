//! A Kinect v1 as its host's USB sees it: three devices that answer control requests and bring an isochronous packet each microframe.
//!
//! It opens nothing and reads no clock: requests come with the host's time, and microframes pass as they are asked for. It is as strict as
//! is known: what no source shows a Kinect to answer stalls. `rust/virtual` brings it to programs.

mod audio;
mod camera;
mod command;
mod depth;
pub mod descriptor;
mod dialogue;
mod faults;
mod motor;
mod registers;
mod truth;
mod video;

pub use audio::{Audio, Hub};
pub use camera::{Camera, Model};
pub use depth::Depth;
pub use dialogue::{Misbehaviour, Wrong};
pub use faults::Faults;
pub use motor::Motor;
pub use truth::FrameSent;

use descriptor::Descriptors;
use std::vec::Vec;

/// Endpoint of video, as its descriptor has it.
pub const VIDEO: u8 = 0x81;
/// Endpoint of depth, likewise.
pub const DEPTH: u8 = 0x82;

const MICROFRAMES_PER_SECOND: f64 = 8000.0;

/// What the isochronous endpoint brings in a microframe.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Slot<'a> {
    /// Its packet; empty where none came.
    pub bytes: &'a [u8],
    /// What was wrong on the bus.
    pub trouble: Option<Trouble>,
}

/// What the bus says of a packet that failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Trouble {
    /// It was not fetched in time.
    Late,
    /// No answer, or none that can be.
    Protocol,
    /// A wrong checksum.
    Checksum,
}

/// A control request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Setup {
    /// bmRequestType: its highest bit is set where bytes come from the device.
    pub request_type: u8,
    /// bRequest.
    pub request: u8,
    /// wValue.
    pub value: u16,
    /// wIndex.
    pub index: u16,
    /// wLength.
    pub length: u16,
}

impl Setup {
    /// As its 8 bytes stand on the bus.
    pub fn parse(bytes: [u8; 8]) -> Self {
        let [request_type, request, v0, v1, i0, i1, l0, l1] = bytes;
        let [value, index, length] = [[v0, v1], [i0, i1], [l0, l1]].map(u16::from_le_bytes);
        Self { request_type, request, value, index, length }
    }
}

/// The device refuses a request: its pipe stalls.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stall;

/// What a request brings: nothing, where it takes bytes to the device.
pub type Answer = Result<Vec<u8>, Stall>;

/// One of a Kinect's devices.
pub trait Device: Send {
    /// What it is.
    fn descriptors(&self) -> &Descriptors;

    /// A request of its own, with the bytes that go to it, at the host's time, ns.
    ///
    /// # Errors
    /// It stalls.
    fn vendor_request(&mut self, setup: Setup, out: &[u8], at_ns: i64) -> Answer;

    /// What the isochronous endpoint brings in its next microframe.
    fn packet(&mut self, _endpoint: u8) -> Slot<'_> {
        Slot::default()
    }

    /// Whether that endpoint brings more than empty packets.
    fn is_streaming(&self, _endpoint: u8) -> bool {
        false
    }

    /// Frames of depth that were sent since this was asked for, and how many there were in all.
    fn frames_sent(&mut self) -> (Vec<FrameSent>, u64) {
        (Vec::new(), 0)
    }

    /// The bus was reset: as after it was plugged in.
    fn reset(&mut self) {}

    /// Any control request, at the host's time, ns; what it brings is no longer than asked for.
    ///
    /// # Errors
    /// It stalls.
    fn control(&mut self, setup: Setup, out: &[u8], at_ns: i64) -> Answer {
        let is_standard = setup.request_type & 0x60 == 0;
        let mut answer = if is_standard { self.descriptors().standard_request(setup) } else { self.vendor_request(setup, out, at_ns) }?;
        answer.truncate(setup.length.into());
        Ok(answer)
    }
}
