//! The servo's set-up: the vehicle holds pulses while disarmed, and a person reports where the
//! rudder is.

use std::time::Duration;

use anyhow::Result;
use client::{Parameter, request};
use tvc_nano::config::{PULSE_MAX_US, PULSE_MIN_US};
use tvc_nano::{Axis, Params};

use super::figures::named;
use super::keyboard::is_yes;
use super::options::Servo;
use super::person::{Ending, Question};
use super::session::{Session, UNCHANGED};
use report::exit::BadInput;
use report::measure::{Figures, figure, shown};

/// Time after which a pulse is commanded again; the vehicle holds it for two seconds.
const AGAIN: Duration = Duration::from_millis(500);
/// Step of a nudge, us.
const NUDGE_US: f32 = 5.0;
/// How far from the centre the horn's angle is measured, us.
const SPAN_US: f32 = 300.0;

/// The parameter that both servos share.
const SCALE: &str = "SRV_US_PER_DEG";

/// The parameters of a servo, by axis: centre, scale, direction, shortest and longest pulse.
const NAMES: [[&str; 5]; Axis::COUNT] = [
    ["SRV_CENTRE_US", SCALE, "SRV_DIR", "SRV_MIN_US", "SRV_MAX_US"],
    ["SRV2_CENTRE_US", SCALE, "SRV2_DIR", "SRV2_MIN_US", "SRV2_MAX_US"],
];

/// Asks the person for the values that are not given, and writes all of them if the person agrees.
///
/// # Errors
/// A value that the firmware does not take, a vehicle that does not answer, or the person wants an
/// end.
pub fn set_up(session: &mut Session, given: &Servo) -> Result<(Figures, Ending)> {
    session.vehicle.begin(session.stop);
    let found = find(session, given);
    let rows = session.vehicle.leave(found)?;
    let found = rows.iter().map(|row| shown(&row.name, row.value.to_string()));
    session.person.show(&Figures::from(found))?;
    let changed = session.write_if_agreed(&rows)?;
    let ending = match changed {
        Some(changed) => Ending::met(format!("{changed} parameters changed, in the flash too")),
        None => Ending::unchanged(UNCHANGED),
    };
    let figures = Figures::from([
        named(&rows),
        figure("changed", changed.unwrap_or(0)),
        figure("written", ending.met),
        // Another direction undoes the check.
        figure("polarity_checked", session.is_polarity_checked()?),
    ]);
    Ok((figures, ending))
}

/// Checks that the firmware takes what is given.
///
/// # Errors
/// [`BadInput`] that names the option.
pub fn check(given: &Servo) -> Result<()> {
    const OPTIONS: [&str; 5] = ["--centre", "--us-per-deg", "--direction", "--min", "--max"];
    let values = [given.centre, given.us_per_deg, given.direction, given.min, given.max];
    let all = OPTIONS.into_iter().zip(NAMES[given.axis().index()]).zip(values);
    admit(all.filter_map(|((option, name), value)| Some((option, name, value?))))
}

/// Checks that the firmware takes values; of each what it is called, its parameter and itself.
fn admit<'a>(values: impl Iterator<Item = (&'a str, &'a str, f32)>) -> Result<()> {
    let mut table = Params::default();
    for (called, name, value) in values {
        let set = table.set(name, value);
        set.map_err(|why| BadInput::new(format!("{called} {value}: {why}")))?;
    }
    Ok(())
}

/// Each value as given on the command line, else as the person finds it, else as the vehicle has
/// it.
fn find(session: &mut Session, given: &Servo) -> Result<Vec<Parameter>> {
    let yes = session.yes;
    let axis = given.axis();
    let names = NAMES[axis.index()];
    let [centre_name, scale_name, direction_name, min_name, max_name] = names;
    type Ask<'a> = &'a dyn Fn(&mut Session, f32) -> Result<f32>;
    let mut value = |name: &str, given: Option<f32>, ask: Ask<'_>| match given {
        Some(value) => Ok(value),
        None => {
            let has = session.vehicle.parameter(name)?;
            if yes { Ok(has) } else { ask(session, has) }
        }
    };
    let centre = value(centre_name, given.centre, &|session, has| {
        let what = "Thrust off. Centre: the rudder hangs straight down";
        nudge(session, axis, what, has)
    })?;
    let us_per_deg = value(scale_name, given.us_per_deg, &|session, has| {
        Ok(scale(session, axis, centre)?.unwrap_or(has))
    })?;
    let direction = value(direction_name, given.direction, &|session, has| {
        Ok(direction(session, axis, centre)?.unwrap_or(has))
    })?;
    let min = value(min_name, given.min, &|session, has| {
        nudge(session, axis, "Shortest pulse at which nothing touches", has)
    })?;
    let max = value(max_name, given.max, &|session, has| {
        nudge(session, axis, "Longest pulse at which nothing touches", has)
    })?;
    // Rounded as a person would write it, so that files and vehicles agree.
    let row = |(name, value): (&str, f32)| Parameter::new(name, (value * 1000.0).round() / 1000.0);
    let values = [centre, us_per_deg, direction, min, max];
    let rows: Vec<_> = names.into_iter().zip(values).map(row).collect();
    admit(rows.iter().map(|row| (&*row.name, &*row.name, row.value)))?;
    Ok(rows)
}

