//! A scenario of a flight from a file: faults by time, and what disturbs all of it.
//!
//! ```toml
//! [[fault]]
//! kind = "spikes"       # as in `tvc faults`
//! at_s = 0.30           # after the release
//! for_s = 0.05
//! probability = 0.01    # drawn from the seed if left out; stretch_ms and clocks likewise
//!
//! [vibration]           # each of these tables as the option of its name
//! acc_m_s2 = 5
//! frequency_hz = 180
//! ```

use std::path::Path;

use rig::Ticks;
use rig::bench::TimedFault;
use rig::bno055::Fault;
use rig::bno055::FaultKind;
use rig::disturbance::Disturbances;
use rig::random::{Stream, generator};
use serde::{Deserialize, Serialize};

use super::disturbance::{RampEntry, SupplyEntry, TemperatureEntry, VibrationEntry};
use crate::out::exit::BadInput;

/// One fault of the file; also what the figures tell.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct FaultEntry {
    /// Name of its kind.
    pub kind: String,
    /// When it begins, s after the release.
    pub at_s: f64,
    /// How long it lasts, s.
    pub for_s: f64,
    /// Share of words or bytes that it strikes, for the kinds that strike some only.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub probability: Option<f64>,
    /// How long a byte is stretched, ms, for `long-stretch`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stretch_ms: Option<f64>,
    /// Clocks until the line is free, for `sda-held`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub clocks: Option<u8>,
}

/// What happens in a flight.
#[derive(Clone, Debug, Default)]
pub struct Scenario {
    /// The faults as the figures tell them.
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
    vibration: Option<VibrationEntry>,
    servo_supply: Option<SupplyEntry>,
    thrust_ramp: Option<RampEntry>,
    temperature: Option<TemperatureEntry>,
}

/// Reads the file for flights of `length_s` and draws from `seed` how hard each fault strikes that does not say it.
///
/// # Errors
/// The file cannot be read, is not of this form, or has a value out of its range.
pub fn read(path: &Path, seed: u64, length_s: f64) -> Result<Scenario, BadInput> {
    let refuse = |why: String| BadInput::new(format!("{}: {why}", path.display()));
    let text = std::fs::read_to_string(path).map_err(|error| refuse(error.to_string()))?;
    let file: File = toml::from_str(&text).map_err(|error| refuse(error.to_string()))?;
    scenario(file, seed, length_s).map_err(refuse)
}

fn scenario(file: File, seed: u64, length_s: f64) -> Result<Scenario, String> {
    let disturbances = Disturbances {
        vibration: file.vibration.map(TryInto::try_into).transpose()?,
        supply: file.servo_supply.map(TryInto::try_into).transpose()?,
        thrust: file.thrust_ramp.map(TryInto::try_into).transpose()?,
        temperature: file.temperature.map(TryInto::try_into).transpose()?,
    };
    let mut dice = generator(seed, Stream::Campaign);
    let mut entries = file.fault;
    let faults = entries
        .iter_mut()
        .map(|entry| {
            let kind: FaultKind = entry.kind.parse()?;
            if !(0.0..length_s).contains(&entry.at_s) {
                return Err(format!("at_s must be 0 to below {length_s}"));
            }
            if !(entry.for_s > 0.0 && entry.for_s <= 3600.0) {
                return Err("for_s must be above 0 and at most 3600".into());
            }
            let mut fault = kind.draw(&mut dice);
            entry.strengthen(&mut fault)?;
            Ok(TimedFault {
                fault,
                at: Ticks::from_secs_f64(entry.at_s),
                until: Ticks::from_secs_f64(entry.at_s + entry.for_s),
            })
        })
        .collect::<Result<_, String>>()?;
    Ok(Scenario {
        entries,
        faults,
        disturbances,
    })
}

