//! Statistics over the outcomes of a campaign.

/// A share of runs with its 95 % confidence bounds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rate {
    /// The share, 0 to 1.
    pub rate: f64,
    /// Lower bound.
    pub low: f64,
    /// Upper bound.
    pub high: f64,
}

impl Rate {
    /// The share of `hits` in `runs` with Wilson's bounds, which hold near 0 and 1 too. Without
    /// runs the bounds are 0 and 1.
    pub fn new(hits: u64, runs: u64) -> Self {
        if runs == 0 {
            return Self { rate: 0.0, low: 0.0, high: 1.0 };
        }
        const Z: f64 = 1.959_963_984_540_054;
        let n = runs as f64;
        let rate = hits as f64 / n;
        let scale = 1.0 / (1.0 + Z * Z / n);
        let centre = scale * (rate + Z * Z / (2.0 * n));
        let half = scale * Z * (rate * (1.0 - rate) / n + Z * Z / (4.0 * n * n)).sqrt();
        Self {
            rate,
            // At the ends the bound is the end itself, which rounding must not miss.
            low: if hits == 0 { 0.0 } else { centre - half },
            high: if hits == runs { 1.0 } else { centre + half },
        }
    }
}

/// Share of the outcomes that pass a test.
pub fn pass_rate<T>(outcomes: &[T], test: impl Fn(&T) -> bool) -> Rate {
    let hits = outcomes.iter().filter(|outcome| test(outcome)).count();
    Rate::new(hits as u64, outcomes.len() as u64)
}

/// The `share` quantile (0 to 1) of a figure over the outcomes, by nearest rank; a missing figure
/// (not settled) counts as larger than any. `None` if it is missing or there are no outcomes.
pub fn quantile<T>(outcomes: &[T], share: f64, figure: impl Fn(&T) -> Option<f64>) -> Option<f64> {
    let mut values: Vec<f64> =
        outcomes.iter().map(|outcome| figure(outcome).unwrap_or(f64::INFINITY)).collect();
    values.sort_by(f64::total_cmp);
    let rank = (share * values.len() as f64).ceil().max(1.0) as usize;
    values.get(rank - 1).copied().filter(|value| value.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wilson_bounds_by_hand() {
        let rate = Rate::new(500, 500);
        assert!((rate.low - 0.992_38).abs() < 1e-5 && rate.high == 1.0);
        let half = Rate::new(50, 100);
        assert!((half.low - 0.403_83).abs() < 1e-5 && (half.high - 0.596_17).abs() < 1e-5);
        assert_eq!(Rate::new(0, 0).high, 1.0);
    }

    #[test]
    fn quantiles_count_the_unsettled_as_worst() {
        let all = [Some(0.5), None, Some(0.9)];
        assert_eq!(quantile(&all, 0.5, |settling| *settling), Some(0.9));
        assert_eq!(quantile(&all, 1.0, |settling| *settling), None);
        assert!((pass_rate(&all, Option::is_some).rate - 2.0 / 3.0).abs() < 1e-12);
    }
}
