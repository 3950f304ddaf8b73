//! Packets to whole frames, and the device's clock to time.

pub mod assembler;
pub mod clock;
pub mod frame;
