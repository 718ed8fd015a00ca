//! One run as a file from which it can be carried out again.

use std::path::{Path, PathBuf};

use anyhow::Result;
use clap::ValueEnum;
use rig::ServoKind;
use rig::bench::Hardware;
use rig::faults::{Case, Kind, Phase, Plan};
use serde::{Deserialize, Serialize};

use super::Flown;
use super::table::Row;
use ground::flight::vehicle::VehicleKind;
use ground::input;
use report::exit::BadInput;
use report::file::write_whole;

/// All that is needed to carry out a run again, with the image.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scenario {
    /// Seed of the campaign.
    pub seed: u64,
    /// What the campaign tries.
    pub campaign: String,
    /// The vehicle, by its name on the command line.
    pub vehicle: String,
    /// Its servo, likewise.
    pub servo: String,
    /// What the emulated parts are like, as `--hardware` takes it.
    pub hardware: String,
    /// What the vehicle does when the fault begins.
    pub phase: String,
    /// What fails.
    pub kind: String,
    /// Number of the run among those of this kind.
    pub number: u32,
    /// Length of a run of a sound vehicle, s.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seconds: Option<u16>,
}

impl Scenario {
    /// A run of a campaign with such hardware.
    pub fn new(hardware: String, row: &Row) -> Self {
        Self {
            seed: row.seed,
            campaign: row.campaign.clone(),
            vehicle: row.vehicle.clone(),
            servo: row.servo.clone(),
            hardware,
            phase: row.phase.clone(),
            kind: row.kind.clone(),
            number: row.number,
            seconds: (row.campaign == Plan::Sound.name()).then_some(row.lasted_s as u16),
        }
    }

    /// Writes the file, with what became of the run as a comment.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write(&self, folder: &Path, place: usize, row: &Row) -> Result<PathBuf> {
        let path = folder.join(format!("unsafe-{place}.toml"));
        let text = format!(
            "# {}\n# {}\n# Again, with the same image: lab faults replay FILE\n\n{}",
            row.story().replace('\n', " "),
            row.why,
            toml::to_string(self)?
        );
        write_whole(&path, text.as_bytes())?;
        Ok(path)
    }

    /// Reads a file.
    ///
    /// # Errors
    /// It cannot be read, or does not say what a run needs.
    pub fn read(path: &Path) -> Result<(Flown, Case), BadInput> {
        let text = input::text(path).map_err(|error| error.to_string());
        let read = text.and_then(|text| Self::parse(&text));
        read.map_err(|error| BadInput::new(format!("{}: {error}", path.display())))
    }

    /// Reads the text of a file.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn parse(text: &str) -> Result<(Flown, Case), String> {
        let scenario: Self = toml::from_str(text).map_err(|error| error.to_string())?;
        let kind: Kind = scenario.kind.parse()?;
        scenario.hardware.parse::<Hardware>()?;
        let vehicle = VehicleKind::DRONES
            .into_iter()
            .find(|vehicle| vehicle.name() == scenario.vehicle)
            .ok_or_else(|| format!("there is no vehicle {}", scenario.vehicle))?;
        let servo = ServoKind::from_str(&scenario.servo, false)
            .map_err(|_| format!("there is no servo {}", scenario.servo))?;
        let plan: Plan = scenario.campaign.parse()?;
        let phase: Phase = scenario.phase.parse()?;
        if scenario
            .seconds
            .is_some_and(|seconds| !(1..=600).contains(&seconds))
        {
            return Err("seconds must be 1 to 600".into());
        }
        if !plan.kinds(phase).contains(&kind) {
            return Err(format!(
                "{kind} is no fault of phase {phase} in the campaign of {plan}"
            ));
        }
        let flown = Flown {
            plan,
            vehicle,
            servo,
            phase,
            hardware: scenario.hardware,
            seed: scenario.seed,
            seconds: scenario.seconds.filter(|_| plan == Plan::Sound),
        };
        let number = scenario.number;
        Ok((flown, Case { kind, number }))
    }
}
