//! A rigid thing of any shape, followed from view to view: its motion by ICP, frame to frame for a first guess, then against a keyframe, so that
//! errors add up only from keyframe to keyframe. A keyframe knows the same surface from the views before and after it, too.

use super::cloud::Cloud;
use super::icp::{Alignment, align};
use super::noise::{Factor, Noise};
use super::{Blob, Detection};
use crate::geometry::camera::Camera;
use crate::geometry::motion::Motion;
use crate::math::{Mat3, Vec3, sqrt, symmetric};
use crate::time::seconds_between;

/// A view turned so far from the keyframe's, rad, becomes the next one: 7.5°. Surfaces come into view and rims wander.
const TURNED: f64 = 0.13;
/// So does one of which less than this part lies on the keyframe;
const FRESH: f64 = 0.75;
/// and less than this is no longer the same thing, or not to be told.
const SAME: f64 = 0.55;
/// Mean squares of distances, in units of what they were so far, above which an alignment may be a wrong one, and above which it is.
const DOUBTFUL: f64 = 1.5;
const WRONG: f64 = 5.0;
/// A shape of which nothing was measured for so long is forgotten, s: what comes back then is a new one.
const FORGOTTEN: f64 = 0.5;
/// A thing as small as noise has to be seen in so many frames after its first.
const DOUBT: u32 = 5;
/// A thing whose speed is not known yet moves less than this, m/s.
const FASTEST: f64 = 6.0;
/// How far a thing may be from where it was going, m; and what part of its way, as it may bounce or turn.
const ASTRAY: (f64, f64) = (0.05, 1.5);
/// Less of it than this part of its keyframe's area, cut off by the image's edge or a hole, is not measured.
const LEAST: f64 = 0.5;

/// Three views: the keyframe, the one before this, and this.
pub struct Views<'v> {
    /// The keyframe.
    pub key: &'v mut Cloud,
    /// The last one that was measured.
    pub last: &'v mut Cloud,
    /// The one to be measured; afterwards its content is of no use.
    pub current: &'v mut Cloud,
}

/// A shape that is followed.
#[derive(Clone, Copy, Debug)]
pub struct Shape {
    /// Its number.
    pub id: u32,
    /// Radius of the ball that would fill as many pixels when it was first seen, m.
    pub radius: f64,
    /// Where its point of reference is in the keyframe's view, m.
    reference: Vec3,
    /// Covariance of how far off it is there by now, and of the last position as its view's noise makes it, m².
    drift: Mat3,
    noise: Mat3,
    /// From the last view to the keyframe's.
    key_from_last: Motion,
    /// From the last view to the one before.
    step_back: Motion,
    /// Mean of the last view's points, m, and how it moves, m/s.
    middle: Vec3,
    velocity: Option<Vec3>,
    measured_ns: i64,
    /// Frames in a row in which it has yet to be seen before it is taken for real.
    doubt: u32,
    /// Mean squares of distances in units of their expectation, so far.
    spread: Factor,
}

/// What is taken for the middle of a thing: seen from the front, the mean depth of a ball's surface is two thirds of its radius before its center.
fn middle_of(cloud: &Cloud) -> Vec3 {
    let mean = cloud.mean();
    mean * (1.0 + 2.0 / 3.0 * cloud.radius() / mean.norm().max(1e-9))
}

impl Shape {
    /// A shape first seen as `key`; it is told of when it was seen in the next frames as well. `None` where too little is seen to follow it.
    pub fn begin(id: u32, now_ns: i64, key: &Cloud, camera: &Camera, noise: Noise) -> Option<Self> {
        let (reference, radius) = (middle_of(key), key.radius());
        // As uncertain as another view from here would be.
        let itself = align(key, key, &Motion::identity(), noise, camera.code.step(reference.z))?;
        let mut shape = Self {
            id,
            radius,
            reference,
            drift: Mat3::zeros(),
            noise: Mat3::zeros(),
            key_from_last: Motion::identity(),
            step_back: Motion::identity(),
            middle: key.mean(),
            velocity: None,
            measured_ns: now_ns,
            // What one matching window made up fills no more than a window, or two that overlap.
            doubt: if key.pixels() as usize > 2 * noise.window[0] * noise.window[1] { 1 } else { DOUBT },
            spread: Factor::default(),
        };
        let detection = shape.detection(key, &itself, camera)?;
        (shape.drift, shape.noise) = (detection.covariance, detection.covariance);
        Some(shape)
    }

    /// Whether it was seen often enough: noise does not come back at one place.
    pub fn is_sure(&self) -> bool {
        self.doubt == 0
    }

    /// Whether nothing was measured for too long.
    pub fn is_forgotten(&self, now_ns: i64) -> bool {
        seconds_between(self.measured_ns, now_ns) > FORGOTTEN
    }

    /// Where the middle of its seen surface should be, m.
    pub fn middle_at(&self, now_ns: i64) -> Vec3 {
        self.middle + self.velocity.unwrap_or_default() * seconds_between(self.measured_ns, now_ns)
    }

