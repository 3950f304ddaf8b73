//! The isochronous packet: a 12-byte header, then a piece of a frame.
//!
//! | bytes | what |
//! |---|---|
//! | 0–1 | magic `52 42` |
//! | 3 | flag: high half 7 depth, 8 video; low half 1 first, 2 middle, 5 last of its frame |
//! | 5 | sequence, one per stream, running on across frames |
//! | 6–7 | the packet's size, big-endian, as it seems; not relied on |
//! | 8–11 | timestamp, ticks of 60 MHz, little-endian; 0 in a frame's first packet |
//!
//! As libfreenect and the kernel's `gspca_kinect` read it.

use super::le32;

/// Bytes of the header.
pub const HEADER: usize = 12;
/// Bytes of payload in every packet of a depth frame but its last.
pub const DEPTH_PAYLOAD: usize = 1748;
/// Bytes of payload in every packet of a video frame but its last.
pub const VIDEO_PAYLOAD: usize = 1908;
/// Ticks of the device's clock in a second.
pub const TICKS_PER_SECOND: u32 = 60_000_000;
/// Frames of depth that it sends in a second.
pub const FRAMES_PER_SECOND: f64 = 30.0;

const MAGIC: [u8; 2] = [0x52, 0x42];

/// Which of the camera's streams.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs)] // The names say it.
pub enum Stream {
    Depth,
    Video,
}

/// Where in its frame a packet stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs)] // The names say it.
pub enum Place {
    First,
    Middle,
    Last,
}

/// Why bytes are no packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PacketError {
    /// No bytes at all, as is normal between frames.
    Empty,
    /// Fewer bytes than a header has.
    Short,
    /// The first two bytes are not the magic.
    Magic([u8; 2]),
    /// A flag that names no stream or no place.
    Flag(u8),
}

impl core::fmt::Display for PacketError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Empty => write!(f, "empty packet"),
            Self::Short => write!(f, "packet shorter than its header of {HEADER} bytes"),
            Self::Magic([a, b]) => write!(f, "packet begins with {a:02x} {b:02x}, not 52 42"),
            Self::Flag(flag) => write!(f, "packet flag {flag:#04x} is none of 71, 72, 75, 81, 82, 85"),
        }
    }
}

impl core::error::Error for PacketError {}

/// A view of bytes that are at least a header; what they say may still make no sense.
#[derive(Clone, Copy, Debug)]
pub struct Packet<'a> {
    header: &'a [u8; HEADER],
    payload: &'a [u8],
}

impl<'a> Packet<'a> {
    /// A view of `bytes`.
    ///
    /// # Errors
    /// [`PacketError::Empty`], [`PacketError::Short`].
    pub fn new(bytes: &'a [u8]) -> Result<Self, PacketError> {
        match bytes.split_first_chunk() {
            Some((header, payload)) => Ok(Self { header, payload }),
            None if bytes.is_empty() => Err(PacketError::Empty),
            None => Err(PacketError::Short),
        }
    }

    /// Bytes 0 and 1.
    pub fn magic(&self) -> [u8; 2] {
        [self.header[0], self.header[1]]
    }

    /// Byte 3.
    pub fn flag(&self) -> u8 {
        self.header[3]
    }

    /// Byte 5.
    pub fn sequence(&self) -> u8 {
        self.header[5]
    }

    /// Bytes 6 and 7.
    pub fn size(&self) -> u16 {
        u16::from_be_bytes([self.header[6], self.header[7]])
    }

    /// Bytes 8 to 11.
    pub fn timestamp_ticks(&self) -> u32 {
        le32(self.header, 8)
    }

    /// What follows the header.
    pub fn payload(&self) -> &'a [u8] {
        self.payload
    }
}

/// What a header says, where it makes sense.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Header {
    /// Depth or video.
    pub stream: Stream,
    /// Where in its frame.
    pub place: Place,
    /// Counts the stream's packets, modulo 256.
    pub sequence: u8,
    /// Of the 60 MHz clock, modulo 2³²; 0 in a frame's first packet.
    pub timestamp_ticks: u32,
}

