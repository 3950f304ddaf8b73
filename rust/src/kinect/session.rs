//! The dialogue with the camera: opening, calibration, streams on and off. It speaks through a [`Control`] and opens nothing itself.
//!
//! A command goes out, then its reply is polled for: none yet reads as 0 bytes, or as all that was asked for. Both directions may hold
//! what an earlier session left when it was killed; it is drained before the first command, and known by its tag after it.

use super::calibration::ZeroPlane;
use super::command::{Command, CommandError, HEADER, REPLY_SIZE, Reply, code};
use super::disparity::Packing;
use super::model::Model;
use super::video::Video;

/// Polls for one reply; with a pause of a millisecond between two, at least half a second.
pub const MOST_POLLS: usize = 500;
/// Replies that may wait from before.
const MOST_STALE: usize = 16;
/// Bytes of the longest command.
const COMMAND_SIZE: usize = HEADER + 10;

/// The registers, and their values, that let depth flow, 640 × 480, 30 frames a second.
pub const fn depth_registers(packing: Packing) -> [(u16, u16); 7] {
    let format = match packing {
        Packing::Eleven => 3,
        Packing::Ten => 2,
    };
    [(0x105, 0), (0x06, 0), (0x12, format), (0x13, 1), (0x14, 30), (0x06, 2), (0x17, 0)]
}

/// The control endpoint of a camera.
pub trait Control {
    /// Why a transfer failed.
    type Error;

    /// Sends a command (bmRequestType 0x40, bRequest 0).
    ///
    /// # Errors
    /// The transfer failed.
    fn send(&mut self, command: &[u8]) -> Result<(), Self::Error>;

    /// Asks for a reply (bmRequestType 0xC0, bRequest 0): how many bytes came.
    ///
    /// # Errors
    /// The transfer failed.
    fn poll(&mut self, reply: &mut [u8; REPLY_SIZE]) -> Result<usize, Self::Error>;

    /// Waits about a millisecond.
    fn pause(&mut self);
}

/// Why a command had no use.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Trouble<E> {
    /// A transfer failed.
    Transfer(E),
    /// No reply to [`MOST_POLLS`] polls.
    Silent,
    /// What came is not its reply.
    Malformed(CommandError),
    /// The status word of the reply, which is not 0.
    Status(u16),
    /// The reply has fewer bytes than it must, its status word counted.
    Short {
        /// So many came.
        bytes: usize,
        /// So many must.
        expected: usize,
    },
}

/// A command that failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SessionError<E> {
    /// One of [`code`].
    pub command: u16,
    /// Its first word: a register, a parameter.
    pub argument: u16,
    /// Why.
    pub trouble: Trouble<E>,
}

impl<E: core::fmt::Display> core::fmt::Display for SessionError<E> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "command {:#04x} ({:#x}): ", self.command, self.argument)?;
        match &self.trouble {
            Trouble::Transfer(error) => write!(f, "{error}"),
            Trouble::Silent => write!(f, "no reply to {MOST_POLLS} polls"),
            Trouble::Malformed(error) => write!(f, "{error}"),
            Trouble::Status(status) => write!(f, "refused, status {status:#06x}"),
            Trouble::Short { bytes, expected } => write!(f, "a reply of {bytes} bytes where {expected} are expected"),
        }
    }
}

impl<E: core::fmt::Display + core::fmt::Debug> core::error::Error for SessionError<E> {}

/// What the camera says of itself on opening.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Calibration {
    /// From disparity to depth; `None` where the numbers can't be a Kinect's.
    pub zero_plane: Option<ZeroPlane>,
    /// What maps depth to the colour image: the reply to parameter 0x40 from its status word on.
    pub registration: [u8; 118],
    /// What goes with it: the reply to parameter 0x41 from its status word on.
    pub padding: [u8; 8],
}

/// A dialogue that has begun.
#[derive(Debug)]
pub struct Session<C> {
    control: C,
    tag: u16,
    /// A reply came that was ours: what comes with another tag is no longer an earlier session's.
    in_step: bool,
    reply: [u8; REPLY_SIZE],
}

impl<C: Control> Session<C> {
    /// Begins with the tag `tag`, best another one than last time, and asks for the calibration.
    ///
    /// # Errors
    /// The first command that failed.
    pub fn open(control: C, model: Model, tag: u16) -> Result<(Self, Calibration), SessionError<C::Error>> {
        let mut session = Self { control, tag, in_step: false, reply: [0; REPLY_SIZE] };
        session.drain()?;
        let padding = session.mode_parameter(0x41)?;
        let mut fixed_parameters = [0; REPLY_SIZE];
        let bytes = session.command(code::FIXED_PARAMETERS, &[0; 5], model.fixed_parameters_bytes())?;
        fixed_parameters.get_mut(..bytes.len()).unwrap_or_default().copy_from_slice(bytes);
        let registration = session.mode_parameter(0x40)?;
        let zero_plane = ZeroPlane::parse(&fixed_parameters, &session.mode_parameter::<4>(0x00)?);
        Ok((session, Calibration { zero_plane, registration, padding }))
    }

