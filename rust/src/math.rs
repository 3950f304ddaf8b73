//! Elementary functions for the core, which has no `std`: the same bits on a laptop, a Pi and a microcontroller.

pub use libm::{acos, atan2, ceil, cos, exp, floor, fmod, hypot, log, pow, round, sin};
#[cfg(not(feature = "std"))]
pub use libm::{sqrt, sqrtf};

/// √x, rounded correctly as everywhere; unlike the core's it can be taken of many at once.
#[cfg(feature = "std")]
#[inline]
pub fn sqrt(x: f64) -> f64 {
    x.sqrt()
}

/// √x, as [`sqrt`].
#[cfg(feature = "std")]
#[inline]
pub fn sqrtf(x: f32) -> f32 {
    x.sqrt()
}

/// Position, velocity or acceleration.
pub type Vec3 = nalgebra::Vector3<f64>;
/// Covariance of a [`Vec3`], or a rotation.
pub type Mat3 = nalgebra::Matrix3<f64>;

/// Rows of a matrix as plain arrays, the form that events and Python see.
pub fn rows<const R: usize, const C: usize>(m: &nalgebra::SMatrix<f64, R, C>) -> [[f64; C]; R] {
    core::array::from_fn(|i| core::array::from_fn(|j| m[(i, j)]))
}

/// The symmetric part: covariances are symmetric to the last bit.
pub fn symmetric<const N: usize>(m: &nalgebra::SMatrix<f64, N, N>) -> nalgebra::SMatrix<f64, N, N> {
    (m + m.transpose()) * 0.5
}

/// Probability that a χ² variable of 3 degrees of freedom exceeds `x`.
pub fn chi2_3_sf(x: f64) -> f64 {
    if x <= 0.0 {
        return 1.0;
    }
    libm::erfc(sqrt(x * 0.5)) + sqrt(2.0 * x / core::f64::consts::PI) * exp(-0.5 * x)
}

/// The `x` that a χ² variable of 3 degrees of freedom exceeds with probability `p`.
pub fn chi2_3_isf(p: f64) -> f64 {
    let (mut low, mut high) = (0.0, 1500.0);
    for _ in 0..64 {
        let mid = 0.5 * (low + high);
        if chi2_3_sf(mid) > p { low = mid } else { high = mid }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chi_squared_tail_agrees_with_tables() {
        for (x, p) in [(7.814_727_903_251_178, 0.05), (16.266_236_196_238_13, 1e-3), (30.664_849_706_154_74, 1e-6)] {
            assert!((chi2_3_sf(x) / p - 1.0).abs() < 1e-6, "{x}");
            assert!((chi2_3_isf(p) - x).abs() < 1e-5, "{p}");
        }
    }
}
