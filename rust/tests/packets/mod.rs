//! Frames as the packets that a Kinect sends.

use physinc::kinect::disparity::Packing;
use physinc::kinect::packet::{DEPTH_PAYLOAD, Header, Place, Stream};

/// The packets of a frame of `samples` at `ticks`, from sequence `base` on.
pub fn packets(packing: Packing, samples: &[u16], ticks: u32, base: u8) -> Vec<Vec<u8>> {
    let mut packed = vec![0; packing.frame_bytes()];
    packing.pack(samples, &mut packed).expect("a frame");
    let last = packing.packets() - 1;
    let packet = |(i, payload): (usize, &[u8])| {
        let (place, timestamp_ticks) = match i {
            0 => (Place::First, 0),
            _ if i == last => (Place::Last, ticks),
            _ => (Place::Middle, ticks),
        };
        let header = Header { stream: Stream::Depth, place, sequence: base.wrapping_add(i as u8), timestamp_ticks };
        [&header.emit(payload.len() as u16)[..], payload].concat()
    };
    packed.chunks(DEPTH_PAYLOAD).enumerate().map(packet).collect()
}

/// The tick nearest to a stamp.
#[allow(dead_code)] // Not every test needs it.
pub fn ticks(timestamp_ns: i64) -> u32 {
    ((timestamp_ns * 3 + 25) / 50) as u32
}
