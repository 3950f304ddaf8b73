//! A device at the bus: its transfers, which programs hold its interface, and when what is complete.

use crate::gate::Gate;
use crate::urb::{CONTROL, Came, Done, ISOCHRONOUS, Urb};
use physinc::sim::kinect::descriptor::Descriptors;
use physinc::sim::kinect::{Device, Setup};
use rustix::io::Errno;
use std::collections::BTreeMap;
use std::io;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Of the bus, ns.
const MICROFRAME_NS: i64 = 125_000;
/// A program that reaps until nothing is left must come up for air.
const MOST_REAPED: usize = 16;

/// An open file of a program.
pub type Client = u64;

/// A device and its node.
pub struct Node {
    /// Where programs wait.
    pub gate: Gate,
    /// Its address at the bus.
    pub number: u8,
    driver: Option<&'static str>,
    is_realtime: bool,
    began: Instant,
    state: Mutex<State>,
    changed: Condvar,
}

/// What programs can change.
pub struct State {
    /// Itself.
    pub device: Box<dyn Device>,
    /// Who claimed its interface.
    pub claimed_by: Option<Client>,
    /// The kernel's driver that holds its interface.
    pub driver: Option<&'static str>,
    /// Alternate setting of the interface.
    pub setting: usize,
    waiting: Vec<(Client, i64, Urb)>,
    over: Vec<(Client, Done)>,
    clocks: BTreeMap<u8, Clock>,
    reaped: usize,
}

/// When the last transfer of an endpoint ended: on its bus, which waits for slow programs unless it is to be real, and by the host's clock.
#[derive(Clone, Copy, Debug, Default)]
struct Clock {
    bus_ns: i64,
    host_ns: i64,
}

impl Node {
    /// A device that was just plugged in.
    pub fn new(device: Box<dyn Device>, number: u8, is_realtime: bool) -> io::Result<Self> {
        let state = State {
            device,
            claimed_by: None,
            driver: None,
            setting: 0,
            waiting: Vec::new(),
            over: Vec::new(),
            clocks: BTreeMap::new(),
            reaped: 0,
        };
        Ok(Self {
            gate: Gate::new()?,
            number,
            driver: None,
            is_realtime,
            began: Instant::now(),
            state: Mutex::new(state),
            changed: Condvar::new(),
        })
    }

    fn now_ns(&self) -> i64 {
        self.began.elapsed().as_nanos() as i64
    }

    /// Its state, to look at or to change in a way that completes nothing.
    pub fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// What it says that it is.
    pub fn descriptors(&self) -> Descriptors {
        self.state().device.descriptors().clone()
    }

    /// The kernel's driver takes the interface if there is one and nobody holds it: 1 if it did.
    pub fn bind_driver(&self) -> i32 {
        let mut state = self.state();
        if self.driver.is_some() && state.claimed_by.is_none() {
            state.driver = self.driver;
        }
        i32::from(state.driver.is_some())
    }

    /// A control request outside of any transfer.
    pub fn control(&self, setup: &Setup, out: &[u8]) -> Result<Vec<u8>, Errno> {
        let mut state = self.state();
        let answer = state.device.control(setup, out, self.now_ns()).map_err(|_| Errno::PIPE);
        self.settle(&state);
        answer
    }

    /// Takes a transfer.
    pub fn submit(&self, client: Client, urb: Urb) -> Result<(), Errno> {
        let mut state = self.state();
        match urb.kind {
            CONTROL => {
                let done = control(&mut state, urb, self.now_ns())?;
                state.over.push((client, done));
            }
            ISOCHRONOUS => {
                state.claim(client)?;
                let fits = urb.slots.iter().map(|slot| *slot as usize).sum::<usize>() <= urb.length;
                if !state.device.descriptors().has_endpoint(state.setting, urb.endpoint) {
                    return Err(Errno::NOENT);
                }
                if !fits {
                    return Err(Errno::INVAL);
                }
                state.waiting.push((client, self.now_ns(), urb));
            }
            _ => return Err(Errno::INVAL),
        }
        self.settle(&state);
        Ok(())
    }

    /// The next transfer that is over.
    pub fn reap(&self, client: Client) -> Option<Done> {
        let mut state = self.state();
        let done = if state.reaped < MOST_REAPED { state.reap(client, self.is_realtime, self.now_ns()) } else { None };
        state.reaped = if done.is_some() { state.reaped + 1 } else { 0 };
        self.settle(&state);
        done
    }

    /// As [`Node::reap`], but waits.
    pub fn wait(&self, client: Client) -> Done {
        loop {
            if let Some(done) = self.reap(client) {
                return done;
            }
            std::thread::sleep(Duration::from_micros(125));
        }
    }

    /// Ends a transfer that waits.
    pub fn discard(&self, client: Client, address: u64) -> Result<(), Errno> {
        let mut state = self.state();
        let place = state.waiting.iter().position(|(other, _, urb)| (*other, urb.address) == (client, address)).ok_or(Errno::INVAL)?;
        let (_, _, urb) = state.waiting.remove(place);
        state.over.push((client, urb.fail(-Errno::NOENT.raw_os_error())));
        self.settle(&state);
        Ok(())
    }

    /// The interface is given back: what waits on it ends.
    pub fn release(&self, client: Client) -> Result<(), Errno> {
        let mut state = self.state();
        if state.claimed_by != Some(client) {
            return Err(Errno::INVAL);
        }
        state.claimed_by = None;
        let ended: Vec<_> = state.waiting.extract_if(.., |(other, ..)| *other == client).collect();
        state.over.extend(ended.into_iter().map(|(client, _, urb)| (client, urb.fail(-Errno::NOENT.raw_os_error()))));
        self.settle(&state);
        Ok(())
    }

