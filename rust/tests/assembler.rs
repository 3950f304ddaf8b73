//! Packets to frames, whatever happens to the packets on their way.

use physinc::kinect::disparity::Packing;
use physinc::kinect::layout::Layout;
use physinc::kinect::packet::{DEPTH_PAYLOAD, HEADER, Header, Place, Stream};
use physinc::kinect::video::Video;
use physinc::stream::assembler::Assembler;
use proptest::prelude::*;

const SAMPLES: usize = 640 * 480;
const PACKETS: usize = 242;
const FRAME_TICKS: u32 = 2_000_000;
const FRAME_NS: i64 = 33_333_333;

/// Frame `number`'s samples: no two frames agree in many, and none is 2047.
fn samples(number: usize) -> Vec<u16> {
    (0..SAMPLES).map(|i| ((i * 7 + number * 911 + i / 640) % 2047) as u16).collect()
}

/// The packets of `count` frames, the first of them with sequence `base`.
fn packets(count: usize, base: u8) -> Vec<Vec<u8>> {
    let mut sequence = base;
    let mut all = Vec::new();
    for number in 0..count {
        let mut packed = vec![0; Packing::Eleven.frame_bytes()];
        Packing::Eleven.pack(&samples(number), &mut packed).expect("a frame");
        for (i, payload) in packed.chunks(DEPTH_PAYLOAD).enumerate() {
            let (place, timestamp_ticks) = match i {
                0 => (Place::First, 0),
                241 => (Place::Last, stamp(number)),
                _ => (Place::Middle, stamp(number)),
            };
            let header = Header { stream: Stream::Depth, place, sequence, timestamp_ticks };
            all.push([&header.emit(payload.len() as u16)[..], payload].concat());
            sequence = sequence.wrapping_add(1);
        }
    }
    all
}

/// Images of video, of which one packet is lost.
#[test]
fn video_is_put_together_as_depth_is() {
    for (video, lost, hole) in [(Video::Color, 1, 1908..3816), (Video::Infrared, 204, 311_385..312_320)] {
        let packed: Vec<u8> = (0..video.frame_bytes()).map(|i| (i / 3) as u8).collect();
        let last = video.packets() - 1;
        let packets = (0..3 * video.packets()).map(|i| {
            let place = match i % video.packets() {
                0 => Place::First,
                i if i == last => Place::Last,
                _ => Place::Middle,
            };
            let payload = packed.chunks(Video::PAYLOAD).nth(i % video.packets()).expect("a packet");
            let header = Header { stream: Stream::Video, place, sequence: i as u8, timestamp_ticks: 7 };
            [&header.emit(payload.len() as u16)[..], payload].concat()
        });
        let mut assembler = Assembler::new(video, vec![0; video.frame_bytes()]).expect("large enough");
        let mut holes = Vec::new();
        for (i, packet) in packets.enumerate().filter(|(i, _)| *i != video.packets() + lost) {
            assembler.push(&packet, i as i64, &mut |frame| {
                holes.push(frame.missing().collect::<Vec<_>>());
                assert!(!frame.is_whole() || frame.packed == packed);
            });
        }
        assert_eq!(holes, [vec![], vec![hole], vec![]], "{video:?}");
        assert_eq!(assembler.counters().packets_lost, 1);
    }
}

/// Over the clock's wrap.
fn stamp(number: usize) -> u32 {
    (u32::MAX - FRAME_TICKS * 3 / 2).wrapping_add(number as u32 * FRAME_TICKS)
}

fn arrival(frame: usize) -> i64 {
    5 + frame as i64 * FRAME_NS
}

/// What came out: for each frame its number by its stamp, and its samples; and lost, invalid, incomplete.
type Outcome = (Vec<(usize, Vec<u16>)>, [u64; 3]);

/// Pushes packets, each with the number of the frame that was being sent when it arrived. Every sample that comes out must be that
/// frame's or 2047, and 2047 exactly where the frame says so.
fn assemble<'a>(sent: impl IntoIterator<Item = (usize, &'a [u8])>) -> Result<Outcome, TestCaseError> {
    let mut assembler = Assembler::new(Packing::Eleven, vec![0; Packing::Eleven.frame_bytes()]).expect("large enough");
    let (mut frames, mut wrong) = (Vec::new(), Ok(()));
    for (at, packet) in sent {
        assembler.push(packet, arrival(at), &mut |frame| {
            // Not rebased: the first frame that comes whole may be behind the wrap.
            let ticks = (frame.timestamp_ns * 3 + 25) / 50;
            let number = ((ticks as u32).wrapping_sub(stamp(0)) / FRAME_TICKS) as usize;
            let mut got = vec![0; SAMPLES];
            Packing::Eleven.unpack(frame.packed, &mut got).expect("a frame");
            let mut expected = samples(number);
            frame.missing().for_each(|range| expected[range].fill(2047));
            if expected != got {
                wrong = Err(TestCaseError::fail(format!("frame {number} is not itself")));
            }
            if frame.is_whole() && got.contains(&2047) {
                wrong = Err(TestCaseError::fail(format!("frame {number} is not whole")));
            }
            frames.push((number, got));
        });
    }
    wrong?;
    let counters = assembler.counters();
    prop_assert_eq!(counters.frames, frames.len() as u64);
    Ok((frames, [counters.packets_lost, counters.packets_invalid, counters.frames_incomplete]))
}

