//! Where to look: what is tracked is looked for where it can be, and the whole image is searched every so often.

use crate::config::{Config, Shape};
use crate::detect::{Blob, Detection};
use crate::geometry::camera::{Camera, Pose};
use crate::math::{ceil, floor, sqrt};
use crate::reasoning::{Predictor, Reasoning};
use crate::seeing::{Area, Band};
use crate::time::{after, seconds_between};
use crate::track::association::TRACKS;
use heapless::Vec;

/// While all that is seen is tracked, the whole image is searched this often, s. What appears meanwhile is found so much later: three frames of a
/// Kinect, before it can have told where it flies.
const EVERYWHERE: f64 = 0.1;
/// An object is looked for within so many standard deviations of where the law puts it: as far as it is taken for the same one.
const GATE: f64 = 5.5;
/// Rows and columns beyond that, px: for the noise of its measurement and of its silhouette, and so that it is seen whole.
const MARGIN: f64 = 12.0;
/// More of the image than this is not worth to be told apart from all of it.
const MOST: f64 = 0.5;

/// What parts of the next frame are worth a look.
#[derive(Clone, Debug)]
pub struct Attention {
    /// Radius of the largest ball, m.
    radius: f64,
    /// When the whole image was last searched, ns.
    everywhere_ns: Option<i64>,
    /// Whether every blob that was seen then is a ball that is tracked.
    calm: bool,
    /// Whether things of any shape are looked for: always everywhere.
    any: bool,
}

impl Attention {
    /// For the objects that `config` tells of.
    pub fn new(config: &Config) -> Self {
        let radius = config.object.radius.as_slice().iter().copied().fold(0.0, f64::max);
        Self { radius, everywhere_ns: None, calm: false, any: config.object.shape == Shape::Any }
    }

    /// The bands in which a frame has to be searched; none where that is the whole image.
    pub fn bands(&self, timestamp_ns: i64, camera: &Camera, reasoning: &Reasoning) -> Vec<Band, TRACKS> {
        let recent = self.everywhere_ns.is_some_and(|last| seconds_between(last, timestamp_ns) < EVERYWHERE);
        if self.any || !self.calm || !recent {
            return Vec::new();
        }
        let pose = reasoning.world_from_camera();
        let mut bands: Vec<Band, TRACKS> = Vec::new();
        for predictor in reasoning.predictors() {
            let Some(band) = self.band(timestamp_ns, camera, &pose, &predictor) else { return Vec::new() };
            let _ = bands.push(band);
        }
        bands.sort_unstable_by_key(|band| band.area.rows.start);
        let mut apart: Vec<Band, TRACKS> = Vec::new();
        for band in bands {
            match apart.last_mut().filter(|last| last.area.rows.end >= band.area.rows.start) {
                Some(last) => {
                    let (area, more) = (&mut last.area, band.area);
                    area.rows.end = area.rows.end.max(more.rows.end);
                    area.columns = area.columns.start.min(more.columns.start)..area.columns.end.max(more.columns.end);
                    last.balls += band.balls;
                }
                None => _ = apart.push(band),
            }
        }
        let pixels: usize = apart.iter().map(|band| band.area.rows.len() * band.area.columns.len()).sum();
        if pixels as f64 > MOST * (camera.width * camera.height) as f64 { Vec::new() } else { apart }
    }

    fn band(&self, timestamp_ns: i64, camera: &Camera, pose: &Pose, predictor: &Predictor) -> Option<Band> {
        let row_time = camera.row_time();
        let at = |time_ns: i64| {
            let (center, covariance) = predictor.predict(time_ns);
            let center = pose.to_camera(&center);
            let pixel = camera.project(&center)?;
            Some((pixel, (GATE * sqrt(covariance.trace()) + self.radius) / center.z))
        };
        // The row says when the object is seen, and that in which row.
        let ((_, guess), _) = at(timestamp_ns)?;
        let ((column, row), reach) = if camera.readout > 0.0 { at(after(timestamp_ns, guess * row_time))? } else { at(timestamp_ns)? };
        let span = |middle: f64, half: f64, end: usize| {
            let [first, last] = [floor(middle - half), ceil(middle + half)].map(|pixel| pixel.clamp(0.0, end as f64) as usize);
            (first < last).then_some(first..last)
        };
        let rows = span(row, reach * camera.fy + MARGIN, camera.height)?;
        let columns = span(column, reach * camera.fx + MARGIN, camera.width)?;
        Some(Band { area: Area { rows, columns }, balls: 1 })
    }

    /// Learns what a frame showed: whether the `whole` image was searched, and how many objects are tracked now.
    pub fn saw(&mut self, timestamp_ns: i64, whole: bool, detections: &[Detection], tracks: usize) {
        if whole {
            self.everywhere_ns = Some(timestamp_ns);
            self.calm = detections.len() == tracks && detections.iter().all(|d| d.blob == Blob::Whole);
        }
    }
}
