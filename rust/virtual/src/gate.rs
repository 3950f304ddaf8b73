//! A file on which `poll` sleeps as on a usbfs node: writable when a transfer is complete, broken when the device is gone.
//!
//! It is a terminal whose output is stopped and let go: what a kernel does to its readiness is what usbfs would do.

use rustix::fs::{self, Mode, OFlags};
use rustix::pty::{self, OpenptFlags};
use rustix::termios::{self, Action};
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};

/// Both ends of it. Where they are dropped, whoever polls sees an error and a hang-up.
pub struct Gate {
    terminal: File,
    is_open: bool,
    path: PathBuf,
    _master: rustix::fd::OwnedFd,
}

impl Gate {
    /// Closed.
    pub fn new() -> io::Result<Self> {
        let master = pty::openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC)?;
        pty::grantpt(&master)?;
        pty::unlockpt(&master)?;
        let path = pty::ptsname(&master, Vec::new())?.into_string().map_err(io::Error::other)?;
        let terminal = fs::open(&path, OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC, Mode::empty())?;
        let mut gate = Self { terminal: terminal.into(), is_open: true, path: path.into(), _master: master };
        gate.set(false);
        Ok(gate)
    }

    /// What programs open.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Opens or closes it.
    pub fn set(&mut self, is_open: bool) {
        if is_open != self.is_open {
            self.is_open = is_open;
            // A terminal that can't be stopped would only make programs ask too often.
            let _ = termios::tcflow(&self.terminal, if is_open { Action::OOn } else { Action::OOff });
        }
    }
}
