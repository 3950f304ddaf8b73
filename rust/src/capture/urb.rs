//! What usbmon tells of one USB request block (`struct usbmon_packet` in the kernel's Documentation/usb/usbmon.rst), by its bytes:
//!
//! | bytes | what |
//! |---|---|
//! | 0–7 | id: the same from submission to completion |
//! | 8, 9 | event: S, C or E; transfer: 0 isochronous, 2 control |
//! | 10, 11, 12–13 | endpoint (0x80: in), device, bus |
//! | 14, 15 | 0 where there is a setup packet; 0 where there is data |
//! | 16–23, 24–27 | time, s and µs |
//! | 28–31 | status, of a completion |
//! | 32–35, 36–39 | bytes of the transfer; bytes captured, descriptors and all |
//! | 40–47 | setup packet, or errors and number of descriptors |
//! | 48–63 | (link type 220 only) interval, start frame, flags, number of descriptors that follow |
//!
//! Then, of isochronous transfers, a descriptor of 16 bytes for each packet: status, offset, length, padding. Then the data.

use super::order::Order;
use super::records::{Link, Record};
use core::ops::Range;

/// The kernel tells of at most so many packets of a transfer.
pub(super) const MOST_PACKETS: usize = 128;

pub(super) const ISOCHRONOUS: u8 = 0;
pub(super) const CONTROL: u8 = 2;
pub(super) const SUBMISSION: u8 = b'S';
pub(super) const COMPLETION: u8 = b'C';
/// Bytes of a descriptor.
pub(super) const DESCRIPTOR: usize = 16;

impl Link {
    /// Bytes of its header.
    pub(super) fn header(self) -> usize {
        match self {
            Self::Usb48 => 48,
            Self::Usb64 => 64,
        }
    }
}

/// What the header says; ranges are of the bytes that the record's is of.
#[derive(Clone, Debug)]
pub(super) struct Urb {
    pub(super) event: u8,
    pub(super) transfer: u8,
    pub(super) endpoint: u8,
    /// Bus and address.
    pub(super) device: (u16, u8),
    pub(super) stamp_ns: i64,
    pub(super) order: Order,
    pub(super) descriptors: Range<usize>,
    pub(super) data: Range<usize>,
}

impl Urb {
    /// The header of `record`, whose bytes are in `bytes`; `None` where it is cut.
    pub(super) fn parse(record: &Record, bytes: &[u8]) -> Option<Self> {
        let (order, length) = (record.order, record.link.header());
        let header = bytes.get(record.bytes.clone())?.get(..length)?;
        let transfer = header[9];
        let count = match record.link {
            _ if transfer != ISOCHRONOUS => 0,
            Link::Usb48 => order.u32(header, 44),
            Link::Usb64 => order.u32(header, 60),
        };
        let count = (count as usize).min(MOST_PACKETS);
        let data = (record.bytes.start + length + count * DESCRIPTOR).min(record.bytes.end);
        let own_ns = || order.i64(header, 16).saturating_mul(1_000_000_000).saturating_add(i64::from(order.i32(header, 24)) * 1000);
        Some(Self {
            event: header[8],
            transfer,
            endpoint: header[10],
            device: (order.u16(header, 12), header[11]),
            stamp_ns: record.stamp_ns.unwrap_or_else(own_ns),
            order,
            descriptors: record.bytes.start + length..data,
            data: data..record.bytes.end,
        })
    }

    /// Packets of an isochronous transfer.
    pub(super) fn packets(&self) -> usize {
        self.descriptors.len() / DESCRIPTOR
    }

    /// Where packet `index` of an isochronous transfer is; an error where the transfer failed, or the capture cut it off.
    pub(super) fn packet(&self, index: usize, bytes: &[u8]) -> Result<Range<usize>, Absent> {
        let at = self.descriptors.start + index * DESCRIPTOR;
        let (status, offset, length) = (self.order.i32(bytes, at), self.order.u32(bytes, at + 4), self.order.u32(bytes, at + 8));
        if status != 0 {
            return Err(Absent::Failed);
        }
        let start = self.data.start.saturating_add(offset as usize);
        let end = start.saturating_add(length as usize);
        // An empty one needs no room.
        if length == 0 {
            return Ok(self.data.start..self.data.start);
        }
        if end <= self.data.end { Ok(start..end) } else { Err(Absent::Cut) }
    }
}

/// Why a packet isn't there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Absent {
    /// The bus says so.
    Failed,
    /// The capture keeps fewer bytes of it than it had.
    Cut,
}

/// A header of 64 bytes, to be written; little-endian, like the captures that this crate writes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Header {
    pub(super) id: u64,
    pub(super) event: u8,
    pub(super) transfer: u8,
    pub(super) endpoint: u8,
    pub(super) setup: Option<[u8; 8]>,
    pub(super) stamp_ns: i64,
    /// Bytes of the transfer: asked for, or come.
    pub(super) length: usize,
    /// Bytes of its data that follow.
    pub(super) data: usize,
    /// Packets of an isochronous transfer, each with a descriptor that follows.
    pub(super) packets: usize,
}

/// Where the camera is said to be.
const BUS: u16 = 1;
const ADDRESS: u8 = 2;
/// The status of a transfer that is on its way.
const IN_PROGRESS: i32 = -115;
/// As soon as possible, in.
const ISOCHRONOUS_FLAGS: u32 = 0x0202;

impl Header {
    pub(super) fn emit(&self) -> [u8; 64] {
        let mut bytes = [0; 64];
        let mut put = |at: usize, field: &[u8]| bytes[at..at + field.len()].copy_from_slice(field);
        let is_in = self.endpoint & 0x80 != 0;
        put(0, &self.id.to_le_bytes());
        put(8, &[self.event, self.transfer, self.endpoint, ADDRESS]);
        put(12, &BUS.to_le_bytes());
        put(
            14,
            &[
                if self.setup.is_some() { 0 } else { b'-' },
                if self.data > 0 {
                    0
                } else if is_in {
                    b'<'
                } else {
                    b'>'
                },
            ],
        );
        put(16, &self.stamp_ns.div_euclid(1_000_000_000).to_le_bytes());
        put(24, &((self.stamp_ns.rem_euclid(1_000_000_000) / 1000) as i32).to_le_bytes());
        put(28, &if self.event == SUBMISSION { IN_PROGRESS } else { 0 }.to_le_bytes());
        put(32, &(self.length as u32).to_le_bytes());
        put(36, &((self.data + self.packets * DESCRIPTOR) as u32).to_le_bytes());
        if self.transfer == ISOCHRONOUS {
            put(44, &(self.packets as u32).to_le_bytes());
            put(48, &1_u32.to_le_bytes());
            put(56, &ISOCHRONOUS_FLAGS.to_le_bytes());
            put(60, &(self.packets as u32).to_le_bytes());
        } else {
            put(40, &self.setup.unwrap_or_default());
            put(56, &(u32::from(is_in) << 9).to_le_bytes());
        }
        bytes
    }
}

/// A packet's descriptor, all well with it.
pub(super) fn descriptor(offset: usize, length: usize) -> [u8; DESCRIPTOR] {
    let mut bytes = [0; DESCRIPTOR];
    bytes[4..8].copy_from_slice(&(offset as u32).to_le_bytes());
    bytes[8..12].copy_from_slice(&(length as u32).to_le_bytes());
    bytes
}
