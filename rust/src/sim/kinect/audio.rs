//! The microphones and hubs, as far as others need them: models 1473 and K4W keep their serial number with the microphones.

use super::descriptor::Descriptors;
use super::{Answer, Device, Setup, Stall};

/// The microphones, which say who they are and nothing else.
pub struct Audio(Descriptors);

impl Audio {
    /// With this serial number.
    pub fn new(serial: &str) -> Self {
        Self(Descriptors::audio(serial))
    }
}

/// A hub, of which nobody asks anything.
pub struct Hub(Descriptors);

impl Hub {
    /// That inside of a Kinect.
    pub fn inside() -> Self {
        Self(Descriptors::hub())
    }

    /// The bus's own.
    pub fn root() -> Self {
        Self(Descriptors::root_hub())
    }
}

impl Device for Hub {
    fn descriptors(&self) -> &Descriptors {
        &self.0
    }

    fn vendor_request(&mut self, _: Setup, _: &[u8], _: i64) -> Answer {
        Err(Stall)
    }
}

impl Device for Audio {
    fn descriptors(&self) -> &Descriptors {
        &self.0
    }

    fn vendor_request(&mut self, _: Setup, _: &[u8], _: i64) -> Answer {
        Err(Stall)
    }
}
