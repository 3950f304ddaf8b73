//! What was really sent: by what a driver is judged.

use crate::kinect::disparity::{HEIGHT, Packing, WIDTH};
use crate::kinect::packet::{HEADER, Header, Packet, Place};
use std::vec::Vec;

/// A frame of depth, once its last packet was sent.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct FrameSent {
    /// Frames sent before.
    pub frame: u64,
    /// Of its last packet.
    pub ticks: u32,
    /// Of its samples, 16 bits each, little-endian: what zlib's crc32 gives.
    pub crc32: u32,
    /// Packets that it has.
    pub packets: usize,
    /// Those that did not arrive, or not whole, from 0 on.
    pub lost: Vec<usize>,
}

/// Puts packets together.
#[derive(Clone, Debug, Default)]
pub(super) struct Recorder {
    packed: Vec<u8>,
    packets: usize,
    lost: Vec<usize>,
    frames: u64,
    sent: Vec<FrameSent>,
}

impl Recorder {
    /// Frames that are over.
    pub fn frames(&self) -> u64 {
        self.frames
    }

    /// A packet that is sent, and whether it arrives whole.
    pub fn packet(&mut self, bytes: &[u8], packing: Packing, arrives: bool) {
        let Ok(packet) = Packet::new(bytes) else { return };
        let Ok(header) = Header::parse(&packet) else { return };
        if header.place == Place::First {
            self.packed.clear();
            self.lost.clear();
            self.packets = 0;
        }
        if !arrives {
            self.lost.push(self.packets);
        }
        self.packed.extend(&bytes[HEADER..]);
        self.packets += 1;
        if header.place != Place::Last {
            return;
        }
        let mut samples = std::vec![0; WIDTH * HEIGHT];
        if packing.unpack(&self.packed, &mut samples).is_ok() {
            let mut crc = flate2::Crc::new();
            crc.update(&samples.iter().flat_map(|sample| sample.to_le_bytes()).collect::<Vec<u8>>());
            let lost = core::mem::take(&mut self.lost);
            let (frame, ticks) = (self.frames, header.timestamp_ticks);
            self.sent.push(FrameSent { frame, ticks, crc32: crc.sum(), packets: self.packets, lost });
        }
        self.frames += 1;
    }

    /// The frames that ended since this was asked for.
    pub fn take(&mut self) -> Vec<FrameSent> {
        core::mem::take(&mut self.sent)
    }
}
