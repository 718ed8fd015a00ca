//! What is done by hand to a rig that runs, each action in a line of words ([`HELP`]).

use std::fmt::Display;
use std::ops::RangeInclusive;
use std::str::FromStr;

use samd21::board::Ticks;
use tvc_nano::Axis;

use crate::bench::hardware::number;
use crate::bench::{FaultEntry, Hardware};
use crate::bno055::{Fault, FaultKind};
use crate::disturbance::{SupplySag, Temperature, ThrustRamp, Vibration};
use crate::rig::ProgramEnd;
use crate::sensor_motion::SensorMotion;

/// The words of each action, and what happens.
pub const HELP: [(&str, &str); 21] = [
    ("state", "nothing; the answer tells how the rig is"),
    (
        "tilt RAD",
        "the clamp tilts the drone, -1.5 to 1.5 rad, and holds it there before every release",
    ),
    ("roll RAD", "the same to the side, right side down positive, of a drone with two rudders"),
    (
        "clamp open|closed|auto",
        "the clamp opens, which lights the engine of a rocket, or closes by hand; auto opens it when \
         the firmware goes to active",
    ),
    ("push N_M_S", "an impulse on a free drone, -1 to 1 N m s; positive raises the nose"),
    ("gust N_M,S", "a torque on a free drone, -1 to 1 N m, for 0.01 to 60 s"),
    (
        "sensor tremble|turn|back",
        "the sensor is held unsteadily, turned in all directions, or put back on the drone",
    ),
    (
        "fault KIND [KEY=VALUE ...]",
        "a fault of the BNO055 (docs/reference/faults.md) from now on; keys: for_s, probability, stretch_ms, clocks",
    ),
    ("clear KIND|all", "ends a fault"),
    ("vibration ACC,HZ[,...]|off", "as --vibration of tvc rig"),
    ("servo-supply V[,...]|off", "as --servo-supply"),
    ("thrust-ramp PCT,S|off", "as --thrust-ramp"),
    ("temperature C,C,S[,...]|off", "as --temperature"),
    (
        "hardware KEY=VALUE",
        "as --hardware, for stretch, stretch-rare, stop-read, stop-write, field, field-age, usb-loss",
    ),
    ("reset", "the reset button"),
    ("power-cycle", "the power of chip and sensor is cut for a moment; faults stay"),
    ("brown-out", "the supply dips below the chip's brown-out level"),
    ("supply V", "the chip's supply goes to V, 1.6 to 3.6; it begins with 3.3"),
    ("program hang|hard-fault|stack-overflow", "the run of the firmware ends badly"),
    ("store spoil|erase", "the stored parameters cannot be read any more, or are gone"),
    ("usb out|in", "the cable is pulled, and put in again"),
];

/// Tilts of the clamp, rad.
const TILT_RAD: RangeInclusive<f64> = -1.5..=1.5;
/// Impulses, N m s, and torques, N m.
const PUSH: RangeInclusive<f64> = -1.0..=1.0;
/// Supply of the chip, V.
const SUPPLY: RangeInclusive<f64> = 1.6..=3.6;
/// Lengths of a gust, s.
const GUST_S: RangeInclusive<f64> = 0.01..=60.0;

