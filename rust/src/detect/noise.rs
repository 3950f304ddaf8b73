//! How much a depth reading may be off.

use nalgebra::{SMatrix, SVector};

/// A pixel's parts in three estimates and in two checks of the noise.
pub type Score = SVector<f64, 5>;
/// Covariance of sums of [`Score`]s.
pub type ScoreCovariance = SMatrix<f64, 5, 5>;

/// Noise of a depth image: along the ray, across it, and over how many pixels it is shared.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Noise {
    /// Columns and rows of the matching window, px: readings whose windows overlap share noise in proportion. 9 × 9 or 9 × 7 in a Kinect v1
    /// (Konolige and Mihelich 2010).
    pub window: [usize; 2],
}

impl Default for Noise {
    fn default() -> Self {
        Self { window: [9, 7] }
    }
}

impl Noise {
    /// Standard deviation of a reading at depth `z`, m: Nguyen, Izadi, Lovell 2012, Eq. 6.
    #[inline]
    pub fn axial(self, z: f64) -> f64 {
        0.0012 + 0.0019 * (z - 0.4) * (z - 0.4)
    }

    /// Standard deviation across the ray, px, where the ray meets the surface at an angle whose cosine is `cos`:
    /// Nguyen, Izadi, Lovell 2012, Eq. 5, 0.8 + 0.035 θ/(π/2 − θ), with π/2 − θ = asin(cos) ≈ cos, which is right where the term counts.
    #[inline]
    pub fn lateral(self, cos: f64) -> f64 {
        0.8 + 0.035 * (core::f64::consts::FRAC_PI_2 / cos.max(1e-3) - 1.0).max(0.0)
    }
}

/// A factor on a modelled variance, learned from what is seen: the mean of squares over their modelled expectation. It starts at 1, as if that had
/// been seen some times, and forgets slowly.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Factor {
    sum: f64,
    weight: f64,
}

impl Default for Factor {
    fn default() -> Self {
        Self { sum: 8.0, weight: 8.0 }
    }
}

impl Factor {
    /// What is known by now.
    pub fn value(self) -> f64 {
        self.sum / self.weight
    }

    /// Learns from one more; a wild one counts as if it were 10 times what is known.
    pub fn learn(&mut self, ratio: f64) {
        let ratio = ratio.clamp(0.0, 10.0 * self.value()).max(1e-3);
        let keep = if self.weight < 200.0 { 1.0 } else { 199.0 / 200.0 };
        self.sum = self.sum * keep + ratio;
        self.weight = self.weight * keep + 1.0;
    }
}

/// Factors on the variance of a ball's depth and of its silhouette.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Factors {
    /// Of the depth of its cap.
    pub cap: Factor,
    /// Of its silhouette.
    pub outline: Factor,
}

/// The pixels around one ball, each with its part in `N` estimates, times the standard deviation of its noise.
pub struct Scores<'s, const N: usize> {
    pixels: &'s mut [[f32; N]],
    width: usize,
    height: usize,
    window: [usize; 2],
}

impl<'s, const N: usize> Scores<'s, N> {
    /// A patch of `width` × `height` pixels whose noise is shared over `window`; `None` where `pixels` are too few.
    pub fn new(pixels: &'s mut [[f32; 5]], width: usize, height: usize, window: [usize; 2]) -> Option<Self> {
        let window = window.map(|edge| edge.max(1));
        let (width, height) = (width + window[0] - 1, height + window[1] - 1);
        let pixels = pixels.as_flattened_mut().as_chunks_mut().0.get_mut(..width * height)?;
        pixels.fill([0.0; N]);
        Some(Self { pixels, width, height, window })
    }

    /// Sets the scores of the pixel in column `x`, row `y` of the patch.
    #[inline]
    pub fn set(&mut self, x: usize, y: usize, scores: [f64; N]) {
        if let Some(pixel) = self.pixels.get_mut(y * self.width + x) {
            *pixel = scores.map(|score| score as f32);
        }
    }

    /// Replaces each pixel by the sum over the window that ends there.
    fn sum_windows(&mut self) {
        let (width, window) = (self.width, self.window);
        for row in self.pixels.chunks_exact_mut(width) {
            box_sums(row, width, 1, window[0]);
        }
        for column in 0..width {
            box_sums(self.pixels.get_mut(column..).unwrap_or_default(), self.height, width, window[1]);
        }
    }
}

impl Scores<'_, 2> {
    /// For scores (value, 1) where there is a value and 0 where there is none: tells `each` pixel's column, row and mean value over the
    /// window around it, NaN where the window is empty.
    pub fn means(mut self, mut each: impl FnMut(usize, usize, f32)) {
        self.sum_windows();
        let [right, down] = self.window.map(|edge| edge / 2);
        for (y, row) in self.pixels.chunks_exact(self.width).skip(down).take(self.height + 1 - self.window[1]).enumerate() {
            for (x, [sum, count]) in row.iter().skip(right).take(self.width + 1 - self.window[0]).enumerate() {
                each(x, y, if *count > 0.5 { sum / count } else { f32::NAN });
            }
        }
    }
}

impl Scores<'_, 5> {
    /// Covariance of the sum of all scores. Noise that is shared over a window of w × w is white noise ε, one a pixel, averaged:
    /// e(p) = Σ ε(q)/w over the window at p. So Σ s(p) e(p) = Σ ε(q) (Σ s over the window at q)/w, and the ε are independent.
    pub fn covariance(mut self) -> ScoreCovariance {
        self.sum_windows();
        let window = self.window;
        let mut sum = [[0.0_f32; 5]; 5];
        for pixel in self.pixels.iter() {
            for (row, a) in sum.iter_mut().zip(pixel) {
                for (sum, b) in row.iter_mut().zip(pixel) {
                    *sum += a * b;
                }
            }
        }
        ScoreCovariance::from_fn(|i, j| f64::from(sum[i][j])) / (window[0] * window[1]) as f64
    }
}

/// Replaces each of the `count` values that lie `stride` apart by the sum of itself and the `window` − 1 before it; the last `window` − 1 are 0.
fn box_sums<const N: usize>(values: &mut [[f32; N]], count: usize, stride: usize, window: usize) {
    let mut sum = [0.0_f32; N];
    for i in (0..count + window).rev() {
        // Backwards, so that what leaves the window has not been overwritten yet.
        let entering = if i >= window { values.get((i - window) * stride).copied().unwrap_or([0.0; N]) } else { [0.0; N] };
        let leaving = if i < count { values.get(i * stride).copied().unwrap_or([0.0; N]) } else { [0.0; N] };
        if let Some(value) = values.get_mut(i * stride).filter(|_| i < count) {
            *value = sum;
        }
        for (sum, (entering, leaving)) in sum.iter_mut().zip(entering.into_iter().zip(leaving)) {
            *sum += entering - leaving;
        }
    }
}
