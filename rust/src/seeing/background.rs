//! What is there without a ball: learned at first, then followed.

use super::image::Source;
use super::{Buffers, Seeing};
use crate::detect::background::{self, ROUND};
use crate::detect::foreground::{Sample, first_key_beyond};
use crate::geometry::camera::Camera;
use core::ops::Range;
use heapless::Vec;

impl Seeing<'_> {
    /// Learns the background of a frame; false where it is known.
    pub(super) fn learns<S: Sample>(&mut self, source: &mut impl Source<S>) -> bool {
        let pixels = self.camera.width * self.camera.height;
        let Buffers { limits, farthest, .. } = &mut self.buffers;
        let (Some(limits), Some(farthest)) = (limits.get_mut(..pixels), farthest.get_mut(..pixels)) else { return true };
        if self.seen == 0 {
            limits.fill(0);
            farthest.fill(0);
        }
        let learning = self.seen < self.background_frames;
        if learning {
            let (width, beyond) = (self.camera.width, first_key_beyond::<S>(&self.coding));
            let rows = limits.chunks_exact_mut(width).zip(farthest.chunks_exact_mut(width)).enumerate();
            rows.for_each(|(row, (limits, farthest))| {
                background::learn(source.glance(row, 0..width), &self.coding, beyond, limits, farthest);
            });
        }
        if self.seen == self.background_frames {
            background::limit::<S>(&self.coding, self.background_frames, limits, farthest);
            let rows = limits.chunks_exact_mut(self.camera.width).zip(farthest.chunks_exact_mut(self.camera.width));
            let beyond = first_key_beyond::<S>(&self.coding);
            rows.for_each(|(limits, farthest)| background::bridge(beyond, limits, farthest));
            if let Some((environment, pose)) = &self.environment {
                for (index, (limit, shown)) in limits.iter_mut().zip(farthest).enumerate() {
                    let ray = self.camera.deproject((index % self.camera.width) as f64, (index / self.camera.width) as f64, 1.0);
                    if let Some(z) = environment.cast(&pose.translation, &(pose.rotation * ray), self.camera.max_depth) {
                        background::know::<S>(&self.coding, z, limit, shown);
                    }
                }
            }
            self.buffers.strangers.fill([0; 2]);
        }
        self.seen = self.seen.saturating_add(1).min(self.background_frames + 1);
        learning
    }

    /// Looks at some rows for slow change of the background, each once a [`ROUND`]; the columns of a row that are `kept` are none of it.
    pub(super) fn follow<S: Sample>(&mut self, source: &mut impl Source<S>, kept: impl Fn(&Camera, usize) -> Vec<Range<usize>, 16>) {
        if self.background_frames == 0 && self.environment.is_none() {
            return;
        }
        let Buffers { limits, farthest, strangers, .. } = &mut self.buffers;
        let Camera { width, height, .. } = self.camera;
        let beyond = first_key_beyond::<S>(&self.coding);
        for _ in 0..height.div_ceil(ROUND) {
            let (row, pixels) = (self.row, self.row * width..(self.row + 1) * width);
            self.row = (row + 1) % height;
            let (Some(limits), Some(farthest), Some(strangers)) =
                (limits.get_mut(pixels.clone()), farthest.get_mut(pixels.clone()), strangers.get_mut(pixels))
            else {
                return;
            };
            let kept = kept(&self.camera, row);
            background::follow(source.glance(row, 0..width), &self.coding, beyond, limits, farthest, strangers, &kept);
        }
    }
}
