//! L D Lᵀ of a small symmetric matrix: what solves it, inverts it, and tells its determinant.

use nalgebra::{SMatrix, SVector};

/// L and 1/D of a positive definite matrix. Unlike a Cholesky factor it takes no roots.
///
/// Loops run over whole columns, zeros and what stands above the diagonal included: several numbers at once are faster than fewer.
#[derive(Clone, Debug)]
pub struct Factor<const N: usize> {
    /// Columns of L without its diagonal, which is of ones.
    columns: [[f64; N]; N],
    inverse: [f64; N],
    determinant: Product,
}

impl<const N: usize> Factor<N> {
    /// Of `matrix`, of which only the lower triangle is read; `None` where it is not positive definite.
    pub fn new(matrix: &SMatrix<f64, N, N>) -> Option<Self> {
        let mut columns = matrix.data.0;
        let (mut inverse, mut determinant) = ([0.0; N], Product::default());
        for j in 0..N {
            let mut column = columns[j];
            let pivot = column[j];
            if !(pivot > 0.0 && pivot < f64::INFINITY) {
                return None;
            }
            determinant.multiply(pivot);
            inverse[j] = 1.0 / pivot;
            column[..=j].fill(0.0);
            let scaled = column.map(|x| x * inverse[j]);
            for k in j + 1..N {
                subtract(&mut columns[k], scaled[k], &column);
            }
            columns[j] = scaled;
        }
        Some(Self { columns, inverse, determinant })
    }

    /// x of matrix · x = `y`.
    pub fn solve(&self, y: &SVector<f64, N>) -> SVector<f64, N> {
        let mut x = y.data.0[0];
        for (j, column) in self.columns.iter().enumerate() {
            let known = x[j];
            subtract(&mut x, known, column);
        }
        for (j, column) in self.columns.iter().enumerate().rev() {
            let later: f64 = column.iter().zip(&x).skip(j + 1).map(|(l, x)| l * x).sum();
            x[j] = x[j] * self.inverse[j] - later;
        }
        SVector::from(x)
    }

    /// The inverse matrix, symmetric to the last bit.
    pub fn invert(&self) -> SMatrix<f64, N, N> {
        // Σ of the rows r of L⁻¹, each r rᵀ / d.
        let (mut rows, mut inverse) = ([[0.0; N]; N], [[0.0; N]; N]);
        for k in 0..N {
            let mut row = [0.0; N];
            row[k] = 1.0;
            for (column, before) in self.columns.iter().zip(&rows).take(k) {
                subtract(&mut row, column[k], before);
            }
            for j in 0..=k {
                subtract(&mut inverse[j], -(row[j] * self.inverse[k]), &row);
            }
            rows[k] = row;
        }
        SMatrix::from_fn(|i, j| inverse[i.min(j)][i.max(j)])
    }

    /// Log of the matrix's determinant.
    pub fn log_determinant(&self) -> f64 {
        self.determinant.log()
    }
}

/// x − `factor` · y.
fn subtract<const N: usize>(x: &mut [f64; N], factor: f64, y: &[f64; N]) {
    for (x, y) in x.iter_mut().zip(y) {
        *x -= factor * y;
    }
}

/// A product of positive numbers that neither overflows nor underflows, so that one logarithm does for all of them.
#[derive(Clone, Copy, Debug)]
pub struct Product {
    /// From 1 to 2.
    mantissa: f64,
    exponent: i64,
}

impl Default for Product {
    fn default() -> Self {
        Self { mantissa: 1.0, exponent: 0 }
    }
}

impl Product {
    const ONE: u64 = 1f64.to_bits();
    const FRACTION: u64 = (1 << 52) - 1;

    /// Times `factor`; what is not positive counts as the smallest number.
    pub fn multiply(&mut self, factor: f64) {
        let bits = (self.mantissa * factor.max(f64::MIN_POSITIVE)).to_bits();
        self.exponent += (bits >> 52) as i64 - (Self::ONE >> 52) as i64;
        self.mantissa = f64::from_bits(bits & Self::FRACTION | Self::ONE);
    }

    /// Times `other`.
    pub fn join(&mut self, other: &Self) {
        self.exponent += other.exponent;
        self.multiply(other.mantissa);
    }

    /// Its natural logarithm.
    pub fn log(&self) -> f64 {
        libm::log(self.mantissa) + self.exponent as f64 * core::f64::consts::LN_2
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix3, Vector3};

    #[test]
    fn a_factor_solves_inverts_and_tells_the_determinant() {
        let root = Matrix3::new(2.0, 0.0, 0.0, -1.0, 100.0, 0.0, 0.5, 3.0, 0.1);
        let matrix = root * root.transpose();
        let factor = Factor::new(&matrix).unwrap();
        let x = Vector3::new(1.0, -2.0, 3.0);
        assert!((factor.solve(&(matrix * x)) - x).norm() < 1e-6);
        assert!((factor.invert() * matrix - Matrix3::identity()).abs().max() < 1e-6);
        assert_eq!(factor.invert(), factor.invert().transpose());
        assert!((factor.log_determinant() - 2.0 * libm::log(2.0 * 100.0 * 0.1)).abs() < 1e-9);
        assert!(Factor::new(&(matrix - Matrix3::identity() * 5.0)).is_none());
    }

    #[test]
    fn products_neither_overflow_nor_underflow() {
        let mut product = Product::default();
        for _ in 0..100 {
            product.multiply(1e300);
        }
        assert!((product.log() / (30_000.0 * core::f64::consts::LN_10) - 1.0).abs() < 1e-12);
        for _ in 0..100 {
            product.multiply(1e-300);
        }
        assert!(product.log().abs() < 1e-9);
    }
}
