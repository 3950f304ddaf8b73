//! The newest video image, for whoever wants to look: only the latest is kept, however slow he is.

use crate::kinect::video::Video;
use crate::stream::frame::Frame;
use core::ops::Range;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::vec::Vec;

/// An image of the colour or the infra-red camera.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct VideoImage {
    /// Of its last packet, on the clock of depth, ns.
    pub timestamp_ns: i64,
    /// What it shows.
    pub video: Video,
    /// Row by row; all ones where it is missing.
    pub samples: Vec<u16>,
    /// Ranges of samples that were lost on the way, ascending.
    pub missing: Vec<Range<usize>>,
}

/// Where the newest image is.
#[derive(Debug, Default)]
pub struct LatestVideo(Mutex<Option<VideoImage>>);

impl LatestVideo {
    /// Replaces what is there, in its place where nobody took it.
    #[cfg_attr(not(feature = "usb"), allow(dead_code))] // Only a device has video.
    pub(super) fn put(&self, frame: &Frame<'_, Video>) {
        let mut latest = self.lock();
        let video = frame.packing;
        let [rows, columns] = video.shape();
        let (mut samples, mut missing) = latest.take().map_or_else(Default::default, |image| (image.samples, image.missing));
        samples.resize(rows * columns, 0);
        missing.clear();
        missing.extend(frame.missing());
        if video.unpack(frame.packed, &mut samples).is_ok() {
            *latest = Some(VideoImage { timestamp_ns: frame.timestamp_ns, video, samples, missing });
        }
    }

    /// The newest image, if there was one since it was last taken.
    pub fn take(&self) -> Option<VideoImage> {
        self.lock().take()
    }

    fn lock(&self) -> MutexGuard<'_, Option<VideoImage>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
