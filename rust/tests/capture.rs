//! Captures: what is written is read back, and whatever a file holds, it is read as far as it goes.

mod packets;

use std::io::{self, Cursor, Read};
use std::path::PathBuf;
use std::{env, fs, process};

use packets::packets;
use physinc::capture::{Output, Packets, Writer};
use physinc::kinect::calibration::ZeroPlane;
use physinc::kinect::disparity::Packing;
use proptest::prelude::*;

/// Packets with their times of arrival, ns.
type Sent = Vec<(i64, Vec<u8>)>;

const PLANE: ZeroPlane = ZeroPlane { emitter_cm: 7.25, rcmos_cm: 2.3, reference_cm: 121.0, pixel_cm: 0.105, shift: 201 };
const START_NS: i64 = 1_700_000_000_123_456_000;

/// `count` frames, eight packets in a transfer of 1 ms, each followed by two empty ones.
fn frames(count: usize, packing: Packing) -> Sent {
    let mut sent = Sent::new();
    for number in 0..count {
        let samples: Vec<u16> = (0..640 * 480).map(|i| ((i / 7 + number * 31) % 1023) as u16).collect();
        let base = (number * packing.packets()) as u8;
        for packet in packets(packing, &samples, 6_000_000 + 2_000_000 * number as u32, base).into_iter().chain([vec![], vec![]]) {
            sent.push((START_NS + (sent.len() / 8) as i64 * 1_000_000, packet));
        }
    }
    sent
}

/// What is read, how it ended, and the reader.
fn read(bytes: impl Into<Vec<u8>>) -> (Sent, Result<(), String>, Option<Packets>) {
    let mut packets = match Packets::read(Cursor::new(bytes.into())).expect("memory can be read") {
        Err(what) => return (Sent::new(), Err(what), None),
        Ok(packets) => packets,
    };
    let mut found = Sent::new();
    let end = loop {
        match packets.next_packet() {
            Ok(Some((bytes, arrival_ns))) => found.push((arrival_ns, bytes.to_vec())),
            Ok(None) => break Ok(()),
            Err(what) => break Err(what),
        }
    };
    (found, end, Some(packets))
}

fn written(sent: &Sent, introduced: Option<Packing>) -> Vec<u8> {
    let mut writer = Writer::new(Vec::new()).expect("memory");
    if let Some(packing) = introduced {
        writer.introduce(Some(&PLANE), packing, START_NS - 1).expect("memory");
    }
    sent.iter().try_for_each(|(arrival_ns, bytes)| writer.packet(bytes, *arrival_ns)).expect("memory");
    writer.finish().expect("memory")
}

#[test]
fn what_is_written_is_read_back() {
    for packing in [Packing::Eleven, Packing::Ten] {
        let sent = frames(2, packing);
        for introduced in [None, Some(packing)] {
            let (found, end, packets) = read(written(&sent, introduced));
            assert!(found == sent && end == Ok(()));
            let packets = packets.expect("a Kinect");
            assert_eq!(packets.packing(), packing);
            assert_eq!(packets.zero_plane(), introduced.map(|_| PLANE));
            assert!(packets.remarks().is_empty());
        }
    }
}

/// A capture put together by hand, as the formats' documents say.
struct Usbmon {
    big: bool,
    mmapped: bool,
    /// pcapng, or pcap of micro- or nanoseconds.
    nanos: Option<bool>,
    bytes: Vec<u8>,
}

impl Usbmon {
    fn new(big: bool, mmapped: bool, nanos: Option<bool>) -> Self {
        let mut capture = Self { big, mmapped, nanos, bytes: Vec::new() };
        capture.section(if mmapped { 220 } else { 189 });
        capture
    }

    fn put<const N: usize>(&self, mut little: [u8; N]) -> [u8; N] {
        if self.big {
            little.reverse();
        }
        little
    }

    fn u32(&self, value: usize) -> [u8; 4] {
        self.put((value as u32).to_le_bytes())
    }

