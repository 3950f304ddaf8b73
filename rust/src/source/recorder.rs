//! Packets or frames into a file or folder that is a source itself.

use super::fakenect::FakenectFolder;
use super::npz_record::{self, NpzFile};
use super::tum::TumFolder;
use super::{Input, Kinect, Source, SourceError, capture};
use crate::capture::{Output, Writer, occupied};
use crate::event::Counters;
use crate::geometry::camera::Camera;
use crate::kinect::disparity::{HEIGHT, WIDTH};
use crate::seeing::Image;
use crate::stream::assembler::Assembler;
use std::boxed::Box;
use std::format;
use std::io;
use std::path::{Path, PathBuf};
use std::string::{String, ToString};
use std::vec::Vec;

/// A live packet that comes this soon after another came in the same transfer, ns: a microframe, and what rounding may add.
const TOGETHER_NS: i64 = 130_000;

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
    #[error("{}: {}", out.display(), reason(error))]
    Write {
        /// What the user named.
        out: PathBuf,
        /// What is wrong.
        error: io::Error,
    },
}

fn reason(error: &io::Error) -> String {
    match error.kind() {
        io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded | io::ErrorKind::FileTooLarge => {
            format!(
                "there is no room for more ({error}); what was recorded until now can be read: free some space, or record to another disk"
            )
        }
        io::ErrorKind::NotFound => format!("{error}: make the folder first"),
        _ => error.to_string(),
    }
}

/// What is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Format {
    Capture,
    Npz,
    Fakenect,
    Tum,
}

/// Where frames go. What was handed over stays readable, in a folder up to the last frame, in a file up to the last second.
pub(super) trait Sink: Send {
    /// Writes a frame of the camera's size.
    fn write(&mut self, timestamp_ns: i64, samples: &[u16]) -> io::Result<()>;

    /// After the last frame.
    fn finish(&mut self) -> io::Result<()>;

    /// How much was written, bytes.
    fn bytes(&self) -> u64;
}

/// Writes what a source delivers, with `camera.toml` beside it. One frame is in memory at a time, of an npz a second of packed ones.
pub struct Recorder {
    camera: Camera,
    kinect: Option<Kinect>,
    out: PathBuf,
    format: Format,
    /// Made for the first packet.
    capture: Option<Writer<Output>>,
    /// When the newest packet arrived, and the first of its transfer.
    arrival_ns: (i64, i64),
    /// Made for the first frame: of a source without frames nothing is left behind.
    sink: Option<Box<dyn Sink>>,
    /// Of a source of packets; and its newest frame.
    assembler: Option<Assembler<Vec<u8>>>,
    samples: Vec<u16>,
    frames: u64,
    is_finished: bool,
}

impl Recorder {
    /// Will record what `source` delivers in `out`: a `*.npz`, a folder, in fakenect's layout or, with `tum`, in TUM's, or, of a
    /// source of packets, a `*.pcapng`, packed if its name goes on with `.gz` or `.zst`. In all but the last, lost samples are 2047.
    ///
    /// # Errors
    /// A source of positions, a capture of a source without packets, an `out` that holds something already, or a format that can't be written.
    pub fn new(source: &dyn Source, out: &Path, tum: bool) -> Result<Self, RecordError> {
        let refused_at = |out: &Path, why: &str| RecordError::Refused { out: out.into(), why: why.into() };
        let refused = |why: &str| refused_at(out, why);
        let Some(camera) = source.camera() else {
            return Err(refused(&format!("{} delivers positions; only frames are recorded", source.name())));
        };
        let format = if tum { Format::Tum } else { Format::Fakenect };
        let format = format_of(out, format).map_err(refused)?;
        let kinect = source.kinect();
        if format == Format::Capture && kinect.is_none() {
            return Err(refused(&format!("captures hold packets, and {} delivers frames: name FILE.npz or a folder", source.name())));
        }
        let found = match format {
            Format::Npz | Format::Capture => occupied([out.into(), beside(out), npz_record::journal(out)]),
            _ if std::fs::read_dir(out).is_ok_and(|mut folder| folder.next().is_none()) => None,
            _ => Some(out.into()).filter(|out: &PathBuf| out.exists()),
        };
        if let Some(found) = found {
            return Err(refused_at(&found, "there is something already, which is never overwritten: name a new file or an empty folder"));
        }
        let assembler = kinect.and_then(|Kinect { packing, .. }| Assembler::new(packing, std::vec![0; packing.frame_bytes()]).ok());
        let samples = if assembler.is_some() { std::vec![0; WIDTH * HEIGHT] } else { Vec::new() };
        let out = out.into();
        let (capture, sink, arrival_ns) = (None, None, (0, 0));
        Ok(Self { camera, kinect, out, format, capture, arrival_ns, sink, assembler, samples, frames: 0, is_finished: false })
    }

    /// Writes what came, unless it is finished; the stamp of the frame that this completes.
    ///
    /// # Errors
    /// It can't be written, or recorded at all.
    pub fn take(&mut self, input: &Input<'_>) -> Result<Option<i64>, RecordError> {
        let written = match *input {
            _ if self.is_finished => Ok(None),
            Input::Frame { timestamp_ns, image: Image::U16(samples) } => self.frame(timestamp_ns, samples).map(|()| Some(timestamp_ns)),
            Input::Packet { bytes, arrival_ns } => self.packet(bytes, arrival_ns),
            Input::Silence | Input::Disconnected(_) => Ok(None),
            Input::Reconnected(_) => {
                self.assembler.as_mut().map(Assembler::begin_anew);
                Ok(None)
            }
            Input::Frame { .. } | Input::Positions { .. } => {
                Err(io::Error::other("only packets, and frames of 16-bit samples, can be recorded"))
            }
        };
        let stamp = written.map_err(|error| self.failed(error))?;
        self.frames += u64::from(stamp.is_some());
        Ok(stamp)
    }

