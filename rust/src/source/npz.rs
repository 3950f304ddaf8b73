//! Depth frames in numpy's `*.npz`, read one at a time.

use super::npz_record::journal;
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

/// Reads `timestamps_ns` `[N]` int64 and `depth_mm` or `disparity` `[N, H, W]` uint16. Whatever the file claims, there is never more than one
/// frame of the camera's size in memory.
pub struct Npz {
    name: String,
    camera: Camera,
    stamps: Entry,
    images: Entry,
    frames_left: u64,
    /// How many frames are whole, of a recording that was cut off.
    saved: Option<u64>,
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
        if let Ok(stamps) = File::open(journal(path)) {
            let count = stamps.metadata().map_or(0, |file| file.len() / 8);
            let (key, images) = Entry::first(file).map_err(malformed)?;
            let mut new = Self::new(path, keys, key, images, Entry::bare(stamps, count))?;
            (new.frames_left, new.saved) = (count, Some(count));
            return Ok(new);
        }
        let mut archive = ZipArchive::new(BufReader::new(file)).map_err(|error| {
            malformed(format!("no npz archive, or a cut one ({error}); np.savez(file, timestamps_ns=..., depth_mm=...) makes one"))
        })?;
        let has = |key: &str| archive.index_for_name(&format!("{key}.npy")).is_some();
        let key = match (has("depth_mm"), has("disparity")) {
            (true, false) => DEPTH,
            (false, true) => DISPARITY,
            (true, true) => return Err(malformed("it has both `depth_mm` and `disparity`: one of them is expected".into())),
            (false, false) => {
                let found: Vec<_> = archive.file_names().flatten().take(8).map(|name| name.trim_end_matches(".npy").to_string()).collect();
                return Err(malformed(format!("neither `depth_mm` nor `disparity` among its arrays ({})", found.join(", "))));
            }
        };
        let images = Entry::open(path, &mut archive, key, TypeChar::Uint, 2).map_err(malformed)?;
        let stamps = Entry::open(path, &mut archive, "timestamps_ns", TypeChar::Int, 8).map_err(malformed)?;
        if let (&[count], &[frames, _, _]) = (&*stamps.shape, &*images.shape)
            && count != frames
        {
            return Err(malformed(format!("{count} timestamps_ns for {frames} frames of {key}: as many are expected")));
        }
        Self::new(path, keys, key, images, stamps)
    }

    fn new(path: &Path, keys: &CameraConfig, key: &str, images: Entry, stamps: Entry) -> Result<Self, SourceError> {
        let name = path.display().to_string();
        let malformed = |what: String| SourceError::malformed(&name, what);
        let code =
            if key == DEPTH { DepthCode::Depth { units_per_metre: 1000.0 } } else { DepthCode::Disparity { law: KINECT_DISPARITY_LAW } };
        let camera = Camera::from_config(keys, code)?;
        let (&[count], &[frames, height, width]) = (&*stamps.shape, &*images.shape) else {
            let (stamps, images) = (&stamps.shape, &images.shape);
            return Err(malformed(format!("timestamps_ns is {stamps:?} and {key} {images:?}: [N] and [N, height, width] are expected")));
        };
        if (width, height) != (camera.width as u64, camera.height as u64) {
            return Err(malformed(format!(
                "its frames are {width}×{height} px, the camera is {}×{}: tell width, height, fx, fy, cx, cy in {} or by --camera FILE",
                camera.width,
                camera.height,
                path.with_extension("camera.toml").display(),
            )));
        }
        let pixels = camera.width * camera.height;
        let frames_left = count.min(frames);
        Ok(Self { name, camera, stamps, images, frames_left, saved: None, bytes: std::vec![0; 2 * pixels], samples: std::vec![0; pixels] })
    }
}

impl Source for Npz {
    fn name(&self) -> &str {
        &self.name
    }

    fn camera(&self) -> Option<Camera> {
        Some(self.camera)
    }

    fn remarks(&self) -> Vec<String> {
        let remark = |count| {
            format!(
                "its recording was cut off: {count} frames are whole; `physinc record {} WHOLE.npz` makes a whole file of them",
                self.name
            )
        };
        self.saved.map(remark).into_iter().collect()
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

/// The arrays that frames may be in.
const DEPTH: &str = "depth_mm";
const DISPARITY: &str = "disparity";

/// One array of the archive, with a file handle of its own so that several can be read side by side.
struct Entry {
    key: &'static str,
    shape: Vec<u64>,
    big_endian: bool,
    content: CrcReader<Box<dyn Read + Send>>,
    /// Not known of what was cut off.
    crc: Option<u32>,
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
        let new = Self::read_from(key, content, kind, size)?;
        let claimed = new.shape.iter().try_fold(size, |bytes, &n| bytes.checked_mul(n));
        if claimed.is_none_or(|claimed| entry.size() < claimed) {
            let Self { shape, .. } = new;
            return Err(format!("`{key}` claims the shape {shape:?}, but has only {} bytes: the file is cut or broken", entry.size()));
        }
        Ok(Self { crc: Some(entry.crc32()), ..new })
    }

    /// The array of frames of an archive whose end, and with it its directory, is missing: as the recorder writes it, it is the first.
    fn first(mut file: File) -> Result<(&'static str, Self), String> {
        let broken = |error: std::io::Error| format!("its recording was cut off at its very beginning ({error})");
        let mut header = [0; 30];
        file.read_exact(&mut header).map_err(broken)?;
        let [name, extra] = [26, 28].map(|at| u16::from_le_bytes([header[at], header[at + 1]]));
        let mut name = std::vec![0; name.into()];
        file.read_exact(&mut name).map_err(broken)?;
        file.seek_relative(extra.into()).map_err(broken)?;
        let key = match &*name {
            b"depth_mm.npy" => DEPTH,
            b"disparity.npy" => DISPARITY,
            name => {
                return Err(format!("its recording was cut off, and it begins with {:?} instead of frames", String::from_utf8_lossy(name)));
            }
        };
        // Nothing is unpacked before it is asked for: what follows the last whole frame may be no stream at all.
        let content = Box::new(DeflateDecoder::new(BufReader::new(file)));
        Ok((key, Self::read_from(key, content, TypeChar::Uint, 2)?))
    }

    /// Numbers without a header, as the recorder writes stamps.
    fn bare(file: File, count: u64) -> Self {
        let content = CrcReader::new(Box::new(BufReader::new(file)) as Box<dyn Read + Send>);
        Self { key: "timestamps_ns", shape: std::vec![count], big_endian: false, content, crc: None }
    }

    /// The array that `content` begins with.
    fn read_from(key: &'static str, content: Box<dyn Read + Send>, kind: TypeChar, size: u64) -> Result<Self, String> {
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
        Ok(Self { key, shape: header.shape().to_vec(), big_endian, content, crc: None })
    }

    fn read(&mut self, buffer: &mut [u8]) -> Result<(), String> {
        self.content.read_exact(buffer).map_err(|error| format!("`{}` ends too early ({error}): the file is cut or broken", self.key))
    }

    /// After the last element: all bytes must have been what the writer wrote.
    fn finish(&mut self) -> Result<(), String> {
        if self.crc.is_none_or(|crc| crc == self.content.crc().sum()) {
            Ok(())
        } else {
            Err(format!("`{}` fails its checksum: the file is broken", self.key))
        }
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
