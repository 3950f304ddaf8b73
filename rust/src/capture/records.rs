//! pcap and pcapng to records, one at a time: <https://www.ietf.org/archive/id/draft-ietf-opsawg-pcap-04.html> and its sibling for pcapng.

use super::interface::{Interface, Link, Resolution, foreign};
use super::order::Order;
use super::unpacked::Window;
use core::ops::Range;
use std::format;
use std::io::{ErrorKind, Read};
use std::string::String;
use std::vec::Vec;

/// The largest block or record that is believed, bytes; usbmon's are a few hundred KiB at most.
const LARGEST: u32 = 1 << 24;
/// More interfaces than a capture ever has.
const MOST_INTERFACES: usize = 1 << 12;

/// What was captured at one time, in `Records::bytes`.
#[derive(Clone, Debug)]
pub(super) struct Record {
    pub(super) link: Link,
    pub(super) order: Order,
    /// On the host's clock, ns; simple blocks have none.
    pub(super) stamp_ns: Option<i64>,
    /// In `Records::bytes`.
    pub(super) bytes: Range<usize>,
}

enum Format {
    Pcap { order: Order, link: Link, resolution: Resolution },
    Pcapng { order: Order, interfaces: Vec<Interface> },
}

/// The records of usbmon in a capture; those of other interfaces are passed over.
pub(super) struct Records<R> {
    window: Window<R>,
    format: Option<Format>,
    /// To be passed before the next record.
    pending: usize,
    /// How much of the capture is read, bytes.
    limit: u64,
    has_usb: bool,
    other_link: Option<u16>,
}

impl<R: Read> Records<R> {
    pub(super) fn new(input: R) -> Self {
        Self { window: Window::new(input), format: None, pending: 0, limit: u64::MAX, has_usb: false, other_link: None }
    }

    /// The bytes that ranges of the last record refer to.
    pub(super) fn bytes(&self) -> &[u8] {
        self.window.ahead()
    }

    /// Reads no record that begins later than `limit` bytes into the capture.
    pub(super) fn limit(&mut self, limit: u64) {
        self.limit = limit;
    }

    /// Whether the limit is reached.
    pub(super) fn is_beyond(&self) -> bool {
        self.window.passed() > self.limit
    }

    /// Why there is no record of usbmon at all, if the file as such says so.
    pub(super) fn why_none(&self) -> Option<String> {
        if self.format.is_none() {
            return Some("it is empty: not even a capture's header in it".into());
        }
        self.other_link.filter(|_| !self.has_usb).map(foreign)
    }

    /// The next record; `None` at the end, or the limit.
    pub(super) fn next(&mut self) -> Result<Option<Record>, String> {
        loop {
            self.window.pass(core::mem::take(&mut self.pending));
            if self.is_beyond() || self.fill(1)? == 0 {
                return Ok(None);
            }
            let found = match &self.format {
                None => self.begin()?,
                Some(Format::Pcap { order, link, resolution }) => {
                    let (order, link, resolution) = (*order, *link, *resolution);
                    Some(self.pcap(order, link, resolution)?)
                }
                Some(Format::Pcapng { order, .. }) => {
                    let order = *order;
                    self.block(order)?
                }
            };
            if found.is_some() {
                return Ok(found);
            }
        }
    }

    fn fill(&mut self, count: usize) -> Result<usize, String> {
        self.window.fill(count).map_err(|error| match error.kind() {
            ErrorKind::UnexpectedEof => {
                format!("the file is cut: what it is packed in ends {} bytes into the capture", self.window.passed())
            }
            _ => format!("it can't be unpacked or read on ({error}), {} bytes into the capture", self.window.passed()),
        })
    }

    /// Makes sure of `count` bytes, which something claims to have.
    fn need(&mut self, count: usize) -> Result<(), String> {
        let passed = self.window.passed();
        if self.fill(count)? < count {
            return Err(format!("the file is cut in the middle of a block, {passed} bytes into the capture"));
        }
        Ok(())
    }

    /// The file's beginning: which format it is.
    fn begin(&mut self) -> Result<Option<Record>, String> {
        self.fill(4)?;
        let magic = Order::Big.u32(self.window.ahead(), 0);
        let micro = Resolution::Decimal(6);
        let nano = Resolution::Decimal(9);
        let (order, resolution) = match magic {
            0x0a0d_0d0a => {
                self.format = Some(Format::Pcapng { order: Order::Little, interfaces: Vec::new() });
                return Ok(None);
            }
            0xa1b2_c3d4 => (Order::Big, micro),
            0xd4c3_b2a1 => (Order::Little, micro),
            0xa1b2_3c4d => (Order::Big, nano),
            0x4d3c_b2a1 => (Order::Little, nano),
            _ => {
                let shown: Vec<_> = self.window.ahead().iter().take(4).map(|byte| format!("{byte:02x}")).collect();
                return Err(format!("no pcap or pcapng: it begins with {}; a usbmon capture of a Kinect is expected", shown.join(" ")));
            }
        };
        self.need(24)?;
        let link_type = order.u32(self.window.ahead(), 20) as u16;
        let link = Link::new(link_type).ok_or_else(|| foreign(link_type))?;
        self.has_usb = true;
        self.pending = 24;
        self.format = Some(Format::Pcap { order, link, resolution });
        Ok(None)
    }

