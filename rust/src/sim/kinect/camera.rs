//! The camera: its command port and registers turn on what its two endpoints bring.

use super::command::Port;
use super::depth::Depth;
use super::descriptor::Descriptors;
use super::dialogue::Misbehaviour;
use super::registers::Registers;
use super::truth::FrameSent;
use super::video::Video;
use super::{Answer, DEPTH, Device, Setup, Slot, VIDEO};
use std::vec::Vec;

/// bcdDevice of model 1414; any other behaves as model 1473.
const MODEL_1414: u16 = 0x010b;
const MODEL_1473: u16 = 0x0110;
/// The serial number of cameras that leave it to their microphones.
const ZEROS: &str = "0000000000000000";

/// Which Kinect it is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Model {
    /// The first.
    #[default]
    M1414,
    /// Longer parameters, the serial number with the microphones, no motor that answers.
    M1473,
    /// Kinect for Windows: likewise, and its endpoints are in an alternate setting.
    Windows,
}

/// The camera of a Kinect.
pub struct Camera {
    descriptors: Descriptors,
    port: Port,
    registers: Registers,
    depth: Depth,
    video: Video,
}

impl Camera {
    /// With this serial number, if its model's cameras have one, before a scene or recording; some of its replies may be wrong.
    pub fn new(model: Model, serial: &str, depth: Depth, misbehaviour: Option<Misbehaviour>) -> Self {
        let descriptors = match model {
            Model::M1414 => Descriptors::camera(MODEL_1414, serial),
            Model::M1473 => Descriptors::camera(MODEL_1473, ZEROS),
            Model::Windows => Descriptors::windows_camera(ZEROS),
        };
        let port = Port::new(depth.zero_plane(), model == Model::M1414, misbehaviour);
        Self { descriptors, port, registers: Registers::default(), depth, video: Video::default() }
    }
}

impl Device for Camera {
    fn descriptors(&self) -> &Descriptors {
        &self.descriptors
    }

    fn vendor_request(&mut self, setup: Setup, out: &[u8], _: i64) -> Answer {
        let answer = self.port.request(setup, out, &mut self.registers);
        self.depth.turn(self.registers.depth());
        self.video.turn(self.registers.video());
        answer
    }

    fn reset(&mut self) {
        self.registers = Registers::default();
        self.port.reset();
        self.depth.turn(None);
        self.video.turn(None);
    }

    fn packet(&mut self, endpoint: u8) -> Slot<'_> {
        match endpoint {
            DEPTH => self.depth.next_packet(),
            VIDEO => self.video.next_packet(),
            _ => Slot::default(),
        }
    }

    fn is_streaming(&self, endpoint: u8) -> bool {
        match endpoint {
            DEPTH => self.depth.is_on(),
            VIDEO => self.video.is_on(),
            _ => false,
        }
    }

    fn frames_sent(&mut self) -> (Vec<FrameSent>, u64) {
        (self.depth.frames_sent(), self.depth.frames())
    }
}
