//! Frames to balls: background, components, fits. It borrows its buffers, for images of any size, and allocates nothing.

use crate::config::ObjectConfig;
use crate::detect::background::{self, ROUND, Stranger};
use crate::detect::ball::{Found, ROOM, View};
use crate::detect::components::{CHUNK, Cluttered, Component, Marks, Run, connect};
pub use crate::detect::foreground::Area;
use crate::detect::foreground::{Coding, Frame, Sample, first_key_beyond};
use crate::detect::noise::{Factors, Noise};
use crate::detect::{Blob, Detection};
use crate::error::ConfigError;
use crate::geometry::camera::{Camera, DepthCode, Pose};
use crate::geometry::environment::Environment;
use crate::kinect::disparity::{HEIGHT, Packing, WIDTH};
use crate::simd::widest;
use core::cell::Cell;
use core::ops::{Deref, DerefMut, Range};
use heapless::Vec;

/// Smallest component that is looked at, px: below it, depth says too little of a ball.
const FEWEST_PIXELS: u32 = 20;
/// Likewise, rows: discs of so many pixels have more. So no component is missed where at first every so manyth row is looked at.
const FEWEST_ROWS: usize = 4;
/// Rows around foreground that are looked at as well: enough to see how a ball's silhouette ends.
const AROUND: usize = 8;

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
    /// Where balls are expected: no two in the same rows, ascending. None is the whole image.
    pub bands: &'s [Band],
}

/// One depth image, row by row.
#[derive(Clone, Copy, Debug)]
pub enum Image<'a> {
    /// Samples as the camera's code says: disparity, or depth in its units.
    U16(&'a [u16]),
    /// Metres; NaN, 0 or less is no reading.
    F32(&'a [f32]),
    /// Disparity as a Kinect v1 packs it, of a frame of its size.
    Packed {
        /// [`Packing::frame_bytes`] bytes.
        packed: &'a [u8],
        /// How it is packed.
        packing: Packing,
    },
}

/// Why an image can't be seen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SeeError {
    /// It does not have width × height samples.
    Size {
        /// Samples it should have.
        expected: usize,
        /// Samples it has.
        found: usize,
    },
    /// It does not have the bytes of a packed frame.
    Bytes {
        /// Bytes it should have.
        expected: usize,
        /// Bytes it has.
        found: usize,
    },
    /// It is packed, but the camera's images are not disparity of 640 × 480 pixels.
    Packed,
    /// The stream began with the other kind of samples.
    Kind,
}

impl core::fmt::Display for SeeError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Size { expected, found } => write!(f, "the image has {found} samples, the camera {expected} pixels"),
            Self::Bytes { expected, found } => write!(f, "the packed frame has {found} bytes instead of {expected}"),
            Self::Packed => write!(f, "only a camera of {WIDTH} × {HEIGHT} pixels of disparity packs its samples"),
            Self::Kind => write!(f, "a stream of integer samples can't change to floating point, nor back"),
        }
    }
}

impl core::error::Error for SeeError {}

/// A slice that is borrowed or, with `std`, owned.
pub enum Slice<'b, T> {
    /// The caller's.
    Borrowed(&'b mut [T]),
    /// Our own.
    #[cfg(feature = "std")]
    Owned(std::vec::Vec<T>),
}

impl<T> Deref for Slice<'_, T> {
    type Target = [T];
    fn deref(&self) -> &[T] {
        match self {
            Self::Borrowed(slice) => slice,
            #[cfg(feature = "std")]
            Self::Owned(slice) => slice,
        }
    }
}

impl<T> DerefMut for Slice<'_, T> {
    fn deref_mut(&mut self) -> &mut [T] {
        match self {
            Self::Borrowed(slice) => slice,
            #[cfg(feature = "std")]
            Self::Owned(slice) => slice,
        }
    }
}

impl<T> AsMut<[T]> for Slice<'_, T> {
    fn as_mut(&mut self) -> &mut [T] {
        self
    }
}

/// How many elements each buffer must have, at least.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sizes {
    /// Of `limits`, of `farthest` and of `strangers`.
    pub pixels: usize,
    /// Of `samples`: none where the images are not of the size that comes packed.
    pub samples: usize,
    /// Of `depths`.
    pub depths: usize,
    /// Of `marks`.
    pub rows: usize,
    /// Of `runs`; more of them, and more clutter is borne.
    pub runs: usize,
    /// Of `planes`.
    pub planes: usize,
}

