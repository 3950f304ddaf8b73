//! Frames into numpy's `*.npz`.

use super::npz_layout::Layout;
use super::recorder::Sink;
use crate::geometry::camera::{Camera, DepthCode};
use flate2::write::DeflateEncoder;
use flate2::{Compression, Crc};
use std::ffi::OsString;
use std::fs::File;
use std::io::{self, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::vec::Vec;

/// The archive is whole after so much of the stream's time, forward or back, ns.
const SETTLED_NS: u64 = 1_000_000_000;
/// And wherever so many packed bytes wait, whatever the stamps say.
const SETTLED_BYTES: usize = 1 << 24;

/// Once in a second of the stream the archive is made whole, and after that the stamps of that second go to `OUT.npz.stamps`, until the
/// end. So whoever is killed in between leaves a file in which so many frames can be found as there are stamps beside it.
pub(super) struct NpzFile {
    file: File,
    journal: File,
    journal_path: PathBuf,
    camera: Camera,
    deflate: DeflateEncoder<Vec<u8>>,
    stamps: Vec<i64>,
    samples: Crc,
    packed: u64,
    /// As the file is.
    settled: Settled,
    settled_ns: Option<i64>,
    bytes: Vec<u8>,
}

/// What is in the file: frames, the sum of their samples, and their deflated bytes.
struct Settled {
    frames: usize,
    samples: Crc,
    packed: u64,
}

impl NpzFile {
    pub(super) fn create(out: &Path, camera: &Camera) -> io::Result<Self> {
        let journal_path = journal(out);
        let mut new = Self {
            file: File::create(out)?,
            journal: File::create(&journal_path)?,
            journal_path,
            camera: *camera,
            deflate: DeflateEncoder::new(Vec::new(), Compression::fast()),
            stamps: Vec::new(),
            samples: Crc::new(),
            packed: 0,
            settled: Settled { frames: 0, samples: Crc::new(), packed: 0 },
            settled_ns: None,
            bytes: Vec::new(),
        };
        new.put(0, &new.layout().head())?;
        new.restore()?;
        Ok(new)
    }

    /// The camera of what is written: an array called `depth_mm` holds millimetres, whatever the units were.
    pub(super) fn camera(&self) -> Camera {
        let code = match self.camera.code {
            DepthCode::Depth { .. } => DepthCode::Depth { units_per_metre: 1000.0 },
            disparity @ DepthCode::Disparity { .. } => disparity,
        };
        Camera { code, ..self.camera }
    }

    /// The archive as it will be.
    fn layout(&self) -> Layout<'_> {
        let key = if matches!(self.camera.code, DepthCode::Depth { .. }) { "depth_mm" } else { "disparity" };
        let Camera { width, height, .. } = self.camera;
        Layout { key, size: [height, width], stamps: &self.stamps, samples: &self.samples, packed: self.packed }
    }

    /// Makes the archive whole.
    fn settle(&mut self) -> io::Result<()> {
        self.deflate.flush()?;
        let mut new = core::mem::take(self.deflate.get_mut());
        self.packed += new.len() as u64;
        let (head, start) = (self.layout().head(), self.end());
        new.extend(self.layout().tail());
        let written = self.put(start, &new).and_then(|()| self.put(0, &head));
        // What doesn't fit leaves the archive as it was, if that can be.
        written.inspect_err(|_| drop(self.restore()))?;
        let stamps = self.stamps[self.settled.frames..].iter().flat_map(|stamp| stamp.to_le_bytes());
        self.journal.write_all(&stamps.collect::<Vec<u8>>())?;
        self.settled = Settled { frames: self.stamps.len(), samples: copy(&self.samples), packed: self.packed };
        Ok(())
    }

    /// Puts back what was there when the archive was whole last; what came after that is forgotten.
    fn restore(&mut self) -> io::Result<()> {
        self.stamps.truncate(self.settled.frames);
        (self.samples, self.packed) = (copy(&self.settled.samples), self.settled.packed);
        let (head, tail, end) = (self.layout().head(), self.layout().tail(), self.end());
        self.file.set_len(end)?;
        self.put(end, &tail)?;
        self.put(0, &head)
    }

    /// Where the deflated samples that are in the file end.
    fn end(&self) -> u64 {
        self.layout().head().len() as u64 + self.settled.packed
    }

    fn put(&mut self, start: u64, bytes: &[u8]) -> io::Result<()> {
        self.file.seek(SeekFrom::Start(start))?;
        self.file.write_all(bytes)
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
        self.samples.update(&self.bytes);
        self.deflate.write_all(&self.bytes)?;
        self.stamps.push(timestamp_ns);
        let since = timestamp_ns.abs_diff(*self.settled_ns.get_or_insert(timestamp_ns));
        if since >= SETTLED_NS || self.deflate.get_ref().len() >= SETTLED_BYTES {
            self.settled_ns = Some(timestamp_ns);
            self.settle()?;
        }
        Ok(())
    }

    fn bytes(&self) -> u64 {
        self.end()
    }

    fn finish(&mut self) -> io::Result<()> {
        if self.stamps.len() > self.settled.frames {
            self.settle()?;
        }
        std::fs::remove_file(&self.journal_path)
    }
}

fn copy(crc: &Crc) -> Crc {
    let mut same = Crc::new();
    same.combine(crc);
    same
}

