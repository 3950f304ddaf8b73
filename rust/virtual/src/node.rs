//! A device at the bus: its transfers, which programs hold its interface, and when what is complete.

use crate::gate::Gate;
use crate::nature::{Client, Nature, SOMEONE};
use crate::options::Moment;
use crate::queue::Queue;
use crate::urb::{CONTROL, Done, ISOCHRONOUS, Urb};
use physinc::sim::kinect::descriptor::Descriptors;
use physinc::sim::kinect::{Device, Setup};
use rustix::io::Errno;
use std::io;
use std::path::PathBuf;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// A program that reaps until nothing is left must come up for air.
const MOST_REAPED: usize = 16;

/// bmRequestType and bRequest.
const SET_INTERFACE: (u8, u8) = (0x01, 11);
const SET_CONFIGURATION: (u8, u8) = (0x00, 9);

/// A device and its node.
pub struct Node {
    nature: Nature,
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
    pub driver: Option<String>,
    /// Whether the kernel has made it ready for programs.
    pub is_configured: bool,
    /// Alternate setting of the interface.
    pub setting: usize,
    /// Its number at the bus.
    pub address: u8,
    gate: Option<Gate>,
    /// How often it was plugged in.
    plugs: u64,
    queue: Queue,
    over: Vec<(Client, Done)>,
    reaped: usize,
    requests: u64,
    submitted: u64,
    /// Frames when it was plugged in.
    frames: u64,
}

impl Node {
    /// A device that is not plugged in yet.
    pub fn new(device: Box<dyn Device>, nature: Nature) -> Self {
        let queue = Queue::new(nature.pace);
        let state = State {
            device,
            claimed_by: None,
            driver: None,
            is_configured: false,
            setting: 0,
            address: 0,
            gate: None,
            plugs: 0,
            queue,
            over: Vec::new(),
            reaped: 0,
            requests: 0,
            submitted: 0,
            frames: 0,
        };
        Self { nature, began: Instant::now(), state: Mutex::new(state), changed: Condvar::new() }
    }

    /// Its state, to look at or to change in a way that completes nothing.
    pub fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn now_ns(&self) -> i64 {
        self.began.elapsed().as_nanos() as i64
    }

    /// What it says that it is.
    pub fn descriptors(&self) -> Descriptors {
        self.state().device.descriptors().clone()
    }

    /// It is powered and reset; what its node must lead to, and how often it was plugged in.
    pub fn plug(&self, address: u8) -> io::Result<(PathBuf, u64)> {
        let mut state = self.state();
        let gate = Gate::new()?;
        let path = gate.path().to_path_buf();
        state.gate = Some(gate);
        state.address = address;
        state.plugs += 1;
        (state.setting, state.is_configured) = (0, false);
        (state.requests, state.frames) = (0, state.device.frames_sent().1);
        state.claimed_by = self.nature.is_busy.then_some(SOMEONE);
        state.driver.clone_from(&self.nature.driver);
        state.device.reset();
        self.settle(&mut state);
        Ok((path, state.plugs))
    }

    /// It is gone: what waits on it ends, and whoever polls is told.
    pub fn pull(&self) {
        let mut state = self.state();
        state.gate = None;
        let ended = state.queue.take(|_| true);
        state.over.extend(ended.into_iter().map(|(client, urb)| (client, urb.fail(Errno::SHUTDOWN))));
        self.changed.notify_all();
    }

    /// The kernel's driver takes the interface if there is one and nobody holds it: 1 if it did.
    pub fn bind_driver(&self) -> i32 {
        let mut state = self.state();
        if state.claimed_by.is_none() {
            state.driver.clone_from(&self.nature.driver);
        }
        i32::from(state.driver.is_some())
    }

    /// A control request outside of any transfer.
    pub fn control(&self, setup: Setup, out: &[u8]) -> Result<Vec<u8>, Errno> {
        let mut state = self.state();
        let answer = self.request(&mut state, setup, out)?;
        self.settle(&mut state);
        answer
    }

