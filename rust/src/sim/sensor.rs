//! A structured-light depth camera: what it reads of balls, of things made of convex parts, and of visible solids.
//!
//! Rays through pixel centers meet what is there; each pixel then reads what fills most of its matching window (the mean
//! disparity over that object's pixels), with noise that neighbours share, rounded to whole raw units. What the projector
//! can't light has no reading, nor have surfaces seen too obliquely.

use super::impact::Solid;
use super::noise::{Field, Rect};
use crate::geometry::camera::{Camera, NO_DISPARITY, Pose};
use crate::math::{Mat3, Vec3};
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

/// A convex form.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Form {
    /// A sphere.
    Sphere {
        /// m.
        radius: f64,
    },
    /// A box.
    Box {
        /// Half of its edges, m.
        half: Vec3,
    },
}

/// Where a form is, camera frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// Its middle, m.
    pub center: Vec3,
    /// Its axes to the camera's.
    pub axes: Mat3,
}

/// Something that moves, as the sensor meets it: a ball, or a part of a rigid thing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Target<'a> {
    /// What it is.
    pub form: Form,
    /// Where it is at each row's time: one per row of the image, or one for all.
    pub places: &'a [Place],
}

impl Target<'_> {
    /// Radius of the sphere around it, m.
    fn reach(&self) -> f64 {
        match self.form {
            Form::Sphere { radius } => radius,
            Form::Box { half } => half.norm(),
        }
    }

    /// Where the ray `origin` + s · `ray` enters it at the time of `row`, s > 0, and the cosine of incidence.
    fn enter(&self, row: i32, origin: &Vec3, ray: &Vec3) -> Option<(f64, f64)> {
        let place = &self.places[row.clamp(0, self.places.len() as i32 - 1) as usize];
        match self.form {
            Form::Sphere { radius } => enter_sphere(origin, ray, &place.center, radius),
            Form::Box { half } => enter_box(&place.axes.tr_mul(&(origin - place.center)), &place.axes.tr_mul(ray), &half),
        }
    }
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

/// A solid in the camera frame at the first frame: inside is where every half-space holds, normal · p ≤ offset.
#[derive(Clone, Debug, PartialEq)]
struct Convex {
    sides: Vec<(Vec3, f64)>,
}

impl Convex {
    fn new(solid: &Solid, pose: &Pose) -> Self {
        let faces = (0..solid.faces()).map(|f| solid.face(f));
        let turned = |n: Vec3, offset: f64| (pose.rotation.transpose() * n, offset - n.dot(&pose.translation));
        Self { sides: faces.map(|(_, n, offset)| turned(n, offset)).collect() }
    }

    /// Where the ray `origin` + s · `ray` enters, s > 0, and the cosine of incidence.
    fn enter(&self, origin: &Vec3, ray: &Vec3) -> Option<(f64, f64)> {
        let (mut enter, mut leave, mut cos) = (0.0, f64::INFINITY, 1.0);
        for (normal, offset) in &self.sides {
            let (speed, gap) = (normal.dot(ray), offset - normal.dot(origin));
            if speed < 0.0 && gap / speed > enter {
                (enter, cos) = (gap / speed, -speed / ray.norm());
            } else if speed > 0.0 {
                leave = f64::min(leave, gap / speed);
            } else if gap < 0.0 && speed == 0.0 {
                return None;
            }
        }
        (enter > 0.0 && enter < leave).then_some((enter, cos))
    }
}

/// Where the ray s · `ray` from `origin` enters a sphere, s > 0, and the cosine of incidence.
fn enter_sphere(origin: &Vec3, ray: &Vec3, center: &Vec3, radius: f64) -> Option<(f64, f64)> {
    let (to, a) = (center - origin, ray.norm_squared());
    let b = to.dot(ray);
    let discriminant = b * b - a * (to.norm_squared() - radius * radius);
    if discriminant <= 0.0 {
        return None;
    }
    let root = discriminant.sqrt();
    let s = (b - root) / a;
    (s > 0.0).then(|| (s, root / (a.sqrt() * radius)))
}

