//! A folder of images and the index that names them.

use super::SourceError;
use super::order::Order;
use crate::geometry::camera::Camera;
use std::format;
use std::fs::File;
use std::io::{BufRead, BufReader, ErrorKind, Read};
use std::path::{Component, Path, PathBuf};
use std::string::{String, ToString};
use std::vec::Vec;

/// The longest line that is read; a longer one names no file.
const LONGEST_LINE: u64 = 1 << 13;

/// Reads an index line by line, and opens what it names.
pub(super) struct Index {
    name: String,
    folder: PathBuf,
    file: &'static str,
    lines: BufReader<File>,
    number: u64,
    found: bool,
    order: Order,
}

impl Index {
    /// The index `file` of `folder`.
    pub(super) fn open(folder: &Path, file: &'static str) -> Result<Self, SourceError> {
        let name = folder.display().to_string();
        let lines = File::open(folder.join(file)).map_err(|error| SourceError::unreadable(&name, error))?;
        Ok(Self { name, folder: folder.into(), file, lines: BufReader::new(lines), number: 0, found: false, order: Order::default() })
    }

    /// The folder, as the user named it.
    pub(super) fn name(&self) -> &str {
        &self.name
    }

    /// The next line, without the space around it; `None` at the end.
    pub(super) fn next_line(&mut self) -> Result<Option<String>, SourceError> {
        self.number += 1;
        let mut line = Vec::new();
        let read = (&mut self.lines).take(LONGEST_LINE).read_until(b'\n', &mut line);
        let length = read.map_err(|error| self.malformed(format!("it can't be read ({error})")))?;
        if length as u64 == LONGEST_LINE {
            return Err(self.malformed("a line of more than 8 KiB; names of images are expected"));
        }
        match String::from_utf8(line) {
            Ok(line) => {
                let line = if self.number == 1 { line.trim_start_matches('\u{feff}') } else { &line };
                Ok((length > 0).then(|| line.trim().into()))
            }
            Err(_) => Err(self.malformed("not text; names of images are expected")),
        }
    }

    /// The line that was read last is of an image that was taken at `timestamp_ns`.
    pub(super) fn see(&mut self, timestamp_ns: i64) {
        self.order.see(timestamp_ns, self.number);
    }

    /// What the user should know of it so far, a line each.
    pub(super) fn remarks(&self) -> Vec<String> {
        self.order.remark().map(|what| format!("{}: {what}", self.file)).into_iter().collect()
    }

    /// What is wrong with the line that was read last.
    pub(super) fn malformed(&self, what: impl std::fmt::Display) -> SourceError {
        SourceError::malformed(&self.name, format!("{}, line {}: {what}", self.file, self.number))
    }

    /// Opens the image `name`, which must be a file inside the folder. `None` where it is missing: a frame that is lost, as its time will
    /// tell, unless the first one is, as in a folder whose images are elsewhere.
    pub(super) fn image(&mut self, name: &str) -> Result<Option<BufReader<File>>, SourceError> {
        let path = Path::new(name);
        if !path.components().all(|part| matches!(part, Component::Normal(_) | Component::CurDir)) {
            return Err(self.malformed(format!("{name:?} leaves the folder: only images inside it are read")));
        }
        let path = self.folder.join(path);
        let kind = match std::fs::metadata(&path) {
            Err(error) if error.kind() == ErrorKind::NotFound && self.found => return Ok(None),
            Err(error) => return Err(self.malformed(format!("{name:?} is missing ({error}); take its line out to begin without it"))),
            Ok(kind) => kind,
        };
        // What is no file, a pipe perhaps, may never open.
        if !kind.is_file() {
            return Err(self.malformed(format!("{name:?} is no file")));
        }
        self.found = true;
        let image = File::open(&path).map_err(|error| self.malformed(format!("{name:?} can't be read ({error})")))?;
        Ok(Some(BufReader::new(image)))
    }
}

/// An error where an image is not of the camera's size.
pub(super) fn check_size(camera: &Camera, [width, height]: [u64; 2]) -> Result<(), String> {
    if [width, height] == [camera.width as u64, camera.height as u64] {
        return Ok(());
    }
    Err(format!(
        "it is {width}×{height} px, the camera is {}×{}: tell width, height, fx, fy, cx, cy in camera.toml or by --camera FILE",
        camera.width, camera.height
    ))
}
