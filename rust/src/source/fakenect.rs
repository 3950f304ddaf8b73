//! Recordings in the manner of libfreenect's fakenect: `INDEX.txt` and a PGM for each frame.

use super::folder::{Index, check_size};
use super::recorder::Sink;
use super::ticks::{self, Wraps};
use super::{Input, Source, SourceError, decimal};
use crate::config::CameraConfig;
use crate::geometry::camera::{Camera, DepthCode, KINECT_DISPARITY_LAW};
use crate::seeing::Image;
use crate::stream::clock;
use std::format;
use std::fs::File;
use std::io::{self, BufRead, ErrorKind, Read, Write};
use std::path::{Path, PathBuf};
use std::string::String;
use std::vec::Vec;

/// The file that names the others.
pub(super) const INDEX: &str = "INDEX.txt";

/// The longest header of a PGM that is read.
const LONGEST_HEADER: u64 = 1 << 10;

/// Reads `d-<host seconds>-<device ticks>.pgm`, one at a time, in the index's order; what else the index names is skipped. Samples are
/// 16 bits, little-endian in spite of PGM's rule. The stamp is the device's: its ticks, unwrapped.
pub struct Fakenect {
    index: Index,
    camera: Camera,
    wraps: Wraps,
    bytes: Vec<u8>,
    samples: Vec<u16>,
}

impl Fakenect {
    /// Opens the recording in `folder`, taken by the camera of `keys`; raw disparity unless they say otherwise.
    ///
    /// # Errors
    /// No index, or a camera that can't be.
    pub fn open(folder: &Path, keys: &CameraConfig) -> Result<Self, SourceError> {
        let index = Index::open(folder, INDEX)?;
        // Its images don't say what they are: raw disparity, unless the camera's file speaks of depth.
        let code = match keys.depth_scale {
            Some(units_per_metre) if keys.disparity != Some(true) => DepthCode::Depth { units_per_metre },
            _ => DepthCode::Disparity { law: KINECT_DISPARITY_LAW },
        };
        let camera = Camera::from_config(keys, code)?;
        let pixels = camera.width * camera.height;
        Ok(Self { index, camera, wraps: Wraps::default(), bytes: std::vec![0; 2 * pixels], samples: std::vec![0; pixels] })
    }
}

impl Source for Fakenect {
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
            let name = line.rsplit('/').next().and_then(|name| name.strip_prefix("d-")?.strip_suffix(".pgm"));
            let Some(name) = name else { continue };
            let stamp = name.rsplit_once('-').and_then(|(host, ticks)| {
                let ticks = self.wraps.unwrap(decimal::nanoseconds(host)?, ticks.parse().ok()?)?;
                clock::nanoseconds(ticks)
            });
            let timestamp_ns = stamp
                .ok_or_else(|| self.index.malformed(format!("{line:?} tells no time: d-<host seconds>-<device ticks>.pgm is expected")))?;
            let Some(mut image) = self.index.image(&line)? else { continue };
            read_pgm(&mut image, &self.camera, &mut self.bytes).map_err(|what| self.index.malformed(format!("{line:?}: {what}")))?;
            for (sample, bytes) in self.samples.iter_mut().zip(self.bytes.chunks_exact(2)) {
                *sample = u16::from_le_bytes([bytes[0], bytes[1]]);
            }
            self.index.see(timestamp_ns);
            return Ok(Some(Input::Frame { timestamp_ns, image: Image::U16(&self.samples) }));
        }
    }
}

/// The samples of a binary 16-bit PGM of the camera's size, as they are stored.
fn read_pgm(image: &mut impl BufRead, camera: &Camera, samples: &mut [u8]) -> Result<(), String> {
    let mut header = image.take(LONGEST_HEADER);
    if token(&mut header).as_deref() != Some("P5") {
        return Err("no binary PGM (it would begin with P5)".into());
    }
    let mut number = || token(&mut header)?.parse::<u32>().ok();
    let (Some(width), Some(height), Some(most)) = (number(), number(), number()) else {
        return Err("its header is no PGM's, or cut".into());
    };
    if !(256..=65535).contains(&most) {
        return Err(format!("its samples go up to {most}: 16-bit ones, up to 65535, are expected"));
    }
    check_size(camera, [width.into(), height.into()])?;
    image.read_exact(samples).map_err(|error| match error.kind() {
        ErrorKind::UnexpectedEof => "it ends too early: the file is cut".into(),
        _ => format!("it can't be read ({error})"),
    })?;
    match image.read(&mut [0]) {
        Ok(0) => Ok(()),
        _ => Err("it goes on after its last sample: one image is expected".into()),
    }
}

