//! `struct usbdevfs_urb` as it stands in a program's memory, on machines of 64 bits.

use crate::preload::Caller;
use rustix::io::Errno;
use std::io;

/// Bytes before the packets' descriptors, and of each of those.
const HEAD: usize = 56;
const DESCRIPTOR: usize = 12;
/// What the kernel refuses to take more of.
const MOST_PACKETS: usize = 128;

/// Kinds of transfers.
pub const ISOCHRONOUS: u8 = 0;
/// Likewise.
pub const CONTROL: u8 = 2;

/// A packet of an isochronous transfer, once it came.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Came {
    /// Bytes.
    pub length: u32,
    /// 0, or a negative error number.
    pub status: i32,
}

/// A transfer that a program submitted.
#[derive(Clone, Debug)]
pub struct Urb {
    /// Where it stands in the program's memory: its name.
    pub address: u64,
    /// One of the kinds.
    pub kind: u8,
    /// Its endpoint.
    pub endpoint: u8,
    buffer: u64,
    /// Of the buffer.
    pub length: usize,
    /// Room for each packet.
    pub slots: Vec<u32>,
    /// What goes to the device: of a control transfer its setup and what follows.
    pub out: Vec<u8>,
}

/// A transfer that is over.
#[derive(Clone, Debug)]
pub struct Done {
    /// Which.
    pub urb: Urb,
    /// 0, or a negative error number.
    pub status: i32,
    /// Bytes that came or went, without the gaps between packets.
    pub actual: usize,
    /// What came, with gaps.
    pub bytes: Vec<u8>,
    /// Of an isochronous transfer.
    pub packets: Vec<Came>,
}

impl Urb {
    /// Fetches it; `None` where it can't be one.
    pub fn fetch(caller: &mut Caller, address: u64) -> io::Result<Option<Self>> {
        let head = caller.read(address, HEAD)?;
        let number = |at: usize| head[at..].first_chunk().map_or(0, |b| i32::from_ne_bytes(*b));
        let (kind, endpoint) = (head[0], head[1]);
        let (length, packets) = (number(24), number(36));
        let Ok(length) = usize::try_from(length) else { return Ok(None) };
        let mut slots = Vec::new();
        if kind == ISOCHRONOUS {
            let Some(packets) = usize::try_from(packets).ok().filter(|n| (1..=MOST_PACKETS).contains(n)) else { return Ok(None) };
            let descriptors = caller.read(address + HEAD as u64, packets * DESCRIPTOR)?;
            slots.extend(descriptors.as_chunks::<DESCRIPTOR>().0.iter().map(|d| u32::from_ne_bytes([d[0], d[1], d[2], d[3]])));
        }
        let buffer = head[16..].first_chunk().map_or(0, |b| u64::from_ne_bytes(*b));
        let fetched = if kind != CONTROL && endpoint & 0x80 != 0 { 0 } else { length };
        let out = caller.read(buffer, fetched)?;
        Ok(Some(Self { address, kind, endpoint, buffer, length, slots, out }))
    }

    /// Not a program's, but the kernel's.
    pub fn received(address: u64, kind: u8, endpoint: u8, length: usize, slots: Vec<u32>, out: Vec<u8>) -> Self {
        Self { address, kind, endpoint, buffer: 0, length, slots, out }
    }

    /// It ended well.
    pub fn succeed(self, actual: usize, bytes: Vec<u8>, packets: Vec<Came>) -> Done {
        Done { urb: self, status: 0, actual, bytes, packets }
    }

    /// It ended without a byte.
    pub fn fail(self, errno: Errno) -> Done {
        let packets = vec![Came { length: 0, status: -Errno::XDEV.raw_os_error() }; self.slots.len()];
        Done { urb: self, status: -errno.raw_os_error(), actual: 0, bytes: Vec::new(), packets }
    }
}

impl Done {
    /// Writes into the program's memory what the kernel would.
    pub fn deliver(&self, caller: &mut Caller) -> io::Result<()> {
        let urb = &self.urb;
        let data = if urb.kind == CONTROL { urb.buffer + 8 } else { urb.buffer };
        caller.write(data, &self.bytes)?;
        let errors = self.packets.iter().filter(|packet| packet.status != 0).count();
        caller.write(urb.address + 4, &self.status.to_ne_bytes())?;
        caller.write(urb.address + 28, &(self.actual as i32).to_ne_bytes())?;
        caller.write(urb.address + 40, &(errors as i32).to_ne_bytes())?;
        let words = urb.slots.iter().zip(&self.packets).flat_map(|(slot, packet)| [*slot, packet.length, packet.status.cast_unsigned()]);
        caller.write(urb.address + HEAD as u64, &words.flat_map(u32::to_ne_bytes).collect::<Vec<u8>>())
    }
}