/// Where the stamps of what is in `out` are while it is being recorded.
pub(super) fn journal(out: &Path) -> PathBuf {
    let mut name = OsString::from(out);
    name.push(".stamps");
    name.into()
}

/// Rounded; what lies beyond 65.535 m is no reading.
fn millimetres(sample: u16, units_per_metre: f64) -> u16 {
    let z = libm::round(f64::from(sample) * 1000.0 / units_per_metre);
    if z <= f64::from(u16::MAX) { z as u16 } else { 0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::CameraConfig;
    use crate::seeing::Image;
    use crate::source::{Input, Npz, Source};

    #[test]
    fn units_become_millimetres() {
        assert_eq!([0, 2, 3, 5000, 65535].map(|sample| millimetres(sample, 5000.0)), [0, 0, 1, 1000, 13107]);
        assert_eq!(millimetres(65535, 1.0), 0);
    }

    fn keys() -> CameraConfig {
        let lens = CameraConfig { fx: Some(20.0), fy: Some(20.0), cx: Some(7.5), cy: Some(7.5), ..CameraConfig::default() };
        CameraConfig { width: Some(16), height: Some(16), ..lens }
    }

    /// A frame every half second, which can't be packed well.
    fn frame(i: i64) -> (i64, Vec<u16>) {
        (i * 500_000_000, (0..256).map(|pixel| ((pixel + 7) * (pixel + i) * 40_503 / 64 % 2047) as u16).collect())
    }

    fn read(path: &Path) -> (Vec<(i64, Vec<u16>)>, usize) {
        let mut npz = Npz::open(path, &keys()).unwrap();
        let (mut frames, remarks) = (Vec::new(), npz.remarks().len());
        while let Some(input) = npz.next_input().unwrap() {
            let Input::Frame { timestamp_ns, image: Image::U16(samples) } = input else { panic!("{input:?}") };
            frames.push((timestamp_ns, samples.to_vec()));
        }
        (frames, remarks)
    }

    /// A folder of its own, and a recording that is begun in it.
    fn begin(name: &str) -> (PathBuf, PathBuf, NpzFile) {
        let folder = std::env::temp_dir().join(std::format!("physinc-{name}-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let out = folder.join("out.npz");
        let camera = Camera::from_config(&keys(), DepthCode::Disparity { law: [3.0, -0.003] }).unwrap();
        let file = NpzFile::create(&out, &camera).unwrap();
        (folder, out, file)
    }

    #[test]
    fn whenever_the_recorder_is_killed_all_but_the_last_second_is_there() {
        let (folder, out, mut file) = begin("npz");
        let expected: Vec<_> = (0..8).map(frame).collect();
        let head = file.layout().head().len();
        let mut before = (std::fs::read(&out).unwrap(), Vec::new());
        for (i, (timestamp_ns, samples)) in expected.iter().enumerate() {
            file.write(*timestamp_ns, samples).unwrap();
            let after = (std::fs::read(&out).unwrap(), std::fs::read(journal(&out)).unwrap());
            if after == before {
                continue;
            }
            // Cut off at any byte of what was written: at the old end, then at the beginning, then in the journal.
            let (whole, settled) = (folder.join("cut.npz"), before.1.len() / 8);
            let start = before.0.iter().zip(&after.0).skip(head).position(|(a, b)| a != b).map_or(before.0.len(), |at| at + head);
            for cut in (start..=after.0.len()).step_by(61) {
                let mut mixed = after.0[..cut].to_vec();
                mixed.extend(before.0.iter().skip(cut));
                mixed[..head].copy_from_slice(&before.0[..head]);
                std::fs::write(&whole, &mixed).unwrap();
                std::fs::write(journal(&whole), &before.1).unwrap();
                assert_eq!(read(&whole), (expected[..settled].to_vec(), 1), "frame {i}, byte {cut}");
            }
            std::fs::write(&whole, &after.0).unwrap();
            for cut in before.1.len()..=after.1.len() {
                std::fs::write(journal(&whole), &after.1[..cut]).unwrap();
                assert_eq!(read(&whole), (expected[..cut / 8].to_vec(), 1), "frame {i}, stamp {cut}");
            }
            assert_eq!(after.1.len() / 8, i + 1, "all that is there is settled");
            before = after;
        }
        assert_eq!(before.1.len() / 8, 7);
        file.finish().unwrap();
        assert_eq!((read(&out), journal(&out).exists()), ((expected, 0), false));
        std::fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn stamps_that_go_back_or_stand_still_are_settled_too() {
        let (folder, _, mut file) = begin("npz-stamps");
        let settled = |file: &NpzFile| file.settled.frames;
        for i in 0..8 {
            let (timestamp_ns, samples) = frame(-i);
            file.write(timestamp_ns, &samples).unwrap();
        }
        assert_eq!(settled(&file), 7, "all but the last second");
        let (mut seed, standing) = (1_u32, i64::MIN);
        let mut noise = || {
            core::array::from_fn::<u16, 256, _>(|_| {
                seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                (seed >> 21) as u16
            })
        };
        file.write(standing, &noise()).unwrap();
        let before = settled(&file);
        for _ in 0..2 * SETTLED_BYTES / 512 {
            file.write(standing, &noise()).unwrap();
        }
        assert!(settled(&file) > before, "of {SETTLED_BYTES} bytes");
        assert!(file.deflate.get_ref().len() < SETTLED_BYTES + 4096);
        drop(file);
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
