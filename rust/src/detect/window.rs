//! What a matching window does to the pixels around a ball: it averages, and so neighbours share their noise.
//!
//! Noise that is shared over a window of w pixels is white noise ε, one a pixel, averaged: e(p) = Σ ε(q)/√w over the window at p, e = Bᵀε/√w.
//! With what each pixel has to itself (rounding), the covariance of readings is C = shared · BᵀB/w + own · 1.
//!
//! Every quantity has a plane of its own, row after row: a window's sum then is a sum of shifted planes, and wide registers need no more.

#![allow(clippy::inline_always)] // So that loops are compiled for the registers of `widest`.

use super::noise::Shares;
use nalgebra::{SMatrix, SVector};

/// One number of each pixel of a patch, laid out as its [`Grid`] says.
pub type Plane = [f32];
/// Four numbers of each pixel.
pub type Planes<'p> = [&'p mut Plane; 4];
/// Sums of products of two times four planes.
pub type Products = SMatrix<f64, 4, 4>;

/// Columns and rows of a patch at the most; above that only every second, third, … pixel of a ball is read.
pub const PATCH: usize = 48;
/// The largest matching window, px: an odd number.
pub const WINDOW: usize = 9;
/// Cells of a plane at the most.
pub const CELLS: usize = Grid { columns: PATCH, rows: PATCH, window: [WINDOW; 2] }.cells();
/// Numbers that a wide register holds.
const WIDE: usize = 8;

/// Two directions that are no more than this apart, as a part of the square of their lengths, are one.
const PARALLEL: f64 = 1e-4;

/// What weights make of jacobian, residual and noise.
pub struct Whitened {
    /// Σ jacobian · jacobianᵀ.
    pub products: Products,
    /// Σ weights · jacobianᵀ.
    pub response: Products,
    /// Σ weights · residual.
    pub moments: SVector<f64, 4>,
    /// Covariance of Σ weights · reading, in units of the readings' variance.
    pub covariance: Products,
}

/// How the pixels of a patch lie in a plane: row by row, between them gaps, before and behind them room, so that no window reaches over.
#[derive(Clone, Copy, Debug)]
pub struct Grid {
    /// Columns and rows of the patch.
    pub columns: usize,
    /// See `columns`.
    pub rows: usize,
    window: [usize; 2],
}

impl Grid {
    /// A patch of `columns` × `rows` pixels, at most [`PATCH`], whose noise is shared over `window` pixels, which are made odd.
    pub fn new(columns: usize, rows: usize, window: [usize; 2]) -> Self {
        Self { columns: columns.min(PATCH), rows: rows.min(PATCH), window: window.map(|edge| edge.min(WINDOW) | 1) }
    }

    /// The grid of its blocks of `stride` × `stride` pixels.
    pub fn thinned(&self, stride: usize) -> Self {
        Self::new(self.columns.div_ceil(stride), self.rows.div_ceil(stride), self.window.map(|edge| edge / stride))
    }

    /// How means over those blocks share noise: sums of many see of it what those of the pixels do, though windows become odd numbers of blocks.
    pub fn shares_of_blocks(&self, noise: Shares, stride: usize) -> Shares {
        let pixels = (stride * stride) as f64;
        Shares { shared: noise.shared * f64::from(self.area() / self.thinned(stride).area()) / pixels, own: noise.own / pixels }
    }

    /// Cells from one row to the next.
    pub const fn width(&self) -> usize {
        (self.columns + Self::gap(self.window[0])).next_multiple_of(WIDE)
    }

    /// Cells that keep windows apart, and a pixel's neighbours.
    const fn gap(edge: usize) -> usize {
        if edge > 1 { edge - 1 } else { 1 }
    }

    /// The cell of the first pixel; so many there are before it, and behind the last one's row.
    pub const fn first(&self) -> usize {
        Self::gap(self.window[1]) * self.width() + Self::gap(self.window[0])
    }

    /// How many cells behind its first one a window ends.
    const fn reach(&self) -> usize {
        (self.window[1] - 1) * self.width() + self.window[0] - 1
    }

    /// The cells from the first pixel to the end of the last one's row: of all, those to write to.
    pub const fn pixels(&self) -> core::ops::Range<usize> {
        self.first()..self.first() + self.rows * self.width()
    }

