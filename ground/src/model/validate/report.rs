//! The HTML report of `tvc model validate`.

use anyhow::Result;
use maud::{Markup, html};
use plant::scenario::Row;
use plant::thesis::Deviation;

use super::NOT_REPRODUCED;
use super::checks::{Check, figures};
use super::runs::{Instant, Runs};
use report::measure::rows;
use report::page::{figure, page, table, verdicts};
use report::plot::{Line, Plot};

/// Pitch acceleration of the artefact that figure 5.12 shows, in rad/s2: 0.038 N m on the inertia
/// of body and rudder that equation (5.30) has.
const PRINTED_FALL_RAD_S2: f64 = -0.31;

/// The whole page as HTML.
pub fn render(
    runs: &Runs,
    checks: &[Check],
    errors: &[Deviation],
    missed: &[String],
) -> Result<String> {
    let body = html! {
        (verdicts(missed))
        p {
            "The thesis validates its model by six figures. Here they are again from first principles, \
             with what its printed equations make of them, and with the balances of energy and \
             momentum, which a wrong equation does not pass."
        }
        h2 { "Figures 5.8 to 5.10: the linkage through its range" }
        (angles(&runs.sweep, "The crank goes to 0.8 rad and back. The link moves by 2.4 deg, \"very \
                              restrained\" as the thesis has it; the rudder follows.", &LINKAGE)?)
        (checked(checks, |figure| matches!(figure, Some("5.8" | "5.9" | "5.10" | "5.8-5.10"))))
        h2 { "Figure 5.11: no forces" }
        (angles(&runs.still, "Started at 0.3 and 0.1 rad, nothing moves.", &ALL)?)
        (checked(checks, |figure| figure == Some("5.11")))
        h2 { "Figure 5.12: gravity only" }
        (gravity(runs)?)
        (checked(checks, |figure| figure == Some("5.12")))
        (missing("5.12"))
        h2 { "Figure 5.13: forces applied" }
        (angles(&runs.torque, "Thrust and a constant torque of 0.1 N m on the crank: pitch.", &[PITCH])?)
        (angles(&runs.torque, "Crank and rudder in the same run.", &MOVED)?)
        (angles(&runs.stopped, "Thrust and the 0.31 N m of 6 V, the crank held by a stop at 0.8 rad: \
                                pitch.", &[PITCH])?)
        (angles(&runs.stopped, "Crank and rudder in the same run.", &MOVED)?)
        (checked(checks, |figure| figure == Some("5.13")))
        (missing("5.13"))
        h2 { "Balances" }
        (energy(&runs.driven)?)
        (momentum(&runs.driven)?)
        (checked(checks, |figure| figure.is_none()))
        h2 { "The printed equations" }
        p { "Terms of the thesis as printed beside the right ones, where the difference has a number." }
        (printed(errors))
    };
    Ok(page("Validation of the model", body))
}

