//! Frames to balls, or to things of any shape: background, components, fits. It borrows its buffers, for images of any size, and allocates nothing.

mod background;
mod buffers;
mod image;
mod planes;
mod search;
mod shapes;
mod structure;
mod survey;
#[cfg(test)]
mod tests;

pub use self::buffers::{Buffers, Sizes, Slice};
pub use self::image::{Image, SeeError};
pub use crate::detect::foreground::Area;

use self::image::{Packed, Plain, Source};
use self::shapes::Shapes;
use self::structure::{Shown, Structure};
use self::survey::Survey;
use crate::config::{ObjectConfig, Shape};
use crate::detect::ball::Found;
use crate::detect::foreground::{Coding, Sample};
use crate::detect::matching::Matching;
use crate::detect::noise::{Factors, Noise};
use crate::detect::{Blob, Detection};
use crate::error::ConfigError;
use crate::geometry::camera::{Camera, DepthCode, Pose};
use crate::geometry::environment::Environment;
use crate::kinect::disparity::{HEIGHT, WIDTH};
use core::ops::Range;
use heapless::Vec;

/// A part of an image in which to look for balls.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Band {
    /// Where: somewhat more may be searched.
    pub area: Area,
    /// How many whole balls there are to be found.
    pub balls: usize,
}

/// What is known of a frame before it is seen.
#[derive(Clone, Copy, Debug, Default)]
pub struct Scope<'s> {
    /// Samples that are missing: ascending ranges, row by row. They show nothing, and say nothing of a ball's silhouette.
    pub missing: &'s [Range<usize>],
    /// Where balls are expected: no two in the same rows, ascending. None is the whole image, in which things of any shape are always looked for.
    pub bands: &'s [Band],
    /// The frame's stamp, ns; left out, frames come 30 times a second. Of use for any shape only.
    pub timestamp_ns: Option<i64>,
}

/// Sees balls of known radius in depth images, or things of any shape.
///
/// Of any shape is whatever the background does not tell of: a thing that stands there while the background is learned is a part of it. At most
/// four are followed at once, each from where all of it is in view; one that was not measured for half a second is a new one when it comes back.
pub struct Seeing<'b> {
    camera: Camera,
    coding: Coding,
    radii: Vec<f64, 4>,
    noise: Noise,
    matching: Matching,
    factors: Factors,
    /// Of any shape, where that is what is looked for.
    shapes: Option<Shapes>,
    buffers: Buffers<'b>,
    background_frames: u32,
    environment: Option<(Environment, Pose)>,
    /// Static planes, where the camera moves, and what the newest frame shows of them.
    structure: Option<Structure>,
    shown: Shown,
    /// What can be touched of the background.
    survey: Survey,
    /// The row that is next looked at for slow change.
    row: usize,
    seen: u32,
    floating: Option<bool>,
    cluttered: u64,
    surplus: u64,
}

impl<'b> Seeing<'b> {
    /// Sees the images of `camera`; the first `background_frames` teach what is there without a ball, 0 for none.
    ///
    /// # Errors
    /// No radius, a camera without pixels, or buffers that are too small for it (see [`Buffers::required`]).
    pub fn new(camera: &Camera, object: &ObjectConfig, background_frames: u32, mut buffers: Buffers<'b>) -> Result<Self, ConfigError> {
        let radii = Vec::from_slice(object.radius.as_slice()).unwrap_or_default();
        let any = object.shape == Shape::Any;
        if radii.is_empty() || !radii.iter().all(|r| *r > 0.0 && r.is_finite()) {
            return Err(ConfigError { key: "object.radius", value: f64::NAN, expected: "1 to 4 lengths, m" });
        }
        if !(1..=8192).contains(&camera.width) || !(1..=8192).contains(&camera.height) {
            return Err(ConfigError { key: "camera.width", value: camera.width as f64, expected: "1 to 8192 px, and so the height" });
        }
        let sizes = Buffers::required(camera.width, camera.height);
        let lengths = [
            ("buffers.limits", buffers.limits.len(), sizes.pixels),
            ("buffers.farthest", buffers.farthest.len(), sizes.pixels),
            ("buffers.strangers", buffers.strangers.len(), sizes.pixels),
            ("buffers.samples", buffers.samples.len(), sizes.samples),
            ("buffers.depths", buffers.depths.len(), sizes.depths),
            ("buffers.marks", buffers.marks.len(), sizes.rows),
            ("buffers.runs", buffers.runs.len(), sizes.runs),
            ("buffers.planes", buffers.planes.len(), sizes.planes),
            ("buffers.clouds", buffers.clouds.len(), if any { sizes.clouds } else { 0 }),
        ];
        if let Some((key, length, _)) = lengths.into_iter().find(|(_, length, needed)| length < needed) {
            return Err(ConfigError { key, value: length as f64, expected: "as many elements as `Buffers::required` says, at least" });
        }
        let coding = Coding::new(camera);
        coding.tabulate(&mut buffers.depths);
        Ok(Self {
            camera: *camera,
            coding,
            radii,
            noise: Noise::default(),
            matching: Matching::default(),
            factors: Factors::default(),
            shapes: any.then(Shapes::default),
            buffers,
            background_frames,
            environment: None,
            structure: None,
            shown: Shown::new(),
            survey: if background_frames > 0 { Survey::Awaited } else { Survey::Over },
            row: 0,
            seen: 0,
            floating: None,
            cluttered: 0,
            surplus: 0,
        })
    }