/// The next word of a header, with the one space after it; comments go from # to the end of the line.
fn token(header: &mut impl BufRead) -> Option<String> {
    let (mut word, mut comment) = (String::new(), false);
    for byte in header.bytes() {
        match byte.ok()? {
            b'\n' if comment => comment = false,
            _ if comment => {}
            b'#' if word.is_empty() => comment = true,
            byte if !byte.is_ascii_whitespace() => word.push(byte.into()),
            _ if word.is_empty() => {}
            _ => return Some(word),
        }
    }
    None
}

/// A recording that is being written. Stamps become ticks, which moves those of other clocks by up to 8⅓ ns; they are not cut to 32 bits,
/// so that a stream needs not begin in the clock's first 71.6 s.
pub(super) struct FakenectFolder {
    folder: PathBuf,
    index: File,
    header: String,
    bytes: Vec<u8>,
    written: u64,
}

impl FakenectFolder {
    /// In `folder`, which exists and is empty.
    pub(super) fn create(folder: &Path, camera: &Camera) -> io::Result<Self> {
        let header = format!("P5 {} {} 65535\n", camera.width, camera.height);
        Ok(Self { folder: folder.into(), index: File::create_new(folder.join(INDEX))?, header, bytes: Vec::new(), written: 0 })
    }

    /// A new file for a frame. As arrival counts the frame's own time; of frames of one stamp the later arrive a microsecond later.
    fn new_file(&self, timestamp_ns: i64) -> io::Result<(String, File)> {
        let ticks = ticks::nearest(timestamp_ns);
        let mut host_us = timestamp_ns / 1000;
        loop {
            let name = format!("d-{}.{:06}-{ticks}.pgm", host_us / 1_000_000, host_us % 1_000_000);
            match File::create_new(self.folder.join(&name)) {
                Err(error) if error.kind() == ErrorKind::AlreadyExists => host_us += 1,
                file => return Ok((name, file?)),
            }
        }
    }
}

impl Sink for FakenectFolder {
    fn write(&mut self, timestamp_ns: i64, samples: &[u16]) -> io::Result<()> {
        if timestamp_ns < 0 {
            return Err(io::Error::other("fakenect's names have no stamps below 0: record to FILE.npz, or with --tum"));
        }
        self.bytes.clear();
        self.bytes.extend_from_slice(self.header.as_bytes());
        self.bytes.extend(samples.iter().flat_map(|sample| sample.to_le_bytes()));
        let (mut name, mut file) = self.new_file(timestamp_ns)?;
        file.write_all(&self.bytes)?;
        // What the index names is whole.
        name.push('\n');
        self.index.write_all(name.as_bytes())?;
        self.written += (self.bytes.len() + name.len()) as u64;
        Ok(())
    }

    fn bytes(&self) -> u64 {
        self.written
    }

    fn finish(&mut self) -> io::Result<()> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn read(content: &[u8]) -> Result<Vec<u8>, String> {
        let lens = CameraConfig { fx: Some(20.0), fy: Some(20.0), cx: Some(7.5), cy: Some(7.5), ..CameraConfig::default() };
        let keys = CameraConfig { width: Some(16), height: Some(16), ..lens };
        let camera = Camera::from_config(&keys, DepthCode::Depth { units_per_metre: 1000.0 }).unwrap();
        let mut samples = std::vec![0; 512];
        read_pgm(&mut &content[..], &camera, &mut samples).map(|()| samples)
    }

    #[test]
    fn a_pgm_is_read_as_it_is_stored() {
        let samples: Vec<u8> = (0..=255).flat_map(|i| [i, 7]).collect();
        for header in ["P5 16 16 65535\n", "P5\n# a comment\n16\t16\r\n#another\n65535\n"] {
            assert_eq!(read(&[header.as_bytes(), &samples].concat()).unwrap(), samples);
        }
    }

    #[test]
    fn what_is_no_such_pgm_is_refused() {
        let zeros = [0; 513];
        for (header, length, expected) in [
            ("", 0, "no binary PGM"),
            ("P6 16 16 65535\n", 512, "no binary PGM"),
            ("P5 16 16", 0, "no PGM's, or cut"),
            ("P5 16 -16 65535\n", 512, "no PGM's"),
            ("P5 16 16 255\n", 256, "up to 255"),
            ("P5 32 16 65535\n", 512, "32×16 px, the camera is 16×16"),
            ("P5 4294967295 4294967295 65535\n", 512, "4294967295×"),
            ("P5 16 16 65535\n", 511, "cut"),
            ("P5 16 16 65535\n", 513, "goes on"),
        ] {
            let message = read(&[header.as_bytes(), &zeros[..length]].concat()).unwrap_err();
            assert!(message.contains(expected), "{header}: {message}");
        }
        assert!(read(&[b"P5 #", &[b'x'; 4096][..]].concat()).unwrap_err().contains("or cut"));
    }

    proptest! {
        #[test]
        fn never_panics(header in "(P5 )?[-0-9 #\n]{0,40}", bytes: Vec<u8>) {
            let _ = (read(header.as_bytes()), read(&bytes));
        }
    }
}