    /// Takes a transfer.
    pub fn submit(&self, client: Client, urb: Urb) -> Result<(), Errno> {
        let mut state = self.state();
        if urb.kind != CONTROL {
            state.submitted += 1;
            match self.nature.refuse {
                Some((errno, from)) if state.submitted > from => return Err(errno),
                _ => (),
            }
        }
        match urb.kind {
            CONTROL => {
                let done = self.control_transfer(&mut state, urb)?;
                state.over.push((client, done));
            }
            ISOCHRONOUS => {
                state.claim(client)?;
                if !state.device.descriptors().has_endpoint(state.setting, urb.endpoint) {
                    return Err(Errno::NOENT);
                }
                if urb.slots.iter().map(|slot| *slot as usize).sum::<usize>() > urb.length {
                    return Err(Errno::INVAL);
                }
                state.queue.submit(client, urb, self.now_ns());
            }
            _ => return Err(Errno::INVAL),
        }
        self.settle(&mut state);
        Ok(())
    }

    /// The next transfer that is over.
    pub fn reap(&self, client: Client) -> Result<Done, Errno> {
        let mut state = self.state();
        let done = if state.reaped < MOST_REAPED { self.next_over(&mut state, client) } else { None };
        state.reaped = if done.is_some() { state.reaped + 1 } else { 0 };
        self.settle(&mut state);
        done.ok_or(if state.has(client) { Errno::AGAIN } else { Errno::NODEV })
    }

    fn next_over(&self, state: &mut State, client: Client) -> Option<Done> {
        if let Some(place) = state.over.iter().position(|(other, _)| *other == client) {
            return Some(state.over.remove(place).1);
        }
        let done = state.queue.next(client, &mut *state.device, self.now_ns())?;
        let (sent, frames) = state.device.frames_sent();
        for frame in &sent {
            (self.nature.on_frame)(frame);
        }
        if matches!(self.nature.pull, Some(Moment::Frames(at)) if frames - state.frames >= at) {
            (self.nature.on_pull)();
            state.frames = frames;
        }
        Some(done)
    }

    /// Waits until a transfer is over.
    pub fn await_over(&self, client: Client) -> Result<(), Errno> {
        let mut state = self.state();
        loop {
            let due = state.queue.due_ns(&*state.device, Some(client)).map(|due| due - self.now_ns());
            if due.is_some_and(|left| left <= 0) || state.over.iter().any(|(other, _)| *other == client) {
                return Ok(());
            }
            if !state.has(client) {
                return Err(Errno::NODEV);
            }
            state = self.sleep(state, due);
        }
    }

