//! A capture as another machine would make it: pcap, big-endian, link type 189, by gzip. The formats' documents say how.

use flate2::Compression;
use flate2::write::GzEncoder;
use std::error::Error;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::Path;

/// Tells the next packet, and when it arrived, ns.
type Tell<'t> = &'t mut dyn FnMut(&[u8], i64) -> Result<(), Box<dyn Error>>;

/// Writes the packets that `tell_all` tells into `path`; those that arrived at the same time are one transfer.
pub fn write(path: &Path, tell_all: impl FnOnce(Tell) -> Result<(), Box<dyn Error>>) -> Result<(), Box<dyn Error>> {
    let mut out = GzEncoder::new(BufWriter::new(File::create(path)?), Compression::best());
    // Magic of stamps in µs, version 2.4, zone, accuracy, snap length, link type.
    out.write_all(&[0xa1, 0xb2, 0xc3, 0xd4, 0, 2, 0, 4])?;
    [0, 0, 245_824, 189].iter().try_for_each(|word: &u32| out.write_all(&word.to_be_bytes()))?;
    let mut transfer = Transfer::default();
    tell_all(&mut |bytes, arrival_ns| {
        if arrival_ns != transfer.arrival_ns {
            transfer.write(&mut out)?;
        }
        transfer.arrival_ns = arrival_ns;
        transfer.packets.push(bytes.into());
        Ok(())
    })?;
    transfer.write(&mut out)?;
    out.finish()?.flush()?;
    Ok(())
}

#[derive(Default)]
struct Transfer {
    id: u64,
    arrival_ns: i64,
    packets: Vec<Vec<u8>>,
}

impl Transfer {
    /// Its completion; then it is empty.
    fn write(&mut self, out: &mut impl Write) -> io::Result<()> {
        if self.packets.is_empty() {
            return Ok(());
        }
        self.id += 1;
        let count = self.packets.len() as u32;
        let length: u32 = self.packets.iter().map(|packet| packet.len() as u32).sum();
        let (seconds, micros) = (self.arrival_ns / 1_000_000_000, (self.arrival_ns % 1_000_000_000 / 1000) as u32);
        let mut record = Vec::new();
        record.extend(self.id.to_be_bytes());
        // A completion, isochronous, from endpoint 0x82 of device 2 on bus 1; no setup, data.
        record.extend([b'C', 0, 0x82, 2, 0, 1, b'-', 0]);
        record.extend(seconds.to_be_bytes());
        // Status, length, what was captured, errors, descriptors.
        for word in [micros, 0, length, length + 16 * count, 0, count] {
            record.extend(word.to_be_bytes());
        }
        let mut offset = 0_u32;
        for packet in &self.packets {
            for word in [0, offset, packet.len() as u32, 0] {
                record.extend(word.to_be_bytes());
            }
            offset += packet.len() as u32;
        }
        self.packets.drain(..).for_each(|packet| record.extend(packet));
        for word in [seconds as u32, micros, record.len() as u32, record.len() as u32] {
            out.write_all(&word.to_be_bytes())?;
        }
        out.write_all(&record)
    }
}
