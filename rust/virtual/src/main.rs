//! Runs a program beside a Kinect that isn't there.
//!
//! `virtual-kinect [SCENE|CAPTURE] [OPTIONS] -- COMMAND ARGS`: the command sees a Kinect's devices through libusb, lsusb, or whatever
//! else looks at `/sys` and `/dev` by way of libc, since umockdev's preloaded library shows it a folder of ours instead.

mod bus;
mod gate;
mod hotplug;
mod nature;
mod node;
mod options;
mod preload;
mod queue;
mod server;
mod testbed;
mod urb;
mod usbfs;
mod vhci;

use rustix::thread::CapabilitySet;
use std::env;
use std::ffi::OsString;
use std::io::{BufRead, BufReader};
use std::os::unix::process::CommandExt;
use std::process::{Command, ExitCode, Stdio};

const PRELOAD: &str = "libumockdev-preload.so.0";

fn main() -> ExitCode {
    let arguments: Vec<OsString> = env::args_os().skip(1).collect();
    let result = match arguments.split_first() {
        Some((first, rest)) if first == "--serve" => server::serve(rest),
        _ => run(&arguments),
    };
    result.map_or_else(
        |what| {
            eprintln!("virtual-kinect: {what}");
            ExitCode::from(2)
        },
        |()| ExitCode::SUCCESS,
    )
}

/// Starts the server, then becomes the command, so that signals, exit code and process number are the command's own.
fn run(arguments: &[OsString]) -> Result<(), String> {
    let Some(dashes) = arguments.iter().position(|argument| argument == "--") else { return Err(options::USAGE.into()) };
    let (options, command) = (&arguments[..dashes], &arguments[dashes + 1..]);
    let Some((program, rest)) = command.split_first() else { return Err(options::USAGE.into()) };
    let own = env::current_exe().map_err(|error| format!("its own file can't be found: {error}"))?;
    let mut server = Command::new(own);
    // Ctrl-C is the command's business.
    server.arg("--serve").args(options).process_group(0).stdin(Stdio::null()).stdout(Stdio::piped());
    let mut server = server.spawn().map_err(|error| format!("its server does not start: {error}"))?;
    let mut root = String::new();
    if let Some(stdout) = server.stdout.take() {
        BufReader::new(stdout).read_line(&mut root).map_err(|error| format!("its server does not answer: {error}"))?;
    }
    if root.is_empty() {
        return Err("its server ended".into());
    }
    let parsed = options::Options::parse(options)?;
    if parsed.is_kernels {
        return Err(format!("{}: {}", program.display(), Command::new(program).args(rest).exec()));
    }
    let mut preload = OsString::from(PRELOAD);
    if let Some(others) = env::var_os("LD_PRELOAD") {
        preload.push(":");
        preload.push(others);
    }
    let mut command = Command::new(program);
    command.args(rest).env("UMOCKDEV_DIR", root.trim_end()).env("LD_PRELOAD", preload);
    if parsed.is_denied && rustix::process::geteuid().is_root() {
        // Nothing is denied to a root that may override modes.
        for capability in [CapabilitySet::DAC_OVERRIDE, CapabilitySet::DAC_READ_SEARCH] {
            let removed = rustix::thread::remove_capability_from_bounding_set(capability);
            removed.map_err(|error| format!("root can't be denied anything: {error}"))?;
        }
    }
    Err(format!("{}: {}", program.display(), command.exec()))
}