/// Frame numbers and counts after `change` of the packets of 5 frames.
fn outcome(change: impl Fn(&mut Vec<(usize, Vec<u8>)>)) -> (Vec<usize>, [u64; 3]) {
    let mut sent: Vec<_> = packets(5, 200).into_iter().enumerate().map(|(i, packet)| (i / PACKETS, packet)).collect();
    change(&mut sent);
    let (frames, counts) = assemble(sent.iter().map(|(at, packet)| (*at, &packet[..]))).expect("true or 2047");
    (frames.into_iter().map(|(number, _)| number).collect(), counts)
}

#[test]
fn each_kind_of_loss_is_counted_as_it_is() {
    let all = vec![0, 1, 2, 3, 4];
    let at = |frame: usize, place: usize| frame * PACKETS + place;
    let none = |_: &mut Vec<(usize, Vec<u8>)>| ();
    assert_eq!(outcome(none), (all.clone(), [0, 0, 0]));
    // Lost: one, two neighbours, a frame's last, its first, a burst within one frame, one over an end.
    assert_eq!(outcome(|p| drop(p.remove(at(1, 100)))), (all.clone(), [1, 0, 1]));
    assert_eq!(outcome(|p| drop(p.drain(at(1, 100)..at(1, 102)))), (all.clone(), [2, 0, 1]));
    assert_eq!(outcome(|p| drop(p.remove(at(1, 241)))), (all.clone(), [1, 0, 1]));
    assert_eq!(outcome(|p| drop(p.remove(at(2, 0)))), (all.clone(), [1, 0, 1]));
    assert_eq!(outcome(|p| drop(p.drain(at(1, 3)..at(1, 200)))), (all.clone(), [197, 0, 1]));
    assert_eq!(outcome(|p| drop(p.drain(at(1, 240)..at(2, 3)))), (vec![0, 2, 3, 4], [5, 0, 1]));
    // So much over an end that what follows reads as places of the frame before.
    assert_eq!(outcome(|p| drop(p.drain(at(1, 200)..at(2, 58)))), (vec![0, 2, 3, 4], [100, 0, 1]));
    // More than the sequence can count; whole frames; exactly one round of it.
    assert_eq!(outcome(|p| drop(p.drain(at(1, 50)..at(3, 60)))).1[0], 494);
    assert_eq!(outcome(|p| drop(p.drain(at(1, 0)..at(3, 0)))), (vec![0, 3, 4], [484, 0, 0]));
    assert_eq!(outcome(|p| drop(p.drain(at(1, 50)..at(1, 50) + 256))), (vec![0, 3, 4], [256, 0, 0]));
    // Doubled: alone, and over an end.
    assert_eq!(outcome(|p| p.insert(at(1, 8), p[at(1, 7)].clone())), (all.clone(), [0, 1, 0]));
    assert_eq!(outcome(|p| p.insert(at(2, 0), p[at(1, 241)].clone())), (all.clone(), [0, 1, 0]));
    // Empty, short, foreign, junk: between others, and in the place of one.
    for junk in [vec![], vec![0x52; 5], packets(1, 0)[0][..600].to_vec(), [&packets(1, 0)[1][..HEADER], &[1; 1908]].concat(), vec![7; 1760]]
    {
        let invalid = u64::from(!junk.is_empty());
        assert_eq!(outcome(|p| p.insert(at(1, 8), (1, junk.clone()))), (all.clone(), [0, invalid, 0]));
        assert_eq!(outcome(|p| p[at(1, 8)].1.clone_from(&junk)), (all.clone(), [1, invalid, 1]));
    }
    // Out of order: neighbours, far apart, and over an end, where the last comes too late.
    assert_eq!(outcome(|p| p.swap(at(1, 8), at(1, 9))), (all.clone(), [0, 0, 0]));
    assert_eq!(outcome(|p| p.swap(at(1, 8), at(1, 90))), (all.clone(), [0, 0, 0]));
    assert_eq!(outcome(|p| p.swap(at(1, 241), at(2, 0))), (all.clone(), [1, 1, 1]));
    // Out of the frame before, where its sequence reads as this frame's, and the packet whose place it takes comes too late as well.
    let late = |p: &mut Vec<(usize, Vec<u8>)>| {
        let stale = p.remove(at(1, 226));
        p.insert(at(1, 241), stale);
        p.swap(at(2, 240), at(2, 241));
    };
    assert_eq!(outcome(late), (all.clone(), [2, 2, 2]));
}

