//! Recordings in the layout of TUM's RGB-D benchmark: `depth.txt` and a 16-bit PNG for each frame.

use super::folder::{Index, check_size};
use super::record::Sink;
use super::{Input, Source, SourceError, decimal};
use crate::config::CameraConfig;
use crate::geometry::camera::{Camera, DepthCode};
use crate::seeing::Image;
use png::{BitDepth, ColorType, Decoder, DecodingError, Limits};
use std::format;
use std::fs::File;
use std::io::{self, BufRead, BufWriter, ErrorKind, Seek, Write};
use std::path::{Path, PathBuf};
use std::string::{String, ToString};
use std::vec::Vec;

/// The file that names the others.
pub(super) const INDEX: &str = "depth.txt";

/// What a PNG may make its reader keep beside the samples: more than any needs.
const LIMITS: Limits = Limits { bytes: 1 << 20 };

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

    fn next_input(&mut self) -> Result<Option<Input<'_>>, SourceError> {
        loop {
            let Some(line) = self.index.next_line()? else { return Ok(None) };
            if line.is_empty() || line.starts_with('#') {
                continue;
            }
            let entry = line.split_once(char::is_whitespace).and_then(|(t, name)| Some((decimal::nanoseconds(t)?, name.trim_start())));
            let (timestamp_ns, name) =
                entry.ok_or_else(|| self.index.malformed(format!("{line:?} is not `timestamp filename`, the timestamp in seconds")))?;
            let image = self.index.image(name)?;
            read_png(image, &self.camera, &mut self.bytes).map_err(|what| self.index.malformed(format!("{name:?}: {what}")))?;
            for (sample, bytes) in self.samples.iter_mut().zip(self.bytes.chunks_exact(2)) {
                *sample = u16::from_be_bytes([bytes[0], bytes[1]]);
            }
            return Ok(Some(Input::Frame { timestamp_ns, image: Image::U16(&self.samples) }));
        }
    }
}

/// The samples of a 16-bit grey PNG of the camera's size, big-endian. The header is looked at before anything is allocated for what it claims.
fn read_png(image: impl BufRead + Seek, camera: &Camera, samples: &mut [u8]) -> Result<(), String> {
    let mut decoder = Decoder::new_with_limits(image, LIMITS);
    decoder.set_ignore_text_chunk(true);
    decoder.set_ignore_iccp_chunk(true);
    let header = decoder.read_header_info().map_err(explain)?;
    match (header.color_type, header.bit_depth) {
        (ColorType::Grayscale, BitDepth::Sixteen) => {}
        (color, depth) => return Err(format!("it is {color:?} of {} bits: 16-bit grey is expected", depth as u8)),
    }
    check_size(camera, [header.width.into(), header.height.into()])?;
    let mut reader = decoder.read_info().map_err(explain)?;
    let frame = reader.next_frame(samples).map_err(explain)?;
    // An animated one may have smaller frames.
    check_size(camera, [frame.width.into(), frame.height.into()])?;
    reader.finish().map_err(explain)
}

fn explain(error: DecodingError) -> String {
    match error {
        DecodingError::IoError(error) if error.kind() == ErrorKind::UnexpectedEof => "it ends too early: the file is cut".into(),
        DecodingError::Format(error) => format!("no PNG, or a broken one ({})", error.to_string().trim_end_matches('.')),
        error => format!("it can't be read ({error})"),
    }
}

/// A recording that is being written; every stamp and sample as it is. Files are numbered, since stamps may stand still.
pub(super) struct TumFolder {
    folder: PathBuf,
    index: File,
    size: [u32; 2],
    frames: u64,
    bytes: Vec<u8>,
}

impl TumFolder {
    /// In `folder`, which exists and is empty.
    pub(super) fn create(folder: &Path, camera: &Camera) -> io::Result<Self> {
        std::fs::create_dir(folder.join("depth"))?;
        let mut index = File::create_new(folder.join(INDEX))?;
        index.write_all(b"# depth maps\n# timestamp filename\n")?;
        Ok(Self { folder: folder.into(), index, size: [camera.width as u32, camera.height as u32], frames: 0, bytes: Vec::new() })
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
        self.frames += 1;
        let (sign, size) = (if timestamp_ns < 0 { "-" } else { "" }, timestamp_ns.unsigned_abs());
        // What the index names is whole.
        let line = format!("{sign}{}.{:09} {name}\n", size / 1_000_000_000, size % 1_000_000_000);
        self.index.write_all(line.as_bytes())
    }

    fn finish(&mut self) -> io::Result<()> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::io::Cursor;

    /// What is read of a PNG by a camera of 16 × 16.
    fn read(content: &[u8]) -> Result<Vec<u8>, String> {
        let lens = CameraConfig { fx: Some(20.0), fy: Some(20.0), cx: Some(7.5), cy: Some(7.5), ..CameraConfig::default() };
        let keys = CameraConfig { width: Some(16), height: Some(16), ..lens };
        let camera = Camera::from_config(&keys, DepthCode::Depth { units_per_metre: 5000.0 }).unwrap();
        let mut samples = std::vec![0; 512];
        read_png(Cursor::new(content), &camera, &mut samples).map(|()| samples)
    }

    fn png(width: u32, height: u32, color: ColorType, depth: BitDepth) -> (Vec<u8>, Vec<u8>) {
        let mut content = Vec::new();
        let mut encoder = png::Encoder::new(&mut content, width, height);
        encoder.set_color(color);
        encoder.set_depth(depth);
        let bytes = width as usize * height as usize * color.samples() * depth as usize / 8;
        let samples: Vec<u8> = (0..bytes).map(|i| (i * i / 7) as u8).collect();
        encoder.write_header().unwrap().write_image_data(&samples).unwrap();
        (content, samples)
    }

    #[test]
    fn only_16_bit_grey_of_the_cameras_size_is_read() {
        let (content, samples) = png(16, 16, ColorType::Grayscale, BitDepth::Sixteen);
        assert_eq!(read(&content).unwrap(), samples);
        for (width, color, depth, expected) in [
            (16, ColorType::Grayscale, BitDepth::Eight, "Grayscale of 8 bits: 16-bit grey"),
            (16, ColorType::Rgb, BitDepth::Sixteen, "Rgb of 16 bits"),
            (16, ColorType::GrayscaleAlpha, BitDepth::Sixteen, "GrayscaleAlpha of 16 bits"),
            (17, ColorType::Grayscale, BitDepth::Sixteen, "17×16 px, the camera is 16×16"),
        ] {
            let message = read(&png(width, 16, color, depth).0).unwrap_err();
            assert!(message.contains(expected), "{message}");
        }
    }

    #[test]
    fn every_cut_is_an_error() {
        let (content, _) = png(16, 16, ColorType::Grayscale, BitDepth::Sixteen);
        for length in 0..content.len() {
            assert!(read(&content[..length]).is_err(), "{length}");
        }
    }

    proptest! {
        #[test]
        fn a_wrong_byte_never_panics(place: prop::sample::Index, byte: u8, junk: Vec<u8>) {
            let (mut content, _) = png(16, 16, ColorType::Grayscale, BitDepth::Sixteen);
            let place = place.index(content.len());
            content[place] = byte;
            let _ = (read(&content), read(&junk));
        }
    }
}
