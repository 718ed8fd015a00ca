//! The sensor that a vehicle at the rig has.

use ::rig::RigConfig;
use ::rig::bench::{Since, TimedFault};
use ::rig::bno055::Fault;

use anyhow::Result;
use clap::Args;
use design::vehicle::store;
use samd21::board::Ticks;
pub use tvc_nano::sensor::Kind;

/// The choice of a sensor.
#[derive(Clone, Copy, Debug, Default, Args)]
pub struct SensorOption {
    /// Sensor: bno055, lsm6ds3 on the Nano's board alone, or both [default: bno055].
    #[arg(long, value_name = "NAME", value_parser = kind)]
    pub sensor: Option<Kind>,
}

impl SensorOption {
    /// Stores the choice in the vehicle, and leaves a BNO055 that is not chosen unplugged.
    ///
    /// # Errors
    /// The sensor cannot be stored.
    pub fn fit(self, rig: &mut RigConfig) -> Result<()> {
        let Some(sensor) = self.sensor else { return Ok(()) };
        let stored = rig.stored.get_or_insert_default();
        store(stored, [("SENSOR", sensor.value())])?;
        if sensor == Kind::Lsm6ds3 {
            rig.bench.faults.push(TimedFault {
                fault: Fault::Unplugged,
                since: Since::PowerOn,
                at: Ticks::ZERO,
                until: Ticks::NEVER,
            });
        }
        Ok(())
    }
}

/// The choice with this name.
///
/// # Errors
/// There is none.
pub fn kind(text: &str) -> Result<Kind, String> {
    let mut all = Kind::ALL.into_iter();
    let found = all.find(|(_, name)| *name == text);
    found.map(|(kind, _)| kind).ok_or_else(|| {
        let names = Kind::ALL.map(|(_, name)| name).join(", ");
        format!("the image has drivers for {names}")
    })
}
