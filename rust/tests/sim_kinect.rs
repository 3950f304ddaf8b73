//! The virtual Kinect's model as a driver meets it: dialogue, streams, faults and their truth.

use physinc::event::Counters;
use physinc::kinect::calibration::ZeroPlane;
use physinc::kinect::command::{Command, CommandError, REPLY_SIZE, Reply, code};
use physinc::kinect::disparity::Packing;
use physinc::sim::kinect::{Camera, DEPTH, Depth, Device, Faults, FrameSent, Misbehaviour, Model, Setup, Stall, VIDEO};
use physinc::sim::packets::zero_plane;
use physinc::stream::assembler::Assembler;

const SCENE: &str = "drop?seed=3";
const START: [(u16, u16); 7] = [(0x105, 0), (0x06, 0), (0x12, 3), (0x13, 1), (0x14, 0x1e), (0x06, 2), (0x17, 0)];
const START_VIDEO: [(u16, u16); 5] = [(0x0c, 0), (0x0d, 1), (0x0e, 0x1e), (0x05, 1), (0x47, 0)];

struct Host {
    camera: Camera,
    tag: u16,
}

impl Host {
    fn new(model: Model, faults: &str, reply: Option<&str>) -> Self {
        let faults = if faults.is_empty() { Faults::default() } else { Faults::parse(faults).unwrap() };
        let reply = reply.map(|reply| Misbehaviour::parse(reply).unwrap());
        Self { camera: Camera::new(model, "V1", Depth::scene(SCENE, faults).unwrap(), reply), tag: 7 }
    }

    fn send(&mut self, bytes: &[u8]) -> Result<Vec<u8>, Stall> {
        let setup = Setup { request_type: 0x40, request: 0, value: 0, index: 0, length: bytes.len() as u16 };
        self.camera.control(setup, bytes, 0)
    }

    fn poll(&mut self) -> Result<Vec<u8>, Stall> {
        self.camera.control(Setup { request_type: 0xc0, request: 0, value: 0, index: 0, length: REPLY_SIZE as u16 }, &[], 0)
    }

    /// The reply as it comes, and after how many polls; empty after 200.
    fn ask(&mut self, command: u16, words: &[u16]) -> Result<(Vec<u8>, usize), Stall> {
        let payload: Vec<u8> = words.iter().flat_map(|word| word.to_le_bytes()).collect();
        let mut bytes = vec![0; 64];
        self.tag += 1;
        let length = Command { command, tag: self.tag, payload: &payload }.emit(&mut bytes).unwrap();
        self.send(&bytes[..length])?;
        for polls in 0..200 {
            let reply = self.poll()?;
            if !reply.is_empty() {
                return Ok((reply, polls));
            }
        }
        Ok((Vec::new(), 200))
    }

    /// Status word and payload of the reply.
    fn tell(&mut self, command: u16, words: &[u16]) -> Vec<u8> {
        let (bytes, _) = self.ask(command, words).expect("no stall");
        let sent = Command { command, tag: self.tag, payload: &[] };
        Reply::parse(&bytes).and_then(|reply| reply.to(&sent)).expect("a reply to it");
        bytes[8..].to_vec()
    }

    fn write(&mut self, registers: &[(u16, u16)]) {
        for &(register, value) in registers {
            assert_eq!(self.tell(code::WRITE_REGISTER, &[register, value]), [0, 0]);
        }
    }

    fn came(&mut self, endpoint: u8, microframes: usize) -> usize {
        (0..microframes).filter(|_| !self.camera.packet(endpoint).bytes.is_empty()).count()
    }

    /// Puts `frames` frames together: the checksums of whole ones, and what was counted.
    fn stream(&mut self, packing: Packing, frames: u64) -> (Vec<u32>, Counters, Vec<FrameSent>) {
        let mut assembler = Assembler::new(packing, vec![0; packing.frame_bytes()]).unwrap();
        let (mut samples, mut whole, mut sent) = (vec![0; 640 * 480], Vec::new(), Vec::new());
        while self.camera.frames_sent().1 < frames || sent.is_empty() {
            for _ in 0..64 {
                let slot = self.camera.packet(DEPTH);
                if slot.trouble.is_some() {
                    continue;
                }
                assembler.push(slot.bytes, 0, &mut |frame| {
                    if frame.is_whole() {
                        packing.unpack(frame.packed, &mut samples).unwrap();
                        let mut crc = flate2::Crc::new();
                        crc.update(&samples.iter().flat_map(|sample: &u16| sample.to_le_bytes()).collect::<Vec<u8>>());
                        whole.push(crc.sum());
                    }
                });
            }
            sent.extend(self.camera.frames_sent().0);
        }
        (whole, assembler.counters(), sent)
    }
}

