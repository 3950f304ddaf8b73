//! What happens to packets on a bad day, on purpose: a wrapper around any source of them.

use super::{Faults, Input, Kinect, LatestVideo, Source, SourceError};
use crate::geometry::camera::Camera;
use crate::kinect::packet::{HEADER, Header, Place, Stream};
use std::boxed::Box;
use std::collections::VecDeque;
use std::format;
use std::string::String;
use std::sync::Arc;
use std::time::Duration;
use std::vec::Vec;

/// A packet that comes late comes after at most so many others.
const LATEST: u64 = 16;
/// How long a silence lasts, ns: longer than the sequence numbers can tell of.
const SILENCE_NS: i64 = 1_500_000_000;
/// Bytes of a packet that is none of depth's, at most.
const FOREIGN: u64 = 1920;

/// How often it happened.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Injected {
    /// Packets lost, those of silences counted.
    pub lost: u64,
    /// Packets emptied.
    pub empty: u64,
    /// Packets cut.
    pub short: u64,
    /// Packets doubled.
    pub double: u64,
    /// Packets of others.
    pub foreign: u64,
    /// Packets that came late.
    pub late: u64,
    /// Bits flipped.
    pub flipped: u64,
}

/// Hands on what a source of packets delivers, with faults. The same seed makes the same ones.
pub struct Faulty {
    name: String,
    source: Box<dyn Source>,
    faults: Faults,
    injected: Injected,
    random: Random,
    /// Packets of a burst still to be lost.
    losing: u64,
    silent_until: Option<i64>,
    /// Late packets, each after how many others.
    late: Vec<(u64, Arrived)>,
    ready: VecDeque<Arrived>,
    current: Arrived,
}

#[derive(Clone, Debug, Default)]
struct Arrived {
    bytes: Vec<u8>,
    arrival_ns: i64,
}

impl Faulty {
    /// `source` with `faults`, called `name`.
    ///
    /// # Errors
    /// A source that delivers no packets.
    pub fn new(name: &str, source: Box<dyn Source>, faults: Faults) -> Result<Self, SourceError> {
        if source.kinect().is_none() {
            return Err(SourceError::unknown(
                name,
                "faults happen to packets, and it delivers none: captures do, the demo, and sim:SCENE?packets=1",
            ));
        }
        Ok(Self {
            name: name.into(),
            source,
            faults,
            injected: Injected::default(),
            random: Random(faults.seed),
            losing: 0,
            silent_until: None,
            late: Vec::new(),
            ready: VecDeque::new(),
            current: Arrived::default(),
        })
    }

    /// What happened so far.
    pub fn injected(&self) -> Injected {
        self.injected
    }

    /// Whether this packet never comes.
    fn is_lost(&mut self, arrival_ns: i64) -> bool {
        if self.random.chance(self.faults.silence) {
            self.silent_until = Some(arrival_ns.saturating_add(SILENCE_NS));
        }
        if self.losing == 0 && self.random.chance(self.faults.lose / self.faults.burst) {
            // Geometric: after each lost one the next is lost, too, but for once in `burst` times.
            self.losing = 1;
            while self.losing < 1 << 20 && !self.random.chance(1.0 / self.faults.burst) {
                self.losing += 1;
            }
        }
        let is_lost = self.losing > 0;
        self.losing = self.losing.saturating_sub(1);
        is_lost || self.silent_until.is_some_and(|until| arrival_ns < until)
    }

    /// One packet of the source, and what becomes of it.
    fn suffer(&mut self, mut packet: Arrived) {
        let Faults { empty, short, double, foreign, late, flip, .. } = self.faults;
        if self.random.chance(foreign) {
            self.injected.foreign += 1;
            let bytes = self.foreign();
            self.deliver(Arrived { bytes, arrival_ns: packet.arrival_ns });
        }
        if self.is_lost(packet.arrival_ns) {
            self.injected.lost += 1;
            return;
        }
        if self.random.chance(empty) {
            self.injected.empty += 1;
            packet.bytes.clear();
        }
        if !packet.bytes.is_empty() && self.random.chance(short) {
            self.injected.short += 1;
            packet.bytes.truncate(self.random.below(packet.bytes.len() as u64) as usize);
        }
        if !packet.bytes.is_empty() && self.random.chance(flip) {
            self.injected.flipped += 1;
            let bit = self.random.below(packet.bytes.len() as u64 * 8);
            packet.bytes[(bit / 8) as usize] ^= 1 << (bit % 8);
        }
        if self.random.chance(double) {
            self.injected.double += 1;
            self.deliver(packet.clone());
        }
        if self.random.chance(late) {
            self.injected.late += 1;
            let after = 1 + self.random.below(LATEST);
            self.late.push((after, packet));
        } else {
            self.deliver(packet);
        }
    }