/// Which angles a plot shows: name, colour, value.
type Angle = (&'static str, usize, fn(&Row) -> f64);
const PITCH: Angle = ("theta0, drone", 0, |r| r.theta0);
const CRANK: Angle = ("theta1, crank", 1, |r| r.theta1);
const LINK: Angle = ("theta2, link", 3, |r| r.theta2);
const RUDDER: Angle = ("theta3, rudder", 2, |r| r.theta3);
const LINKAGE: [Angle; 3] = [CRANK, LINK, RUDDER];
const MOVED: [Angle; 2] = [CRANK, RUDDER];
const ALL: [Angle; 4] = [PITCH, CRANK, LINK, RUDDER];

fn over_time<'a>(y: &'a str, lines: Vec<Line<'a>>) -> Plot<'a> {
    Plot::new("time, s", y, lines)
}

fn angles(rows: &[Row], caption: &str, which: &[Angle]) -> Result<Markup> {
    let lines = which
        .iter()
        .map(|&(name, colour, of)| {
            Line::new(name, colour, rows.iter().map(|r| (r.t, of(r))).collect())
        })
        .collect();
    Ok(figure(caption, over_time("angle, rad", lines).svg()?))
}

fn gravity(runs: &Runs) -> Result<Markup> {
    let line = |name, colour, rows: &[Row]| {
        // A drone that falls turns over and over; the picture is about how it begins.
        let begin = rows.iter().take_while(|r| r.theta0.abs() < 1.6);
        Line::new(name, colour, begin.map(|r| (r.t, r.theta0)).collect())
    };
    let printed = (0..=320)
        .map(|i| f64::from(i) * 0.01)
        .map(|t| (t, 0.5 * PRINTED_FALL_RAD_S2 * t * t))
        .collect();
    let lines = vec![
        line("centre of mass at the pivot", 0, &runs.balanced),
        line("body balanced at the pivot (thesis)", 2, &runs.pendulum),
        line("centre of mass 2 cm above", 1, &runs.top_heavy),
        Line::new("as (5.30) is printed, from 0", 4, printed),
    ];
    Ok(figure(
        "Pitch under gravity alone. The printed equation falls without bound whatever the drone; the \
         right one swings, stands or falls as the centre of mass lies.",
        over_time("pitch, rad", lines).svg()?,
    ))
}

fn curve(
    name: &'static str,
    colour: usize,
    instants: &[Instant],
    of: fn(&Instant) -> f64,
) -> Line<'static> {
    let points = instants.iter().map(|i| (i.time_s, of(i))).collect();
    Line::new(name, colour, points)
}

fn energy(instants: &[Instant]) -> Result<Markup> {
    let Some(first) = instants.first() else {
        return Ok(html! {});
    };
    let start = first.kinetic_j + first.potential_j;
    let mut work = curve(
        "work of the loads, and what was there at the start",
        5,
        instants,
        |i| i.work_j,
    );
    for point in &mut work.points {
        point.1 += start;
    }
    let lines = vec![
        curve("kinetic", 0, instants, |i| i.kinetic_j),
        curve("potential", 2, instants, |i| i.potential_j),
        curve("sum", 4, instants, |i| i.kinetic_j + i.potential_j),
        work,
    ];
    Ok(figure(
        "Energy of a tumble under thrust, wash, friction and a servo that pushes to and fro. The sum \
         and the work lie on one another.",
        over_time("energy, J", lines).svg()?,
    ))
}

fn momentum(instants: &[Instant]) -> Result<Markup> {
    let Some(first) = instants.first() else {
        return Ok(html! {});
    };
    let mut impulse = curve(
        "impulse of all moments, and what was there at the start",
        5,
        instants,
        |i| i.impulse,
    );
    for point in &mut impulse.points {
        point.1 += first.momentum;
    }
    let lines = vec![
        curve("angular momentum", 0, instants, |i| i.momentum),
        impulse,
    ];
    Ok(figure(
        "Angular momentum about the pivot in the same tumble; the servo's torque is internal and \
         makes none.",
        over_time("kg m2/s", lines).svg()?,
    ))
}

fn checked(checks: &[Check], which: impl Fn(Option<&str>) -> bool) -> Markup {
    let chosen = checks.iter().filter(|(place, _)| which(*place));
    rows("", chosen.map(figures)).table().markup()
}

fn missing(which: &str) -> Markup {
    html! {
        @for missing in NOT_REPRODUCED.iter().filter(|m| m.figure == which) {
            p {
                strong { "Not reproduced: " (missing.printed) ". " }
                "Why: " (missing.why)
            }
        }
    }
}

fn printed(errors: &[Deviation]) -> Markup {
    let rows: Vec<_> = errors
        .iter()
        .map(|e| {
            let number = |x: f64| format!("{:.3}", if x.abs() < 5e-4 { 0.0 } else { x });
            vec![
                format!("{}: {}", e.place, e.what),
                e.quantity.to_string(),
                number(e.printed),
                number(e.right),
            ]
        })
        .collect();
    table(&["where and what", "quantity", "printed", "right"], &rows)
}
