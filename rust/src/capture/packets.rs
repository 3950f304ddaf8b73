//! The depth packets of the first Kinect in a capture.

use super::bus::Bus;
use super::records::Records;
use super::unpacked;
use super::urb::{Absent, COMPLETION, CONTROL, ISOCHRONOUS, Urb};
use crate::kinect::calibration::ZeroPlane;
use crate::kinect::disparity::Packing;
use crate::kinect::model::DEPTH_ENDPOINT;
use crate::kinect::packet::{DEPTH_PAYLOAD, Header, Packet, Place, Stream};
use core::ops::Range;
use std::boxed::Box;
use std::format;
use std::io::{self, Read};
use std::path::Path;
use std::string::String;
use std::vec::Vec;

/// A Kinect must show within so much of a capture, bytes: else whoever waits for it would wait for ever.
const SEARCHED: u64 = 1 << 30;
/// Packets that are looked at to see how a frame is packed: two frames have fewer.
const MOST_HELD: usize = 512;

/// Reads packets one by one.
pub struct Packets {
    records: Records<Box<dyn Read + Send>>,
    bus: Bus,
    /// Bus and address of the camera.
    place: (u16, u8),
    packing: Packing,
    zero_plane: Option<ZeroPlane>,
    held: Held,
    /// The transfer that is being handed out, and its next packet.
    urb: Option<(Urb, usize)>,
    /// What ends the capture, after what was held.
    broken: Option<String>,
    others: Vec<(u16, u8)>,
    cut: u64,
}

/// Packets that were read to see how they are packed.
#[derive(Debug, Default)]
struct Held {
    bytes: Vec<u8>,
    packets: Vec<Found>,
    next: usize,
}

/// When a packet arrived, and where it is in [`Records::bytes`].
type Found = (i64, Range<usize>);

impl Packets {
    /// Opens the capture at `path` and finds the Kinect in it. Errors say what is wrong, in one line.
    ///
    /// # Errors
    /// The file can't be opened, in the outer result; it is no capture of a Kinect, in the inner one.
    pub fn open(path: &Path) -> io::Result<Result<Self, String>> {
        Ok(Self::new(unpacked::open(path)?))
    }

    /// Finds the Kinect in the capture that `input` is, packed or not.
    ///
    /// # Errors
    /// As of [`Packets::open`].
    pub fn read(input: impl Read + Send + 'static) -> io::Result<Result<Self, String>> {
        Ok(Self::new(unpacked::unpack(input)?))
    }

    fn new(input: Box<dyn Read + Send>) -> Result<Self, String> {
        let mut packets = Self {
            records: Records::new(input),
            bus: Bus::default(),
            place: (0, 0),
            packing: Packing::Eleven,
            zero_plane: None,
            held: Held::default(),
            urb: None,
            broken: None,
            others: Vec::new(),
            cut: 0,
        };
        packets.records.limit(SEARCHED);
        packets.search()?;
        packets.records.limit(u64::MAX);
        Ok(packets)
    }

    /// How the camera packs its frames.
    pub fn packing(&self) -> Packing {
        self.packing
    }

    /// The camera's own zero plane, if the capture shows how it was asked for.
    pub fn zero_plane(&self) -> Option<ZeroPlane> {
        self.zero_plane
    }

    /// What else the user should know, a line each.
    pub fn remarks(&self) -> Vec<String> {
        let (bus, address) = self.place;
        let others = self.others.iter().map(|(other_bus, other)| {
            format!("device {other} on bus {other_bus} is a Kinect, too: read is the first, device {address} on bus {bus}")
        });
        let cut =
            (self.cut > 0).then(|| format!("the capture cut {} packets off (counted as lost): tcpdump -s 245824 keeps them", self.cut));
        others.chain(cut).collect()
    }

    /// The next packet, and when it arrived on the host's clock, ns. Those that failed on the bus or were cut off by the capture are not
    /// there.
    ///
    /// # Errors
    /// The capture is cut or broken; there is no next packet then.
    pub fn next_packet(&mut self) -> Result<Option<(&[u8], i64)>, String> {
        if self.held.next < self.held.packets.len() {
            let (stamp, range) = self.held.packets[self.held.next].clone();
            self.held.next += 1;
            return Ok(Some((&self.held.bytes[range], stamp)));
        }
        if let Some(what) = &self.broken {
            return Err(what.clone());
        }
        if self.held.next > 0 {
            self.held = Held::default();
        }
        let found = self.advance()?;
        Ok(found.map(|(stamp, range)| (&self.records.bytes()[range], stamp)))
    }