/// The memory that [`Seeing`] works in; what it holds at first does not matter.
pub struct Buffers<'b> {
    /// For each pixel, where the background begins.
    pub limits: Slice<'b, u16>,
    /// For each pixel, the farthest reading while the background is learned, and then the background.
    pub farthest: Slice<'b, u16>,
    /// For each pixel, what it has lately shown in place of that.
    pub strangers: Slice<'b, Stranger>,
    /// A packed frame's samples.
    pub samples: Slice<'b, u16>,
    /// Depth of each disparity.
    pub depths: Slice<'b, f32>,
    /// For each row, where it shows foreground.
    pub marks: Slice<'b, Marks>,
    /// Runs of foreground.
    pub runs: Slice<'b, Run>,
    /// What one ball's pixels show and should show.
    pub planes: Slice<'b, f32>,
}

impl Buffers<'_> {
    /// Sizes for images of `width` × `height` pixels.
    pub const fn required(width: usize, height: usize) -> Sizes {
        let samples = if width == WIDTH && height == HEIGHT { WIDTH * HEIGHT } else { 0 };
        Sizes { pixels: width * height, samples, depths: 2048, rows: height, runs: width * height / 16 + 64, planes: ROOM }
    }
}

#[cfg(feature = "std")]
impl Buffers<'static> {
    /// Buffers of their own, for images of `width` × `height` pixels.
    pub fn owned(width: usize, height: usize) -> Self {
        let sizes = Self::required(width, height);
        Self {
            limits: Slice::Owned(std::vec![0; sizes.pixels]),
            farthest: Slice::Owned(std::vec![0; sizes.pixels]),
            strangers: Slice::Owned(std::vec![[0; 2]; sizes.pixels]),
            samples: Slice::Owned(std::vec![0; sizes.samples]),
            depths: Slice::Owned(std::vec![0.0; sizes.depths]),
            marks: Slice::Owned(std::vec![Marks::default(); sizes.rows]),
            runs: Slice::Owned(std::vec![Run::default(); sizes.runs]),
            planes: Slice::Owned(std::vec![0.0; sizes.planes]),
        }
    }
}

/// Sees balls of known radius in depth images.
pub struct Seeing<'b> {
    camera: Camera,
    coding: Coding,
    radii: Vec<f64, 4>,
    noise: Noise,
    factors: Factors,
    buffers: Buffers<'b>,
    background_frames: u32,
    environment: Option<(Environment, Pose)>,
    /// The row that is next looked at for slow change.
    row: usize,
    seen: u32,
    floating: Option<bool>,
    cluttered: u64,
}

