//! How the frames of a stream are cut into packets.

use super::disparity::Packing;
use super::packet::{DEPTH_PAYLOAD, Stream, VIDEO_PAYLOAD};
use super::video::Video;

/// What putting packets together needs to know of a stream. A frame has fewer than 256 packets.
pub trait Layout: Copy {
    /// Whose packets.
    const STREAM: Stream;
    /// Bytes of payload in every packet of a frame but its last.
    const PAYLOAD: usize;

    /// Bits of a sample.
    fn bits(self) -> usize;

    /// Packed bytes of a frame.
    fn frame_bytes(self) -> usize;

    /// Packets of a frame.
    fn packets(self) -> usize {
        self.frame_bytes().div_ceil(Self::PAYLOAD)
    }
}

impl Layout for Packing {
    const STREAM: Stream = Stream::Depth;
    const PAYLOAD: usize = DEPTH_PAYLOAD;

    fn bits(self) -> usize {
        self.bits()
    }

    fn frame_bytes(self) -> usize {
        self.frame_bytes()
    }
}

impl Layout for Video {
    const STREAM: Stream = Stream::Video;
    const PAYLOAD: usize = VIDEO_PAYLOAD;

    fn bits(self) -> usize {
        self.bits()
    }

    fn frame_bytes(self) -> usize {
        self.frame_bytes()
    }
}
