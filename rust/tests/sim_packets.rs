//! A scene's packets, put together again, are its frames.

use physinc::capture::Packets as Captured;
use physinc::kinect::disparity::Packing;
use physinc::kinect::packet::PacketError;
use physinc::sim::recording::write_capture;
use physinc::sim::{Packets, Scene};
use physinc::stream::assembler::Assembler;
use std::collections::VecDeque;
use std::io::Cursor;

/// Pushes all packets that `next` hands out, and holds what comes of them against the scene's frames; how many were whole.
fn assemble(scene: &Scene, mut next: impl FnMut() -> Option<(Vec<u8>, i64)>) -> Assembler<Vec<u8>> {
    let packing = Packing::Eleven;
    let mut assembler = Assembler::new(packing, vec![0; packing.frame_bytes()]).unwrap();
    let (mut frames, mut samples) = (scene.frames(), vec![0; 640 * 480]);
    while let Some((packet, arrival_ns)) = next() {
        assembler.push(&packet, arrival_ns, &mut |whole| {
            let frame = frames.next_frame().expect("no more frames than there were");
            packing.unpack(whole.packed, &mut samples).unwrap();
            assert!(whole.is_whole() && whole.timestamp_ns == frame.timestamp_ns && samples == frame.samples);
            assert!((0..5_000_000_000).contains(&(arrival_ns - 1_288_828_800_000_000_000 - whole.timestamp_ns)));
        });
    }
    assert!(frames.next_frame().is_none(), "a frame is missing");
    assembler
}

#[test]
fn all_frames_come_whole_and_identical() {
    for keys in ["seed=3", "seed=4&loss=0.3"] {
        let scene = Scene::parse(&format!("drop?{keys}")).unwrap();
        let mut packets = Packets::new(&scene);
        let counters = assemble(&scene, || packets.next_packet().map(|(bytes, arrival_ns)| (bytes.to_vec(), arrival_ns))).counters();
        let frames = scene.truth().frames.len() as u64;
        assert_eq!((counters.frames, counters.packets, counters.packets_invalid), (frames, frames * 242, 0));
        // The first and the last packet of what was lost are known, and so is all between.
        let span = scene.truth().frames.last().unwrap().timestamp_ns - scene.truth().frames[0].timestamp_ns;
        let sent = (span as f64 * 30e-9).round() as u64 + 1;
        assert_eq!(counters.packets_lost, (sent - frames) * 242, "{keys}");
    }
}

#[test]
fn a_bus_at_full_speed_carries_them() {
    let scene = Scene::parse("passive_flight?throws=1").unwrap();
    let mut packets = Packets::new(&scene);
    let (mut arrivals, mut empty) = (VecDeque::new(), 0);
    while let Some((bytes, arrival_ns)) = packets.next_packet() {
        empty += usize::from(physinc::kinect::packet::Packet::new(bytes).err() == Some(PacketError::Empty));
        arrivals.push_back(arrival_ns);
        assert!(arrivals.len() <= 16 || arrival_ns - arrivals.pop_front().unwrap() >= 2_000_000, "more than one a microframe");
    }
    let frames = scene.truth().frames.len();
    // 266 or 267 microframes a frame.
    assert!((23 * frames..=26 * frames + 32).contains(&empty), "{empty} of {frames}");
}

#[test]
fn a_capture_of_it_holds_them_and_tells_the_calibration() {
    let scene = Scene::parse("passive_flight?throws=1&seed=2").unwrap();
    let capture = write_capture(&scene, Vec::new(), || Ok(())).unwrap();
    let mut captured = Captured::read(Cursor::new(capture)).unwrap().unwrap();
    assert_eq!((captured.packing(), captured.zero_plane()), (Packing::Eleven, Some(physinc::sim::packets::zero_plane())));
    let counters = assemble(&scene, || captured.next_packet().unwrap().map(|(bytes, at)| (bytes.to_vec(), at))).counters();
    assert_eq!((counters.packets_lost, counters.packets_invalid), (0, 0));
}
