//! The one mathematics under everything: linear-Gaussian observations, gathered as normal equations.
//!
//! Each observation says y = H x + noise. What is kept is the information matrix `Σ HᵀWH`, the vector `Σ HᵀWy` and the
//! scalars that the marginal likelihood needs, so hypotheses over the same measurements compare by [`Solution::log_evidence`].

use crate::math::{Mat3, Vec3};
use crate::physics::factor::{Factor, Product};
use nalgebra::{SMatrix, SVector};

/// log 2π.
const LN_TAU: f64 = 1.837_877_066_409_345_3;

/// Normal equations of `N` unknowns.
#[derive(Clone, Debug)]
pub struct Accumulator<const N: usize> {
    /// Its lower triangle; what stands above it does not count.
    information: SMatrix<f64, N, N>,
    vector: SVector<f64, N>,
    square: f64,
    /// Determinants of the weights, and how many numbers were observed.
    weights: Product,
    observed: usize,
}

/// What the normal equations say.
#[derive(Clone, Debug)]
pub struct Solution<const N: usize> {
    /// The unknowns.
    pub mean: SVector<f64, N>,
    /// Their covariance.
    pub covariance: SMatrix<f64, N, N>,
    /// Weighted sum of squared residuals at the mean, priors included.
    pub chi2: f64,
    /// Log of the marginal likelihood of all observations; priors must be proper for it to mean something.
    pub log_evidence: f64,
}

/// The same without the covariance, which takes the longest, until it is asked for.
#[derive(Clone, Debug)]
pub struct Estimate<const N: usize> {
    /// The unknowns.
    pub mean: SVector<f64, N>,
    /// As of [`Solution`].
    pub chi2: f64,
    /// As of [`Solution`].
    pub log_evidence: f64,
    /// Of the information.
    pub factor: Factor<N>,
}

impl<const N: usize> Default for Accumulator<N> {
    fn default() -> Self {
        Self { information: SMatrix::zeros(), vector: SVector::zeros(), square: 0.0, weights: Product::default(), observed: 0 }
    }
}

impl<const N: usize> Accumulator<N> {
    /// Scalar observations: prior knowledge that row · x = `value`, with standard deviation `sd`.
    pub fn observe(&mut self, row: &SVector<f64, N>, value: f64, sd: f64) {
        let w = 1.0 / (sd * sd);
        self.information.ger(w, row, row, 1.0);
        self.vector.axpy(w * value, row, 1.0);
        self.square += w * value * value;
        self.weights.multiply(w);
        self.observed += 1;
    }

    /// Prior knowledge of the unknown `index` alone.
    pub fn expect(&mut self, index: usize, value: f64, sd: f64) {
        let w = 1.0 / (sd * sd);
        self.information[(index, index)] += w;
        self.vector[index] += w * value;
        self.square += w * value * value;
        self.weights.multiply(w);
        self.observed += 1;
    }

    /// A point y = H x + noise.
    pub fn observe_design(&mut self, design: &SMatrix<f64, 3, N>, y: &Vec3, weight: &Mat3) {
        let hw = design.transpose() * weight;
        self.information += hw * design;
        self.vector += hw * y;
        self.weigh(y.dot(&(weight * y)), weight);
    }

    /// Integrates three unknowns out that no later observation sees. What was observed with them at zero says of them, beside x, that
    /// `information` · them + `cross` · x = `vector`; their prior is part of that.
    pub fn integrate_out(&mut self, information: &Mat3, cross: &SMatrix<f64, 3, N>, vector: &Vec3) {
        let Some(cholesky) = information.cholesky() else { return };
        let (solved, pull) = (cholesky.solve(cross), cholesky.solve(vector));
        self.information -= cross.transpose() * solved;
        self.vector -= cross.transpose() * pull;
        self.square -= vector.dot(&pull);
        self.weights.multiply(1.0 / information.determinant());
        self.observed = self.observed.saturating_sub(3);
    }