    /// A program has closed the node.
    pub fn close(&self, client: Client) {
        let _ = self.release(client);
        let mut state = self.state();
        state.over.retain(|(other, _)| *other != client);
        self.settle(&state);
    }

    /// Opens or closes the gate by what is complete now.
    fn settle(&self, state: &State) {
        let due = state.due_ns(None, self.is_realtime);
        self.gate.set(!state.over.is_empty() || due.is_some_and(|due| due <= self.now_ns()));
        self.changed.notify_all();
    }

    /// Opens the gate when a transfer becomes complete by itself; never returns.
    pub fn keep_time(&self) -> ! {
        let mut state = self.state();
        loop {
            let left_ns = state.due_ns(None, self.is_realtime).map(|due| due - self.now_ns());
            state = match left_ns {
                Some(left @ 1..) => {
                    let waited = self.changed.wait_timeout(state, Duration::from_nanos(left as u64));
                    let (state, _) = waited.unwrap_or_else(PoisonError::into_inner);
                    self.gate.set(!state.over.is_empty() || state.due_ns(None, self.is_realtime).is_some_and(|due| due <= self.now_ns()));
                    state
                }
                _ => self.changed.wait(state).unwrap_or_else(PoisonError::into_inner),
            };
        }
    }
}

impl State {
    /// The interface is `client`'s now, if nobody else holds it.
    pub fn claim(&mut self, client: Client) -> Result<(), Errno> {
        if self.driver.is_some() || self.claimed_by.is_some_and(|other| other != client) {
            return Err(Errno::BUSY);
        }
        self.claimed_by = Some(client);
        Ok(())
    }

    /// When the next isochronous transfer of `client` (`None`: of any) is over: at once where the bus waits for the program and the
    /// endpoint brings something.
    fn due_ns(&self, client: Option<Client>, is_realtime: bool) -> Option<i64> {
        self.first(client, is_realtime).map(|(due, _)| due)
    }

    fn first(&self, client: Option<Client>, is_realtime: bool) -> Option<(i64, usize)> {
        let mut seen = Vec::new();
        let mut first = None;
        for (place, (owner, submitted_ns, urb)) in self.waiting.iter().enumerate() {
            // Each endpoint's transfers end in their order.
            if seen.contains(&urb.endpoint) || client.is_some_and(|client| client != *owner) {
                continue;
            }
            seen.push(urb.endpoint);
            let clock = self.clocks.get(&urb.endpoint).copied().unwrap_or_default();
            let lasts = urb.slots.len() as i64 * MICROFRAME_NS;
            let ends = if is_realtime { clock.bus_ns.max(*submitted_ns) } else { clock.bus_ns } + lasts;
            let due = match is_realtime {
                true => ends,
                false if self.device.is_streaming(urb.endpoint) => 0,
                false => clock.host_ns + lasts,
            };
            if first.is_none_or(|(_, sooner, _)| ends < sooner) {
                first = Some((due, ends, place));
            }
        }
        first.map(|(due, _, place)| (due, place))
    }

    fn reap(&mut self, client: Client, is_realtime: bool, now_ns: i64) -> Option<Done> {
        if let Some(place) = self.over.iter().position(|(other, _)| *other == client) {
            return Some(self.over.remove(place).1);
        }
        let (due, place) = self.first(Some(client), is_realtime)?;
        if due > now_ns {
            return None;
        }
        let (_, submitted_ns, urb) = self.waiting.remove(place);
        let clock = self.clocks.entry(urb.endpoint).or_default();
        if is_realtime && clock.bus_ns < submitted_ns {
            // What came while no transfer waited is lost.
            let missed = if clock.bus_ns == 0 { 0 } else { (submitted_ns - clock.bus_ns) / MICROFRAME_NS };
            (0..missed).for_each(|_| _ = self.device.packet(urb.endpoint));
            clock.bus_ns = submitted_ns;
        }
        clock.bus_ns += urb.slots.len() as i64 * MICROFRAME_NS;
        clock.host_ns = now_ns;
        Some(self.fill(urb))
    }

    fn fill(&mut self, urb: Urb) -> Done {
        let mut bytes = Vec::with_capacity(urb.length);
        let (mut packets, mut offset) = (Vec::with_capacity(urb.slots.len()), 0);
        for slot in &urb.slots {
            let packet = self.device.packet(urb.endpoint);
            let fits = &packet[..packet.len().min(*slot as usize)];
            bytes.resize(offset, 0);
            bytes.extend(fits);
            let status = if fits.len() < packet.len() { -Errno::OVERFLOW.raw_os_error() } else { 0 };
            packets.push(Came { length: fits.len() as u32, status });
            offset += *slot as usize;
        }
        Done { actual: packets.iter().map(|packet| packet.length as usize).sum(), urb, status: 0, bytes, packets }
    }
}

fn control(state: &mut State, urb: Urb, now_ns: i64) -> Result<Done, Errno> {
    let (setup, out) = urb.out.split_first_chunk::<8>().ok_or(Errno::INVAL)?;
    let setup = Setup::parse(*setup);
    if usize::from(setup.length) > out.len() {
        return Err(Errno::INVAL);
    }
    let is_in = setup.request_type & 0x80 != 0;
    let answer = state.device.control(&setup, if is_in { &[] } else { &out[..setup.length.into()] }, now_ns);
    Ok(match answer {
        Ok(bytes) => Done { actual: if is_in { bytes.len() } else { setup.length.into() }, urb, status: 0, bytes, packets: Vec::new() },
        Err(_) => urb.fail(-Errno::PIPE.raw_os_error()),
    })
}
