//! The dialogue with a camera that answers as it should, and with cameras that don't.

use std::collections::VecDeque;

use physinc::kinect::calibration::ZeroPlane;
use physinc::kinect::command::{Command, CommandError, REPLY_SIZE, Reply, code};
use physinc::kinect::disparity::Packing;
use physinc::kinect::model::Model;
use physinc::kinect::session::{Control, MOST_POLLS, Session, SessionError, Trouble};
use physinc::kinect::video::Video;

const PLANE: ZeroPlane = ZeroPlane { emitter_cm: 7.5, rcmos_cm: 2.3, reference_cm: 120.0, pixel_cm: 0.1042, shift: 200 };

/// What becomes of a reply.
type Bend = fn(&Command<'_>, &mut Vec<u8>);

/// Answers each command after two empty polls.
struct Scripted {
    bytes_of_fixed_parameters: usize,
    bend: Bend,
    replies: VecDeque<Vec<u8>>,
    registers: Vec<(u16, u16)>,
    polls: usize,
}

impl Scripted {
    fn new(bend: Bend) -> Self {
        Self { bytes_of_fixed_parameters: 322, bend, replies: VecDeque::new(), registers: Vec::new(), polls: 0 }
    }

    fn answer(&mut self, command: &Command<'_>) -> Vec<u8> {
        let (fixed_parameters, shift) = PLANE.replies();
        let word = |at: usize| u16::from_le_bytes([command.payload[at], command.payload[at + 1]]);
        match (command.command, word(0)) {
            (code::FIXED_PARAMETERS, 0) => {
                let mut payload = fixed_parameters.to_vec();
                payload.resize(self.bytes_of_fixed_parameters - 2, 0);
                payload
            }
            (code::MODE_PARAMETERS, 0x41) => vec![0x41; 6],
            (code::MODE_PARAMETERS, 0x40) => vec![0x40; 116],
            (code::MODE_PARAMETERS, 0) => shift.to_vec(),
            (code::WRITE_REGISTER, register) => {
                self.registers.push((register, word(2)));
                Vec::new()
            }
            other => panic!("nobody asked for {other:x?}"),
        }
    }
}

impl Control for &mut Scripted {
    type Error = &'static str;

    fn send(&mut self, command: &[u8]) -> Result<(), Self::Error> {
        let command = Command::parse(command).expect("a command");
        let payload = self.answer(&command);
        let mut reply = vec![0; REPLY_SIZE];
        let length = Reply { command: command.command, tag: command.tag, status: 0, payload: &payload }.emit(&mut reply).expect("room");
        reply.truncate(length);
        (self.bend)(&command, &mut reply);
        self.replies.extend([vec![], vec![0; REPLY_SIZE], reply]);
        Ok(())
    }

    fn poll(&mut self, reply: &mut [u8; REPLY_SIZE]) -> Result<usize, Self::Error> {
        self.polls += 1;
        let next = self.replies.pop_front().unwrap_or_default();
        reply[..next.len()].copy_from_slice(&next);
        if next == b"unplugged" { Err("no such device") } else { Ok(next.len()) }
    }

    fn pause(&mut self) {}
}

fn open(device: &mut Scripted, model: Model) -> Result<(), SessionError<&'static str>> {
    Session::open(device, model, 7).map(drop)
}

/// How opening fails, and what it says.
fn failure(bend: Bend) -> (Trouble<&'static str>, String) {
    let error = open(&mut Scripted::new(bend), Model::M1414).expect_err("it can't be opened");
    (error.trouble, error.to_string())
}

