//! Depth frames in numpy's `*.npz`, read one at a time.

use super::{Input, Source, SourceError};
use crate::config::CameraConfig;
use crate::geometry::camera::{Camera, DepthCode, KINECT_DISPARITY_LAW};
use crate::seeing::Image;
use flate2::CrcReader;
use flate2::read::DeflateDecoder;
use npyz::{DType, Endianness, NpyHeader, Order, TypeChar};
use std::boxed::Box;
use std::format;
use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::Path;
use std::string::{String, ToString};
use std::vec::Vec;
use zip::{CompressionMethod, ZipArchive};

/// Reads `timestamps_ns` [N] int64 and `depth_mm` or `disparity` [N, H, W] uint16. Whatever the file claims, there is never more than one
/// frame of the camera's size in memory.
pub struct Npz {
    name: String,
    camera: Camera,
    stamps: Entry,
    images: Entry,
    frames_left: u64,
    bytes: Vec<u8>,
    samples: Vec<u16>,
}

impl Npz {
    /// Opens the recording at `path`, taken by the camera of `keys`.
    ///
    /// # Errors
    /// It is no such recording, or not of this camera.
    pub fn open(path: &Path, keys: &CameraConfig) -> Result<Self, SourceError> {
        let name = path.display().to_string();
        let file = File::open(path).map_err(|error| SourceError::unreadable(&name, error))?;
        let malformed = |what: String| SourceError::malformed(&name, what);
        let mut archive = ZipArchive::new(BufReader::new(file)).map_err(|error| {
            malformed(format!("no npz archive, or a cut one ({error}); np.savez(file, timestamps_ns=..., depth_mm=...) makes one"))
        })?;
        let has = |key: &str| archive.index_for_name(&format!("{key}.npy")).is_some();
        let (key, code) = match (has("depth_mm"), has("disparity")) {
            (true, false) => ("depth_mm", DepthCode::Depth { units_per_metre: 1000.0 }),
            (false, true) => ("disparity", DepthCode::Disparity { law: KINECT_DISPARITY_LAW }),
            (true, true) => return Err(malformed("it has both `depth_mm` and `disparity`: one of them is expected".into())),
            (false, false) => {
                let found: Vec<_> = archive.file_names().take(8).collect();
                return Err(malformed(format!("neither `depth_mm` nor `disparity` in it, only {found:?}")));
            }
        };
        let camera = Camera::from_config(keys, code)?;
        let images = Entry::open(path, &mut archive, key, TypeChar::Uint, 2).map_err(malformed)?;
        let stamps = Entry::open(path, &mut archive, "timestamps_ns", TypeChar::Int, 8).map_err(malformed)?;
        let (&[count], &[frames, height, width]) = (&*stamps.shape, &*images.shape) else {
            let (stamps, images) = (&stamps.shape, &images.shape);
            return Err(malformed(format!("timestamps_ns is {stamps:?} and {key} {images:?}: [N] and [N, height, width] are expected")));
        };
        if count != frames {
            return Err(malformed(format!("{count} timestamps_ns for {frames} frames of {key}: as many are expected")));
        }
        if (width, height) != (camera.width as u64, camera.height as u64) {
            return Err(malformed(format!(
                "its frames are {width}×{height} px, the camera is {}×{}: tell width, height, fx, fy, cx, cy in {} or by --camera FILE",
                camera.width,
                camera.height,
                path.with_extension("camera.toml").display(),
            )));
        }
        let pixels = camera.width * camera.height;
        Ok(Self { name, camera, stamps, images, frames_left: frames, bytes: std::vec![0; 2 * pixels], samples: std::vec![0; pixels] })
    }
}

impl Source for Npz {
    fn name(&self) -> &str {
        &self.name
    }

    fn camera(&self) -> Option<Camera> {
        Some(self.camera)
    }

    fn next_input(&mut self) -> Result<Option<Input<'_>>, SourceError> {
        if self.frames_left == 0 {
            return Ok(None);
        }
        self.frames_left -= 1;
        let mut stamp = [0; 8];
        let read = self.stamps.read(&mut stamp).and_then(|()| self.images.read(&mut self.bytes));
        read.and_then(|()| if self.frames_left == 0 { self.stamps.finish().and_then(|()| self.images.finish()) } else { Ok(()) })
            .map_err(|what| SourceError::malformed(&self.name, what))?;
        let timestamp_ns = if self.stamps.big_endian { i64::from_be_bytes(stamp) } else { i64::from_le_bytes(stamp) };
        let decode = if self.images.big_endian { u16::from_be_bytes } else { u16::from_le_bytes };
        for (sample, bytes) in self.samples.iter_mut().zip(self.bytes.chunks_exact(2)) {
            *sample = decode([bytes[0], bytes[1]]);
        }
        Ok(Some(Input::Frame { timestamp_ns, image: Image::U16(&self.samples) }))
    }
}

