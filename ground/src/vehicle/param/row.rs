//! A parameter as people see it: its value, what it means, what it belongs to, and which control
//! laws use it.

use client::Parameter;
use serde::Serialize;
use tvc_nano::Params;
use tvc_nano::params::{Change, DESCRIPTIONS};

/// The parameter that chooses the control law.
pub const LAW: &str = "PID_LAW";

/// Beginnings of names, what such parameters belong to, and the control laws that use them: none
/// where it is no matter of the law.
const GROUPS: [(&str, &str, &[u8]); 28] = [
    ("PID_KP", CONTROL, &[0]),
    ("PID_KI", CONTROL, &[0, 3]),
    ("PID_KD", CONTROL, &[0, 3]),
    ("PID_TRIM", CONTROL, &[2]),
    (LAW, CONTROL, &[]),
    ("SFC_", CONTROL, &[2]),
    ("CAS_", CONTROL, &[3]),
    // What the control laws assume of drone and servo.
    ("PITCH_GAIN", CONTROL, &[2]),
    ("SRV_LOOP_S", CONTROL, &[2]),
    ("SRV_MOTOR_S", CONTROL, &[2]),
    ("SRV_PLAY_RAD", CONTROL, &[2]),
    ("SRV_RAD_S", CONTROL, &[2]),
    ("PITCH_SET", CONTROL, &[]),
    ("ROLL_SET", CONTROL, &[]),
    ("AXES", CONTROL, &[]),
    ("SRV_POLARITY", SAFETY, &[]),
    ("SRV2_POLARITY", SAFETY, &[]),
    ("FS_", SAFETY, &[]),
    ("SRV_", "Servo", &[]),
    ("SRV2_", "Second servo", &[]),
    ("GS", "Gain schedule", &[0, 3]),
    ("LAUNCH_", FREE, &[]),
    ("BURN", FREE, &[]),
    ("GYR_PER_G", FREE, &[]),
    ("MNT_", MOUNT, &[]),
    ("DECLINATION", MOUNT, &[]),
    ("FUSE_", "Attitude filter", &[]),
    ("CAL_", "Calibration of the sensors", &[]),
];
const CONTROL: &str = "Control law";
const SAFETY: &str = "Safety";
const FREE: &str = "Free flight";
const MOUNT: &str = "Mount and place";
const OTHER: &str = "Bus, clock and link";

/// What the polarity check turns the rudder by, whatever the law is.
const SHOWN: [&str; 2] = ["PID_KP", "PID_KD"];

fn place(name: &str) -> (&'static str, &'static [u8]) {
    let found = GROUPS.iter().find(|(prefix, ..)| name.starts_with(prefix));
    found.map_or((OTHER, &[]), |(_, group, laws)| (*group, *laws))
}

/// The control laws that use a parameter; none where it is no matter of the law.
pub fn laws_of(name: &str) -> &'static [u8] {
    place(name).1
}

/// Whether the vehicle sets the parameter by itself: its value is no change of the operator's.
pub fn is_measured(name: &str) -> bool {
    Params::info(name).is_some_and(|info| info.change == Change::Measured)
}

/// `law 2`, `laws 0 and 3`.
fn named(laws: &[u8]) -> String {
    match laws {
        [one] => format!("law {one}"),
        [rest @ .., last] => {
            let rest: Vec<String> = rest.iter().map(u8::to_string).collect();
            format!("laws {} and {last}", rest.join(", "))
        }
        [] => String::new(),
    }
}

/// A parameter's value on the vehicle, with this tool's own description of it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    /// Name.
    pub name: String,
    /// Value.
    pub value: f32,
    /// Value after a reset.
    pub default: Option<f32>,
    /// Unit.
    pub unit: &'static str,
    /// The values that it can have, in words.
    pub range: String,
    /// What it does.
    pub meaning: String,
    /// The law in force, if that does not use it.
    pub unused_by_law: Option<u8>,
}

impl Row {
    /// A parameter with its description, where this control law is in force; a parameter that this
    /// tool does not know has none.
    pub fn of(parameter: &Parameter, law: Option<f32>) -> Self {
        let index = Params::index_of(&parameter.name);
        let info = Params::info(&parameter.name);
        let description = index.and_then(|index| DESCRIPTIONS.get(index));
        let laws = laws_of(&parameter.name);
        let law = law.map(|law| law as u8);
        let meaning = description.map_or("(unknown to this tool)", |about| about.meaning);
        Self {
            name: parameter.name.clone(),
            value: parameter.value,
            default: info.map(|info| info.default),
            unit: description.map_or("", |description| description.unit),
            range: info.map_or(String::new(), |info| info.range.to_string()),
            meaning: match laws {
                [] => meaning.to_owned(),
                _ if meaning.contains("law") => meaning.to_owned(),
                laws => format!("{meaning}, in {}", named(laws)),
            },
            unused_by_law: law.filter(|law| !laws.is_empty() && !laws.contains(law)),
        }
    }

