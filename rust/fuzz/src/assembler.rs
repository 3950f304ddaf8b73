//! Four frames whose packets meet faults that the input chooses, then arbitrary packets: no frame has another's samples, every packet is
//! counted once.
#![no_main]

use libfuzzer_sys::fuzz_target;
use physinc::kinect::disparity::Packing;
use physinc::kinect::packet::{DEPTH_PAYLOAD, Header, Place, Stream};
use physinc::stream::assembler::Assembler;
use std::borrow::Cow;
use std::sync::LazyLock;

const FRAMES: usize = 4;
/// Of losses in a row, and of places by which a packet is late: together less than half a round of the sequence.
const MOST: usize = 50;

/// Packet `place` of frame `number`: its payload names both.
fn packet(number: usize, place: usize, packing: Packing) -> Vec<u8> {
    let last = packing.packets() - 1;
    let length = if place == last { packing.frame_bytes() - last * DEPTH_PAYLOAD } else { DEPTH_PAYLOAD };
    let header = Header {
        stream: Stream::Depth,
        place: if place == 0 {
            Place::First
        } else if place == last {
            Place::Last
        } else {
            Place::Middle
        },
        sequence: (number * packing.packets() + place) as u8,
        timestamp_ticks: if place == 0 { 0 } else { 1 + number as u32 },
    };
    let mut bytes = header.emit(length as u16).to_vec();
    bytes.resize(bytes.len() + length, 0);
    bytes[12..].chunks_exact_mut(2).for_each(|pair| pair.copy_from_slice(&[number as u8, place as u8]));
    bytes
}

fn frames(packing: Packing) -> Vec<Vec<u8>> {
    (0..FRAMES).flat_map(|number| (0..packing.packets()).map(move |place| packet(number, place, packing))).collect()
}

static WHOLE: LazyLock<[Vec<Vec<u8>>; 2]> = LazyLock::new(|| [frames(Packing::Eleven), frames(Packing::Ten)]);

fuzz_target!(|input: &[u8]| {
    let Some((&first, input)) = input.split_first() else { return };
    let packing = if first & 1 == 0 { Packing::Eleven } else { Packing::Ten };
    let mut sent: Vec<Cow<'_, [u8]>> = WHOLE[usize::from(first & 1)].iter().map(Cow::from).collect();
    let (faults, rest) = input.split_at(input.len().min(40));
    let (mut lost, mut late) = (0, 0);
    for fault in faults.chunks_exact(4) {
        let at = usize::from(u16::from_be_bytes([fault[0], fault[1]])) % sent.len().max(1);
        let by = usize::from(fault[3]);
        match fault[2] % 5 {
            0 if lost + by <= MOST => {
                drop(sent.drain(at..(at + by).min(sent.len())));
                lost += by;
            }
            1 => sent.insert(at, sent[at].clone()),
            2 if late + by <= MOST => {
                let packet = sent.remove(at);
                sent.insert((at + by).min(sent.len()), packet);
                late += by;
            }
            3 => sent[at].to_mut().truncate(7 * by),
            // Not the bytes that hold sequence or time.
            4 => {
                if let Some(byte) = sent[at].to_mut().get_mut(by % 5) {
                    *byte ^= 1 << (by / 5 % 8);
                }
            }
            _ => (),
        }
    }
    let mut assembler = Assembler::new(packing, vec![0; packing.frame_bytes()]).expect("large enough");
    let (mut frames, mut pushed) = (0, 0);
    for (i, packet) in sent.iter().enumerate() {
        pushed += u64::from(!packet.is_empty());
        assembler.push(packet, i as i64, &mut |frame| {
            frames += 1;
            let number = (frame.timestamp_ns * 3 + 25) / 50;
            for (place, payload) in frame.packed.chunks(DEPTH_PAYLOAD).enumerate().filter(|(place, _)| frame.present.contains(*place as u8))
            {
                // The first and last sample may be half another packet's.
                for pair in [&payload[2..4], &payload[payload.len() / 4 * 2..][..2], &payload[payload.len() - 4..][..2]] {
                    assert_eq!(*pair, [number as u8 - 1, place as u8], "place {place} of frame {number}");
                }
            }
        });
    }
    for packet in rest.split(|byte| *byte == 0x55) {
        let mut packet = packet.to_vec();
        if packet.first() == Some(&0x52) {
            packet.resize(12 + DEPTH_PAYLOAD, 0);
        }
        pushed += u64::from(!packet.is_empty());
        assembler.push(&packet, i64::MAX, &mut |frame| {
            frames += 1;
            assert!(frame.missing().all(|samples| samples.end <= 640 * 480));
        });
    }
    let counters = assembler.counters();
    assert_eq!((counters.packets, counters.frames), (pushed, frames));
});