/// Something that is done by hand.
#[derive(Clone, Debug, PartialEq)]
pub enum Action {
    /// Nothing.
    Look,
    /// The clamp holds the drone at this tilt of an axis before every release, rad.
    Tilt(Axis, f64),
    /// The clamp is opened or closed by hand; `None` leaves it to the firmware's state.
    Clamp(Option<bool>),
    /// An angular impulse, N m s.
    Push(f64),
    /// A torque, N m, for a time, s.
    Gust(f64, f64),
    /// The sensor is moved by hand, or put back on the drone.
    Sensor(Option<SensorMotion>),
    /// A fault from now on, and how long.
    Fault(Fault, Option<Ticks>),
    /// The end of a fault, or of all.
    Clear(Option<FaultKind>),
    /// A disturbance from now on, or none.
    Vibration(Option<Vibration>),
    /// Likewise.
    ServoSupply(Option<SupplySag>),
    /// Likewise.
    ThrustRamp(Option<ThrustRamp>),
    /// Likewise.
    Temperature(Option<Temperature>),
    /// Parts that differ, as `KEY=VALUE`.
    Hardware(String),
    /// The reset button.
    Reset,
    /// The power is cut for a moment.
    PowerCycle,
    /// A dip of the chip's supply.
    BrownOut,
    /// The chip's supply, V.
    Supply(f64),
    /// A bad end of the program.
    Program(ProgramEnd),
    /// Stored parameters that cannot be read, or, if true, are gone.
    Store(bool),
    /// The cable at the port: in or out.
    Usb(bool),
}

impl FromStr for Action {
    type Err = String;

    fn from_str(line: &str) -> Result<Self, String> {
        let mut words = line.split_whitespace();
        let name = words.next().unwrap_or_default();
        let words: Vec<&str> = words.collect();
        let Some((usage, _)) = HELP.iter().find(|(usage, _)| first(usage) == name) else {
            let names = HELP.map(|(usage, _)| first(usage)).join(", ");
            return Err(format!("there is no action `{name}`; there are {names}"));
        };
        let usage = || format!("say `{usage}`");
        let action = match (name, words.as_slice()) {
            ("state", []) => Self::Look,
            ("tilt", [rad]) => Self::Tilt(Axis::Pitch, number(rad, TILT_RAD)?),
            ("roll", [rad]) => Self::Tilt(Axis::Roll, number(rad, TILT_RAD)?),
            ("clamp", ["open"]) => Self::Clamp(Some(true)),
            ("clamp", ["closed"]) => Self::Clamp(Some(false)),
            ("clamp", ["auto"]) => Self::Clamp(None),
            ("push", [impulse]) => Self::Push(number(impulse, PUSH)?),
            ("gust", [gust]) => {
                let (torque, seconds) = gust.split_once(',').ok_or_else(usage)?;
                Self::Gust(number(torque, PUSH)?, number(seconds, GUST_S)?)
            }
            ("sensor", ["tremble"]) => Self::Sensor(Some(SensorMotion::TREMBLE)),
            ("sensor", ["turn"]) => Self::Sensor(Some(SensorMotion::Turn)),
            ("sensor", ["back"]) => Self::Sensor(None),
            ("fault", [kind, settings @ ..]) => fault(kind, settings)?,
            ("clear", ["all"]) => Self::Clear(None),
            ("clear", [kind]) => Self::Clear(Some(kind.parse()?)),
            ("vibration", [value]) => Self::Vibration(unless_off(value)?),
            ("servo-supply", [value]) => Self::ServoSupply(unless_off(value)?),
            ("thrust-ramp", [value]) => Self::ThrustRamp(unless_off(value)?),
            ("temperature", [value]) => Self::Temperature(unless_off(value)?),
            ("hardware", [setting]) => {
                Hardware::default().set(setting)?;
                Self::Hardware((*setting).to_owned())
            }
            ("reset", []) => Self::Reset,
            ("power-cycle", []) => Self::PowerCycle,
            ("brown-out", []) => Self::BrownOut,
            ("supply", [volts]) => Self::Supply(number(volts, SUPPLY)?),
            ("program", ["hang"]) => Self::Program(ProgramEnd::Hang),
            ("program", ["hard-fault"]) => Self::Program(ProgramEnd::HardFault),
            ("program", ["stack-overflow"]) => Self::Program(ProgramEnd::StackOverflow),
            ("store", ["spoil"]) => Self::Store(false),
            ("store", ["erase"]) => Self::Store(true),
            ("usb", ["out"]) => Self::Usb(false),
            ("usb", ["in"]) => Self::Usb(true),
            _ => return Err(usage()),
        };
        Ok(action)
    }
}

