//! What points say of the parabola that they are on: y = p + s v + s²/2 a.

use crate::math::{Mat3, Vec3};
use crate::physics::accumulator::Accumulator;
use crate::physics::factor::Product;

/// Σ sᵏ W over points with weights W at times s, and what they are: all that the normal equations are made of.
#[derive(Clone, Debug, Default)]
pub struct Moments {
    /// Of each W, the lower triangle column by column.
    weights: [[f64; 6]; 5],
    determinants: Product,
    count: usize,
}

/// Σ sᵏ W y and Σ yᵀWy.
#[derive(Clone, Copy, Debug, Default)]
pub struct Pulls {
    /// To s².
    pub powers: [Vec3; 3],
    /// Of the points themselves.
    pub square: f64,
}

impl Moments {
    /// There is a point with `weight` at `s`.
    pub fn add(&mut self, s: f64, weight: &Mat3) {
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

    /// Σ sᵏ W.
    pub fn weight(&self, k: usize) -> Mat3 {
        let [a, b, c, d, e, f] = self.weights[k];
        Mat3::new(a, b, c, b, d, e, c, e, f)
    }

    /// Adds to `fit` what only the evidence needs.
    pub fn count<const N: usize>(&self, fit: &mut Accumulator<N>) {
        fit.count(&self.determinants, 3 * self.count);
    }

    /// The normal equations of p, v, a without the points.
    pub fn normal_equations(&self) -> Accumulator<9> {
        let mut fit = Accumulator::default();
        // 1, s and s²/2, one times the other.
        for (i, j, k, factor) in [(0, 0, 0, 1.0), (3, 0, 1, 1.0), (3, 3, 2, 1.0), (6, 0, 2, 0.5), (6, 3, 3, 0.5), (6, 6, 4, 0.25)] {
            fit.add_block(i, j, &(self.weight(k) * factor));
        }
        self.count(&mut fit);
        fit
    }
}

impl Pulls {
    /// There is the point `y` with `weight` at `s`.
    pub fn add(&mut self, s: f64, y: &Vec3, weight: &Mat3) {
        let pull = weight * y;
        add_powers(&mut self.powers, s, &pull);
        self.square += y.dot(&pull);
    }
}

/// Adds sᵏ `x` to each sum.
pub fn add_powers(sums: &mut [Vec3; 3], s: f64, x: &Vec3) {
    let once = x * s;
    sums[0] += x;
    sums[1] += once;
    sums[2] += once * s;
}
