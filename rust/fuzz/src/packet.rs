//! Any bytes as a packet, a command, a reply, a calibration.
#![no_main]

use libfuzzer_sys::fuzz_target;
use physinc::kinect::calibration::ZeroPlane;
use physinc::kinect::command::{Command, Reply};
use physinc::kinect::packet::{Header, Packet};

fuzz_target!(|bytes: &[u8]| {
    if let Ok(header) = Packet::new(bytes).and_then(|packet| Header::parse(&packet)) {
        let again = header.emit(0);
        assert_eq!(Packet::new(&again).and_then(|packet| Header::parse(&packet)), Ok(header));
    }
    let mut out = vec![0; bytes.len()];
    if let Ok(command) = Command::parse(bytes) {
        let length = command.emit(&mut out).expect("it was no longer");
        assert_eq!(out[..length], bytes[..length]);
        if let Ok(reply) = Reply::parse(bytes) {
            let _ = reply.to(&command);
        }
    }
    if let Ok(reply) = Reply::parse(bytes) {
        let length = reply.emit(&mut out).expect("it was no longer");
        assert_eq!(out[..length], bytes[..length]);
    }
    let (shift, parameters) = bytes.split_at(bytes.len().min(4));
    if let Some(plane) = ZeroPlane::parse(parameters, shift) {
        let _ = (plane.law(), plane.focal_length_px());
    }
});
