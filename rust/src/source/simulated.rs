//! A simulated scene, seen as it is rendered: frames, or packets.

use super::{Input, Kinect, Source, SourceError};
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
    /// The scene that `name` (`sim:SCENE?key=value&…`) tells of.
    ///
    /// # Errors
    /// An unknown scene or key, or a value that can't be.
    pub fn new(name: &str) -> Result<Self, SourceError> {
        let scene = Scene::parse(name.trim_start_matches("sim:")).map_err(|error| SourceError::unknown(name, error.to_string()))?;
        let shown = if scene.truth().parameters.packets {
            Shown::Packets(Box::new(Packets::new(&scene)))
        } else {
            Shown::Frames(Box::new(scene.frames()))
        };
        Ok(Self { name: name.into(), camera: scene.camera(), shown })
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
