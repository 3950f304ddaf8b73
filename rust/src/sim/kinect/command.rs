//! The command port: takes a command, and has its reply ready some polls later.

use super::dialogue::Misbehaviour;
use super::registers::Registers;
use super::{Answer, Setup, Stall};
use crate::kinect::calibration::ZeroPlane;
use crate::kinect::command::{Command, REPLY_SIZE, Reply, code};
use std::collections::BTreeMap;
use std::vec::Vec;

/// bmRequestType of a command, and of a poll for its reply.
const OUT: u8 = 0x40;
const IN: u8 = 0xc0;
/// So many polls find nothing yet, by turns: how many are real is not known, so that none may be counted on.
const POLLS: [u32; 4] = [0, 1, 0, 3];
/// The parameter of the shift in command 0x16, that of the zero plane in command 0x04; others, and how many bytes each has after the
/// status word. What they mean is not needed: zeros.
const SHIFT: u16 = 0x00;
const ZERO_PLANE: u16 = 0x00;
const OTHERS: [(u16, u16, usize); 5] = [
    (code::MODE_PARAMETERS, 0x01, 2),
    (code::MODE_PARAMETERS, 0x40, 116),
    (code::MODE_PARAMETERS, 0x41, 6),
    (code::MODE_PARAMETERS, 0xc0, 12),
    (code::FIXED_PARAMETERS, 0x17, 228),
];
/// What the reply to command 0x04 has more from models other than 1414.
const LONGER: usize = 12;

/// The state of the port.
#[derive(Clone, Debug)]
pub struct Port {
    zero_plane: ZeroPlane,
    is_1414: bool,
    cmos: BTreeMap<u16, u16>,
    /// Polls to go, and the reply that waits.
    waiting: Option<(u32, Vec<u8>)>,
    taken: usize,
    misbehaviour: Option<Misbehaviour>,
    /// Polls stall.
    is_stalled: bool,
}

impl Port {
    pub(super) fn new(zero_plane: ZeroPlane, is_1414: bool, misbehaviour: Option<Misbehaviour>) -> Self {
        Self { zero_plane, is_1414, cmos: BTreeMap::new(), waiting: None, taken: 0, misbehaviour, is_stalled: false }
    }

    /// Nothing waits any more.
    pub(super) fn reset(&mut self) {
        self.waiting = None;
        self.is_stalled = false;
    }

    /// A command or a poll.
    pub(super) fn request(&mut self, setup: Setup, out: &[u8], registers: &mut Registers) -> Answer {
        match (setup.request_type, setup.request) {
            (OUT, 0) => {
                let command = Command::parse(out).map_err(|_| Stall)?;
                let payload = self.reply(&command, registers)?;
                let reply = Reply { command: command.command, tag: command.tag, status: 0, payload: &payload };
                let mut bytes = std::vec![0; REPLY_SIZE];
                let length = reply.emit(&mut bytes).map_err(|_| Stall)?;
                bytes.truncate(length);
                let polls = POLLS[self.taken % POLLS.len()];
                self.waiting = match self.misbehaviour.filter(|misbehaviour| self.taken >= misbehaviour.from) {
                    Some(misbehaviour) => misbehaviour.spoil(&reply, bytes, polls),
                    None => Some((polls, bytes)),
                };
                self.is_stalled = self.waiting.is_none();
                self.taken += 1;
                Ok(Vec::new())
            }
            (IN, 0) if self.is_stalled => Err(Stall),
            (IN, 0) => Ok(match &mut self.waiting {
                Some((polls @ 1.., _)) => {
                    *polls -= 1;
                    Vec::new()
                }
                waiting => waiting.take().map_or_else(Vec::new, |(_, reply)| reply),
            }),
            _ => Err(Stall),
        }
    }

    /// What follows the status word of the reply.
    fn reply(&mut self, command: &Command, registers: &mut Registers) -> Answer {
        let words: Vec<u16> = command.payload.as_chunks().0.iter().map(|word| u16::from_le_bytes(*word)).collect();
        match (command.command, &words[..]) {
            (code::READ_REGISTER, [register]) => Ok(registers.read(*register).to_le_bytes().into()),
            (code::WRITE_REGISTER, [register, value]) => {
                registers.write(*register, *value);
                Ok(Vec::new())
            }
            (code::FIXED_PARAMETERS, [ZERO_PLANE, ..]) => {
                let mut fixed = self.zero_plane.replies().0.to_vec();
                fixed.resize(fixed.len() + if self.is_1414 { 0 } else { LONGER }, 0);
                Ok(fixed)
            }
            (code::MODE_PARAMETERS, [SHIFT, ..]) => Ok(self.zero_plane.replies().1.into()),
            (code::CMOS, [_, pairs @ ..]) => Ok(self.cmos(pairs)),
            (number, [parameter, ..]) => {
                let told = OTHERS.iter().find(|(code, known, _)| (*code, *known) == (number, *parameter));
                told.map(|(_, _, length)| std::vec![0; *length]).ok_or(Stall)
            }
            _ => Err(Stall),
        }
    }

    /// Pairs of a register of the image sensor and its value; the highest bit of the register says that it is written.
    fn cmos(&mut self, pairs: &[u16]) -> Vec<u8> {
        let answers = pairs.as_chunks::<2>().0.iter().flat_map(|[register, value]| {
            let stored = self.cmos.entry(register & 0x3fff).or_default();
            if register & 0x8000 != 0 {
                *stored = *value;
            }
            [register | 0x4000, *stored]
        });
        answers.flat_map(u16::to_le_bytes).collect()
    }
}
