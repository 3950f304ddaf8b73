//! What the virtual Kinect is to be.

use std::ffi::OsString;
use std::path::PathBuf;

/// How it is called.
pub const USAGE: &str = "usage: virtual-kinect [sim:SCENE | CAPTURE] [--realtime] [--truth FILE] -- COMMAND ARGS";

/// As told on the command line.
#[derive(Debug, Default)]
pub struct Options {
    /// `sim:SCENE`, or the path of a capture.
    pub view: Option<String>,
    /// Packets come and go whether a program takes them or not.
    pub is_realtime: bool,
    /// Where to tell what was sent.
    pub truth: Option<PathBuf>,
}

impl Options {
    /// # Errors
    /// What is wrong, in one line.
    pub fn parse(arguments: &[OsString]) -> Result<Self, String> {
        let mut options = Self::default();
        let mut arguments = arguments.iter();
        while let Some(argument) = arguments.next() {
            let text = argument.to_str().ok_or("options must be UTF-8")?;
            let mut value = || arguments.next().ok_or_else(|| format!("{text} needs a value; {USAGE}"));
            match text {
                "--realtime" => options.is_realtime = true,
                "--truth" => options.truth = Some(value()?.into()),
                _ if text.starts_with('-') => return Err(format!("no option {text}; {USAGE}")),
                _ => options.view = Some(text.into()),
            }
        }
        Ok(options)
    }
}
