//! Noise of a stereo matcher: neighbouring pixels share their matching window, and so their error.

use rand::Rng;
use rand_distr::{Distribution, StandardNormal};
use std::vec::Vec;

/// Pixels from (`left`, `top`), inclusive, to (`right`, `bottom`), exclusive; may reach beyond the image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Rect {
    /// First column.
    pub left: i32,
    /// First row.
    pub top: i32,
    /// One past the last column.
    pub right: i32,
    /// One past the last row.
    pub bottom: i32,
}

impl Rect {
    /// Columns.
    pub fn width(&self) -> usize {
        (self.right - self.left).max(0) as usize
    }

    /// Rows.
    pub fn height(&self) -> usize {
        (self.bottom - self.top).max(0) as usize
    }

    /// Grown by `margin` on every side.
    #[must_use]
    pub fn grown(&self, margin: i32) -> Self {
        Self { left: self.left - margin, top: self.top - margin, right: self.right + margin, bottom: self.bottom + margin }
    }

    /// What both cover.
    #[must_use]
    pub fn intersection(&self, other: &Self) -> Self {
        Self {
            left: self.left.max(other.left),
            top: self.top.max(other.top),
            right: self.right.min(other.right),
            bottom: self.bottom.min(other.bottom),
        }
    }

    /// The smallest that covers both.
    #[must_use]
    pub fn union(&self, other: &Self) -> Self {
        Self {
            left: self.left.min(other.left),
            top: self.top.min(other.top),
            right: self.right.max(other.right),
            bottom: self.bottom.max(other.bottom),
        }
    }

    /// Whether no pixel is in it.
    pub fn is_empty(&self) -> bool {
        self.right <= self.left || self.bottom <= self.top
    }

    /// Whether pixel (`x`, `y`) is in it.
    pub fn contains(&self, x: i32, y: i32) -> bool {
        (self.left..self.right).contains(&x) && (self.top..self.bottom).contains(&y)
    }

    /// Where pixel (`x`, `y`) stands in row-major order.
    pub fn index(&self, x: i32, y: i32) -> usize {
        (y - self.top) as usize * self.width() + (x - self.left) as usize
    }
}

/// Normal noise of sd 1 over a rectangle, row-major, correlated over `window` × `window` pixels (1 for white): white noise
/// under a box filter, so that the correlation falls linearly to 0 at `window` pixels.
#[derive(Clone, Debug, Default)]
pub struct Field {
    /// The noise.
    pub values: Vec<f32>,
    rows: Vec<f32>,
    column_sums: Vec<f32>,
}

impl Field {
    /// Draws it anew.
    pub fn draw(&mut self, rect: &Rect, window: usize, rng: &mut impl Rng) {
        let (width, height) = (rect.width(), rect.height());
        let scale = 1.0 / window as f32;
        self.values.clear();
        self.rows.clear();
        self.column_sums.clear();
        self.column_sums.resize(width, 0.0);
        // Sums along each row, then down the columns: as one row enters, another leaves.
        for y in 0..height + window - 1 {
            let white: Vec<f32> = (0..width + window - 1).map(|_| StandardNormal.sample(rng)).collect();
            let mut sum: f32 = white[..window - 1].iter().sum();
            for x in 0..width {
                sum += white[x + window - 1];
                self.rows.push(sum);
                sum -= white[x];
                self.column_sums[x] += self.rows[y * width + x];
            }
            if y + 1 >= window {
                self.values.extend(self.column_sums.iter().map(|s| s * scale));
                let leaving = (y + 1 - window) * width;
                self.column_sums.iter_mut().zip(&self.rows[leaving..]).for_each(|(s, r)| *s -= r);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand::rngs::Xoshiro256PlusPlus;

    #[test]
    fn noise_has_unit_variance_and_the_windows_correlation() {
        let rect = Rect { left: -3, top: 2, right: 597, bottom: 602 };
        let mut field = Field::default();
        for window in [1, 5, 9] {
            field.draw(&rect, window, &mut Xoshiro256PlusPlus::seed_from_u64(4));
            let lagged = |dx: usize, dy: usize| {
                let pairs = (0..600 - dy).flat_map(|y| (0..600 - dx).map(move |x| (y * 600 + x, (y + dy) * 600 + x + dx)));
                let products: Vec<f64> = pairs.map(|(a, b)| f64::from(field.values[a] * field.values[b])).collect();
                products.iter().sum::<f64>() / products.len() as f64
            };
            let expected = |lag: usize| (1.0 - lag as f64 / window as f64).max(0.0);
            for lag in [0, 1, 3, 6, 12] {
                assert!((lagged(lag, 0) - expected(lag)).abs() < 0.06, "{window} {lag}: {}", lagged(lag, 0));
                assert!((lagged(0, lag) - expected(lag)).abs() < 0.06, "{window} {lag}: {}", lagged(0, lag));
            }
        }
    }
}
