//! A structured-light depth camera: what it reads of balls, of things made of convex parts, and of visible solids.
//!
//! Rays through pixel centers meet what is there; each pixel then reads what fills most of its matching window (the mean
//! disparity over that object's pixels), with noise that neighbours share, rounded to whole raw units. What the projector
//! can't light has no reading, nor have surfaces seen too obliquely.

mod matching;
mod ray;

pub use self::ray::{Form, Place, Target};

use self::ray::Convex;
use super::impact::Solid;
use super::noise::{Field, Rect};
use crate::geometry::camera::{Camera, NO_DISPARITY, Pose};
use crate::math::Vec3;
use rand::SeedableRng;
use rand::rngs::Xoshiro256PlusPlus;
use std::vec::Vec;

/// Focal length, px.
pub const FOCAL: f64 = 575.8;
/// From the camera to the projector, along the camera's x, m: shadows fall to the left.
pub(super) const BASELINE: f64 = 0.075;
/// Raw disparity of a point at infinity.
pub(super) const RAW_AT_INFINITY: f64 = 1090.0;
/// Steps of raw disparity per pixel of disparity.
const RAW_PER_PIXEL: f64 = 8.0;
/// Temporal noise, raw units, before rounding.
const RAW_SD: f64 = 0.4;
/// Fixed noise of a static background, raw units.
const FROZEN_SD: f64 = 0.3;
/// Nearest and farthest depth that is read, m.
const RANGE: [f64; 2] = [0.4, 10.0];
/// Readings fade out between these angles of incidence, rad.
const GRAZING: [f64; 2] = [1.22, 1.40];
/// Most balls and parts of things in one frame.
pub const MAX_TARGETS: usize = 16;
/// Labels of a ray: nothing; in the projector's shadow; then what moves, then visible solids.
const NOTHING: usize = 0;
const SHADOW: usize = 1;
const TARGETS: usize = 2;
const SOLIDS: usize = TARGETS + MAX_TARGETS;

/// How the sensor errs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Errors {
    /// Factor on all noise.
    pub sigma: f64,
    /// Edge of the matching window, px, odd.
    pub window: usize,
    /// Noise of neighbouring pixels is independent.
    pub white: bool,
}

/// What a ray meets.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Hit {
    label: usize,
    depth: f64,
    /// Asked for once for each window that it is in.
    inverse_depth: f64,
    cos_incidence: f64,
}

const MISS: Hit = Hit { label: NOTHING, depth: f64::INFINITY, inverse_depth: 0.0, cos_incidence: 1.0 };

/// The sensor, and what it knows by heart: its background, for as long as it stands still.
#[derive(Clone, Debug)]
pub struct Sensor {
    camera: Camera,
    errors: Errors,
    solids: Vec<Convex>,
    /// Where it is since the first frame, own axes, at each row's time or at all.
    eyes: Vec<Vec3>,
    /// Mean raw disparity of each pixel with nothing moving, frozen noise included; infinite where nothing is read.
    background: Vec<f32>,
    /// Frozen noise belongs to the pixels, not to what they see: a camera that wobbles takes it along, and no average over its frames is rid of it.
    /// So does what decides which pixels lose an oblique surface.
    frozen: Vec<f32>,
    frozen_edge: Field,
    rng: Xoshiro256PlusPlus,
    noise: Field,
    edge: Field,
    hits: Vec<Hit>,
}

/// Raw disparity at depth `z`, m, not yet rounded.
fn raw_disparity(z: f64) -> f64 {
    (1.0 / z - disparity_law()[0]) / disparity_law()[1]
}

/// `[c0, c1]` of 1/z = c0 + c1 · raw, 1/m: disparity is baseline · focal / z pixels, eight steps of raw each.
pub fn disparity_law() -> [f64; 2] {
    let c1 = -1.0 / (RAW_PER_PIXEL * BASELINE * FOCAL);
    [-c1 * RAW_AT_INFINITY, c1]
}

impl Sensor {
    /// A sensor at `camera.pose` (required; its true intrinsics) that looks at `solids`.
    pub fn new(camera: Camera, errors: Errors, solids: &[Solid], seed: u64) -> Self {
        let pose = camera.pose.unwrap_or_else(Pose::renamed_axes);
        let solids: Vec<Convex> = solids.iter().filter(|s| s.visible).map(|s| Convex::new(s, &pose)).collect();
        let rng = Xoshiro256PlusPlus::seed_from_u64(seed);
        let mut sensor = Self {
            camera,
            errors,
            solids,
            eyes: std::vec![Vec3::zeros()],
            background: Vec::new(),
            frozen: Vec::new(),
            frozen_edge: Field::default(),
            rng,
            noise: Field::default(),
            edge: Field::default(),
            hits: Vec::new(),
        };
        if !sensor.solids.is_empty() {
            let image = sensor.image();
            sensor.noise.draw(&image, errors.window, &mut sensor.rng);
            sensor.frozen = sensor.noise.values.iter().map(|n| (FROZEN_SD * errors.sigma) as f32 * n).collect();
            sensor.frozen_edge.draw(&image, errors.window, &mut sensor.rng);
            sensor.look();
        }
        sensor
    }

    /// The background from where it is now.
    fn look(&mut self) {
        let (image, mut background) = (self.image(), core::mem::take(&mut self.background));
        background.clear();
        background.resize(image.width() * image.height(), f32::INFINITY);
        let edge = core::mem::take(&mut self.frozen_edge);
        self.match_windows(&image, &[], &edge, |index, raw| background[index] = raw);
        (self.frozen_edge, self.background) = (edge, background);
    }

