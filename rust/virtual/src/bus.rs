//! What devices are plugged into.

use crate::node::Node;
use std::io;
use std::sync::Arc;

/// Where a device is plugged in.
#[derive(Clone, Debug)]
pub struct Place {
    /// `1-1.3`: bus 1, port 1 of the root hub, port 3 of the hub there; `usb1` the root hub.
    pub name: String,
    /// Its number at the bus.
    pub address: u8,
}

/// A bus, real or not.
pub trait Bus: Send + Sync {
    /// Plugs a device in.
    fn plug(&self, place: &Place, node: &Arc<Node>) -> io::Result<()>;

    /// Pulls it out.
    fn pull(&self, place: &Place, node: &Node) -> io::Result<()>;

    /// Whether a device has that address.
    fn has(&self, _place: &Place) -> bool {
        false
    }
}
