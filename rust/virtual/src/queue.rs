//! Isochronous transfers that wait for their packets, and when each is over.

use crate::nature::Client;
use crate::urb::{Came, Done, Urb};
use physinc::sim::kinect::{Device, Trouble};
use rustix::io::Errno;
use std::collections::BTreeMap;

/// Of the bus, ns.
const MICROFRAME_NS: i64 = 125_000;

/// A program may be late by so much and catch up, ns.
const PATIENCE_NS: i64 = 100_000_000;

/// When packets come. An endpoint that brings nothing always keeps time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pace {
    /// As fast as the program takes them.
    Client,
    /// As fast as the bus brings them, but it waits for a slow program.
    Bus,
    /// As fast as the bus brings them: what nobody takes is lost.
    Real,
}

/// Those of a device.
#[derive(Debug)]
pub struct Queue {
    pace: Pace,
    waiting: Vec<Waiting>,
    clocks: BTreeMap<u8, Clock>,
}

#[derive(Debug)]
struct Waiting {
    client: Client,
    since_ns: i64,
    urb: Urb,
}

/// When the last transfer of an endpoint ended: by its own packets, and by the host's clock.
#[derive(Clone, Copy, Debug, Default)]
struct Clock {
    bus_ns: i64,
    host_ns: i64,
}

impl Queue {
    /// Empty.
    pub fn new(pace: Pace) -> Self {
        Self { pace, waiting: Vec::new(), clocks: BTreeMap::new() }
    }

    /// `urb` waits, too.
    pub fn submit(&mut self, client: Client, urb: Urb, now_ns: i64) {
        self.waiting.push(Waiting { client, since_ns: now_ns, urb });
    }

    /// Takes out what ends without a packet.
    pub fn take(&mut self, mut ends: impl FnMut(&(Client, Urb)) -> bool) -> Vec<(Client, Urb)> {
        let mut ended = Vec::new();
        for Waiting { client, since_ns, urb } in std::mem::take(&mut self.waiting) {
            let pair = (client, urb);
            if ends(&pair) {
                ended.push(pair);
            } else {
                self.waiting.push(Waiting { client, since_ns, urb: pair.1 });
            }
        }
        ended
    }

    /// When the next is over, of `client` or of all.
    pub fn due_ns(&self, device: &dyn Device, client: Option<Client>) -> Option<i64> {
        self.first(device, |waiting| client.is_none_or(|client| waiting.client == client)).map(|(due, _)| due)
    }

    /// When the first of those is over, and which it is.
    fn first(&self, device: &dyn Device, belongs: impl Fn(&Waiting) -> bool) -> Option<(i64, usize)> {
        let mut seen = Vec::new();
        let mut first: Option<(i64, i64, usize)> = None;
        for (place, waiting) in self.waiting.iter().enumerate().filter(|(_, waiting)| belongs(waiting)) {
            // Each endpoint's transfers end in their order.
            let endpoint = waiting.urb.endpoint;
            if seen.contains(&endpoint) {
                continue;
            }
            seen.push(endpoint);
            let clock = self.clocks.get(&endpoint).copied().unwrap_or_default();
            let lasts = waiting.urb.slots.len() as i64 * MICROFRAME_NS;
            let begins = if self.pace == Pace::Real { clock.bus_ns.max(waiting.since_ns) } else { clock.bus_ns };
            let due = match self.pace {
                Pace::Real => begins + lasts,
                Pace::Client if device.is_streaming(endpoint) => 0,
                Pace::Client | Pace::Bus => clock.host_ns + lasts,
            };
            if first.is_none_or(|(_, sooner, _)| begins + lasts < sooner) {
                first = Some((due, begins + lasts, place));
            }
        }
        first.map(|(due, _, place)| (due, place))
    }

    /// The next of `client`'s that is over by now, with its packets.
    pub fn next(&mut self, client: Client, device: &mut dyn Device, now_ns: i64) -> Option<Done> {
        let (due, place) = self.first(device, |waiting| waiting.client == client)?;
        if due > now_ns {
            return None;
        }
        let Waiting { since_ns, urb, .. } = self.waiting.remove(place);
        let clock = self.clocks.entry(urb.endpoint).or_default();
        if self.pace == Pace::Real && clock.bus_ns < since_ns {
            // What came while no transfer waited is lost.
            let missed = if clock.bus_ns == 0 { 0 } else { (since_ns - clock.bus_ns) / MICROFRAME_NS };
            (0..missed).for_each(|_| _ = device.packet(urb.endpoint));
            clock.bus_ns = since_ns;
        }
        clock.bus_ns += urb.slots.len() as i64 * MICROFRAME_NS;
        clock.host_ns = if self.pace == Pace::Bus { due.max(now_ns - PATIENCE_NS) } else { now_ns };
        Some(fill(urb, device))
    }
}

fn fill(urb: Urb, device: &mut dyn Device) -> Done {
    let mut bytes = Vec::with_capacity(urb.length);
    let (mut packets, mut offset, mut actual) = (Vec::with_capacity(urb.slots.len()), 0, 0);
    for slot in &urb.slots {
        let came = device.packet(urb.endpoint);
        let fits = &came.bytes[..came.bytes.len().min(*slot as usize)];
        bytes.resize(offset, 0);
        bytes.extend(fits);
        let trouble = came.trouble.map(|trouble| match trouble {
            Trouble::Late => Errno::XDEV,
            Trouble::Protocol => Errno::PROTO,
            Trouble::Checksum => Errno::ILSEQ,
        });
        let errno = trouble.or((fits.len() < came.bytes.len()).then_some(Errno::OVERFLOW));
        packets.push(Came { length: fits.len() as u32, status: errno.map_or(0, |errno| -errno.raw_os_error()) });
        offset += *slot as usize;
        actual += fits.len();
    }
    urb.succeed(actual, bytes, packets)
}