    fn image(&self) -> Rect {
        Rect { left: 0, top: 0, right: self.camera.width as i32, bottom: self.camera.height as i32 }
    }

    /// One frame of raw disparity, row-major, into `samples` (width · height), [`NO_DISPARITY`] where nothing is read. `eyes` is where the camera is since
    /// the first frame, its own axes, m: one per row of the image, or one for all.
    pub fn expose(&mut self, targets: &[Target], eyes: &[Vec3], samples: &mut [u16]) {
        if self.eyes != eyes {
            self.eyes.clear();
            self.eyes.extend_from_slice(eyes);
            if !self.solids.is_empty() {
                self.look();
            }
        }
        let (image, window) = (self.image(), if self.errors.white { 1 } else { self.errors.window });
        let sd = (RAW_SD * self.errors.sigma) as f32;
        samples.fill(NO_DISPARITY);
        let blank = self.background.is_empty();
        let (mut noise, mut edge) = (core::mem::take(&mut self.noise), core::mem::take(&mut self.edge));
        if !blank {
            noise.draw(&image, window, &mut self.rng);
            for ((sample, raw), n) in samples.iter_mut().zip(&self.background).zip(&noise.values) {
                *sample = quantised(raw + sd * n);
            }
        }
        for rect in self.rects(targets) {
            if blank {
                noise.draw(&rect, window, &mut self.rng);
            }
            edge.draw(&rect, self.errors.window, &mut self.rng);
            let drawn = if blank { rect } else { image };
            self.match_windows(&rect, targets, &edge, |index, raw| {
                let (x, y) = ((index % image.width()) as i32, (index / image.width()) as i32);
                samples[index] = quantised(raw + sd * noise.values[drawn.index(x, y)]);
            });
        }
        (self.noise, self.edge) = (noise, edge);
    }

    /// Where the image differs from its background: around each target and its shadow; rectangles that overlap become one.
    fn rects(&self, targets: &[Target]) -> Vec<Rect> {
        let margin = self.errors.window as i32;
        let mut rects: Vec<Rect> = Vec::new();
        let alone = self.solids.is_empty() && targets.len() == 1;
        for target in targets {
            let Some(bounds) = self.bounds(target, if alone { 0.0 } else { BASELINE }) else { continue };
            let mut rect = bounds.grown(margin).intersection(&self.image());
            while let Some(i) = rects.iter().position(|r| !r.intersection(&rect).is_empty()) {
                rect = rects.swap_remove(i).union(&rect);
            }
            if !rect.is_empty() {
                rects.push(rect);
            }
        }
        rects
    }

    /// Where something may be seen, and its shadow from a projector `baseline` to the right.
    fn bounds(&self, target: &Target, baseline: f64) -> Option<Rect> {
        let c = &self.camera;
        let radius = target.reach();
        let bounds = target.places.iter().filter_map(|Place { center, .. }| {
            let (x, y) = c.project(center)?;
            let near = (center.z - radius).max(0.05);
            let reach = 1.1 * c.fx.max(c.fy) * radius / near;
            let shadow = baseline * c.fx / near;
            Some(Rect {
                left: (x - reach - shadow) as i32,
                top: (y - reach) as i32,
                right: (x + reach) as i32 + 1,
                bottom: (y + reach) as i32 + 1,
            })
        });
        bounds.reduce(|a, b| a.union(&b))
    }

    /// What the ray through pixel (`x`, `y`) meets; `bounds` are the targets' in the image.
    fn cast(&self, x: i32, y: i32, targets: &[Target], bounds: &[Rect]) -> Hit {
        let ray = self.camera.deproject(f64::from(x), f64::from(y), 1.0);
        let (camera, eye) = (Vec3::zeros(), self.eyes[y.clamp(0, self.eyes.len() as i32 - 1) as usize]);
        let near = targets.iter().zip(bounds).enumerate().filter(|(_, (_, bounds))| bounds.contains(x, y));
        let moving = near.map(|(i, (t, _))| (TARGETS + i, t.enter(y, &camera, &ray)));
        let solids = self.solids.iter().enumerate().map(|(i, s)| (SOLIDS + i, s.enter(&eye, &ray)));
        let hits = moving
            .chain(solids)
            .filter_map(|(label, hit)| hit.map(|(depth, cos_incidence)| Hit { label, depth, inverse_depth: depth.recip(), cos_incidence }));
        let Some(hit) = hits.min_by(|a, b| a.depth.total_cmp(&b.depth)) else { return MISS };
        if hit.depth < RANGE[0] || hit.depth > RANGE[1] {
            return MISS;
        }
        let projector = Vec3::new(BASELINE, 0.0, 0.0);
        // Stopped just before the surface, which must not shade itself.
        let beam = (ray * hit.depth - projector) * (1.0 - 1e-9);
        let shaded =
            targets.iter().enumerate().any(|(i, t)| TARGETS + i != hit.label && t.enter(y, &projector, &beam).is_some_and(|e| e.0 < 1.0))
                || self
                    .solids
                    .iter()
                    .enumerate()
                    .any(|(i, s)| SOLIDS + i != hit.label && s.enter(&(eye + projector), &beam).is_some_and(|e| e.0 < 1.0));
        if shaded { Hit { label: SHADOW, ..hit } } else { hit }
    }
}

/// To whole raw units.
fn quantised(raw: f32) -> u16 {
    if (0.0..f32::from(NO_DISPARITY) - 0.5).contains(&raw) { raw.round() as u16 } else { NO_DISPARITY }
}