/// Asks a question while the servo holds a pulse.
fn ask_at(
    session: &mut Session,
    axis: Axis,
    pulse_us: f32,
    question: &Question,
) -> Result<Option<String>> {
    let mut due = session.vehicle.now();
    session.question(question, &mut |vehicle| {
        if vehicle.now() >= due {
            due = vehicle.now() + AGAIN;
            vehicle.command(request::servo(axis, pulse_us))?;
        }
        Ok(())
    })
}

/// Moves the servo until the person accepts the pulse.
fn nudge(session: &mut Session, axis: Axis, what: &str, from_us: f32) -> Result<f32> {
    let mut pulse_us = from_us;
    let mut again = false;
    loop {
        let question = Question {
            words: format!("{what}: now {pulse_us} us."),
            keys: "Pulse in us, + or - for 5 us (++ for 10), Enter when it is so:",
            buttons: &[
                ("\u{2212} 50", "----------"),
                ("\u{2212} 5", "-"),
                ("+ 5", "+"),
                ("+ 50", "++++++++++"),
                ("It is so", ""),
            ],
            entry: Some("us"),
            again,
        };
        let Some(answer) = ask_at(session, axis, pulse_us, &question)? else {
            return Ok(pulse_us);
        };
        again = true;
        match nudged(pulse_us, &answer) {
            Some(us) => pulse_us = us,
            None => session.say(&format!(
                "{answer} leads to no pulse within the limits of {PULSE_MIN_US:.0} to {PULSE_MAX_US:.0} us"
            )),
        }
    }
}

/// The pulse after an answer, if it is within the limits of all servos.
fn nudged(pulse_us: f32, answer: &str) -> Option<f32> {
    let us = if answer.bytes().all(|b| b == b'+') {
        pulse_us + NUDGE_US * answer.len() as f32
    } else if answer.bytes().all(|b| b == b'-') {
        pulse_us - NUDGE_US * answer.len() as f32
    } else {
        answer.parse().ok()?
    };
    (PULSE_MIN_US..=PULSE_MAX_US).contains(&us).then_some(us)
}

/// Change of the pulse per degree, us, from the horn's angles at [`SPAN_US`] to both sides.
fn scale(session: &mut Session, axis: Axis, centre_us: f32) -> Result<Option<f32>> {
    let mut degrees = 0.0;
    for pulse_us in [centre_us + SPAN_US, centre_us - SPAN_US] {
        loop {
            let question = Question {
                words: format!("Horn at {pulse_us} us: how many deg from the centre, either way"),
                keys: "(Enter: leave the scale as it is)?",
                buttons: &[("Leave the scale as it is", "")],
                entry: Some("deg"),
                again: false,
            };
            let Some(answer) = ask_at(session, axis, pulse_us, &question)? else {
                return Ok(None);
            };
            match answer.parse::<f32>() {
                Ok(deg) if (5.0..=90.0).contains(&deg.abs()) => {
                    degrees += deg.abs();
                    break;
                }
                _ => session.say(&format!("{answer} is no angle from 5 to 90 deg")),
            }
        }
    }
    Ok(Some(2.0 * SPAN_US / degrees))
}

/// Which way a longer pulse turns the rudder.
fn direction(session: &mut Session, axis: Axis, centre_us: f32) -> Result<Option<f32>> {
    let words = match axis {
        Axis::Pitch => "A longer pulse: does the rudder's lower edge point forward, to the nose",
        Axis::Roll => "A longer pulse: does the second rudder's lower edge point left",
    };
    let buttons = &[("Yes", "y"), ("No", "n"), ("Leave it as it is", "")];
    let question = Question::new(words, "[y/n] (Enter: leave it as it is)?", buttons);
    loop {
        match ask_at(session, axis, centre_us + SPAN_US, &question)?.as_deref() {
            None => return Ok(None),
            Some(answer) if is_yes(answer) => return Ok(Some(1.0)),
            Some("n" | "N" | "no") => return Ok(Some(-1.0)),
            Some(_) => session.say("answer y or n"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nudges_and_pulses() {
        assert_eq!(nudged(1500.0, "+"), Some(1505.0));
        assert_eq!(nudged(1500.0, "---"), Some(1485.0));
        assert_eq!(nudged(1500.0, "1523.6"), Some(1523.6));
        for bad in ["800", "2200", "x", "+-", "NaN"] {
            assert_eq!(nudged(1500.0, bad), None, "{bad}");
        }
        assert_eq!(nudged(855.0, "-"), None);
    }

    #[test]
    fn what_the_firmware_would_not_take_is_named_by_its_option() {
        let given = |centre, direction| Servo {
            second: false,
            centre,
            us_per_deg: None,
            direction,
            min: None,
            max: None,
        };
        assert!(check(&given(Some(1500.0), Some(-1.0))).is_ok());
        let why = check(&given(Some(1700.0), None)).unwrap_err().to_string();
        assert!(why.starts_with("--centre 1700: SRV_CENTRE_US must be"), "{why}");
        assert!(check(&given(None, Some(0.5))).is_err());
        let second = Servo { second: true, ..given(Some(1700.0), None) };
        let why = check(&second).unwrap_err().to_string();
        assert!(why.contains("SRV2_CENTRE_US must be"), "{why}");
    }
}
