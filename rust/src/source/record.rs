//! Packets or frames of any source into a file or folder that is a source itself.

use super::fakenect::FakenectFolder;
use super::npz_record::NpzFile;
use super::tum::TumFolder;
use super::{Input, Kinect, Source, SourceError, capture};
use crate::capture::{Output, Writer};
use crate::geometry::camera::Camera;
use crate::kinect::disparity::{HEIGHT, WIDTH};
use crate::seeing::Image;
use crate::stream::assembler::Assembler;
use std::boxed::Box;
use std::format;
use std::io;
use std::path::{Path, PathBuf};
use std::string::String;
use std::vec::Vec;

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

/// What came of waiting for the next frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Recorded {
    /// It is recorded.
    Frame {
        /// How many there are now.
        count: u64,
        /// Its stamp.
        timestamp_ns: i64,
    },
    /// A live source is silent.
    Silence,
}

/// What is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Format {
    Capture,
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
    /// Made for the first packet.
    capture: Option<Writer<Output>>,
    /// Made for the first frame: of a source without frames nothing is left behind.
    sink: Option<Box<dyn Sink>>,
    /// Of a source of packets; and its newest frame.
    assembler: Option<Assembler<Vec<u8>>>,
    samples: Vec<u16>,
    frames: u64,
    limit: Option<u64>,
}

impl Recording {
    /// Will record at most `limit` frames of `source` in `out`: a `*.npz`, a folder, in fakenect's layout or, with `tum`, in TUM's, or, of a
    /// source of packets, a `*.pcapng`, packed if its name goes on with `.gz` or `.zst`. In all but the last, lost samples are 2047.
    ///
    /// # Errors
    /// A source of positions, a capture of a source without packets, an `out` that holds something already, or a format that can't be written.
    pub fn new(source: Box<dyn Source>, out: &Path, tum: bool, limit: Option<u64>) -> Result<Self, RecordError> {
        let refused = |why: &str| RecordError::Refused { out: out.into(), why: why.into() };
        let Some(camera) = source.camera() else {
            return Err(refused(&format!("{} delivers positions; only frames are recorded", source.name())));
        };
        let format = if tum { Format::Tum } else { Format::Fakenect };
        let format = format_of(out, format).map_err(refused)?;
        let kinect = source.kinect();
        if format == Format::Capture && kinect.is_none() {
            return Err(refused(&format!("captures hold packets, and {} delivers frames: name FILE.npz or a folder", source.name())));
        }
        let is_free = match format {
            Format::Npz | Format::Capture => {
                std::fs::metadata(out).map_or(true, |file| file.is_file() && file.len() == 0) && !beside(out).exists()
            }
            _ => !out.exists() || std::fs::read_dir(out).is_ok_and(|mut folder| folder.next().is_none()),
        };
        if !is_free {
            return Err(refused("there is something already, which is never overwritten: name a new file or an empty folder"));
        }
        let assembler = kinect.and_then(|Kinect { packing, .. }| Assembler::new(packing, std::vec![0; packing.frame_bytes()]).ok());
        let samples = if assembler.is_some() { std::vec![0; WIDTH * HEIGHT] } else { Vec::new() };
        Ok(Self { source, camera, out: out.into(), format, capture: None, sink: None, assembler, samples, frames: 0, limit })
    }

    /// Records the next frame. `None` at the end.
    ///
    /// # Errors
    /// The source broke or has no frames, or a frame can't be written.
    pub fn next_frame(&mut self) -> Result<Option<Recorded>, RecordError> {
        if self.limit.is_some_and(|limit| self.frames >= limit) {
            return Ok(None);
        }
        let Self { source, camera, out, format, capture, sink, assembler, samples, .. } = self;
        let failed = |error| RecordError::Write { out: out.clone(), error };
        let kinect = source.kinect();
        let (timestamp_ns, frame) = loop {
            match (source.next_input()?, &mut *assembler) {
                (Some(Input::Frame { timestamp_ns, image: Image::U16(samples) }), _) => break (timestamp_ns, samples),
                (Some(Input::Packet { bytes, arrival_ns }), Some(assembler)) => {
                    if *format == Format::Capture {
                        if capture.is_none() {
                            *capture = Some(create_capture(out, camera, kinect, arrival_ns).map_err(failed)?);
                        }
                        capture.as_mut().map_or(Ok(()), |capture| capture.packet(bytes, arrival_ns)).map_err(failed)?;
                    }
                    let mut ended = None;
                    assembler.push(bytes, arrival_ns, &mut |frame| {
                        // Its size is the packing's.
                        ended = frame.packing.unpack(frame.packed, samples).is_ok().then_some(frame.timestamp_ns);
                    });
                    if let Some(timestamp_ns) = ended {
                        break (timestamp_ns, samples);
                    }
                }
                (Some(Input::Silence), _) => return Ok(Some(Recorded::Silence)),
                // An error follows: nobody awaits its return.
                (Some(Input::Disconnected(_)), _) => {}
                (Some(_), _) => return Err(failed(io::Error::other("only packets, and frames of 16-bit samples, can be recorded"))),
                (None, _) if self.frames == 0 => return Err(SourceError::Empty { source_name: source.name().into() }.into()),
                (None, _) => return Ok(None),
            }
        };
        if *format != Format::Capture {
            if sink.is_none() {
                *sink = Some(create(*format, out, camera).map_err(failed)?);
            }
            sink.as_mut().map_or(Ok(()), |sink| sink.write(timestamp_ns, frame)).map_err(failed)?;
        }
        self.frames += 1;
        Ok(Some(Recorded::Frame { count: self.frames, timestamp_ns }))
    }

    /// What the user should know of the source so far, a line each.
    pub fn remarks(&self) -> Vec<String> {
        self.source.remarks()
    }

    /// Completes what was recorded. An npz is nothing before; a folder is complete after each frame, a capture up to the last second.
    ///
    /// # Errors
    /// It can't be written.
    pub fn finish(mut self) -> Result<(), RecordError> {
        let sink = self.sink.as_mut().map_or(Ok(()), |sink| sink.finish());
        let capture = self.capture.map_or(Ok(()), Writer::close);
        sink.and(capture).map_err(|error| RecordError::Write { out: self.out, error })
    }
}

fn format_of(out: &Path, folder: Format) -> Result<Format, &'static str> {
    let extension = |path: &Path| path.extension().map(|extension| extension.to_string_lossy().to_ascii_lowercase());
    match extension(&capture::unpacked_name(out)).as_deref() {
        Some("pcapng" | "npz") if folder == Format::Tum => Err("--tum is the layout of a folder, and this is a file"),
        Some("pcapng") => Ok(Format::Capture),
        Some("pcap") => Err("captures hold packets, and are written as *.pcapng, also .gz or .zst"),
        Some("npz") => Ok(Format::Npz),
        _ => Ok(folder),
    }
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
