//! The polarity check: somebody tilts the vehicle and looks whether the rudder answers the right
//! way.
//!
//! What the vehicle can know of it (which way it was tilted, that it commands the rudder) is
//! measured; which way the rudder really swings only a person sees.

use anyhow::{Result, bail};
use calibration::prompt::{Prompt, Tilt};
use serde::Serialize;

use super::options::Calibrate;
use super::person::Ending;
use super::session::{Seen, Session, verdict};
use super::write::{CHECKED, POLARITY, UNCHECKED, WATCHED, write};
use crate::out::exit::Verdict;
use crate::out::file::print_json;
use client::Parameter;

/// Least pitch of a tilt, and largest pitch that counts as upright, rad.
const TILTED_RAD: f64 = 0.25;
const UPRIGHT_RAD: f64 = 0.1;
/// How many looks in a row must find it so.
const LOOKS: usize = 4;
/// How long a step may take, s of the vehicle's time.
const PATIENCE_S: f64 = 60.0;
/// Least change of the pulse that a person sees at the rudder, us.
const LEAST_US: f64 = 40.0;

/// What `tvc calibrate polarity --json` prints.
#[derive(Debug, Serialize)]
pub struct Figures {
    checked: bool,
    direction: f32,
    upright_us: u16,
    nose_up_us: u16,
    nose_down_us: u16,
    refused: Option<String>,
}

impl Figures {
    fn lines(&self) -> Vec<[String; 2]> {
        [
            ("pulse upright, us", self.upright_us),
            ("  nose up", self.nose_up_us),
            ("  nose down", self.nose_down_us),
        ]
        .map(|(name, us)| [name.to_owned(), us.to_string()])
        .into()
    }

    fn text(&self) -> String {
        format!(
            "pulse upright {} us, nose up {} us, nose down {} us\n",
            self.upright_us, self.nose_up_us, self.nose_down_us
        )
    }
}

/// Checks the vehicle at a port.
///
/// # Errors
/// The vehicle does not answer or does not see the tilt, or Ctrl-C was pressed.
pub fn run(options: &Calibrate) -> Result<Verdict> {
    let mut session = Session::connect(options)?;
    let (figures, ending) = check(&mut session)?;
    if figures.checked {
        session.say(&ending.words);
    }
    if options.port.json {
        print_json(&figures)?;
    }
    Ok(verdict(figures.refused.as_deref()))
}

/// Leads through the check, and keeps in the vehicle's flash that it was made.
///
/// # Errors
/// The vehicle does not answer or does not see the tilt, or the person wants an end.
pub fn check(session: &mut Session) -> Result<(Figures, Ending)> {
    session.await_standby()?;
    session.vehicle.begin(session.stop);
    session.vehicle.put_back_later(POLARITY, UNCHECKED);
    let looked = look(session);
    let told = session.done();
    let mut figures = session.vehicle.leave(looked)?;
    told?;
    session.person.show(&figures.lines(), &figures.text())?;
    if let Some(why) = &figures.refused {
        let ending = Ending::unchanged(why.clone());
        return Ok((figures, ending));
    }
    session.go_on()?;
    let row = Parameter {
        name: POLARITY.to_owned(),
        value: CHECKED,
    };
    write(&mut session.vehicle, &[row])?;
    figures.checked = true;
    Ok((figures, Ending::met("checked: the vehicle may be armed")))
}

