//! Matching windows: what each pixel reads of all that its window shows.

use super::{GRAZING, Hit, MISS, NOTHING, SHADOW, SOLIDS, Sensor, TARGETS, Target, raw_disparity};
use crate::sim::noise::{Field, Rect};
use std::vec::Vec;

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

impl Sensor {
    /// Matches every pixel of `rect` (inside the image) whose window shows something that moves, or every one where nothing does, and tells
    /// `read` its index in the image and its raw disparity before temporal noise; infinite where there is no reading. `edge` is drawn over `rect`.
    pub(super) fn match_windows(&mut self, rect: &Rect, targets: &[Target], edge: &Field, mut read: impl FnMut(usize, f32)) {
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
