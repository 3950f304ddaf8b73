//! The camera: its command port and registers turn on what its two endpoints bring.

use super::command::Port;
use super::depth::Depth;
use super::descriptor::Descriptors;
use super::registers::Registers;
use super::truth::FrameSent;
use super::video::Video;
use super::{Answer, DEPTH, Device, Setup, VIDEO};

/// bcdDevice of model 1414; any other behaves as model 1473.
const MODEL_1414: u16 = 0x010b;

/// The camera of a Kinect.
pub struct Camera {
    descriptors: Descriptors,
    port: Port,
    registers: Registers,
    depth: Depth,
    video: Video,
}

impl Camera {
    /// That of model 1414 with this serial number, before a scene or recording.
    pub fn new(depth: Depth, serial: &str) -> Self {
        Self::of(Descriptors::camera(MODEL_1414, serial), depth)
    }

    fn of(descriptors: Descriptors, depth: Depth) -> Self {
        let port = Port::new(depth.zero_plane(), descriptors.version == MODEL_1414);
        Self { descriptors, port, registers: Registers::default(), depth, video: Video::default() }
    }

    /// What was sent last, once a frame is over; `None` where none ended since it was asked for.
    pub fn frame_sent(&mut self) -> Option<FrameSent> {
        self.depth.frame_sent()
    }
}

impl Device for Camera {
    fn descriptors(&self) -> &Descriptors {
        &self.descriptors
    }

    fn vendor_request(&mut self, setup: &Setup, out: &[u8], _: i64) -> Answer {
        let answer = self.port.request(setup, out, &mut self.registers);
        self.depth.turn(self.registers.depth());
        self.video.turn(self.registers.video());
        answer
    }

    fn reset(&mut self) {
        self.registers = Registers::default();
        self.depth.turn(None);
        self.video.turn(None);
    }

    fn packet(&mut self, endpoint: u8) -> &[u8] {
        match endpoint {
            DEPTH => self.depth.next_packet(),
            VIDEO => self.video.next_packet(),
            _ => &[],
        }
    }

    fn is_streaming(&self, endpoint: u8) -> bool {
        match endpoint {
            DEPTH => self.depth.is_on(),
            VIDEO => self.video.is_on(),
            _ => false,
        }
    }
}
