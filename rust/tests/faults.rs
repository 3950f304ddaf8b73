//! Packets of a capture on a bad day: frames are whole or marked, and counts are exact.

mod packets;

use std::path::{Path, PathBuf};
use std::{env, fs, process};

use packets::packets;
use physinc::capture::Writer;
use physinc::config::Config;
use physinc::event::Counters;
use physinc::kinect::disparity::Packing;
use physinc::source::{Input, Source, open};
use physinc::stream::assembler::Assembler;

const FRAMES: usize = 60;
const SAMPLES: usize = 640 * 480;

/// No two frames agree in many samples, and none is 2047.
fn samples(number: usize) -> Vec<u16> {
    (0..SAMPLES).map(|i| ((i * 7 + number * 911 + i / 640) % 2047) as u16).collect()
}

/// A folder of its own, removed at the end.
struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Self {
        let folder = env::temp_dir().join(format!("physinc-{name}-{}", process::id()));
        fs::create_dir_all(&folder).expect("a folder");
        Self(folder)
    }

    /// A capture of [`FRAMES`] frames.
    fn capture(&self) -> String {
        let path = self.0.join("clean.pcapng");
        let mut writer = Writer::create(&path, None).expect("a file");
        writer.introduce(None, Packing::Eleven, 0).expect("a file");
        for number in 0..FRAMES {
            let sent = packets(Packing::Eleven, &samples(number), (number as u32 + 1) * 2_000_000, (number * 242) as u8);
            for (i, packet) in sent.iter().enumerate() {
                // A microframe each, 16 of them in a transfer.
                writer.packet(packet, number as i64 * 33_333_333 + i as i64 / 16 * 2_000_000).expect("a file");
            }
        }
        writer.close().expect("a file");
        path.to_str().expect("text").into()
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

fn opened(name: &str) -> Box<dyn Source> {
    open(name, &Config::default(), None).expect("a capture")
}

fn arrivals(name: &str) -> Vec<(Vec<u8>, i64)> {
    let (mut source, mut all) = (opened(name), Vec::new());
    while let Some(Input::Packet { bytes, arrival_ns }) = source.next_input().expect("it is whole") {
        all.push((bytes.to_vec(), arrival_ns));
    }
    all
}

/// Through the assembler: every sample is its frame's own or 2047 where the frame says so. Frame numbers, counters, and what was injected.
fn assembled(name: &str) -> (Vec<usize>, Counters, String) {
    let mut source = opened(name);
    let mut assembler = Assembler::new(Packing::Eleven, vec![0; Packing::Eleven.frame_bytes()]).expect("large enough");
    let (mut frames, mut lost) = (Vec::new(), 0);
    while let Some(Input::Packet { bytes, arrival_ns }) = source.next_input().expect("it is whole") {
        assembler.push(bytes, arrival_ns, &mut |frame| {
            let number = (frame.timestamp_ns as f64 * 0.06 / 2e6).round() as usize - 1;
            let (mut expected, mut got) = (samples(number), vec![0; SAMPLES]);
            Packing::Eleven.unpack(frame.packed, &mut got).expect("a frame");
            frame.missing().for_each(|range| expected[range].fill(2047));
            assert!(got == expected, "{name}: frame {number} is torn");
            lost += frame.lost;
            frames.push(number);
        });
    }
    let counters = assembler.counters();
    assert!(frames.is_sorted() && frames.len() as u64 == counters.frames && lost == counters.packets_lost, "{name}");
    (frames, counters, source.remarks().pop().unwrap_or_default())
}

/// The number before `what` in a remark.
fn number(remark: &str, what: &str) -> u64 {
    let before = remark.split(what).next().unwrap_or_default();
    before.rsplit([' ', ',']).find_map(|word| word.parse().ok()).expect("a number")
}

#[test]
fn each_fault_is_counted_as_it_is() {
    let folder = Folder::new("faults");
    let capture = folder.capture();
    let all: Vec<usize> = (0..FRAMES).collect();
    let clean = Counters { frames: 60, packets: 60 * 242, ..Counters::default() };
    assert_eq!(arrivals(&format!("{capture}?lose=0")), arrivals(&capture));
    assert_eq!(assembled(&format!("{capture}?seed=1")).1, clean);

    for seed in 1..4 {
        let with = |faults: &str| assembled(&format!("{capture}?{faults}&seed={seed}"));
        let (frames, counters, said) = with("lose=0.05");
        assert!(frames.len() >= 53, "{frames:?}: a lost end beside a lost beginning takes a frame along");
        let lost = number(&said, " packets lost");
        assert_eq!(counters.packets, clean.packets - lost);
        assert!(
            counters.packets_lost <= lost && counters.packets_lost + 200 > lost,
            "but for those after the last frame or before the first"
        );

        let (frames, counters, said) = with("empty=0.01");
        assert!(frames.len() > 56 && counters.packets_lost <= number(&said, " empty"));
        let (frames, counters, said) = with("short=0.01");
        // One cut to nothing is an empty one.
        assert!(frames.len() > 56 && counters.packets_lost <= number(&said, " short"));
        assert!(counters.packets_invalid <= number(&said, " short") && counters.packets_invalid > 80);

        assert_eq!(with("double=0.05").0, all);
        let (_, counters, said) = with("double=0.05");
        assert_eq!((counters.packets_lost, counters.packets_invalid, counters.frames_incomplete), (0, number(&said, " doubled"), 0));
        let (frames, counters, said) = with("foreign=0.05");
        assert_eq!((frames, counters.packets_invalid, counters.frames_incomplete), (all.clone(), number(&said, " foreign"), 0));

        // Late within a frame is no loss; over its end it is.
        let (frames, counters, said) = with("late=0.05");
        assert!(frames.len() > 50 && counters.packets_lost * 5 < number(&said, " late"), "{frames:?} {counters:?} {said}");

        let (frames, counters, _) = with("lose=0.05&burst=60");
        assert!(frames.len() > 40 && (3..35).contains(&counters.frames_incomplete), "{counters:?}");
        let (frames, counters, said) = with("silence=0.0002");
        // What a silence swallows can't be counted, and isn't guessed.
        assert!(frames.len() > 10 && counters.packets + number(&said, " packets lost") == clean.packets);
    }
}

/// Flipped bits may be anywhere, in samples too: nothing panics, and all but a few frames come.
#[test]
fn everything_at_once_is_survived() {
    let folder = Folder::new("everything");
    let capture = folder.capture();
    for seed in 1..6 {
        let name = format!("{capture}?lose=0.01&burst=5&empty=0.01&short=0.01&double=0.01&foreign=0.01&late=0.01&flip=0.02&seed={seed}");
        assert_eq!(arrivals(&name), arrivals(&name), "the same seed, the same faults");
        let mut assembler = Assembler::new(Packing::Eleven, vec![0; Packing::Eleven.frame_bytes()]).expect("large enough");
        let mut frames = 0;
        for (bytes, arrival_ns) in arrivals(&name) {
            assembler.push(&bytes, arrival_ns, &mut |_| frames += 1);
        }
        assert!(frames > 45, "{frames} of {FRAMES}");
    }
    assert_ne!(arrivals(&format!("{capture}?lose=0.1&seed=1")), arrivals(&format!("{capture}?lose=0.1&seed=2")));
}

#[test]
fn a_files_own_name_comes_first() {
    let folder = Folder::new("names");
    let capture = folder.capture();
    let renamed = format!("{capture}?lose=1.pcapng");
    fs::rename(&capture, &renamed).expect("a file");
    assert_eq!(arrivals(&renamed).len(), FRAMES * 242);
    assert!(arrivals(&format!("{renamed}?lose=1")).is_empty());
    for (name, message) in [
        (format!("{renamed}?loose=1"), "no fault `loose`"),
        (format!("{capture}?lose=1"), "no such file"),
        (format!("{}?lose=1", Path::new(&capture).with_extension("npz").display()), "no such file"),
    ] {
        let error = open(&name, &Config::default(), None).err().expect("refused").to_string();
        assert!(error.contains(message), "{error}");
    }
}
