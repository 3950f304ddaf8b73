//! Packets to frames. A frame is whole or says which of its samples are missing; it is never torn, never stale, never mixed.
//!
//! A packet's place in its frame is its sequence less that of the frame's first packet, modulo 256; a frame has fewer packets than
//! that, but a gap may be longer. So a frame is handed out only when its end confirms its beginning: by its last packet at the last
//! place, or by the next frame's first packet right behind it. Frames shift against the sequence by 14 (10 bits: 36) each, so that
//! after a gap of whole frames the ends don't meet for 128 (64) frames, over 2 s; and a silence of [`SILENCE_NS`] begins anew.
//!
//! A packet that is late, out of the frame before, reads as one far ahead in this one. What comes next tells: of two packets more than
//! `REACH` places apart, the one ahead was not this frame's.
//!
//! Bits that flip inside a packet's samples can't be seen here: USB's checksum is for them. A flipped sequence is seen when the
//! packet whose place was taken comes too: then neither is believed.

use super::clock::Clock;
use super::frame::{Frame, PacketSet, erase, missing};
use crate::event::Counters;
use crate::kinect::disparity::Packing;
use crate::kinect::layout::Layout;
use crate::kinect::packet::{Header, Packet, PacketError, Place};

/// After so long without a packet the sequence no longer tells how many were lost, ns.
pub const SILENCE_NS: i64 = 1_000_000_000;

/// A packet comes at most so many places late: half a round of the sequence, so that the nearer of two readings is taken.
const REACH: u8 = 128;

/// The frame buffer has fewer bytes than a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BufferTooSmall {
    /// [`Layout::frame_bytes`].
    pub needed: usize,
}

impl core::fmt::Display for BufferTooSmall {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "the frame buffer needs {} bytes", self.needed)
    }
}

impl core::error::Error for BufferTooSmall {}

/// The frame that is being put together.
#[derive(Clone, Copy, Debug)]
struct Current {
    /// Sequence of its first packet.
    base: u8,
    /// In the buffer, as the device sent it.
    present: PacketSet,
    /// Two packets that differ claimed the place.
    doubtful: PacketSet,
    /// Packets that claimed a taken place with other samples.
    clashes: u64,
    /// The latest place that is taken.
    front: u8,
    /// Place and ticks of the latest packet that has a time.
    stamp: Option<(u8, u32)>,
}

impl Current {
    fn new(base: u8) -> Self {
        Self { base, present: PacketSet::default(), doubtful: PacketSet::default(), clashes: 0, front: 0, stamp: None }
    }

    /// Whether a packet at `index` is rather one of the next frame: nearer ahead of the front than behind it, and the front no straggler
    /// out of the frame before, as most of the places up to it are taken.
    fn is_overtaken(&self, index: u8) -> bool {
        let taken = (index..self.front).filter(|place| self.present.contains(*place + 1)).count();
        self.front > index.saturating_add(REACH) && 2 * taken > usize::from(self.front - index)
    }

    /// Gives back the places too far ahead of a packet at `index`, and says how many packets came in vain.
    fn disown(&mut self, index: u8) -> u64 {
        let last = index.saturating_add(REACH);
        if self.front <= last {
            return 0;
        }
        let before = self.present.len();
        (last + 1..=self.front).for_each(|ahead| self.present.remove(ahead));
        self.front = last;
        self.stamp = self.stamp.filter(|(at, _)| *at <= last);
        (before - self.present.len()) as u64
    }
}

/// Puts the packets of an endpoint together, depth's where nothing else is said, in a buffer `B` that is the caller's (a slice, a vector).
#[derive(Clone, Debug)]
pub struct Assembler<B, L = Packing> {
    packing: L,
    buffer: B,
    clock: Clock,
    counters: Counters,
    empty: u64,
    current: Option<Current>,
    /// Sequence of the first packet that is not yet counted as come or lost.
    counted: Option<u8>,
    /// Packets since then that came and could not be used, because their frame was given up.
    strays: u64,
    /// Packets lost that no frame that was handed out has told of.
    untold: u64,
    newest_ns: Option<i64>,
}