    /// The pixels of a plane, without what is before and behind.
    #[inline(always)]
    pub fn inside<'p>(&self, plane: &'p Plane) -> &'p Plane {
        plane.get(self.pixels()).unwrap_or_default()
    }

    /// Cells of a plane.
    pub const fn cells(&self) -> usize {
        2 * self.first() + self.rows * self.width()
    }

    /// Pixels of a window.
    fn area(&self) -> f32 {
        (self.window[0] * self.window[1]) as f32
    }

    /// How many cells before a pixel the window begins that has it in its middle.
    pub const fn to_middle(&self) -> usize {
        self.reach() / 2
    }

    /// Makes all but the pixels' rows `value`.
    pub fn clear_ends(&self, plane: &mut Plane, value: f32) {
        let pixels = self.pixels();
        if let Some((before, rest)) = plane.split_at_mut_checked(pixels.start) {
            before.fill(value);
            rest.iter_mut().skip(pixels.len()).for_each(|cell| *cell = value);
        }
    }

    /// Sums over the window that begins at each cell: B. What is no pixel must be 0 in `from`. `between` is room to work in.
    #[inline(always)]
    pub fn gather(&self, from: &Plane, between: &mut Plane, to: &mut Plane) {
        let windows = self.cells() - self.first();
        let rows = windows + (self.window[1] - 1) * self.width();
        if let (Some(between), Some(to)) = (between.get_mut(..rows), to.get_mut(..windows)) {
            sums(from, self.window[0], 1, between);
            sums(between, self.window[1], self.width(), to);
        }
    }

    /// Sums over the windows, `from` [`Grid::gather`], that each pixel is in: Bᵀ. Here cell 0 is the first pixel's.
    #[inline(always)]
    fn scatter(&self, from: &Plane, between: &mut Plane, to: &mut Plane) {
        let last = self.window[0] - 1;
        let from = from.get(self.first() - self.reach()..).unwrap_or_default();
        let windows = self.rows * self.width() + self.reach();
        if let (Some(between), Some(to)) = (between.get_mut(..windows - last), to.get_mut(..self.rows * self.width() - last)) {
            sums(from, self.window[0], 1, between);
            sums(between, self.window[1], self.width(), to);
        }
    }

    /// Solves C · weights = `jacobian` for each plane, nearly, by two steps of conjugate gradients: any weights give an unbiased estimate, these
    /// nearly the best there is. One step would be plain least squares. More than two make centers no more than 1 % better
    /// (`seeing_accuracy`), and worse where the window is not as thought: what they gain, they gain at the edges of what it lets through.
    ///
    /// Weights are sums of `jacobian` and of C · `jacobian`, so that products of those tell all. Where the third plane of `jacobian` is 0, the
    /// pixel takes no part. `room` has 10 planes.
    #[inline(always)]
    pub fn whiten(&self, noise: Shares, jacobian: [&Plane; 4], residual: &Plane, room: &mut [f32]) -> Whitened {
        let (shared, own) = (noise.shared as f32 / self.area(), noise.own as f32);
        let (images, room) = room.split_at_mut(4 * self.cells());
        let (sums, room) = room.split_at_mut(4 * self.cells());
        let (between, windows) = room.split_at_mut(self.cells());
        let pixels = self.pixels();
        let used = jacobian[2].get(pixels.clone()).unwrap_or_default();
        for (jacobian, image) in jacobian.iter().zip(images.chunks_exact_mut(self.cells())) {
            self.clear_ends(image, 0.0);
            self.gather(jacobian, between, windows);
            let image = image.get_mut(pixels.clone()).unwrap_or_default();
            self.scatter(windows, between, image);
            for ((image, jacobian), used) in image.iter_mut().zip(jacobian.get(pixels.clone()).unwrap_or_default()).zip(used) {
                *image = if *used == 0.0 { 0.0 } else { shared * *image + own * jacobian };
            }
        }
        for (image, sums) in images.chunks_exact(self.cells()).zip(sums.chunks_exact_mut(self.cells())) {
            self.gather(image, between, sums);
        }
        let mut images = images.chunks_exact(self.cells());
        let images: [&Plane; 4] = core::array::from_fn(|_| images.next().unwrap_or_default());
        let mut sums = sums.chunks_exact(self.cells()).map(|sums| sums.get(..self.cells() - self.first()).unwrap_or_default());
        let sums: [&Plane; 4] = core::array::from_fn(|_| sums.next().unwrap_or_default());

        // Jᵀ Cⁿ J.
        let [jacobian, images] = [jacobian, images].map(|planes| planes.map(|plane| self.inside(plane)));
        let residual = self.inside(residual);
        let (zeroth, first, second) = (products(jacobian, jacobian), products(jacobian, images), products(images, images));
        let third = products(sums, sums) * f64::from(shared) + second * f64::from(own);
        // The weights' share of either is where the gradients of both vanish.
        let shares = SMatrix::<f64, 4, 2>::from_fn(|i, j| {
            let [g0, g1, g2, g3] = [&zeroth, &first, &second, &third].map(|g| g[(i, i)]);
            let determinant = g1 * g3 - g2 * g2;
            let one = if g1 > 0.0 { g0 / g1 } else { 0.0 };
            match j {
                _ if determinant > PARALLEL * g1 * g3 => [g0 * g3 - g1 * g2, g1 * g1 - g0 * g2][j] / determinant,
                0 => one,
                _ => 0.0,
            }
        });
        let (a, b) = (SMatrix::from_diagonal(&shares.column(0).into_owned()), SMatrix::from_diagonal(&shares.column(1).into_owned()));
        let cross = a * second * b;
        Whitened {
            products: zeroth,
            response: a * zeroth + b * first,
            moments: a * moments(jacobian, residual) + b * moments(images, residual),
            covariance: a * first * a + cross + cross.transpose() + b * third * b,
        }
    }

    /// The covariance of Σ `weights` · reading where noise is shared only. `room` has 5 planes.
    #[inline(always)]
    pub fn covariance(&self, weights: [&Plane; 4], room: &mut [f32]) -> Products {
        let (between, room) = room.split_at_mut(self.cells());
        for (weights, sums) in weights.iter().zip(room.chunks_exact_mut(self.cells())) {
            self.gather(weights, between, sums);
        }
        let mut sums = room.chunks_exact(self.cells()).map(|sums| sums.get(..self.cells() - self.first()).unwrap_or_default());
        let sums = core::array::from_fn(|_| sums.next().unwrap_or_default());
        products(sums, sums) / f64::from(self.area())
    }
}

