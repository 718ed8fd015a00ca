//! One run as a file from which it can be carried out again.

use std::path::{Path, PathBuf};

use anyhow::Result;
use rig::Image;
use rig::bench::Hardware;
use rig::faults::{Case, Kind};
use serde::{Deserialize, Serialize};

use super::table::Row;
use super::{Flown, named};
use design::vehicle::VehicleKind;
use report::file::write_whole;

/// All that is needed to carry out a run again, with the image.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scenario {
    #[serde(flatten)]
    flown: Flown,
    /// What fails.
    #[serde(with = "named")]
    kind: Kind,
    /// Number of the run among those of this kind.
    number: u32,
    /// Checksum of the image.
    image: Option<String>,
}

impl Scenario {
    /// A case of what is flown, with this image.
    pub fn new(flown: &Flown, case: Case, image: &Image) -> Self {
        Self {
            flown: flown.clone(),
            kind: case.kind,
            number: case.number,
            image: Some(checksum(image)),
        }
    }

    /// Writes the file, with what became of the run as a comment. No two runs of two campaigns have
    /// files of one name, unless their hardware differs.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write(&self, folder: &Path, row: &Row) -> Result<PathBuf> {
        let Flown { plan, vehicle, servo, phase, seed, .. } = &self.flown;
        let path = folder.join(format!(
            "{plan}-{seed}-{phase}-{}-{}-{}-{}.toml",
            vehicle.name(),
            servo.name(),
            self.kind,
            self.number
        ));
        let text = format!(
            "# {}\n# {}\n# Again, with the same image: cargo lab faults rerun FILE\n\n{}",
            row.story().replace('\n', " "),
            row.why,
            toml::to_string(self)?
        );
        write_whole(&path, text.as_bytes())?;
        Ok(path)
    }

    /// Reads the text of a file.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn parse(text: &str) -> Result<Self, String> {
        let scenario: Self = toml::from_str(text).map_err(|error| error.to_string())?;
        let Self { flown, kind, .. } = &scenario;
        flown.hardware.parse::<Hardware>()?;
        if !VehicleKind::DRONES.contains(&flown.vehicle) {
            return Err(format!("there are no runs of vehicle {}", flown.vehicle.name()));
        }
        if flown.seconds.is_some_and(|seconds| !(1..=600).contains(&seconds)) {
            return Err("seconds must be 1 to 600".into());
        }
        let (plan, phase) = (flown.plan, flown.phase);
        if !plan.kinds(phase).contains(kind) {
            return Err(format!("{kind} is no fault of phase {phase} in the campaign of {plan}"));
        }
        Ok(scenario)
    }

    /// What is flown, and which case of it. An image that is not the campaign's is told.
    pub fn flown(&self, image: &Image) -> (&Flown, Case) {
        let now = checksum(image);
        if let Some(then) = self.image.as_ref().filter(|then| **then != now) {
            eprintln!(
                "note: the image is {now}, that of the campaign was {then}: the run may differ"
            );
        }
        let Self { kind, number, .. } = *self;
        (&self.flown, Case { kind, number })
    }
}

/// Tells images apart.
fn checksum(image: &Image) -> String {
    let crc = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC);
    format!("{:08x}", crc.checksum(image.bytes()))
}
