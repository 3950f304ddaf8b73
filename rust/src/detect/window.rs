//! What a matching window does to the pixels around a ball: it averages, and so neighbours share their noise.
//!
//! Noise that is shared over a window of w pixels is white noise ε, one a pixel, averaged: e(p) = Σ ε(q)/√w over the window at p, e = Bᵀε/√w.
//! With what each pixel has to itself (rounding), the covariance of readings is C = shared · BᵀB/w + own · 1, in running sums.

#![allow(clippy::inline_always)] // So that loops are compiled for the registers of `widest`.

use super::noise::Shares;
use crate::math::symmetric;
use crate::simd::widest;
use nalgebra::{SMatrix, SVector};

/// Four numbers of a pixel.
pub type Lanes = [f32; 4];
/// Sums of products of [`Lanes`].
pub type Products = SMatrix<f64, 4, 4>;

/// Columns and rows of a patch at the most; above that only every second, third, … pixel of a ball is read.
pub const PATCH: usize = 48;
/// The largest matching window, px.
pub const WINDOW: usize = 9;
/// Cells of a grid at the most, padding included.
pub const CELLS: usize = WIDTH * WIDTH;

const WIDTH: usize = PATCH + WINDOW - 1;

/// Steps of conjugate gradients; one would be plain least squares. More than two make centers no more than 1 % better (`seeing_accuracy`), and
/// worse where the window is not as thought: what they gain, they gain at the edges of what it lets through.
const STEPS: usize = 2;

/// What weights make of jacobian and noise.
pub struct Whitened {
    /// Σ weights · jacobianᵀ.
    pub response: Products,
    /// Covariance of Σ weights · reading, in units of the readings' variance.
    pub covariance: Products,
}

/// The pixels of a patch, row by row, padded to the right and downwards by the window less one, so that sums over windows fit.
#[derive(Clone, Copy, Debug)]
pub struct Grid {
    /// Columns and rows of the patch.
    pub columns: usize,
    /// See `columns`.
    pub rows: usize,
    window: [usize; 2],
}

impl Grid {
    /// A patch of `columns` × `rows` pixels, at most [`PATCH`], whose noise is shared over `window` pixels.
    pub fn new(columns: usize, rows: usize, window: [usize; 2]) -> Self {
        Self { columns: columns.min(PATCH), rows: rows.min(PATCH), window: window.map(|edge| edge.clamp(1, WINDOW)) }
    }

    /// Cells from one row to the next: an even number, for registers that take two at once.
    pub fn width(&self) -> usize {
        (self.columns + self.window[0] - 1).next_multiple_of(2)
    }

    /// Cells, padding included.
    pub fn cells(&self) -> usize {
        self.width() * (self.rows + self.window[1] - 1)
    }

    /// Pixels of a window.
    fn area(&self) -> f32 {
        (self.window[0] * self.window[1]) as f32
    }

    /// Replaces each cell by the sum over the window that ends there: B. The padding must be 0.
    #[inline(always)]
    fn gather<const N: usize>(&self, cells: &mut [[f32; N]]) {
        let (width, [across, down]) = (self.width(), self.window);
        let mut before = [[0.0; N]; WIDTH];
        for row in cells.chunks_exact_mut(width).take(self.rows) {
            let before = before.get_mut(..width).unwrap_or_default();
            before.copy_from_slice(row);
            gather_row(across, before, row);
        }
        let mut sums = [[0.0; N]; WIDTH];
        let sums = sums.get_mut(..width).unwrap_or_default().as_flattened_mut();
        for y in (0..self.rows + down - 1).rev() {
            // Upwards, so that what leaves the window has not been overwritten yet.
            let (above, here) = cells.as_flattened_mut().split_at_mut(y * width * N);
            if let Some(first) = (y + 1).checked_sub(down) {
                let entering = if down == 1 { &*here } else { above.get(first * width * N..).unwrap_or_default() };
                add(sums, entering);
            }
            for (sum, cell) in sums.iter_mut().zip(here) {
                let leaving = core::mem::replace(cell, *sum);
                *sum -= leaving;
            }
        }
    }

