//! A usbmon capture of a Kinect as a source.

use super::{Input, Kinect, Source, SourceError};
use crate::capture::Packets;
use crate::config::CameraConfig;
use crate::geometry::camera::{Camera, DepthCode, KINECT_DISPARITY_LAW};
use std::path::{Path, PathBuf};
use std::string::{String, ToString};
use std::vec::Vec;

/// Reads the depth packets of the first Kinect in a capture.
pub struct Capture {
    name: String,
    camera: Camera,
    packets: Packets,
}

impl Capture {
    /// Opens the capture at `path`. The law of depth is that of `keys`, else the camera's own, if the capture shows how it was asked for its
    /// zero plane, else that of one real Kinect; likewise the focal length.
    ///
    /// # Errors
    /// It can't be read, is no capture of a Kinect, or the camera can't be.
    pub fn open(path: &Path, keys: &CameraConfig) -> Result<Self, SourceError> {
        let name = path.display().to_string();
        let packets = Packets::open(path).map_err(|error| SourceError::unreadable(&name, error))?;
        let packets = packets.map_err(|what| SourceError::malformed(&name, what))?;
        let plane = packets.zero_plane();
        let law = plane.map_or(KINECT_DISPARITY_LAW, |plane| plane.law());
        let focal_length = plane.map(|plane| plane.focal_length_px());
        let keys = CameraConfig { fx: keys.fx.or(focal_length), fy: keys.fy.or(focal_length), ..keys.clone() };
        let camera = Camera::from_config(&keys, DepthCode::Disparity { law })?;
        Ok(Self { name, camera, packets })
    }
}

impl Source for Capture {
    fn name(&self) -> &str {
        &self.name
    }

    fn camera(&self) -> Option<Camera> {
        Some(self.camera)
    }

    fn kinect(&self) -> Option<Kinect> {
        Some(Kinect { packing: self.packets.packing(), zero_plane: self.packets.zero_plane() })
    }

    fn remarks(&self) -> Vec<String> {
        self.packets.remarks()
    }

    fn next_input(&mut self) -> Result<Option<Input<'_>>, SourceError> {
        match self.packets.next_packet() {
            Ok(packet) => Ok(packet.map(|(bytes, arrival_ns)| Input::Packet { bytes, arrival_ns })),
            Err(what) => Err(SourceError::malformed(&self.name, what)),
        }
    }
}

/// The name without what it says of packing: `.gz`, `.zst`.
pub(super) fn unpacked_name(path: &Path) -> PathBuf {
    let is_packed = |extension: &std::ffi::OsStr| extension.eq_ignore_ascii_case("gz") || extension.eq_ignore_ascii_case("zst");
    if path.extension().is_some_and(is_packed) { path.with_extension("") } else { path.into() }
}

/// Whether the name is a capture's.
pub(super) fn is_named_so(path: &Path) -> bool {
    let extension = |known: &str| unpacked_name(path).extension().is_some_and(|extension| extension.eq_ignore_ascii_case(known));
    extension("pcap") || extension("pcapng")
}
