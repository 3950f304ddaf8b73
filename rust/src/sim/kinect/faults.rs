//! What may happen to the packets of depth on their way, and how often.

use super::Trouble;
use crate::kinect::packet::{HEADER, Header, Place, Stream};
use rand::rngs::Xoshiro256PlusPlus;
use rand::{RngExt, SeedableRng};
use std::collections::VecDeque;
use std::format;
use std::string::String;
use std::vec::Vec;

/// Of a fault's length.
const MOST: f64 = 1e6;

/// Probabilities for each packet, and what happens once.
#[derive(Clone, Debug, PartialEq)]
pub struct Faults {
    /// It never comes; what follows takes its slot.
    pub lose: f64,
    /// Mean length of a run of lost packets, from 1 on.
    pub burst: f64,
    /// An empty packet comes in its place.
    pub zero: f64,
    /// It comes without some of its last bytes.
    pub short: f64,
    /// It comes twice.
    pub double: f64,
    /// One of video, or noise, comes before it.
    pub foreign: f64,
    /// An error of the bus comes in its place.
    pub error: f64,
    /// From the beginning of frame `from` on nothing comes for so long, s.
    pub silence: f64,
    /// The stream starts with so many packets missing.
    pub begin: f64,
    /// Nothing happens to frames before this one.
    pub from: f64,
    /// Which faults of all that are so frequent.
    pub seed: f64,
}

impl Default for Faults {
    fn default() -> Self {
        let [lose, zero, short, double, foreign, error, silence, begin, from, seed] = [0.0; 10];
        Self { lose, burst: 1.0, zero, short, double, foreign, error, silence, begin, from, seed }
    }
}

impl Faults {
    /// From `lose=0.05&burst=10&seed=3`.
    ///
    /// # Errors
    /// What is wrong with it, in one line.
    pub fn parse(text: &str) -> Result<Self, String> {
        let mut faults = Self::default();
        for pair in text.split('&') {
            let (key, value) = pair.split_once('=').ok_or_else(|| format!("`{pair}` is not key=value"))?;
            let (number, range) = match key {
                "lose" => (&mut faults.lose, 0.0..=1.0),
                "zero" => (&mut faults.zero, 0.0..=1.0),
                "short" => (&mut faults.short, 0.0..=1.0),
                "double" => (&mut faults.double, 0.0..=1.0),
                "foreign" => (&mut faults.foreign, 0.0..=1.0),
                "error" => (&mut faults.error, 0.0..=1.0),
                "burst" => (&mut faults.burst, 1.0..=MOST),
                "silence" => (&mut faults.silence, 0.0..=MOST),
                "begin" => (&mut faults.begin, 0.0..=MOST),
                "from" => (&mut faults.from, 0.0..=MOST),
                "seed" => (&mut faults.seed, 0.0..=MOST),
                _ => {
                    return Err(format!(
                        "no fault `{key}`: lose, burst, zero, short, double, foreign, error, silence, begin, from, or seed"
                    ));
                }
            };
            *number = value
                .parse()
                .ok()
                .filter(|n| range.contains(n))
                .ok_or_else(|| format!("{key}={value}: a number from {} to {} is expected", range.start(), range.end()))?;
        }
        Ok(faults)
    }
}

/// What comes in a microframe.
pub(super) type Arrival = (Vec<u8>, Option<Trouble>);

/// The way of the packets.
#[derive(Clone, Debug)]
pub(super) struct Way {
    faults: Faults,
    rng: Xoshiro256PlusPlus,
    is_losing: bool,
    /// What comes next.
    pub arrivals: VecDeque<Arrival>,
}

impl Way {
    pub fn new(faults: Faults) -> Self {
        let rng = Xoshiro256PlusPlus::seed_from_u64(faults.seed.to_bits());
        Self { faults, rng, is_losing: false, arrivals: VecDeque::new() }
    }

    pub fn faults(&self) -> &Faults {
        &self.faults
    }

