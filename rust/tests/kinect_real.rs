//! The 55 control transactions that the first libfreenect recorded from a real Kinect, where they are there.

mod skipping;

use std::path::Path;
use std::{env, fs};

use physinc::geometry::camera::KINECT_DISPARITY_LAW;
use physinc::kinect::calibration::ZeroPlane;
use physinc::kinect::command::{Command, HEADER, REPLY_SIZE, Reply, code};

fn bytes(hex: &str) -> Vec<u8> {
    (0..hex.len() / 2).map(|i| u8::from_str_radix(&hex[2 * i..2 * i + 2], 16).expect("hexadecimal")).collect()
}

/// Command, tag, payload out, status and payload back.
type Transaction = (u16, u16, Vec<u8>, Vec<u8>);

fn recorded() -> Option<Vec<Transaction>> {
    let beside = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data");
    let folder = env::var_os("PHYSINC_DATA").map_or(beside, Into::into);
    let file = folder.join("libfreenect-2010-raw/camera_init_control_transactions.txt");
    let Ok(text) = fs::read_to_string(&file) else {
        skipping::skip(&format!("no real transactions at {} (PHYSINC_DATA names the folder)", file.display()));
        return None;
    };
    let number = |hex: &str| u16::from_str_radix(hex, 16).expect("hexadecimal");
    let transaction = |line: &str| {
        let columns: Vec<_> = line.trim().split(',').collect();
        (number(columns[0]), number(columns[1]), bytes(columns[2]), bytes(columns[3]))
    };
    Some(text.lines().map(transaction).collect())
}

#[test]
fn real_transactions_are_built_and_read_to_the_byte() {
    let Some(transactions) = recorded() else { return };
    assert_eq!(transactions.len(), 55);
    for (number, tag, sent, answer) in &transactions {
        let command = Command { command: *number, tag: *tag, payload: sent };
        let mut out = [0; HEADER + 1024];
        let length = command.emit(&mut out).expect("room");
        assert_eq!(length, HEADER + sent.len());
        assert_eq!(Command::parse(&out[..length]), Ok(command));

        // The text has the header's fields apart: put together by hand.
        let half = (answer.len() / 2) as u16;
        let mut raw: Vec<u8> = [0x4252, half, *number, *tag].iter().flat_map(|word| word.to_le_bytes()).collect();
        raw.extend(answer);
        assert!(raw.len() < REPLY_SIZE);
        let reply = Reply::parse(&raw).and_then(|reply| reply.to(&command)).expect("a reply to it");
        let length = reply.emit(&mut out).expect("room");
        assert_eq!(out[..length], raw, "{number:02x} {tag:04x}");
    }
}

#[test]
fn the_real_zero_plane_gives_the_law() {
    let Some(transactions) = recorded() else { return };
    let reply = |number, first: &[u8]| {
        let found = transactions.iter().find(|(command, _, sent, _)| *command == number && sent.starts_with(first));
        &found.expect("recorded").3
    };
    let plane = ZeroPlane::parse(reply(code::FIXED_PARAMETERS, &[0, 0]), reply(code::MODE_PARAMETERS, &[0, 0])).expect("a zero plane");
    assert_eq!((plane.emitter_cm, plane.rcmos_cm, plane.reference_cm, plane.pixel_cm), (7.5, 2.3, 120.0, 0.1042));
    assert_eq!(plane.shift, 200);
    for (got, stated) in plane.law().iter().zip(KINECT_DISPARITY_LAW) {
        assert!((got / stated - 1.0).abs() < 1e-7, "{got} {stated}");
    }
}

#[cfg(feature = "sim")]
#[test]
fn the_virtual_camera_answers_as_the_real_one_did() {
    use physinc::sim::kinect::{Camera, Depth, Device, Faults, Model, Setup};
    let Some(transactions) = recorded() else { return };
    let depth = Depth::scene("drop", Faults::default()).expect("a scene");
    let mut camera = Camera::new(Model::M1414, "1", depth, None);
    let known = [code::WRITE_REGISTER, code::FIXED_PARAMETERS, code::MODE_PARAMETERS, code::CMOS];
    let (mut answered, mut identical) = (0, 0);
    for (command, tag, sent, answer) in transactions.iter().filter(|(command, ..)| known.contains(command)) {
        let mut bytes = [0; HEADER + 64];
        let length = Command { command: *command, tag: *tag, payload: sent }.emit(&mut bytes).expect("room");
        let setup = |request_type, length| Setup { request_type, request: 0, value: 0, index: 0, length };
        camera.control(setup(0x40, length as u16), &bytes[..length], 0).expect("a command that it knows");
        let mut replies = (0..9).map(|_| camera.control(setup(0xc0, REPLY_SIZE as u16), &[], 0).expect("a poll"));
        let reply = replies.find(|reply| !reply.is_empty()).expect("a reply");
        assert_eq!(reply.len(), HEADER + answer.len(), "{command:02x} {tag:04x}");
        answered += 1;
        identical += usize::from(reply[HEADER..] == answer[..]);
    }
    // All but what the image sensor measured (one) and the parameters of that unit (five).
    assert_eq!((answered, identical), (42, 36));
}
