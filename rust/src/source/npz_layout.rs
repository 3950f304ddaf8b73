//! The bytes of an `*.npz` around its samples: a zip of two arrays, of which the first grows.

use flate2::Crc;
use std::format;
use std::string::String;
use std::vec::Vec;

/// The array of stamps.
const STAMPS: &str = "timestamps_ns.npy";
/// Bytes of an array's header, padded.
const ARRAY_HEADER: usize = 128;
/// How entries are stored.
const PLAIN: u16 = 0;
const DEFLATED: u16 = 8;
/// What a deflated entry ends with, on a byte's boundary: a last block without content.
const LAST_BLOCK: [u8; 2] = [3, 0];
/// The version of zip that has sizes of 64 bits, and that they stand elsewhere.
const ZIP64: u16 = 45;
const ELSEWHERE: u32 = u32::MAX;
/// The first of January 1980, when zip's time begins.
const DATE: u16 = 0x21;

/// An archive of so many frames.
pub(super) struct Layout<'a> {
    /// Name of the array of frames.
    pub key: &'a str,
    /// Height and width of a frame.
    pub size: [usize; 2],
    /// Stamp of each frame.
    pub stamps: &'a [i64],
    /// Of all samples.
    pub samples: &'a Crc,
    /// Deflated samples, bytes.
    pub packed: u64,
}

impl Layout<'_> {
    /// What stands before the deflated samples; as long whatever they are.
    pub(super) fn head(&self) -> Vec<u8> {
        let mut bytes = self.frames().header();
        bytes.extend(stored(&self.header()));
        bytes
    }

    /// What stands behind them.
    pub(super) fn tail(&self) -> Vec<u8> {
        let frames = self.frames();
        let mut stamps = array_header("<i8", &format!("{},", self.stamps.len()));
        stamps.extend(self.stamps.iter().flat_map(|stamp| stamp.to_le_bytes()));
        let mut crc = Crc::new();
        crc.update(&stamps);
        let stamps_entry = Entry {
            name: STAMPS.into(),
            method: PLAIN,
            crc: crc.sum(),
            packed: stamps.len() as u64,
            unpacked: stamps.len() as u64,
            start: frames.header().len() as u64 + frames.packed,
        };
        let mut bytes = LAST_BLOCK.to_vec();
        bytes.extend(stamps_entry.header());
        bytes.extend(stamps);
        let directory = [frames.in_directory(), stamps_entry.in_directory()].concat();
        let start = stamps_entry.start + stamps_entry.header().len() as u64 + stamps_entry.packed;
        bytes.extend(&directory);
        bytes.extend(end(start, directory.len() as u64));
        bytes
    }

    fn header(&self) -> Vec<u8> {
        array_header("<u2", &format!("{}, {}, {}", self.stamps.len(), self.size[0], self.size[1]))
    }

    fn frames(&self) -> Entry {
        let header = self.header();
        let mut crc = Crc::new();
        crc.update(&header);
        crc.combine(self.samples);
        let packed = (stored(&header).len() + LAST_BLOCK.len()) as u64 + self.packed;
        let unpacked = (ARRAY_HEADER + 2 * self.stamps.len() * self.size[0] * self.size[1]) as u64;
        Entry { name: format!("{}.npy", self.key), method: DEFLATED, crc: crc.sum(), packed, unpacked, start: 0 }
    }
}

/// Version 1.0, C order.
fn array_header(kind: &str, shape: &str) -> Vec<u8> {
    let text = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': ({shape}), }}");
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((ARRAY_HEADER as u16 - 10).to_le_bytes());
    bytes.extend(text.as_bytes());
    bytes.resize(ARRAY_HEADER - 1, b' ');
    bytes.push(b'\n');
    bytes
}

/// A block of a deflated stream that is stored as it is, and not the last.
fn stored(content: &[u8]) -> Vec<u8> {
    let length = content.len() as u16;
    [&[0][..], &length.to_le_bytes(), &(!length).to_le_bytes(), content].concat()
}

struct Entry {
    name: String,
    method: u16,
    crc: u32,
    packed: u64,
    unpacked: u64,
    /// Where its header begins.
    start: u64,
}

impl Entry {
    /// What stands before its content.
    fn header(&self) -> Vec<u8> {
        let sizes = [self.unpacked.to_le_bytes(), self.packed.to_le_bytes()].concat();
        [&b"PK\x03\x04"[..], &self.description(sizes.len()), self.name.as_bytes(), &extra(&sizes)].concat()
    }

    /// What the directory tells of it.
    fn in_directory(&self) -> Vec<u8> {
        let sizes = [self.unpacked.to_le_bytes(), self.packed.to_le_bytes(), self.start.to_le_bytes()].concat();
        let made_by = ZIP64.to_le_bytes();
        // No comment, the first disk, no attributes.
        let rest = [&[0; 10][..], &ELSEWHERE.to_le_bytes()].concat();
        [&b"PK\x01\x02"[..], &made_by, &self.description(sizes.len()), &rest, self.name.as_bytes(), &extra(&sizes)].concat()
    }

    fn description(&self, sizes: usize) -> Vec<u8> {
        let words = [ZIP64, 0, self.method, 0, DATE].map(u16::to_le_bytes).concat();
        let lengths = [self.name.len() as u16, 4 + sizes as u16].map(u16::to_le_bytes).concat();
        [words, [self.crc, ELSEWHERE, ELSEWHERE].map(u32::to_le_bytes).concat(), lengths].concat()
    }
}

/// The extra field of sizes of 64 bits.
fn extra(sizes: &[u8]) -> Vec<u8> {
    [&1_u16.to_le_bytes()[..], &(sizes.len() as u16).to_le_bytes(), sizes].concat()
}

/// The end of an archive of two entries whose directory begins at `start`.
fn end(start: u64, length: u64) -> Vec<u8> {
    let zip64 =
        [&44_u64.to_le_bytes()[..], &[ZIP64.to_le_bytes(); 2].concat(), &[0; 8], &[2, 2, length, start].map(u64::to_le_bytes).concat()];
    let locator = [&[0; 4][..], &(start + length).to_le_bytes(), &1_u32.to_le_bytes()];
    let old = [&[0; 4][..], &[2_u16.to_le_bytes(); 2].concat(), &[ELSEWHERE.to_le_bytes(); 2].concat(), &[0; 2]];
    [b"PK\x06\x06", &zip64.concat()[..], b"PK\x06\x07", &locator.concat(), b"PK\x05\x06", &old.concat()].concat()
}
