//! What the virtual Kinect is to be.

use crate::queue::Pace;
use physinc::sim::kinect::{Faults, Misbehaviour, Model};
use rustix::io::Errno;
use std::ffi::OsString;
use std::path::PathBuf;
use std::time::Duration;

/// How it is called.
pub const USAGE: &str = "usage: virtual-kinect [sim:SCENE | CAPTURE] [OPTIONS] -- COMMAND ARGS
  --model 1414|1473|k4w      which Kinect
  --count N                  so many of them
  --without PART,…           of camera, motor, audio
  --empty, --no-bus          a bus without devices, no bus at all
  --realtime                 packets come whether the command takes them or not
  --usbip                    attached to the kernel's vhci_hcd, for root; packets come no faster than USB's
  --faults KEY=VALUE&…       lose, burst, zero, short, double, foreign, error, silence (s), begin, from (frame), seed
  --reply WRONG[:FROM]       tag, command, magic, short, cut, status, never, late, stall; from which reply on
  --unplug AT[:S[:TIMES]]    after frame:N or command:N; back S seconds later, and again, so many times
  --busy, --driver NAME      another program, or that driver of the kernel, has the camera
  --denied                   the command must not open any device, even as root
  --refuse ENOMEM|ENOSPC[:N] transfers, from the Nth on
  --truth FILE               a line of JSON for each frame that was sent";

/// When it is pulled.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Moment {
    /// After so many frames since it was plugged in.
    Frames(u64),
    /// At this control request to the camera since then.
    Requests(u64),
}

/// It is pulled, and perhaps plugged in again.
#[derive(Clone, Copy, Debug)]
pub struct Unplug {
    /// When.
    pub at: Moment,
    /// For how long; for ever where it is `None`.
    pub back: Option<Duration>,
    /// How often.
    pub times: u64,
}

/// As told on the command line.
#[derive(Clone, Debug)]
#[allow(missing_docs, clippy::struct_excessive_bools)] // As USAGE says.
pub struct Options {
    pub view: String,
    pub model: Model,
    pub count: u8,
    pub without: Vec<String>,
    pub has_devices: bool,
    pub has_bus: bool,
    pub is_kernels: bool,
    pub pace: Pace,
    pub faults: Faults,
    pub reply: Option<Misbehaviour>,
    pub unplug: Option<Unplug>,
    pub is_busy: bool,
    pub driver: Option<String>,
    pub is_denied: bool,
    pub refuse: Option<(Errno, u64)>,
    pub truth: Option<PathBuf>,
}

impl Options {
    /// # Errors
    /// What is wrong, in one line.
    pub fn parse(arguments: &[OsString]) -> Result<Self, String> {
        let mut options = Self {
            view: "sim:bounce".into(),
            model: Model::M1414,
            count: 1,
            without: Vec::new(),
            has_devices: true,
            has_bus: true,
            is_kernels: false,
            pace: Pace::Client,
            faults: Faults::default(),
            reply: None,
            unplug: None,
            is_busy: false,
            driver: None,
            is_denied: false,
            refuse: None,
            truth: None,
        };
        let mut arguments = arguments.iter();
        while let Some(argument) = arguments.next() {
            let name = argument.to_str().ok_or("options must be UTF-8")?;
            let mut value = || {
                let value = arguments.next().and_then(|value| value.to_str());
                value.ok_or_else(|| format!("{name} needs a value\n{USAGE}"))
            };
            match name {
                "--model" => options.model = model(value()?)?,
                "--count" => options.count = number(value()?)?,
                "--without" => options.without = value()?.split(',').map(String::from).collect(),
                "--empty" => options.has_devices = false,
                "--no-bus" => options.has_bus = false,
                "--realtime" => options.pace = Pace::Real,
                "--usbip" => (options.is_kernels, options.pace) = (true, Pace::Bus),
                "--faults" => options.faults = Faults::parse(value()?)?,
                "--reply" => options.reply = Some(Misbehaviour::parse(value()?)?),
                "--unplug" => options.unplug = Some(unplug(value()?)?),
                "--busy" => options.is_busy = true,
                "--driver" => options.driver = Some(value()?.into()),
                "--denied" => options.is_denied = true,
                "--refuse" => options.refuse = Some(refuse(value()?)?),
                "--truth" => options.truth = Some(value()?.into()),
                _ if name.starts_with('-') => return Err(format!("no option {name}\n{USAGE}")),
                _ => options.view = name.into(),
            }
        }
        Ok(options)
    }
}

fn number<T: std::str::FromStr>(text: &str) -> Result<T, String> {
    text.parse().map_err(|_| format!("{text}: another number is expected"))
}

fn model(text: &str) -> Result<Model, String> {
    match text {
        "1414" => Ok(Model::M1414),
        "1473" => Ok(Model::M1473),
        "k4w" => Ok(Model::Windows),
        _ => Err(format!("no model {text}: 1414, 1473, k4w")),
    }
}

fn refuse(text: &str) -> Result<(Errno, u64), String> {
    let (name, from) = text.split_once(':').unwrap_or((text, "0"));
    let errno = match name {
        "ENOMEM" => Errno::NOMEM,
        "ENOSPC" => Errno::NOSPC,
        _ => return Err(format!("{name}: ENOMEM or ENOSPC is expected")),
    };
    Ok((errno, number(from)?))
}

fn unplug(text: &str) -> Result<Unplug, String> {
    let mut parts = text.split(':');
    let (kind, at) = (parts.next().unwrap_or_default(), number(parts.next().unwrap_or_default())?);
    let at = match kind {
        "frame" => Moment::Frames(at),
        "command" => Moment::Requests(at),
        _ => return Err(format!("{text}: frame:N or command:N is expected")),
    };
    let back = parts.next().map(number).transpose()?;
    let back = back.map(|s| Duration::try_from_secs_f64(s).map_err(|_| format!("{text}: seconds are expected"))).transpose()?;
    Ok(Unplug { at, back, times: parts.next().map_or(Ok(1), number)? })
}