impl Header {
    /// What the header of `packet` says.
    ///
    /// # Errors
    /// [`PacketError::Magic`], [`PacketError::Flag`].
    pub fn parse(packet: &Packet<'_>) -> Result<Self, PacketError> {
        if packet.magic() != MAGIC {
            return Err(PacketError::Magic(packet.magic()));
        }
        let flag = packet.flag();
        let stream = match flag >> 4 {
            7 => Stream::Depth,
            8 => Stream::Video,
            _ => return Err(PacketError::Flag(flag)),
        };
        let place = match flag & 15 {
            1 => Place::First,
            2 => Place::Middle,
            5 => Place::Last,
            _ => return Err(PacketError::Flag(flag)),
        };
        Ok(Self { stream, place, sequence: packet.sequence(), timestamp_ticks: packet.timestamp_ticks() })
    }

    /// The bytes of this header before `payload` bytes of payload. The two bytes without a known meaning are 0.
    pub fn emit(&self, payload: u16) -> [u8; HEADER] {
        let stream = match self.stream {
            Stream::Depth => 0x70,
            Stream::Video => 0x80,
        };
        let place = match self.place {
            Place::First => 1,
            Place::Middle => 2,
            Place::Last => 5,
        };
        let [high, low] = payload.saturating_add(HEADER as u16).to_be_bytes();
        let [a, b, c, d] = self.timestamp_ticks.to_le_bytes();
        [MAGIC[0], MAGIC[1], 0, stream | place, 0, self.sequence, high, low, a, b, c, d]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_header_is_these_bytes() {
        let bytes = [0x52, 0x42, 0, 0x75, 0, 0xfe, 0x06, 0xe0, 0x80, 0x84, 0x1e, 0x01, 9];
        let packet = Packet::new(&bytes).unwrap();
        let header = Header { stream: Stream::Depth, place: Place::Last, sequence: 254, timestamp_ticks: 0x011e_8480 };
        assert_eq!(Header::parse(&packet), Ok(header));
        assert_eq!((packet.payload(), packet.size()), (&[9][..], 1760));
        assert_eq!(header.emit(1748), bytes[..HEADER]);
    }

    #[test]
    fn what_is_no_packet_says_why() {
        assert_eq!(Packet::new(&[]).err(), Some(PacketError::Empty));
        assert_eq!(Packet::new(&[0x52; 11]).err(), Some(PacketError::Short));
        let parsed = |change: fn(&mut [u8; HEADER])| {
            let mut bytes = Header { stream: Stream::Video, place: Place::First, sequence: 0, timestamp_ticks: 0 }.emit(0);
            change(&mut bytes);
            Header::parse(&Packet::new(&bytes).unwrap())
        };
        assert_eq!(parsed(|_| ()).unwrap().stream, Stream::Video);
        assert_eq!(parsed(|b| b[1] = 0x24), Err(PacketError::Magic([0x52, 0x24])));
        for flag in [0x61, 0x70, 0x74, 0x91, 0xff] {
            assert!(Header::parse(&Packet::new(&[0x52, 0x42, 0, flag, 0, 0, 0, 0, 0, 0, 0, 0]).unwrap()) == Err(PacketError::Flag(flag)));
        }
    }

    proptest! {
        #[test]
        fn any_header_that_makes_sense_is_written_as_it_was(mut bytes in prop::array::uniform12(any::<u8>()), sense in any::<bool>()) {
            if sense {
                (bytes[0], bytes[1], bytes[3]) = (0x52, 0x42, 0x72);
            }
            if let Ok(header) = Header::parse(&Packet::new(&bytes).unwrap()) {
                prop_assert_eq!(Header::parse(&Packet::new(&header.emit(0)).unwrap()), Ok(header));
            } else {
                prop_assert!(!sense);
            }
        }
    }
}