impl<B: AsMut<[u8]>, L: Layout> Assembler<B, L> {
    /// An assembler of frames packed as `packing`, in `buffer` of at least [`Layout::frame_bytes`].
    ///
    /// # Errors
    /// A buffer that is too small.
    pub fn new(packing: L, mut buffer: B) -> Result<Self, BufferTooSmall> {
        let needed = packing.frame_bytes();
        if buffer.as_mut().len() < needed {
            return Err(BufferTooSmall { needed });
        }
        let (clock, counters) = Default::default();
        Ok(Self { packing, buffer, clock, counters, empty: 0, current: None, counted: None, strays: 0, untold: 0, newest_ns: None })
    }

    /// `frames`, `frames_incomplete`, `packets` (empty ones apart), `packets_invalid` (short, foreign, doubled, too late, or junk) and
    /// `packets_lost`: places up to the last frame that was handed out for which no valid packet came in time.
    pub fn counters(&self) -> Counters {
        self.counters
    }

    /// Packets of length zero, of which there are some between any two frames.
    pub fn empty_packets(&self) -> u64 {
        self.empty
    }

    /// The device was away: its next packet is the first of another run of sequence and clock.
    pub fn begin_anew(&mut self) {
        (self.current, self.counted) = (None, None);
        self.clock.begin_anew();
    }

