//! A live Kinect that isn't there: the driver through real libusb, before `virtual-kinect` (rust/virtual), which `VIRTUAL_KINECT` names.
//! Each test runs its other half, an ignored test of its own, under it.

mod counting;
mod skipping;

use std::process::Command;
use std::time::Duration;

use physinc::config::CameraConfig;
use physinc::event::ReconnectReason;
use physinc::kinect::disparity::{HEIGHT, Packing, WIDTH};
use physinc::sim::{Packets, Scene};
use physinc::source::usb::{DeviceError, Live, Problem};
use physinc::source::{Input, Source, SourceError};
use physinc::stream::assembler::Assembler;

/// Runs the ignored test `name` of this file under a virtual Kinect, if there is one.
fn before(device: &[&str], name: &str) {
    let Some(program) = std::env::var_os("VIRTUAL_KINECT") else {
        return skipping::miss("VIRTUAL_KINECT does not name the virtual Kinect: `make virtual` makes it");
    };
    // Where anybody may run it.
    let own = std::env::temp_dir().join(format!("physinc-live-{}-{}", std::process::id(), name.replace("::", "-")));
    std::fs::copy(std::env::current_exe().expect("this test"), &own).expect("room");
    let output = Command::new(program).args(device).arg("--").arg(&own).args(["--ignored", "--exact", name, "--nocapture"]).output();
    let _ = std::fs::remove_file(own);
    let output = output.expect("the virtual Kinect runs");
    assert!(output.status.success(), "{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
}

/// Hands `frames` frames to `sink`, stamp and samples; whole ones only, and nothing lost, allocated or silent between them.
fn watch(live: &mut Live, frames: u64, mut sink: impl FnMut(i64, &[u16])) {
    let mut assembler = Assembler::new(Packing::Eleven, vec![0; Packing::Eleven.frame_bytes()]).expect("room");
    let mut samples = vec![0; WIDTH * HEIGHT];
    let mut warm = None;
    while assembler.counters().frames < frames {
        let input = live.next_input().expect("it is there").expect("it goes on");
        let Input::Packet { bytes, arrival_ns } = input else { continue };
        let mut stamp_ns = None;
        assembler.push(bytes, arrival_ns, &mut |frame| {
            assert!(frame.is_whole());
            frame.packing.unpack(frame.packed, &mut samples).expect("as many");
            stamp_ns = Some(frame.timestamp_ns);
        });
        if let Some(stamp_ns) = stamp_ns {
            let before = counting::so_far();
            assert!(warm.is_none_or(|warm| warm == before), "{} allocations", before - warm.unwrap_or(0));
            sink(stamp_ns, &samples);
            warm = (assembler.counters().frames > 5).then(counting::so_far);
        }
    }
    let counters = assembler.counters();
    assert_eq!((counters.packets_lost, counters.packets_invalid, counters.frames_incomplete), (0, 0, 0));
}

#[test]
fn every_frame_is_what_was_sent_and_none_allocates() {
    before(&["sim:bounce"], "under_virtual::every_frame");
}

#[test]
fn a_device_that_another_program_has_names_it() {
    before(&["--busy"], "under_virtual::busy");
}

#[test]
fn a_device_that_may_not_be_opened_says_which() {
    before(&["--denied"], "under_virtual::denied");
}

#[test]
fn video_comes_beside_depth() {
    before(&["sim:bounce"], "under_virtual::video");
}

#[test]
fn a_device_that_is_unplugged_again_and_again_leaves_nothing_behind() {
    before(&["sim:bounce", "--unplug", "frame:10:0.05:100"], "under_virtual::again_and_again");
}

/// The other halves.
mod under_virtual {
    use super::*;

    #[test]
    #[ignore = "run by the tests above, under the virtual Kinect that VIRTUAL_KINECT names (`make virtual`)"]
    fn every_frame() {
        let mut live = Live::open("kinect", &CameraConfig::default()).expect("it is there");
        let scene = Scene::parse_for_packets("bounce").expect("a scene");
        let mut sent = Packets::endless(&scene);
        let mut packed = Assembler::new(Packing::Eleven, vec![0; Packing::Eleven.frame_bytes()]).expect("room");
        let mut samples = vec![0; WIDTH * HEIGHT];
        watch(&mut live, 300, |stamp_ns, got| {
            let mut expected = None;
            while expected.is_none() {
                let (bytes, arrival_ns) = sent.next_packet().expect("endless");
                packed.push(bytes, arrival_ns, &mut |frame| {
                    frame.packing.unpack(frame.packed, &mut samples).expect("as many");
                    expected = Some(frame.timestamp_ns);
                });
            }
            assert_eq!(Some(stamp_ns), expected);
            assert!(got == samples, "at {stamp_ns}");
        });
        println!("{:?}", live.traffic());
    }

    #[test]
    #[ignore = "run by the tests above, under the virtual Kinect that VIRTUAL_KINECT names (`make virtual`)"]
    fn busy() {
        let error = Live::open("kinect", &CameraConfig::default()).err().expect("another has it");
        let SourceError::Device(DeviceError { problem: Problem::Busy { holders, .. }, .. }) = &error else { panic!("{error}") };
        assert!(!holders.is_empty(), "{error}");
    }

    #[test]
    #[ignore = "run by the tests above, under the virtual Kinect that VIRTUAL_KINECT names (`make virtual`)"]
    fn denied() {
        let error = Live::open("kinect", &CameraConfig::default()).err().expect("it may not");
        let SourceError::Device(DeviceError { problem: Problem::Denied { node }, .. }) = &error else { panic!("{error}") };
        assert!(node.starts_with("/dev/bus/usb/001/"), "{error}");
    }

    #[test]
    #[ignore = "run by the tests above, under the virtual Kinect that VIRTUAL_KINECT names (`make virtual`)"]
    fn video() {
        for (name, shape) in [("kinect?video=color", 640 * 480), ("kinect?video=infrared", 640 * 488)] {
            let mut live = Live::open(name, &CameraConfig::default()).expect("it is there");
            let latest = live.video().expect("asked for");
            watch(&mut live, 30, |_, _| ());
            let image = latest.take().expect("there was one");
            assert_eq!((image.samples.len(), image.missing.len()), (shape, 0));
            // A slope, as the virtual Kinect's.
            let range = if shape == 640 * 480 { 256 } else { 1024 };
            assert!(image.samples.windows(2).take(200).all(|pair| (pair[1] + range - pair[0]) % range < range), "{name}");
        }
    }

    /// Open files and threads of this process.
    fn held() -> (usize, usize) {
        let count = |folder| std::fs::read_dir(folder).expect("Linux").count();
        (count("/proc/self/fd"), count("/proc/self/task"))
    }

    #[test]
    #[ignore = "run by the tests above, under the virtual Kinect that VIRTUAL_KINECT names (`make virtual`)"]
    fn again_and_again() {
        let mut live = Live::open("kinect", &CameraConfig::default()).expect("it is there");
        live.wait_for_return(Duration::from_secs(20));
        let before = held();
        let (mut gone, mut back) = (0, 0);
        while back < 100 {
            match live.next_input().expect("it comes back").expect("it goes on") {
                Input::Disconnected(_) => gone += 1,
                Input::Reconnected(reason) => {
                    assert_eq!(reason, ReconnectReason::SameSerial);
                    back += 1;
                }
                _ => {}
            }
        }
        assert_eq!((gone, held()), (100, before));
        watch(&mut live, 30, |_, _| ());
    }
}
