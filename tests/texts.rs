//! docs/guides/troubleshooting.md and docs/reference/texts.md have every text that the vehicle can
//! say: as literal texts, up to the number or address that differs from case to case.

use tvc_imu::SensorFault;
use tvc_nano::failsafe::{Command, RefusalKind, StateCode, StateKind};
use tvc_nano::params::ParamError;
use tvc_nano::servo::PulseUs;
use tvc_nano::store::{Loaded, SaveError};
use tvc_nano::{Axis, Params};

const PAGES: [&str; 2] =
    [include_str!("../docs/guides/troubleshooting.md"), include_str!("../docs/reference/texts.md")];

fn assert_described(text: impl ToString) {
    let text = text.to_string();
    let fixed = text.split("0x").next().unwrap().trim_end();
    assert!(
        PAGES.iter().any(|page| page.contains(fixed)),
        "docs/reference/texts.md lacks `{fixed}`"
    );
}

#[test]
fn states_and_reasons_are_described() {
    for code in StateCode::all() {
        let words = code.to_string();
        assert_described(words.rsplit(": ").next().unwrap());
    }
    assert_eq!(StateCode::COUNT, StateCode::all().count());
}

#[test]
fn refusals_are_described() {
    for refusal in RefusalKind::ALL {
        assert_described(refusal);
    }
    for state in StateCode::all().map(|code| code.kind()) {
        assert_described(format!("`in {state}`"));
    }
    assert_described(format!("`in {}`", StateKind::Latched));
    for command in [
        Command::Arm,
        Command::Release,
        Command::Disarm,
        Command::TestPulse(Axis::Pitch, PulseUs(1500)),
    ] {
        assert_described(format!("`{command}`"));
    }
}

/// The fault that comes after `fault` in the list of all, and none after the last. A fault that is
/// new does not compile here before it has a place.
fn after(fault: SensorFault) -> Option<SensorFault> {
    use SensorFault::*;
    Some(match fault {
        Booting => Nak,
        Nak => Timeout,
        Timeout => Stuck,
        Stuck => Arbitration,
        Arbitration => Protocol,
        Protocol => WrongChip { found: 1 },
        WrongChip { .. } => dead(1),
        DeadSensor { sensor: 1, .. } => dead(2),
        DeadSensor { sensor: 2, .. } => dead(3),
        DeadSensor { .. } => SelfTest { result: 1 },
        SelfTest { .. } => System { error: 1 },
        System { .. } => configuration(7),
        Configuration { register: 7, .. } => configuration(0x41),
        Configuration { .. } => Profile { register: 1 },
        Profile { .. } => Clock,
        Clock => Reset,
        Reset => AllZero,
        AllZero => AllOnes,
        AllOnes => Frozen,
        Frozen => Implausible,
        Implausible => Torn,
        Torn => Late,
        Late => Suspended,
        Suspended => Unreliable,
        Unreliable => RegisterMismatch,
        RegisterMismatch => Disagreement,
        Disagreement => return None,
    })
}

fn dead(sensor: u8) -> SensorFault {
    SensorFault::DeadSensor { sensor, found: 1 }
}

fn configuration(register: u8) -> SensorFault {
    SensorFault::Configuration { register, found: 1 }
}

#[test]
fn faults_of_the_sensor_are_described() {
    let all = std::iter::successors(Some(SensorFault::Booting), |fault| after(*fault));
    let mut count = 0;
    for fault in all {
        count += 1;
        assert_described(fault);
    }
    assert!(count > 25, "{count}");
}

#[test]
fn what_is_said_of_parameters_is_described() {
    let (info, _) = Params::default().by_index(0).unwrap();
    assert_eq!(info.name, "PID_KP");
    let said = ParamError::OutOfRange(info).to_string();
    assert_described(said.split(" 0").next().unwrap());
    for error in [
        ParamError::Unknown,
        ParamError::Armed { name: "SRV_DIR" },
        ParamError::ArmedAll,
        ParamError::OldLaw,
        ParamError::Unseen { name: "SRV_POLARITY" },
    ] {
        assert_described(error);
    }
    let set = |unusable, interrupted| Loaded::Set { generation: 1, unusable, interrupted };
    for loaded in [Loaded::Nothing, Loaded::Corrupt, set(0, true), set(1, false)] {
        assert_described(loaded);
    }
    for error in [SaveError::Flash, SaveError::ReadBack] {
        assert_described(format!("save failed: {error}"));
    }
}

/// Whatever telemetry says in words of its own, by its source.
#[test]
fn texts_of_telemetry_are_described() {
    let sources = [
        include_str!("../src/telemetry.rs"),
        include_str!("../src/telemetry/answers.rs"),
        include_str!("../src/telemetry/commands.rs"),
        include_str!("../src/telemetry/modes.rs"),
        include_str!("../src/telemetry/storage.rs"),
    ];
    let mut found = 0;
    for source in sources {
        for rest in source.split("format_args!(\"").skip(1) {
            let text = rest.split('"').next().unwrap();
            // Between what differs from case to case.
            for fixed in text.split(['{', '}']).step_by(2) {
                let fixed = fixed.trim();
                if !fixed.is_empty() {
                    found += 1;
                    assert_described(fixed);
                }
            }
        }
    }
    assert!(found >= 7, "{found}");
}
