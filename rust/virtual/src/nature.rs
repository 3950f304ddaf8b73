//! What does not change about a device, and who may have it open.

use crate::options::Moment;
use crate::queue::Pace;
use physinc::sim::kinect::FrameSent;
use rustix::io::Errno;

/// An open file of a program: how often the device was plugged in before it was opened, and its number then.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Client(pub u64, pub u64);

/// Another program, of which nothing is known.
pub const SOMEONE: Client = Client(u64::MAX, 0);

/// What does not change about a device.
pub struct Nature {
    /// When its packets come.
    pub pace: Pace,
    /// The kernel's driver that takes its interface.
    pub driver: Option<String>,
    /// Another program has it.
    pub is_busy: bool,
    /// When it is pulled.
    pub pull: Option<Moment>,
    /// How transfers are refused, from which on.
    pub refuse: Option<(Errno, u64)>,
    /// Is told of each frame that was sent.
    pub on_frame: Box<dyn Fn(&FrameSent) + Send + Sync>,
    /// Is told when it is pulled.
    pub on_pull: Box<dyn Fn() + Send + Sync>,
}
