//! A capture without an end: a few seconds of a scene, over and over, with stamps and sequence numbers that go on.

use std::io::{self, Read};

use physinc::capture::{Packets, Writer};
use physinc::config::Config;
use physinc::engine::Engine;
use physinc::event::{Counters, Kind};
use physinc::kinect::disparity::Packing;
use physinc::kinect::packet::{HEADER, Header, Packet, Stream};
use physinc::sim::Scene;

use crate::packets::{packets, ticks};

/// After so many frames of 242 packets the 8 bits of the sequence begin anew, and with them the loop.
const FRAMES: usize = 128;
const FRAME_NS: i64 = 33_333_333;
const FRAME_TICKS: u32 = 2_000_000;

/// Reads the same capture again and again, each time later.
struct Looped {
    bytes: Vec<u8>,
    /// Where the loop begins: behind section and interface.
    start: usize,
    /// Where enhanced packet blocks keep their stamps, and packets the device's ticks.
    stamps: Vec<usize>,
    ticks: Vec<usize>,
    at: usize,
    left: usize,
}

impl Looped {
    /// `loops` of [`FRAMES`] frames of a scene.
    fn new(scene: &Scene, loops: usize) -> Self {
        let mut writer = Writer::new(Vec::new()).expect("memory");
        let mut frames = scene.frames();
        for number in 0..FRAMES {
            let frame = frames.next_frame().expect("a scene that is long enough");
            let sent = packets(Packing::Eleven, frame.samples, ticks(number as i64 * FRAME_NS + FRAME_NS), (number * 242) as u8);
            for (i, packet) in sent.iter().enumerate() {
                writer.packet(packet, number as i64 * FRAME_NS + i as i64 / 16 * 2_000_000).expect("memory");
            }
        }
        let bytes = writer.finish().expect("memory");
        let word = |at: usize| u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]);
        let (mut stamps, mut places, mut at, mut start) = (Vec::new(), Vec::new(), 0, 0);
        while at < bytes.len() {
            if word(at) == 6 {
                stamps.push(at + 12);
                // The records' own bytes: of completions, the packets behind 64 bytes of header and a descriptor for each.
                let (record, count) = (at + 28, word(at + 28 + 60) as usize);
                let data = record + 64 + 16 * count;
                for i in 0..if bytes[record + 8] == b'C' { count } else { 0 } {
                    let packet = data + word(record + 64 + 16 * i + 4) as usize;
                    let header = Packet::new(&bytes[packet..packet + HEADER]).and_then(|packet| Header::parse(&packet));
                    if header.is_ok_and(|header| header.stream == Stream::Depth && header.timestamp_ticks != 0) {
                        places.push(packet + 8);
                    }
                }
            } else {
                start = at + word(at + 4) as usize;
            }
            at += word(at + 4) as usize;
        }
        Self { bytes, start, stamps, ticks: places, at: 0, left: loops }
    }

    /// Makes the next loop of the last one.
    fn age(&mut self) {
        let mut add = |at: usize, more: u32| -> bool {
            let field = &mut self.bytes[at..at + 4];
            let (sum, carry) = u32::from_le_bytes(field.try_into().expect("4 bytes")).overflowing_add(more);
            field.copy_from_slice(&sum.to_le_bytes());
            carry
        };
        let later = FRAMES as i64 * FRAME_NS;
        for &at in &self.stamps {
            let carry = add(at + 4, later as u32);
            add(at, (later >> 32) as u32 + u32::from(carry));
        }
        for &at in &self.ticks {
            add(at, FRAMES as u32 * FRAME_TICKS);
        }
    }
}

impl Read for Looped {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if self.at == self.bytes.len() {
            self.left -= 1;
            if self.left == 0 {
                return Ok(0);
            }
            self.age();
            self.at = self.start;
        }
        let count = buffer.len().min(self.bytes.len() - self.at);
        buffer[..count].copy_from_slice(&self.bytes[self.at..self.at + count]);
        self.at += count;
        Ok(count)
    }
}

/// Resident memory, bytes; `None` where the system doesn't say.
pub fn resident() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"))?;
    Some(line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()? * 1024)
}

#[allow(dead_code)] // Only the bench tells it.
/// Processor time of this process so far, s, to a hundredth; `None` where the system doesn't say.
pub fn worked() -> Option<f64> {
    let stat = std::fs::read_to_string("/proc/self/stat").ok()?;
    // Behind the command's name, which may hold anything: state, then 10 fields, then user's and system's time.
    let mut fields = stat.rsplit_once(')')?.1.split_whitespace().skip(11);
    Some((fields.next()?.parse::<u64>().ok()? + fields.next()?.parse::<u64>().ok()?) as f64 / 100.0)
}

/// What came of it.
pub struct Outcome {
    /// At the end.
    pub counters: Counters,
    /// Final contacts.
    pub contacts: usize,
    /// By how much resident memory grew from the second loop to the last, bytes.
    pub growth: Option<i64>,
}

/// `loops` of a ball's bounces, from capture to events. Each is 4.27 s.
pub fn watch(loops: usize) -> Outcome {
    let scene = Scene::parse("bounce?seed=1").expect("a scene");
    let mut source = Packets::read(Looped::new(&scene, loops)).expect("memory").expect("a Kinect");
    let mut engine = Engine::new_for_packets(&Config::default(), &scene.camera(), source.packing()).expect("a Kinect");
    let (mut contacts, mut before) = (0, None);
    let mut sink = |event: physinc::event::Event| contacts += usize::from(event.is_final && matches!(event.kind, Kind::Contact(_)));
    while let Some((bytes, arrival_ns)) = source.next_packet().expect("it is whole") {
        engine.packet(bytes, arrival_ns, &mut sink).expect("it is for packets");
        if before.is_none() && engine.counters().frames as usize == 2 * FRAMES {
            before = resident();
        }
    }
    let growth = before.and_then(|before| Some(resident()? as i64 - before as i64));
    engine.finish(&mut sink);
    Outcome { counters: engine.counters(), contacts, growth }
}

/// Frames of so many loops.
pub fn frames(loops: usize) -> u64 {
    (loops * FRAMES) as u64
}