/// One array of the archive, with a file handle of its own so that several can be read side by side.
struct Entry {
    key: &'static str,
    shape: Vec<u64>,
    big_endian: bool,
    content: CrcReader<Box<dyn Read + Send>>,
    crc: u32,
}

/// The longest header that is believed.
const LONGEST_HEADER: u32 = 1 << 16;

impl Entry {
    /// The array `key`, whose elements must be of `kind` and `size` bytes.
    fn open(path: &Path, archive: &mut ZipArchive<BufReader<File>>, key: &'static str, kind: TypeChar, size: u64) -> Result<Self, String> {
        let broken = |error: &dyn std::fmt::Display| format!("`{key}` can't be read ({error}): the file is cut or broken");
        let entry = archive.by_name(&format!("{key}.npy")).map_err(|error| match error {
            zip::result::ZipError::FileNotFound => format!("no `{key}` in it"),
            error => broken(&error),
        })?;
        let start = entry.data_start().ok_or_else(|| broken(&"no start"))?;
        let mut file = File::open(path).map_err(|error| broken(&error))?;
        file.seek(SeekFrom::Start(start)).map_err(|error| broken(&error))?;
        let stored = BufReader::new(file.take(entry.compressed_size()));
        let content: Box<dyn Read + Send> = match entry.compression() {
            CompressionMethod::Stored => Box::new(stored),
            CompressionMethod::Deflated => Box::new(BufReader::new(DeflateDecoder::new(stored))),
            method => return Err(format!("`{key}` is packed by {method}: np.savez and np.savez_compressed are read")),
        };
        let mut content = CrcReader::new(content);
        let header = read_header(&mut content).map_err(|error| format!("`{key}` is no numpy array ({error})"))?;
        let big_endian = match header.dtype() {
            dtype if dtype.uses_pickled_array() => {
                return Err(format!("`{key}` holds pickled Python objects, which are never loaded: a plain array is expected"));
            }
            DType::Plain(plain) if plain.type_char() == kind && plain.size_field() == size => plain.endianness() == Endianness::Big,
            dtype => {
                let expected = if kind == TypeChar::Int { "int64" } else { "uint16" };
                return Err(format!("`{key}` is of type {}: {expected} is expected", dtype.descr()));
            }
        };
        if header.order() == Order::Fortran {
            return Err(format!("`{key}` is in Fortran order: save np.ascontiguousarray({key})"));
        }
        let shape = header.shape().to_vec();
        let claimed = shape.iter().try_fold(size, |bytes, &n| bytes.checked_mul(n));
        if claimed.is_none_or(|claimed| entry.size() < claimed) {
            return Err(format!("`{key}` claims the shape {shape:?}, but has only {} bytes: the file is cut or broken", entry.size()));
        }
        Ok(Self { key, shape, big_endian, content, crc: entry.crc32() })
    }

    fn read(&mut self, buffer: &mut [u8]) -> Result<(), String> {
        self.content.read_exact(buffer).map_err(|error| format!("`{}` ends too early ({error}): the file is cut or broken", self.key))
    }

    /// After the last element: all bytes must have been what the writer wrote.
    fn finish(&mut self) -> Result<(), String> {
        if self.content.crc().sum() == self.crc { Ok(()) } else { Err(format!("`{}` fails its checksum: the file is broken", self.key)) }
    }
}

/// `npyz` allocates as much as a header claims to be long, so that is looked at first.
fn read_header(content: &mut impl Read) -> std::io::Result<NpyHeader> {
    let mut start = [0; 12];
    content.read_exact(&mut start)?;
    let version_1 = start[6] < 2;
    if !version_1 && u32::from_le_bytes([start[8], start[9], start[10], start[11]]) > LONGEST_HEADER {
        return Err(std::io::Error::other("its header is absurdly long"));
    }
    NpyHeader::from_reader(start.chain(content))
}
