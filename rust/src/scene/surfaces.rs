//! Which contacts lie on the same surface, and what is known of each.

use crate::config::{EnvironmentConfig, Name};
use crate::event::{Above, Surface};
use crate::geometry::environment::{Environment, KnownSurface, Relief, SURVEY_SD};
use crate::math::{Mat3, Vec3, acos, sqrt};
use crate::physics::restitution::Restitution;
use crate::scene::outline::{CORNERS, is_within, outline};
use crate::scene::plane::{Patch, Plane, Up};
use heapless::Vec;

/// Contacts that are remembered; the oldest goes first.
pub const PATCHES: usize = 64;
/// Surfaces that are found at a time; one that has merged is forgotten as soon as that is told.
const SURFACES: usize = 32;
/// χ² beyond which a contact is not on a plane (three observations).
const GATE: f64 = 25.0;
/// What one more surface costs, as χ²: twice the logarithm of how many heights, told apart to a millimetre, it might have had.
const ONE_MORE: f64 = 15.0;
/// χ² up to which two homeless contacts share a plane (six observations, four unknowns with priors; a plane that is not level).
const PAIR: f64 = 34.0;
/// Surfaces at an angle within this many standard deviations are parallel.
const PARALLEL: f64 = 9.0;
/// Heights that differ by less than this part of the ball's radius may be one.
const A_LITTLE: f64 = 0.3;

/// A surface that contacts showed.
#[derive(Clone, Debug)]
struct Found {
    id: u32,
    plane: Plane,
    merged_into: Option<u32>,
    told: bool,
    /// Contacts that are forgotten; the plane was fitted to them once.
    forgotten: u32,
}

/// Restitution on each known surface and each plane that the camera sees, as they are counted: mean and standard deviation.
pub type Restitutions = Vec<(f64, f64), { Environment::ALL }>;

/// Slower impacts say little of the restitution, m/s.
const TELLING: f64 = 0.5;

/// All surfaces of a stream.
#[derive(Debug)]
pub struct Surfaces {
    environment: Environment,
    known_contacts: [u32; Environment::CAPACITY],
    known_restitutions: [Restitution; Environment::ALL],
    patches: Vec<(Patch, Option<u32>), PATCHES>,
    found: Vec<Found, SURFACES>,
    next: u32,
    closed: bool,
}

impl Surfaces {
    /// Begins with what is known; `closed`: there is nothing else.
    pub fn new(environment: &EnvironmentConfig, closed: bool) -> Self {
        let environment = Environment::new(environment);
        let next = environment.surfaces().len() as u32;
        Self {
            environment,
            known_contacts: [0; Environment::CAPACITY],
            known_restitutions: [Restitution::default(); Environment::ALL],
            patches: Vec::new(),
            found: Vec::new(),
            next,
            closed,
        }
    }

    /// What is known.
    pub fn environment(&self) -> &Environment {
        &self.environment
    }

    /// Learns what the camera sees: it can be touched, but which surfaces there are is told by contacts alone.
    pub fn see(&mut self, relief: Relief) {
        self.environment.see(relief);
    }

    /// Restitution on each known surface and each plane that the camera sees, as contacts have shown it.
    pub fn restitutions(&self) -> Restitutions {
        self.known_restitutions[..self.environment.count()].iter().map(Restitution::expected).collect()
    }

    /// The surface, known or well found, that a ball of `radius` (m) at `center` (with covariance) touches, and its normal there.
    pub fn touched(&self, center: &Vec3, covariance: &Mat3, radius: f64) -> Option<(u32, Vec3)> {
        let near = |height: f64, variance: f64| (height - radius) * (height - radius) < 9.0 * variance + 1e-5;
        let found = || self.heights(center, covariance).find(|(_, height, variance)| near(*height, *variance));
        self.environment.touched(center, covariance, radius).or_else(|| found().map(|(f, ..)| (f.id, f.plane.normal)))
    }

    /// Whether a ball of `radius` (m) at `center` (with covariance) would be partly behind a surface that is known or well found.
    pub fn is_beyond(&self, center: &Vec3, covariance: &Mat3, radius: f64) -> bool {
        let pierces = |height: f64, variance: f64| height > 0.0 && height < radius - 3.0 * sqrt(variance);
        let known = self.environment.nearest(center);
        self.heights(center, covariance).any(|(_, height, variance)| pierces(height, variance))
            || known.is_some_and(|(distance, normal, _)| pierces(distance, normal.dot(&(covariance * normal)) + SURVEY_SD * SURVEY_SD))
    }