    /// Sends a packet of frame number `frame`; whether it comes whole.
    pub fn send(&mut self, packet: &[u8], frame: u64) -> bool {
        if (frame as f64) < self.faults.from {
            self.arrivals.push_back((packet.to_vec(), None));
            return true;
        }
        let Faults { lose, burst, zero, short, double, foreign, error, .. } = self.faults;
        let begins = if self.is_losing { 1.0 - 1.0 / burst } else { lose / burst };
        self.is_losing = self.chance(begins);
        if self.chance(foreign) {
            let foreign = self.foreign();
            self.arrivals.push_back((foreign, None));
        }
        if self.is_losing {
            return false;
        }
        if self.chance(zero) {
            self.arrivals.push_back((Vec::new(), None));
            return false;
        }
        if self.chance(error) {
            let [late, broken] = [self.rng.random(), self.rng.random()];
            let trouble = if late {
                Trouble::Late
            } else if broken {
                Trouble::Protocol
            } else {
                Trouble::Checksum
            };
            // What fails half way leaves bytes in the slot.
            let rest = if late { 0 } else { self.rng.random_range(0..packet.len()) };
            self.arrivals.push_back((packet[..rest].to_vec(), Some(trouble)));
            return false;
        }
        if self.chance(short) {
            let kept = self.rng.random_range(1..packet.len().max(2));
            self.arrivals.push_back((packet[..kept].to_vec(), None));
            return false;
        }
        self.arrivals.push_back((packet.to_vec(), None));
        if self.chance(double) {
            self.arrivals.push_back((packet.to_vec(), None));
        }
        true
    }

    fn chance(&mut self, probability: f64) -> bool {
        probability > 0.0 && self.rng.random::<f64>() < probability
    }

    /// A packet of video as real logs show on the depth endpoint, or noise that is none at all.
    fn foreign(&mut self) -> Vec<u8> {
        let mut bytes: Vec<u8> = (0..HEADER + 1908).map(|_| self.rng.random()).collect();
        if self.rng.random() {
            let header =
                Header { stream: Stream::Video, place: Place::Middle, sequence: self.rng.random(), timestamp_ticks: self.rng.random() };
            bytes[..HEADER].copy_from_slice(&header.emit(1908));
        } else {
            bytes[0] = 0;
        }
        bytes
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kinect::packet::DEPTH_PAYLOAD;

    #[test]
    fn faults_are_read_as_they_are_written() {
        let expected = Faults { lose: 0.05, burst: 10.0, from: 20.0, ..Faults::default() };
        assert_eq!(Faults::parse("lose=0.05&burst=10&from=20"), Ok(expected));
        for (text, message) in [
            ("lose", "not key=value"),
            ("loose=1", "no fault `loose`"),
            ("lose=5", "from 0 to 1 is expected"),
            ("zero=NaN", "is expected"),
            ("burst=0", "from 1 to"),
        ] {
            assert!(Faults::parse(text).is_err_and(|what| what.contains(message)), "{text}");
        }
    }

    #[test]
    fn as_many_packets_suffer_as_are_told() {
        let packet = std::vec![1; HEADER + DEPTH_PAYLOAD];
        let sent = 20_000;
        for (fault, is_one) in [
            ("lose=0.1&burst=5", (|came: &[Arrival]| came.is_empty()) as fn(&[Arrival]) -> bool),
            ("zero=0.1", |came| came[0].0.is_empty()),
            ("short=0.1", |came| (1..HEADER + DEPTH_PAYLOAD).contains(&came[0].0.len())),
            ("double=0.1", |came| came.len() == 2 && came[0] == came[1]),
            ("foreign=0.1", |came| came.len() == 2 && came[0] != came[1]),
            ("error=0.1", |came| came[0].1.is_some()),
        ] {
            let mut way = Way::new(Faults::parse(fault).unwrap());
            let (mut faulty, mut whole) = (0, 0);
            for _ in 0..sent {
                whole += usize::from(way.send(&packet, 0));
                let came: Vec<Arrival> = way.arrivals.drain(..).collect();
                faulty += usize::from(is_one(&came));
            }
            let expected = 0.1 * f64::from(sent);
            assert!((faulty as f64 - expected).abs() < 0.15 * expected, "{fault}: {faulty}");
            let harmless = fault.starts_with("double") || fault.starts_with("foreign");
            assert_eq!(whole, if harmless { sent as usize } else { sent as usize - faulty }, "{fault}");
        }
    }
}
