//! The microphones, as far as others need them: where models 1473 and K4W keep their serial number.

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

impl Device for Audio {
    fn descriptors(&self) -> &Descriptors {
        &self.0
    }

    fn vendor_request(&mut self, _: &Setup, _: &[u8], _: i64) -> Answer {
        Err(Stall)
    }
}