    /// Surfaces that are well found, how high `center` (with covariance) is over each, m, and the variance of that.
    fn heights(&self, center: &Vec3, covariance: &Mat3) -> impl Iterator<Item = (&Found, f64, f64)> {
        let (center, covariance) = (*center, *covariance);
        self.well_found().map(move |f| {
            let (height, variance) = f.plane.height(&center);
            (f, height, variance + f.plane.normal.dot(&(covariance * f.plane.normal)))
        })
    }

    fn well_found(&self) -> impl Iterator<Item = &Found> {
        self.found.iter().filter(|f| f.merged_into.is_none() && f.plane.normal_covariance().trace() < 0.01)
    }

    /// Takes in a final contact; returns the surface it belongs to, and that surface's normal there.
    pub fn add(&mut self, patch: Patch, up: &Up) -> Option<(u32, Vec3)> {
        let covariance: Mat3 = patch.covariance.fixed_view::<3, 3>(0, 0).into();
        if let Some((id, normal)) = self.environment.seen_touched(&patch.center, &covariance, patch.radius) {
            self.learn_restitution(id, &normal, &patch);
        }
        if let Some((id, normal)) = self.environment.touched(&patch.center, &covariance, patch.radius) {
            self.known_contacts[id as usize] += 1;
            self.learn_restitution(id, &normal, &patch);
            if self.environment.surfaces().get(id as usize).is_some_and(|known| known.normal.dot(&normal) < 0.0) {
                self.environment.turn(id);
            }
            return Some((id, normal));
        }
        if self.closed {
            return None;
        }
        self.make_room();
        let _ = self.patches.push((patch, None));
        let newest = self.patches.len() - 1;
        self.place(newest, up);
        // Early contacts were placed when little was known.
        for _ in 0..2 {
            for i in 0..self.patches.len() {
                self.place(i, up);
            }
        }
        self.merge(up);
        let id = self.patches[newest].1?;
        self.found.iter().find(|f| f.id == id).map(|f| (id, f.plane.normal))
    }

    fn learn_restitution(&mut self, id: u32, normal: &Vec3, patch: &Patch) {
        let (into, off) = (-patch.before.dot(normal), patch.after.dot(normal));
        if into > TELLING && off > 0.0 && off < 1.05 * into {
            self.known_restitutions[id as usize].learn(off / into);
        }
    }

    /// Forgets the oldest contact of the surface that has most.
    fn make_room(&mut self) {
        if !self.patches.is_full() {
            return;
        }
        let members = |id: Option<u32>| self.patches.iter().filter(|p| p.1 == id).count();
        let most = self.patches.iter().map(|p| p.1).max_by_key(|id| members(*id)).flatten();
        let oldest = self.patches.iter().position(|p| p.1 == most).unwrap_or(0);
        if let Some(found) = self.found.iter_mut().find(|f| Some(f.id) == most) {
            found.forgotten += 1;
        }
        self.patches.remove(oldest);
    }

    /// Puts patch `index` on the surface that it disagrees with least, or on one of its own.
    fn place(&mut self, index: usize, up: &Up) {
        let present = self.patches[index].1;
        let best = {
            let patch = &self.patches[index].0;
            let alone = present.is_some_and(|id| self.on(id).count() == 1);
            // A plane that rests on this patch alone agrees with it: what counts is whether another does.
            let others = self.found.iter().filter(|f| f.merged_into.is_none() && !(alone && present == Some(f.id)));
            let scored = others.map(|f| (f.plane.disagreement(patch), f.id));
            let own = || Plane::fit(core::iter::once(patch), Some(up)).filter(|p| p.level);
            let near = |chi2: f64| chi2 < GATE && (chi2 < ONE_MORE || own().is_none_or(|own| chi2 < own.chi2 + ONE_MORE));
            scored.min_by(|a, b| a.0.total_cmp(&b.0)).filter(|(chi2, _)| near(*chi2)).map(|(_, id)| id)
        };
        match (best, present) {
            (Some(id), _) if present == Some(id) => {}
            (Some(id), _) => {
                self.patches[index].1 = Some(id);
                self.refit(id, up);
                if let Some(left) = present {
                    self.refit(left, up);
                    if !self.patches.iter().any(|p| p.1 == Some(left)) {
                        self.close(left, id);
                    }
                }
            }
            (None, Some(left)) if self.on(left).count() > 1 => {
                self.patches[index].1 = None;
                self.refit(left, up);
                self.found_own(index, up);
            }
            (None, Some(_)) => {}
            (None, None) => self.found_own(index, up),
        }
    }

