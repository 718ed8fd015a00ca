//! A row of the result: what was expected, what was found, and what a difference means.

use std::fmt::Display;
use std::ops::RangeInclusive;

use report::measure::{Figure, figure};

/// How a check ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    /// As on the rig.
    Pass,
    /// Not as on the rig; the board may still work.
    Differ,
    /// It does not work.
    Fail,
    /// Not looked at; [`Row::found`] says why.
    Skipped,
}

/// A check.
#[derive(Debug)]
pub struct Row {
    /// What was looked at.
    pub check: Check,
    /// What the rig says, or the data sheet.
    pub expected: String,
    /// What was found.
    pub found: String,
    /// How it ended.
    pub result: Outcome,
}

impl Row {
    /// Whether the board is not as it should be.
    pub fn is_missed(&self) -> bool {
        matches!(self.result, Outcome::Differ | Outcome::Fail)
    }

    /// The row of the table.
    pub fn figures(&self) -> [Figure; 5] {
        let result = match self.result {
            Outcome::Pass => "pass",
            Outcome::Differ => "differ",
            Outcome::Fail => "fail",
            Outcome::Skipped => "skipped",
        };
        [
            figure("check", self.check.name).shown("check", "", 0),
            figure("expected", &*self.expected).shown("expected", "", 0),
            figure("found", &*self.found).shown("found", "", 0),
            figure("result", result).shown("result", "", 0),
            figure("meaning", self.check.meaning),
        ]
    }
}

/// A check before its result.
#[derive(Debug, Clone, Copy)]
pub struct Check {
    /// Its name.
    pub name: &'static str,
    /// What a difference means, and what to do.
    pub meaning: &'static str,
}

/// Checks as constants, each with its name and its meaning.
macro_rules! checks {
    ($($check:ident $name:literal: $meaning:literal;)+) => {
        $(const $check: $crate::vehicle::bringup::row::Check =
            $crate::vehicle::bringup::row::Check { name: $name, meaning: $meaning };)+
    };
}
pub(super) use checks;

impl Check {
    /// With its result.
    pub fn row(self, expected: impl Display, found: impl Display, result: Outcome) -> Row {
        Row { check: self, expected: expected.to_string(), found: found.to_string(), result }
    }

    /// Passes if `holds`; otherwise it differs.
    pub fn of(self, expected: impl Display, found: impl Display, holds: bool) -> Row {
        let result = if holds { Outcome::Pass } else { Outcome::Differ };
        self.row(expected, found, result)
    }

    /// Passes if the value lies in `range`; otherwise it differs.
    pub fn within(self, value: f64, range: RangeInclusive<f64>, unit: &str) -> Row {
        let decimals = if range.end() - range.start() < 10.0 { 2 } else { 0 };
        let expected = format!("{:.decimals$} to {:.decimals$} {unit}", range.start(), range.end());
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
