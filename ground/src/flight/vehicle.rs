//! What hangs on the virtual rig: the vehicles that `--vehicle` chooses from.

use anyhow::{Result, anyhow};
use rig::RigConfig;
use rig::bench::{TwoAxes, VehicleConfig};
use rig::rocket::{self, Airframe, RocketLaw};
use tvc_nano::Params;

/// A vehicle on the rig.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum VehicleKind {
    /// The tethered drone: it pitches, and has one rudder.
    #[default]
    Drone,
    /// The same in a joint, with two rudders: it pitches, rolls and spins.
    Drone2,
    /// A rocket through its burn: it stands on its pad, and its gimbal is steered about two axes.
    Rocket,
}

impl VehicleKind {
    /// Those that fly from a clamp.
    pub const DRONES: [Self; 2] = [Self::Drone, Self::Drone2];

    /// Its name on the command line and in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Drone => "drone",
            Self::Drone2 => "drone2",
            Self::Rocket => "rocket",
        }
    }

    /// Hangs it on the bench. Where parameters are stored, those that its image needs are, too.
    ///
    /// # Errors
    /// None: the parameters are in the firmware's table, and in range.
    pub fn hang(self, rig: &mut RigConfig) -> Result<()> {
        let parameters = match self {
            Self::Drone => Vec::new(),
            Self::Drone2 => {
                rig.bench.vehicle = VehicleConfig::TwoAxes(TwoAxes::default());
                // A Nano fresh from its box knows of one axis only.
                vec![("AXES".to_owned(), 2.0), ("SRV2_POLARITY".to_owned(), 1.0)]
            }
            Self::Rocket => {
                let rocket = Airframe::Stable.on_pad(rig.seed);
                rig.bench.vehicle = VehicleConfig::Rocket(Box::new(rocket));
                rocket::parameters(Airframe::Stable, RocketLaw::Scheduled)
            }
        };
        rig.stored.as_mut().map_or(Ok(()), |stored| store(stored, &parameters))
    }
}

/// Puts parameters among the stored ones.
///
/// # Errors
/// One that is not in the firmware's table, or out of its range.
pub fn store(stored: &mut Params, parameters: &[(String, f32)]) -> Result<()> {
    for (name, value) in parameters {
        stored.set(name, *value).map_err(|error| anyhow!("{error}"))?;
    }
    Ok(())
}
