//! What a capture's control transfers say of the devices on the bus: which is a Kinect's camera, its zero plane, how it packs.

use super::urb::{COMPLETION, SUBMISSION, Urb};
use crate::kinect::calibration::ZeroPlane;
use crate::kinect::command::{Command, HEADER, Reply, code};
use crate::kinect::disparity::Packing;
use crate::kinect::model::Model;
use std::vec::Vec;

/// More devices than all buses of a machine have.
const MOST_DEVICES: usize = 1 << 10;
/// The register of the format of depth, and its value for 10 bits.
const FORMAT: [u8; 2] = [0x12, 0];
const TEN_BITS: [u8; 2] = [2, 0];

/// What is known of a device.
#[derive(Clone, Debug, Default)]
pub(super) struct Device {
    /// Bus and address.
    pub(super) place: (u16, u8),
    /// By its descriptor.
    pub(super) is_camera: bool,
    /// By what its driver told it.
    pub(super) packing: Option<Packing>,
    /// The command whose reply is awaited, and what it asks for.
    asked: Option<(u16, u16, [u8; 2])>,
    fixed_parameters: Vec<u8>,
    shift: Vec<u8>,
}

impl Device {
    /// By its own replies.
    pub(super) fn zero_plane(&self) -> Option<ZeroPlane> {
        ZeroPlane::parse(&self.fixed_parameters, &self.shift)
    }

    fn control(&mut self, urb: &Urb, data: &[u8]) {
        match (urb.event, urb.endpoint) {
            (SUBMISSION, 0) => {
                let Ok(command) = Command::parse(data) else { return };
                let first = command.payload.first_chunk().copied().unwrap_or_default();
                self.asked = Some((command.command, command.tag, first));
                if let (code::WRITE_REGISTER, [low, high, value @ ..]) = (command.command, command.payload)
                    && [*low, *high] == FORMAT
                {
                    self.packing = Some(if *value == TEN_BITS { Packing::Ten } else { Packing::Eleven });
                }
            }
            (COMPLETION, 0x80) => match data {
                [18, 1, ..] if data.len() == 18 => {
                    let [vendor, product, release] = [8, 10, 12].map(|at| u16::from_le_bytes([data[at], data[at + 1]]));
                    self.is_camera = Model::of(vendor, product, release).is_some();
                }
                _ => self.reply(data),
            },
            _ => {}
        }
    }

    fn reply(&mut self, data: &[u8]) {
        let Ok(reply) = Reply::parse(data) else { return };
        match self.asked {
            Some((command, tag, [0, 0])) if (reply.command, reply.tag, reply.status) == (command, tag, 0) => match command {
                code::FIXED_PARAMETERS => self.fixed_parameters = data[HEADER..].into(),
                code::MODE_PARAMETERS => self.shift = data[HEADER..].into(),
                _ => {}
            },
            _ => {}
        }
    }
}

/// The devices that spoke so far.
#[derive(Debug, Default)]
pub(super) struct Bus {
    devices: Vec<Device>,
}

impl Bus {
    /// Takes note of a control transfer.
    pub(super) fn control(&mut self, urb: &Urb, data: &[u8]) {
        if let Some(device) = self.device_mut(urb.device) {
            device.control(urb, data);
        }
    }

    /// The device at `place`, as far as it is known.
    pub(super) fn device(&self, place: (u16, u8)) -> Device {
        self.devices.iter().find(|device| device.place == place).cloned().unwrap_or_default()
    }

    /// A camera that said so.
    pub(super) fn camera(&self) -> Option<(u16, u8)> {
        self.devices.iter().find(|device| device.is_camera).map(|device| device.place)
    }

    fn device_mut(&mut self, place: (u16, u8)) -> Option<&mut Device> {
        let index = match self.devices.iter().position(|device| device.place == place) {
            Some(index) => index,
            None if self.devices.len() < MOST_DEVICES => {
                self.devices.push(Device { place, ..Device::default() });
                self.devices.len() - 1
            }
            None => return None,
        };
        self.devices.get_mut(index)
    }
}
