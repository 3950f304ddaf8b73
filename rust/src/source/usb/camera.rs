//! A Kinect that is open and sends depth.

use super::devices::{Attached, Identity};
use super::error::Problem;
use super::ffi::{Handle, Ring, UsbError};
use crate::kinect::command::REPLY_SIZE;
use crate::kinect::disparity::Packing;
use crate::kinect::model::{DEPTH_ENDPOINT, SLOT, VIDEO_ENDPOINT};
use crate::kinect::session::{Calibration, Control, Session, SessionError, Trouble};
use crate::kinect::video::Video;
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

/// What is asked of a camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Wanted {
    /// How many transfers are out at once, for each endpoint.
    pub transfers: usize,
    /// How many packets of 125 µs each has.
    pub packets: usize,
    /// Beside depth.
    pub video: Option<Video>,
}

/// An open camera. Dropped, it is left as it was found.
pub(super) struct OpenCamera {
    session: Session<Wire>,
    pub depth: Ring,
    pub video: Option<Ring>,
    pub handle: Arc<Handle>,
    pub calibration: Calibration,
    pub identity: Identity,
}

impl OpenCamera {
    /// Opens it and lets flow what is wanted.
    pub fn start(attached: &Attached, wanted: Wanted) -> Result<Self, Problem> {
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
        let (mut session, calibration) = Session::open(Wire(Arc::clone(&handle)), attached.model(), tag).map_err(confused)?;
        // A program that was killed may have left them on.
        session.stop().map_err(confused)?;
        let ring = |endpoint| {
            let mut ring = Ring::new(Arc::clone(&handle), endpoint, wanted.transfers, wanted.packets, SLOT)?;
            ring.submit().map(|()| ring)
        };
        let depth = ring(DEPTH_ENDPOINT).map_err(failed)?;
        let video = wanted.video.map(|_| ring(VIDEO_ENDPOINT)).transpose().map_err(failed)?;
        // From here on all is stopped whatever happens.
        let mut camera = Self { session, depth, video, handle, calibration, identity: attached.identity() };
        camera.session.start_depth(Packing::Eleven).map_err(confused)?;
        if let Some(video) = wanted.video {
            camera.session.start_video(video).map_err(confused)?;
        }
        Ok(camera)
    }
}

impl Drop for OpenCamera {
    fn drop(&mut self) {
        // One that is gone, or doesn't answer, can't be stopped.
        let _ = self.session.stop();
    }
}
