//! Scenes as files: `OUT.npz` or a capture `OUT.pcapng`, what the camera is (`OUT.camera.toml`), what really happened (`OUT.truth.json`).

use super::SimError;
use super::packets::{Packets, zero_plane};
use super::scene::Scene;
use super::truth::FrameTruth;
use crate::capture::{Output, Writer, occupied};
use crate::geometry::camera::{Camera, DepthCode};
use crate::kinect::disparity::Packing;
use npyz::WriterBuilder;
use std::fs::File;
use std::io::{self, BufWriter, Seek, Write};
use std::path::{Path, PathBuf};
use std::string::{String, ToString};
use std::vec::Vec;
use zip::ZipWriter;
use zip::write::SimpleFileOptions;

/// What was written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Summary {
    /// Frames in the recording.
    pub frames: usize,
    /// Throws; or robots or cars.
    pub balls: usize,
    /// True contacts, seen or not.
    pub contacts: usize,
    /// `OUT.npz` or `OUT.pcapng`, also packed.
    pub recording: PathBuf,
    /// `OUT.camera.toml`.
    pub camera: PathBuf,
    /// `OUT.truth.json`.
    pub truth: PathBuf,
}

/// What a recording is, by its name.
enum Format {
    Npz,
    Capture,
}

/// A scene that is made up, and free places for its files.
pub struct Plan {
    scene: Scene,
    format: Format,
    out: PathBuf,
    camera: PathBuf,
    truth: PathBuf,
}

/// Simulates `scene` (`NAME?key=value&…`) into `out` (`OUT.npz`, or a capture `OUT.pcapng` of the Kinect's packets, also `.gz` and `.zst`), with
/// camera and truth beside it. One frame is in memory at a time.
///
/// # Errors
/// What [`Plan::new`] refuses, and files that can't be written.
pub fn simulate(scene: &str, out: &Path) -> Result<Summary, SimError> {
    Plan::new(scene, out)?.write(|| Ok(()))
}

impl Plan {
    /// As [`simulate`], but for writing it.
    ///
    /// # Errors
    /// What [`Scene::parse`] refuses, a name that is no recording's, and files that are there already and were not simulated.
    pub fn new(scene: &str, out: &Path) -> Result<Self, SimError> {
        let packed = out.extension().is_some_and(|e| e == "gz" || e == "zst");
        let plain = if packed { out.with_extension("") } else { out.to_path_buf() };
        let format = match plain.extension().and_then(|e| e.to_str()) {
            Some("npz") if !packed => Format::Npz,
            Some("pcapng") => Format::Capture,
            _ => return Err(SimError::Unwritable(out.to_path_buf())),
        };
        let (camera, truth) = (plain.with_extension("camera.toml"), plain.with_extension("truth.json"));
        // What has its truth beside it was simulated.
        if let Some(found) = occupied([out.into(), camera.clone()]).filter(|_| !truth.exists()) {
            return Err(SimError::Occupied(found));
        }
        let scene = match format {
            Format::Npz => Scene::parse(scene)?,
            Format::Capture => Scene::parse_for_packets(scene)?,
        };
        Ok(Self { scene, format, out: out.into(), camera, truth })
    }

