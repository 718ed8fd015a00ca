//! A scenario of a flight from a file: faults by time, and what disturbs all of it.
//!
//! ```toml
//! [[fault]]
//! kind = "spikes"       # as in `lab faults`
//! since = "release"     # or "power-on"
//! at_s = 0.30           # after that
//! for_s = 0.05          # for ever if left out
//! probability = 0.01    # drawn from the seed if left out; stretch_ms and clocks likewise
//!
//! [vibration]           # each of these tables as the option of its name
//! acc_m_s2 = 5
//! frequency_hz = 180
//! ```

use std::path::Path;

use rig::bench::{FaultEntry, TimedFault};
use rig::disturbance::{Disturbances, SupplySag, Temperature, ThrustRamp, Vibration};
use rig::random::{Stream, generator};
use serde::Deserialize;

use report::exit::BadInput;
use report::input;

/// What happens in a flight.
#[derive(Clone, Debug, Default)]
pub struct Scenario {
    /// The faults as the figures report them.
    pub entries: Vec<FaultEntry>,
    /// The same as the rig takes them.
    pub faults: Vec<TimedFault>,
    /// What disturbs all of the flight.
    pub disturbances: Disturbances,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    #[serde(default)]
    fault: Vec<FaultEntry>,
    vibration: Option<Vibration>,
    servo_supply: Option<SupplySag>,
    thrust_ramp: Option<ThrustRamp>,
    temperature: Option<Temperature>,
}

/// Reads the file, if there is one, for flights of `length_s`. How hard a fault strikes is drawn
/// from `seed` where the file leaves it open.
///
/// # Errors
/// The file cannot be read, is not of this form, or has a value out of its range.
pub fn read(path: Option<&Path>, seed: u64, length_s: f64) -> Result<Scenario, BadInput> {
    let Some(path) = path else {
        return Ok(Scenario::default());
    };
    let text = input::file_text(path)?;
    parse(&text, seed, length_s).map_err(|why| BadInput::of(path, why))
}

/// As [`read`], of the text of a file.
///
/// # Errors
/// What is wrong with it.
pub fn parse(text: &str, seed: u64, length_s: f64) -> Result<Scenario, String> {
    let file: File = toml::from_str(text).map_err(|error| error.to_string())?;
    let disturbances = Disturbances {
        vibration: file.vibration,
        servo_supply: file.servo_supply,
        thrust_ramp: file.thrust_ramp,
        temperature: file.temperature,
    };
    disturbances.check()?;
    let mut dice = generator(seed, Stream::Campaign);
    let mut entries = file.fault;
    let faults = entries.iter_mut().map(|entry| entry.draw(length_s, &mut dice));
    Ok(Scenario { faults: faults.collect::<Result<_, _>>()?, entries, disturbances })
}

#[cfg(test)]
mod tests {
    use super::*;
    use rig::Ticks;
    use rig::bench::Since;
    use rig::bno055::{Fault, FaultKind};

    fn parsed(text: &str) -> Result<Scenario, String> {
        parse(text, 1, 3.0)
    }

    fn fault(rest: &str) -> Result<Scenario, String> {
        parsed(&format!("[[fault]]\nat_s = 0.1\nfor_s = 0.5\n{rest}"))
    }

    /// Every kind can be named; those with a strength take it, and the figures tell what was drawn.
    #[test]
    fn each_fault_has_its_strength() {
        for kind in FaultKind::ALL {
            let drawn = fault(&format!("kind = \"{kind}\"")).unwrap();
            let mut same = kind.draw(&mut generator(1, Stream::Campaign));
            assert_eq!(drawn.faults[0].fault, same, "left to the seed");
            let told = drawn.entries[0].probability;
            assert_eq!(told, same.probability_mut().copied(), "{kind}");

            let given = fault(&format!("kind = \"{kind}\"\nprobability = 0.25"));
            match told {
                Some(_) => {
                    let share = given.unwrap().faults[0].fault.probability_mut().copied();
                    assert_eq!(share, Some(0.25), "{kind}");
                }
                None => assert_eq!(given.unwrap_err(), format!("fault {kind} has no probability")),
            }
        }
        let stretched = "kind = \"long-stretch\"\nstretch_ms = 3\nprobability = 1";
        assert_eq!(
            fault(stretched).unwrap().faults[0].fault,
            Fault::LongStretch { stretch: Ticks::from_ms(3), probability: 1.0 }
        );
        let held = fault("kind = \"sda-held\"\nclocks = 4").unwrap();
        assert_eq!(held.faults[0].fault, Fault::SdaHeld { clocks: 4 });
    }

    #[test]
    fn a_fault_may_come_with_the_power_and_stay() {
        let text = "[[fault]]\nkind = \"unplugged\"\nsince = \"power-on\"\nat_s = 20\n";
        let faults = parsed(text).map(|scenario| scenario.faults);
        let error = faults.unwrap_err();
        assert!(error.contains("at_s must be 0 to below 3"), "{error}");
        let fault = parsed(&text.replace("20", "0")).unwrap().faults[0];
        assert_eq!((fault.since, fault.until), (Since::PowerOn, Ticks::NEVER));
        let error = parsed(&text.replace("power-on", "noon")).unwrap_err();
        assert!(error.contains("`release`"), "{error}");
    }

    #[test]
    fn a_scenario_disturbs_as_the_options_do() {
        let all = "[vibration]\nacc_m_s2 = 5\nfrequency_hz = 180\n\
                   [servo_supply]\nvolts = 4.8\n\
                   [thrust_ramp]\nfrom_pct = 40\nseconds = 0.5\n\
                   [temperature]\nfrom_c = 20\nto_c = 45\ntime_constant_s = 60\n";
        let disturbances = parsed(all).unwrap().disturbances;
        assert_eq!(disturbances.servo_supply.unwrap().volts, 4.8);
        assert_eq!(disturbances.thrust_ramp.unwrap().from_pct, 40.0);
        let vibration = disturbances.report().unwrap().vibration.unwrap();
        assert!((vibration.rate_dps.unwrap() - 2.53).abs() < 0.01);
        let temperature = disturbances.temperature.unwrap();
        assert_eq!(temperature.gyro_dps_k, 0.015);
        for (text, word) in [
            ("[vibration]\nacc_m_s2 = 5\nfrequency_hz = 900", "Hz"),
            ("[servo_supply]\nvolts = 12", "3 to 7.4 V"),
            ("[thrust_ramp]\nfrom_pct = 40\nseconds = 0", "thrust ramp"),
            ("[temperature]\nfrom_c = 20\nto_c = 145\ntime_constant_s = 1", "85 C"),
            ("[wind]\nm_s = 3", "unknown field"),
        ] {
            let error = parsed(text).unwrap_err();
            assert!(error.contains(word), "{text}: {error}");
        }
    }
}
