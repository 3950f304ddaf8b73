//! Kinects that are attached, by libusb's isochronous transfers.
//!
//! One thread does it all: [`Live`] lets libusb handle what has happened, whose callbacks only note which transfers have come back, hands
//! their packets out in place, one by one, and sends each transfer out again when it is used up.

mod busy;
mod camera;
mod devices;
mod error;
mod ffi;
mod live;

pub use devices::{Attached, Identity, attached};
pub use error::{DeviceError, Problem};
pub use ffi::UsbError;
pub use live::{Live, Traffic};