    /// Until something changes, or so long, ns.
    fn sleep<'a>(&self, state: MutexGuard<'a, State>, left_ns: Option<i64>) -> MutexGuard<'a, State> {
        match left_ns {
            Some(left) => {
                let waited = self.changed.wait_timeout(state, Duration::from_nanos(left.max(0) as u64));
                waited.unwrap_or_else(PoisonError::into_inner).0
            }
            None => self.changed.wait(state).unwrap_or_else(PoisonError::into_inner),
        }
    }

    /// As [`Node::reap`], but waits.
    pub fn wait(&self, client: Client) -> Result<Done, Errno> {
        loop {
            self.await_over(client)?;
            match self.reap(client) {
                Err(Errno::AGAIN) => (),
                other => return other,
            }
        }
    }

    /// Takes a transfer back without a word, if it was not reaped yet.
    pub fn unlink(&self, client: Client, address: u64) -> bool {
        let mut state = self.state();
        let waited = state.queue.take(|(other, urb)| (*other, urb.address) == (client, address)).len();
        let before = state.over.len();
        state.over.retain(|(other, done)| (*other, done.urb.address) != (client, address));
        let found = waited > 0 || state.over.len() < before;
        self.settle(&mut state);
        found
    }

    /// Ends a transfer that waits.
    pub fn discard(&self, client: Client, address: u64) -> Result<(), Errno> {
        let mut state = self.state();
        let ended = state.queue.take(|(other, urb)| (*other, urb.address) == (client, address));
        let (_, urb) = ended.into_iter().next().ok_or(Errno::INVAL)?;
        state.over.push((client, urb.fail(Errno::NOENT)));
        self.settle(&mut state);
        Ok(())
    }

    /// The interface is given back: what waits on it ends.
    pub fn release(&self, client: Client) -> Result<(), Errno> {
        let mut state = self.state();
        if state.claimed_by != Some(client) {
            return Err(Errno::INVAL);
        }
        state.claimed_by = None;
        let ended = state.queue.take(|(other, _)| *other == client);
        state.over.extend(ended.into_iter().map(|(client, urb)| (client, urb.fail(Errno::NOENT))));
        self.settle(&mut state);
        Ok(())
    }

    /// A program has closed the node.
    pub fn close(&self, client: Client) {
        let _ = self.release(client);
        let mut state = self.state();
        state.queue.take(|(other, _)| *other == client);
        state.over.retain(|(other, _)| *other != client);
        self.settle(&mut state);
    }

    /// Opens or closes the gate by what is complete now.
    fn settle(&self, state: &mut State) {
        state.open_or_close(self.now_ns());
        self.changed.notify_all();
    }

    /// Opens the gate when a transfer becomes complete by itself; never returns.
    pub fn keep_time(&self) -> ! {
        let mut state = self.state();
        loop {
            let left = state.open_or_close(self.now_ns());
            state = self.sleep(state, left.filter(|left| *left > 0));
        }
    }

    /// The device's answer, unless it is pulled first.
    fn request(&self, state: &mut State, setup: Setup, out: &[u8]) -> Result<Result<Vec<u8>, Errno>, Errno> {
        let is_own = setup.request_type & 0x60 != 0;
        state.requests += u64::from(is_own);
        if is_own && self.nature.pull == Some(Moment::Requests(state.requests)) {
            (self.nature.on_pull)();
            return Err(Errno::NODEV);
        }
        let answer = state.device.control(setup, out, self.now_ns());
        match (setup.request_type, setup.request) {
            SET_INTERFACE if answer.is_ok() => state.setting = setup.value.into(),
            SET_CONFIGURATION => state.is_configured = answer.is_ok(),
            _ => (),
        }
        Ok(answer.map_err(|_| Errno::PIPE))
    }

    fn control_transfer(&self, state: &mut State, urb: Urb) -> Result<Done, Errno> {
        let (setup, out) = urb.out.split_first_chunk::<8>().ok_or(Errno::INVAL)?;
        let setup = Setup::parse(*setup);
        let out = out.get(..setup.length.into()).ok_or(Errno::INVAL)?;
        let is_in = setup.request_type & 0x80 != 0;
        Ok(match self.request(state, setup, if is_in { &[] } else { out })? {
            Ok(bytes) => urb.succeed(if is_in { bytes.len() } else { setup.length.into() }, bytes, Vec::new()),
            Err(errno) => urb.fail(errno),
        })
    }
}

impl State {
    /// Whether `client` has opened the device that is plugged in now.
    pub fn has(&self, client: Client) -> bool {
        self.gate.is_some() && client.0 == self.plugs
    }

    /// Opens or closes the gate by what is complete now; after how long a transfer will be, ns.
    fn open_or_close(&mut self, now_ns: i64) -> Option<i64> {
        let left = self.queue.due_ns(&*self.device, None).map(|due| due - now_ns);
        let is_complete = !self.over.is_empty() || left.is_some_and(|left| left <= 0);
        if let Some(gate) = &mut self.gate {
            gate.set(is_complete);
        }
        left
    }

    /// The interface is `client`'s now, if nobody else holds it.
    pub fn claim(&mut self, client: Client) -> Result<(), Errno> {
        if self.driver.is_some() || self.claimed_by.is_some_and(|other| other != client) {
            return Err(Errno::BUSY);
        }
        self.claimed_by = Some(client);
        Ok(())
    }
}
