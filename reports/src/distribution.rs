//! Mean, 95 % and worst of a figure over many flights.

use super::measure::{Figure, Limit, figure};

/// Share of the values that the second figure is not below.
const MOST: f64 = 0.95;

/// How a figure is distributed over many flights; infinite where some of them have none.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Distribution {
    /// The mean.
    pub mean: f64,
    /// What 95 % of the values do not exceed, by nearest rank.
    pub p95: f64,
    /// The largest.
    pub worst: f64,
}

impl Distribution {
    /// Of these values, of which there is one at least; a missing one is worse than any.
    pub fn of(values: impl IntoIterator<Item = Option<f64>>) -> Self {
        let values = values.into_iter();
        let mut values: Vec<f64> = values.map(|value| value.unwrap_or(f64::INFINITY)).collect();
        values.sort_by(f64::total_cmp);
        let rank = (MOST * values.len() as f64).ceil().max(1.0) as usize;
        let at = |rank: usize| values.get(rank - 1).copied().unwrap_or(f64::INFINITY);
        Self {
            mean: values.iter().sum::<f64>() / values.len() as f64,
            p95: at(rank),
            worst: at(values.len().max(1)),
        }
    }

    /// The figures; in tables `label` stands in front of the first. The limits are those of 95 %
    /// and of the worst.
    pub fn figure(
        self,
        key: &'static str,
        (label, unit, decimals): (&str, &'static str, usize),
        limits: [Option<Limit>; 2],
    ) -> Figure {
        let one = |key, value: f64, label: String, limit| {
            figure(key, value.is_finite().then_some(value))
                .shown(label, unit, decimals)
                .or("never")
                .limit(limit)
        };
        figure(
            key,
            [
                one("mean", self.mean, format!("{label}, mean"), None),
                one("p95", self.p95, "95 %".into(), limits[0]),
                one("worst", self.worst, "worst".into(), limits[1]),
            ],
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mean_most_and_worst_of_forty() {
        let found = Distribution::of((1..=40).rev().map(|value| Some(f64::from(value))));
        assert_eq!((found.mean, found.p95, found.worst), (20.5, 38.0, 40.0));
        let one = Distribution::of([Some(2.0)]);
        assert_eq!((one.mean, one.p95, one.worst), (2.0, 2.0, 2.0));
    }

    #[test]
    fn a_missing_value_is_worse_than_any() {
        let found = Distribution::of([Some(1.0), None]);
        assert!(found.worst.is_infinite() && found.p95.is_infinite());
        let text = serde_json::to_string(&crate::measure::Figures::from([found.figure(
            "ratio",
            ("ratio", "", 2),
            [None; 2],
        )]));
        assert_eq!(text.unwrap(), r#"{"ratio":{"mean":null,"p95":null,"worst":null}}"#);
    }
}
