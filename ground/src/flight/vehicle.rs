//! What hangs on the virtual rig: the vehicles that `--vehicle` chooses from.

use anyhow::{Result, anyhow};
use rig::RigConfig;
use rig::bench::TwoAxes;

/// A vehicle on the rig.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum VehicleKind {
    /// The tethered drone: it pitches, and has one rudder.
    #[default]
    Drone,
    /// The same in a joint, with two rudders: it pitches, rolls and spins.
    Drone2,
}

impl VehicleKind {
    /// Its name on the command line and in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Drone => "drone",
            Self::Drone2 => "drone2",
        }
    }

    /// Hangs it on the bench. Where parameters are stored, those that its image needs are, too.
    ///
    /// # Errors
    /// None: the parameters are in the firmware's table, and in range.
    pub fn hang(self, rig: &mut RigConfig) -> Result<()> {
        if self == Self::Drone2 {
            rig.bench.two_axes = Some(TwoAxes::default());
            // A Nano fresh from its box knows of one axis only.
            for (name, value) in [("AXES", 2.0), ("SRV2_POLARITY", 1.0)] {
                if let Some(stored) = &mut rig.stored {
                    let set = stored.set(name, value);
                    set.map_err(|error| anyhow!("{error}"))?;
                }
            }
        }
        Ok(())
    }
}
