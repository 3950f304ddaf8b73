//! Frames of any source into a file or folder that is a source itself.

use super::fakenect::FakenectFolder;
use super::npz_record::NpzFile;
use super::tum::TumFolder;
use super::{Input, Source, SourceError};
use crate::geometry::camera::Camera;
use crate::seeing::Image;
use std::boxed::Box;
use std::format;
use std::io;
use std::path::{Path, PathBuf};
use std::string::String;

/// Why a recording can't be made, or broke off.
#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    /// The source can't be opened, or broke.
    #[error(transparent)]
    Source(#[from] SourceError),
    /// Nothing will be written there.
    #[error("{}: {why}", out.display())]
    Refused {
        /// What the user named.
        out: PathBuf,
        /// Why not, and what to do.
        why: String,
    },
    /// The operating system refuses, or the format can't hold a frame.
    #[error("{}: {error}", out.display())]
    Write {
        /// What the user named.
        out: PathBuf,
        /// What is wrong.
        error: io::Error,
    },
}

/// What is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Format {
    Npz,
    Fakenect,
    Tum,
}

/// Where frames go. What was handed over stays readable in a folder, whatever happens next.
pub(super) trait Sink: Send {
    /// Writes a frame of the camera's size.
    fn write(&mut self, timestamp_ns: i64, samples: &[u16]) -> io::Result<()>;

    /// After the last frame.
    fn finish(&mut self) -> io::Result<()>;
}

/// A source that is being recorded, frame by frame, with `camera.toml` beside it. One frame is in memory at a time.
pub struct Recording {
    source: Box<dyn Source>,
    camera: Camera,
    out: PathBuf,
    format: Format,
    /// Made for the first frame: of a source without frames nothing is left behind.
    sink: Option<Box<dyn Sink>>,
    frames: u64,
    limit: Option<u64>,
}

impl Recording {
    /// Will record at most `limit` frames of `source` in `out`: a `*.npz`, or a folder, in fakenect's layout or, with `tum`, in TUM's.
    ///
    /// # Errors
    /// A source of positions, an `out` that holds something already, or a format that can't be written.
    pub fn new(source: Box<dyn Source>, out: &Path, tum: bool, limit: Option<u64>) -> Result<Self, RecordError> {
        let refused = |why: &str| RecordError::Refused { out: out.into(), why: why.into() };
        let Some(camera) = source.camera() else {
            return Err(refused(&format!("{} delivers positions; only frames are recorded", source.name())));
        };
        let format = if tum { Format::Tum } else { Format::Fakenect };
        let format = format_of(out, format).map_err(refused)?;
        let is_free = match format {
            Format::Npz => std::fs::metadata(out).map_or(true, |file| file.is_file() && file.len() == 0) && !beside(out).exists(),
            _ => !out.exists() || std::fs::read_dir(out).is_ok_and(|mut folder| folder.next().is_none()),
        };
        if !is_free {
            return Err(refused("there is something already, which is never overwritten: name a new file or an empty folder"));
        }
        Ok(Self { source, camera, out: out.into(), format, sink: None, frames: 0, limit })
    }

    /// Records the next frame: how many there are now, and its stamp. `None` at the end.
    ///
    /// # Errors
    /// The source broke or has no frames, or a frame can't be written.
    pub fn next_frame(&mut self) -> Result<Option<(u64, i64)>, RecordError> {
        if self.limit.is_some_and(|limit| self.frames >= limit) {
            return Ok(None);
        }
        let failed = |error| RecordError::Write { out: self.out.clone(), error };
        let (timestamp_ns, samples) = match self.source.next_input()? {
            Some(Input::Frame { timestamp_ns, image: Image::U16(samples) }) => (timestamp_ns, samples),
            Some(_) => return Err(failed(io::Error::other("only frames of 16-bit samples can be recorded"))),
            None if self.frames == 0 => return Err(SourceError::Empty { source_name: self.source.name().into() }.into()),
            None => return Ok(None),
        };
        if self.sink.is_none() {
            self.sink = Some(create(self.format, &self.out, &self.camera).map_err(failed)?);
        }
        if let Some(sink) = &mut self.sink {
            sink.write(timestamp_ns, samples).map_err(failed)?;
        }
        self.frames += 1;
        Ok(Some((self.frames, timestamp_ns)))
    }

    /// Completes what was recorded. An npz is nothing before; a folder is complete after each frame.
    ///
    /// # Errors
    /// It can't be written.
    pub fn finish(mut self) -> Result<(), RecordError> {
        self.sink.as_mut().map_or(Ok(()), |sink| sink.finish()).map_err(|error| RecordError::Write { out: self.out, error })
    }
}

fn format_of(out: &Path, folder: Format) -> Result<Format, &'static str> {
    let name = out.file_name().map(|name| name.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
    let plain = [".gz", ".zst"].iter().find_map(|packed| name.strip_suffix(packed)).unwrap_or(&name);
    match plain.rsplit_once('.').map(|(_, extension)| extension) {
        Some("pcapng" | "pcap") => Err("captures hold packets, which this version doesn't record: name FILE.npz or a folder"),
        Some("npz") if folder == Format::Tum => Err("--tum is the layout of a folder, and this is an npz"),
        Some("npz") => Ok(Format::Npz),
        _ => Ok(folder),
    }
}

/// The camera file of `OUT.npz`.
fn beside(out: &Path) -> PathBuf {
    out.with_extension("camera.toml")
}

fn create(format: Format, out: &Path, camera: &Camera) -> io::Result<Box<dyn Sink>> {
    let write_camera = |path: &Path, camera: &Camera| {
        let keys = toml::to_string(&camera.to_config()).map_err(io::Error::other)?;
        std::fs::write(path, keys)
    };
    if format == Format::Npz {
        let file = NpzFile::create(out, camera)?;
        write_camera(&beside(out), &file.camera())?;
        return Ok(Box::new(file));
    }
    std::fs::create_dir_all(out)?;
    write_camera(&out.join("camera.toml"), camera)?;
    Ok(if format == Format::Tum { Box::new(TumFolder::create(out, camera)?) } else { Box::new(FakenectFolder::create(out, camera)?) })
}
