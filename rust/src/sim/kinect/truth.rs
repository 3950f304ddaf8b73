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
    /// Packets sent.
    pub packets: u64,
}

/// Puts packets together.
#[derive(Clone, Debug, Default)]
pub struct Recorder {
    packed: Vec<u8>,
    packets: u64,
    frames: u64,
    last: Option<FrameSent>,
}

impl Recorder {
    /// A packet that is sent.
    pub fn packet(&mut self, bytes: &[u8], packing: Packing) {
        let Ok(header) = Packet::new(bytes).map_err(|_| ()).and_then(|packet| Header::parse(&packet).map_err(|_| ())) else {
            return;
        };
        if header.place == Place::First {
            self.packed.clear();
            self.packets = 0;
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
            self.last = Some(FrameSent { frame: self.frames, ticks: header.timestamp_ticks, crc32: crc.sum(), packets: self.packets });
        }
        self.frames += 1;
    }

    /// The frame that ended since this was asked for.
    pub fn take(&mut self) -> Option<FrameSent> {
        self.last.take()
    }
}
