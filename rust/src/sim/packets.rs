//! A scene as the packets that a Kinect sends: one a microframe, 242 a frame (220 of 10 bits) and empty ones between frames.

use super::scene::{Frames, Scene};
use super::sensor::{BASELINE, FOCAL, RAW_AT_INFINITY};
use crate::kinect::calibration::ZeroPlane;
use crate::kinect::disparity::Packing;
use crate::kinect::packet::{DEPTH_PAYLOAD, Header, Place, Stream};
use std::vec::Vec;

/// Of the USB at high speed, ns.
const MICROFRAME_NS: i64 = 125_000;
/// Packets of a transfer, which arrive together when the last one has.
const TRANSFER: i64 = 16;
/// The device's clock begins at this time of the host's, ns.
const HOST_NS: i64 = 1_288_828_800_000_000_000;
/// More empty packets than this are not sent in a row: where frames are lost, so are their packets.
const MOST_EMPTY: i64 = 32;
/// The disparity of the zero plane, in quarters of which raw counts, and what the device adds to it.
const SHIFT: (u16, f64) = (200, 0.375);

/// The zero plane of the simulated sensor: the law that [`super::sensor::disparity_law`] is, but for its floats of 32 bits.
pub fn zero_plane() -> ZeroPlane {
    let emitter_cm = 100.0 * BASELINE;
    let pixel_cm = emitter_cm / (0.25 * RAW_AT_INFINITY - SHIFT.1 - f64::from(SHIFT.0));
    let reference_cm = 2.0 * FOCAL * pixel_cm;
    ZeroPlane { emitter_cm: emitter_cm as f32, rcmos_cm: 2.3, reference_cm: reference_cm as f32, pixel_cm: pixel_cm as f32, shift: SHIFT.0 }
}

/// Renders a scene packet by packet.
#[derive(Clone, Debug)]
pub struct Packets {
    frames: Frames,
    is_endless: bool,
    packing: Packing,
    packed: Vec<u8>,
    packet: Vec<u8>,
    /// Of the present frame: its stamp, the sequence of its first packet, and the next packet.
    ticks: u32,
    base: u8,
    next: usize,
    /// Empty packets to come before it.
    empty: i64,
    /// Of the next packet, since the device's clock began.
    microframe: i64,
}

impl Packets {
    /// From the first frame of `scene`, whose samples must be disparity.
    pub fn new(scene: &Scene) -> Self {
        let packing = Packing::Eleven;
        Self {
            frames: scene.frames(),
            is_endless: false,
            packing,
            packed: Vec::new(),
            packet: Vec::new(),
            ticks: 0,
            base: 0,
            next: packing.packets(),
            empty: 0,
            microframe: 0,
        }
    }

    /// As of [`Packets::new`]; after the last frame the scene begins again, while sequence and time go on.
    pub fn endless(scene: &Scene) -> Self {
        Self { is_endless: true, ..Self::new(scene) }
    }

    /// How frames are packed from the next one on. In 10 bits the lowest of the 11 is missing.
    pub fn set_packing(&mut self, packing: Packing) {
        if self.packing != packing {
            self.packing = packing;
            self.next = Packing::Eleven.packets();
        }
    }

    /// The next packet, all of it, and when it arrives on the host's clock, ns; `None` after the last frame.
    pub fn next_packet(&mut self) -> Option<(&[u8], i64)> {
        if self.next >= self.packing.packets() {
            self.next_frame()?;
        }
        let last = self.packing.packets() - 1;
        let arrival_ns = HOST_NS + (self.microframe / TRANSFER + 1) * TRANSFER * MICROFRAME_NS;
        self.microframe += 1;
        self.packet.clear();
        if self.empty > 0 {
            self.empty -= 1;
            return Some((&self.packet, arrival_ns));
        }
        let index = self.next;
        self.next += 1;
        let (place, timestamp_ticks) = match index {
            0 => (Place::First, 0),
            _ if index == last => (Place::Last, self.ticks),
            _ => (Place::Middle, self.ticks),
        };
        let payload = self.packed.chunks(DEPTH_PAYLOAD).nth(index)?;
        let header = Header { stream: Stream::Depth, place, sequence: self.base.wrapping_add(index as u8), timestamp_ticks };
        self.packet.extend_from_slice(&header.emit(payload.len() as u16));
        self.packet.extend_from_slice(payload);
        Some((&self.packet, arrival_ns))
    }

    /// Renders the next frame and awaits its first microframe.
    fn next_frame(&mut self) -> Option<()> {
        let packing = self.packing;
        if self.is_endless {
            self.frames.begin_again_at_end();
        }
        let frame = self.frames.next_frame()?;
        self.packed.resize(packing.frame_bytes(), 0);
        match packing {
            Packing::Eleven => packing.pack(frame.samples, &mut self.packed),
            Packing::Ten => packing.pack(&frame.samples.iter().map(|sample| sample >> 1).collect::<Vec<u16>>(), &mut self.packed),
        }
        .ok()?;
        self.ticks = frame.ticks;
        // Frames that were lost had their sequence numbers, too.
        self.base = (frame.number * packing.packets() as u64) as u8;
        let begins = frame.timestamp_ns.div_euclid(MICROFRAME_NS) + 1;
        self.empty = (begins - self.microframe).clamp(0, MOST_EMPTY);
        self.microframe = self.microframe.max(begins - self.empty);
        self.next = 0;
        Some(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::sensor::disparity_law;
    use super::*;

    #[test]
    fn the_zero_plane_tells_the_sensors_law() {
        let plane = zero_plane();
        assert!(plane.law().iter().zip(disparity_law()).all(|(told, law)| (told / law - 1.0).abs() < 1e-6), "{plane:?}");
        assert!((plane.focal_length_px() / FOCAL - 1.0).abs() < 1e-6);
    }
}
