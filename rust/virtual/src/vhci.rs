//! The kernel's own bus: devices are attached to `vhci_hcd` by USB/IP, so that usbfs, usbmon and all other drivers see them.
//!
//! A message has 48 bytes, big-endian words; then bytes that go or came, without the gaps between packets; then 16 bytes for each packet.

use crate::bus::{Bus, Place};
use crate::nature::Client;
use crate::node::Node;
use crate::urb::{CONTROL, Done, ISOCHRONOUS, Urb};
use physinc::sim::kinect::descriptor::Speed;
use rustix::fd::AsRawFd;
use rustix::io::Errno;
use std::collections::BTreeMap;
use std::io::{self, Read, Write};
use std::net::Shutdown;
use std::os::unix::net::UnixStream;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};
use std::{fs, thread};

const CONTROLLER: &str = "/sys/devices/platform/vhci_hcd.0";
/// What `status` says of a port that is free.
const FREE: &str = "004";
/// A hub's class; the controller has hubs of its own.
const HUB: u8 = 9;

const SUBMIT: u32 = 1;
const UNLINK: u32 = 2;
const SUBMITTED: u32 = 3;
const UNLINKED: u32 = 4;
const HEADER: usize = 48;
const DESCRIPTOR: usize = 16;
/// Of packets in a transfer: more are a mistake.
const MOST_PACKETS: usize = 1024;
/// Likewise of its bytes.
const MOST_BYTES: usize = 1 << 22;
/// For the kernel to ask what it needs to know.
const MOST_PATIENCE: Duration = Duration::from_secs(30);

/// The controller, and our ends of what is attached.
#[derive(Default)]
pub struct Vhci {
    attached: Mutex<BTreeMap<String, UnixStream>>,
}

impl Vhci {
    fn attached(&self) -> std::sync::MutexGuard<'_, BTreeMap<String, UnixStream>> {
        self.attached.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Bus for Vhci {
    fn plug(&self, place: &Place, node: &Arc<Node>) -> io::Result<()> {
        let descriptors = node.descriptors();
        if descriptors.device()[4] == HUB {
            return Ok(());
        }
        let (_, plugs) = node.plug(place.address)?;
        let (ours, kernels) = UnixStream::pair()?;
        let speed = match descriptors.speed {
            Speed::Full => 2,
            Speed::High => 3,
        };
        let line = format!("{} {} {} {speed}", free_port()?, kernels.as_raw_fd(), place.address);
        fs::write(format!("{CONTROLLER}/attach"), line)?;
        let (connection, client) =
            (Arc::new(Connection { node: Arc::clone(node), socket: Mutex::new(ours.try_clone()?) }), Client(plugs, 0));
        self.attached().insert(place.name.clone(), ours.try_clone()?);
        let writer = Arc::clone(&connection);
        thread::spawn(move || writer.tell(client));
        // The kernel has taken its end.
        thread::spawn(move || {
            // The connection ends where the device is pulled.
            let _ = connection.listen(client, ours);
            connection.node.close(client);
        });
        let attached = Instant::now();
        while !node.state().is_configured {
            if attached.elapsed() > MOST_PATIENCE {
                return Err(io::Error::new(io::ErrorKind::TimedOut, "the kernel does not take it"));
            }
            thread::sleep(Duration::from_millis(10));
        }
        Ok(())
    }

    fn pull(&self, place: &Place, node: &Node) -> io::Result<()> {
        node.pull();
        self.attached().remove(&place.name).map_or(Ok(()), |socket| socket.shutdown(Shutdown::Both))
    }
}

/// The first free port for fast devices.
fn free_port() -> io::Result<String> {
    let status = fs::read_to_string(format!("{CONTROLLER}/status"))?;
    let ports = status.lines().map(|line| line.split_whitespace().collect::<Vec<_>>());
    let free = ports.filter_map(|words| match words[..] {
        ["hs", port, FREE, ..] => Some(port.to_owned()),
        _ => None,
    });
    free.into_iter().next().ok_or_else(|| io::Error::other("vhci_hcd has no free port"))
}

struct Connection {
    node: Arc<Node>,
    /// Whoever holds it may take transfers that are over: what was taken is told before anything else is.
    socket: Mutex<UnixStream>,
}

impl Connection {
    /// Takes what the kernel says.
    fn listen(&self, client: Client, mut socket: UnixStream) -> io::Result<()> {
        loop {
            let mut header = [0; HEADER];
            socket.read_exact(&mut header)?;
            let word = |number: usize| header[4 * number..].first_chunk().map_or(0, |b| u32::from_be_bytes(*b));
            let (command, sequence) = (word(0), word(1));
            match command {
                SUBMIT => {
                    let urb = receive(&mut socket, &header)?;
                    if let Err(errno) = self.node.submit(client, urb.clone()) {
                        self.send(&urb.fail(errno))?;
                    }
                }
                UNLINK => {
                    let mut out = self.socket.lock().unwrap_or_else(PoisonError::into_inner);
                    let status = if self.node.unlink(client, word(5).into()) { -Errno::CONNRESET.raw_os_error() } else { 0 };
                    out.write_all(&message(UNLINKED, sequence, [status.cast_unsigned(), 0, 0, 0, 0]))?;
                }
                _ => return Err(io::Error::other(format!("USB/IP knows no command {command}"))),
            }
        }
    }