    /// Hands on a packet, and the late ones that have waited long enough then.
    fn deliver(&mut self, packet: Arrived) {
        let arrival_ns = packet.arrival_ns;
        self.ready.push_back(packet);
        for (after, _) in &mut self.late {
            *after -= 1;
        }
        self.late.sort_by_key(|(after, _)| *after);
        let due = self.late.partition_point(|(after, _)| *after == 0);
        self.ready.extend(self.late.drain(..due).map(|(_, packet)| Arrived { arrival_ns, ..packet }));
    }

    /// A packet of video, or of noise.
    fn foreign(&mut self) -> Vec<u8> {
        let sequence = self.random.below(256) as u8;
        if self.random.chance(0.5) {
            let header = Header { stream: Stream::Video, place: Place::Middle, sequence, timestamp_ticks: 0 };
            return [&header.emit(FOREIGN as u16 - HEADER as u16)[..], &[0; FOREIGN as usize - HEADER]].concat();
        }
        let length = self.random.below(FOREIGN);
        (0..length).map(|_| self.random.below(256) as u8).collect()
    }
}

impl Source for Faulty {
    fn name(&self) -> &str {
        &self.name
    }

    fn camera(&self) -> Option<Camera> {
        self.source.camera()
    }

    fn kinect(&self) -> Option<Kinect> {
        self.source.kinect()
    }

    fn is_live(&self) -> bool {
        self.source.is_live()
    }

    fn video(&self) -> Option<Arc<LatestVideo>> {
        self.source.video()
    }

    fn wait_for_return(&mut self, patience: Duration) {
        self.source.wait_for_return(patience);
    }

    fn remarks(&self) -> Vec<String> {
        let Injected { lost, empty, short, double, foreign, late, flipped } = self.injected;
        let own = format!(
            "faults on purpose: {lost} packets lost, {empty} empty, {short} short, {double} doubled, {foreign} foreign, {late} late, {flipped} with a flipped bit"
        );
        let mut remarks = self.source.remarks();
        remarks.push(own);
        remarks
    }

    fn next_input(&mut self) -> Result<Option<Input<'_>>, SourceError> {
        while self.ready.is_empty() {
            let packet = match self.source.next_input()? {
                Some(Input::Packet { bytes, arrival_ns }) => Arrived { bytes: bytes.into(), arrival_ns },
                Some(Input::Silence) => return Ok(Some(Input::Silence)),
                Some(Input::Disconnected(reason)) => return Ok(Some(Input::Disconnected(reason))),
                Some(Input::Reconnected(reason)) => return Ok(Some(Input::Reconnected(reason))),
                Some(Input::Frame { .. } | Input::Positions { .. }) => continue,
                // Nothing comes after the late ones.
                None if self.late.is_empty() => return Ok(None),
                None => {
                    self.ready.extend(self.late.drain(..).map(|(_, packet)| packet));
                    break;
                }
            };
            self.suffer(packet);
        }
        self.current = self.ready.pop_front().unwrap_or_default();
        Ok(Some(Input::Packet { bytes: &self.current.bytes, arrival_ns: self.current.arrival_ns }))
    }
}

/// `SplitMix64` (Steele, Lea, Flood 2014).
#[derive(Clone, Copy, Debug)]
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// True so often.
    fn chance(&mut self, probability: f64) -> bool {
        (self.next() >> 11) as f64 * (1.0 / (1_u64 << 53) as f64) < probability
    }

    /// An integer below `end`; 0 where that is 0.
    fn below(&mut self, end: u64) -> u64 {
        ((u128::from(self.next()) * u128::from(end)) >> 64) as u64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chances_are_as_they_are_called() {
        let mut random = Random(1);
        let hits = (0..100_000).filter(|_| random.chance(0.05)).count();
        assert!((4700..5300).contains(&hits), "{hits}");
        assert!((0..1000).all(|_| random.below(7) < 7) && random.below(0) == 0);
    }
}
