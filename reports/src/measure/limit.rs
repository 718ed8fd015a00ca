//! The limit of a figure: what meets it, and its words.

/// What a figure is held to, in the unit of its value in JSON.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Limit {
    /// Not above.
    AtMost(f64),
    /// Not below.
    AtLeast(f64),
    /// Strictly below.
    Below(f64),
    /// An expected value and how far from it is near enough.
    Near(f64, f64),
    /// From the first to the second, both allowed.
    Within(f64, f64),
    /// The flag must be set.
    Set,
}

use Limit::{AtLeast, AtMost, Below, Near, Set, Within};

impl Limit {
    /// The least and the greatest value that meet it.
    pub fn range(self) -> (f64, f64) {
        match self {
            AtMost(most) | Below(most) => (f64::NEG_INFINITY, most),
            AtLeast(least) => (least, f64::INFINITY),
            Near(value, tolerance) => (value - tolerance, value + tolerance),
            Within(low, high) => (low, high),
            Set => (1.0, 1.0),
        }
    }

    /// Whether a number meets it; NaN does not.
    pub(super) fn met_by(self, number: f64) -> bool {
        let (low, high) = self.range();
        (low..=high).contains(&number) && self != Below(number)
    }

    /// In words, its numbers multiplied by `scale`.
    pub(super) fn words(self, scale: f64) -> String {
        let number = |value: f64| match value * scale {
            value if value != 0.0 && value.abs() < 1e-3 => format!("{value:e}"),
            value => format!("{value}"),
        };
        match self {
            AtMost(0.0) => "none".into(),
            AtMost(most) => format!("at most {}", number(most)),
            AtLeast(least) => format!("at least {}", number(least)),
            Below(most) => format!("below {}", number(most)),
            Near(value, tolerance) => format!("{} ± {:e}", number(value), tolerance * scale),
            Within(low, high) if low == high => format!("exactly {}", number(low)),
            Within(0.0, high) => format!("at most {}", number(high)),
            Within(low, high) => format!("{} to {}", number(low), number(high)),
            Set => "yes".into(),
        }
    }
}