impl<'b> Seeing<'b> {
    /// Sees the images of `camera`; the first `background_frames` teach what is there without a ball, 0 for none.
    ///
    /// # Errors
    /// No radius, a camera without pixels, or buffers that are too small for it (see [`Buffers::required`]).
    pub fn new(camera: &Camera, object: &ObjectConfig, background_frames: u32, mut buffers: Buffers<'b>) -> Result<Self, ConfigError> {
        let radii = Vec::from_slice(object.radius.as_slice()).unwrap_or_default();
        if radii.is_empty() || !radii.iter().all(|r| *r > 0.0 && r.is_finite()) {
            return Err(ConfigError { key: "object.radius", value: f64::NAN, expected: "1 to 4 lengths, m" });
        }
        if !(1..=8192).contains(&camera.width) || !(1..=8192).contains(&camera.height) {
            return Err(ConfigError { key: "camera.width", value: camera.width as f64, expected: "1 to 8192 px, and so the height" });
        }
        let sizes = Buffers::required(camera.width, camera.height);
        let enough = buffers.limits.len() >= sizes.pixels
            && buffers.farthest.len() >= sizes.pixels
            && buffers.strangers.len() >= sizes.pixels
            && buffers.samples.len() >= sizes.samples
            && buffers.depths.len() >= sizes.depths
            && buffers.marks.len() >= sizes.rows
            && buffers.runs.len() >= sizes.runs
            && buffers.planes.len() >= sizes.planes;
        if !enough {
            return Err(ConfigError { key: "camera.width", value: camera.width as f64, expected: "buffers of the camera's size" });
        }
        let coding = Coding::new(camera);
        coding.tabulate(&mut buffers.depths);
        Ok(Self {
            camera: *camera,
            coding,
            radii,
            noise: Noise::default(),
            factors: Factors::default(),
            buffers,
            background_frames,
            environment: None,
            row: 0,
            seen: 0,
            floating: None,
            cluttered: 0,
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
                let whole = samples
                    .get_mut(..WIDTH * HEIGHT)
                    .is_none_or(|samples| self.see_source(Packed { bytes: packed, packing, samples }, scope, detections));
                self.buffers.samples = samples;
                whole
            }
        })
    }

    fn see_source<S: Sample>(&mut self, mut source: impl Source<S>, scope: Scope<'_>, detections: &mut Vec<Detection, 16>) -> bool {
        if self.learns(&mut source) {
            return true;
        }
        let everywhere = Area { rows: 0..self.camera.height, columns: 0..self.camera.width };
        let mut found = Vec::new();
        let narrow = !scope.bands.is_empty()
            && scope.bands.iter().all(|band| {
                let before = found.len();
                let complete = self.search(&mut source, &band.area, scope.missing, &mut found) == Ok(true);
                let whole = found.iter().skip(before).filter(|ball| ball.detection.blob == Blob::Whole).count();
                complete && whole >= band.balls
            });
        if !narrow {
            found.clear();
            self.cluttered += u64::from(self.search(&mut source, &everywhere, scope.missing, &mut found).is_err());
        }
        self.follow(&mut source, &found);
        for ball in found {
            if ball.detection.blob == Blob::Whole {
                self.factors.cap.learn(ball.cap_ratio);
                self.factors.outline.learn(ball.outline_ratio);
            }
            let _ = detections.push(ball.detection);
        }
        !narrow
    }

    /// Learns the background of a frame; false where it is known.
    fn learns<S: Sample>(&mut self, source: &mut impl Source<S>) -> bool {
        let pixels = self.camera.width * self.camera.height;
        let Buffers { limits, farthest, .. } = &mut self.buffers;
        let (Some(limits), Some(farthest)) = (limits.get_mut(..pixels), farthest.get_mut(..pixels)) else { return true };
        if self.seen == 0 {
            limits.fill(0);
            farthest.fill(0);
        }
        let learning = self.seen < self.background_frames;
        if learning {
            (0..self.camera.height).for_each(|row| _ = source.part(row, 0..self.camera.width));
            background::learn(source.samples(), &self.coding, limits, farthest);
        }
        if self.seen == self.background_frames {
            background::limit::<S>(&self.coding, self.background_frames, limits, farthest);
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

    /// Looks at some rows for slow change of the background, each once a [`ROUND`]; what has been `found` is none of it.
    fn follow<S: Sample>(&mut self, source: &mut impl Source<S>, found: &[Found]) {
        if self.background_frames == 0 && self.environment.is_none() {
            return;
        }
        let Buffers { limits, farthest, strangers, .. } = &mut self.buffers;
        let Camera { width, height, fx, .. } = self.camera;
        let beyond = first_key_beyond::<S>(&self.coding);
        for _ in 0..height.div_ceil(ROUND) {
            let (row, pixels) = (self.row, self.row * width..(self.row + 1) * width);
            self.row = (row + 1) % height;
            let (Some(limits), Some(farthest), Some(strangers)) =
                (limits.get_mut(pixels.clone()), farthest.get_mut(pixels.clone()), strangers.get_mut(pixels))
            else {
                return;
            };
            let kept: Vec<Range<usize>, 16> = (found.iter())
                .filter_map(|ball| {
                    let (x, y) = self.camera.project(&ball.detection.center)?;
                    let reach = 1.5 * ball.detection.radius * fx / ball.detection.center.z + 4.0;
                    ((row as f64 - y).abs() < reach).then_some((x - reach) as usize..(x + reach) as usize + 1)
                })
                .collect();
            background::follow(source.part(row, 0..width), &self.coding, beyond, limits, farthest, strangers, &kept);
        }
    }

    /// Searches `area` for balls that lie wholly in it. False where more of the image is needed to see them as they are.
    fn search<S: Sample>(
        &mut self,
        source: &mut impl Source<S>,
        area: &Area,
        missing: &[Range<usize>],
        found: &mut Vec<Found, 16>,
    ) -> Result<bool, Cluttered> {
        let Camera { width, height, .. } = self.camera;
        let Area { rows, columns } = area;
        if rows.start >= rows.end || rows.end > height || columns.start >= columns.end || columns.end > width {
            return Ok(false);
        }
        let columns = columns.start / CHUNK * CHUNK..(columns.end.div_ceil(CHUNK) * CHUNK).min(width);
        let area = Area { rows: rows.clone(), columns };
        let before = found.len();
        for stride in [FEWEST_ROWS, 1] {
            self.look_at(source, &area, stride);
            found.truncate(before);
            if self.search_marked(source, &area, missing, found)? {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// Marks the foreground in every `stride`th row, and in all rows around those that show any.
    fn look_at<S: Sample>(&mut self, source: &mut impl Source<S>, area: &Area, stride: usize) {
        let Buffers { limits, marks, .. } = &mut self.buffers;
        let (width, coding) = (self.camera.width, &self.coding);
        let Area { rows, columns } = area;
        let Some(marks) = marks.get_mut(rows.clone()) else { return };
        widest(
            #[inline(always)]
            || {
                for (row, marks) in rows.clone().zip(&mut *marks) {
                    *marks = if row % stride == 0 { mark(source, row, columns, limits, width, coding) } else { Marks::default() };
                }
                for seen in (0..marks.len()).filter(|i| (rows.start + i) % stride == 0) {
                    if marks.get(seen).is_none_or(|marks| marks.is_empty()) {
                        continue;
                    }
                    for (i, marks) in marks.iter_mut().enumerate().take(seen + AROUND + 1).skip(seen.saturating_sub(AROUND)) {
                        if !marks.looked_at {
                            *marks = mark(source, rows.start + i, columns, limits, width, coding);
                        }
                    }
                }
            },
        );
    }

    /// Searches what is marked of `area`.
    fn search_marked<S: Sample>(
        &mut self,
        source: &mut impl Source<S>,
        area: &Area,
        missing: &[Range<usize>],
        found: &mut Vec<Found, 16>,
    ) -> Result<bool, Cluttered> {
        let Buffers { limits, marks, depths, runs, planes, .. } = &mut self.buffers;
        let Camera { width, height, .. } = self.camera;
        let Some(marks) = marks.get(area.rows.clone()) else { return Ok(false) };
        let frame = Frame {
            samples: source.samples(),
            width,
            at_hand: area.clone(),
            marks,
            asked_beyond: Cell::new(false),
            limits,
            depths,
            coding: self.coding,
            missing,
        };
        let smallest = self.radii.iter().copied().fold(f64::INFINITY, f64::min);
        let count = connect(&frame, width, area.rows.start, marks, View::<S>::jump(smallest), self.noise, runs)?;
        // What touches an edge may go on beyond.
        let inside = |first_and_last: &[u16; 2], area: &Range<usize>, end: usize| {
            let [first, last] = first_and_last.map(usize::from);
            (first > area.start || area.start == 0) && (last + 1 < area.end || area.end == end)
        };
        let whole = |c: &Component| inside(&c.rows, &area.rows, height) && inside(&c.columns, &area.columns, width);
        let components = runs.iter().take(count).enumerate().filter_map(|(index, run)| run.component(index));
        for component in
            components.filter(|c| c.pixels >= FEWEST_PIXELS && usize::from(c.rows[1] - c.rows[0]) + 1 >= FEWEST_ROWS && whole(c))
        {
            let view = |radius| View { frame: &frame, camera: &self.camera, noise: self.noise, factors: self.factors, radius };
            let Some(ball) = look(view, &self.radii, component, planes) else { continue };
            // Two pieces of one ball, on both sides of a hole.
            let is_known = |known: &Found| (known.detection.center - ball.detection.center).norm() < known.detection.radius;
            if !missing.is_empty() && found.iter().any(is_known) {
                continue;
            }
            if found.push(ball).is_err() {
                break;
            }
        }
        Ok(!frame.asked_beyond.get())
    }
}

/// Marks the foreground in some columns of a row.
#[inline(always)]
#[allow(clippy::inline_always)] // So that it is compiled for the registers of `widest`.
fn mark<S: Sample>(
    source: &mut impl Source<S>,
    row: usize,
    columns: &Range<usize>,
    limits: &[u16],
    width: usize,
    coding: &Coding,
) -> Marks {
    let limits = limits.get(row * width + columns.start..row * width + columns.end).unwrap_or_default();
    Marks::of(source.part(row, columns.clone()), limits, columns.start, width, coding)
}

/// An image that can be read part by part.
trait Source<S> {
    /// The samples of some columns of a row.
    fn part(&mut self, row: usize, columns: Range<usize>) -> &[S];
    /// All samples; those that were not read by now may be wrong.
    fn samples(&self) -> &[S];
}

struct Plain<'a, S> {
    samples: &'a [S],
    width: usize,
}

impl<S> Source<S> for Plain<'_, S> {
    #[inline]
    fn part(&mut self, row: usize, columns: Range<usize>) -> &[S] {
        self.samples.get(row * self.width + columns.start..row * self.width + columns.end).unwrap_or_default()
    }

    fn samples(&self) -> &[S] {
        self.samples
    }
}

struct Packed<'a> {
    bytes: &'a [u8],
    packing: Packing,
    samples: &'a mut [u16],
}

impl Source<u16> for Packed<'_> {
    #[inline]
    fn part(&mut self, row: usize, columns: Range<usize>) -> &[u16] {
        let part = row * WIDTH + columns.start..row * WIDTH + columns.end;
        match self.packing.unpack_part(self.bytes, self.samples, part.clone()) {
            Ok(()) => self.samples.get(part).unwrap_or_default(),
            // Its size was checked.
            Err(_) => &[],
        }
    }

    fn samples(&self) -> &[u16] {
        self.samples
    }
}