    /// How far from there it may be, m.
    pub fn reach_at(&self, now_ns: i64) -> f64 {
        let speed = self.velocity.map_or(FASTEST, |velocity| ASTRAY.1 * velocity.norm());
        self.radius + ASTRAY.0 + speed * seconds_between(self.measured_ns, now_ns)
    }

    /// Measures it in `views.current`, which becomes the last view. `None` where that does not show it, or not enough of it; then nothing changes.
    pub fn follow(&mut self, now_ns: i64, views: Views<'_>, camera: &Camera, noise: Noise) -> Option<Detection> {
        let Views { key, last, current } = views;
        let step = camera.code.step(current.mean().z);
        if !current.is_whole() && area(current) < LEAST * area(key) {
            return None;
        }
        // It turns on as it did, or it doesn't; its middle is where it is seen, unless it is cut off: then it moves on as well.
        let by_means = |rotation: Mat3| Motion { rotation, translation: last.mean() - rotation * current.mean() };
        let whole = current.is_whole() && last.is_whole();
        let first = if whole { by_means(self.step_back.rotation) } else { self.step_back };
        let spread = self.spread.value();
        let aligned = |target: &Cloud, start: &Motion| {
            let found = align(current, target, start, noise, step)?;
            let badness = found.chi_square / spread;
            (found.overlap >= SAME && badness < WRONG).then_some((found, badness))
        };
        let mut to_last = aligned(last, &first);
        if to_last.as_ref().is_none_or(|(_, badness)| *badness > DOUBTFUL) {
            let again = aligned(last, &by_means(Mat3::identity()));
            to_last = [to_last, again].into_iter().flatten().min_by(|a, b| a.1.total_cmp(&b.1));
        }
        let (to_last, badness) = to_last?;
        let start = self.key_from_last.after(&to_last.target_from_source);
        let to_key = if let Some((to_key, _)) = aligned(key, &start).filter(|found| found.1 < DOUBTFUL * badness.max(1.0)) {
            to_key
        } else {
            // It has turned away from its keyframe within one frame: the last view takes the keyframe's place.
            let back = self.key_from_last.inverse();
            self.renew(back.of(&self.reference), turned(&self.drift, &back) + self.noise);
            key.copy_from(last);
            to_last
        };
        self.spread.learn(to_key.chi_square);
        let detection = self.detection(current, &to_key, camera)?;
        let middle = current.mean();
        let seconds = seconds_between(self.measured_ns, now_ns);
        self.velocity = (seconds > 0.0).then(|| (middle - self.middle) / seconds);
        (self.middle, self.measured_ns, self.doubt) = (middle, now_ns, self.doubt.saturating_sub(1));
        self.step_back = to_last.target_from_source;
        (self.key_from_last, self.noise) = (to_key.target_from_source, detection.covariance);
        core::mem::swap(last, current);
        // Noise alone turns what shows no turn, as a ball: its part of the angle's square is not a turn.
        let (angle, noise_of_turn) = (to_key.target_from_source.angle(), to_key.covariance.fixed_view::<3, 3>(0, 0).trace());
        if last.is_whole() && (angle * angle - noise_of_turn > TURNED * TURNED || to_key.overlap < FRESH) {
            // The next keyframe is this view, and what the present one knows of the same surface.
            current.copy_from(last);
            current.fuse(key, &self.key_from_last, noise);
            core::mem::swap(key, current);
            self.renew(detection.center, detection.drift + detection.covariance);
        } else {
            key.fuse(last, &self.key_from_last.inverse(), noise);
        }
        Some(detection)
    }

    /// The last view becomes the keyframe: where the point of reference is in it, m, and how far off it may be, m².
    fn renew(&mut self, reference: Vec3, drift: Mat3) {
        (self.reference, self.drift, self.key_from_last) = (reference, drift, Motion::identity());
    }

    /// What a view that is aligned to the keyframe tells.
    fn detection(&self, view: &Cloud, to_key: &Alignment, camera: &Camera) -> Option<Detection> {
        let back = to_key.target_from_source.inverse();
        let center = back.of(&self.reference);
        let by_motion = to_key.covariance_at(&self.reference);
        let covariance = turned(&(by_motion * to_key.own), &back);
        let drift = turned(&(self.drift + by_motion * (1.0 - to_key.own)), &back);
        let (_, row) = camera.project(&center)?;
        // Where nobody knows any more within its own size, it is not followed.
        let finite = center.iter().chain(covariance.iter()).all(|x| x.is_finite());
        (finite && sqrt((covariance + drift).trace()) < self.radius).then_some(Detection {
            center,
            covariance,
            drift,
            radius: self.radius,
            points: view.pixels(),
            residual_rms: to_key.residual_rms,
            row,
            blob: Blob::Whole,
            shape: Some(self.id),
        })
    }
}

/// A covariance where a motion has brought it.
fn turned(covariance: &Mat3, motion: &Motion) -> Mat3 {
    symmetric(&(motion.rotation * covariance * motion.rotation.transpose()))
}

/// Pixels of a view as they would be at a depth of 1 m.
fn area(view: &Cloud) -> f64 {
    f64::from(view.pixels()) * view.mean().z * view.mean().z
}
