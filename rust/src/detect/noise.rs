//! How much a depth reading may be off.

use crate::math::{Mat3, Vec3};

/// Noise of a depth image: along the ray, across it, and over how many pixels it is shared.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Noise {
    /// Edge of the matching window, px: readings closer than this share noise, in proportion to how much their windows overlap.
    pub window: usize,
}

impl Default for Noise {
    fn default() -> Self {
        Self { window: 9 }
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

/// The pixels around one ball, each with three numbers: its part in three estimates, times the standard deviation of its noise.
pub struct Scores<'s> {
    pixels: &'s mut [[f32; 3]],
    width: usize,
    height: usize,
    window: usize,
}

impl<'s> Scores<'s> {
    /// A patch of `width` × `height` pixels whose noise is shared over `window`; `None` where `pixels` are too few.
    pub fn new(pixels: &'s mut [[f32; 3]], width: usize, height: usize, window: usize) -> Option<Self> {
        let window = window.max(1);
        let (width, height) = (width + window - 1, height + window - 1);
        let pixels = pixels.get_mut(..width * height)?;
        pixels.fill([0.0; 3]);
        Some(Self { pixels, width, height, window })
    }

    /// Sets the scores of the pixel in column `x`, row `y` of the patch.
    #[inline]
    pub fn set(&mut self, x: usize, y: usize, score: &Vec3) {
        if let Some(pixel) = self.pixels.get_mut(y * self.width + x) {
            *pixel = [score.x as f32, score.y as f32, score.z as f32];
        }
    }

    /// Covariance of the sum of all scores. Noise that is shared over a window of w × w is white noise ε, one a pixel, averaged:
    /// e(p) = Σ ε(q)/w over the window at p. So Σ s(p) e(p) = Σ ε(q) (Σ s over the window at q)/w, and the ε are independent.
    pub fn covariance(self) -> Mat3 {
        let (width, window) = (self.width, self.window);
        for row in self.pixels.chunks_exact_mut(width) {
            box_sums(row, width, 1, window);
        }
        for column in 0..width {
            box_sums(self.pixels.get_mut(column..).unwrap_or_default(), self.height, width, window);
        }
        let mut sum = [0.0_f32; 6];
        for [a, b, c] in self.pixels.iter() {
            for (sum, product) in sum.iter_mut().zip([a * a, a * b, a * c, b * b, b * c, c * c]) {
                *sum += product;
            }
        }
        let [aa, ab, ac, bb, bc, cc] = sum.map(f64::from);
        Mat3::new(aa, ab, ac, ab, bb, bc, ac, bc, cc) / (window * window) as f64
    }
}

/// Replaces each of the `count` values that lie `stride` apart by the sum of itself and the `window` − 1 before it; the last `window` − 1 are 0.
fn box_sums(values: &mut [[f32; 3]], count: usize, stride: usize, window: usize) {
    let mut sum = [0.0_f32; 3];
    for i in (0..count + window).rev() {
        // Backwards, so that what leaves the window has not been overwritten yet.
        let entering = if i >= window { values.get((i - window) * stride).copied().unwrap_or_default() } else { [0.0; 3] };
        let leaving = if i < count { values.get(i * stride).copied().unwrap_or_default() } else { [0.0; 3] };
        if let Some(value) = values.get_mut(i * stride).filter(|_| i < count) {
            *value = sum;
        }
        for (sum, (entering, leaving)) in sum.iter_mut().zip(entering.into_iter().zip(leaving)) {
            *sum += entering - leaving;
        }
    }
}
