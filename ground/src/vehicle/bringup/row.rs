//! A row of the result: what was expected, what was found, and what a difference means.

use std::fmt::Display;
use std::ops::RangeInclusive;

use serde::Serialize;

/// How a check ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Outcome {
    /// As on the rig.
    Pass,
    /// Not as on the rig; the board may work all the same.
    Differ,
    /// It does not work.
    Fail,
    /// Not looked at; [`Row::found`] says why.
    Skipped,
}

impl Outcome {
    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Pass => "pass",
            Self::Differ => "differ",
            Self::Fail => "fail",
            Self::Skipped => "skipped",
        }
    }
}

/// A check.
#[derive(Debug, Serialize)]
pub struct Row {
    /// What was looked at.
    pub check: &'static str,
    /// What the rig says, or the data sheet.
    pub expected: String,
    /// What was found.
    pub found: String,
    /// How it ended.
    pub result: Outcome,
    /// What a difference means, and what to do.
    pub meaning: &'static str,
}

/// A check before its result.
#[derive(Debug, Clone, Copy)]
pub struct Check {
    /// Its name.
    pub name: &'static str,
    /// What a difference means, and what to do.
    pub meaning: &'static str,
}

impl Check {
    /// With its result.
    pub fn row(self, expected: impl Display, found: impl Display, result: Outcome) -> Row {
        Row {
            check: self.name,
            expected: expected.to_string(),
            found: found.to_string(),
            result,
            meaning: self.meaning,
        }
    }

    /// Passes if `holds`; otherwise it differs.
    pub fn of(self, expected: impl Display, found: impl Display, holds: bool) -> Row {
        let result = if holds {
            Outcome::Pass
        } else {
            Outcome::Differ
        };
        self.row(expected, found, result)
    }

    /// Passes if the value lies in `range`; otherwise it differs.
    pub fn within(self, value: f64, range: RangeInclusive<f64>, unit: &str) -> Row {
        let decimals = if range.end() - range.start() < 10.0 {
            2
        } else {
            0
        };
        let expected = format!(
            "{:.decimals$} to {:.decimals$} {unit}",
            range.start(),
            range.end()
        );
        let found = format!("{value:.decimals$} {unit}");
        self.of(expected, found, range.contains(&value))
    }

    /// Does not work.
    pub fn failed(self, expected: impl Display, why: impl Display) -> Row {
        self.row(expected, why, Outcome::Fail)
    }

    /// Was not looked at.
    pub fn skipped(self, why: impl Display) -> Row {
        self.row("-", why, Outcome::Skipped)
    }
}
