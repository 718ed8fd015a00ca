//! What hangs on the virtual rig: the vehicles that `--vehicle` chooses from.

use rig::bench::TwoAxes;
use rig::flight::Setup;

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

    /// Hangs it on the bench, with the parameters that its image needs stored.
    pub fn hang(self, setup: &mut Setup) -> Result<(), tvc_nano::params::ParamError> {
        if self == Self::Drone2 {
            setup.rig.bench.two_axes = Some(TwoAxes::default());
            let stored = setup.rig.stored.get_or_insert_default();
            stored.set("AXES", 2.0)?;
            stored.set("SRV2_POLARITY", 1.0)?;
        }
        Ok(())
    }
}
