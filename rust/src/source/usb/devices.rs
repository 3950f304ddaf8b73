//! The Kinects that are attached, and which of them is meant.

use super::error::Problem;
use super::ffi::{Context, Device, UsbError};
use crate::kinect::model::{Model, is_audio};
use std::format;
use std::path::Path;
use std::string::{String, ToString};
use std::vec::Vec;

/// A Kinect's camera that is attached.
pub struct Attached {
    pub(super) device: Device,
    model: Model,
    serial: Option<String>,
    bus: u8,
    address: u8,
    ports: Vec<u8>,
}

impl Attached {
    /// Which model.
    pub fn model(&self) -> Model {
        self.model
    }

    /// Its serial number; that of its microphones, where the camera has none. `None`: neither tells.
    pub fn serial(&self) -> Option<&str> {
        self.serial.as_deref()
    }

    /// Bus and ports: `1-2.1`. As good as a serial number, as long as it stays plugged in there.
    pub fn place(&self) -> String {
        place(self.bus, &self.ports)
    }

    /// The file by which programs open it.
    pub fn node(&self) -> String {
        format!("/dev/bus/usb/{:03}/{:03}", self.bus, self.address)
    }

    /// By what it is known.
    pub fn identity(&self) -> Identity {
        self.serial.clone().map_or_else(|| Identity::Place(self.place()), Identity::Serial)
    }
}

/// All of them, in the order of the bus's ports.
///
/// # Errors
/// There is no bus.
pub fn attached() -> Result<Vec<Attached>, Problem> {
    let no_bus = |error: UsbError| Problem::NoBus { error: error.to_string() };
    let context = Context::new().map_err(no_bus)?;
    let devices = context.devices().map_err(no_bus)?;
    let devices: Vec<_> = devices.into_iter().filter_map(|device| Some((device.descriptor().ok()?, device))).collect();
    // The microphones are at the hub inside the Kinect, as the camera is.
    let audio: Vec<_> = devices
        .iter()
        .filter(|(descriptor, _)| is_audio(descriptor.vendor, descriptor.product))
        .map(|(descriptor, device)| (device.address().0, device.ports(), serial(device, descriptor.serial_index)))
        .collect();
    let mut cameras: Vec<_> = devices
        .into_iter()
        .filter_map(|(descriptor, device)| {
            let model = Model::of(descriptor.vendor, descriptor.product, descriptor.bcd_device)?;
            let ((bus, address), ports) = (device.address(), device.ports());
            let is_beside = |other: &[u8]| ports.split_last().map(|(_, hub)| hub) == other.split_last().map(|(_, hub)| hub);
            let beside = || audio.iter().find(|(at, other, _)| *at == bus && is_beside(other)).and_then(|(_, _, serial)| serial.clone());
            let serial = serial(&device, descriptor.serial_index).or_else(beside);
            Some(Attached { device, model, serial, bus, address, ports })
        })
        .collect();
    cameras.sort_by(|a, b| (a.bus, &a.ports).cmp(&(b.bus, &b.ports)));
    Ok(cameras)
}

/// A serial number that is more than zeros: as the system has read it, for which nobody needs permission, else as the device tells.
fn serial(device: &Device, index: u8) -> Option<String> {
    let known = Path::new("/sys/bus/usb/devices").join(place(device.address().0, &device.ports())).join("serial");
    let serial = std::fs::read_to_string(known).ok().or_else(|| device.open().ok()?.string(index).ok())?;
    let serial = serial.trim();
    (!serial.trim_matches('0').is_empty()).then(|| serial.into())
}

fn place(bus: u8, ports: &[u8]) -> String {
    let ports: Vec<_> = ports.iter().map(ToString::to_string).collect();
    format!("{bus}-{}", ports.join("."))
}

/// By what a Kinect is known.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Identity {
    /// Its serial number.
    Serial(String),
    /// Where it is plugged in.
    Place(String),
}

impl Identity {
    /// What stands behind `kinect:`.
    pub fn name(&self) -> &str {
        match self {
            Self::Serial(name) | Self::Place(name) => name,
        }
    }
}

/// The one among `attached` that is meant by `name`, what stands behind `kinect:`: a serial number, a place or an index; empty: the first.
/// Whatever else asks a Kinect of that name, its accelerometer for one, finds the same one so.
pub(super) fn meant(name: &str, attached: Vec<Attached>) -> Result<Attached, Problem> {
    let known = attached.iter().map(|one| one.identity().name().into()).collect();
    let is_named = |one: &Attached| name.is_empty() || one.serial() == Some(name) || one.place() == name;
    let index = attached.iter().position(is_named).or_else(|| name.parse().ok());
    index.and_then(|index| attached.into_iter().nth(index)).ok_or(Problem::NotFound { known })
}
