//! A Kinect that is open and sends depth.

use super::devices::{Attached, Identity};
use super::error::Problem;
use super::ffi::{Handle, Ring, UsbError};
use crate::kinect::command::REPLY_SIZE;
use crate::kinect::disparity::Packing;
use crate::kinect::model::{DEPTH_ENDPOINT, SLOT};
use crate::kinect::session::{Calibration, Control, Session, SessionError, Trouble};
use core::time::Duration;
use std::boxed::Box;
use std::sync::Arc;
use std::time::{SystemTime, UNIX_EPOCH};

/// How long a control transfer may take.
const PATIENCE: Duration = Duration::from_millis(500);

/// The control endpoint.
struct Wire(Arc<Handle>);

impl Control for Wire {
    type Error = UsbError;

    fn send(&mut self, command: &[u8]) -> Result<(), UsbError> {
        self.0.control_out(command, PATIENCE)
    }

    fn poll(&mut self, reply: &mut [u8; REPLY_SIZE]) -> Result<usize, UsbError> {
        self.0.control_in(reply, PATIENCE)
    }

    fn pause(&mut self) {
        std::thread::sleep(Duration::from_millis(1));
    }
}

/// How many transfers are out at once, and how many packets of 125 µs each has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Size {
    pub transfers: usize,
    pub packets: usize,
}

/// An open camera. Dropped, it is left as it was found.
pub(super) struct OpenCamera {
    session: Session<Wire>,
    pub depth: Ring,
    pub handle: Arc<Handle>,
    pub calibration: Calibration,
    pub identity: Identity,
}

impl OpenCamera {
    /// Opens it and lets depth flow.
    pub fn start(attached: &Attached, size: Size) -> Result<Self, Problem> {
        let node = attached.node();
        if attached.device.is_slow() {
            return Err(Problem::Slow { node });
        }
        let failed = |error| Problem::from_device(error, &node);
        let handle = Arc::new(attached.device.open().map_err(failed)?);
        handle.claim(attached.model().alternate_setting()).map_err(failed)?;
        let confused = |error: SessionError<UsbError>| match error.trouble {
            Trouble::Transfer(error) if error.is_gone() => failed(error),
            _ => Problem::Confused(Box::new(error)),
        };
        // Its milliseconds are another tag than last time's, as a rule.
        let tag = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |now| now.as_millis() as u16);
        let (session, calibration) = Session::open(Wire(Arc::clone(&handle)), attached.model(), tag).map_err(confused)?;
        let Size { transfers, packets } = size;
        let mut depth = Ring::new(Arc::clone(&handle), DEPTH_ENDPOINT, transfers, packets, SLOT).map_err(failed)?;
        depth.submit().map_err(failed)?;
        // From here on depth is stopped whatever happens.
        let mut camera = Self { session, depth, handle, calibration, identity: attached.identity() };
        camera.session.start_depth(Packing::Eleven).map_err(confused)?;
        Ok(camera)
    }
}

impl Drop for OpenCamera {
    fn drop(&mut self) {
        // One that is gone, or doesn't answer, can't be stopped.
        let _ = self.session.stop_depth();
    }
}