    /// Takes a packet of the endpoint that arrived at `arrival_ns` on the host's clock; a frame that it ends goes to `sink`.
    pub fn push(&mut self, packet: &[u8], arrival_ns: i64, sink: &mut impl FnMut(Frame<'_, L>)) {
        let (header, payload) = match Packet::new(packet).and_then(|packet| Ok((Header::parse(&packet)?, packet.payload()))) {
            Err(PacketError::Empty) => {
                self.empty += 1;
                return;
            }
            Err(_) => return self.refuse(),
            Ok(valid) => valid,
        };
        if header.stream != L::STREAM || payload.len() != self.payload_bytes(header.place) {
            return self.refuse();
        }
        if self.newest_ns.is_some_and(|newest| arrival_ns.saturating_sub(newest) > SILENCE_NS) {
            (self.current, self.counted) = (None, None);
        }
        self.newest_ns = Some(arrival_ns);
        self.counters.packets += 1;
        self.locate(header, payload, arrival_ns, sink);
    }

    /// Finds the frame and the place that a valid packet belongs to.
    fn locate(&mut self, header: Header, payload: &[u8], arrival_ns: i64, sink: &mut impl FnMut(Frame<'_, L>)) {
        let Some(current) = self.current else {
            if header.place == Place::First {
                self.begin(header, payload);
            } else {
                self.strays += 1;
            }
            return;
        };
        let packets = self.packing.packets() as u8;
        let index = header.sequence.wrapping_sub(current.base);
        // Behind the last place are both the next frame's first and the previous one's last.
        let ends = current.front >= packets / 2;
        let place = match index {
            0 => Place::First,
            _ if index == packets - 1 => Place::Last,
            _ => Place::Middle,
        };
        // Just before the first place is only a last packet.
        let is_beyond = index >= packets && (ends || index == u8::MAX);
        let skips_an_end = header.place == Place::Middle && (is_beyond || current.is_overtaken(index));
        if skips_an_end {
            // The one's last packet and the other's first are lost: nothing confirms the one; its own last may confirm the other.
            self.give_up();
            self.current = Some(Current::new(current.base.wrapping_add(packets)));
            self.fill(index.wrapping_sub(packets), header, payload);
        } else if index < packets && header.place == place {
            self.fill(index, header, payload);
            if place == Place::Last {
                self.deliver(arrival_ns, sink);
            }
        } else if header.place == Place::First {
            if index == packets {
                self.deliver(arrival_ns, sink);
            }
            self.give_up();
            self.begin(header, payload);
        } else if index >= packets && !ends && (header.place == Place::Last) == (index == u8::MAX) {
            // Of the frame before, which is gone.
            self.counters.packets_invalid += 1;
        } else {
            // A place that contradicts the sequence: more was lost than it can count.
            self.give_up();
            self.strays += 1;
        }
    }

    /// A first packet: the frame begins here, whatever was before.
    fn begin(&mut self, header: Header, payload: &[u8]) {
        self.current = Some(Current::new(header.sequence));
        if self.counted.is_none() {
            (self.counted, self.strays) = (Some(header.sequence), 0);
        }
        self.fill(0, header, payload);
    }

    /// Puts a packet in its place, if that is free.
    fn fill(&mut self, index: u8, header: Header, payload: &[u8]) {
        let Some(current) = &mut self.current else { return };
        self.counters.packets_invalid += current.disown(index);
        let start = usize::from(index) * L::PAYLOAD;
        let Some(place) = self.buffer.as_mut().get_mut(start..start + payload.len()) else { return };
        if current.present.contains(index) {
            if place == payload {
                self.counters.packets_invalid += 1;
            } else {
                current.doubtful.insert(index);
                current.clashes += 1;
            }
            return;
        }
        place.copy_from_slice(payload);
        current.present.insert(index);
        current.front = current.front.max(index);
        if header.timestamp_ticks != 0 && current.stamp.is_none_or(|(at, _)| at < index) {
            current.stamp = Some((index, header.timestamp_ticks));
        }
    }

    /// The current frame is not to be trusted: its packets came in vain.
    fn give_up(&mut self) {
        if let Some(current) = self.current.take() {
            self.strays += current.present.len() as u64 + current.clashes;
        }
    }

    /// Hands the current frame out and awaits the next right behind it.
    fn deliver(&mut self, arrival_ns: i64, sink: &mut impl FnMut(Frame<'_, L>)) {
        let Some(current) = self.current else { return };
        let (packing, packets) = (self.packing, self.packing.packets());
        let next = current.base.wrapping_add(packets as u8);
        self.current = Some(Current::new(next));
        self.count(current);
        // Without any time, no stamp would be true.
        let Some((_, ticks)) = current.stamp else { return };
        let timestamp_ns = self.clock.stamp_ns(ticks, arrival_ns);
        let mut present = current.present;
        (0..=u8::MAX).filter(|index| current.doubtful.contains(*index)).for_each(|index| present.remove(index));
        let Some(packed) = self.buffer.as_mut().get_mut(..packing.frame_bytes()) else { return };
        for samples in missing(packing, present) {
            erase(packed, packing, &samples);
        }
        let lost = core::mem::take(&mut self.untold);
        let frame = Frame { timestamp_ns, arrival_ns, packed, packing, present, lost };
        self.counters.frames += 1;
        self.counters.frames_incomplete += u64::from(!frame.is_whole());
        sink(frame);
    }

    /// Counts what was lost up to the end of the frame `current`.
    fn count(&mut self, current: Current) {
        let packets = self.packing.packets();
        let counted = self.counted.unwrap_or(current.base);
        let frames_between = (0..128).find(|frames| counted.wrapping_add((frames * packets) as u8) == current.base).unwrap_or(0);
        let lost = ((frames_between * packets) as u64).saturating_sub(self.strays) + (packets - current.present.len()) as u64;
        self.counters.packets_lost += lost;
        self.untold += lost;
        self.counters.packets_invalid += current.clashes;
        (self.counted, self.strays) = (Some(current.base.wrapping_add(packets as u8)), 0);
    }

    fn payload_bytes(&self, place: Place) -> usize {
        match place {
            Place::Last => self.packing.frame_bytes() - (self.packing.packets() - 1) * L::PAYLOAD,
            _ => L::PAYLOAD,
        }
    }

    fn refuse(&mut self) {
        self.counters.packets += 1;
        self.counters.packets_invalid += 1;
    }
}