/// Where the ray `origin` + s · `ray` enters the box of these half edges around the origin, s > 0, and the cosine of incidence.
fn enter_box(origin: &Vec3, ray: &Vec3, half: &Vec3) -> Option<(f64, f64)> {
    let (mut enter, mut leave, mut speed) = (0.0, f64::INFINITY, 0.0);
    // Most rays miss the sphere around it, which is cheaper.
    if origin.cross(ray).norm_squared() > half.norm_squared() * ray.norm_squared() {
        return None;
    }
    for i in 0..3 {
        // Infinite where the ray runs along the faces, with signs that make it miss or not.
        let (a, b) = ((-half[i] - origin[i]) / ray[i], (half[i] - origin[i]) / ray[i]);
        if a.min(b) > enter {
            (enter, speed) = (a.min(b), ray[i].abs());
        }
        leave = f64::min(leave, a.max(b));
    }
    (enter > 0.0 && enter < leave).then(|| (enter, speed / ray.norm()))
}

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

/// Which windows show one thing alone, row by row.
struct Alike {
    window: usize,
    /// Of each column: what its last row shows, and since how many rows.
    columns: Vec<(usize, usize)>,
}

impl Alike {
    fn new(width: usize, window: usize) -> Self {
        Self { window, columns: std::vec![(NOTHING, 0); width] }
    }

    fn enter(&mut self, row: &[Hit]) {
        for ((label, rows), hit) in self.columns.iter_mut().zip(row) {
            *rows = if *label == hit.label { *rows + 1 } else { 1 };
            *label = hit.label;
        }
    }

    /// Whether the window of the last rows does, from this column on.
    fn at(&self, column: usize) -> bool {
        let columns = self.columns.get(column..column + self.window);
        columns.is_some_and(|c| c.iter().all(|(label, rows)| *label == c[0].0 && *rows >= self.window))
    }
}

/// What one matching window holds of one object.
#[derive(Clone, Copy, Debug, Default)]
struct Share {
    pixels: usize,
    inverse_depth: f64,
    cos: f64,
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

    /// Matches every pixel of `rect` (inside the image) whose window shows something that moves, or every one where nothing does, and tells
    /// `read` its index in the image and its raw disparity before temporal noise; infinite where there is no reading. `edge` is drawn over `rect`.
    fn match_windows(&mut self, rect: &Rect, targets: &[Target], edge: &Field, mut read: impl FnMut(usize, f32)) {
        let half = (self.errors.window / 2) as i32;
        let around = rect.grown(half);
        let mut hits = core::mem::take(&mut self.hits);
        hits.clear();
        let bounds: Vec<Rect> =
            targets.iter().map(|t| self.bounds(t, 0.0).unwrap_or_default().grown(2 * self.errors.window as i32)).collect();
        hits.extend(
            (around.top..around.bottom)
                .flat_map(|y| (around.left..around.right).map(move |x| (x, y)))
                .map(|(x, y)| self.cast(x, y, targets, &bounds)),
        );
        let seen = |hit: &Hit| (SHADOW..SOLIDS).contains(&hit.label);
        let mut alike = Alike::new(if targets.is_empty() { around.width() } else { 0 }, self.errors.window);
        // Sums over a window's rows: most windows show nothing that moves, and are passed by.
        let mut moving = std::vec![0_u32; around.width()];
        for row in hits.chunks(around.width()).take(self.errors.window - 1) {
            alike.enter(row);
            moving.iter_mut().zip(row).for_each(|(n, hit)| *n += u32::from(seen(hit)));
        }
        let image = self.image();
        let mut shares = std::vec![Share::default(); SOLIDS + self.solids.len()];
        for y in rect.top..rect.bottom {
            let entering = around.index(around.left, y + half);
            alike.enter(&hits[entering..]);
            moving.iter_mut().zip(&hits[entering..]).for_each(|(n, hit)| *n += u32::from(seen(hit)));
            for (x, columns) in (rect.left..rect.right).zip(moving.windows(self.errors.window)) {
                if !targets.is_empty() && columns.iter().all(|n| *n == 0) {
                    continue;
                }
                let index = image.index(x, y);
                let alone = alike.at((x - rect.left) as usize).then(|| self.alone(&hits[around.index(x, y)])).flatten();
                if let Some(raw) = alone {
                    read(index, raw + self.frozen[index]);
                    continue;
                }
                shares.fill(Share::default());
                let mut front = MISS;
                for wy in y - half..=y + half {
                    let from = around.index(x - half, wy);
                    for hit in &hits[from..from + self.errors.window] {
                        let share = &mut shares[hit.label];
                        share.pixels += 1;
                        share.inverse_depth += hit.inverse_depth;
                        share.cos += hit.cos_incidence;
                        if hit.label >= TARGETS && hit.depth < front.depth {
                            front = *hit;
                        }
                    }
                }
                let chance = f64::from(edge.values[rect.index(x, y)]);
                let raw = self.winner(&shares, front.label, chance).map_or(f32::INFINITY, |(label, raw)| {
                    let frozen = if label >= SOLIDS { self.frozen[index] } else { 0.0 };
                    raw + frozen
                });
                read(index, raw);
            }
            let leaving = around.index(around.left, y - half);
            moving.iter_mut().zip(&hits[leaving..]).for_each(|(n, hit)| *n -= u32::from(seen(hit)));
        }
        self.hits = hits;
    }