    /// A contact that fits nowhere begins a surface if it may be level, or if another homeless contact shares it.
    /// One alone that is not level may as well be an edge.
    fn found_own(&mut self, index: usize, up: &Up) {
        let patch = &self.patches[index].0;
        let Some(alone) = Plane::fit(core::iter::once(patch), Some(up)) else { return };
        let partner = self.patches.iter().enumerate().filter(|(i, p)| *i != index && p.1.is_none()).find_map(|(i, p)| {
            let plane = Plane::fit([patch, &p.0].into_iter(), Some(up))?;
            (plane.chi2 < PAIR).then_some((i, plane))
        });
        let (partner, plane) = match partner {
            Some((i, plane)) => (Some(i), plane),
            None if alone.level => (None, alone),
            None => return,
        };
        // Nobody heard of what has merged at once, and nothing is on it.
        self.found.retain(|f| f.merged_into.is_none() || f.told);
        if self.found.push(Found { id: self.next, plane, merged_into: None, told: false, forgotten: 0 }).is_ok() {
            self.patches[index].1 = Some(self.next);
            if let Some(i) = partner {
                self.patches[i].1 = Some(self.next);
            }
            self.next += 1;
        }
    }

    fn refit(&mut self, id: u32, up: &Up) {
        if let (Some(plane), Some(found)) = (Plane::fit(self.on(id), Some(up)), self.found.iter_mut().find(|f| f.id == id)) {
            found.plane = plane;
        }
    }

    fn close(&mut self, id: u32, into: u32) {
        for found in self.found.iter_mut().filter(|f| f.id == id || f.merged_into == Some(id)) {
            found.merged_into = Some(into);
        }
    }

    /// Two surfaces whose contacts one plane explains as well are one.
    fn merge(&mut self, up: &Up) {
        for i in 0..self.found.len() {
            for j in i + 1..self.found.len() {
                let (a, b) = (&self.found[i], &self.found[j]);
                if a.merged_into.is_some() || b.merged_into.is_some() {
                    continue;
                }
                let (a_id, b_id) = (a.id, b.id);
                let Some(plane) = Plane::fit(self.on(a_id).chain(self.on(b_id)), Some(up)) else { continue };
                if plane.chi2 < a.plane.chi2 + b.plane.chi2 + ONE_MORE || self.one_covers_the_other(a_id, b_id) {
                    for patch in &mut self.patches {
                        if patch.1 == Some(b_id) {
                            patch.1 = Some(a_id);
                        }
                    }
                    self.found[i].plane = plane;
                    self.found[i].forgotten += self.found[j].forgotten;
                    self.close(b_id, a_id);
                }
            }
        }
    }