    fn pcap(&mut self, order: Order, link: Link, resolution: Resolution) -> Result<Record, String> {
        self.need(16)?;
        let header = self.window.ahead();
        let (seconds, fraction, captured) = (order.u32(header, 0), order.u32(header, 4), order.u32(header, 8));
        if captured > LARGEST {
            return Err(self.absurd(captured));
        }
        let end = 16 + captured as usize;
        self.need(end)?;
        self.pending = end;
        let ns = i128::from(seconds) * 1_000_000_000 + resolution.nanoseconds(fraction.into());
        Ok(Record { link, order, stamp_ns: Some(ns as i64), bytes: 16..end })
    }

    /// One block of pcapng; a record, if it holds one of usbmon.
    fn block(&mut self, order: Order) -> Result<Option<Record>, String> {
        self.need(12)?;
        let is_section = Order::Little.u32(self.window.ahead(), 0) == 0x0a0d_0d0a;
        let order = match (is_section, Order::Big.u32(self.window.ahead(), 8)) {
            (false, _) => order,
            (true, 0x1a2b_3c4d) => Order::Big,
            (true, 0x4d3c_2b1a) => Order::Little,
            (true, _) => return Err(self.garbled("a section without its byte-order magic")),
        };
        let (kind, length) = (order.u32(self.window.ahead(), 0), order.u32(self.window.ahead(), 4));
        if length > LARGEST {
            return Err(self.absurd(length));
        }
        if length < 12 || !length.is_multiple_of(4) {
            return Err(self.garbled(&format!("a block of {length} bytes")));
        }
        let end = length as usize;
        self.need(end)?;
        if order.u32(self.window.ahead(), end - 4) != length {
            return Err(self.garbled(&format!("a block that claims {length} bytes and ends with another length")));
        }
        self.pending = end;
        if is_section {
            self.format = Some(Format::Pcapng { order, interfaces: Vec::new() });
            return Ok(None);
        }
        let body = &self.window.ahead()[8..end - 4];
        let Some(Format::Pcapng { interfaces, .. }) = &mut self.format else { return Ok(None) };
        if kind == 1 {
            let interface = Interface::parse(order, body);
            interfaces.push(interface);
            match Link::new(interface.link_type) {
                Some(_) => self.has_usb = true,
                None => self.other_link = Some(interface.link_type),
            }
            return if interfaces.len() <= MOST_INTERFACES { Ok(None) } else { Err(self.garbled("interfaces without end")) };
        }
        let (interface, stamp, start, captured) = match kind {
            // Enhanced, simple, and the obsolete one.
            6 => (order.u32(body, 0), Some(stamp(order, body)), 20, order.u32(body, 12)),
            3 => (0, None, 4, order.u32(body, 0).min((body.len() as u32).saturating_sub(4))),
            2 => (order.u16(body, 0).into(), Some(stamp(order, body)), 20, order.u32(body, 12)),
            _ => return Ok(None),
        };
        let Some(interface) = interfaces.get(interface as usize).copied() else {
            return Err(self.garbled("a packet of an interface that was never described"));
        };
        let Some(link) = Link::new(interface.link_type) else { return Ok(None) };
        let captured = if kind == 3 && interface.snap_length > 0 { captured.min(interface.snap_length) } else { captured };
        if start + captured as usize > body.len() {
            return Err(self.garbled(&format!("a packet that claims {captured} bytes in a block of {length}")));
        }
        let stamp_ns = stamp.map(|stamp| {
            let ns = interface.resolution.nanoseconds(stamp) + i128::from(interface.offset_s) * 1_000_000_000;
            ns.clamp(i64::MIN.into(), i64::MAX.into()) as i64
        });
        Ok(Some(Record { link, order, stamp_ns, bytes: 8 + start..8 + start + captured as usize }))
    }

    fn absurd(&self, length: u32) -> String {
        self.garbled(&format!("a block that claims {length} bytes, more than any of usbmon"))
    }

    fn garbled(&self, what: &str) -> String {
        format!("the file is garbled: {what}, {} bytes into the capture", self.window.passed())
    }
}

fn stamp(order: Order, body: &[u8]) -> u64 {
    u64::from(order.u32(body, 4)) << 32 | u64::from(order.u32(body, 8))
}
