//! Options that disturb a flight on the rig.

use ::rig::disturbance::{Disturbances, SupplySag, Temperature, ThrustRamp, Vibration};
use clap::Args;

/// Disturbances of a flight, off unless they are asked for.
#[derive(Debug, Clone, Copy, PartialEq, Args)]
#[command(next_help_heading = "Disturbances (docs/reference/faults.md has ranges and examples)")]
pub struct Disturb {
    /// Unbalanced propeller: m/s2, Hz[, deg/s[, harmonics, wander in %]].
    #[arg(long, value_name = "ACC,HZ,...", allow_negative_numbers = true)]
    pub vibration: Option<Vibration>,

    /// Servo supply, V (nominal 6)[, from, until, s[, V while it stalls]].
    #[arg(long, value_name = "V,...", allow_negative_numbers = true)]
    pub servo_supply: Option<SupplySag>,

    /// Thrust at the release, %, and the time until it is whole, s.
    #[arg(long, value_name = "PCT,S", allow_negative_numbers = true)]
    pub thrust_ramp: Option<ThrustRamp>,

    /// Sensor at power-on and in the end, C; time constant, s[, drift].
    #[arg(long, value_name = "C,C,S,...", allow_negative_numbers = true)]
    pub temperature: Option<Temperature>,
}

impl Disturb {
    /// As the rig takes them, those of a scenario where there is no option.
    pub fn over(&self, scenario: Disturbances) -> Disturbances {
        Disturbances {
            vibration: self.vibration.or(scenario.vibration),
            servo_supply: self.servo_supply.or(scenario.servo_supply),
            thrust_ramp: self.thrust_ramp.or(scenario.thrust_ramp),
            temperature: self.temperature.or(scenario.temperature),
        }
    }
}