    /// The patches on surface `id`, by their place among the last [`PATCHES`] that were added.
    pub fn members(&self, id: u32) -> impl Iterator<Item = usize> + '_ {
        self.patches.iter().enumerate().filter(move |(_, p)| p.1 == Some(id)).map(|(i, _)| i)
    }

    /// Restitution of the ball on the found surface `id`.
    pub fn restitution(&self, id: u32) -> Option<f64> {
        self.found.iter().find(|f| f.id == id).map(|f| f.plane.restitution)
    }

    /// No ball touches a surface through another one: what was touched side by side, a little higher and a little lower, or a little lower among
    /// touches, is one surface, however sure the contacts are of their heights.
    fn one_covers_the_other(&self, a: u32, b: u32) -> bool {
        let (Some(a), Some(b)) = (self.living(a), self.living(b)) else { return false };
        let n = a.plane.normal;
        let side_by_side = |p: &Patch, q: &Patch| {
            let apart = q.center - p.center;
            let height = n.dot(&apart);
            (apart - n * height).norm() < p.radius && height.abs() < A_LITTLE * p.radius
        };
        n.dot(&b.plane.normal) > 0.99
            && (self.covers(a, b) || self.covers(b, a) || self.on(a.id).any(|p| self.on(b.id).any(|q| side_by_side(p, q))))
    }

    /// Whether a contact with the one surface was a little below the other one, among the touches of that.
    fn covers(&self, upper: &Found, lower: &Found) -> bool {
        let Plane { normal, offset, .. } = upper.plane;
        let hull = self.outline(upper);
        self.on(lower.id).any(|p| {
            let above = normal.dot(&p.center) - p.radius - offset;
            above < 0.0 && above > -A_LITTLE * p.radius && is_within(&p.center, &hull, &normal)
        })
    }

    fn living(&self, id: u32) -> Option<&Found> {
        self.found.iter().find(|f| f.id == id && f.merged_into.is_none())
    }

    /// The contacts on surface `id`.
    fn on(&self, id: u32) -> impl Iterator<Item = &Patch> + Clone {
        self.patches.iter().filter(move |p| p.1 == Some(id)).map(|p| &p.0)
    }

    fn outline(&self, found: &Found) -> Vec<[f64; 3], CORNERS> {
        let Plane { normal, offset, .. } = found.plane;
        outline(self.on(found.id).map(|p| p.center - normal * p.radius), &normal, offset)
    }

    /// Hands out every surface as it is now: known ones, found ones, and those that merged since they were handed out last; of each what lies lower
    /// comes first, so that none names one that was never handed out. With `last`, all of them, for good.
    pub fn tell(&mut self, up: &Up, last: bool, mut out: impl FnMut(Surface, bool)) {
        let mut known: Vec<(u32, &KnownSurface), { Environment::CAPACITY }> = (0..).zip(self.environment.surfaces()).collect();
        known.sort_unstable_by(|a, b| a.1.offset.total_cmp(&b.1.offset));
        known.iter().for_each(|(id, known)| out(self.known(*id, known, up), last));
        let mut order: Vec<usize, SURFACES> = (0..self.found.len()).collect();
        let rank = |i: usize| (self.found[i].merged_into.is_some(), self.found[i].plane.offset);
        order.sort_unstable_by(|a, b| rank(*a).0.cmp(&rank(*b).0).then(rank(*a).1.total_cmp(&rank(*b).1)));
        for i in order {
            let Found { merged_into, told, .. } = self.found[i];
            let gone = merged_into.is_some();
            // Nobody heard of what has merged at once.
            if told || !gone {
                out(self.describe(&self.found[i], up), last || gone);
                self.found[i].told = true;
            }
        }
        self.found.retain(|f| f.merged_into.is_none());
    }

    fn known(&self, id: u32, known: &KnownSurface, up: &Up) -> Surface {
        Surface {
            id,
            name: Some(known.name.clone()).filter(|n: &Name| !n.is_empty()),
            normal: known.normal.into(),
            offset: known.offset,
            covariance: None,
            tilt: Some(acos(known.normal.dot(&up.direction).clamp(-1.0, 1.0))),
            tilt_sd: Some(sqrt(up.variance)),
            contacts: self.known_contacts[id as usize],
            outline: None,
            above: self.above_known(known),
            merged_into: None,
        }
    }

    fn describe(&self, found: &Found, up: &Up) -> Surface {
        let plane = &found.plane;
        // The tilt's variance is that of the normal along the way to "up", or along any way where there is none.
        let c = plane.normal_covariance();
        let way = (up.direction - plane.normal * plane.normal.dot(&up.direction)).try_normalize(1e-12);
        let variance = way.map_or(0.5 * c.trace(), |w| w.dot(&(c * w)));
        Surface {
            id: found.id,
            name: None,
            normal: plane.normal.into(),
            offset: plane.offset,
            covariance: Some(plane.covariance_rows()),
            tilt: Some(acos(plane.normal.dot(&up.direction).clamp(-1.0, 1.0))),
            tilt_sd: Some(sqrt(variance + up.variance)),
            contacts: self.on(found.id).count() as u32 + found.forgotten,
            outline: Some(self.outline(found)),
            above: self.above(found),
            merged_into: found.merged_into,
        }
    }

    /// The nearest known parallel surface below a known one.
    fn above_known(&self, upper: &KnownSurface) -> Option<Above> {
        let lower = self.environment.surfaces().iter().enumerate().filter(|(_, k)| k.normal.dot(&upper.normal) > 1.0 - 1e-6);
        let heights = lower.map(|(id, k)| (id as u32, upper.offset - k.offset)).filter(|(_, height)| *height > 0.0);
        heights.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(surface, height)| Above { surface, height, sd: None })
    }

    /// The nearest parallel surface below `found`.
    fn above(&self, found: &Found) -> Option<Above> {
        let members = self.on(found.id);
        let count = members.clone().count();
        if count == 0 || found.merged_into.is_some() {
            return None;
        }
        let upper = &found.plane;
        let middle = members.map(|p| p.center - upper.normal * p.radius).sum::<Vec3>() / count as f64;
        let known = self.environment.surfaces().iter().enumerate().filter_map(|(id, k)| {
            let parallel = upper.turn_to(&k.normal, 1e-6) < PARALLEL;
            let (own, variance) = upper.height(&middle);
            parallel.then_some((id as u32, k.normal.dot(&middle) - own - k.offset, variance))
        });
        let others = self.found.iter().filter(|f| f.id != found.id && f.merged_into.is_none()).filter_map(|f| {
            let spread = 0.5 * f.plane.normal_covariance().trace();
            if upper.turn_to(&f.plane.normal, spread) > PARALLEL {
                return None;
            }
            // That they are parallel is knowledge: each has its normal from both.
            let (upper, lower) = (upper.parallel_to(&f.plane), f.plane.parallel_to(upper));
            let (own, variance) = upper.height(&middle);
            let (height, below) = lower.height(&(middle - upper.normal * own));
            Some((f.id, height, variance + below))
        });
        let nearest = known.chain(others).filter(|(_, height, _)| *height > 0.0).min_by(|a, b| a.1.total_cmp(&b.1));
        nearest.map(|(surface, height, variance)| Above { surface, height, sd: Some(sqrt(variance)) })
    }

    /// Distance (m) of `p` from the surface nearest to it, known or well found, and the unit normal towards `p` there.
    pub fn nearest(&self, p: &Vec3) -> Option<(f64, Vec3)> {
        let found = self.well_found().map(|f| (f.plane.height(p).0, f.plane.normal)).filter(|(height, _)| *height > 0.0);
        let known = self.environment.nearest(p).map(|(distance, normal, _)| (distance, normal));
        known.into_iter().chain(found).min_by(|a, b| a.0.total_cmp(&b.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::SMatrix;

    const UP: Up = Up { direction: Vec3::new(0.0, 0.0, 1.0), variance: 1e-6 };

    /// A bounce of a ball of 33 mm at `x`, `y`, of restitution `e` on a floor at `height`, m.
    fn patch(x: f64, y: f64, height: f64, e: f64) -> Patch {
        let (before, after) = (Vec3::new(0.3, 0.1, -1.0), Vec3::new(0.3, 0.1, e));
        let covariance = SMatrix::from_diagonal_element(1e-6);
        Patch { center: Vec3::new(x, y, height + 0.033), before, after, covariance, radius: 0.033, spin_sd: 0.0, normal: Vec3::z() }
    }

    /// Heights of the surfaces that the corners of a square of 1 m on a floor, and another patch, leave.
    fn heights(other: Patch) -> std::vec::Vec<f64> {
        let mut surfaces = Surfaces::new(&EnvironmentConfig::default(), false);
        for (x, y) in [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)] {
            surfaces.add(patch(x, y, 0.0, 0.7), &UP);
        }
        surfaces.add(other, &UP);
        let mut heights = std::vec::Vec::new();
        surfaces.tell(&UP, true, |surface, _| heights.extend(surface.merged_into.is_none().then_some((surface.offset * 1e3).round())));
        heights
    }

    #[test]
    fn nothing_is_touched_a_little_below_a_surface_among_its_touches() {
        let one = heights(patch(0.5, 0.4, -0.008, 0.4));
        assert!(one.len() == 1 && one[0].abs() <= 2.0, "{one:?}");
        // Beside it, higher, and far below it there may well be another.
        assert_eq!(heights(patch(1.5, 0.4, -0.008, 0.4)), [-8.0, 0.0]);
        assert_eq!(heights(patch(0.5, 0.4, 0.008, 0.4)), [0.0, 8.0]);
        assert_eq!(heights(patch(0.5, 0.4, -0.4, 0.4)), [-400.0, 0.0]);
    }

    #[test]
    fn a_stream_goes_on_beyond_as_many_surfaces_as_there_is_room_for() {
        let mut surfaces = Surfaces::new(&EnvironmentConfig::default(), false);
        let (mut ids, mut merged) = (std::collections::BTreeSet::new(), 0);
        for level in (0..SURFACES - 1).map(|i| 0.3 * i as f64) {
            // Touched first a little below what is then touched around it: until the last of these they are two surfaces.
            for (x, y, lower) in [(0.5, 0.4, 0.008), (0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 1.0, 0.0), (0.0, 1.0, 0.0)] {
                let touched = surfaces.add(patch(x, y, level - lower, 0.4), &UP);
                assert!(touched.is_some(), "at {level} m, after {} surfaces", ids.len());
                surfaces.tell(&UP, false, |surface, is_final| {
                    merged += usize::from(surface.merged_into.is_some());
                    assert_eq!(is_final, surface.merged_into.is_some());
                    ids.insert(surface.id);
                });
            }
        }
        let mut living = 0;
        surfaces.tell(&UP, true, |surface, _| living += usize::from(surface.merged_into.is_none()));
        assert!(merged > 5 && ids.len() > SURFACES && living + merged == ids.len(), "{living} + {merged} of {}", ids.len());
    }
}
