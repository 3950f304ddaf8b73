//! The usbfs ioctls of an open node.

use crate::nature::Client;
use crate::node::Node;
use crate::preload::{Call, Caller};
use crate::urb::Urb;
use physinc::sim::kinect::Setup;
use physinc::sim::kinect::descriptor::Speed;
use rustix::io::Errno;
use std::io;

/// The letter of usbfs in a request, and numbers of requests.
const LETTER: u64 = b'U' as u64;
const CONTROL: u64 = 0;
const SET_INTERFACE: u64 = 4;
const SET_CONFIGURATION: u64 = 5;
const GET_DRIVER: u64 = 8;
const SUBMIT: u64 = 10;
const DISCARD: u64 = 11;
const REAP: u64 = 12;
const REAP_NOW: u64 = 13;
const CLAIM: u64 = 15;
const RELEASE: u64 = 16;
const CONNECT_INFO: u64 = 17;
const IOCTL: u64 = 18;
const RESET: u64 = 20;
const CLEAR_HALT: u64 = 21;
const DISCONNECT: u64 = 22;
const CONNECT: u64 = 23;
const CAPABILITIES: u64 = 26;
const DISCONNECT_CLAIM: u64 = 27;
const SPEED: u64 = 31;

/// Zero packets, continued bulk, no limit to the size of packets, reaping after the device is gone.
const CAPABLE: u32 = 0x01 | 0x02 | 0x04 | 0x10;

/// What a call brings: a number, or an error number; outside of it, the program is gone.
type Called = io::Result<Result<i32, Errno>>;

/// Answers the calls of one program until it closes the node.
pub fn serve(node: &Node, client: Client, caller: &mut Caller) -> io::Result<()> {
    let mut position = 0;
    while let Some(call) = caller.next_call()? {
        let result = match call {
            Call::Ioctl(request, argument) if request >> 8 & 0xff == LETTER => ioctl(node, client, caller, request & 0xff, argument)?,
            Call::Ioctl(..) => Err(Errno::NOTTY),
            Call::Read(address, length) => {
                let descriptors = { [node.descriptors().device(), node.descriptors().configuration()].concat() };
                let left = descriptors.get(position..).unwrap_or_default();
                let read = &left[..left.len().min(length as usize)];
                position += read.len();
                caller.write(address, read)?;
                Ok(read.len() as i32)
            }
            Call::Write => Err(Errno::INVAL),
        };
        caller.done(result)?;
    }
    Ok(())
}

fn ioctl(node: &Node, client: Client, caller: &mut Caller, number: u64, argument: u64) -> Called {
    if !matches!(number, REAP | REAP_NOW) && !node.state().has(client) {
        return Ok(Err(Errno::NODEV));
    }
    Ok(match number {
        CONTROL => return control(node, caller, argument),
        SUBMIT => match Urb::fetch(caller, argument)? {
            Some(urb) => node.submit(client, urb).map(|()| 0),
            None => Err(Errno::INVAL),
        },
        REAP | REAP_NOW => {
            let done = match if number == REAP { node.wait(client) } else { node.reap(client) } {
                Ok(done) => done,
                Err(errno) => return Ok(Err(errno)),
            };
            done.deliver(caller)?;
            caller.write(argument, &done.urb.address.to_ne_bytes())?;
            Ok(0)
        }
        DISCARD => node.discard(client, argument).map(|()| 0),
        CLAIM => match int(caller, argument)? {
            0 => node.state().claim(client).map(|()| 0),
            _ => Err(Errno::NOENT),
        },
        RELEASE => node.release(client).map(|()| 0),
        SET_INTERFACE => {
            let (interface, setting) = (int(caller, argument)?, int(caller, argument + 4)?);
            let mut state = node.state();
            let known = usize::try_from(setting).ok().filter(|s| interface == 0 && *s < state.device.descriptors().settings());
            match known {
                Some(setting) => state.claim(client).map(|()| {
                    state.setting = setting;
                    0
                }),
                None => Err(Errno::INVAL),
            }
        }
        SET_CONFIGURATION => match (int(caller, argument)?, node.state().claimed_by) {
            (_, Some(_)) => Err(Errno::BUSY),
            (1, None) => Ok(0),
            _ => Err(Errno::INVAL),
        },
        GET_DRIVER => {
            let state = node.state();
            let name = state.driver.clone().or(state.claimed_by.map(|_| "usbfs".into()));
            drop(state);
            let Some(name) = name else { return Ok(Err(Errno::NODATA)) };
            caller.write(argument + 4, &[name.as_bytes(), &[0]].concat())?;
            Ok(0)
        }
        CONNECT_INFO => {
            let address = node.state().address;
            caller.write(argument, &u32::from(address).to_ne_bytes())?;
            caller.write(argument + 4, &[0])?;
            Ok(0)
        }
        IOCTL => {
            let inner = int(caller, argument + 4)?;
            match inner.cast_unsigned().to_le_bytes()[0].into() {
                DISCONNECT => node.state().driver.take().map(|_| 0).ok_or(Errno::NODATA),
                CONNECT => Ok(node.bind_driver()),
                _ => Err(Errno::NOTTY),
            }
        }
        RESET => {
            node.state().device.reset();
            Ok(0)
        }
        CLEAR_HALT => Ok(0),
        CAPABILITIES => {
            caller.write(argument, &CAPABLE.to_ne_bytes())?;
            Ok(0)
        }
        DISCONNECT_CLAIM => {
            let interface = int(caller, argument)?;
            let mut state = node.state();
            if interface == 0 {
                state.driver = None;
                state.claim(client).map(|()| 0)
            } else {
                Err(Errno::INVAL)
            }
        }
        SPEED => Ok(match node.descriptors().speed {
            Speed::Full => 2,
            Speed::High => 3,
        }),
        _ => Err(Errno::NOTTY),
    })
}

/// `struct usbdevfs_ctrltransfer`.
fn control(node: &Node, caller: &mut Caller, argument: u64) -> Called {
    let head = caller.read(argument, 24)?;
    let (Some(setup), Some(data)) = (head.first_chunk::<8>(), head[16..].first_chunk::<8>()) else { return Ok(Err(Errno::INVAL)) };
    let (setup, data) = (Setup::parse(*setup), u64::from_ne_bytes(*data));
    let is_in = setup.request_type & 0x80 != 0;
    let out = if is_in { Vec::new() } else { caller.read(data, setup.length.into())? };
    Ok(match node.control(setup, &out) {
        Ok(answer) => {
            caller.write(data, &answer)?;
            Ok(if is_in { answer.len() as i32 } else { i32::from(setup.length) })
        }
        Err(errno) => Err(errno),
    })
}

fn int(caller: &mut Caller, address: u64) -> io::Result<i32> {
    let bytes = caller.read(address, 4)?;
    Ok(bytes.first_chunk().map_or(0, |b| i32::from_ne_bytes(*b)))
}
