//! The video endpoint: colour as Bayer pixels, or the infra-red camera. What they show is a slope that wanders.

use super::Slot;
use super::registers::Picture;
use crate::kinect::packet::{Header, Place, Stream};
use std::vec::Vec;

/// Payload of every packet but a frame's last, bytes.
const PAYLOAD: usize = 1908;
/// Columns, px.
const WIDTH: usize = 640;
/// Microframes from one frame to the next, three times.
const MICROFRAMES: u64 = 800;
/// Ticks of the device's clock in a microframe.
const TICKS: u64 = 7500;

impl Picture {
    fn frame_bytes(self) -> usize {
        match self {
            Self::Bayer => WIDTH * 480,
            Self::Infrared => WIDTH * 488 / 8 * 10,
        }
    }
}

/// The stream of video.
#[derive(Clone, Debug, Default)]
pub struct Video {
    picture: Option<Picture>,
    /// Of the present frame.
    bytes: Vec<u8>,
    /// Its next packet.
    next: usize,
    sequence: u8,
    frame: u64,
    /// Since the stream was turned on first.
    microframe: u64,
    packet: Vec<u8>,
}

impl Video {
    pub(super) fn is_on(&self) -> bool {
        self.picture.is_some()
    }

    pub(super) fn turn(&mut self, picture: Option<Picture>) {
        if self.picture != picture {
            self.picture = picture;
            self.bytes.clear();
            self.next = 0;
        }
    }

    pub(super) fn next_packet(&mut self) -> Slot<'_> {
        self.packet.clear();
        if let Some(picture) = self.picture {
            self.fill(picture);
            self.microframe += 1;
        }
        Slot { bytes: &self.packet, trouble: None }
    }

    fn fill(&mut self, picture: Picture) {
        if self.next * PAYLOAD >= self.bytes.len() {
            if 3 * self.microframe < MICROFRAMES * self.frame {
                return;
            }
            self.frame += 1;
            self.next = 0;
            let slope = (0..picture.frame_bytes()).map(|i| (i % WIDTH + i / WIDTH + self.frame as usize) as u8);
            self.bytes.clear();
            self.bytes.extend(slope);
        }
        let payload = self.bytes.chunks(PAYLOAD).nth(self.next).unwrap_or_default();
        let (place, timestamp_ticks) = match self.next {
            0 => (Place::First, 0),
            next if (next + 1) * PAYLOAD >= self.bytes.len() => (Place::Last, (self.microframe * TICKS) as u32),
            _ => (Place::Middle, (self.microframe * TICKS) as u32),
        };
        let header = Header { stream: Stream::Video, place, sequence: self.sequence, timestamp_ticks };
        self.packet.extend(header.emit(payload.len() as u16));
        self.packet.extend(payload);
        self.next += 1;
        self.sequence = self.sequence.wrapping_add(1);
    }
}
