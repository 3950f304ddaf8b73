//! The Kinect v1's own bytes: packets, packed disparity, control messages. Nothing here opens a device.

pub mod calibration;
pub mod command;
pub mod disparity;
pub mod layout;
pub mod model;
pub mod packet;
pub mod session;
pub mod video;

/// The little-endian 16 bits at `at`; 0 beyond the end.
fn le16(bytes: &[u8], at: usize) -> u16 {
    bytes.get(at..).and_then(<[u8]>::first_chunk).map_or(0, |b| u16::from_le_bytes(*b))
}

/// The little-endian 32 bits at `at`; 0 beyond the end.
fn le32(bytes: &[u8], at: usize) -> u32 {
    bytes.get(at..).and_then(<[u8]>::first_chunk).map_or(0, |b| u32::from_le_bytes(*b))
}