#[test]
fn only_a_stream_that_was_started_brings_packets() {
    let mut host = Host::new(Model::M1414, "", None);
    assert_eq!((host.came(DEPTH, 600), host.came(VIDEO, 600)), (0, 0));
    host.write(&START);
    assert!(host.camera.is_streaming(DEPTH) && !host.camera.is_streaming(VIDEO));
    // A third of a second, with an empty slot in each tenth microframe or so.
    let came = host.came(DEPTH, 2667);
    assert!((10 * 242 - 60..=10 * 242 + 60).contains(&came), "{came}");
    host.write(&[(0x06, 0)]);
    assert_eq!(host.came(DEPTH, 600), 0);
    host.write(&START_VIDEO);
    let came = host.came(VIDEO, 2667);
    assert!((10 * 162..=11 * 162).contains(&came), "{came}");
    host.camera.reset();
    assert_eq!(host.came(VIDEO, 600), 0);
}

#[test]
fn frames_are_whole_in_both_packings_and_the_truth_knows_them() {
    for (packing, mode) in [(Packing::Eleven, 3), (Packing::Ten, 2)] {
        let mut host = Host::new(Model::M1414, "", None);
        host.write(&START.map(|(register, value)| if register == 0x12 { (register, mode) } else { (register, value) }));
        let (whole, counters, sent) = host.stream(packing, 5);
        assert_eq!(whole, sent.iter().map(|frame| frame.crc32).collect::<Vec<_>>());
        assert!(sent.iter().all(|frame| frame.packets == packing.packets() && frame.lost.is_empty()));
        assert_eq!((counters.packets_lost, counters.packets_invalid), (0, 0));
    }
}

#[test]
fn a_second_start_begins_with_a_whole_frame() {
    let mut host = Host::new(Model::M1414, "", None);
    host.write(&START);
    host.came(DEPTH, 400);
    host.write(&[(0x06, 0)]);
    host.write(&START);
    let (whole, counters, _) = host.stream(Packing::Eleven, 3);
    assert_eq!((whole.len(), counters.packets_lost), (2, 0));
}

#[test]
fn what_is_lost_is_what_the_truth_says() {
    for faults in ["lose=0.01", "lose=0.02&burst=8", "zero=0.01", "error=0.01", "short=0.01", "double=0.02", "foreign=0.02", "silence=0.2"]
    {
        let mut host = Host::new(Model::M1414, &format!("{faults}&from=1&seed=5"), None);
        host.write(&START);
        let (whole, counters, sent) = host.stream(Packing::Eleven, 20);
        let lost: usize = sent.iter().map(|frame| frame.lost.len()).sum();
        assert_eq!(counters.packets_lost, lost as u64, "{faults}");
        assert_eq!(lost == 0, faults.starts_with("double") || faults.starts_with("foreign"), "{faults}");
        let truly: Vec<u32> = sent.iter().filter(|frame| frame.lost.is_empty()).map(|frame| frame.crc32).collect();
        assert_eq!(whole, truly, "{faults}");
    }
    let mut host = Host::new(Model::M1414, "begin=100", None);
    host.write(&START);
    assert_eq!(host.stream(Packing::Eleven, 3).0.len(), 2, "it begins in mid-frame");
}

#[test]
fn it_tells_its_calibration_as_its_model_does() {
    for (model, length) in [(Model::M1414, 322), (Model::M1473, 334), (Model::Windows, 334)] {
        let mut host = Host::new(model, "", None);
        assert_eq!(host.tell(code::MODE_PARAMETERS, &[0x41, 0, 1, 0x1e, 0]).len(), 8);
        assert_eq!(host.tell(code::MODE_PARAMETERS, &[0x40, 0, 1, 0x1e, 0]).len(), 118);
        let (fixed, shift) = (host.tell(code::FIXED_PARAMETERS, &[0]), host.tell(code::MODE_PARAMETERS, &[0, 0, 1, 0x1e, 0]));
        assert_eq!((fixed.len(), shift.len()), (length, 4));
        assert_eq!(ZeroPlane::parse(&fixed, &shift), Some(zero_plane()));
    }
}