    /// The log of a prior's normalisation whose quadratic part went elsewhere: of three unknowns with this `information` about them.
    pub fn normalise(&mut self, information: &Mat3) {
        self.weigh(0.0, information);
    }

    fn weigh(&mut self, square: f64, weight: &Mat3) {
        self.square += square;
        self.weights.multiply(weight.determinant());
        self.observed += 3;
    }

    /// Knowledge of three neighbouring unknowns from `first` on: Gaussian with `information` about `mean`.
    pub fn expect_block(&mut self, first: usize, mean: &Vec3, information: &Mat3) {
        let pull = information * mean;
        self.add_block(first, first, information);
        self.pull(first, &pull);
        self.weigh(mean.dot(&pull), information);
    }

    /// Adds to the information about three unknowns from `row` on and three from `column` on, which do not come later.
    pub fn add_block(&mut self, row: usize, column: usize, block: &Mat3) {
        let mut sum = self.information.fixed_view_mut::<3, 3>(row, column);
        sum += block;
    }

    /// The same for the single unknown `at`, with itself and with three from each place on.
    pub fn add_single(&mut self, at: usize, own: f64, with: &[(usize, Vec3)]) {
        self.information[(at, at)] += own;
        for (first, block) in with {
            for i in 0..3 {
                self.information[(at.max(first + i), at.min(first + i))] += block[i];
            }
        }
    }

    /// Adds to the vector, from `first` on.
    pub fn pull(&mut self, first: usize, pull: &Vec3) {
        let mut sum = self.vector.fixed_rows_mut::<3>(first);
        sum += pull;
    }

    /// Adds to the vector at `at`.
    pub fn pull_single(&mut self, at: usize, pull: f64) {
        self.vector[at] += pull;
    }

    /// Adds to the observations' weighted square.
    pub fn square(&mut self, square: f64) {
        self.square += square;
    }

    /// Adds to what only the evidence needs: the product of the weights' determinants, and how many numbers were observed.
    pub fn count(&mut self, weights: &Product, observed: usize) {
        self.weights.join(weights);
        self.observed += observed;
    }

    /// The information that is left about the three unknowns from `first` on when all others are free: (matrix, vector).
    /// `None` where the others are not determined.
    pub fn marginal(&self, first: usize) -> Option<(Mat3, Vec3)> {
        // The Schur complement, by the inverse of the covariance's block, with the block itself held off zero.
        let mut held = self.clone();
        let ridge = Mat3::identity();
        held.expect_block(first, &Vec3::zeros(), &ridge);
        let solution = held.solve()?;
        let covariance: Mat3 = solution.covariance.fixed_view::<3, 3>(first, first).into();
        let mean: Vec3 = solution.mean.fixed_rows::<3>(first).into();
        let information = crate::math::symmetric(&covariance.try_inverse()?);
        Some((information - ridge, information * mean))
    }

    /// Mean, covariance, χ² and evidence; `None` where something is not determined.
    pub fn solve(&self) -> Option<Solution<N>> {
        let estimate = self.estimate()?;
        let covariance = estimate.covariance()?;
        Some(Solution { mean: estimate.mean, covariance, chi2: estimate.chi2, log_evidence: estimate.log_evidence })
    }

    /// Mean, χ² and evidence; `None` where something is not determined.
    pub fn estimate(&self) -> Option<Estimate<N>> {
        self.estimate_by(Factor::new(&self.information)?)
    }

    /// The same with the factor of another estimate, which weighed the same observations.
    #[inline]
    pub fn estimate_by(&self, factor: Factor<N>) -> Option<Estimate<N>> {
        let mean = factor.solve(&self.vector);
        let chi2 = (self.square - mean.dot(&self.vector)).max(0.0);
        let volume = (N as f64 - self.observed as f64) * LN_TAU - factor.log_determinant();
        let log_evidence = 0.5 * (self.weights.log() - chi2 + volume);
        mean.iter().all(|x| x.is_finite()).then_some(Estimate { mean, chi2, log_evidence, factor })
    }
}

