//! The search for the least cost: an evolution strategy.
//!
//! The cost comes from flights with limits, dead bands and noise: it has steps and plateaus, and no
//! useful gradient. A `(mu, lambda)` strategy with a spread for each variable needs none, tries a
//! whole generation in parallel, and gives the same result for the same seed. It is of the family
//! of Ros and Hansen, A simple modification in CMA-ES achieving linear time and space complexity,
//! 2008.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use rayon::prelude::*;

/// Candidates in a generation.
pub const CANDIDATES: usize = 10;
/// The best of them, from which the next generation is drawn.
const PARENTS: usize = 4;
/// Spread of the first generation, in logarithms: a quarter either way.
const SPREAD: f64 = 0.25;
/// Share of a spread that a generation replaces.
const LEARNING: f64 = 0.3;

/// The point of least cost found, with its cost. Variables are positive and searched by their
/// logarithms; `told` is called with the least cost after every generation.
pub fn minimise<const N: usize>(
    start: [f64; N],
    generations: u32,
    seed: u64,
    cost: impl Fn(&[f64; N]) -> f64 + Sync,
    mut told: impl FnMut(f64),
) -> ([f64; N], f64) {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut best = (start, cost(&start));
    let mut mean = start.map(f64::ln);
    let mut spread = [SPREAD; N];
    for _ in 0..generations {
        let candidates: Vec<[f64; N]> = (0..CANDIDATES)
            .map(|_| {
                std::array::from_fn(|i| mean[i] + spread[i] * rng.sample::<f64, _>(StandardNormal))
            })
            .collect();
        let mut tried: Vec<(f64, [f64; N])> = candidates
            .into_par_iter()
            .map(|candidate| (cost(&candidate.map(f64::exp)), candidate))
            .collect();
        tried.sort_by(|a, b| a.0.total_cmp(&b.0));
        if tried[0].0 < best.1 {
            best = (tried[0].1.map(f64::exp), tried[0].0);
        }
        let parents = &tried[..PARENTS];
        for i in 0..N {
            let over = |f: &dyn Fn(f64) -> f64| {
                parents.iter().map(|(_, x)| f(x[i])).sum::<f64>() / PARENTS as f64
            };
            let variance = over(&|x| (x - mean[i]).powi(2));
            spread[i] = ((1.0 - LEARNING) * spread[i].powi(2) + LEARNING * variance).sqrt();
            mean[i] = over(&|x| x);
        }
        told(best.1);
    }
    best
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
        let (x, least) = minimise([1.0, 0.5, 4.0], 60, 1, cost, |_| ());
        assert!(least <= 1.0, "{x:?} {least}");
        assert_eq!(minimise([1.0, 0.5, 4.0], 60, 1, cost, |_| ()), (x, least));
    }
}
