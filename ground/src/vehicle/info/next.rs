//! What to do next, in one sentence.

use anyhow::{Error, anyhow};
use serde::Serialize;
use tvc_nano::failsafe::StateKind;

use super::vehicle::{SERVO, Told};
use super::{Found, PortFound};
use crate::vehicle::port::machine::in_use;
use report::exit::Verdict;

/// How things stand.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Standing {
    /// Nothing is left to do before a release.
    Well,
    /// Something is.
    ToDo,
    /// The vehicle cannot be reached.
    Unreachable,
}

impl Standing {
    /// As an exit status.
    pub fn verdict(self) -> Verdict {
        match self {
            Self::Well => Verdict::Met,
            Self::ToDo => Verdict::Missed,
            Self::Unreachable => Verdict::Unusable,
        }
    }

    /// In words.
    pub fn words(self) -> &'static str {
        match self {
            Self::Well => "all is well",
            Self::ToDo => "to do",
            Self::Unreachable => "the vehicle cannot be reached",
        }
    }
}

/// Why a port is not to be opened.
pub fn obstacle(port: &PortFound) -> Option<Error> {
    let name = &port.name;
    if port.bootloader {
        return Some(anyhow!(
            "the Nano at {name} is in its bootloader: `tvc flash` puts the firmware on it"
        ));
    }
    in_use(name, port.held_by.as_deref()?).map(Error::msg)
}

/// How things stand, and what to do.
pub fn next(found: &Found) -> (Standing, String) {
    match (&found.vehicle, &found.problem) {
        (Some(told), _) => match of_vehicle(told) {
            Some(words) => (Standing::ToDo, words),
            None => {
                (Standing::Well, "`tvc test step` on the tether (docs/guides/tether.md)".into())
            }
        },
        (None, problem) => (Standing::Unreachable, problem.clone().unwrap_or_default()),
    }
}

fn of_vehicle(told: &Told) -> Option<String> {
    let state = &told.state;
    match told.code.map(|code| code.kind()) {
        Some(StateKind::Armed | StateKind::Active) => {
            return Some(format!("it is {state}: `tvc disarm` puts the rudder to neutral"));
        }
        Some(StateKind::Latched | StateKind::Failsafe) => {
            return Some(format!(
                "{state}: look it up in docs/guides/troubleshooting.md, then `tvc disarm`"
            ));
        }
        Some(StateKind::Boot) => {
            return Some(format!("{state}: see docs/guides/troubleshooting.md if it stays so"));
        }
        _ => {}
    }
    if told.runs_image == Some(false) {
        return Some("`tvc flash`: the vehicle runs another build than the image here".into());
    }
    let sensors: Vec<&str> =
        told.uncalibrated.iter().copied().filter(|name| *name != SERVO).collect();
    if !sensors.is_empty() {
        let sensors = sensors.join(", ");
        return Some(format!("`tvc calibrate`: still as out of the box are {sensors}"));
    }
    if told.uncalibrated.contains(&SERVO) {
        return Some("`tvc calibrate servo`: the servo is as out of the box".into());
    }
    if !told.polarity_checked {
        return Some("`tvc calibrate polarity`: nobody has seen the rudder answer a tilt".into());
    }
    told.refusal.as_ref().map(|refusal| format!("arming would be refused: {refusal}"))
}

#[cfg(test)]
mod tests {
    use super::super::Program;
    use super::*;
    use tvc_nano::failsafe::{ReasonKind, StateCode};

    fn told(code: StateCode) -> Told {
        Told {
            state: code.to_string(),
            code: Some(code),
            runs_image: Some(true),
            polarity_checked: true,
            ..Told::default()
        }
    }

    fn advice(told: Told) -> (Standing, String) {
        next(&Found { vehicle: Some(told), ..Found::default() })
    }

    #[test]
    fn the_first_obstacle_is_named_first() {
        let standby = || told(StateCode::Standby);
        assert_eq!(advice(standby()).0, Standing::Well);
        let blank =
            Told { uncalibrated: vec!["mount", "servo"], polarity_checked: false, ..standby() };
        let cases = [
            (told(StateCode::Active), "tvc disarm"),
            (told(StateCode::Failsafe(ReasonKind::Tilt)), "troubleshooting"),
            (
                Told { runs_image: Some(false), uncalibrated: vec!["mount"], ..standby() },
                "`tvc flash`",
            ),
            (blank, "out of the box are mount"),
            (
                Told { uncalibrated: vec!["servo"], polarity_checked: false, ..standby() },
                "`tvc calibrate servo`",
            ),
            (Told { polarity_checked: false, ..standby() }, "polarity"),
            (Told { refusal: Some("tilt beyond 50 deg".into()), ..standby() }, "tilt beyond"),
        ];
        for (told, part) in cases {
            let (standing, words) = advice(told);
            assert_eq!(standing, Standing::ToDo, "{words}");
            assert!(words.contains(part), "{words}");
        }
    }

    #[test]
    fn a_port_in_use_or_a_bootloader_is_not_opened() {
        let port = |bootloader, held_by| PortFound {
            name: "x".into(),
            life: None,
            nano: true,
            bootloader,
            access: None,
            held_by,
        };
        let holder = Program { id: 7, name: "mavproxy.py".into() };
        assert!(obstacle(&port(false, Some(Vec::new()))).is_none());
        assert!(obstacle(&port(false, None)).is_none());
        let said = obstacle(&port(false, Some(vec![holder]))).unwrap().to_string();
        assert!(said.contains("mavproxy.py (process 7)"), "{said}");
        let said = obstacle(&port(true, None)).unwrap().to_string();
        assert!(said.contains("tvc flash"), "{said}");
    }
}
