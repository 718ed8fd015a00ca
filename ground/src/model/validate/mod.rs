//! `tvc model validate`: the thesis' validations of its model, repeated on the right equations, and
//! the balances of energy and momentum, which a wrong equation does not pass.

mod checks;
mod report;
mod runs;

use anyhow::Result;
use plant::thesis;
use plant::{Mechanism, Parameters};
use serde::Serialize;

use crate::model::Validate;
use ::report::exit::Verdict;
use ::report::measure::{Figures, data, note, rows};
use runs::Runs;

/// A figure of the thesis that the right equations do not give.
#[derive(Serialize)]
struct NotReproduced {
    figure: &'static str,
    printed: &'static str,
    why: &'static str,
}

/// Which of figures 5.8 to 5.13 cannot be reproduced, and why.
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

/// Validates, prints the checks and writes the report.
pub fn run(options: &Validate) -> Result<Verdict> {
    let runs = Runs::new()?;
    let checks = checks::all(&runs)?;
    let errors = thesis::deviations(&Mechanism::new(&Parameters::PHYS)?);
    let mut figures = vec![
        rows("checks", checks.iter().map(checks::figures)),
        data("not_reproduced", &NOT_REPRODUCED),
        data("printed_errors", &errors),
    ];
    figures.extend(NOT_REPRODUCED.iter().map(|missing| {
        note(format!(
            "Figure {} ({}) cannot be reproduced: {}",
            missing.figure, missing.printed, missing.why
        ))
    }));
    let figures = Figures::from(figures);
    let page = report::render(&runs, &checks, &errors, &figures.missed())?;
    figures.conclude(options.json, Some((&options.report, page)))
}
