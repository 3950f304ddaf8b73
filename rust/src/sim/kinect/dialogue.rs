//! A camera that answers commands wrongly.

use crate::kinect::command::{HEADER, Reply};
use std::format;
use std::string::String;
use std::vec::Vec;

/// What is wrong with a reply.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wrong {
    /// Its tag is another's.
    Tag,
    /// It is to another command.
    Command,
    /// It begins with other bytes.
    Magic,
    /// Its last word is missing.
    Short,
    /// Its payload is cut to its half, and its header says so.
    Cut,
    /// Its status is not 0.
    Status,
    /// It never comes.
    Never,
    /// It comes when polled for the hundredth time.
    Late,
    /// Polling stalls.
    Stall,
}

/// Which replies are wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Misbehaviour {
    /// How.
    pub wrong: Wrong,
    /// Those from this number on, from 0.
    pub from: usize,
}

impl Misbehaviour {
    /// From `tag`, or from `tag:3`: replies from number 3 on.
    ///
    /// # Errors
    /// What is wrong with it, in one line.
    pub fn parse(text: &str) -> Result<Self, String> {
        let (name, from) = text.split_once(':').unwrap_or((text, "0"));
        let wrong = match name {
            "tag" => Wrong::Tag,
            "command" => Wrong::Command,
            "magic" => Wrong::Magic,
            "short" => Wrong::Short,
            "cut" => Wrong::Cut,
            "status" => Wrong::Status,
            "never" => Wrong::Never,
            "late" => Wrong::Late,
            "stall" => Wrong::Stall,
            _ => return Err(format!("no such reply: {name}; there are tag, command, magic, short, cut, status, never, late, stall")),
        };
        let from = from.parse().map_err(|_| format!("{text}: the number of a reply is expected after the colon"))?;
        Ok(Self { wrong, from })
    }

    /// The bytes that come instead of `reply`'s, and after how many polls; `None` where they stall.
    pub(super) fn spoil(self, reply: &Reply, bytes: Vec<u8>, polls: u32) -> Option<(u32, Vec<u8>)> {
        let again = |reply: Reply| {
            let mut out = std::vec![0; bytes.len()];
            let length = reply.emit(&mut out).unwrap_or(0);
            out.truncate(length);
            out
        };
        let half = (bytes.len() - HEADER) / 4 * 2;
        Some(match self.wrong {
            Wrong::Tag => (polls, again(Reply { tag: reply.tag.wrapping_add(1), ..*reply })),
            Wrong::Command => (polls, again(Reply { command: reply.command ^ 1, ..*reply })),
            Wrong::Magic => (polls, [&[0x47, 0x4d], &bytes[2..]].concat()),
            Wrong::Short => (polls, bytes[..bytes.len() - 2].into()),
            Wrong::Cut => (polls, again(Reply { payload: &reply.payload[..half.min(reply.payload.len())], ..*reply })),
            Wrong::Status => (polls, again(Reply { status: 5, ..*reply })),
            Wrong::Never => (u32::MAX, bytes),
            Wrong::Late => (100, bytes),
            Wrong::Stall => return None,
        })
    }
}