    fn block(&mut self, kind: u32, body: &[u8]) {
        let length = self.u32(12 + body.len().next_multiple_of(4));
        let kind = self.u32(kind as usize);
        let padding = vec![0; body.len().next_multiple_of(4) - body.len()];
        self.bytes.extend([&kind, &length, body, &padding, &length].concat());
    }

    fn section(&mut self, link_type: usize) {
        match self.nanos {
            None => {
                let body = [&self.u32(0x1a2b_3c4d)[..], &self.put([1, 0]), &[0, 0], &[0xff; 8]].concat();
                self.block(0x0a0d_0d0a, &body);
                // An interface of another kind first, then one whose stamps count 2⁻²⁰ s from 5 s on.
                self.block(1, &[&self.put([1, 0])[..], &[0; 6]].concat());
                let offset = [&self.put([14, 0])[..], &self.put([8, 0]), &self.put(5_i64.to_le_bytes()), &[0; 4]].concat();
                let resolution = [&self.put([9, 0])[..], &self.put([1, 0]), &[0x94, 0, 0, 0]].concat();
                self.block(1, &[&self.put((link_type as u16).to_le_bytes())[..], &[0; 6], &resolution, &offset].concat());
            }
            Some(nanos) => {
                let magic = self.u32(if nanos { 0xa1b2_3c4d } else { 0xa1b2_c3d4 });
                let version = [self.put([2, 0]), self.put([4, 0])].concat();
                self.bytes.extend([&magic[..], &version, &[0; 8], &self.u32(1 << 18), &self.u32(link_type)].concat());
            }
        }
    }

    /// A record, `cut` bytes short.
    fn record(&mut self, stamp_ns: i64, record: &[u8], cut: usize) {
        let (kept, whole) = (self.u32(record.len() - cut), self.u32(record.len()));
        let record = &record[..record.len() - cut];
        if let Some(nanos) = self.nanos {
            let (seconds, fraction) = (stamp_ns / 1_000_000_000, stamp_ns % 1_000_000_000 / if nanos { 1 } else { 1000 });
            let header = [self.u32(seconds as usize), self.u32(fraction as usize), kept, whole].concat();
            self.bytes.extend([&header, record].concat());
            return;
        }
        let stamp = ((i128::from(stamp_ns) - 5_000_000_000) << 20).div_euclid(1_000_000_000) as u64 + 1;
        let stamp = [self.u32((stamp >> 32) as usize), self.u32((stamp & 0xffff_ffff) as usize)].concat();
        let body = [&self.u32(1)[..], &stamp, &kept, &whole, record].concat();
        self.block(6, &body);
    }

    /// A completed isochronous transfer of `device`, with gaps between its packets as a controller leaves them; each with its status.
    fn transfer(&mut self, stamp_ns: i64, device: u8, endpoint: u8, packets: &[(i32, &[u8])], cut: usize) {
        let slots = |i: usize| i * 1920;
        let header = [
            &self.put(0xffff_8880_1234_5678_u64.to_le_bytes())[..],
            &[b'C', 0, endpoint, device],
            &self.put(3_u16.to_le_bytes()),
            &[b'-', 0],
            &self.put((stamp_ns / 1_000_000_000).to_le_bytes()),
            &self.put(((stamp_ns % 1_000_000_000 / 1000) as i32).to_le_bytes()),
            &[0; 4],
            &self.u32(packets.iter().map(|(_, bytes)| bytes.len()).sum()),
            &self.u32(packets.len() * (16 + 1920)),
            &self.u32(0),
            &self.u32(packets.len()),
        ]
        .concat();
        assert_eq!(header.len(), 48);
        let more = [self.u32(1), self.u32(0), self.u32(0x202), self.u32(packets.len())].concat();
        let mut record = [&header[..], if self.mmapped { &more } else { &[] }].concat();
        for (i, (status, bytes)) in packets.iter().enumerate() {
            record.extend([&self.put(status.to_le_bytes())[..], &self.u32(slots(i)), &self.u32(bytes.len()), &[0; 4]].concat());
        }
        for (_, bytes) in packets {
            record.extend([bytes, &vec![0xaa; 1920 - bytes.len()][..]].concat());
        }
        self.record(stamp_ns, &record, cut);
    }
}

