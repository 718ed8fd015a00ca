//! The HTML report of `tvc model rocket`.

use anyhow::Result;
use maud::{Markup, html};
use plant::rocket::RocketSample;

use super::flights::{Airframe, ScheduleRow, Step};
use super::{Figures, REQUIRED, RESPONSE_COLUMNS, SCHEDULE_COLUMNS};
use crate::out::page::{figure, page, table, verdict};
use crate::out::plot::{Line, Plot};

/// The whole page as HTML.
pub fn render(figures: &Figures) -> Result<String> {
    let (overshoot, settling) = REQUIRED;
    let body = html! {
        (verdict(
            figures.passed,
            &format!(
                "With scheduled gains {} step overshoots {overshoot:.0} % at most and settles within \
                 {settling} s.",
                if figures.passed { "every" } else { "not every" }
            ),
        ))
        p {
            "The drone's rudder stands in for a rocket's gimbal. While roll is held, pitch and yaw are \
             two equal axes, θ'' = -μc δ - μa θ, whose coefficients change as propellant burns; the \
             gimbal turns by 5 deg at most, at 30 deg/s, with a lag of 5 Hz. The same controller flies \
             both, its gains interpolated in the table below."
        }
        p { (figures.implied.said()) }
        h2 { "Schedule" }
        (table(&SCHEDULE_COLUMNS, &figures.schedule_cells()))
        (schedule(&figures.schedule)?)
        @for airframe in &figures.airframes {
            h2 { "Steps through the burn, " (airframe.name) " airframe" }
            (steps(airframe, true, "pitch, deg", "Pitch from 5 deg, gains scheduled.", |s| s.attitude.angle_rad[0])?)
            (steps(airframe, true, "yaw, deg", "Yaw from -3 deg in the same flights.", |s| s.attitude.angle_rad[1])?)
            (steps(airframe, false, "pitch, deg", "Pitch from 5 deg, gains of lift-off kept.", |s| s.attitude.angle_rad[0])?)
            (steps(airframe, true, "gimbal, deg", "The pitch gimbal, gains scheduled.", |s| s.gimbal_rad[0])?)
        }
        h2 { "Responses" }
        (table(&RESPONSE_COLUMNS, &figures.response_cells()))
        footer {
            "Structure, aerodynamics and gimbal are estimates. Left out: lateral drift and wind (the \
             angle of attack is the attitude), slosh, bending, jet damping."
        }
    };
    Ok(page("The rocket through its burn", body))
}

fn schedule(rows: &[ScheduleRow]) -> Result<Markup> {
    let line = |name, colour, points| Line {
        name,
        colour,
        points,
    };
    let coefficients = Plot {
        x: "time since ignition, s",
        y: "1/s2",
        lines: vec![
            line(
                "mu_c, control",
                0,
                rows.iter().map(ScheduleRow::control).collect(),
            ),
            line("mu_a, air", 1, rows.iter().map(ScheduleRow::air).collect()),
        ],
        band: None,
    };
    let gains = Plot {
        x: "time since ignition, s",
        y: "rad/rad, rad s/rad",
        lines: vec![
            line(
                "kp",
                2,
                rows.iter().map(ScheduleRow::proportional).collect(),
            ),
            line("kd", 3, rows.iter().map(ScheduleRow::derivative).collect()),
        ],
        band: None,
    };
    Ok(html! {
        (figure("What a radian of gimbal and of angle of attack do.", coefficients.svg()?))
        (figure("The gains that follow.", gains.svg()?))
    })
}

fn steps(
    airframe: &Airframe,
    scheduled: bool,
    y: &str,
    caption: &str,
    of: fn(&RocketSample) -> f64,
) -> Result<Markup> {
    let chosen: Vec<(String, &Step)> = airframe
        .steps
        .iter()
        .filter(|step| step.scheduled == scheduled)
        .map(|step| (format!("at {:.0} s", step.time_s), step))
        .collect();
    let lines = chosen
        .iter()
        .enumerate()
        .map(|(colour, (name, step))| Line {
            name,
            colour,
            points: step
                .samples
                .iter()
                .map(|s| (s.attitude.time_s - step.time_s, of(s).to_degrees()))
                .collect(),
        })
        .collect();
    let plot = Plot {
        x: "time since the step, s",
        y,
        lines,
        band: None,
    };
    Ok(figure(caption, plot.svg()?))
}
