//! `tvc model validate`: the thesis' validations of its model, repeated on the right equations, and
//! the balances that tell whether equations are right.

mod checks;
mod report;
mod runs;

use anyhow::Result;
use plant::thesis::{self, Deviation};
use plant::{Mechanism, Parameters};
use serde::Serialize;

use crate::model::Validate;
use crate::out::exit::Verdict;
use crate::out::file::{print_figures, write_whole};
use checks::Check;
use runs::Runs;

/// A printed term beside the right one.
#[derive(Serialize)]
struct Error {
    place: &'static str,
    what: &'static str,
    quantity: &'static str,
    printed: f64,
    right: f64,
}

impl From<Deviation> for Error {
    fn from(deviation: Deviation) -> Self {
        Self {
            place: deviation.place,
            what: deviation.what,
            quantity: deviation.quantity,
            printed: deviation.printed,
            right: deviation.right,
        }
    }
}

/// A figure of the thesis that the right equations do not give.
#[derive(Serialize)]
struct NotReproduced {
    figure: &'static str,
    printed: &'static str,
    why: &'static str,
}

/// What of figures 5.8 to 5.13 cannot be had, and why.
const NOT_REPRODUCED: [NotReproduced; 2] = [
    NotReproduced {
        figure: "5.12",
        printed: "gravity alone lets the drone fall without bound",
        why: "equation (5.30) leaves gravity fixed to the body: it does not turn with theta0, so the \
              weight of the servo horn pulls with a constant 0.038 N m (-0.31 rad/s2) for ever. With \
              gravity fixed to the earth, the thesis' drone, whose body is balanced at the pivot and \
              whose rudder hangs below, is a pendulum; only a centre of mass above the pivot falls.",
    },
    NotReproduced {
        figure: "5.13",
        printed: "the drone leans to 0.4 rad and turns back; the crank stops at its kinematic limit \
                  of nearly 0.8 rad",
        why: "the linkage has no such limit: its crank is the shortest bar and turns fully, so 0.8 rad \
              must be a stop or the solver. With thrust and a constant torque the rudder settles \
              where the wash holds it and the drone tumbles one way, because nothing turns it back; \
              (5.30) also multiplies the wash by its lever in a force row, which makes the control \
              moment 5.1 times too small and turns its lateral force round.",
    },
];

/// Everything that the command prints.
#[derive(Serialize)]
struct Figures {
    passed: bool,
    checks: Vec<Check>,
    not_reproduced: &'static [NotReproduced],
    printed_errors: Vec<Error>,
}

/// Validates, prints the checks and writes the report.
pub fn run(options: &Validate) -> Result<Verdict> {
    let runs = Runs::new()?;
    let checks = checks::all(&runs)?;
    let mechanism = Mechanism::new(&Parameters::PHYS)?;
    let figures = Figures {
        passed: checks.iter().all(|check| check.passed),
        checks,
        not_reproduced: &NOT_REPRODUCED,
        printed_errors: thesis::deviations(&mechanism)
            .into_iter()
            .map(Error::from)
            .collect(),
    };
    let page = report::render(&runs, &figures)?;
    write_whole(&options.report, page.as_bytes())?;
    print_figures(&figures, options.json, Figures::text)?;
    eprintln!("report: {}", options.report.display());
    for check in figures.checks.iter().filter(|check| !check.passed) {
        eprintln!("failed: {}", check.said());
    }
    Ok(Verdict::of(figures.passed))
}

impl Figures {
    fn text(&self) -> String {
        let mut text = String::new();
        for check in &self.checks {
            let word = if check.passed { "holds " } else { "FAILS " };
            text.push_str(&format!("{word} {}\n", check.said()));
        }
        for missing in self.not_reproduced {
            text.push_str(&format!(
                "\nFigure {} ({}) cannot be reproduced: {}\n",
                missing.figure, missing.printed, missing.why
            ));
        }
        text
    }
}