#[test]
fn every_format_in_either_order_is_read() {
    let sent = frames(2, Packing::Eleven);
    for (big, mmapped, nanos) in [false, true]
        .iter()
        .flat_map(|big| [false, true].map(|mmapped| [None, Some(false), Some(true)].map(|nanos| (*big, mmapped, nanos))).concat())
    {
        let mut capture = Usbmon::new(big, mmapped, nanos);
        for (number, transfer) in sent.chunks(8).enumerate() {
            if number == 20 && nanos.is_none() {
                capture.block(0xbad, &[1; 13]);
                capture.section(if mmapped { 220 } else { 189 });
            }
            let packets: Vec<_> = transfer.iter().map(|(_, bytes)| (0, &bytes[..])).collect();
            capture.transfer(transfer[0].0, 5, 0x82, &packets, 0);
            // Video, and what another device sends, are passed over.
            capture.transfer(transfer[0].0, 5, 0x81, &packets, 0);
            capture.transfer(transfer[0].0, 6, 0x82, &[(0, &[7; 100])], 0);
        }
        let (found, end, packets) = read(capture.bytes);
        assert_eq!(end, Ok(()), "{big} {mmapped} {nanos:?}");
        // Stamps are as fine as the format holds them: whole microseconds were sent.
        assert!(found.iter().zip(&sent).all(|(a, b)| (a.0 - b.0).abs() <= if nanos.is_none() { 954 } else { 0 } && a.1 == b.1));
        assert!(found.len() == sent.len() && packets.expect("a Kinect").remarks().is_empty());
    }
}

#[test]
fn the_first_of_two_kinects_is_read_and_what_failed_or_was_cut_is_not_there() {
    let sent = frames(1, Packing::Eleven);
    let mut capture = Usbmon::new(false, true, Some(false));
    for (number, transfer) in sent.chunks(8).enumerate() {
        let packets: Vec<_> = transfer.iter().map(|(_, bytes)| (if number == 3 { -18 } else { 0 }, &bytes[..])).collect();
        // Of the fifth transfer the capture keeps three packets and a half.
        capture.transfer(transfer[0].0, 5, 0x82, &packets, if number == 4 { 4 * 1920 + 1000 } else { 0 });
        capture.transfer(transfer[0].0, 9, 0x82, &packets, 0);
    }
    let (found, end, packets) = read(capture.bytes);
    let expected: Sent = [&sent[..24], &sent[32..35], &sent[40..]].concat();
    assert!(end == Ok(()) && found == expected);
    let remarks = packets.expect("a Kinect").remarks();
    assert!(
        remarks.len() == 2 && remarks[0].contains("device 9 on bus 3 is a Kinect, too") && remarks[1].contains("cut 5 packets"),
        "{remarks:?}"
    );
}

