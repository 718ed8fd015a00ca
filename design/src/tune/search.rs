//! The search for the least cost: CMA-ES, an evolution strategy that learns how the variables hang
//! together.
//!
//! The cost comes from flights with limits, dead bands and noise: it has steps and plateaus, and no
//! useful gradient. An evolution strategy needs none, tries a whole generation in parallel, and
//! gives the same result for the same seed. Gains hang together, so that the strategy must learn
//! their covariance: one with a spread for each alone stops halfway. (N. Hansen, The CMA Evolution
//! Strategy: A Tutorial, 2016, whose equations are named below.)
//!
//! The library for it (`cmaes`) brings another linear algebra, another generator of random numbers
//! and a library of statistics, half a minute of every first build; here it is a page.

use nalgebra::{DMatrix, DVector};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use rayon::prelude::*;

/// What a search shows of its progress.
pub const BAR: &str = "{bar:40} generation {pos}/{len}, {eta} left, cost {msg}";
/// Candidates in a generation, the better half of which make the next.
pub const CANDIDATES: usize = 14;
const PARENTS: usize = CANDIDATES / 2;
/// Spread of the first generation, in logarithms.
const SPREAD: f64 = 0.2;

/// The point of least cost found, with its cost. Variables are positive and searched by their
/// logarithms; `told` is called with the best so far after every generation.
pub fn minimise<const N: usize>(
    start: [f64; N],
    generations: u32,
    seed: u64,
    cost: impl Fn(&[f64; N]) -> f64 + Sync,
    mut told: impl FnMut(&[f64; N], f64),
) -> ([f64; N], f64) {
    let point = |x: &DVector<f64>| std::array::from_fn(|i| x[i].exp());
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut best = (start, cost(&start));
    let mut strategy = Strategy::new(DVector::from_iterator(N, start.map(f64::ln)));
    for _ in 0..generations {
        let steps: Vec<DVector<f64>> = (0..CANDIDATES).map(|_| strategy.step(&mut rng)).collect();
        let mut tried: Vec<(f64, DVector<f64>)> = steps
            .into_par_iter()
            .map(|step| {
                let x = &strategy.mean + strategy.spread * &step;
                (cost(&point(&x)), step)
            })
            .collect();
        tried.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (least, step) = &tried[0];
        if *least < best.1 {
            best = (point(&(&strategy.mean + strategy.spread * step)), *least);
        }
        let steps: Vec<&DVector<f64>> = tried.iter().map(|(_, step)| step).take(PARENTS).collect();
        strategy.learn(&steps);
        told(&best.0, best.1);
    }
    best
}

/// The normal distribution from which candidates are drawn, and how it learns.
struct Strategy {
    mean: DVector<f64>,
    /// The step size (sigma).
    spread: f64,
    /// The covariance, and its square root as axes and lengths.
    covariance: DMatrix<f64>,
    axes: DMatrix<f64>,
    lengths: DVector<f64>,
    /// The paths of the step size and of the covariance.
    size_path: DVector<f64>,
    path: DVector<f64>,
    generation: i32,
    weights: [f64; PARENTS],
    /// Variance that the weights leave (mu_eff).
    effective: f64,
}

impl Strategy {
    fn new(mean: DVector<f64>) -> Self {
        let n = mean.len();
        // Equation 49, positive weights alone.
        let raw: [f64; PARENTS] =
            std::array::from_fn(|i| ((CANDIDATES + 1) as f64 / 2.0).ln() - ((i + 1) as f64).ln());
        let sum: f64 = raw.iter().sum();
        let weights = raw.map(|weight| weight / sum);
        Self {
            mean,
            spread: SPREAD,
            covariance: DMatrix::identity(n, n),
            axes: DMatrix::identity(n, n),
            lengths: DVector::repeat(n, 1.0),
            size_path: DVector::zeros(n),
            path: DVector::zeros(n),
            generation: 0,
            weights,
            effective: 1.0 / weights.iter().map(|weight| weight * weight).sum::<f64>(),
        }
    }

