//! The camera's registers: what turns its streams on, and how they are.

use crate::kinect::disparity::Packing;
use std::collections::BTreeMap;

/// Register that turns depth on with 2.
pub const DEPTH_STREAM: u16 = 0x06;
/// Register that turns video on: 1 Bayer, 3 infra-red.
pub const VIDEO_STREAM: u16 = 0x05;
/// 640 × 480 (for infra-red 640 × 488) in the registers of resolution, 30 Hz in those of the rate.
const SIZE: u16 = 1;
const RATE: u16 = 0x1e;

/// What the video endpoint brings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Picture {
    /// Colour, 8 bits a pixel.
    Bayer,
    /// The infra-red camera, 10 bits a pixel.
    Infrared,
}

/// All registers that were written.
#[derive(Clone, Debug, Default)]
pub struct Registers(BTreeMap<u16, u16>);

impl Registers {
    /// Of a register that was never written: 0.
    pub fn read(&self, register: u16) -> u16 {
        self.0.get(&register).copied().unwrap_or(0)
    }

    /// Nothing that is written is refused, as far as is known.
    pub fn write(&mut self, register: u16, value: u16) {
        self.0.insert(register, value);
    }

    /// How depth is packed if it is on and can be.
    pub fn depth(&self) -> Option<Packing> {
        let packing = match self.read(0x12) {
            2 => Packing::Ten,
            3 => Packing::Eleven,
            _ => return None,
        };
        let is_on = self.read(DEPTH_STREAM) == 2 && (self.read(0x13), self.read(0x14)) == (SIZE, RATE);
        is_on.then_some(packing)
    }

    /// What video shows if it is on and can be.
    pub fn video(&self) -> Option<Picture> {
        let (picture, mode) = match self.read(VIDEO_STREAM) {
            1 => (Picture::Bayer, [0x0c, 0x0d, 0x0e]),
            3 => (Picture::Infrared, [0x19, 0x1a, 0x1b]),
            _ => return None,
        };
        (mode.map(|register| self.read(register)) == [0, SIZE, RATE]).then_some(picture)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn written(registers: &[(u16, u16)]) -> Registers {
        Registers(registers.iter().copied().collect())
    }

    #[test]
    fn depth_is_on_only_with_its_mode() {
        let mode = [(0x12, 3), (0x13, 1), (0x14, 0x1e), (0x06, 2)];
        assert_eq!(written(&mode).depth(), Some(Packing::Eleven));
        assert_eq!(written(&[(0x12, 2), (0x13, 1), (0x14, 0x1e), (0x06, 2)]).depth(), Some(Packing::Ten));
        for missing in 0..mode.len() {
            let rest: Vec<_> = mode.iter().copied().enumerate().filter(|(i, _)| *i != missing).map(|(_, write)| write).collect();
            assert_eq!(written(&rest).depth(), None, "{missing}");
        }
        assert_eq!(written(&mode).video(), None);
    }

    use std::vec::Vec;

    #[test]
    fn video_is_colour_or_infrared() {
        assert_eq!(written(&[(0x05, 1), (0x0d, 1), (0x0e, 0x1e)]).video(), Some(Picture::Bayer));
        assert_eq!(written(&[(0x05, 3), (0x1a, 1), (0x1b, 0x1e)]).video(), Some(Picture::Infrared));
        assert_eq!(written(&[(0x05, 3), (0x0d, 1), (0x0e, 0x1e)]).video(), None, "the other's mode");
    }
}
