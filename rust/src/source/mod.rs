//! Where frames and positions come from.
//!
//! A source knows its name and, if it has one, its camera, and hands out its inputs one by one, each with the stamp of the source's own clock.
//! It opens, reads and waits; it does not judge stamps, and knows nothing of physics.

mod capture;
mod csv;
mod decimal;
mod depth_png;
mod error;
mod fakenect;
mod faults;
mod faulty;
mod folder;
mod npz;
mod npz_layout;
mod npz_record;
mod order;
mod record;
mod recorder;
mod sidecar;
#[cfg(feature = "sim")]
mod simulated;
mod ticks;
mod tum;
#[cfg(feature = "usb")]
pub mod usb;
mod video;

pub use self::capture::Capture;
pub use self::csv::Csv;
pub use depth_png::read_png;
pub use error::SourceError;
pub use fakenect::Fakenect;
pub use faults::Faults;
pub use faulty::{Faulty, Injected};
pub use npz::Npz;
pub use record::{Recorded, Recording, Tape, Taped};
pub use recorder::{RecordError, Recorder};
#[cfg(feature = "sim")]
pub use simulated::Simulated;
pub use tum::Tum;
pub use video::{LatestVideo, VideoImage};

use crate::config::{CameraConfig, Config};
use crate::config_file::ConfigFileError;
use crate::event::{DisconnectReason, ReconnectReason};
use crate::geometry::camera::Camera;
use crate::kinect::calibration::ZeroPlane;
use crate::kinect::disparity::Packing;
use crate::math::{Mat3, Vec3};
use crate::seeing::Image;
use crate::track::Measurement;
use std::boxed::Box;
use std::path::{Path, PathBuf};
use std::string::String;
use std::sync::Arc;
use std::time::Duration;
use std::vec::Vec;

/// One input.
#[derive(Clone, Copy, Debug)]
pub enum Input<'a> {
    /// A depth image.
    Frame {
        /// Its stamp.
        timestamp_ns: i64,
        /// Its samples, as many as the source's camera has pixels.
        image: Image<'a>,
    },
    /// All positions of one instant; none: nothing was seen then.
    Positions {
        /// Its stamp.
        timestamp_ns: i64,
        /// World frame.
        positions: &'a [Measurement],
    },
    /// A packet of a Kinect's depth endpoint.
    Packet {
        /// All of it, its header first.
        bytes: &'a [u8],
        /// When it arrived, ns on the host's clock.
        arrival_ns: i64,
    },
    /// Nothing came for a while; who reads may stop.
    Silence,
    /// The device is gone. It may come back, or an error follows.
    Disconnected(DisconnectReason),
    /// The device is back; its own clock began anew.
    Reconnected(ReconnectReason),
}

/// What a source of packets knows of their Kinect.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Kinect {
    /// How its frames are packed.
    pub packing: Packing,
    /// Its own zero plane, if it told.
    pub zero_plane: Option<ZeroPlane>,
}

/// Anything that delivers packets, frames or positions.
pub trait Source: Send {
    /// How it calls itself: what the user named.
    fn name(&self) -> &str;

    /// The camera of its frames; `None` where it delivers positions.
    fn camera(&self) -> Option<Camera>;

    /// The Kinect whose packets it delivers; `None` where it delivers frames or positions.
    fn kinect(&self) -> Option<Kinect> {
        None
    }

    /// It goes on whether anyone reads or not, and is never silent for longer than 50 ms without saying [`Input::Silence`].
    fn is_live(&self) -> bool {
        false
    }

    /// Lets a device be away for so long, where it would otherwise end the stream.
    fn wait_for_return(&mut self, _patience: Duration) {}

    /// Where its newest video image is, if it has video.
    fn video(&self) -> Option<Arc<LatestVideo>> {
        None
    }

    /// What the user should know of it so far, a line each.
    fn remarks(&self) -> Vec<String> {
        Vec::new()
    }

    /// The next input, `None` at the end. May wait for it.
    ///
    /// # Errors
    /// The source broke; there is no next input.
    fn next_input(&mut self) -> Result<Option<Input<'_>>, SourceError>;
}

/// What can be opened, for messages.
const KINDS: &str = "kinect, kinect:SERIAL, *.npz (depth frames), *.pcap or *.pcapng (usbmon captures of a Kinect, also .gz, .zst), a folder with INDEX.txt (fakenect) or depth.txt (TUM), *.csv or - (positions), sim:SCENE, demo";

