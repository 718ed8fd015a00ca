//! The polarity check: somebody tilts the vehicle and looks whether each rudder answers the right
//! way.
//!
//! What the vehicle can know of it (which way it was tilted, that it commands the rudder) is
//! measured; which way the rudder really swings only a person sees.

use anyhow::{Result, bail};
use calibration::prompt::{Prompt, Tilt};

use super::person::Ending;
use super::session::{Seen, Session};
use super::write::{CHECKED, UNCHECKED, WATCHED, write};
use client::Parameter;
use flights::param_file::{POLARITY, SECOND_POLARITY};
use report::measure::{Figures, figure};
use tvc_nano::Axis;

/// Least pitch of a tilt, and largest pitch that counts as upright, rad.
const TILTED_RAD: f64 = 0.25;
const UPRIGHT_RAD: f64 = 0.1;
/// How many looks in a row must find it so.
const LOOKS: usize = 4;
/// How long a step may take, s of the vehicle's time.
const PATIENCE_S: f64 = 60.0;
/// Least change of the pulse that a person sees at the rudder, us.
const LEAST_US: f64 = 40.0;

/// How a rudder is looked at.
struct Look {
    axis: Axis,
    polarity: &'static str,
    direction: &'static str,
    rudder: &'static str,
    upright: &'static str,
    /// Tilts to the positive and the negative side, and where the rudder's lower edge points then.
    tilts: [(Tilt, &'static str); 2],
    /// What is wrong if the vehicle takes one side for the other.
    mistaken: &'static str,
    /// Keys and labels of its pulses, upright and tilted to either side.
    pulses: [(&'static str, &'static str); 3],
}

/// The looks, by axis.
const LOOKS_AT: [Look; Axis::COUNT] = [
    Look {
        axis: Axis::Pitch,
        polarity: POLARITY,
        direction: "SRV_DIR",
        rudder: "rudder",
        upright: "1/3  Thrust off. Hold the vehicle upright.",
        tilts: [(Tilt::NoseUp, "forward"), (Tilt::NoseDown, "backward")],
        mistaken: "nose up for nose down",
        pulses: [
            ("upright_us", "pulse upright"),
            ("nose_up_us", "  nose up"),
            ("nose_down_us", "  nose down"),
        ],
    },
    Look {
        axis: Axis::Roll,
        polarity: SECOND_POLARITY,
        direction: "SRV2_DIR",
        rudder: "second rudder",
        upright: "1/3  The second rudder. Hold the vehicle upright.",
        tilts: [(Tilt::RightDown, "left"), (Tilt::LeftDown, "right")],
        mistaken: "left for right",
        pulses: [
            ("upright_us", "second pulse upright"),
            ("right_down_us", "  right side down"),
            ("left_down_us", "  left side down"),
        ],
    },
];

/// What was seen of a rudder: pulses upright and tilted to either side, us.
struct Looked {
    direction: f32,
    upright_us: u16,
    tilted_us: [u16; 2],
    refused: Option<String>,
}

/// Leads through the check of every rudder, and keeps in the vehicle's flash that it was made.
///
/// # Errors
/// The vehicle does not answer or does not see the tilt, or the person wants an end.
pub fn check(session: &mut Session) -> Result<(Figures, Ending)> {
    session.await_standby()?;
    let axes = session.vehicle.parameter("AXES")? as usize;
    let looks = || LOOKS_AT.iter().take(axes);
    session.vehicle.begin(session.stop);
    for at in looks() {
        session.vehicle.put_back_later(at.polarity, UNCHECKED);
    }
    let looked = looks().map(|at| look(session, at));
    let looked: Result<Vec<Looked>> = looked.collect();
    let told = session.done();
    let looked = session.vehicle.leave(looked)?;
    told?;
    let refused = looked.iter().find_map(|looked| looked.refused.clone());
    session.person.show(&figures(&looked, &refused))?;
    if let Some(why) = &refused {
        return Ok((figures(&looked, &refused), Ending::refused(why)));
    }
    session.go_on()?;
    let rows = looks().map(|at| Parameter::new(at.polarity, CHECKED));
    write(&mut session.vehicle, &rows.collect::<Vec<_>>())?;
    let ending = Ending::met("checked: the vehicle may be armed");
    Ok((figures(&looked, &refused), ending))
}

fn figures(looked: &[Looked], refused: &Option<String>) -> Figures {
    let mut axes = looked.iter().zip(&LOOKS_AT).map(|(looked, at)| {
        let [up, down] = looked.tilted_us;
        let pulses = at.pulses.into_iter().zip([looked.upright_us, up, down]);
        let pulses = pulses.map(|((key, label), us)| figure(key, us).shown(label, "us", 0));
        [figure("direction", f64::from(looked.direction))].into_iter().chain(pulses).collect()
    });
    let checked = figure("checked", refused.is_none());
    let pitch: Vec<_> = axes.next().unwrap_or_default();
    let rest = [figure("roll", axes.next()), figure("refused", refused.clone())];
    Figures::from([checked].into_iter().chain(pitch).chain(rest))
}

/// Has the vehicle tilted both ways, and asks what the person sees.
fn look(session: &mut Session, at: &Look) -> Result<Looked> {
    session.vehicle.set_parameter(at.polarity, WATCHED)?;
    let direction = session.vehicle.parameter(at.direction)?;
    let us_per_deg = f64::from(session.vehicle.parameter("SRV_US_PER_DEG")?);
    let pulse_us = |seen: Seen| seen.pulses_us[at.axis.index()];
    let upright_us = pulse_us(tilt(session, Tilt::Upright, at.upright, at.axis)?);
    let mut looked = Looked { direction, upright_us, tilted_us: [0; 2], refused: None };
    for (side, (way, points)) in at.tilts.into_iter().enumerate() {
        let words = format!(
            "{}/3  Tilt it {} by some 20 deg, hold it, and look at the {}.",
            side + 2,
            way.name(),
            at.rudder
        );
        let tilted_us = pulse_us(tilt(session, way, &words, at.axis)?);
        looked.tilted_us[side] = tilted_us;
        let change = f64::from(tilted_us) - f64::from(upright_us);
        let sign = [1.0, -1.0][side];
        if change * sign * f64::from(direction) < LEAST_US {
            looked.refused = Some(format!(
                "the pulse changed by {change:+.0} us, too little to be seen: check the gains and the pulse limits"
            ));
            return Ok(looked);
        }
        // At the virtual rig there is nothing else to look at.
        session.say(&format!(
            "commanded: pulse {upright_us} -> {tilted_us} us, servo {:+.0} deg",
            change / us_per_deg
        ));
        let rudder = at.rudder;
        let question =
            format!("Does the {rudder}'s lower edge point {points}, to the raised side?");
        if !session.agrees(&question)? {
            looked.refused = Some(format!(
                "the rudder answers the wrong way: set {} to {} and look again; if the vehicle takes {}, the mount \
                 is wrong instead (MNT_YAW_DEG)",
                at.direction, -direction, at.mistaken
            ));
            return Ok(looked);
        }
    }
    // The other rudder is looked at while this one rests.
    session.vehicle.set_parameter(at.polarity, UNCHECKED)?;
    Ok(looked)
}

/// Waits until the vehicle is tilted and its rudder rests.
fn tilt(session: &mut Session, way: Tilt, words: &str, axis: Axis) -> Result<Seen> {
    session.ask(Prompt::Tilt(way), words)?;
    let begun_s = session.now_s();
    let angle = |seen: Seen| seen.tilts_rad[axis.index()];
    let (mut so, mut last) = (0, session.seen);
    while so < LOOKS {
        session.look()?;
        let seen = session.seen;
        let there = match way {
            Tilt::NoseUp | Tilt::RightDown => angle(seen) >= TILTED_RAD,
            Tilt::NoseDown | Tilt::LeftDown => angle(seen) <= -TILTED_RAD,
            Tilt::Upright => angle(seen).abs() <= UPRIGHT_RAD,
        };
        let rests = (angle(seen) - angle(last)).abs() < 0.02;
        so = if there && rests { so + 1 } else { 0 };
        last = seen;
        let name = ["pitch", "roll"][axis.index()];
        session.progress(
            so as f64 / LOOKS as f64,
            &format!(
                "{name} {:+.0} deg, pulse {} us",
                angle(seen).to_degrees(),
                seen.pulses_us[axis.index()]
            ),
        );
        if session.now_s() - begun_s > PATIENCE_S {
            bail!("{}", astray(way, seen));
        }
    }
    Ok(last)
}

/// Why the vehicle does not see the tilt that was asked for.
fn astray(way: Tilt, seen: Seen) -> String {
    let [pitch, roll] = seen.tilts_rad.map(f64::to_degrees);
    let mut why = format!(
        "the vehicle was to be {} and says pitch {pitch:+.0} deg, roll {roll:+.0} deg",
        way.name()
    );
    if seen.tilts_rad.iter().any(|tilt| tilt.abs() >= TILTED_RAD) {
        why += ": if it was, the mount is wrong (`tvc calibrate --only level`, MNT_YAW_DEG)";
    }
    why
}

#[cfg(test)]
mod tests {
    use super::*;
    use tvc_nano::params::Polarity;
    use tvc_nano::{Params, Refusal};

    #[test]
    fn the_firmware_means_the_same_by_its_parameter_and_names_this_command() {
        for (value, meaning) in [
            (UNCHECKED, Polarity::Unchecked),
            (CHECKED, Polarity::Checked),
            (WATCHED, Polarity::Watched),
        ] {
            for at in LOOKS_AT {
                let mut params = Params::default();
                params.set(at.polarity, value).unwrap();
                assert_eq!(params.polarity(at.axis), meaning);
                assert!(params.value(at.direction).is_some());
            }
        }
        assert!(Refusal::Polarity.to_string().contains("tvc calibrate polarity"));
    }

    #[test]
    fn a_tilt_the_other_way_is_said_to_be_one() {
        let seen = Seen { tilts_rad: [-0.35, 0.0], ..Seen::default() };
        let why = astray(Tilt::NoseUp, seen);
        assert!(why.contains("pitch -20 deg") && why.contains("mount"), "{why}");
        assert!(!astray(Tilt::NoseUp, Seen::default()).contains("mount"));
    }
}