#[test]
fn what_is_no_capture_of_a_kinect_says_why() {
    let why = |bytes: Vec<u8>| read(bytes).1.expect_err("no Kinect");
    let capture = written(&frames(1, Packing::Eleven), None);
    assert!(why(vec![]).contains("empty"));
    assert!(why(b"PK\x03\x04 and so on".to_vec()).contains("begins with 50 4b 03 04"));
    assert!(why(capture[..10].to_vec()).contains("cut"));
    assert!(why(capture[..60].to_vec()).contains("no Kinect"));
    assert!(why([&capture[..60], &capture[60..150]].concat()).contains("cut in the middle of a block"));
    assert!(why(Usbmon::new(true, true, Some(true)).bytes[..20].to_vec()).contains("cut"));
    let mut ethernet = Usbmon::new(false, true, Some(true)).bytes;
    ethernet[20] = 1;
    assert!(why(ethernet).contains("link type is 1 (Ethernet)"));
    let mut ethernet = capture.clone();
    ethernet[36] = 1;
    assert!(why(ethernet[..60].to_vec()).contains("link type is 1 (Ethernet)"));
    let mut greedy = capture.clone();
    greedy[64..68].copy_from_slice(&0xffff_fff0_u32.to_le_bytes());
    assert!(why(greedy).contains("claims 4294967280 bytes"));
    for kind in [2, 3, 6] {
        let short: Vec<u8> = [kind, 12, 12].iter().flat_map(|word: &u32| word.to_le_bytes()).collect();
        assert!(why([&capture[..60], &short].concat()).contains("claims 0 bytes in a block of 12"), "{kind}");
    }
    let mut snapped = Usbmon::new(false, true, Some(false));
    snapped.transfer(0, 5, 0x82, &[(0, &[7; 1760])], 1900);
    assert!(why(snapped.bytes).contains("tcpdump -s 245824"));
    let introduced = written(&Sent::new(), Some(Packing::Eleven));
    assert!(why(introduced).contains("the Kinect, device 2 on bus 1, sends none"));
}

/// The same bytes over and over.
struct Endless(Cursor<Vec<u8>>);

impl Read for Endless {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if self.0.position() == self.0.get_ref().len() as u64 {
            self.0.set_position(0);
        }
        self.0.read(buffer)
    }
}

#[test]
fn what_never_ends_is_searched_as_far_as_its_first_gib() {
    const MOST: usize = 1 << 24;
    let endless = |start: &[u8], again: &[u8]| Cursor::new(start.to_vec()).chain(Endless(Cursor::new(again.to_vec())));
    let assert_none = |input: Box<dyn Read + Send>| {
        let message = Packets::read(input).expect("memory can be read").err().expect("no Kinect");
        assert!(message.contains("no Kinect in the first GiB of it"), "{message}");
    };
    let pcapng = Usbmon::new(false, true, None).bytes;
    let mut unknown = Usbmon { big: false, mmapped: true, nanos: None, bytes: Vec::new() };
    unknown.block(0x0bad, &vec![0; MOST - 12]);
    let unknown = unknown.bytes;
    assert_none(Box::new(endless(&pcapng, &unknown)));
    assert_none(Box::new(endless(&pcapng, &pcapng)));
    let mut pcap = Usbmon::new(false, true, Some(false));
    let header = std::mem::take(&mut pcap.bytes);
    pcap.record(0, &vec![0; MOST], 0);
    assert_none(Box::new(endless(&header, &pcap.bytes)));
    assert_none(Box::new(endless(&zstd_of(&header), &zstd_of(&vec![0; MOST]))));
    // A Kinect that comes later is none of it; one whose packing doesn't show in it is read.
    let introduced = written(&Sent::new(), Some(Packing::Eleven));
    let late = endless(&pcapng, &unknown).take(65 * MOST as u64 + pcapng.len() as u64).chain(Cursor::new(introduced));
    assert_none(Box::new(late));
    let mut one = Usbmon::new(false, true, None);
    one.transfer(0, 5, 0x82, &[(0, &frames(1, Packing::Eleven)[0].1)], 0);
    let mut packets = Packets::read(endless(&one.bytes, &unknown)).expect("memory can be read").expect("a Kinect");
    assert!(packets.next_packet().expect("it is whole").is_some());
}