    /// Tells what is over, until the device is gone.
    fn tell(&self, client: Client) {
        loop {
            if self.node.await_over(client).is_err() {
                return;
            }
            let mut socket = self.socket.lock().unwrap_or_else(PoisonError::into_inner);
            if let Ok(done) = self.node.reap(client)
                && send(&mut socket, &done).is_err()
            {
                return;
            }
        }
    }

    fn send(&self, done: &Done) -> io::Result<()> {
        send(&mut self.socket.lock().unwrap_or_else(PoisonError::into_inner), done)
    }
}

/// The transfer that follows `header`.
fn receive(socket: &mut UnixStream, header: &[u8; HEADER]) -> io::Result<Urb> {
    let word = |number: usize| header[4 * number..].first_chunk().map_or(0, |b| u32::from_be_bytes(*b));
    let (sequence, is_in, endpoint) = (word(1), word(3) == 1, word(4));
    let (length, packets) = (word(6) as usize, word(8) as usize);
    if length > MOST_BYTES {
        return Err(io::Error::other(format!("a transfer of {length} bytes")));
    }
    let setup = &header[40..];
    let mut out = if endpoint == 0 { setup.to_vec() } else { Vec::new() };
    if !is_in {
        let start = out.len();
        out.resize(start + length, 0);
        socket.read_exact(&mut out[start..])?;
    } else if endpoint == 0 {
        out.resize(out.len() + length, 0);
    }
    let mut slots = Vec::new();
    if (1..=MOST_PACKETS).contains(&packets) {
        let mut descriptors = vec![0; packets * DESCRIPTOR];
        socket.read_exact(&mut descriptors)?;
        slots.extend(descriptors.as_chunks::<DESCRIPTOR>().0.iter().map(|d| u32::from_be_bytes([d[4], d[5], d[6], d[7]])));
    }
    let kind = match endpoint {
        0 => CONTROL,
        _ if slots.is_empty() => u8::MAX,
        _ => ISOCHRONOUS,
    };
    Ok(Urb::received(sequence.into(), kind, endpoint as u8 | if is_in { 0x80 } else { 0 }, length, slots, out))
}

fn message(command: u32, sequence: u32, words: [u32; 5]) -> [u8; HEADER] {
    let mut message = [0; HEADER];
    let all = [command, sequence, 0, 0, 0].into_iter().chain(words);
    for (bytes, word) in message.chunks_exact_mut(4).zip(all) {
        bytes.copy_from_slice(&word.to_be_bytes());
    }
    message
}

fn send(socket: &mut UnixStream, done: &Done) -> io::Result<()> {
    let urb = &done.urb;
    let packets = if urb.slots.is_empty() { u32::MAX } else { urb.slots.len() as u32 };
    let errors = done.packets.iter().filter(|packet| packet.status != 0).count() as u32;
    let mut bytes = message(SUBMITTED, urb.address as u32, [done.status.cast_unsigned(), done.actual as u32, 0, packets, errors]).to_vec();
    if urb.slots.is_empty() {
        bytes.extend(&done.bytes);
    }
    let mut offset = 0;
    let mut descriptors: Vec<u8> = Vec::with_capacity(urb.slots.len() * DESCRIPTOR);
    for (slot, packet) in urb.slots.iter().zip(&done.packets) {
        bytes.extend(done.bytes.get(offset..offset + packet.length as usize).unwrap_or_default());
        descriptors.extend([offset as u32, *slot, packet.length, packet.status.cast_unsigned()].map(u32::to_be_bytes).as_flattened());
        offset += *slot as usize;
    }
    bytes.extend(descriptors);
    socket.write_all(&bytes)
}