    /// The next packet of the camera.
    fn advance(&mut self) -> Result<Option<Found>, String> {
        loop {
            while let Some((urb, index)) = &mut self.urb
                && *index < urb.packets()
            {
                *index += 1;
                match urb.packet(*index - 1, self.records.bytes()) {
                    Ok(range) => return Ok(Some((urb.stamp_ns, range))),
                    Err(Absent::Cut) => self.cut += 1,
                    Err(Absent::Failed) => {}
                }
            }
            self.urb = None;
            let Some(urb) = self.next_depth()? else { return Ok(None) };
            if urb.device == self.place {
                self.urb = Some((urb, 0));
            } else if !self.others.contains(&urb.device) && self.others.len() < 8 && self.sends_depth(&urb) {
                self.others.push(urb.device);
            }
        }
    }

    /// The next transfer from a depth endpoint; on the way, control transfers are taken note of.
    fn next_depth(&mut self) -> Result<Option<Urb>, String> {
        while let Some(record) = self.records.next()? {
            let bytes = self.records.bytes();
            let Some(urb) = Urb::parse(&record, bytes) else { continue };
            match urb.transfer {
                CONTROL => self.bus.control(&urb, &bytes[urb.data.clone()]),
                ISOCHRONOUS if urb.event == COMPLETION && urb.endpoint == DEPTH_ENDPOINT => return Ok(Some(urb)),
                _ => {}
            }
        }
        Ok(None)
    }

    /// Whether a transfer brought a Kinect's depth.
    fn sends_depth(&self, urb: &Urb) -> bool {
        let bytes = self.records.bytes();
        (0..urb.packets()).filter_map(|index| urb.packet(index, bytes).ok()).any(|range| header(&bytes[range]).is_some())
    }

    /// Reads on until it is known which device is the camera, and how it packs.
    fn search(&mut self) -> Result<(), String> {
        let mut cut = 0;
        let urb = loop {
            let Some(urb) = self.next_depth()? else { return Err(self.why_none(cut)) };
            if self.sends_depth(&urb) {
                break urb;
            }
            cut += (0..urb.packets()).filter(|index| urb.packet(*index, self.records.bytes()) == Err(Absent::Cut)).count();
        };
        self.place = urb.device;
        self.urb = Some((urb, 0));
        let device = self.bus.device(self.place);
        self.zero_plane = device.zero_plane();
        let mut packing = device.packing;
        while packing.is_none() && self.held.packets.len() < MOST_HELD {
            let (stamp, range) = match self.advance() {
                Ok(Some(found)) => found,
                Ok(None) => break,
                Err(what) => {
                    self.broken = Some(what);
                    break;
                }
            };
            let bytes = &self.records.bytes()[range];
            packing = packing_of(bytes);
            let start = self.held.bytes.len();
            self.held.bytes.extend_from_slice(bytes);
            self.held.packets.push((stamp, start..self.held.bytes.len()));
        }
        self.packing = packing.unwrap_or_default();
        Ok(())
    }

    fn why_none(&self, cut: usize) -> String {
        let searched = if self.records.is_beyond() { "the first GiB of it" } else { "it" };
        if let Some(why) = self.records.why_none() {
            return why;
        }
        if cut > 0 {
            return format!(
                "its packets are cut off by the capture: tcpdump -s 245824 keeps them ({cut} packets of a depth endpoint in {searched})"
            );
        }
        match self.bus.camera() {
            Some((bus, address)) => {
                format!("no depth in {searched}: the Kinect, device {address} on bus {bus}, sends none; start one while capturing")
            }
            None => format!("no Kinect in {searched}: no device sends depth packets from its endpoint 0x82"),
        }
    }
}

/// The header, if it is that of a packet of depth.
fn header(bytes: &[u8]) -> Option<Header> {
    let header = Header::parse(&Packet::new(bytes).ok()?).ok()?;
    (header.stream == Stream::Depth).then_some(header)
}

/// How the frame that `bytes` is the last packet of is packed: its length tells.
fn packing_of(bytes: &[u8]) -> Option<Packing> {
    header(bytes).filter(|header| header.place == Place::Last)?;
    let payload = Packet::new(bytes).ok()?.payload().len();
    [Packing::Eleven, Packing::Ten].into_iter().find(|packing| payload == packing.frame_bytes() % DEPTH_PAYLOAD)
}
