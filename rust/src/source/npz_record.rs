//! Frames into numpy's `*.npz`.

use super::record::Sink;
use crate::geometry::camera::{Camera, DepthCode};
use flate2::Compression;
use flate2::read::DeflateDecoder;
use flate2::write::DeflateEncoder;
use npyz::WriterBuilder;
use std::fs::File;
use std::io::{self, BufReader, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::vec::Vec;
use zip::ZipWriter;
use zip::write::SimpleFileOptions;

/// An array's header tells how many frames there are, so they wait, packed, in `OUT.npz.part` until that is known; stamps wait in memory.
pub(super) struct NpzFile {
    out: PathBuf,
    part: PathBuf,
    camera: Camera,
    frames: DeflateEncoder<BufWriter<File>>,
    stamps: Vec<i64>,
    bytes: Vec<u8>,
}

impl NpzFile {
    /// Nothing is at `out` before [`Sink::finish`].
    pub(super) fn create(out: &Path, camera: &Camera) -> io::Result<Self> {
        let mut part = out.to_path_buf().into_os_string();
        part.push(".part");
        let frames = DeflateEncoder::new(BufWriter::new(File::create(&part)?), Compression::fast());
        Ok(Self { out: out.into(), part: part.into(), camera: *camera, frames, stamps: Vec::new(), bytes: Vec::new() })
    }

    /// The camera of what is written: an array called `depth_mm` holds millimetres, whatever the units were.
    pub(super) fn camera(&self) -> Camera {
        let code = match self.camera.code {
            DepthCode::Depth { .. } => DepthCode::Depth { units_per_metre: 1000.0 },
            disparity @ DepthCode::Disparity { .. } => disparity,
        };
        Camera { code, ..self.camera }
    }

    fn write_zip(&self) -> io::Result<()> {
        let mut zip = ZipWriter::new(BufWriter::new(File::create(&self.out)?));
        let options = SimpleFileOptions::default().large_file(true);
        let frames = self.stamps.len() as u64;
        zip.start_file("timestamps_ns.npy", options)?;
        write_header(&mut zip, "<i8", &[frames])?;
        for stamp in &self.stamps {
            zip.write_all(&stamp.to_le_bytes())?;
        }
        let is_depth = matches!(self.camera.code, DepthCode::Depth { .. });
        zip.start_file(if is_depth { "depth_mm.npy" } else { "disparity.npy" }, options)?;
        write_header(&mut zip, "<u2", &[frames, self.camera.height as u64, self.camera.width as u64])?;
        io::copy(&mut DeflateDecoder::new(BufReader::new(File::open(&self.part)?)), &mut zip)?;
        zip.finish()?.flush()
    }
}

impl Sink for NpzFile {
    fn write(&mut self, timestamp_ns: i64, samples: &[u16]) -> io::Result<()> {
        self.bytes.clear();
        match self.camera.code {
            DepthCode::Depth { units_per_metre } if units_per_metre != 1000.0 => {
                self.bytes.extend(samples.iter().flat_map(|&sample| millimetres(sample, units_per_metre).to_le_bytes()));
            }
            _ => self.bytes.extend(samples.iter().flat_map(|sample| sample.to_le_bytes())),
        }
        self.frames.write_all(&self.bytes)?;
        self.stamps.push(timestamp_ns);
        Ok(())
    }

    fn finish(&mut self) -> io::Result<()> {
        self.frames.try_finish()?;
        self.frames.get_mut().flush()?;
        self.write_zip()?;
        std::fs::remove_file(&self.part)
    }
}

/// Rounded; what lies beyond 65.535 m is no reading.
fn millimetres(sample: u16, units_per_metre: f64) -> u16 {
    let z = libm::round(f64::from(sample) * 1000.0 / units_per_metre);
    if z <= f64::from(u16::MAX) { z as u16 } else { 0 }
}

fn write_header(out: &mut impl Write, kind: &str, shape: &[u64]) -> io::Result<()> {
    let kind = npyz::DType::Plain(kind.parse().map_err(io::Error::other)?);
    npyz::WriteOptions::new_header_only().dtype(kind).shape(shape).writer(out).write_header_only().map(drop)
}

#[cfg(test)]
mod tests {
    use super::millimetres;

    #[test]
    fn units_become_millimetres() {
        assert_eq!([0, 2, 3, 5000, 65535].map(|sample| millimetres(sample, 5000.0)), [0, 0, 1, 1000, 13107]);
        assert_eq!(millimetres(65535, 1.0), 0);
    }
}
