//! `tvc model rocket`: the drone's controller on the rocket's two axes, with gains that follow the
//! burn.

mod flights;
mod report;

use anyhow::Result;
use plant::rocket::{Rocket, RocketParameters};
use serde::Serialize;

use super::options::Rocket as Options;
use ::report::exit::Verdict;
use ::report::measure::Limit::{self, AtMost};
use ::report::measure::{Figures, data, note, rows};
use flights::{Airframe, ScheduleRow};

/// Specific impulse that oxygen and ethanol reach, in s.
const ETHANOL_IMPULSE_S: f64 = 250.0;
/// What the thesis asks of a step response: overshoot, percent of the step, and 5 % settling, s.
const OVERSHOOT_PCT: Limit = AtMost(30.0);
const SETTLING_S: Limit = AtMost(1.5);

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

    /// The contradictions in words.
    fn words(&self) -> String {
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

/// Flies, prints the figures and writes the report.
pub fn run(options: &Options) -> Result<Verdict> {
    let stable = Rocket::new(&RocketParameters::SPICA)?;
    let unstable = Rocket::new(&RocketParameters::SPICA_UNSTABLE)?;
    let airframes = [
        Airframe::fly("stable", &stable)?,
        Airframe::fly("unstable", &unstable)?,
    ];
    let schedule = flights::schedule_rows(&stable);
    let implied = Implied::new(&stable);
    let steps = rows("", airframes.iter().flat_map(Airframe::figures));
    let figures = Figures::from([
        rows("schedule", schedule.iter().map(ScheduleRow::figures)),
        steps,
        rows("airframes", airframes.iter().map(Airframe::object)).unseen(),
        data("implied", &implied),
        note(implied.words()),
    ]);
    let page = report::render(&airframes, &schedule, &implied, &figures)?;
    figures.conclude(options.json, Some((&options.report, page)))
}
