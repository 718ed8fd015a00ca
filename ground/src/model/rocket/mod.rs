//! `tvc model rocket`: the drone's controller on the rocket's two axes, its gains following the burn.

mod flights;
mod report;

use anyhow::Result;
use plant::rocket::{Rocket, RocketParameters};
use serde::Serialize;

use super::options::Rocket as Options;
use crate::out::exit::Verdict;
use crate::out::file::{print_figures, write_whole};
use flights::{Airframe, ScheduleRow};

/// Specific impulse that oxygen and ethanol reach, in s.
const ETHANOL_IMPULSE_S: f64 = 250.0;
/// What the thesis asks of a step response: overshoot in percent, 5 % settling in s.
const REQUIRED: (f64, f64) = (30.0, 1.5);

/// What thrust, propellant and burn time imply, beside what is stated.
#[derive(Serialize)]
struct Implied {
    specific_impulse_s: f64,
    burn_at_250_s: f64,
    burn_out_speed_m_s: f64,
    stated_speed_m_s: f64,
    burn_out_altitude_m: f64,
    stated_altitude_m: f64,
    supersonic_at_s: Option<f64>,
    stated_supersonic_at_s: f64,
}

impl Implied {
    fn new(rocket: &Rocket) -> Self {
        let p = rocket.parameters();
        let end = rocket.at(p.burn_s);
        Self {
            specific_impulse_s: p.implied_impulse_s(),
            burn_at_250_s: p.burn_at_impulse_s(ETHANOL_IMPULSE_S),
            burn_out_speed_m_s: end.speed_m_s,
            stated_speed_m_s: 1000.0,
            burn_out_altitude_m: end.altitude_m,
            stated_altitude_m: 50e3,
            supersonic_at_s: rocket.supersonic_s(),
            stated_supersonic_at_s: 20.0,
        }
    }

    /// The note in words.
    fn said(&self) -> String {
        format!(
            "The stated figures do not fit one another. 100 kN from 2600 kg in 90 s are a specific \
             impulse of {:.0} s, too much for oxygen and ethanol: at {ETHANOL_IMPULSE_S:.0} s the \
             propellant lasts {:.0} s. A vertical run on them ends at {:.0} m/s and {:.0} km, where \
             {:.0} m/s and {:.0} km are stated. The speed of sound is passed at {:.0} s (stated: {:.0} \
             s). They are used as stated.",
            self.specific_impulse_s,
            self.burn_at_250_s,
            self.burn_out_speed_m_s,
            self.burn_out_altitude_m / 1e3,
            self.stated_speed_m_s,
            self.stated_altitude_m / 1e3,
            self.supersonic_at_s.unwrap_or(f64::NAN),
            self.stated_supersonic_at_s,
        )
    }
}

/// Everything that the command prints.
#[derive(Serialize)]
struct Figures {
    passed: bool,
    schedule: Vec<ScheduleRow>,
    airframes: Vec<Airframe>,
    implied: Implied,
}

/// Flies, prints the figures and writes the report.
pub fn run(options: &Options) -> Result<Verdict> {
    let stable = Rocket::new(&RocketParameters::SPICA)?;
    let unstable = Rocket::new(&RocketParameters::SPICA_UNSTABLE)?;
    let airframes = vec![
        Airframe::fly("stable", &stable)?,
        Airframe::fly("unstable", &unstable)?,
    ];
    let figures = Figures {
        passed: airframes.iter().all(Airframe::passed),
        schedule: flights::schedule_rows(&stable),
        airframes,
        implied: Implied::new(&stable),
    };
    write_whole(&options.report, report::render(&figures)?.as_bytes())?;
    print_figures(&figures, options.json, Figures::text)?;
    eprintln!("report: {}", options.report.display());
    Ok(Verdict::of(figures.passed))
}

/// Columns of the schedule's table.
const SCHEDULE_COLUMNS: [&str; 9] = [
    "time, s",
    "mass, kg",
    "CM, m",
    "inertia, kg m2",
    "q, kPa",
    "mu_c, 1/s2",
    "mu_a, 1/s2",
    "kp",
    "kd, s",
];
/// Columns of the table of responses.
const RESPONSE_COLUMNS: [&str; 5] = [
    "airframe, gains, time of the burn",
    "pitch overshoot, %",
    "pitch 5 % settling, s",
    "yaw overshoot, %",
    "yaw 5 % settling, s",
];

impl Figures {
    fn schedule_cells(&self) -> Vec<Vec<String>> {
        self.schedule.iter().map(ScheduleRow::cells).collect()
    }

    fn response_cells(&self) -> Vec<Vec<String>> {
        self.airframes.iter().flat_map(Airframe::cells).collect()
    }

    fn text(&self) -> String {
        let mut text = String::new();
        for (head, rows) in [
            (&SCHEDULE_COLUMNS[..], self.schedule_cells()),
            (&RESPONSE_COLUMNS[..], self.response_cells()),
        ] {
            let mut table = comfy_table::Table::new();
            table.load_style(comfy_table::presets::NOTHING);
            table.set_header(head).add_rows(rows);
            text.push_str(&format!("{table}\n\n"));
        }
        text.push_str(&self.implied.said());
        text.push('\n');
        text
    }
}