    /// What `environment` has before the camera at `pose` is background from the first frame on. To be told before that.
    pub fn know(&mut self, environment: Environment, pose: Pose) {
        self.environment = Some((environment, pose));
    }

    /// How the noise of the balls seen so far compares with the model.
    pub fn factors(&self) -> Factors {
        self.factors
    }

    /// Frames in which nothing could be told apart because there were more pieces of foreground than the buffers hold.
    pub fn cluttered(&self) -> u64 {
        self.cluttered
    }

    /// Balls that were measured and not handed on, because a frame showed more than 16.
    pub fn surplus(&self) -> u64 {
        self.surplus
    }

    /// Whether [`Seeing::see`] would take `image`.
    ///
    /// # Errors
    /// The image is not the camera's.
    pub fn check(&self, image: Image<'_>) -> Result<(), SeeError> {
        let (found, floating) = match image {
            Image::U16(samples) => (samples.len(), false),
            Image::F32(samples) => (samples.len(), true),
            Image::Packed { packed, packing } => {
                let disparity = matches!(self.camera.code, DepthCode::Disparity { .. });
                if !disparity || (self.camera.width, self.camera.height) != (WIDTH, HEIGHT) {
                    return Err(SeeError::Packed);
                }
                if packed.len() != packing.frame_bytes() {
                    return Err(SeeError::Bytes { expected: packing.frame_bytes(), found: packed.len() });
                }
                (WIDTH * HEIGHT, false)
            }
        };
        let expected = self.camera.width * self.camera.height;
        if found != expected {
            return Err(SeeError::Size { expected, found });
        }
        if self.floating.is_some_and(|before| before != floating) { Err(SeeError::Kind) } else { Ok(()) }
    }

    /// Finds the balls of one frame; while the background is learned there are none. `detections` is emptied first.
    ///
    /// # Errors
    /// The image is not the camera's. Nothing has changed then.
    pub fn see(&mut self, image: Image<'_>, detections: &mut Vec<Detection, 16>) -> Result<(), SeeError> {
        self.see_in(image, Scope::default(), detections).map(|_| ())
    }

    /// Finds the balls that lie wholly in the bands of `scope`, just as they would be found in the whole image. Where a band does not show as many
    /// whole balls as it should, or there is none, the whole image is searched: then it returns true.
    ///
    /// # Errors
    /// As of [`Seeing::see`].
    pub fn see_in(&mut self, image: Image<'_>, scope: Scope<'_>, detections: &mut Vec<Detection, 16>) -> Result<bool, SeeError> {
        detections.clear();
        self.check(image)?;
        self.floating = Some(matches!(image, Image::F32(_)));
        let width = self.camera.width;
        Ok(match image {
            Image::U16(samples) => self.see_source(Plain { samples, width }, scope, detections),
            Image::F32(samples) => self.see_source(Plain { samples, width }, scope, detections),
            Image::Packed { packed, packing } => {
                let mut samples = core::mem::replace(&mut self.buffers.samples, Slice::Borrowed(&mut []));
                let whole = samples.get_mut(..WIDTH * HEIGHT).is_none_or(|samples| {
                    self.see_source(Packed { bytes: packed, packing, samples, glanced: [0; WIDTH] }, scope, detections)
                });
                self.buffers.samples = samples;
                whole
            }
        })
    }

    fn see_source<S: Sample>(&mut self, mut source: impl Source<S>, scope: Scope<'_>, detections: &mut Vec<Detection, 16>) -> bool {
        if self.learns(&mut source) {
            return true;
        }
        self.measure_structure(&mut source);
        self.survey(&mut source);
        if let Some(mut shapes) = self.shapes.take() {
            self.cluttered += u64::from(self.see_shapes(&mut source, &scope, &mut shapes, detections).is_err());
            self.follow(&mut source, |_, row| shapes.kept_in(row));
            self.shapes = Some(shapes);
            return true;
        }
        let everywhere = Area { rows: 0..self.camera.height, columns: 0..self.camera.width };
        let (mut found, matching, surplus) = (Vec::new(), self.matching, self.surplus);
        let narrow = !scope.bands.is_empty()
            && scope.bands.iter().all(|band| {
                let before = found.len();
                let complete = self.search(&mut source, &band.area, scope.missing, &mut found) == Ok(true);
                let whole = found.iter().skip(before).filter(|ball| ball.detection.blob == Blob::Whole).count();
                complete && whole >= band.balls
            });
        if !narrow {
            found.clear();
            (self.matching, self.surplus) = (matching, surplus);
            self.cluttered += u64::from(self.search(&mut source, &everywhere, scope.missing, &mut found).is_err());
        }
        self.matching.decide();
        self.follow(&mut source, |camera, row| kept(&found, camera, row));
        for ball in found {
            if ball.detection.blob == Blob::Whole {
                self.factors.cap.learn(ball.cap_ratio);
                self.factors.outline.learn(ball.outline_ratio);
            }
            let _ = detections.push(ball.detection);
        }
        !narrow
    }
}

/// The columns of `row` in which balls were found.
fn kept(found: &[Found], camera: &Camera, row: usize) -> Vec<Range<usize>, 16> {
    let columns = found.iter().filter_map(|ball| {
        let (x, y) = camera.project(&ball.detection.center)?;
        let reach = 1.5 * ball.detection.radius * camera.fx / ball.detection.center.z + 4.0;
        ((row as f64 - y).abs() < reach).then_some((x - reach) as usize..(x + reach) as usize + 1)
    });
    columns.collect()
}
