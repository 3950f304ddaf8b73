//! What points say of the parabola that they are on: y = p + s v + s²/2 a.

use crate::math::{Mat3, Vec3};
use crate::physics::accumulator::Accumulator;
use crate::physics::factor::Product;

/// Σ sᵏ W and Σ sᵏ W y over points y with weights W at times s: all that the normal equations are made of.
#[derive(Clone, Debug, Default)]
pub struct Moments {
    /// Of each W, the lower triangle column by column.
    weights: [[f64; 6]; 5],
    points: [Vec3; 3],
    /// Σ yᵀWy.
    square: f64,
    determinants: Product,
    count: usize,
}

impl Moments {
    /// There is a point with `weight` at `s`.
    pub fn weigh(&mut self, s: f64, weight: &Mat3) {
        let w = weight;
        let mut power = [w[0], w[1], w[2], w[4], w[5], w[8]];
        for sum in &mut self.weights {
            for (sum, x) in sum.iter_mut().zip(&mut power) {
                *sum += *x;
                *x *= s;
            }
        }
        self.determinants.multiply(weight.determinant());
        self.count += 1;
    }

    /// It is `y`.
    pub fn see(&mut self, s: f64, y: &Vec3, weight: &Mat3) {
        let pull = weight * y;
        add_powers(&mut self.points, s, &pull);
        self.square += y.dot(&pull);
    }

    /// Σ sᵏ W.
    pub fn weight(&self, k: usize) -> Mat3 {
        let [a, b, c, d, e, f] = self.weights[k];
        Mat3::new(a, b, c, b, d, e, c, e, f)
    }

    /// Σ sᵏ W y.
    pub fn point(&self, k: usize) -> Vec3 {
        self.points[k]
    }

    /// Adds to `fit` what no unknown matters for.
    pub fn count<const N: usize>(&self, fit: &mut Accumulator<N>) {
        fit.count(self.square, &self.determinants, 3 * self.count);
    }

    /// The normal equations of p, v, a.
    pub fn normal_equations(&self) -> Accumulator<9> {
        let mut fit = Accumulator::default();
        // 1, s and s²/2, one times the other.
        for (i, j, k, factor) in [(0, 0, 0, 1.0), (3, 0, 1, 1.0), (3, 3, 2, 1.0), (6, 0, 2, 0.5), (6, 3, 3, 0.5), (6, 6, 4, 0.25)] {
            fit.add_block(i, j, &(self.weight(k) * factor));
        }
        for (i, k, factor) in [(0, 0, 1.0), (3, 1, 1.0), (6, 2, 0.5)] {
            fit.pull(i, &(self.point(k) * factor));
        }
        self.count(&mut fit);
        fit
    }
}

/// Adds sᵏ `x` to each sum.
pub fn add_powers(sums: &mut [Vec3; 3], s: f64, x: &Vec3) {
    let once = x * s;
    sums[0] += x;
    sums[1] += once;
    sums[2] += once * s;
}
