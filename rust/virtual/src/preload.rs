//! What umockdev's preloaded library asks of the socket that stands for a device node: the calls of a program on its open file.
//!
//! Three machine words a message: what, and two arguments. The answer to a call may first look into the program's memory and change it.

use std::io::{self, Read, Write};
use std::os::unix::net::UnixStream;

const IOCTL: u64 = 1;
const DONE: u64 = 3;
const READ_MEMORY: u64 = 5;
const WRITE_MEMORY: u64 = 6;
const READ: u64 = 7;
const WRITE: u64 = 8;

/// What a program called.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Call {
    /// Request and argument.
    Ioctl(u64, u64),
    /// Where to, and how many bytes.
    Read(u64, u64),
    /// Likewise; a usbfs node takes none.
    Write,
}

/// A program that has the node open.
pub struct Caller(UnixStream);

impl Caller {
    /// At the other end of `stream`.
    pub fn new(stream: UnixStream) -> Self {
        Self(stream)
    }

    /// What it calls next; `None` once it has closed the node.
    pub fn next_call(&mut self) -> io::Result<Option<Call>> {
        let mut words = [0; 24];
        match self.0.read_exact(&mut words) {
            Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => return Ok(None),
            other => other?,
        }
        let [what, first, second] = [0, 8, 16].map(|at| word(&words, at));
        match what {
            IOCTL => Ok(Some(Call::Ioctl(first, second))),
            READ => Ok(Some(Call::Read(first, second))),
            WRITE => Ok(Some(Call::Write)),
            _ => Err(io::Error::other(format!("libumockdev-preload says {what}, which version 0.17 does not"))),
        }
    }

    /// `length` bytes of its memory.
    pub fn read(&mut self, address: u64, length: usize) -> io::Result<Vec<u8>> {
        let mut bytes = vec![0; length];
        if length > 0 {
            self.say(READ_MEMORY, address, length as u64)?;
            self.0.read_exact(&mut bytes)?;
        }
        Ok(bytes)
    }

    /// Writes to its memory.
    pub fn write(&mut self, address: u64, bytes: &[u8]) -> io::Result<()> {
        if bytes.is_empty() {
            return Ok(());
        }
        self.say(WRITE_MEMORY, address, bytes.len() as u64)?;
        self.0.write_all(bytes)
    }

    /// Ends its call.
    pub fn done(&mut self, result: Result<i32, rustix::io::Errno>) -> io::Result<()> {
        let (value, errno) = match result {
            Ok(value) => (i64::from(value), 0),
            Err(errno) => (-1, errno.raw_os_error() as u64),
        };
        self.say(DONE, value as u64, errno)
    }

    fn say(&mut self, what: u64, first: u64, second: u64) -> io::Result<()> {
        self.0.write_all([what, first, second].map(u64::to_ne_bytes).as_flattened())
    }
}

/// The machine word at `at`; 0 beyond the end.
fn word(bytes: &[u8], at: usize) -> u64 {
    bytes.get(at..).and_then(<[u8]>::first_chunk).map_or(0, |word| u64::from_ne_bytes(*word))
}
