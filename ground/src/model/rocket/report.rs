//! The HTML report of `tvc model rocket`.

use anyhow::Result;
use maud::{Markup, html};
use plant::rocket::RocketSample;

use super::Implied;
use super::flights::{Airframe, ScheduleRow, Step};
use report::measure::Figures;
use report::page::{figure, page, verdicts};
use report::plot::{Line, Plot};

/// The whole page as HTML.
pub fn render(
    airframes: &[Airframe],
    schedule: &[ScheduleRow],
    implied: &Implied,
    figures: &Figures,
) -> Result<String> {
    let body = html! {
        (verdicts(&figures.missed()))
        p {
            "The drone's rudder stands in for a rocket's gimbal. While roll is held, pitch and yaw are \
             two equal axes, θ'' = -μc δ - μa θ, whose coefficients change as propellant burns; the \
             gimbal turns by 5 deg at most, at 30 deg/s, with a lag of 5 Hz. The same controller flies \
             both, its gains interpolated in the table below."
        }
        p { (implied.words()) }
        h2 { "Schedule" }
        (figures.table("schedule").markup())
        (gains(schedule)?)
        @for airframe in airframes {
            h2 { "Steps through the burn, " (airframe.name) " airframe" }
            (steps(airframe, true, "pitch, deg", "Pitch from 5 deg, gains scheduled.", |s| s.attitude.angle_rad[0])?)
            (steps(airframe, true, "yaw, deg", "Yaw from -3 deg in the same flights.", |s| s.attitude.angle_rad[1])?)
            (steps(airframe, false, "pitch, deg", "Pitch from 5 deg, gains of lift-off kept.", |s| s.attitude.angle_rad[0])?)
            (steps(airframe, true, "gimbal, deg", "The pitch gimbal, gains scheduled.", |s| s.gimbal_rad[0])?)
        }
        h2 { "Responses" }
        p { "Steps with the schedule are held to the limits in the head." }
        (figures.table("").markup())
        footer {
            "Structure, aerodynamics and gimbal are estimates. Left out: lateral drift and wind (the \
             angle of attack is the attitude), slosh, bending, jet damping."
        }
    };
    Ok(page("The rocket through its burn", body))
}

fn gains(rows: &[ScheduleRow]) -> Result<Markup> {
    let line = |name, colour, of: fn(&ScheduleRow) -> f64| {
        let points = rows.iter().map(|row| (row.flight.time_s, of(row)));
        Line::new(name, colour, points.collect())
    };
    let plot = |y, lines| Plot::new("time since ignition, s", y, lines);
    let control = line("mu_c, control", 0, |row| row.flight.mu_c);
    let air = line("mu_a, air", 1, |row| row.flight.mu_a);
    let coefficients = plot("1/s2", vec![control, air]);
    let kp = line("kp", 2, |row| row.gains.kp);
    let kd = line("kd", 3, |row| row.gains.kd);
    let gains = plot("rad/rad, rad s/rad", vec![kp, kd]);
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
        .map(|(colour, (name, step))| {
            let samples = step.samples.iter();
            let points = samples.map(|s| (s.attitude.time_s - step.time_s, of(s).to_degrees()));
            Line::new(name, colour, points.collect())
        })
        .collect();
    let plot = Plot::new("time since the step, s", y, lines);
    Ok(figure(caption, plot.svg()?))
}
