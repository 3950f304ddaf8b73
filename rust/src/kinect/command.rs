//! Control messages: commands to the camera and its replies.
//!
//! Both begin with a header of 8 bytes: magic, half the length of what follows, command, tag, little-endian 16 bits each. A reply's
//! payload begins with a status word. A command goes out with bmRequestType 0x40, its reply is polled with 0xC0, bRequest 0 both.

use super::le16;

/// Bytes of the header.
pub const HEADER: usize = 8;
/// Bytes to ask for when polling for a reply; none is longer.
pub const REPLY_SIZE: usize = 0x200;

/// What begins a message.
const COMMAND_MAGIC: u16 = u16::from_le_bytes([0x47, 0x4d]);
const REPLY_MAGIC: u16 = u16::from_le_bytes([0x52, 0x42]);

/// Codes of commands.
pub mod code {
    /// Reads a register: its address; replies with address and value.
    pub const READ_REGISTER: u16 = 0x02;
    /// Writes a register: address, value.
    pub const WRITE_REGISTER: u16 = 0x03;
    /// Fixed parameters, the zero plane among them.
    pub const FIXED_PARAMETERS: u16 = 0x04;
    /// Parameters of a mode, the shift among them.
    pub const MODE_PARAMETERS: u16 = 0x16;
    /// Registers of the image sensor.
    pub const CMOS: u16 = 0x95;
}

/// Why bytes are no message, or not the awaited one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CommandError {
    /// Fewer bytes than a header, or than a reply with its status word.
    Short,
    /// Another magic.
    Magic(u16),
    /// The header claims another length than the message has.
    Length {
        /// Bytes of payload, as claimed.
        claimed: usize,
        /// Bytes of payload, as they are.
        actual: usize,
    },
    /// A reply to another command.
    Command(u16),
    /// A reply to an earlier or later command.
    Tag(u16),
    /// A payload that is odd, longer than a header can say, or than there is room for.
    Payload(usize),
}

impl core::fmt::Display for CommandError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Short => write!(f, "control message is cut short"),
            Self::Magic(magic) => write!(f, "control message begins with {magic:#06x}"),
            Self::Length { claimed, actual } => write!(f, "control message claims {claimed} bytes of payload and has {actual}"),
            Self::Command(command) => write!(f, "reply to another command, {command:#04x}"),
            Self::Tag(tag) => write!(f, "reply with another tag, {tag:#06x}"),
            Self::Payload(bytes) => write!(f, "a payload of {bytes} bytes fits no control message, or not the room for it"),
        }
    }
}

impl core::error::Error for CommandError {}

/// A command to the camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Command<'a> {
    /// One of [`code`], or another.
    pub command: u16,
    /// Counts up; the reply carries it too.
    pub tag: u16,
    /// An even number of bytes.
    pub payload: &'a [u8],
}

impl<'a> Command<'a> {
    /// The command in `bytes`.
    ///
    /// # Errors
    /// All but [`CommandError::Command`], `Tag` and `Payload`.
    pub fn parse(bytes: &'a [u8]) -> Result<Self, CommandError> {
        let (command, tag, payload) = parse(bytes, COMMAND_MAGIC)?;
        Ok(Self { command, tag, payload })
    }

    /// Writes it at the beginning of `out` and returns how many bytes it takes.
    ///
    /// # Errors
    /// [`CommandError::Payload`].
    pub fn emit(&self, out: &mut [u8]) -> Result<usize, CommandError> {
        emit(COMMAND_MAGIC, self.command, self.tag, [&[], self.payload], out)
    }
}

/// The camera's reply.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reply<'a> {
    /// That of the command.
    pub command: u16,
    /// That of the command.
    pub tag: u16,
    /// 0 where all is well.
    pub status: u16,
    /// What follows the status word.
    pub payload: &'a [u8],
}

impl<'a> Reply<'a> {
    /// The reply in `bytes`, to whatever command.
    ///
    /// # Errors
    /// [`CommandError::Short`], `Magic`, `Length`.
    pub fn parse(bytes: &'a [u8]) -> Result<Self, CommandError> {
        let (command, tag, words) = parse(bytes, REPLY_MAGIC)?;
        let (status, payload) = words.split_first_chunk().ok_or(CommandError::Short)?;
        Ok(Self { command, tag, status: u16::from_le_bytes(*status), payload })
    }

    /// This reply, if it is the one to `command`.
    ///
    /// # Errors
    /// [`CommandError::Command`], `Tag`.
    pub fn to(self, command: &Command<'_>) -> Result<Self, CommandError> {
        if self.tag != command.tag {
            Err(CommandError::Tag(self.tag))
        } else if self.command != command.command {
            Err(CommandError::Command(self.command))
        } else {
            Ok(self)
        }
    }

