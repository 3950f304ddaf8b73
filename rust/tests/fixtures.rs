//! The captures in `fixtures/`: one throw, and what may happen to a capture of it.

mod judge;

use judge::{finals, hold};
use physinc::config::Config;
use physinc::event::{Contact, Counters, EndReason, Event, Kind, StreamEnded};
use physinc::math::Vec3;
use physinc::run::{Options, Run};
use physinc::source::{SourceError, open};
use std::fs;
use std::path::{Path, PathBuf};

/// Of the whole throw.
const FRAMES: u64 = 85;
const PACKETS: u64 = FRAMES * 242;

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures")
}

/// The events of a capture, and how it ended.
fn events(name: &str) -> (Vec<Event>, Counters, Result<(), SourceError>) {
    let config = Config::default();
    let path = folder().join(name);
    let mut source = open(path.to_str().expect("text"), &config, None).expect(name);
    let mut run = Run::of(&*source, name, &config, Options { positions: true, ..Options::default() }).expect("a configuration that can be");
    let mut events = Vec::new();
    let end = loop {
        match source.next_input() {
            Ok(Some(input)) => drop(run.push(input, &mut |e| events.push(e)).expect("a Kinect's packet")),
            Ok(None) => break Ok(()),
            Err(error) => break Err(error),
        }
    };
    run.end(EndReason::EndOfSource, &mut |e| events.push(e));
    hold(&events);
    let counters = finals!(events, StreamEnded).last().expect("it ends").1.counters;
    (events, counters, end)
}

/// First touches: time, ns, and center.
fn truth() -> Vec<(i64, Vec3)> {
    let text = fs::read_to_string(folder().join("truth.json")).expect("it is there");
    let truth: serde_json::Value = serde_json::from_str(&text).expect("what the simulator wrote");
    let number = |value: &serde_json::Value| value.as_f64().expect("a number");
    let contacts = truth["contacts"].as_array().expect("a list").iter();
    contacts.map(|c| (c["time_ns"].as_i64().expect("ns"), Vec3::from_fn(|i, _| number(&c["center"][i])))).collect()
}

/// Which true contacts were found; every one that is told is true, to within `error` m.
fn found(name: &str, events: &[Event], error: f64) -> Vec<usize> {
    let truth = truth();
    let mut found: Vec<usize> = finals!(events, Contact)
        .into_iter()
        .map(|(_, c)| {
            let near = |t: &(i64, Vec3)| (t.0 - c.time_ns).abs() < 10_000_000 && (t.1 - Vec3::from(c.center)).norm() < error;
            truth.iter().position(near).unwrap_or_else(|| panic!("{name}: nothing was touched there: {c:?}"))
        })
        .collect();
    found.sort_unstable();
    found
}

#[test]
fn formats_hold_the_same() {
    let (clean, counters, end) = events("clean.pcapng.zst");
    assert!(end.is_ok() && (counters.frames, counters.packets, counters.packets_lost) == (FRAMES, PACKETS, 0));
    assert_eq!(found("clean", &clean, 0.003), [0, 1]);
    let (other, same, end) = events("big_endian_189.pcap.gz");
    assert!(end.is_ok() && other[1..] == clean[1..] && same == counters, "but for its name");
}

#[test]
fn a_cut_capture_tells_what_came_before() {
    let (clean, ..) = events("clean.pcapng.zst");
    let (cut, counters, end) = events("cut.pcapng.zst");
    assert!(end.is_err_and(|error| error.to_string().contains("cut")) && counters.frames > FRAMES / 2);
    let told = |events: &[Event]| events.iter().filter(|e| matches!(e.kind, Kind::Position(_))).cloned().collect::<Vec<_>>();
    let (cut, clean) = (told(&cut), told(&clean));
    assert!(cut.len() > 10 && cut[..] == clean[..cut.len()]);
}

#[test]
fn faults_are_counted_and_cost_little() {
    // Frames, incomplete ones, packets lost and invalid, contacts.
    for (name, counts, contacts) in [
        ("lost", [85, 85, 981, 0], &[0, 1][..]),
        ("bursts", [85, 40, 981, 0], &[0, 1]),
        ("empty", [84, 83, 451, 0], &[0, 1]),
        ("short", [85, 85, 462, 462], &[0, 1]),
        ("doubled", [85, 0, 0, 384], &[0, 1]),
        ("foreign", [85, 0, 0, 113], &[0, 1]),
        ("late", [85, 7, 8, 8], &[0, 1]),
        ("flipped", [85, 1, 1, 1], &[0, 1]),
        // What a silence swallows can't be counted; the second bounce was in it.
        ("silence", [49, 0, 0, 0], &[0]),
    ] {
        let (events, counters, end) = events(&format!("{name}.pcapng.zst"));
        let Counters { frames, frames_incomplete, packets_lost, packets_invalid, .. } = counters;
        assert_eq!([frames, frames_incomplete, packets_lost, packets_invalid], counts, "{name}");
        assert!(end.is_ok());
        assert_eq!(found(name, &events, 0.010), contacts, "{name}");
    }
}

#[test]
fn the_table_names_every_file() {
    let table = fs::read_to_string(folder().join("README.md")).expect("it is there");
    for file in fs::read_dir(folder()).expect("a folder") {
        let name = file.expect("a file").file_name().into_string().expect("text");
        assert!(table.contains(&format!("`{name}`")) || name == "README.md", "{name}");
    }
}