    /// Fills the pixels of `to` with those of `from` after B and its transpose. `between` is room to work in; the padding of `from` and `to` must be 0.
    #[inline(always)]
    fn correlate(&self, from: &[Lanes], to: &mut [Lanes], between: &mut [Lanes]) {
        let (width, [across, down]) = (self.width(), self.window);
        let mut sums = [[0.0; 4]; WIDTH];
        let gathered = sums.get_mut(..width).unwrap_or_default();
        for (from, to) in from.chunks_exact(width).zip(to.chunks_exact_mut(width)).take(self.rows) {
            gather_row(across, from, gathered);
            scatter_row(across, gathered, to.get_mut(..self.columns).unwrap_or_default());
        }
        let row = |y: usize| y * width * 4..(y + 1) * width * 4;
        let (to, between) = (to.as_flattened_mut(), between.as_flattened_mut());
        let sums = gathered.as_flattened_mut();
        sums.fill(0.0);
        for y in 0..self.rows + down - 1 {
            if y < self.rows {
                add(sums, &to[row(y)]);
            }
            between[row(y)].copy_from_slice(sums);
            if let Some(first) = (y + 1).checked_sub(down) {
                subtract(sums, &to[row(first)]);
            }
        }
        sums.fill(0.0);
        for y in 0..self.rows + down - 1 {
            add(sums, &between[row(y)]);
            if let Some(first) = (y + 1).checked_sub(down) {
                to[row(first)].copy_from_slice(sums);
                subtract(sums, &between[row(first)]);
            }
        }
    }

    /// Of cells (value, 1) where there is a value and 0 where there is none, tells `mean` the mean over the window around each pixel, NaN where
    /// it is empty.
    pub fn average(&self, cells: &mut [[f32; 2]], mean: &mut [f32]) {
        self.gather(cells);
        let [right, down] = self.window.map(|edge| edge / 2);
        let width = self.width();
        for (row, mean) in cells.chunks_exact(width).skip(down).zip(mean.chunks_exact_mut(width)).take(self.rows) {
            for ([sum, count], mean) in row.iter().skip(right).zip(mean) {
                *mean = if *count > 0.5 { sum / count } else { f32::NAN };
            }
        }
    }

    /// Solves C · weights = `jacobian` for each lane, nearly: any weights give an unbiased estimate, these nearly the best there is. Only
    /// pixels that `jacobian` has anything of take part. `scratch` is five times as long.
    pub fn whiten(&self, noise: Shares, jacobian: &[Lanes], weights: &mut [Lanes], scratch: &mut [Lanes]) -> Whitened {
        weights.fill([0.0; 4]);
        let width = self.width();
        let says = |row: &[Lanes]| row.iter().any(|cell| *cell != [0.0; 4]);
        let mut rows = jacobian.chunks_exact(width).take(self.rows);
        let first = rows.position(says).unwrap_or(0);
        let grid = Self { rows: 1 + rows.rposition(says).map_or(0, |last| last + 1), ..*self };
        let cells = first * width..(first + grid.rows) * width;
        let (jacobian, weights) = (&jacobian[cells.clone()], &mut weights[cells]);
        let residual = widest(
            #[inline(always)]
            || grid.solve(noise, jacobian, weights, scratch),
        );
        // C · weights is `jacobian` less what the solver left.
        let response = products(weights, jacobian);
        Whitened { response, covariance: symmetric(&(response - products(weights, residual))) }
    }

