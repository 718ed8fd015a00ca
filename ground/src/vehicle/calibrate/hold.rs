//! The holding angle: the servo angle that holds the drone upright against a lateral offset of its
//! mass.
//!
//! A centimetre of offset takes 0.08 rad of servo. The controller's observer finds that in flight,
//! but a released drone begins with the rudder at neutral; with the neutral at the holding angle,
//! nothing is left to find.

use std::time::{Duration, Instant};

use anyhow::{Result, bail};
use calibration::spread;
use client::status::angles;
use client::{Parameter, StateKind, request};
use mavlink::dialects::common::MavMessage;
use nalgebra::Vector3;
use serde::Serialize;
use tvc_nano::Params;
use tvc_nano::telemetry::CRANKS;

use super::options::Calibrate;
use super::person::Ending;
use super::session::{Session, UNCHANGED, verdict};
use crate::vehicle::test::arm;
use report::exit::Verdict;
use report::file::print_json;

const NAME: &str = "SRV_HOLD_DEG";
/// Time from the release until it is measured.
const SETTLE: Duration = Duration::from_secs(3);
/// Largest standard deviation of pitch that counts as held, deg.
const STEADY_DEG: f64 = 2.0;
/// Fewest control steps for a measurement.
const FEWEST: usize = 100;

/// What `tvc calibrate hold --json` prints.
#[derive(Debug, Serialize)]
pub struct Figures {
    /// Mean servo angle beyond the neutral, deg.
    crank_deg: f64,
    /// Pitch, mean and standard deviation, deg.
    pitch_deg: [f64; 2],
    before_deg: f32,
    hold_deg: f32,
    steps: usize,
    written: bool,
    refused: Option<String>,
}

impl Figures {
    fn lines(&self) -> Vec<[String; 2]> {
        let [pitch, deviation] = self.pitch_deg;
        [
            ("steps held", self.steps.to_string()),
            ("pitch, deg", format!("{pitch:.2}, to {deviation:.2}")),
            ("servo, deg", format!("{:+.2}", self.crank_deg)),
            (NAME, format!("{} -> {}", self.before_deg, self.hold_deg)),
        ]
        .map(|(name, value)| [name.to_owned(), value])
        .into()
    }

    fn text(&self) -> String {
        format!(
            "held for {} steps at {:.2} deg of pitch, to {:.2} deg, with {:+.2} deg of servo\n{NAME} {} -> {}\n",
            self.steps,
            self.pitch_deg[0],
            self.pitch_deg[1],
            self.crank_deg,
            self.before_deg,
            self.hold_deg
        )
    }
}

/// Measures the vehicle at a port.
///
/// # Errors
/// The vehicle refuses a command or goes to failsafe, or Ctrl-C was pressed.
pub fn run(seconds: f64, options: &Calibrate) -> Result<Verdict> {
    let mut session = Session::connect(options)?;
    let (figures, _) = measure(&mut session, seconds)?;
    if options.port.json {
        print_json(&figures)?;
    }
    Ok(verdict(figures.refused.as_deref()))
}

/// Flies, measures for `seconds`, disarms, and writes the angle, if the person agrees.
///
/// # Errors
/// The vehicle refuses a command or goes to failsafe, or the person wants an end.
pub fn measure(session: &mut Session, seconds: f64) -> Result<(Figures, Ending)> {
    let before_deg = session.vehicle.parameter(NAME)?;
    let set_deg = f64::from(session.vehicle.parameter("PITCH_SET_DEG")?);
    session.vehicle.begin(session.stop);
    let flown = fly(session, Duration::from_secs_f64(seconds));
    session.person.rest();
    let steps = session.vehicle.leave(flown)?;
    let Some((mean, deviation)) = spread(steps.iter()) else {
        bail!("the vehicle told nothing of its rudder");
    };
    let mut figures = Figures {
        crank_deg: mean.x,
        pitch_deg: [mean.y, deviation.y],
        before_deg,
        hold_deg: ((f64::from(before_deg) + mean.x) * 100.0).round() as f32 / 100.0,
        steps: steps.len(),
        written: false,
        refused: None,
    };
    figures.refused = refusal(&figures, set_deg);
    session.person.show(&figures.lines(), &figures.text())?;
    if let Some(why) = &figures.refused {
        let ending = Ending::unchanged(why.clone());
        return Ok((figures, ending));
    }
    let row = Parameter {
        name: NAME.into(),
        value: figures.hold_deg,
    };
    figures.written = session.write_if_agreed(&[row])?.is_some();
    let ending = match figures.written {
        true => Ending::met(format!("{NAME} is {} in the flash", figures.hold_deg)),
        false => Ending::unchanged(UNCHANGED),
    };
    Ok((figures, ending))
}