/// The ball that a component is, if it can be one: the radius whose disc comes nearest in size.
fn look<'v, S: Sample + 'v>(view: impl Fn(f64) -> View<'v, S>, radii: &[f64], component: &Component, room: &mut [f32]) -> Option<Found> {
    let (column, row, depth) = component.mean();
    let pixels = f64::from(component.pixels);
    // Seen from the front, the mean depth of a cap is that of its center less two thirds of the radius.
    let start = |radius: f64| view(radius).camera.deproject(column, row, depth + radius * 2.0 / 3.0);
    let ratio = |radius: f64| pixels / view(radius).disc(&start(radius));
    let mismatch = |radius: f64| crate::math::log(ratio(radius)).abs();
    let radius = radii.iter().copied().min_by(|a, b| mismatch(*a).total_cmp(&mismatch(*b)))?;
    if !(0.25..4.0).contains(&ratio(radius)) {
        return None;
    }
    let view = view(radius);
    let found = view.fit(start(radius), component.pixels, room)?;
    if view.frame.missing.is_empty() {
        return Some(found);
    }
    // A hole may leave only a piece of the ball, whose middle is not the ball's: begin again at what the piece led to.
    view.fit(found.detection.center, component.pixels, room)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{CameraConfig, Radii};
    use crate::geometry::camera::DepthCode;
    use crate::math::Vec3;
    use std::vec::Vec as StdVec;

    fn camera() -> Camera {
        Camera::from_config(&CameraConfig::default(), DepthCode::Depth { units_per_metre: 1000.0 }).unwrap()
    }

    /// Depth in metres of balls (center, radius) before a wall at `wall` m, each reading the mean of its ball over a matching window.
    fn image(camera: &Camera, balls: &[(Vec3, f64)], wall: f64) -> StdVec<f32> {
        let (width, height) = (camera.width, camera.height);
        let surface = |i: usize| {
            let ray = camera.deproject((i % width) as f64, (i / width) as f64, 1.0);
            let depth = |(c, r): &(Vec3, f64)| {
                let (a, b) = (ray.norm_squared(), ray.dot(c));
                let square = b * b - a * (c.norm_squared() - r * r);
                (square > 0.0).then(|| (b - crate::math::sqrt(square)) / a)
            };
            balls.iter().enumerate().filter_map(|(ball, b)| Some((ball, depth(b)?))).min_by(|a, b| a.1.total_cmp(&b.1))
        };
        let surfaces: StdVec<_> = (0..width * height).map(surface).collect();
        let reading = |i: usize| {
            let Some((ball, _)) = surfaces[i] else { return wall as f32 };
            let (x, y) = (i % width, i / width);
            let rows = y.saturating_sub(3)..(y + 4).min(height);
            let window = rows.flat_map(|y| (x.saturating_sub(4)..(x + 5).min(width)).map(move |x| y * width + x));
            let depths: StdVec<f64> = window.filter_map(|i| surfaces[i].filter(|s| s.0 == ball)).map(|s| s.1).collect();
            (depths.iter().sum::<f64>() / depths.len() as f64) as f32
        };
        (0..width * height).map(reading).collect()
    }

    fn balls_seen(camera: &Camera, radius: Radii, images: &[StdVec<f32>]) -> Vec<Detection, 16> {
        let object = ObjectConfig { radius, ..ObjectConfig::default() };
        let frames = images.len() as u32 - 1;
        let mut seeing = Seeing::new(camera, &object, frames, Buffers::owned(camera.width, camera.height)).unwrap();
        let mut found = Vec::new();
        for image in images {
            assert!(found.is_empty());
            seeing.see(Image::F32(image), &mut found).unwrap();
        }
        found
    }

    #[test]
    fn a_perfect_ball_is_where_it_is() {
        let camera = camera();
        for center in [Vec3::new(0.0, 0.0, 1.0), Vec3::new(0.3, -0.2, 1.5), Vec3::new(-0.8, 0.4, 2.0), Vec3::new(0.1, 0.1, 0.5)] {
            let found = balls_seen(&camera, Radii::one(0.033), &[image(&camera, &[(center, 0.033)], f64::NAN)]);
            assert_eq!(found.len(), 1, "{center}");
            assert_eq!(found[0].blob, Blob::Whole, "{center}");
            let error = found[0].center - center;
            // The pixels alone leave 0.1 px of the silhouette open, and linearisation some more.
            assert!(error.norm() < 0.1 * center.z / camera.fx + 1e-4, "{error}");
            assert!((found[0].row - (center.y / center.z * camera.fy + camera.cy)).abs() < 0.1);
        }
    }

    #[test]
    fn a_ball_before_a_wall_is_seen_with_and_without_its_background() {
        let camera = camera();
        let center = Vec3::new(0.1, -0.1, 1.5);
        let (wall, ball) = (image(&camera, &[], 2.5), image(&camera, &[(center, 0.033)], 2.5));
        for images in [StdVec::from([ball.clone()]), StdVec::from([wall.clone(), wall.clone(), wall.clone(), wall, ball.clone()])] {
            let found = balls_seen(&camera, Radii::one(0.033), &images);
            assert_eq!(found.len(), 1);
            assert!((found[0].center - center).norm() < 3e-4);
        }
    }

    #[test]
    fn a_ball_does_not_burn_into_the_background() {
        let camera = camera();
        let ball = |x: f64| image(&camera, &[(Vec3::new(x, 0.0, 1.5), 0.033)], 2.5);
        let found = balls_seen(&camera, Radii::one(0.033), &[ball(0.0), ball(0.0), ball(0.2), ball(0.3), ball(0.0)]);
        assert_eq!(found.len(), 1);
        assert_eq!(found[0].blob, Blob::Whole);
    }

    #[test]
    fn cut_and_merged_balls_are_known_as_such() {
        let camera = camera();
        let blob = |balls: &[(Vec3, f64)]| balls_seen(&camera, Radii::one(0.033), &[image(&camera, balls, f64::NAN)]);
        let at_the_edge = Vec3::new(-319.5 / 575.8 * 1.5, 0.0, 1.5);
        assert!(blob(&[(at_the_edge, 0.033)]).iter().all(|d| d.blob == Blob::Cut));
        let ball = (Vec3::new(0.0, 0.0, 1.5), 0.033);
        let hidden = blob(&[ball, (Vec3::new(0.04, 0.0, 1.0), 0.033)]);
        assert_eq!(hidden.iter().filter(|d| d.blob == Blob::Cut).count(), 1);
        assert_eq!(hidden.iter().filter(|d| d.blob == Blob::Whole).count(), 1);
        let touching = blob(&[ball, (Vec3::new(0.05, 0.0, 1.5), 0.033)]);
        assert!(!touching.is_empty() && touching.iter().all(|d| d.blob == Blob::Merged));
    }

    #[test]
    fn of_several_radii_the_right_one_is_chosen() {
        let camera = camera();
        let balls = [(Vec3::new(-0.2, 0.0, 1.5), 0.02), (Vec3::new(0.2, 0.0, 1.5), 0.033)];
        let mut found = balls_seen(&camera, Radii::Many(Vec::from_slice(&[0.033, 0.02]).unwrap()), &[image(&camera, &balls, f64::NAN)]);
        assert_eq!(found.len(), 2);
        found.sort_by(|a, b| a.center.x.total_cmp(&b.center.x));
        for (detection, (center, radius)) in found.iter().zip(balls) {
            assert_eq!(detection.radius, radius);
            assert!((detection.center - center).norm() < 3e-4);
        }
    }

    #[test]
    fn a_resting_ball_is_seen_for_ever_and_a_box_put_down_is_not() {
        let camera = camera();
        let (at_rest, falling) = ((Vec3::new(-0.2, 0.1, 1.5), 0.033), (Vec3::new(0.2, 0.0, 1.5), 0.033));
        let (wall, scene, both) = (image(&camera, &[], 2.5), image(&camera, &[at_rest], 2.5), image(&camera, &[at_rest, falling], 2.2));
        let with_box = |image: &StdVec<f32>| -> StdVec<f32> {
            let in_box = |i: usize| (400..500).contains(&(i % 640)) && (150..350).contains(&(i / 640));
            image.iter().enumerate().map(|(i, z)| if in_box(i) { z.min(2.0) } else { *z }).collect()
        };
        let mut seeing = Seeing::new(&camera, &ObjectConfig::default(), 3, Buffers::owned(camera.width, camera.height)).unwrap();
        let mut found = Vec::new();
        (0..3).for_each(|_| seeing.see(Image::F32(&wall), &mut found).unwrap());
        let scene = with_box(&scene);
        for _ in 0..12 * ROUND {
            seeing.see(Image::F32(&scene), &mut found).unwrap();
            assert!(found.iter().any(|d| d.blob == Blob::Whole && (d.center - at_rest.0).norm() < 1e-3));
        }
        assert_eq!(found.len(), 1);
        // Before the box, as before the wall, a ball is seen at once.
        seeing.see(Image::F32(&with_box(&both)), &mut found).unwrap();
        assert_eq!(found.iter().filter(|d| d.blob == Blob::Whole).count(), 2);
    }

    #[test]
    fn before_a_known_environment_a_ball_is_seen_in_the_first_frame() {
        let camera = camera();
        let mut config = crate::config::EnvironmentConfig::default();
        let wall = crate::config::KnownPlane { normal: [0.0, -1.0, 0.0], offset: -2.0, ..Default::default() };
        config.plane.push(wall).unwrap();
        // The box is not where it is said to be: half of it is seen as foreground, and a ball before it is still a ball.
        config.r#box.push(crate::config::KnownBox { center: [0.5, 1.9, 0.0], size: [0.2; 3], ..Default::default() }).unwrap();
        let balls = [(Vec3::new(0.0, 0.0, 1.5), 0.033), (Vec3::new(0.45, 0.0, 1.2), 0.033)];
        let image = image(&camera, &balls, 2.0);
        let see = |known: bool| {
            let mut seeing = Seeing::new(&camera, &ObjectConfig::default(), 0, Buffers::owned(camera.width, camera.height)).unwrap();
            if known {
                seeing.know(Environment::new(&config), Pose::renamed_axes());
            }
            let mut found = Vec::new();
            seeing.see(Image::F32(&image), &mut found).unwrap();
            found
        };
        let found = see(true);
        assert_eq!(found.len(), 2);
        for (ball, _) in balls {
            assert!(found.iter().any(|d| d.blob == Blob::Whole && (d.center - ball).norm() < 1e-3), "{found:?}");
        }
    }

    #[test]
    fn of_two_balls_that_cross_none_is_wrongly_taken_for_whole() {
        let camera = camera();
        for (depth, gap) in [(1.5, 0.0), (1.52, 0.0), (1.56, 0.002), (1.65, 0.01), (1.9, 0.0)] {
            for step in -20..=20 {
                let balls = [(Vec3::new(0.0, gap, 1.5), 0.033), (Vec3::new(0.004 * f64::from(step), 0.01, depth), 0.033)];
                if (balls[0].0 - balls[1].0).norm() < 0.066 {
                    continue;
                }
                for found in balls_seen(&camera, Radii::one(0.033), &[image(&camera, &balls, f64::NAN)]) {
                    let error = balls.iter().map(|b| (b.0 - found.center).norm()).fold(f64::INFINITY, f64::min);
                    assert!(found.blob != Blob::Whole || error < 3e-3, "{step} at {depth}: {error}");
                }
            }
        }
    }
}