#[test]
fn registers_are_read_as_they_were_written() {
    let mut host = Host::new(Model::M1414, "", None);
    host.write(&[(0x17, 1)]);
    assert_eq!(host.tell(code::READ_REGISTER, &[0x17]), [0, 0, 1, 0]);
    assert_eq!(host.tell(code::CMOS, &[1, 0x8238, 0x0440]), [0, 0, 0x38, 0xc2, 0x40, 0x04], "as one real Kinect answered");
    assert_eq!(host.tell(code::CMOS, &[1, 0x0238, 0]), [0, 0, 0x38, 0x42, 0x40, 0x04]);
    let polls: Vec<usize> = (0..4).map(|_| host.ask(code::READ_REGISTER, &[0x17]).unwrap().1).collect();
    assert!(polls.iter().any(|polls| *polls > 0), "no client may count on a reply at the first poll: {polls:?}");
    assert_eq!(host.poll(), Ok(Vec::new()), "nothing waits");
}

#[test]
fn what_is_no_command_stalls() {
    let mut host = Host::new(Model::M1414, "", None);
    for bytes in
        [&[][..], &[0x47, 0x4d], &[0x47, 0x4d, 1, 0, 2, 0, 1, 0], &[0x52, 0x42, 0, 0, 4, 0, 1, 0], &[0x47, 0x4d, 0, 0, 0x77, 0, 1, 0]]
    {
        assert_eq!(host.send(bytes), Err(Stall), "{bytes:02x?}");
    }
    assert_eq!(host.ask(code::MODE_PARAMETERS, &[0x99]), Err(Stall));
    assert_eq!(host.camera.control(Setup { request_type: 0xc0, request: 9, value: 0, index: 0, length: 9 }, &[], 0), Err(Stall));
}

#[test]
fn replies_are_wrong_as_told() {
    type Check = fn(Result<Reply<'_>, CommandError>) -> bool;
    let cases: [(&str, Check); 6] = [
        ("tag:1", |reply| reply == Err(CommandError::Tag(10))),
        ("command:1", |reply| reply == Err(CommandError::Command(5))),
        ("magic:1", |reply| matches!(reply, Err(CommandError::Magic(_)))),
        ("short:1", |reply| matches!(reply, Err(CommandError::Length { .. }))),
        ("cut:1", |reply| reply.is_ok_and(|reply| reply.payload.len() == 160)),
        ("status:1", |reply| reply.is_ok_and(|reply| reply.status == 5)),
    ];
    for (wrong, check) in cases {
        let mut host = Host::new(Model::M1414, "", Some(wrong));
        host.write(&START[..1]);
        let (bytes, _) = host.ask(code::FIXED_PARAMETERS, &[0]).unwrap();
        let sent = Command { command: code::FIXED_PARAMETERS, tag: host.tag, payload: &[] };
        let reply = Reply::parse(&bytes).and_then(|reply| reply.to(&sent));
        assert!(check(reply), "{wrong}: {reply:?}");
    }
    assert_eq!(Host::new(Model::M1414, "", Some("never")).ask(code::FIXED_PARAMETERS, &[0]), Ok((Vec::new(), 200)));
    assert_eq!(Host::new(Model::M1414, "", Some("late")).ask(code::FIXED_PARAMETERS, &[0]).map(|(_, polls)| polls), Ok(100));
    assert_eq!(Host::new(Model::M1414, "", Some("stall")).ask(code::FIXED_PARAMETERS, &[0]), Err(Stall));
}

#[test]
fn its_descriptors_are_those_of_a_real_unit() {
    let mut host = Host::new(Model::M1414, "", None);
    let mut get = |value, length| {
        let setup = Setup { request_type: 0x80, request: 6, value, index: 0, length };
        host.camera.control(setup, &[], 0)
    };
    assert_eq!(get(0x100, 18).unwrap(), [18, 1, 0, 2, 0, 0, 0, 64, 0x5e, 4, 0xae, 2, 0x0b, 1, 1, 2, 3, 1]);
    let [video, depth] = [0x81, 0x82].map(|address| [7, 5, address, 1, 0xc0, 0x0b, 1]);
    let interface = [9, 4, 0, 0, 2, 0xff, 0xff, 0xff, 0];
    let all = [&[9, 2, 32, 0, 1, 1, 0, 0xc0, 8][..], &interface, &video, &depth].concat();
    assert_eq!(get(0x200, 255), Ok(all.clone()));
    assert_eq!(get(0x200, 9), Ok(all[..9].into()));
    assert_eq!(get(0x303, 255).unwrap(), [6, 3, b'V', 0, b'1', 0]);
    assert_eq!(get(0x304, 255), Err(Stall));
    assert_eq!(get(0x0600, 10), Err(Stall), "a high-speed device alone");
}