impl FaultEntry {
    /// Makes the fault as strong as the entry says, and notes in the entry what it leaves to the seed.
    fn strengthen(&mut self, fault: &mut Fault) -> Result<(), String> {
        let kind = &self.kind;
        let none = |what: &str| Err(format!("fault {kind} has no {what}"));
        match (&mut self.probability, fault.probability_mut()) {
            (Some(wanted), Some(share)) if (0.0..=1.0).contains(wanted) => *share = *wanted,
            (Some(_), Some(_)) => return Err("probability must be 0 to 1".into()),
            (Some(_), None) => return none("probability"),
            (told, share) => *told = share.copied(),
        }
        match (&mut self.stretch_ms, &mut *fault) {
            (Some(ms), Fault::LongStretch { stretch, .. }) if (0.0..=1000.0).contains(ms) => {
                *stretch = Ticks::from_secs_f64(*ms * 1e-3);
            }
            (Some(_), Fault::LongStretch { .. }) => {
                return Err("stretch_ms must be 0 to 1000".into());
            }
            (Some(_), _) => return none("stretch_ms"),
            (told, Fault::LongStretch { stretch, .. }) => *told = Some(stretch.as_us_f64() * 1e-3),
            (None, _) => {}
        }
        match (&mut self.clocks, fault) {
            (Some(wanted), Fault::SdaHeld { clocks }) if (1..=9).contains(wanted) => {
                *clocks = *wanted;
            }
            (Some(_), Fault::SdaHeld { .. }) => return Err("clocks must be 1 to 9".into()),
            (Some(_), _) => return none("clocks"),
            (told, Fault::SdaHeld { clocks }) => *told = Some(*clocks),
            (None, _) => {}
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed(text: &str) -> Result<Scenario, String> {
        let file = toml::from_str(text).map_err(|error| error.to_string())?;
        scenario(file, 1, 3.0)
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
                None => assert_eq!(
                    given.unwrap_err(),
                    format!("fault {kind} has no probability")
                ),
            }
        }
        let stretched = "kind = \"long-stretch\"\nstretch_ms = 3\nprobability = 1";
        assert_eq!(
            fault(stretched).unwrap().faults[0].fault,
            Fault::LongStretch {
                stretch: Ticks::from_ms(3),
                probability: 1.0
            }
        );
        let held = fault("kind = \"sda-held\"\nclocks = 4").unwrap();
        assert_eq!(held.faults[0].fault, Fault::SdaHeld { clocks: 4 });
    }

    #[test]
    fn strengths_out_of_range_or_place_are_named() {
        for (entry, word) in [
            ("kind = \"spikes\"\nprobability = 1.5", "probability"),
            ("kind = \"spikes\"\nclocks = 3", "spikes has no clocks"),
            ("kind = \"frozen\"\nstretch_ms = 3", "no stretch_ms"),
            ("kind = \"long-stretch\"\nstretch_ms = -1", "stretch_ms"),
            ("kind = \"sda-held\"\nclocks = 10", "clocks"),
            ("kind = \"spikes\"\nstrength = 1", "unknown field"),
        ] {
            let error = fault(entry).unwrap_err();
            assert!(error.contains(word), "{entry}: {error}");
        }
    }

    #[test]
    fn a_scenario_disturbs_as_the_options_do() {
        let all = "[vibration]\nacc_m_s2 = 5\nfrequency_hz = 180\n\
                   [servo_supply]\nvolts = 4.8\n\
                   [thrust_ramp]\nfrom_pct = 40\nseconds = 0.5\n\
                   [temperature]\nfrom_c = 20\nto_c = 45\ntime_constant_s = 60\n";
        let disturbances = parsed(all).unwrap().disturbances;
        assert_eq!(disturbances.supply.unwrap().volts, 4.8);
        assert_eq!(disturbances.thrust.unwrap().from_share, 0.4);
        let vibration = disturbances.vibration.unwrap();
        assert!((vibration.rate_rad_s.to_degrees() - 2.53).abs() < 0.01);
        let temperature = disturbances.temperature.unwrap();
        assert!((temperature.gyro_rad_s_k.to_degrees() - 0.015).abs() < 1e-12);
        for (text, word) in [
            ("[vibration]\nacc_m_s2 = 5\nfrequency_hz = 900", "Hz"),
            ("[servo_supply]\nvolts = 12", "3 to 7.4 V"),
            ("[thrust_ramp]\nfrom_pct = 40\nseconds = 0", "thrust ramp"),
            (
                "[temperature]\nfrom_c = 20\nto_c = 145\ntime_constant_s = 1",
                "85 C",
            ),
            ("[wind]\nm_s = 3", "unknown field"),
        ] {
            let error = parsed(text).unwrap_err();
            assert!(error.contains(word), "{text}: {error}");
        }
    }
}