    /// Conjugate gradients; what they leave of `jacobian`.
    #[inline(always)]
    fn solve<'s>(&self, noise: Shares, jacobian: &[Lanes], weights: &mut [Lanes], scratch: &'s mut [Lanes]) -> &'s [Lanes] {
        let (between, scratch) = scratch.split_at_mut(self.cells());
        let pixels = jacobian.len();
        let (residual, scratch) = scratch.split_at_mut(pixels);
        let (direction, scratch) = scratch.split_at_mut(pixels);
        let (used, scratch) = scratch.split_at_mut(pixels);
        let image = &mut scratch[..pixels];
        let (shared, own) = (noise.shared as f32 / self.area(), noise.own as f32);
        residual.copy_from_slice(jacobian);
        direction.copy_from_slice(jacobian);
        image.fill([0.0; 4]);
        for (used, jacobian) in used.iter_mut().zip(jacobian) {
            *used = [f32::from(u8::from(*jacobian != [0.0; 4])); 4];
        }
        let mut square = jacobian.iter().fold([0.0; 4], |sum, j| lanes(|i| sum[i] + j[i] * j[i]));
        for _ in 0..STEPS {
            self.correlate(direction, image, between);
            let mut curvature = [0.0; 4];
            for ((image, direction), used) in image.iter_mut().zip(&*direction).zip(&*used) {
                *image = lanes(|i| used[i] * (shared * image[i] + own * direction[i]));
                curvature = lanes(|i| curvature[i] + image[i] * direction[i]);
            }
            let step = quotient(&square, &curvature);
            let mut next = [0.0; 4];
            for ((weight, residual), (direction, image)) in weights.iter_mut().zip(residual.iter_mut()).zip(direction.iter().zip(&*image)) {
                *weight = lanes(|i| weight[i] + step[i] * direction[i]);
                *residual = lanes(|i| residual[i] - step[i] * image[i]);
                next = lanes(|i| next[i] + residual[i] * residual[i]);
            }
            let turn = quotient(&next, &square);
            for (direction, residual) in direction.iter_mut().zip(&*residual) {
                let before = *direction;
                *direction = lanes(|i| residual[i] + turn[i] * before[i]);
            }
            square = next;
        }
        residual
    }

    /// weightsᵀ C weights: the covariance of Σ weights · reading. Overwrites `weights`.
    pub fn covariance(&self, noise: Shares, weights: &mut [Lanes]) -> Products {
        let own = if noise.own > 0.0 { products(weights, weights) * noise.own } else { Products::zeros() };
        widest(
            #[inline(always)]
            || self.gather(weights),
        );
        own + products(weights, weights) * (noise.shared / f64::from(self.area()))
    }
}

/// Fills each cell of `sums` with the sum over the `window` cells of `row` that end there.
#[inline(always)]
fn gather_row<const N: usize>(window: usize, row: &[[f32; N]], sums: &mut [[f32; N]]) {
    let mut sum = [0.0; N];
    let (first, rest) = sums.split_at_mut(window.min(sums.len()));
    for (cell, sums) in row.iter().zip(first) {
        add(&mut sum, cell);
        *sums = sum;
    }
    for ((entering, leaving), sums) in row.iter().skip(window).zip(row).zip(rest) {
        add(&mut sum, entering);
        subtract(&mut sum, leaving);
        *sums = sum;
    }
}

/// Fills each cell of `sums` with the sum over the `window` cells of `row` that begin there.
#[inline(always)]
fn scatter_row(window: usize, row: &[Lanes], sums: &mut [Lanes]) {
    let (first, rest) = row.split_at((window - 1).min(row.len()));
    let mut sum = [0.0; 4];
    for cell in first {
        add(&mut sum, cell);
    }
    for ((entering, leaving), sums) in rest.iter().zip(row).zip(sums) {
        add(&mut sum, entering);
        *sums = sum;
        subtract(&mut sum, leaving);
    }
}

#[inline(always)]
fn add(sum: &mut [f32], value: &[f32]) {
    each(sum, value, |sum, value| sum + value);
}

#[inline(always)]
fn subtract(sum: &mut [f32], value: &[f32]) {
    each(sum, value, |sum, value| sum - value);
}

/// Replaces each of `sum` by what `of` makes of it and `value`, eight at once.
#[inline(always)]
fn each(sum: &mut [f32], value: &[f32], of: impl Fn(f32, f32) -> f32) {
    let ((sums, sums_left), (values, values_left)) = (sum.as_chunks_mut::<8>(), value.as_chunks::<8>());
    for (sum, value) in sums.iter_mut().zip(values) {
        let before = *sum;
        *sum = core::array::from_fn(|i| of(before[i], value[i]));
    }
    for (sum, value) in sums_left.iter_mut().zip(values_left) {
        *sum = of(*sum, *value);
    }
}

#[inline(always)]
fn lanes(of: impl FnMut(usize) -> f32) -> Lanes {
    core::array::from_fn(of)
}

#[inline(always)]
fn quotient(a: &Lanes, b: &Lanes) -> Lanes {
    lanes(|i| if b[i] > 0.0 { a[i] / b[i] } else { 0.0 })
}

