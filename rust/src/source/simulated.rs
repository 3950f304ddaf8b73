//! A simulated scene, seen as it is rendered: frames, or packets.

use super::folder::check_size;
use super::{Input, Kinect, Source, SourceError};
use crate::config::CameraConfig;
use crate::geometry::camera::Camera;
use crate::kinect::disparity::Packing;
use crate::seeing::Image;
use crate::sim::packets::zero_plane;
use crate::sim::{Frames, Packets, Scene};
use std::boxed::Box;
use std::string::{String, ToString};

/// The frames of `sim:SCENE`, or with its key `packets` the packets.
pub struct Simulated {
    name: String,
    camera: Camera,
    shown: Shown,
}

enum Shown {
    Frames(Box<Frames>),
    Packets(Box<Packets>),
}

impl Simulated {
    /// The scene that `name` (`sim:SCENE?key=value&…`) tells of. Of its camera is told what `keys` say, then what `instead` says, or else the
    /// scene; the images are the scene's.
    ///
    /// # Errors
    /// An unknown scene or key, a value that can't be, or a camera that can't have taken its images.
    pub fn new(name: &str, keys: &CameraConfig, instead: Option<&CameraConfig>) -> Result<Self, SourceError> {
        let scene = Scene::parse(name.trim_start_matches("sim:")).map_err(|error| SourceError::unknown(name, error.to_string()))?;
        let shown = if scene.truth().parameters.packets {
            Shown::Packets(Box::new(Packets::new(&scene)))
        } else {
            Shown::Frames(Box::new(scene.frames()))
        };
        let own = scene.camera();
        let camera = Camera::from_config(&keys.or(instead.unwrap_or(&own.to_config())), own.code)?;
        check_size(&camera, [own.width as u64, own.height as u64]).map_err(|what| SourceError::malformed(name, what))?;
        Ok(Self { name: name.into(), camera, shown })
    }
}

impl Source for Simulated {
    fn name(&self) -> &str {
        &self.name
    }

    fn camera(&self) -> Option<Camera> {
        Some(self.camera)
    }

    fn kinect(&self) -> Option<Kinect> {
        matches!(self.shown, Shown::Packets(_)).then(|| Kinect { packing: Packing::Eleven, zero_plane: Some(zero_plane()) })
    }

    fn next_input(&mut self) -> Result<Option<Input<'_>>, SourceError> {
        Ok(match &mut self.shown {
            Shown::Frames(frames) => {
                frames.next_frame().map(|frame| Input::Frame { timestamp_ns: frame.timestamp_ns, image: Image::U16(frame.samples) })
            }
            Shown::Packets(packets) => packets.next_packet().map(|(bytes, arrival_ns)| Input::Packet { bytes, arrival_ns }),
        })
    }
}