/// Fills each cell of `to` with the sum over `count` cells of `from`, each `step` behind the one before, from that cell on.
#[inline(always)]
fn sums(from: &Plane, count: usize, step: usize, to: &mut Plane) {
    match count {
        9 => sums_of::<9>(from, step, to),
        7 => sums_of::<7>(from, step, to),
        5 => sums_of::<5>(from, step, to),
        3 => sums_of::<3>(from, step, to),
        _ => sums_of::<1>(from, step, to),
    }
}

#[inline(always)]
fn sums_of<const N: usize>(from: &Plane, step: usize, to: &mut Plane) {
    let shifted: [&Plane; N] = core::array::from_fn(|i| from.get(i * step..i * step + to.len()).unwrap_or_default());
    if shifted.iter().all(|shifted| shifted.len() == to.len()) {
        for (i, to) in to.iter_mut().enumerate() {
            let mut sum = shifted[0][i];
            for shifted in &shifted[1..] {
                sum += shifted[i];
            }
            *to = sum;
        }
    }
}

/// Σ a bᵀ, where that is symmetric.
#[inline(always)]
pub fn products(a: [&Plane; 4], b: [&Plane; 4]) -> Products {
    let mut sum = [[[0.0_f32; WIDE]; 4]; 4];
    let [a, b] = [a, b].map(|planes| planes.map(|plane| plane.as_chunks::<WIDE>().0));
    let firsts = a[0].iter().zip(a[1]).zip(a[2]).zip(a[3]);
    let seconds = b[0].iter().zip(b[1]).zip(b[2]).zip(b[3]);
    for ((((a0, a1), a2), a3), (((b0, b1), b2), b3)) in firsts.zip(seconds) {
        let (a, b) = ([a0, a1, a2, a3], [b0, b1, b2, b3]);
        for i in 0..4 {
            for j in i..4 {
                sum[i][j] = core::array::from_fn(|k| sum[i][j][k] + a[i][k] * b[j][k]);
            }
        }
    }
    Products::from_fn(|i, j| sum[i.min(j)][i.max(j)].iter().map(|sum| f64::from(*sum)).sum())
}

/// Σ a · b.
#[inline(always)]
pub fn moments(a: [&Plane; 4], b: &Plane) -> SVector<f64, 4> {
    let mut sum = [[0.0_f32; WIDE]; 4];
    let [a0, a1, a2, a3] = a.map(|plane| plane.as_chunks::<WIDE>().0);
    for ((((a0, a1), a2), a3), b) in a0.iter().zip(a1).zip(a2).zip(a3).zip(b.as_chunks::<WIDE>().0) {
        for (sum, a) in sum.iter_mut().zip([a0, a1, a2, a3]) {
            *sum = core::array::from_fn(|k| sum[k] + a[k] * b[k]);
        }
    }
    sum.map(|sum| sum.iter().map(|sum| f64::from(*sum)).sum()).into()
}

