//! Scenes as files: `OUT.npz`, what the camera is (`OUT.camera.toml`), what really happened (`OUT.truth.json`).

use super::SimError;
use super::scene::Scene;
use crate::geometry::camera::{Camera, DepthCode};
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
    /// Throws.
    pub balls: usize,
    /// True contacts, seen or not.
    pub contacts: usize,
    /// `OUT.npz`.
    pub recording: PathBuf,
    /// `OUT.camera.toml`.
    pub camera: PathBuf,
    /// `OUT.truth.json`.
    pub truth: PathBuf,
}

/// Simulates `scene` (`NAME?key=value&…`) into `out` (`OUT.npz`), with camera and truth beside it. One frame is in memory at a time.
///
/// # Errors
/// What [`Scene::parse`] refuses, and files that can't be written.
pub fn simulate(scene: &str, out: &Path) -> Result<Summary, SimError> {
    if out.extension().is_none_or(|e| e != "npz") {
        return Err(SimError::NotNpz(out.to_path_buf()));
    }
    let scene = Scene::parse(scene)?;
    let (camera, truth) = (out.with_extension("camera.toml"), out.with_extension("truth.json"));
    let failed = |path: &Path| {
        let path = path.to_path_buf();
        move |source| SimError::Write { path, source }
    };
    File::create(out).and_then(|file| write_npz(&scene, file)).map_err(failed(out))?;
    std::fs::write(&camera, camera_toml(&scene.camera())?).map_err(failed(&camera))?;
    let json = File::create(&truth).map(BufWriter::new).and_then(|file| Ok(serde_json::to_writer(file, scene.truth())?));
    json.map_err(failed(&truth))?;
    let balls = 1 + scene.truth().frames.iter().flat_map(|f| &f.balls).map(|b| b.ball).max().unwrap_or(0);
    Ok(Summary {
        frames: scene.truth().frames.len(),
        balls,
        contacts: scene.truth().contacts.len(),
        recording: out.to_path_buf(),
        camera,
        truth,
    })
}

/// Writes a scene's frames as npz: `timestamps_ns` [N] int64, and `disparity` or `depth_mm` [N, 480, 640] uint16.
///
/// # Errors
/// Whatever `out` refuses.
pub fn write_npz(scene: &Scene, out: impl Write + Seek) -> io::Result<()> {
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
        bytes.clear();
        bytes.extend(frame.samples.iter().flat_map(|s| s.to_le_bytes()));
        zip.write_all(&bytes)?;
    }
    zip.finish()?.flush()
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
