//! What the devices say that they are, as `lsusb -v` shows a real unit.

use super::{Answer, Setup, Stall};
use std::string::String;
use std::vec::Vec;

/// Microsoft's vendor number.
const VENDOR: u16 = 0x045e;
/// Linux's own.
const LINUX: u16 = 0x1d6b;
/// Standard requests: bmRequestType and bRequest.
const GET_STATUS: (u8, u8) = (0, 0);
const CLEAR_FEATURE: (u8, u8) = (0, 1);
const GET_DESCRIPTOR: (u8, u8) = (0, 6);
const GET_CONFIGURATION: (u8, u8) = (0, 8);
const SET_CONFIGURATION: (u8, u8) = (0, 9);
const GET_INTERFACE: (u8, u8) = (0, 10);
const SET_INTERFACE: (u8, u8) = (0, 11);
/// Bytes of a slot of the isochronous endpoints: two of 960 in a microframe, and how a descriptor says it.
const ISOCHRONOUS: (u8, u16) = (1, 0x0bc0);
const INTERRUPT: (u8, u16) = (3, 1);
const BULK: (u8, u16) = (2, 512);

/// How fast a device's bus is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Speed {
    /// 12 Mbit/s.
    Full,
    /// 480 Mbit/s.
    High,
}

/// An endpoint's address, kind and size.
type Endpoint = (u8, (u8, u16));

/// All that a device says of itself.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Descriptors {
    /// Its maker's number.
    pub vendor: u16,
    /// Its product number.
    pub product: u16,
    /// Its version, bcdDevice.
    pub version: u16,
    /// Of its bus.
    pub speed: Speed,
    /// bDeviceClass.
    class: u8,
    /// mA.
    power: u16,
    /// The endpoints of each alternate setting of its interface.
    settings: &'static [&'static [Endpoint]],
    /// Manufacturer, product, serial number; empty where it has none.
    pub strings: [String; 3],
}

impl Descriptors {
    fn new(product: u16, version: u16, settings: &'static [&'static [Endpoint]], name: &str, serial: &str) -> Self {
        let strings = ["Microsoft", name, serial].map(String::from);
        Self { vendor: VENDOR, product, version, speed: Speed::High, class: 0, power: 16, settings, strings }
    }

    /// Of the camera of model 1414, or where `version` is another, of 1473.
    pub fn camera(version: u16, serial: &str) -> Self {
        const ENDPOINTS: &[Endpoint] = &[(super::VIDEO, ISOCHRONOUS), (super::DEPTH, ISOCHRONOUS)];
        Self::new(0x02ae, version, &[ENDPOINTS], "Xbox NUI Camera", serial)
    }

    /// Of the camera of Kinect for Windows, whose endpoints are in its alternate setting.
    pub fn windows_camera(serial: &str) -> Self {
        const ENDPOINTS: &[Endpoint] = &[(super::VIDEO, ISOCHRONOUS), (super::DEPTH, ISOCHRONOUS)];
        Self::new(0x02bf, 0x0200, &[&[], ENDPOINTS], "Kinect for Windows Camera", serial)
    }

    /// Of the motor.
    pub fn motor() -> Self {
        Self { speed: Speed::Full, power: 100, ..Self::new(0x02b0, 0x0105, &[&[]], "Xbox NUI Motor", "") }
    }

    /// Of the microphones, before they are given a firmware.
    pub fn audio(serial: &str) -> Self {
        Self::new(0x02ad, 0x0100, &[&[(0x01, BULK), (0x81, BULK)]], "Xbox NUI Audio", serial)
    }

    /// Of the hub inside, that they are all at.
    pub fn hub() -> Self {
        Self { class: 9, power: 100, ..Self::new(0x02c2, 0x0000, &[&[(0x81, INTERRUPT)]], "Xbox NUI Hub", "") }
    }

    /// Of the bus's own hub, as the kernel makes it up.
    pub fn root_hub() -> Self {
        let strings = ["Linux", "Virtual Host Controller", ""].map(String::from);
        Self { vendor: LINUX, product: 0x0002, power: 0, strings, ..Self::hub() }
    }

    /// Alternate settings of the interface.
    pub fn settings(&self) -> usize {
        self.settings.len()
    }

    /// Whether `setting` of the interface has this endpoint.
    pub fn has_endpoint(&self, setting: usize, address: u8) -> bool {
        self.settings.get(setting).is_some_and(|endpoints| endpoints.iter().any(|(other, _)| *other == address))
    }

    /// The device's descriptor, 18 bytes.
    pub fn device(&self) -> Vec<u8> {
        let [v0, v1] = self.vendor.to_le_bytes();
        let [p0, p1] = self.product.to_le_bytes();
        let [d0, d1] = self.version.to_le_bytes();
        let serial = if self.strings[2].is_empty() { 0 } else { 3 };
        let protocol = u8::from(self.class == 9);
        std::vec![18, 1, 0x00, 0x02, self.class, 0, protocol, 64, v0, v1, p0, p1, d0, d1, 1, 2, serial, 1]
    }

    /// The configuration's descriptor, with those of the interface and its endpoints.
    pub fn configuration(&self) -> Vec<u8> {
        let mut all = std::vec![9, 2, 0, 0, 1, 1, 0, 0xc0, (self.power / 2) as u8];
        for (setting, endpoints) in self.settings.iter().enumerate() {
            let class = if self.class == 0 { [0xff; 3] } else { [self.class, 0, 0] };
            all.extend([9, 4, 0, setting as u8, endpoints.len() as u8]);
            all.extend(class);
            all.push(0);
            for &(address, (kind, size)) in *endpoints {
                let [s0, s1] = size.to_le_bytes();
                let interval = match kind {
                    1 => 1,
                    3 => 12,
                    _ => 0,
                };
                all.extend([7, 5, address, kind, s0, s1, interval]);
            }
        }
        let [l0, l1] = (all.len() as u16).to_le_bytes();
        (all[2], all[3]) = (l0, l1);
        all
    }

    /// The string of this number, as UTF-16 with its header; 0 is the list of languages.
    fn string(&self, number: usize) -> Answer {
        let text: Vec<u8> = match number.checked_sub(1) {
            None => 0x0409_u16.to_le_bytes().into(),
            Some(index) => {
                let text = self.strings.get(index).filter(|text| !text.is_empty()).ok_or(Stall)?;
                text.encode_utf16().flat_map(u16::to_le_bytes).collect()
            }
        };
        Ok([&[text.len() as u8 + 2, 3], &text[..]].concat())
    }

    /// What every device answers alike.
    pub(super) fn standard_request(&self, setup: Setup) -> Answer {
        match (setup.request_type & 0x60, setup.request) {
            GET_STATUS => Ok(std::vec![1, 0]),
            GET_DESCRIPTOR => match setup.value.to_be_bytes() {
                [1, 0] => Ok(self.device()),
                [2, 0] => Ok(self.configuration()),
                [3, number] => self.string(number.into()),
                _ => Err(Stall),
            },
            GET_CONFIGURATION => Ok(std::vec![1]),
            GET_INTERFACE => Ok(std::vec![0]),
            SET_CONFIGURATION if setup.value <= 1 => Ok(Vec::new()),
            SET_INTERFACE if setup.index == 0 && usize::from(setup.value) < self.settings() => Ok(Vec::new()),
            CLEAR_FEATURE => Ok(Vec::new()),
            _ => Err(Stall),
        }
    }
}