    /// What a window reads that shows nothing but what its middle shows, before noise; `None` where that has to be asked of all its pixels. On a plane
    /// inverse depth is linear in the image, and its mean is in the middle.
    fn alone(&self, middle: &Hit) -> Option<f32> {
        match middle.label {
            NOTHING | SHADOW => Some(f32::INFINITY),
            // Clearly less oblique than what may be lost.
            solid if solid >= SOLIDS && self.solids[solid - SOLIDS].sides.len() == 1 && middle.cos_incidence > 0.01 + GRAZING[0].cos() => {
                Some(raw_disparity(middle.depth) as f32)
            }
            _ => None,
        }
    }

    /// The object that a window with these shares reads, and its mean raw disparity. `chance` (normal, sd 1) moves the front object's
    /// silhouette by Nguyen's lateral noise (an edge that lies `d` pixels farther out takes `d` columns of the window from what is behind), and decides
    /// whether a surface that is seen obliquely is lost.
    fn winner(&self, shares: &[Share], front: usize, chance: f64) -> Option<(usize, f32)> {
        let mean_cos = |s: &Share| (s.cos / s.pixels as f64).clamp(0.0, 1.0);
        let nothing = (shares[NOTHING].pixels + shares[SHADOW].pixels) as f64;
        let mut best = (NOTHING, nothing);
        for (label, share) in shares.iter().enumerate().skip(TARGETS).filter(|(_, s)| s.pixels > 0) {
            let mut vote = share.pixels as f64;
            if label == front && share.pixels < self.errors.window * self.errors.window {
                let incidence = mean_cos(share).acos().min(GRAZING[1]);
                let lateral_sd = 0.8 + 0.035 * incidence / (core::f64::consts::FRAC_PI_2 - incidence);
                vote += 2.0 * self.errors.sigma * lateral_sd * chance * self.errors.window as f64;
            }
            if vote > best.1 {
                best = (label, vote);
            }
        }
        let share = (best.0 >= TARGETS).then(|| &shares[best.0])?;
        let faded = (mean_cos(share).acos() - GRAZING[0]) / (GRAZING[1] - GRAZING[0]);
        // The normal distribution makes `chance` uniform: neighbours share their window, and are lost together.
        let lost = faded > 0.0 && 0.5 * libm::erfc(chance * core::f64::consts::FRAC_1_SQRT_2) < faded;
        (!lost).then(|| (best.0, raw_disparity(share.pixels as f64 / share.inverse_depth) as f32))
    }
}

/// To whole raw units.
fn quantised(raw: f32) -> u16 {
    if (0.0..f32::from(NO_DISPARITY) - 0.5).contains(&raw) { raw.round() as u16 } else { NO_DISPARITY }
}