    /// All of a vehicle's parameters: first the gains of the law in force, last those of others.
    pub fn of_all(parameters: &[Parameter]) -> Vec<Self> {
        let law = parameters.iter().find(|row| row.name == LAW);
        let law = law.map(|row| row.value);
        let mut rows: Vec<Self> = parameters.iter().map(|row| Self::of(row, law)).collect();
        rows.sort_by_key(|row| match (row.unused_by_law, laws_of(&row.name)) {
            _ if row.name == LAW => 0,
            (Some(_), _) => 3,
            (None, []) => 2,
            (None, _) => 1,
        });
        rows
    }

    /// What it belongs to, for a person who looks for it.
    pub fn group(&self) -> String {
        match self.unused_by_law {
            Some(law) => format!("Not used by law {law}"),
            None => place(&self.name).0.to_owned(),
        }
    }

    /// That the law in force does not use it, and which do.
    pub fn note(&self) -> Option<String> {
        let law = self.unused_by_law?;
        let laws = laws_of(&self.name);
        let shown = match SHOWN.contains(&&*self.name) {
            true => ", though the polarity check does",
            false => "",
        };
        Some(format!(
            "{} is not used by law {law} ({LAW}), but by {}{shown}",
            self.name,
            named(laws)
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tvc_nano::controller::Sample;
    use tvc_nano::params::{Range, TABLE};
    use tvc_nano::{Axis, Controller, LawState};

    #[test]
    fn every_parameter_of_the_firmware_is_explained() {
        for info in TABLE {
            let row = Row::of(&Parameter::new(info.name, info.default), Some(2.0));
            assert_eq!(row.default, Some(info.default));
            assert!(!row.meaning.is_empty() && !row.range.is_empty());
            assert!(!row.group().is_empty());
        }
        let of = |name| Row::of(&Parameter::new(name, 1.0), Some(2.0));
        for (name, group) in [
            ("SRV_CENTRE_US", "Servo"),
            ("PID_KI", "Not used by law 2"),
            ("SFC_NEAR", "Control law"),
            ("SRV_PLAY_RAD", "Control law"),
            ("SRV_POLARITY", "Safety"),
            ("MAV_SYSID", "Bus, clock and link"),
        ] {
            assert_eq!(of(name).group(), group, "{name}");
        }
        assert!(of("SFC_NEAR").meaning.ends_with(", in law 2"));
        assert!(of("PID_KD").meaning.ends_with(", in laws 0 and 3"));
        assert!(of("PID_KI").meaning.ends_with("in laws 0 and 3"));
    }

    /// What a control law puts out in a motion that swings, with the rudder's model and trim.
    fn outputs(params: &Params) -> Vec<f32> {
        let controller = Controller::new(params, Axis::Pitch, 1.0);
        let mut state = LawState::at_rest(params);
        let motion = (0..400).map(|tick| {
            let time_s = tick as f32 / 150.0;
            let (sin, cos) = (3.0 * time_s).sin_cos();
            let size = 0.7 * (-0.5 * time_s).exp();
            let sample = Sample {
                angle: (size * cos + 0.02).into(),
                rate: (-3.0 * size * sin).into(),
                rate_age_us: Some(4_000),
                refresh_us: 10_000,
                is_carried: tick % 3 == 0,
            };
            controller.update(&mut state, &sample, None)
        });
        motion.map(f32::from).collect()
    }

    /// A value that differs from the default, near enough that no limit hides the difference.
    fn other(range: Range, default: f32) -> f32 {
        match range {
            Range::Between(low, high) => {
                let step = 0.5 * if default == 0.0 { 1.0_f32.min(high - low) } else { default };
                if default + step <= high { default + step } else { default - step }
            }
            Range::OneOf(values) => *values.iter().find(|value| **value != default).unwrap(),
        }
    }

    /// The table says of every gain what the firmware's own laws do with it. The schedule is not
    /// theirs; a test of the firmware holds it.
    #[test]
    fn a_law_uses_what_the_table_says_and_nothing_else() {
        for law in [0, 2, 3_u8] {
            let mut params = Params::default();
            params.set(LAW, f32::from(law)).unwrap();
            let before = outputs(&params);
            for info in TABLE.iter().filter(|info| !info.name.starts_with("GS")) {
                if laws_of(info.name).is_empty() {
                    continue;
                }
                let mut changed = params.clone();
                changed.set(info.name, other(info.range, info.default)).unwrap();
                let differs = outputs(&changed) != before;
                let says = laws_of(info.name).contains(&law);
                assert_eq!(differs, says, "{} in law {law}", info.name);
            }
        }
    }

    #[test]
    fn gains_of_the_law_in_force_come_first_and_others_last() {
        let params = Params::default();
        let all: Vec<_> =
            params.iter().map(|(info, value)| Parameter::new(info.name, value)).collect();
        let rows = Row::of_all(&all);
        assert_eq!(rows[0].name, LAW);
        assert_eq!(rows[1].name, "PID_TRIM_RAD_S");
        assert_eq!(rows.last().unwrap().unused_by_law, Some(2));
        assert_eq!(rows.len(), all.len());
        let kp = rows.iter().find(|row| row.name == "PID_KP").unwrap();
        let note = kp.note().unwrap();
        assert!(note.contains("not used by law 2 (PID_LAW), but by law 0"), "{note}");
        assert!(note.contains("polarity check"), "{note}");
        // A vehicle without the parameter tells nothing of its laws.
        assert_eq!(Row::of(&Parameter::new("PID_KP", 1.0), None).unused_by_law, None);
    }
}