    /// Writes it. `go_on` is asked again and again, and its error ends the work. Nothing is left of what went wrong.
    ///
    /// # Errors
    /// Files that can't be written, and what `go_on` says, as if it were the file's.
    pub fn write(self, mut go_on: impl FnMut() -> io::Result<()>) -> Result<Summary, SimError> {
        let Self { scene, format, out, camera, truth } = self;
        let keys = camera_toml(&scene.camera())?;
        let mut frames = || match format {
            Format::Npz => write_npz(&scene, File::create(&out)?, &mut go_on),
            // The highest level makes a third of blank frames, and nothing but heat of noisy ones.
            Format::Capture => write_capture(&scene, Output::create(&out, scene.is_blank().then_some(19))?, &mut go_on)?.finish(),
        };
        let told = || Ok(serde_json::to_writer(BufWriter::new(File::create(&truth)?), scene.truth())?);
        let failed = |path: &Path| {
            let path = path.to_path_buf();
            move |source| SimError::Write { path, source }
        };
        let written = frames().map_err(failed(&out));
        let written = written.and_then(|()| std::fs::write(&camera, keys).map_err(failed(&camera)));
        written.and_then(|()| told().map_err(failed(&truth))).inspect_err(|_| {
            for path in [&out, &camera, &truth] {
                // Of what was never begun there is nothing to remove.
                let _ = std::fs::remove_file(path);
            }
        })?;
        let objects = |f: &FrameTruth| f.balls.iter().map(|b| b.ball).chain(f.objects.iter().map(|o| o.object)).max();
        let balls = 1 + scene.truth().frames.iter().filter_map(objects).max().unwrap_or(0);
        let (frames, contacts) = (scene.truth().frames.len(), scene.truth().contacts.len());
        Ok(Summary { frames, balls, contacts, recording: out, camera, truth })
    }
}

/// Writes a scene's frames as npz: `timestamps_ns` `[N]` int64, and `disparity` or `depth_mm` `[N, 480, 640]` uint16.
///
/// # Errors
/// Whatever `out` refuses, and `go_on`, which is asked before each frame.
pub fn write_npz(scene: &Scene, out: impl Write + Seek, mut go_on: impl FnMut() -> io::Result<()>) -> io::Result<()> {
    // The same bytes whenever it is written. The highest level makes a quarter of blank frames, and nothing but heat of noisy ones.
    let level = scene.is_blank().then_some(9);
    let options = SimpleFileOptions::default().last_modified_time(zip::DateTime::default()).compression_level(level).large_file(true);
    let mut zip = ZipWriter::new(BufWriter::new(out));
    let camera = scene.camera();
    let frames = scene.truth().frames.len() as u64;
    zip.start_file("timestamps_ns.npy", options)?;
    write_header(&mut zip, "<i8", &[frames])?;
    for frame in &scene.truth().frames {
        zip.write_all(&frame.timestamp_ns.to_le_bytes())?;
    }
    zip.start_file(if matches!(camera.code, DepthCode::Depth { .. }) { "depth_mm.npy" } else { "disparity.npy" }, options)?;
    write_header(&mut zip, "<u2", &[frames, camera.height as u64, camera.width as u64])?;
    let (mut rendered, mut bytes) = (scene.frames(), Vec::new());
    while let Some(frame) = rendered.next_frame() {
        go_on()?;
        bytes.clear();
        bytes.extend(frame.samples.iter().flat_map(|s| s.to_le_bytes()));
        zip.write_all(&bytes)?;
    }
    zip.finish()?.flush()
}

/// Writes a scene as the capture of the Kinect that saw it, its own calibration first; the same bytes whenever it is written.
///
/// # Errors
/// Whatever `out` refuses, and `go_on`, which is asked before each packet.
pub fn write_capture<W: Write>(scene: &Scene, out: W, mut go_on: impl FnMut() -> io::Result<()>) -> io::Result<W> {
    let mut writer = Writer::new(out)?;
    let mut packets = Packets::new(scene);
    let mut begun = false;
    while let Some((bytes, arrival_ns)) = packets.next_packet() {
        go_on()?;
        if !core::mem::replace(&mut begun, true) {
            writer.introduce(Some(&zero_plane()), Packing::Eleven, arrival_ns)?;
        }
        writer.packet(bytes, arrival_ns)?;
    }
    writer.finish()
}

fn write_header(out: &mut impl Write, kind: &str, shape: &[u64]) -> io::Result<()> {
    let kind = npyz::DType::Plain(kind.parse().map_err(io::Error::other)?);
    npyz::WriteOptions::new_header_only().dtype(kind).shape(shape).writer(out).write_header_only().map(drop)
}

/// What an estimator is told of the camera, as `camera.toml`.
fn camera_toml(camera: &Camera) -> Result<String, SimError> {
    toml::to_string(&camera.to_config()).map_err(|e| SimError::BadValue {
        key: "camera".to_string(),
        value: String::new(),
        why: e.to_string(),
    })
}
