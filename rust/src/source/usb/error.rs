//! What can be wrong with a device: what happened, the evidence, and the command that mends it.

use super::ffi::UsbError;
use crate::kinect::session::SessionError;
use std::boxed::Box;
use std::format;
use std::string::{String, ToString};
use std::vec::Vec;

/// A device that can't be had, or was lost.
#[derive(Debug, thiserror::Error)]
#[error("{source_name}: {problem}")]
pub struct DeviceError {
    /// What the user named.
    pub source_name: String,
    /// What is wrong.
    pub problem: Problem,
}

/// What is wrong with a device.
#[derive(Debug, thiserror::Error)]
pub enum Problem {
    /// The system has no USB.
    #[error(
        "there is no USB here ({error}): in a container, start it with `--device /dev/bus/usb`; without a Kinect, try `physinc run demo`"
    )]
    NoBus {
        /// What libusb says.
        error: String,
    },
    /// No such Kinect.
    #[error("no {}; `physinc doctor` looks further, and without a Kinect there is `physinc run demo`", missing(known))]
    NotFound {
        /// Serial numbers, or places, of those that are.
        known: Vec<String>,
    },
    /// The user may not.
    #[error("no permission for {node}: `sudo chmod a+rw {node}` for now, `physinc doctor` tells how for good")]
    Denied {
        /// Its file.
        node: String,
    },
    /// Somebody else has it.
    #[error("{node} is in use by {}: end that, and try again", users(holders))]
    Busy {
        /// Its file.
        node: String,
        /// The programs that have the file open.
        holders: Vec<String>,
    },
    /// It runs at 12 Mbit/s.
    #[error(
        "{node} is connected at less than the 480 Mbit/s that it needs: plug it into another port, without a hub (`lsusb -t` shows the speeds)"
    )]
    Slow {
        /// Its file.
        node: String,
    },
    /// The bus is full.
    #[error("the bus has no room for it ({error}): plug it into a port of another controller, or unplug what shares this one (`lsusb -t`)")]
    Bandwidth {
        /// What the system says.
        error: String,
    },
    /// The system is out of memory for transfers.
    #[error("the system has no memory for its transfers ({error}): `echo 64 | sudo tee /sys/module/usbcore/parameters/usbfs_memory_mb`")]
    Memory {
        /// What the system says.
        error: String,
    },
    /// It doesn't answer as a Kinect does.
    #[error("{0}: unplug its USB and its power, wait for five seconds, and plug both in again")]
    Confused(#[from] Box<SessionError<UsbError>>),
    /// It was there, and is no longer.
    #[error("the connection broke ({evidence}): plug it in again; `--reconnect S` (in Python reconnect=True) waits for that")]
    Gone {
        /// What libusb said.
        evidence: String,
    },
    /// Anything else that USB can say.
    #[error("USB says {0}: unplug it and plug it in again; `physinc doctor` looks further")]
    Usb(UsbError),
}

impl DeviceError {
    pub(super) fn new(source_name: &str, problem: Problem) -> Self {
        Self { source_name: source_name.into(), problem }
    }
}

impl Problem {
    /// The device whose file is `node` refused.
    pub(super) fn from_device(error: UsbError, node: &str) -> Self {
        let evidence = error.to_string();
        match error {
            _ if error.is_gone() => Self::Gone { evidence },
            _ if error.is_denied() => Self::Denied { node: node.into() },
            _ if error.is_busy() => Self::Busy { node: node.into(), holders: super::busy::holders(node) },
            _ if error.is_out_of_bandwidth() => Self::Bandwidth { error: evidence },
            _ if error.is_out_of_memory() => Self::Memory { error: evidence },
            _ => Self::Usb(error),
        }
    }
}

fn missing(known: &[String]) -> String {
    if known.is_empty() {
        return "Kinect is attached: is its power supply plugged in?".into();
    }
    format!("such Kinect is attached, of those that are name one: {}", known.join(", "))
}

fn users(holders: &[String]) -> String {
    if holders.is_empty() { "another program, of another user".into() } else { holders.join(" and ") }
}
