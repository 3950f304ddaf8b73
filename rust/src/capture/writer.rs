//! Packets into a capture: pcapng, link type 220, as usbmon tells of a camera that is being read.

use super::Output;
use super::urb::{COMPLETION, CONTROL, DESCRIPTOR, Header, ISOCHRONOUS, MOST_PACKETS, SUBMISSION, descriptor};
use crate::kinect::calibration::ZeroPlane;
use crate::kinect::command::{Command, HEADER, REPLY_SIZE, Reply, code};
use crate::kinect::disparity::Packing;
use crate::kinect::model::{DEPTH_ENDPOINT, SLOT};
use crate::kinect::session::depth_registers;
use std::io::{self, Write};
use std::path::Path;
use std::vec::Vec;

/// What was written is flushed after so much of the stream's time, forward or back, ns.
const FLUSH_NS: u64 = 1_000_000_000;
/// The device descriptor of a Kinect's camera, model 1414: 045e:02ae, 1.0b.
const DEVICE: [u8; 18] = [18, 1, 0, 2, 0, 0, 0, 64, 0x5e, 0x04, 0xae, 0x02, 0x0b, 0x01, 2, 1, 3, 1];

/// Writes packets as the transfers that brought them: those that arrived at the same time, up to 128, are one transfer.
///
/// What was flushed, once in a second of the stream, can be read back whatever happens then.
pub struct Writer<W: Write> {
    out: W,
    /// Of transfers.
    last_id: u64,
    /// Of commands.
    last_tag: u16,
    arrival_ns: i64,
    lengths: Vec<usize>,
    data: Vec<u8>,
    flushed_ns: Option<i64>,
}

impl Writer<Output> {
    /// The capture `path`, packed as its name says; see [`Output::create`].
    ///
    /// # Errors
    /// Whatever the operating system refuses.
    pub fn create(path: &Path, level: Option<u8>) -> io::Result<Self> {
        Self::new(Output::create(path, level)?)
    }

    /// Completes the file.
    ///
    /// # Errors
    /// Whatever the operating system refuses.
    pub fn close(self) -> io::Result<()> {
        self.finish()?.finish()
    }
}

impl<W: Write> Writer<W> {
    /// Begins a capture in `out`.
    ///
    /// # Errors
    /// Whatever `out` refuses.
    pub fn new(mut out: W) -> io::Result<Self> {
        // A section of unknown length; an interface of link type 220 whose stamps are nanoseconds.
        block(&mut out, 0x0a0d_0d0a, &[&0x1a2b_3c4d_u32.to_le_bytes(), &[1, 0, 0, 0], &[0xff; 8]])?;
        block(&mut out, 1, &[&[220, 0, 0, 0], &[0; 4], &[9, 0, 1, 0, 9, 0, 0, 0], &[0; 4]])?;
        Ok(Self { out, last_id: 0, last_tag: 0, arrival_ns: 0, lengths: Vec::new(), data: Vec::new(), flushed_ns: None })
    }

    /// What comes before the packets where a capture is begun first: the camera's descriptor, its zero plane, and the start of its depth,
    /// at `at_ns`.
    ///
    /// # Errors
    /// Whatever `out` refuses.
    pub fn introduce(&mut self, zero_plane: Option<&ZeroPlane>, packing: Packing, at_ns: i64) -> io::Result<()> {
        self.control([0x80, 6, 0, 1, 0, 0, DEVICE.len() as u8, 0], &DEVICE, at_ns)?;
        if let Some(plane) = zero_plane {
            let (fixed_parameters, shift) = plane.replies();
            self.command(code::FIXED_PARAMETERS, &[0; 2], &fixed_parameters, at_ns)?;
            self.command(code::MODE_PARAMETERS, &[0, 0, 0, 0, 1, 0, 0x1e, 0, 0, 0], &shift, at_ns)?;
        }
        for (register, value) in depth_registers(packing) {
            let [[a, b], [c, d]] = [register, value].map(u16::to_le_bytes);
            self.command(code::WRITE_REGISTER, &[a, b, c, d], &[], at_ns)?;
        }
        Ok(())
    }

    /// A packet of the depth endpoint, empty ones too.
    ///
    /// # Errors
    /// Whatever `out` refuses.
    pub fn packet(&mut self, bytes: &[u8], arrival_ns: i64) -> io::Result<()> {
        if arrival_ns != self.arrival_ns || self.lengths.len() == MOST_PACKETS {
            self.transfer()?;
        }
        self.arrival_ns = arrival_ns;
        self.lengths.push(bytes.len());
        self.data.extend_from_slice(bytes);
        Ok(())
    }