#[test]
fn stamps_are_the_last_packets_through_the_clocks_wrap() {
    let all = packets(3, 0);
    let mut stamps = Vec::new();
    let mut assembler = Assembler::new(Packing::Eleven, vec![0; Packing::Eleven.frame_bytes()]).expect("large enough");
    for (i, packet) in all.iter().enumerate() {
        assembler.push(packet, arrival(i / PACKETS), &mut |frame| stamps.push(frame.timestamp_ns));
    }
    let expected: Vec<_> = (0..3).map(|i| ((i64::from(stamp(0)) + i * 2_000_000) * 100 + 3) / 6).collect();
    assert_eq!(stamps, expected);
    assert!(Assembler::new(Packing::Eleven, [0; 100]).is_err());
}

/// What happens to a packet.
#[derive(Clone, Debug)]
enum Fault {
    Lose(usize),
    Double,
    Delay(usize),
    Cut(usize),
    /// A bit of the header, but not of the sequence or the time.
    Flip(usize),
}

fn fault() -> impl Strategy<Value = Fault> {
    prop_oneof![
        4 => (1_usize..4).prop_map(Fault::Lose),
        1 => (1_usize..700).prop_map(Fault::Lose),
        2 => Just(Fault::Double),
        2 => (1_usize..30).prop_map(Fault::Delay),
        1 => (0_usize..1800).prop_map(Fault::Cut),
        2 => (0_usize..40).prop_map(Fault::Flip),
    ]
}

proptest! {
    #[test]
    fn samples_are_the_frames_own_or_missing(base in any::<u8>(), faults in prop::collection::vec((0_usize..6 * PACKETS, fault()), 0..30)) {
        let mut sent: Vec<_> = packets(6, base).into_iter().enumerate().map(|(i, packet)| (i / PACKETS, packet)).collect();
        for (at, fault) in faults {
            let at = at.min(sent.len().saturating_sub(1));
            match fault {
                _ if sent.is_empty() => (),
                Fault::Lose(count) => drop(sent.drain(at..(at + count).min(sent.len()))),
                Fault::Double => sent.insert(at, sent[at].clone()),
                Fault::Delay(by) => {
                    let late = sent.remove(at);
                    sent.insert((at + by).min(sent.len()), late);
                }
                Fault::Cut(length) => sent[at].1.truncate(length),
                Fault::Flip(bit) => if let Some(byte) = sent[at].1.get_mut(bit / 8) { *byte ^= 1 << (bit % 8) },
            }
        }
        assemble(sent.iter().map(|(at, packet)| (*at, &packet[..])))?;
    }

    /// A wrong sequence alone is seen: its true owner comes as well.
    #[test]
    fn a_flipped_sequence_mixes_nothing(base in any::<u8>(), at in PACKETS..3 * PACKETS, bit in 0_u8..8) {
        let mut sent = packets(5, base);
        sent[at][5] ^= 1 << bit;
        let (frames, _) = assemble(sent.iter().enumerate().map(|(i, packet)| (i / PACKETS, &packet[..])))?;
        prop_assert!(frames.len() >= 3);
    }

    #[test]
    fn any_bytes_at_any_time_pass(sent in prop::collection::vec((prop::collection::vec(any::<u8>(), 0..40), any::<i64>(), any::<bool>()), 0..60), ten in any::<bool>()) {
        let packing = if ten { Packing::Ten } else { Packing::Eleven };
        let mut assembler = Assembler::new(packing, vec![0; packing.frame_bytes()]).expect("large enough");
        for (mut bytes, at, valid) in sent {
            if valid {
                bytes.resize(HEADER + DEPTH_PAYLOAD, 0);
                let flag = 0x71 + bytes[4] % 2;
                bytes[..4].copy_from_slice(&[0x52, 0x42, 0, flag]);
            }
            assembler.push(&bytes, at, &mut |frame| assert!(frame.missing().all(|range| range.end <= SAMPLES)));
        }
    }
}