/// Arms and releases: servo angle and pitch, deg, of every step after the drone has settled.
fn fly(session: &mut Session, length: Duration) -> Result<Vec<Vector3<f64>>> {
    session.vehicle.watch_host()?;
    session.vehicle.command(request::CALIBRATE)?;
    let person = &mut session.person;
    arm(&mut session.vehicle, &mut |why| {
        person.progress(0.0, &format!("hold the drone still  {why}"), None);
    })?;
    session.vehicle.command(request::RELEASE)?;
    let begun = Instant::now();
    let (mut steps, mut pitch_deg) = (Vec::new(), 0.0);
    while begun.elapsed() < SETTLE + length {
        for frame in session.vehicle.receive()? {
            match &frame.message {
                MavMessage::ATTITUDE_QUATERNION(q) => {
                    let [_, pitch, _] = angles([q.q1, q.q2, q.q3, q.q4].map(f64::from));
                    pitch_deg = pitch.to_degrees();
                }
                MavMessage::NAMED_VALUE_FLOAT(value)
                    if value.name.to_str() == Ok(CRANKS[0]) && begun.elapsed() > SETTLE =>
                {
                    let crank_deg = f64::from(value.value).to_degrees();
                    steps.push(Vector3::new(crank_deg, pitch_deg, 0.0));
                }
                _ => {}
            }
        }
        if session.vehicle.state() == Some(StateKind::Failsafe) {
            bail!("the vehicle gave up: {}", session.vehicle.reason());
        }
        let share = begun.elapsed().as_secs_f64() / (SETTLE + length).as_secs_f64();
        session.progress(share, &format!("released, pitch {pitch_deg:+.1} deg"));
    }
    Ok(steps)
}

/// Why the flight is not a measurement, if it is none.
fn refusal(figures: &Figures, set_deg: f64) -> Option<String> {
    let [pitch, deviation] = figures.pitch_deg;
    if figures.steps < FEWEST {
        Some(format!(
            "{} control steps are too few to measure",
            figures.steps
        ))
    } else if deviation > STEADY_DEG || (pitch - set_deg).abs() > STEADY_DEG {
        Some(format!(
            "the drone was not held: pitch {pitch:.1} deg, to {deviation:.1} deg, where it was to be {set_deg:.1} deg"
        ))
    } else {
        let taken = Params::default().set(NAME, figures.hold_deg).err();
        taken.map(|why| format!("{why}, not {}: move the mass", figures.hold_deg))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_drone_that_was_held_says_where_its_mass_is() {
        let figures = |pitch, deviation, hold_deg, steps| Figures {
            crank_deg: 0.0,
            pitch_deg: [pitch, deviation],
            before_deg: 0.0,
            hold_deg,
            steps,
            written: false,
            refused: None,
        };
        assert_eq!(refusal(&figures(0.3, 0.2, 2.3, 900), 0.0), None);
        for (bad, part) in [
            (figures(0.3, 0.2, 2.3, 20), "too few"),
            (figures(4.0, 0.2, 2.3, 900), "not held"),
            (figures(0.3, 3.0, 2.3, 900), "not held"),
            (figures(0.3, 0.2, 11.0, 900), "move the mass"),
        ] {
            let why = refusal(&bad, 0.0).unwrap();
            assert!(why.contains(part), "{why}");
        }
    }
}