impl<const N: usize> Estimate<N> {
    /// Covariance of the unknowns; `None` where it is not finite.
    pub fn covariance(&self) -> Option<SMatrix<f64, N, N>> {
        let covariance = self.factor.invert();
        covariance.iter().all(|x| x.is_finite()).then_some(covariance)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of a point at time `t` on a line.
    fn line(t: f64) -> SMatrix<f64, 3, 6> {
        SMatrix::from_fn(|i, j| {
            if j == i {
                1.0
            } else if j == i + 3 {
                t
            } else {
                0.0
            }
        })
    }

    #[test]
    fn evidence_is_the_gaussian_marginal_likelihood() {
        // One unknown with prior N(0, 2²), seen once with sd 1 at 3: marginally N(0, 5).
        let mut a = Accumulator::<1>::default();
        a.expect(0, 0.0, 2.0);
        a.expect(0, 3.0, 1.0);
        let s = a.solve().unwrap();
        let expected = -0.5 * libm::log(core::f64::consts::TAU * 5.0) - 0.5 * 9.0 / 5.0;
        assert!((s.log_evidence - expected).abs() < 1e-12);
        assert!((s.mean[0] - 2.4).abs() < 1e-12 && (s.covariance[(0, 0)] - 0.8).abs() < 1e-12);
    }

    #[test]
    fn the_marginal_is_the_schur_complement() {
        let mut a = Accumulator::<6>::default();
        for (t, x) in [(0.0, 1.0), (1.0, 2.5), (2.0, 3.0)] {
            a.observe_design(&line(t), &Vec3::new(x, -x, 2.0 * x), &Mat3::from_diagonal_element(4.0));
        }
        let (information, vector) = a.marginal(3).unwrap();
        // A line through t = 0, 1, 2: the slope's information is w Σ (t − 1)² = 8, its value (3 − 1) / 2.
        assert!((information - Mat3::from_diagonal_element(8.0)).abs().max() < 1e-9);
        assert!((vector - Vec3::new(8.0, -8.0, 16.0)).abs().max() < 1e-9);
    }

    #[test]
    fn what_is_integrated_out_leaves_what_a_larger_fit_says_of_the_rest() {
        // y = x + u with u ~ N(0, 0.5²), seen twice through the same u.
        let (w, prior) = (Mat3::from_diagonal_element(4.0), Mat3::from_diagonal_element(4.0));
        let seen = [Vec3::new(1.0, 2.0, 3.0), Vec3::new(1.5, 1.0, 3.5)];
        let (mut whole, mut reduced) = (Accumulator::<6>::default(), Accumulator::<3>::default());
        whole.expect_block(0, &Vec3::zeros(), &Mat3::identity());
        reduced.expect_block(0, &Vec3::zeros(), &Mat3::identity());
        whole.expect_block(3, &Vec3::zeros(), &prior);
        reduced.normalise(&prior);
        for y in &seen {
            whole.observe_design(&SMatrix::from_fn(|i, j| if j % 3 == i { 1.0 } else { 0.0 }), y, &w);
            reduced.observe_design(&SMatrix::identity(), y, &w);
        }
        let cross = SMatrix::<f64, 3, 3>::from(w * 2.0);
        reduced.integrate_out(&(prior + w * 2.0), &cross, &(w * (seen[0] + seen[1])));
        let (whole, reduced) = (whole.solve().unwrap(), reduced.solve().unwrap());
        assert!((whole.log_evidence - reduced.log_evidence).abs() < 1e-9);
        assert!((whole.mean.fixed_rows::<3>(0) - reduced.mean).norm() < 1e-12);
        assert!((whole.covariance.fixed_view::<3, 3>(0, 0) - reduced.covariance).norm() < 1e-12);
    }

    #[test]
    fn what_is_not_determined_is_none() {
        let mut a = Accumulator::<6>::default();
        a.observe_design(&line(0.5), &Vec3::zeros(), &Mat3::identity());
        assert!(a.solve().is_none());
    }
}