/// Has the vehicle tilted both ways, and asks what the person sees.
fn look(session: &mut Session) -> Result<Figures> {
    session.vehicle.set_parameter(POLARITY, WATCHED)?;
    let direction = session.vehicle.parameter("SRV_DIR")?;
    let mut figures = Figures {
        checked: false,
        direction,
        upright_us: 0,
        nose_up_us: 0,
        nose_down_us: 0,
        refused: None,
    };
    let upright = tilt(
        session,
        Tilt::Upright,
        "1/3  Thrust off. Hold the vehicle upright.",
    )?;
    figures.upright_us = upright.pulse_us;
    for (way, words, question) in [
        (
            Tilt::NoseUp,
            "2/3  Tilt it nose up by some 20 deg, hold it, and look at the rudder.",
            "Does the rudder's lower edge point forward, to the raised side?",
        ),
        (
            Tilt::NoseDown,
            "3/3  Tilt it nose down by some 20 deg, hold it, and look at the rudder.",
            "Does the rudder's lower edge point backward, to the raised side?",
        ),
    ] {
        let seen = tilt(session, way, words)?;
        let change = f64::from(seen.pulse_us) - f64::from(upright.pulse_us);
        let nose = if way == Tilt::NoseUp {
            figures.nose_up_us = seen.pulse_us;
            1.0
        } else {
            figures.nose_down_us = seen.pulse_us;
            -1.0
        };
        if change * nose * f64::from(direction) < LEAST_US {
            figures.refused = Some(format!(
                "the pulse changed by {change:+.0} us, too little to be seen: check the gains and the pulse limits"
            ));
            return Ok(figures);
        }
        if !session.agrees(question)? {
            figures.refused = Some(format!(
                "the rudder answers the wrong way: set SRV_DIR to {} and look again; if the vehicle takes nose up for nose \
                 down, the mount is wrong instead (MNT_YAW_DEG)",
                -direction
            ));
            return Ok(figures);
        }
    }
    Ok(figures)
}

/// Waits until the vehicle is tilted and its rudder rests.
fn tilt(session: &mut Session, way: Tilt, words: &str) -> Result<Seen> {
    session.ask(Prompt::Tilt(way), words)?;
    let begun_s = session.now_s();
    let (mut so, mut last) = (0, session.seen());
    while so < LOOKS {
        session.look()?;
        let seen = session.seen();
        let there = match way {
            Tilt::NoseUp => seen.pitch_rad >= TILTED_RAD,
            Tilt::NoseDown => seen.pitch_rad <= -TILTED_RAD,
            Tilt::Upright => seen.pitch_rad.abs() <= UPRIGHT_RAD,
        };
        let rests = (seen.pitch_rad - last.pitch_rad).abs() < 0.02;
        so = if there && rests { so + 1 } else { 0 };
        last = seen;
        let degrees = seen.pitch_rad.to_degrees();
        session.progress(
            so as f64 / LOOKS as f64,
            &format!("pitch {degrees:+.0} deg, pulse {} us", seen.pulse_us),
        );
        if session.now_s() - begun_s > PATIENCE_S {
            bail!("{}", astray(way, seen));
        }
    }
    Ok(last)
}

/// Why the vehicle does not see the tilt that was asked for.
fn astray(way: Tilt, seen: Seen) -> String {
    let asked = match way {
        Tilt::NoseUp => "nose up",
        Tilt::NoseDown => "nose down",
        Tilt::Upright => "upright",
    };
    let (pitch, roll) = (seen.pitch_rad.to_degrees(), seen.roll_rad.to_degrees());
    let mut why = format!(
        "the vehicle was to be {asked} and says pitch {pitch:+.0} deg, roll {roll:+.0} deg"
    );
    if seen.pitch_rad.abs().max(seen.roll_rad.abs()) >= TILTED_RAD {
        why += ": if it was, the mount is wrong (`tvc calibrate --only level`, MNT_YAW_DEG)";
    }
    why
}

#[cfg(test)]
mod tests {
    use super::*;
    use tvc_nano::params::Polarity;
    use tvc_nano::{Axis, Params, Refusal};

    #[test]
    fn the_firmware_means_the_same_by_its_parameter_and_names_this_command() {
        for (value, meaning) in [
            (UNCHECKED, Polarity::Unchecked),
            (CHECKED, Polarity::Checked),
            (WATCHED, Polarity::Watched),
        ] {
            let mut params = Params::default();
            params.set(POLARITY, value).unwrap();
            assert_eq!(params.polarity(Axis::Pitch), meaning);
        }
        assert!(
            Refusal::Polarity
                .to_string()
                .contains("tvc calibrate polarity")
        );
    }

    #[test]
    fn a_tilt_the_other_way_is_said_to_be_one() {
        let seen = Seen {
            pitch_rad: -0.35,
            ..Seen::default()
        };
        let why = astray(Tilt::NoseUp, seen);
        assert!(
            why.contains("pitch -20 deg") && why.contains("mount"),
            "{why}"
        );
        assert!(!astray(Tilt::NoseUp, Seen::default()).contains("mount"));
    }
}
