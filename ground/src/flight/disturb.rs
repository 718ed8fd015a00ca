//! Options that disturb a flight on the rig.

use ::rig::disturbance::{Disturbances, SupplySag, Temperature, ThrustRamp, Vibration};
use clap::Args;

/// Disturbances of a flight, off unless they are asked for.
#[derive(Debug, Clone, Copy, PartialEq, Args)]
#[command(next_help_heading = "Disturbances")]
pub struct Disturb {
    /// Unbalanced propeller from the release on: amplitude of the acceleration in m/s2 (0 to 40),
    /// turns in Hz (1 to 400) and, if it is not what a mount that yields over 0.1 m gives,
    /// amplitude of the angular rate in deg/s. 5,180 reaches a sensor that refreshes at 100 Hz as
    /// 20 Hz. With the rate, how many harmonics follow at multiples of the frequency (0 to 4, each
    /// half as strong as the one before) and how far the frequency wanders in % (0 to 20):
    /// 5,120,3,2,4.
    #[arg(
        long,
        value_name = "ACC,HZ[,RATE[,HARMONICS,WANDER]]",
        allow_negative_numbers = true
    )]
    pub vibration: Option<Vibration>,

    /// Supply of the servo in V (3 to 7.4, whole at 6), if not for the whole flight from when and
    /// until when after the release, in s, and what is left of it while the servo stalls, if it is
    /// a weak one: 4.8, 4.5,0.2,0.6 or 6,0,3,4. Speed and stall torque follow it.
    #[arg(long, value_name = "V[,FROM,UNTIL[,V]]", allow_negative_numbers = true)]
    pub servo_supply: Option<SupplySag>,

    /// Thrust that grows from this share at release, in % (0 to 100), to the whole after so many
    /// seconds (above 0, at most 10): 40,0.5.
    #[arg(long, value_name = "PCT,S", allow_negative_numbers = true)]
    pub thrust_ramp: Option<ThrustRamp>,

    /// Temperature of the sensor's chip at power-on and in the end in C (-40 to 85), the time
    /// constant between them in s and, if it is not the typical 0.015, the drift of the gyroscope's
    /// bias in deg/s/K, and of the accelerometer's offset in mg/K: 20,45,60 or 20,45,60,0.03,1.
    #[arg(
        long,
        value_name = "C,C,S[,DPS_K[,MG_K]]",
        allow_negative_numbers = true
    )]
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