/// Opens what the user named. `camera` is what a camera file says that wins over those beside a recording, and over what a simulation tells;
/// `[camera]` in `config` wins over all, key by key.
///
/// # Errors
/// It isn't there, isn't what it claims to be, or this version has no such source.
pub fn open(source: &str, config: &Config, camera: Option<&CameraConfig>) -> Result<Box<dyn Source>, SourceError> {
    let radius = config.object.radius.as_slice().first().copied().unwrap_or(f64::NAN);
    if source == "-" {
        return Ok(Box::new(Csv::new("-", std::io::stdin(), radius)));
    }
    if is_kinect(source) {
        #[cfg(feature = "usb")]
        return Ok(Box::new(usb::Live::open(source, &camera_in_force(None, config, camera)?)?));
        #[cfg(not(feature = "usb"))]
        return Err(SourceError::NoDevice { source_name: source.into() });
    }
    if let Some((packets, faults)) = with_faults(source) {
        let faults = Faults::parse(faults).map_err(|what| SourceError::unknown(source, what))?;
        return Ok(Box::new(Faulty::new(source, open(packets, config, camera)?, faults)?));
    }
    #[cfg(feature = "sim")]
    if source.starts_with("sim:") {
        return Ok(Box::new(Simulated::new(source, &config.camera, camera)?));
    }
    let path = Path::new(source);
    let unknown = |why: &str| SourceError::unknown(source, std::format!("{why}; sources are {KINDS}"));
    if path.is_dir() {
        let keys = || sidecar::in_force(path, config, camera);
        return match [fakenect::INDEX, tum::INDEX].map(|index| path.join(index).is_file()) {
            [true, _] => Ok(Box::new(Fakenect::open(path, &keys()?)?)),
            [false, true] => Ok(Box::new(Tum::open(path, &keys()?)?)),
            [false, false] => Err(unknown("neither INDEX.txt nor depth.txt in this folder")),
        };
    }
    let extension = path.extension().map(|extension| extension.to_ascii_lowercase().to_string_lossy().into_owned());
    match extension.as_deref() {
        _ if capture::is_named_so(path) => Ok(Box::new(Capture::open(path, &sidecar::in_force(path, config, camera)?)?)),
        Some("npz") => Ok(Box::new(Npz::open(path, &sidecar::in_force(path, config, camera)?)?)),
        Some("csv") => Ok(Box::new(Csv::open(source, radius)?)),
        _ if source.is_empty() => Err(unknown("a source without a name")),
        _ => match std::fs::metadata(path) {
            Err(error) => Err(SourceError::unreadable(source, error)),
            Ok(_) => Err(unknown("the name doesn't say what it is")),
        },
    }
}

/// Whether it is a pipe, or the like: opening it waits for whoever writes to it.
pub fn may_be_silent(source: &str) -> bool {
    std::fs::metadata(file_of(source)).is_ok_and(|kind| !kind.is_file() && !kind.is_dir())
}

/// The file that it names, if it names one.
fn file_of(source: &str) -> &Path {
    Path::new(with_faults(source).map_or(source, |(packets, _)| packets))
}

/// Whether it names a live Kinect.
fn is_kinect(source: &str) -> bool {
    source.strip_prefix("kinect").is_some_and(|rest| rest.is_empty() || rest.starts_with([':', '?']))
}

/// The source and the faults that `FILE?key=value&…` names, unless that is a file's own name, and `sim:SCENE?packets=true&…?key=value&…`.
fn with_faults(source: &str) -> Option<(&str, &str)> {
    let (packets, faults) = source.rsplit_once('?')?;
    let is_simulated = packets.starts_with("sim:") && packets.contains('?');
    let path = Path::new(packets);
    let is_file = || (capture::is_named_so(path) || path.exists()) && !Path::new(source).exists();
    (is_simulated || is_file()).then_some((packets, faults))
}

/// The keys of `[camera]` in force for `source`: `config`'s, then those of `camera`, or of the file beside `source`, if that is a file itself.
///
/// # Errors
/// A camera file that can't be read, or says what can't be.
pub fn camera_in_force(source: Option<&str>, config: &Config, camera: Option<&CameraConfig>) -> Result<CameraConfig, ConfigFileError> {
    if let Some(file) = source.and_then(recording) {
        return sidecar::in_force(file, config, camera);
    }
    Ok(camera.map_or_else(|| config.camera.clone(), |camera| config.camera.or(camera)))
}

/// Where the camera file of `source` is, or would be; `None` of what has no place: a live Kinect, a simulated scene, stdin.
pub fn camera_file(source: &str) -> Option<PathBuf> {
    recording(source).map(sidecar::beside)
}

/// The file or folder that `source` names, if it is there.
fn recording(source: &str) -> Option<&Path> {
    Some(source).filter(|source| !is_kinect(source)).map(file_of).filter(|file| file.exists())
}

/// Positions farther out than this are taken for a mistake in units, m.
const FARTHEST: f64 = 1e6;

/// So many objects may be seen at one instant: what the engine takes.
pub const MOST_POSITIONS: usize = 16;

/// A measurement by some other tracker, checked.
///
/// # Errors
/// What is expected instead.
pub fn measurement(
    time_ns: i64,
    center: Vec3,
    covariance: Option<Mat3>,
    label: Option<u32>,
    radius: f64,
) -> Result<Measurement, &'static str> {
    if !center.iter().all(|x| x.abs() <= FARTHEST) {
        return Err("positions must be finite metres within 1e6 of the origin");
    }
    if let Some(covariance) = covariance {
        let scale = covariance.abs().max();
        if !(scale <= FARTHEST * FARTHEST && (covariance - covariance.transpose()).abs().max() <= 1e-9 * scale) {
            return Err("a covariance must be finite and symmetric, m²");
        }
        if nalgebra::Cholesky::new(covariance).is_none() {
            return Err("a covariance must be positive definite, m²");
        }
    }
    Ok(Measurement {
        time_ns,
        center,
        covariance,
        drift: Mat3::zeros(),
        center_in_camera: None,
        label,
        radius,
        points: None,
        residual_rms: None,
        whole: true,
    })
}
