//! The holding angle: the servo angle that holds the drone upright against a lateral offset of its
//! mass.
//!
//! A centimetre of offset takes 0.08 rad of servo. The controller's observer finds that in flight,
//! but a released drone begins with the rudder at neutral; with the neutral at the holding angle,
//! nothing is left to find.

use std::time::Duration;

use anyhow::{Result, bail};
use calibration::spread;
use client::status::angles;
use client::{Parameter, request};
use mavlink::dialects::common::MavMessage;
use nalgebra::Vector3;
use tvc_nano::Params;
use tvc_nano::telemetry::CRANKS;

use super::person::Ending;
use super::session::{Session, UNCHANGED};
use crate::vehicle::test::{arm, watch};
use report::measure::{Figures, data, figure};

const NAME: &str = "SRV_HOLD_DEG";
/// Time from the release until it is measured.
const SETTLE: Duration = Duration::from_secs(3);
/// Largest standard deviation of pitch that counts as held, deg.
const STEADY_DEG: f64 = 2.0;
/// Fewest control steps for a measurement.
const FEWEST: usize = 100;

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
    let hold_deg = ((f64::from(before_deg) + mean.x) * 100.0).round() as f32 / 100.0;
    let pitch_deg = [mean.y, deviation.y];
    let refused = refusal(pitch_deg, hold_deg, steps.len(), set_deg);
    let pitch = format!("{:.2}, to {:.2}", mean.y, deviation.y);
    let figures = |written| {
        Figures::from([
            figure("crank_deg", mean.x).said("servo, deg", format!("{:+.2}", mean.x)),
            data("pitch_deg", &pitch_deg).said("pitch, deg", &*pitch),
            data("before_deg", &before_deg),
            data("hold_deg", &hold_deg).said(NAME, format!("{before_deg} -> {hold_deg}")),
            figure("steps", steps.len()).shown("steps held", "", 0),
            figure("written", written),
            figure("refused", refused.clone()),
        ])
    };
    session.person.show(&figures(false))?;
    if let Some(why) = &refused {
        return Ok((figures(false), Ending::refused(why)));
    }
    let row = Parameter::new(NAME, hold_deg);
    let ending = match session.write_if_agreed(&[row])? {
        Some(_) => Ending::met(format!("{NAME} is {hold_deg} in the flash")),
        None => Ending::unchanged(UNCHANGED),
    };
    Ok((figures(ending.met), ending))
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
    let (mut steps, mut pitch_deg) = (Vec::new(), 0.0);
    watch(&mut session.vehicle, SETTLE + length, |_, lasted, frames| {
        for frame in frames {
            match &frame.message {
                MavMessage::ATTITUDE_QUATERNION(q) => {
                    let [_, pitch, _] = angles([q.q1, q.q2, q.q3, q.q4].map(f64::from));
                    pitch_deg = pitch.to_degrees();
                }
                MavMessage::NAMED_VALUE_FLOAT(value)
                    if value.name.to_str() == Ok(CRANKS[0]) && lasted > SETTLE =>
                {
                    let crank_deg = f64::from(value.value).to_degrees();
                    steps.push(Vector3::new(crank_deg, pitch_deg, 0.0));
                }
                _ => {}
            }
        }
        let share = lasted.as_secs_f64() / (SETTLE + length).as_secs_f64();
        person.progress(share, &format!("released, pitch {pitch_deg:+.1} deg"), None);
        Ok(())
    })?;
    Ok(steps)
}

/// Why the flight is not a measurement, if it is none.
fn refusal(
    [pitch, deviation]: [f64; 2],
    hold_deg: f32,
    steps: usize,
    set_deg: f64,
) -> Option<String> {
    if steps < FEWEST {
        Some(format!("{steps} control steps are too few to measure"))
    } else if deviation > STEADY_DEG || (pitch - set_deg).abs() > STEADY_DEG {
        Some(format!(
            "the drone was not held: pitch {pitch:.1} deg, to {deviation:.1} deg, where it was to be {set_deg:.1} deg"
        ))
    } else {
        let taken = Params::default().set(NAME, hold_deg).err();
        taken.map(|why| format!("{why}, not {hold_deg}: move the mass"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_drone_that_was_held_says_where_its_mass_is() {
        assert_eq!(refusal([0.3, 0.2], 2.3, 900, 0.0), None);
        for (pitch_deg, hold_deg, steps, part) in [
            ([0.3, 0.2], 2.3, 20, "too few"),
            ([4.0, 0.2], 2.3, 900, "not held"),
            ([0.3, 3.0], 2.3, 900, "not held"),
            ([0.3, 0.2], 11.0, 900, "move the mass"),
        ] {
            let why = refusal(pitch_deg, hold_deg, steps, 0.0).unwrap();
            assert!(why.contains(part), "{why}");
        }
    }
}