#[test]
fn what_was_flushed_survives_and_names_do_not_matter() {
    let sent = frames(40, Packing::Eleven);
    let folder = env::temp_dir().join(format!("physinc-capture-{}", process::id()));
    fs::create_dir_all(&folder).expect("a folder");
    for name in ["a.pcapng", "a.pcapng.gz", "a.pcapng.zst"] {
        let path: PathBuf = folder.join(name);
        let mut writer = Writer::new(Output::create(&path, None).expect("a file")).expect("a file");
        sent.iter().try_for_each(|(arrival_ns, bytes)| writer.packet(bytes, *arrival_ns)).expect("a file");
        // As if it were killed now: nothing that is still in memory reaches the disk.
        let killed = fs::read(&path).expect("it is there");
        let (found, _, _) = read(killed);
        assert!(found.len() > 8000 && found == sent[..found.len()], "{name}: {}", found.len());
        writer.close().expect("a file");
        let (found, end, _) = read(fs::read(&path).expect("it is there"));
        assert!(end == Ok(()) && found == sent, "{name}");
        let renamed = folder.join("b.pcap.gz");
        fs::rename(&path, &renamed).expect("a file");
        assert!(Packets::open(&renamed).expect("a file").is_ok());
    }
    fs::remove_dir_all(&folder).expect("ours");
}

#[test]
fn a_host_whose_clock_goes_back_has_its_capture_flushed() {
    struct Flushes(usize);
    impl std::io::Write for Flushes {
        fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
            Ok(bytes.len())
        }
        fn flush(&mut self) -> std::io::Result<()> {
            self.0 += 1;
            Ok(())
        }
    }
    let mut writer = Writer::new(Flushes(0)).expect("takes all");
    for tenth in (0..30).rev() {
        writer.packet(&[0; 12], tenth * 100_000_000).expect("takes all");
    }
    assert_eq!(writer.finish().expect("takes all").0, 3, "twice, and at the end");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    /// Cut anywhere: all packets before are read, and then it is said.
    #[test]
    fn a_cut_loses_nothing_before_it(at in 0.0_f64..1.0, packed in 0..3) {
        let sent = frames(1, Packing::Eleven);
        let plain = written(&sent, None);
        let bytes = match packed {
            0 => plain.clone(),
            1 => zstd_of(&plain),
            _ => gzip_of(&plain),
        };
        let cut = (bytes.len() as f64 * at) as usize;
        let (found, end, _) = read(&bytes[..cut]);
        prop_assert!(found == sent[..found.len()]);
        if packed == 0 {
            // Each transfer is a record of its own, of 15 KB, and 3 % of the file is headers.
            let read_bytes: usize = found.iter().map(|(_, bytes)| bytes.len()).sum();
            prop_assert!(read_bytes + 40_000 > cut, "{} of {}", read_bytes, cut);
        } else {
            prop_assert!(end.is_err());
        }
    }

    /// Bytes that changed: no panic.
    #[test]
    fn garbled_bytes_break_nothing(changes in prop::collection::vec((0.0_f64..1.0, any::<u8>()), 1..20), packed in 0..3) {
        // Short packets: most of the bytes are headers.
        let sent: Sent = frames(1, Packing::Eleven).into_iter().take(24).map(|(at, bytes)| (at, bytes[..20].to_vec())).collect();
        let plain = written(&sent, Some(Packing::Eleven));
        let mut bytes = match packed {
            0 => plain,
            1 => zstd_of(&plain),
            _ => gzip_of(&plain),
        };
        let length = bytes.len() as f64;
        for (at, byte) in changes {
            bytes[(at * length) as usize] = byte;
        }
        let _ = read(bytes);
    }

    #[test]
    fn any_bytes_are_read_or_refused(magic in 0..5_usize, bytes in prop::collection::vec(any::<u8>(), 0..300)) {
        let magics: [&[u8]; 5] = [&[], &[0x0a, 0x0d, 0x0d, 0x0a], &[0xd4, 0xc3, 0xb2, 0xa1], &[0x1f, 0x8b, 8], &[0x28, 0xb5, 0x2f, 0xfd]];
        let _ = read([magics[magic], &bytes].concat());
    }
}

fn zstd_of(bytes: &[u8]) -> Vec<u8> {
    zstd::encode_all(bytes, 1).expect("memory")
}

fn gzip_of(bytes: &[u8]) -> Vec<u8> {
    use std::io::Write;
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    encoder.write_all(bytes).expect("memory");
    encoder.finish().expect("memory")
}