/// Σ a · b.
#[inline(always)]
pub fn dot(a: &Plane, b: &Plane) -> f64 {
    let chunks = a.as_chunks::<WIDE>().0.iter().zip(b.as_chunks::<WIDE>().0);
    let sum = chunks.fold([0.0_f32; WIDE], |sum, (a, b)| core::array::from_fn(|k| sum[k] + a[k] * b[k]));
    sum.iter().map(|sum| f64::from(*sum)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec;

    /// Some pixels of a patch, in four planes.
    fn patch(grid: &Grid) -> [Vec<f32>; 4] {
        let value = |i: usize, lane: usize| {
            let Some((x, y)) = i.checked_sub(grid.first()).map(|i| (i % grid.width(), i / grid.width())) else { return 0.0 };
            let inside = x < grid.columns && y < grid.rows && i % 7 != 3;
            f32::from(u8::from(inside)) * (1.0 + 0.1 * (i % 11) as f32) * (1.0 + lane as f32 * (i % 5) as f32)
        };
        core::array::from_fn(|lane| (0..grid.cells()).map(|i| value(i, lane)).collect())
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
    fn sums_over_windows_are_the_covariance_and_its_inverse() {
        for window in [[9, 7], [1, 3], [9, 9], [1, 1]] {
            let (grid, noise) = (Grid::new(12, 9, window), Shares { shared: 0.7, own: 0.3 });
            let jacobian = patch(&grid);
            let planes = jacobian.each_ref().map(Vec::as_slice);
            let at = |i: usize, lane: usize| jacobian[lane][grid.first() + i / 12 * grid.width() + i % 12];
            let used: Vec<bool> = (0..PIXELS).map(|i| at(i, 2) != 0.0).collect();
            let j = SMatrix::<f64, PIXELS, 4>::from_fn(|i, lane| f64::from(at(i, lane)));
            let mut room = std::vec![f32::NAN; 10 * grid.cells()];
            let shared = covariance(&grid, Shares { shared: 1.0, own: 0.0 }, &used);
            let expected = j.transpose() * shared * j;
            let got = grid.covariance(planes, &mut room);
            assert!((got - expected).abs().max() < 1e-4 * expected.max(), "{got} {expected}");

            let c = covariance(&grid, noise, &used);
            let whitened = grid.whiten(noise, planes, planes[1], &mut room);
            let (once, twice) = (c * j, c * c * j);
            let plain = j.transpose() * once;
            let best = (j.transpose() * c.try_inverse().unwrap() * j).diagonal();
            let (response, variance) = (whitened.response, whitened.covariance);
            assert!((whitened.moments - response.column(1)).abs().max() < 1e-5 * response.max());
            for lane in 0..4 {
                // That the response is to the weights that have the covariance: both are known where the weights are.
                let basis = SMatrix::<f64, PIXELS, 2>::from_columns(&[j.column(lane), once.column(lane)]);
                let images = SMatrix::<f64, PIXELS, 2>::from_columns(&[once.column(lane), twice.column(lane)]);
                if let Some(inverse) = (basis.transpose() * images).try_inverse().filter(|_| window != [1, 1]) {
                    let weights = basis * (inverse * basis.transpose() * j.column(lane));
                    let expected = weights.transpose() * j;
                    assert!((response.row(lane) - expected).abs().max() < 1e-3 * expected.max(), "{response} {expected}");
                    let expected = (weights.transpose() * c * weights)[0];
                    assert!((variance[(lane, lane)] / expected - 1.0).abs() < 1e-3, "{variance} {expected}");
                }
                // Variance of the estimate: that of the sum over the square of the response.
                let efficiency = response[(lane, lane)] * response[(lane, lane)] / variance[(lane, lane)] / best[lane];
                let plain = j.column(lane).norm_squared() * j.column(lane).norm_squared() / plain[(lane, lane)] / best[lane];
                assert!(efficiency < 1.001 && efficiency > plain - 1e-3, "{window:?} lane {lane}: {efficiency}, plain {plain}");
                assert!(window == [1, 1] || efficiency > plain + 0.02, "{window:?} lane {lane}: {efficiency}, plain {plain}");
            }
        }
    }
}