#[test]
fn opening_reads_the_calibration_and_streams_are_started_by_their_registers() {
    let mut device = Scripted::new(|_, _| ());
    let (mut session, calibration) = Session::open(&mut device, Model::M1414, u16::MAX).expect("it answers");
    assert_eq!(calibration.zero_plane, Some(PLANE));
    assert_eq!(
        (calibration.padding, calibration.registration[2..].to_vec()),
        ([0, 0, 0x41, 0x41, 0x41, 0x41, 0x41, 0x41], vec![0x40; 116])
    );
    session.start_depth(Packing::Eleven).expect("it answers");
    session.start_video(Video::Color).expect("it answers");
    session.start_video(Video::Infrared).expect("it answers");
    session.stop().expect("it answers");
    let depth = [(0x105, 0), (6, 0), (0x12, 3), (0x13, 1), (0x14, 30), (6, 2), (0x17, 0)];
    let color = [(0x0c, 0), (0x0d, 1), (0x0e, 30), (5, 1), (0x47, 0)];
    let infrared = [(0x19, 0), (0x1a, 1), (0x1b, 30), (0x105, 0), (5, 3), (0x48, 0)];
    assert_eq!(device.registers, [&depth[..], &color, &infrared, &[(6, 0), (5, 0)]].concat());
}

#[test]
fn a_later_model_has_a_longer_block() {
    let mut device = Scripted::new(|_, _| ());
    let short = open(&mut device, Model::M1473).expect_err("322 bytes").trouble;
    assert_eq!(short, Trouble::Short { bytes: 322, expected: 334 });
    device.bytes_of_fixed_parameters = 334;
    assert_eq!(open(&mut device, Model::M1473), Ok(()));
}

#[test]
fn what_an_earlier_session_left_is_passed_over() {
    let mut device = Scripted::new(|command, reply| {
        // Its reply comes only now, before ours.
        if command.tag == 7 {
            reply[6] = 200;
        }
    });
    let stale = |tag| vec![0x52, 0x42, 1, 0, 3, 0, tag, 0, 0, 0];
    device.replies.extend([stale(7), stale(9)]);
    assert!(matches!(open(&mut device, Model::M1414), Err(SessionError { command: 0x16, argument: 0x41, trouble: Trouble::Silent })));
    device.bend = |_, _| ();
    device.replies.extend([stale(7), stale(9)]);
    assert_eq!(open(&mut device, Model::M1414), Ok(()));
}

#[test]
fn wrong_replies_are_errors_that_name_command_and_evidence() {
    let (trouble, text) = failure(|_, reply| reply[1] = 0x43);
    assert_eq!(trouble, Trouble::Malformed(CommandError::Magic(0x4352)));
    assert_eq!(text, "command 0x16 (0x41): control message begins with 0x4352");
    let tag: Bend = |command, reply| reply[6] += u8::from(command.command == code::FIXED_PARAMETERS);
    assert_eq!(failure(tag).0, Trouble::Malformed(CommandError::Tag(9)), "once in step, another tag is an error");
    let (trouble, text) = failure(|_, reply| reply[4] = 3);
    assert_eq!(
        (trouble, text.as_str()),
        (Trouble::Malformed(CommandError::Command(3)), "command 0x16 (0x41): reply to another command, 0x03")
    );
    assert_eq!(failure(|_, reply| reply[8] = 1).1, "command 0x16 (0x41): refused, status 0x0001");
    assert_eq!(failure(|_, reply| reply.truncate(5)).0, Trouble::Malformed(CommandError::Short));
    assert_eq!(failure(|_, reply| reply.truncate(10)).0, Trouble::Malformed(CommandError::Length { claimed: 8, actual: 2 }));
    let (trouble, text) = failure(|_, reply| {
        reply.truncate(12);
        reply[2] = 2;
    });
    assert_eq!(trouble, Trouble::Short { bytes: 4, expected: 8 });
    assert_eq!(text, "command 0x16 (0x41): a reply of 4 bytes where 8 are expected");
    assert_eq!(failure(|_, reply| *reply = b"unplugged".to_vec()).1, "command 0x16 (0x41): no such device");
}

#[test]
fn a_device_that_never_replies_is_given_up() {
    let mut device = Scripted::new(|_, reply| reply.clear());
    let error = open(&mut device, Model::M1414).expect_err("silent");
    assert_eq!(error.to_string(), format!("command 0x16 (0x41): no reply to {MOST_POLLS} polls"));
    assert!(device.polls <= MOST_POLLS + 1);
    // One that talks without end is no better.
    let mut device = Scripted::new(|_, _| ());
    device.replies.extend(std::iter::repeat_n(vec![1; 20], 10_000));
    assert!(matches!(open(&mut device, Model::M1414), Err(SessionError { trouble: Trouble::Malformed(_), .. })));
}
