//! Recordings in the layout of TUM's RGB-D benchmark: `depth.txt` and a 16-bit PNG for each frame.

use super::depth_png::read_png;
use super::folder::Index;
use super::recorder::Sink;
use super::{Input, Source, SourceError, decimal};
use crate::config::CameraConfig;
use crate::geometry::camera::{Camera, DepthCode};
use crate::seeing::Image;
use png::{BitDepth, ColorType};
use std::format;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::string::String;
use std::vec::Vec;

/// The file that names the others.
pub(super) const INDEX: &str = "depth.txt";

/// Reads the PNGs that lines `timestamp filename` name, one at a time, in their order. Seconds are decimal text; `#` begins a comment.
pub struct Tum {
    index: Index,
    camera: Camera,
    bytes: Vec<u8>,
    samples: Vec<u16>,
}

impl Tum {
    /// Opens the recording in `folder`, taken by the camera of `keys`; depth, 5000 units a metre, unless they say otherwise.
    ///
    /// # Errors
    /// No index, or a camera that can't be.
    pub fn open(folder: &Path, keys: &CameraConfig) -> Result<Self, SourceError> {
        let index = Index::open(folder, INDEX)?;
        let camera = Camera::from_config(keys, DepthCode::Depth { units_per_metre: 5000.0 })?;
        let pixels = camera.width * camera.height;
        Ok(Self { index, camera, bytes: std::vec![0; 2 * pixels], samples: std::vec![0; pixels] })
    }
}

impl Source for Tum {
    fn name(&self) -> &str {
        self.index.name()
    }

    fn camera(&self) -> Option<Camera> {
        Some(self.camera)
    }

    fn remarks(&self) -> Vec<String> {
        self.index.remarks()
    }

    fn next_input(&mut self) -> Result<Option<Input<'_>>, SourceError> {
        loop {
            let Some(line) = self.index.next_line()? else { return Ok(None) };
            if line.is_empty() || line.starts_with('#') {
                continue;
            }
            let entry = line.split_once(char::is_whitespace).and_then(|(t, name)| Some((decimal::nanoseconds(t)?, name.trim_start())));
            let (timestamp_ns, name) =
                entry.ok_or_else(|| self.index.malformed(format!("{line:?} is not `timestamp filename`, the timestamp in seconds")))?;
            let Some(image) = self.index.image(name)? else { continue };
            read_png(image, &self.camera, &mut self.bytes).map_err(|what| self.index.malformed(format!("{name:?}: {what}")))?;
            for (sample, bytes) in self.samples.iter_mut().zip(self.bytes.chunks_exact(2)) {
                *sample = u16::from_be_bytes([bytes[0], bytes[1]]);
            }
            self.index.see(timestamp_ns);
            return Ok(Some(Input::Frame { timestamp_ns, image: Image::U16(&self.samples) }));
        }
    }
}

/// A recording that is being written; every stamp and sample as it is. Files are numbered, since stamps may stand still.
pub(super) struct TumFolder {
    folder: PathBuf,
    index: File,
    size: [u32; 2],
    frames: u64,
    bytes: Vec<u8>,
    written: u64,
}

impl TumFolder {
    /// In `folder`, which exists and is empty.
    pub(super) fn create(folder: &Path, camera: &Camera) -> io::Result<Self> {
        std::fs::create_dir(folder.join("depth"))?;
        let mut index = File::create_new(folder.join(INDEX))?;
        index.write_all(b"# depth maps\n# timestamp filename\n")?;
        Ok(Self {
            folder: folder.into(),
            index,
            size: [camera.width as u32, camera.height as u32],
            frames: 0,
            bytes: Vec::new(),
            written: 0,
        })
    }
}

impl Sink for TumFolder {
    fn write(&mut self, timestamp_ns: i64, samples: &[u16]) -> io::Result<()> {
        self.bytes.clear();
        self.bytes.extend(samples.iter().flat_map(|sample| sample.to_be_bytes()));
        let name = format!("depth/{:06}.png", self.frames);
        let mut file = BufWriter::new(File::create_new(self.folder.join(&name))?);
        let mut encoder = png::Encoder::new(&mut file, self.size[0], self.size[1]);
        encoder.set_color(ColorType::Grayscale);
        encoder.set_depth(BitDepth::Sixteen);
        encoder.set_compression(png::Compression::Fast);
        let mut writer = encoder.write_header()?;
        writer.write_image_data(&self.bytes)?;
        writer.finish()?;
        file.flush()?;
        self.written += file.get_ref().metadata()?.len();
        self.frames += 1;
        let (sign, size) = (if timestamp_ns < 0 { "-" } else { "" }, timestamp_ns.unsigned_abs());
        // What the index names is whole.
        let line = format!("{sign}{}.{:09} {name}\n", size / 1_000_000_000, size % 1_000_000_000);
        self.index.write_all(line.as_bytes())
    }

    fn bytes(&self) -> u64 {
        self.written
    }

    fn finish(&mut self) -> io::Result<()> {
        Ok(())
    }
}