    /// Writes it at the beginning of `out` and returns how many bytes it takes.
    ///
    /// # Errors
    /// [`CommandError::Payload`].
    pub fn emit(&self, out: &mut [u8]) -> Result<usize, CommandError> {
        emit(REPLY_MAGIC, self.command, self.tag, [&self.status.to_le_bytes(), self.payload], out)
    }
}

/// Command, tag, payload.
fn parse(bytes: &[u8], magic: u16) -> Result<(u16, u16, &[u8]), CommandError> {
    let (header, payload) = bytes.split_first_chunk::<HEADER>().ok_or(CommandError::Short)?;
    let (claimed, actual) = (2 * usize::from(le16(header, 2)), payload.len());
    if le16(header, 0) != magic {
        Err(CommandError::Magic(le16(header, 0)))
    } else if claimed != actual {
        Err(CommandError::Length { claimed, actual })
    } else {
        Ok((le16(header, 4), le16(header, 6), payload))
    }
}

fn emit(magic: u16, command: u16, tag: u16, payload: [&[u8]; 2], out: &mut [u8]) -> Result<usize, CommandError> {
    let [status, rest] = payload;
    let bytes = status.len().saturating_add(rest.len());
    let error = CommandError::Payload(bytes);
    let half = u16::try_from(bytes / 2).ok().filter(|_| bytes.is_multiple_of(2)).ok_or(error)?;
    let out = out.get_mut(..HEADER + bytes).ok_or(error)?;
    let (header, body) = out.split_at_mut(HEADER);
    for (to, word) in header.chunks_exact_mut(2).zip([magic, half, command, tag]) {
        to.copy_from_slice(&word.to_le_bytes());
    }
    let (head, tail) = body.split_at_mut(status.len());
    head.copy_from_slice(status);
    tail.copy_from_slice(rest);
    Ok(HEADER + bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_command_is_these_bytes() {
        let command = Command { command: code::WRITE_REGISTER, tag: 0x1267, payload: &[6, 0, 2, 0] };
        let mut out = [0; 12];
        assert_eq!(command.emit(&mut out), Ok(12));
        assert_eq!(out, [0x47, 0x4d, 2, 0, 3, 0, 0x67, 0x12, 6, 0, 2, 0]);
        assert_eq!(Command::parse(&out), Ok(command));
        assert_eq!(Reply::parse(&out), Err(CommandError::Magic(0x4d47)));
        assert_eq!(Command::parse(&out[..10]), Err(CommandError::Length { claimed: 4, actual: 2 }));
        assert_eq!(command.emit(&mut [0; 11]), Err(CommandError::Payload(4)));
        assert_eq!(Command { payload: &[1], ..command }.emit(&mut out), Err(CommandError::Payload(1)));
    }

    #[test]
    fn a_reply_to_another_command_is_refused() {
        let bytes = [0x52, 0x42, 1, 0, 3, 0, 0x67, 0x12, 5, 0];
        let command = Command { command: 3, tag: 0x1267, payload: &[] };
        let reply = Reply::parse(&bytes).unwrap();
        assert_eq!(reply.to(&command), Ok(Reply { command: 3, tag: 0x1267, status: 5, payload: &[] }));
        assert_eq!(reply.to(&Command { tag: 0x1268, ..command }), Err(CommandError::Tag(0x1267)));
        assert_eq!(reply.to(&Command { command: 2, ..command }), Err(CommandError::Command(3)));
        assert_eq!(Reply::parse(&[0x52, 0x42, 0, 0, 3, 0, 0x67, 0x12]), Err(CommandError::Short), "no status word");
    }

    proptest! {
        #[test]
        fn whatever_parses_is_written_as_it_was(mut bytes in prop::collection::vec(any::<u8>(), 0..40), sense in any::<bool>()) {
            if sense && bytes.len() >= 10 && bytes.len() % 2 == 0 {
                let half = (bytes.len() - HEADER) as u8 / 2;
                bytes[..4].copy_from_slice(&[0x52, 0x42, half, 0]);
            }
            let mut out = [0; 40];
            if let Ok(reply) = Reply::parse(&bytes) {
                let length = reply.emit(&mut out).unwrap();
                prop_assert_eq!(&out[..length], &bytes[..]);
            } else {
                prop_assert!(!(sense && bytes.len() >= 10 && bytes.len() % 2 == 0));
            }
        }
    }
}