    /// Writes what is left.
    ///
    /// # Errors
    /// Whatever `out` refuses.
    pub fn finish(mut self) -> io::Result<W> {
        self.transfer()?;
        self.out.flush()?;
        Ok(self.out)
    }

    /// The isochronous transfer that brought the packets, submitted and completed.
    fn transfer(&mut self) -> io::Result<()> {
        let packets = self.lengths.len();
        if packets == 0 {
            return Ok(());
        }
        self.last_id += 1;
        let submission = Header {
            id: self.last_id,
            event: SUBMISSION,
            transfer: ISOCHRONOUS,
            endpoint: DEPTH_ENDPOINT,
            setup: None,
            stamp_ns: self.arrival_ns,
            length: packets * SLOT,
            data: 0,
            packets,
        };
        let slots: Vec<u8> = (0..packets).flat_map(|i| descriptor(i * SLOT, SLOT)).collect();
        record(&mut self.out, &submission, &[&slots])?;
        let mut offset = 0;
        let mut descriptors = Vec::with_capacity(packets * DESCRIPTOR);
        for length in self.lengths.drain(..) {
            descriptors.extend(descriptor(offset, length));
            offset += length;
        }
        let completion = Header { event: COMPLETION, length: offset, data: offset, ..submission };
        record(&mut self.out, &completion, &[&descriptors, &self.data])?;
        self.data.clear();
        if self.arrival_ns.abs_diff(*self.flushed_ns.get_or_insert(self.arrival_ns)) >= FLUSH_NS {
            self.out.flush()?;
            self.flushed_ns = Some(self.arrival_ns);
        }
        Ok(())
    }

    /// A command and its reply.
    fn command(&mut self, command: u16, payload: &[u8], reply: &[u8], at_ns: i64) -> io::Result<()> {
        let impossible = io::Error::other;
        let (tag, mut bytes) = (self.last_tag, [0; REPLY_SIZE]);
        self.last_tag += 1;
        let length = Command { command, tag, payload }.emit(&mut bytes).map_err(impossible)?;
        self.control([0x40, 0, 0, 0, 0, 0, (HEADER + payload.len()) as u8, 0], &bytes[..length], at_ns)?;
        let length = Reply { command, tag, status: 0, payload: reply }.emit(&mut bytes).map_err(impossible)?;
        let [low, high] = (REPLY_SIZE as u16).to_le_bytes();
        self.control([0xc0, 0, 0, 0, 0, 0, low, high], &bytes[..length], at_ns)
    }

    /// A control transfer, submitted and completed: its data goes out with the one, or comes in with the other.
    fn control(&mut self, setup: [u8; 8], data: &[u8], at_ns: i64) -> io::Result<()> {
        self.last_id += 1;
        let is_in = setup[0] & 0x80 != 0;
        let (out, come): (&[u8], &[u8]) = if is_in { (&[], data) } else { (data, &[]) };
        let submission = Header {
            id: self.last_id,
            event: SUBMISSION,
            transfer: CONTROL,
            endpoint: setup[0] & 0x80,
            setup: Some(setup),
            stamp_ns: at_ns,
            length: u16::from_le_bytes([setup[6], setup[7]]).into(),
            data: out.len(),
            packets: 0,
        };
        record(&mut self.out, &submission, &[out])?;
        let completion = Header { event: COMPLETION, setup: None, length: data.len(), data: come.len(), ..submission };
        record(&mut self.out, &completion, &[come])
    }
}

/// An enhanced packet block.
fn record(out: &mut impl Write, header: &Header, rest: &[&[u8]]) -> io::Result<()> {
    let header_bytes = header.emit();
    let length = (header_bytes.len() + rest.iter().map(|part| part.len()).sum::<usize>()) as u32;
    let stamp = header.stamp_ns.max(0) as u64;
    let [high, low] = [(stamp >> 32) as u32, stamp as u32].map(u32::to_le_bytes);
    let [first, second] = [rest.first(), rest.get(1)].map(|part| part.copied().unwrap_or_default());
    let padding = &[0; 3][..(length.next_multiple_of(4) - length) as usize];
    block(out, 6, &[&[0; 4], &high, &low, &length.to_le_bytes(), &length.to_le_bytes(), &header_bytes, first, second, padding])
}

/// A block whose body is a multiple of 4 bytes.
fn block(out: &mut impl Write, kind: u32, body: &[&[u8]]) -> io::Result<()> {
    let length = (12 + body.iter().map(|part| part.len()).sum::<usize>()) as u32;
    out.write_all(&kind.to_le_bytes())?;
    out.write_all(&length.to_le_bytes())?;
    body.iter().try_for_each(|part| out.write_all(part))?;
    out.write_all(&length.to_le_bytes())
}
