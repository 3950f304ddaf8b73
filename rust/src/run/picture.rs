//! The newest depth image, for whoever wants to look: only the latest is kept, however slow he is.

use crate::geometry::camera::{Camera, DepthCode};
use crate::kinect::disparity::{HEIGHT, WIDTH};
use crate::seeing::Image;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::vec::Vec;

/// A depth image.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Its stamp.
    pub timestamp_ns: i64,
    /// Index of the frame as delivered, from 0.
    pub frame: u64,
    /// Row by row.
    pub samples: Samples,
    /// What they say, and how many there are.
    pub camera: Camera,
}

/// What an image's pixels are.
#[derive(Clone, Debug, PartialEq)]
pub enum Samples {
    /// As the camera's code says.
    U16(Vec<u16>),
    /// Metres.
    F32(Vec<f32>),
}

impl Picture {
    /// Whether its samples are disparity.
    pub fn is_disparity(&self) -> bool {
        matches!(self.camera.code, DepthCode::Disparity { .. })
    }

    /// Depth in whole mm; 0 where there is no reading, or none that 16 bits can hold.
    pub fn depth_mm(&self) -> Vec<u16> {
        let mm = |depth: f64| if (0.0..65.5).contains(&depth) { libm::round(depth * 1000.0) as u16 } else { 0 };
        match &self.samples {
            Samples::U16(samples) => {
                let table: Vec<u16> = (0..=u16::MAX).map(|sample| self.camera.code.depth(sample).map_or(0, mm)).collect();
                samples.iter().map(|&sample| table[usize::from(sample)]).collect()
            }
            Samples::F32(samples) => samples.iter().map(|&depth| mm(depth.into())).collect(),
        }
    }
}

/// Where the newest image is.
#[derive(Debug, Default)]
pub struct Latest(Mutex<Option<Picture>>);

impl Latest {
    /// Replaces what is there, in its place where nobody took it.
    pub(super) fn put(&self, timestamp_ns: i64, frame: u64, image: Image<'_>, camera: Camera) {
        let mut latest = self.lock();
        let samples = match (image, latest.take().map(|picture| picture.samples)) {
            (Image::F32(depths), Some(Samples::F32(mut place))) if place.len() == depths.len() => {
                place.copy_from_slice(depths);
                Samples::F32(place)
            }
            (Image::F32(depths), _) => Samples::F32(depths.into()),
            (Image::U16(samples), Some(Samples::U16(mut place))) if place.len() == samples.len() => {
                place.copy_from_slice(samples);
                Samples::U16(place)
            }
            (Image::U16(samples), _) => Samples::U16(samples.into()),
            (Image::Packed { packed, packing }, place) => {
                let mut place = match place {
                    Some(Samples::U16(place)) => place,
                    _ => std::vec![0; WIDTH * HEIGHT],
                };
                if packing.unpack(packed, &mut place).is_err() {
                    return;
                }
                Samples::U16(place)
            }
        };
        *latest = Some(Picture { timestamp_ns, frame, samples, camera });
    }

    /// The newest image, if there was one since it was last taken.
    pub fn take(&self) -> Option<Picture> {
        self.lock().take()
    }

    fn lock(&self) -> MutexGuard<'_, Option<Picture>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::CameraConfig;

    #[test]
    fn only_the_newest_is_kept_and_handed_out_once() {
        let latest = Latest::default();
        let camera = Camera::from_config(&CameraConfig::default(), DepthCode::Depth { units_per_metre: 1000.0 }).unwrap();
        for (frame, image) in [Image::U16(&[1, 2]), Image::U16(&[3, 4]), Image::F32(&[0.5, f32::NAN, 70.0, -1.0])].into_iter().enumerate() {
            latest.put(7, frame as u64, image, camera);
        }
        let picture = latest.take().unwrap();
        assert_eq!((picture.timestamp_ns, picture.frame), (7, 2));
        assert_eq!(picture.depth_mm(), [500, 0, 0, 0]);
        assert_eq!(latest.take(), None);
    }
}
