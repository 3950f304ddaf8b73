//! A simulated scene, seen as it is rendered.

use super::{Input, Source, SourceError};
use crate::geometry::camera::Camera;
use crate::seeing::Image;
use crate::sim::{Frames, Scene};
use std::string::{String, ToString};

/// The frames of `sim:SCENE`.
pub struct Simulated {
    name: String,
    camera: Camera,
    frames: Frames,
}

impl Simulated {
    /// The scene that `name` (`sim:SCENE?key=value&…`) tells of.
    ///
    /// # Errors
    /// An unknown scene or key, or a value that can't be.
    pub fn new(name: &str) -> Result<Self, SourceError> {
        let scene = Scene::parse(name.trim_start_matches("sim:")).map_err(|error| SourceError::malformed(name, error.to_string()))?;
        Ok(Self { name: name.into(), camera: scene.camera(), frames: scene.frames() })
    }
}

impl Source for Simulated {
    fn name(&self) -> &str {
        &self.name
    }

    fn camera(&self) -> Option<Camera> {
        Some(self.camera)
    }

    fn next_input(&mut self) -> Result<Option<Input<'_>>, SourceError> {
        let frame = self.frames.next_frame();
        Ok(frame.map(|frame| Input::Frame { timestamp_ns: frame.timestamp_ns, image: Image::U16(frame.samples) }))
    }
}