fn first(usage: &str) -> &str {
    usage.split(' ').next().unwrap_or_default()
}

fn unless_off<T: FromStr<Err = String>>(text: &str) -> Result<Option<T>, String> {
    (text != "off").then(|| text.parse()).transpose()
}

/// A fault that is as hard as one that is drawn can be, where the settings say nothing.
fn fault(kind: &str, settings: &[&str]) -> Result<Action, String> {
    let kind: FaultKind = kind.parse()?;
    let mut entry = FaultEntry { kind: kind.to_string(), ..FaultEntry::default() };
    for setting in settings {
        let (key, value) = setting.split_once('=').unwrap_or((setting, ""));
        match key {
            "for_s" => entry.for_s = Some(parsed(key, value)?),
            "probability" => entry.probability = Some(parsed(key, value)?),
            "stretch_ms" => entry.stretch_ms = Some(parsed(key, value)?),
            "clocks" => entry.clocks = Some(parsed(key, value)?),
            _ => {
                return Err(format!(
                    "a fault has no `{key}`; it can have for_s, probability, stretch_ms, clocks"
                ));
            }
        }
    }
    let timed = entry.fit(1.0, kind, kind.hardest())?;
    Ok(Action::Fault(timed.fault, entry.for_s.map(Ticks::from_secs_f64)))
}

fn parsed<T: FromStr>(key: &str, value: &str) -> Result<T, String>
where
    T::Err: Display,
{
    value.parse().map_err(|error| format!("{key}={value}: {error}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_action_has_words_and_every_choice_is_one() {
        for (usage, _) in HELP {
            let sample = match first(usage) {
                "tilt" | "roll" | "push" => "0.4",
                "gust" => "0.05,0.3",
                "fault" => "spikes",
                "vibration" | "servo-supply" | "thrust-ramp" | "temperature" => "off",
                "supply" => "3.3",
                "clear" => "all",
                "hardware" => "stretch=300",
                _ => usage.split(' ').nth(1).unwrap_or_default(),
            };
            for choice in sample.split('|') {
                let line = format!("{} {choice}", first(usage));
                line.parse::<Action>().unwrap_or_else(|why| panic!("{line}: {why}"));
            }
        }
    }

    #[test]
    fn a_fault_is_told_how_hard_and_how_long() {
        let said = "fault long-stretch stretch_ms=3 probability=1 for_s=0.5";
        let fault = Fault::LongStretch { stretch: Ticks::from_ms(3), probability: 1.0 };
        assert_eq!(said.parse(), Ok(Action::Fault(fault, Some(Ticks::from_ms(500)))));
        let fault = Fault::SdaHeld { clocks: 9 };
        assert_eq!("fault sda-held".parse(), Ok(Action::Fault(fault, None)));
    }

    #[test]
    fn what_is_no_action_is_refused_with_what_is_one() {
        for (line, part) in [
            ("", "there are state, tilt"),
            ("explode", "there is no action `explode`"),
            ("tilt", "say `tilt RAD`"),
            ("tilt 2", "-1.5 to 1.5"),
            ("tilt NaN", "-1.5 to 1.5"),
            ("tilt 0.1 0.2", "say `tilt RAD`"),
            ("clamp ajar", "open|closed|auto"),
            ("gust 0.1", "say `gust N_M,S`"),
            ("fault gremlins", "sda-held"),
            ("fault frozen probability=0.5", "frozen has no probability"),
            ("fault spikes probability=2", "probability must be 0 to 1"),
            ("fault spikes for_s=0", "for_s must be above 0"),
            ("fault spikes hard", "a fault has no `hard`"),
            ("clear gremlins", "sda-held"),
            ("vibration 5", "m/s2 and Hz"),
            ("hardware stretch=-1", "stretch"),
            ("usb up", "out|in"),
        ] {
            let why = line.parse::<Action>().unwrap_err();
            assert!(why.contains(part), "{line}: {why}");
        }
    }
}