    /// Lets depth flow, 640 × 480, 30 frames a second. Whoever wants all of it has its transfers submitted before.
    ///
    /// # Errors
    /// The first command that failed.
    pub fn start_depth(&mut self, packing: Packing) -> Result<(), SessionError<C::Error>> {
        self.write(&depth_registers(packing))
    }

    /// Lets video flow, 30 images a second. Whoever wants all of it has its transfers submitted before.
    ///
    /// # Errors
    /// The first command that failed.
    pub fn start_video(&mut self, video: Video) -> Result<(), SessionError<C::Error>> {
        self.write(match video {
            Video::Color => &[(0x0c, 0), (0x0d, 1), (0x0e, 30), (0x05, 1), (0x47, 0)],
            Video::Infrared => &[(0x19, 0), (0x1a, 1), (0x1b, 30), (0x105, 0), (0x05, 3), (0x48, 0)],
        })
    }

    /// Lets nothing flow any more, depth nor video.
    ///
    /// # Errors
    /// The first command that failed.
    pub fn stop(&mut self) -> Result<(), SessionError<C::Error>> {
        self.write(&[(0x06, 0), (0x05, 0)])
    }

    /// Writes each register its value.
    fn write(&mut self, registers: &[(u16, u16)]) -> Result<(), SessionError<C::Error>> {
        registers.iter().try_for_each(|&(register, value)| self.command(code::WRITE_REGISTER, &[register, value], 2).map(drop))
    }

    /// Asks for a parameter of the mode in which depth flows; its reply from its status word on.
    fn mode_parameter<const BYTES: usize>(&mut self, parameter: u16) -> Result<[u8; BYTES], SessionError<C::Error>> {
        let reply = self.command(code::MODE_PARAMETERS, &[parameter, 0, 1, 30, 0], BYTES)?;
        // As long as was asked for.
        Ok(reply.first_chunk().copied().unwrap_or([0; BYTES]))
    }

    /// Sends a command of `words` and returns the first `expected` bytes of its reply, from its status word on.
    fn command(&mut self, command: u16, words: &[u16], expected: usize) -> Result<&[u8], SessionError<C::Error>> {
        let argument = words.first().copied().unwrap_or_default();
        let failed = |trouble| SessionError { command, argument, trouble };
        let mut payload = [0; COMMAND_SIZE - HEADER];
        for (bytes, word) in payload.chunks_exact_mut(2).zip(words) {
            bytes.copy_from_slice(&word.to_le_bytes());
        }
        let payload = payload.get(..2 * words.len()).unwrap_or_default();
        let bytes = self.exchange(&Command { command, tag: self.tag, payload }).map_err(failed)?;
        self.tag = self.tag.wrapping_add(1);
        self.in_step = true;
        if bytes < expected {
            return Err(failed(Trouble::Short { bytes, expected }));
        }
        Ok(self.reply.get(HEADER..HEADER + expected).unwrap_or_default())
    }

    /// Sends `command` and waits for its reply: how many bytes it has, from its status word on.
    fn exchange(&mut self, command: &Command<'_>) -> Result<usize, Trouble<C::Error>> {
        let mut out = [0; COMMAND_SIZE];
        let length = command.emit(&mut out).map_err(Trouble::Malformed)?;
        self.control.send(out.get(..length).unwrap_or_default()).map_err(Trouble::Transfer)?;
        for _ in 0..MOST_POLLS {
            let length = self.control.poll(&mut self.reply).map_err(Trouble::Transfer)?;
            if !is_reply(length) {
                self.control.pause();
                continue;
            }
            let reply = self.reply.get(..length).ok_or(CommandError::Short);
            match reply.and_then(Reply::parse).and_then(|reply| reply.to(command)) {
                Ok(Reply { status: 0, .. }) => return Ok(length - HEADER),
                Ok(Reply { status, .. }) => return Err(Trouble::Status(status)),
                Err(CommandError::Tag(_)) if !self.in_step => {}
                Err(error) => return Err(Trouble::Malformed(error)),
            }
        }
        Err(Trouble::Silent)
    }

    /// Takes what waits from before.
    fn drain(&mut self) -> Result<(), SessionError<C::Error>> {
        let failed = |error| SessionError { command: 0, argument: 0, trouble: Trouble::Transfer(error) };
        for _ in 0..MOST_STALE {
            if !is_reply(self.control.poll(&mut self.reply).map_err(failed)?) {
                break;
            }
        }
        Ok(())
    }
}

/// Whether what a poll brought is a reply, not the lack of one.
fn is_reply(bytes: usize) -> bool {
    bytes != 0 && bytes != REPLY_SIZE
}