/// Σ a bᵀ.
pub fn products(a: &[Lanes], b: &[Lanes]) -> Products {
    let sum = widest(
        #[inline(always)]
        || a.iter().zip(b).fold([[0.0_f32; 4]; 4], |sum, (a, b)| core::array::from_fn(|i| lanes(|j| sum[i][j] + a[i] * b[j]))),
    );
    Products::from_fn(|i, j| f64::from(sum[i][j]))
}

/// Σ a · b.
pub fn moments(a: &[Lanes], b: &[f32]) -> SVector<f64, 4> {
    let sum = a.iter().zip(b).fold([0.0_f32; 4], |sum, (a, b)| lanes(|i| sum[i] + a[i] * b));
    SVector::from_fn(|i, _| f64::from(sum[i]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec;

    /// Some pixels of a patch, and one lane of them as plain numbers.
    fn patch(grid: &Grid) -> Vec<Lanes> {
        let inside = |i: usize| i % grid.width() < grid.columns && i / grid.width() < grid.rows;
        let value = |i: usize| f32::from(u8::from(inside(i) && i % 7 != 3)) * (1.0 + 0.1 * (i % 11) as f32);
        (0..grid.cells()).map(|i| lanes(|lane| value(i) * (1.0 + lane as f32 * (i % 5) as f32))).collect()
    }

    const PIXELS: usize = 12 * 9;

    /// C of the pixels that are `used`, by its definition: noise is shared in proportion to how much two windows overlap. 1 for others.
    fn covariance(grid: &Grid, noise: Shares, used: &[bool]) -> SMatrix<f64, PIXELS, PIXELS> {
        let overlap = |a: usize, b: usize, edge: usize| (1.0 - a.abs_diff(b) as f64 / edge as f64).max(0.0);
        SMatrix::from_fn(|i, j| {
            let same = f64::from(u8::from(i == j));
            let ([xi, yi], [xj, yj]) = ([i % 12, i / 12], [j % 12, j / 12]);
            let shared = overlap(xi, xj, grid.window[0]) * overlap(yi, yj, grid.window[1]);
            if used[i] && used[j] { noise.shared * shared + noise.own * same } else { same }
        })
    }

    #[test]
    fn running_sums_are_the_covariance_and_its_inverse() {
        for window in [[9, 7], [1, 3], [9, 9], [1, 1]] {
            let (grid, noise) = (Grid::new(12, 9, window), Shares { shared: 0.7, own: 0.3 });
            let jacobian = patch(&grid);
            let at = |i: usize| jacobian[i / 12 * grid.width() + i % 12];
            let used: Vec<bool> = (0..PIXELS).map(|i| at(i) != [0.0; 4]).collect();
            let c = covariance(&grid, noise, &used);
            let j = SMatrix::<f64, PIXELS, 4>::from_fn(|i, lane| f64::from(at(i)[lane]));
            let expected = j.transpose() * c * j;
            let got = grid.covariance(noise, &mut jacobian.clone());
            assert!((got - expected).abs().max() < 1e-4 * expected.max(), "{got} {expected}");

            let (mut weights, mut scratch) = (std::vec![[0.0; 4]; jacobian.len()], std::vec![[0.0; 4]; 5 * jacobian.len()]);
            let whitened = grid.whiten(noise, &jacobian, &mut weights, &mut scratch);
            let plain = (j.transpose() * c * j).diagonal();
            let best = (j.transpose() * c.try_inverse().unwrap() * j).diagonal();
            let response = products(&weights, &jacobian);
            let variance = grid.covariance(noise, &mut weights);
            assert!((whitened.response - response).abs().max() < 1e-4 * response.max());
            assert!((whitened.covariance - variance).abs().max() < 1e-3 * variance.max(), "{} {variance}", whitened.covariance);
            for lane in 0..4 {
                // Variance of the estimate: that of the sum over the square of the response.
                let efficiency = response[(lane, lane)] * response[(lane, lane)] / variance[(lane, lane)] / best[lane];
                let plain = (j.column(lane).norm_squared() * j.column(lane).norm_squared()) / plain[lane] / best[lane];
                assert!(efficiency < 1.001 && efficiency > plain - 1e-3, "{window:?} lane {lane}: {efficiency}, plain {plain}");
                assert!(window == [1, 1] || efficiency > plain + 0.02, "{window:?} lane {lane}: {efficiency}, plain {plain}");
            }
        }
    }
}