    fn packet(&mut self, bytes: &[u8], arrival_ns: i64) -> io::Result<Option<i64>> {
        if self.format == Format::Capture {
            let (newest, first) = self.arrival_ns;
            let is_together = (0..=TOGETHER_NS).contains(&arrival_ns.saturating_sub(newest));
            self.arrival_ns = (arrival_ns, if is_together { first } else { arrival_ns });
            if self.capture.is_none() {
                self.capture = Some(create_capture(&self.out, &self.camera, self.kinect, arrival_ns)?);
            }
            self.capture.as_mut().map_or(Ok(()), |capture| capture.packet(bytes, self.arrival_ns.1))?;
        }
        let mut ended = None;
        let Some(assembler) = &mut self.assembler else { return Ok(None) };
        assembler.push(bytes, arrival_ns, &mut |frame| {
            // Its size is the packing's.
            ended = frame.packing.unpack(frame.packed, &mut self.samples).is_ok().then_some(frame.timestamp_ns);
        });
        if let (Some(timestamp_ns), true) = (ended, self.format != Format::Capture) {
            let samples = core::mem::take(&mut self.samples);
            let written = self.frame(timestamp_ns, &samples);
            self.samples = samples;
            written?;
        }
        Ok(ended)
    }

    fn frame(&mut self, timestamp_ns: i64, samples: &[u16]) -> io::Result<()> {
        if self.sink.is_none() {
            self.sink = Some(create(self.format, &self.out, &self.camera)?);
        }
        self.sink.as_mut().map_or(Ok(()), |sink| sink.write(timestamp_ns, samples))
    }

    /// Frames recorded.
    pub fn frames(&self) -> u64 {
        self.frames
    }

    /// Frames, and what was lost of a source of packets.
    pub fn counters(&self) -> Counters {
        Counters { frames: self.frames, ..self.assembler.as_ref().map(Assembler::counters).unwrap_or_default() }
    }

    /// How much was written, bytes.
    pub fn bytes(&self) -> u64 {
        let file = || std::fs::metadata(&self.out).map_or(0, |file| file.len());
        self.sink.as_ref().map_or_else(file, |sink| sink.bytes())
    }

    /// Completes what was recorded, once. A folder is complete after each frame, a file up to the last second.
    ///
    /// # Errors
    /// It can't be written.
    pub fn finish(&mut self) -> Result<(), RecordError> {
        self.is_finished = true;
        let sink = self.sink.take().map_or(Ok(()), |mut sink| sink.finish());
        let capture = self.capture.take().map_or(Ok(()), Writer::close);
        sink.and(capture).map_err(|error| self.failed(error))
    }

    fn failed(&self, error: io::Error) -> RecordError {
        RecordError::Write { out: self.out.clone(), error }
    }
}

/// Suffixes of files that are no recordings: no folder is meant by them.
const OTHERS: [&str; 13] = ["7z", "bz2", "csv", "gz", "json", "pcap", "png", "toml", "tsv", "txt", "xz", "zip", "zst"];

fn format_of(out: &Path, folder: Format) -> Result<Format, &'static str> {
    let extension = |path: &Path| path.extension().map(|extension| extension.to_string_lossy().to_ascii_lowercase());
    let format = match (extension(out).as_deref(), extension(&capture::unpacked_name(out)).as_deref()) {
        (_, Some("pcapng")) => Format::Capture,
        (Some("npz"), _) => Format::Npz,
        (Some(suffix), _) if !out.is_dir() && OTHERS.contains(&suffix) => {
            return Err("recordings are *.npz, *.pcapng (of packets, also .gz or .zst) or folders, and this name is of another file; \
                 make a folder of this name first if one is meant");
        }
        _ => return Ok(folder),
    };
    if folder == Format::Tum { Err("--tum is the layout of a folder, and this is a file") } else { Ok(format) }
}

/// The camera file of `OUT.npz` or a capture.
fn beside(out: &Path) -> PathBuf {
    capture::unpacked_name(out).with_extension("camera.toml")
}

fn write_camera(path: &Path, camera: &Camera) -> io::Result<()> {
    let keys = toml::to_string(&camera.to_config()).map_err(io::Error::other)?;
    std::fs::write(path, keys)
}

/// A capture that begins with the first packet, at `arrival_ns`.
fn create_capture(out: &Path, camera: &Camera, kinect: Option<Kinect>, arrival_ns: i64) -> io::Result<Writer<Output>> {
    write_camera(&beside(out), camera)?;
    let mut writer = Writer::create(out, None)?;
    if let Some(Kinect { packing, zero_plane }) = kinect {
        writer.introduce(zero_plane.as_ref(), packing, arrival_ns)?;
    }
    Ok(writer)
}

fn create(format: Format, out: &Path, camera: &Camera) -> io::Result<Box<dyn Sink>> {
    if format == Format::Npz {
        let file = NpzFile::create(out, camera)?;
        write_camera(&beside(out), &file.camera())?;
        return Ok(Box::new(file));
    }
    std::fs::create_dir_all(out)?;
    write_camera(&out.join("camera.toml"), camera)?;
    Ok(if format == Format::Tum { Box::new(TumFolder::create(out, camera)?) } else { Box::new(FakenectFolder::create(out, camera)?) })
}