    /// A step from the mean, in units of the spread (equation 39).
    fn step(&self, rng: &mut impl Rng) -> DVector<f64> {
        let normal = DVector::from_fn(self.mean.len(), |_, _| rng.sample(StandardNormal));
        &self.axes * self.lengths.component_mul(&normal)
    }

    /// Takes over the best steps, the best first (equations 41 to 47, with the constants of table
    /// 1).
    fn learn(&mut self, steps: &[&DVector<f64>]) {
        let n = self.mean.len() as f64;
        let effective = self.effective;
        let size_rate = (effective + 2.0) / (n + effective + 5.0);
        let damping =
            1.0 + size_rate + 2.0 * (((effective - 1.0) / (n + 1.0)).sqrt() - 1.0).max(0.0);
        let path_rate = (4.0 + effective / n) / (n + 4.0 + 2.0 * effective / n);
        let one_rate = 2.0 / ((n + 1.3).powi(2) + effective);
        let many_rate = (2.0 * (effective - 2.0 + 1.0 / effective)
            / ((n + 2.0).powi(2) + effective))
            .min(1.0 - one_rate);
        let usual = n.sqrt() * (1.0 - 1.0 / (4.0 * n) + 1.0 / (21.0 * n * n));

        let mut mean_step = DVector::zeros(self.mean.len());
        for (weight, step) in self.weights.iter().zip(steps) {
            mean_step += *weight * *step;
        }
        self.mean += self.spread * &mean_step;
        self.generation += 1;

        let white = &self.axes * (self.axes.transpose() * &mean_step).component_div(&self.lengths);
        self.size_path = (1.0 - size_rate) * &self.size_path
            + (size_rate * (2.0 - size_rate) * effective).sqrt() * white;
        let grown =
            self.size_path.norm() / (1.0 - (1.0 - size_rate).powi(2 * self.generation)).sqrt();
        let is_usual = grown < (1.4 + 2.0 / (n + 1.0)) * usual;
        self.path *= 1.0 - path_rate;
        if is_usual {
            self.path += (path_rate * (2.0 - path_rate) * effective).sqrt() * &mean_step;
        }
        let lost = if is_usual { 0.0 } else { path_rate * (2.0 - path_rate) };
        self.covariance *= 1.0 + one_rate * lost - one_rate - many_rate;
        self.covariance += one_rate * &self.path * self.path.transpose();
        for (weight, step) in self.weights.iter().zip(steps) {
            self.covariance += many_rate * *weight * *step * step.transpose();
        }
        self.spread *= (size_rate / damping * (self.size_path.norm() / usual - 1.0)).exp();

        let eigen = self.covariance.clone().symmetric_eigen();
        self.axes = eigen.eigenvectors;
        // Rounding may leave a value below zero.
        self.lengths = eigen.eigenvalues.map(|value| value.max(1e-20).sqrt());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn finds_the_bottom_of_a_bowl_with_steps() {
        let cost = |x: &[f64; 3]| {
            let off = |x: f64, at: f64| (10.0 * (x / at).ln()).abs().floor();
            off(x[0], 2.0) + off(x[1], 0.3) + off(x[2], 5.0)
        };
        let (x, least) = minimise([1.0, 0.5, 4.0], 60, 1, cost, |_, _| ());
        assert!(least <= 1.0, "{x:?} {least}");
        assert_eq!(minimise([1.0, 0.5, 4.0], 60, 1, cost, |_, _| ()), (x, least));
    }

    /// A valley a thousand times as long as wide, along no axis.
    #[test]
    fn learns_how_variables_hang_together() {
        let cost = |x: &[f64; 4]| {
            let y = x.map(f64::ln);
            let along = y.iter().sum::<f64>() - 2.0;
            let across = [y[0] - y[1], y[1] - y[2], y[2] - y[3]];
            along.powi(2) + 1e6 * across.iter().map(|d| d * d).sum::<f64>()
        };
        let (x, least) = minimise([1.0, 1.5, 0.7, 1.2], 300, 1, cost, |_, _| ());
        assert!(least < 1e-3, "{x:?} {least}");
        assert!(x.iter().all(|x| (x.ln() - 0.5).abs() < 0.05), "{x:?}");
    }
}
