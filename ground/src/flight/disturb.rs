//! Options that disturb a flight on the rig.

use crate::flight::fly::disturbance::{
    RampEntry, SupplyEntry, TemperatureEntry, VibrationEntry, typical_gyro_dps_k,
};
use ::rig::disturbance::{Disturbances, SupplySag, Temperature, ThrustRamp, Vibration};
use clap::Args;

/// Disturbances of a flight, off unless they are asked for.
#[derive(Debug, Clone, Copy, PartialEq, Args)]
#[command(next_help_heading = "Disturbances")]
pub struct Disturb {
    /// Unbalanced propeller from the release on: amplitude of the acceleration in m/s2 (0 to 40), turns
    /// in Hz (1 to 400) and, if it is not what a mount that yields over 0.1 m gives, amplitude of the
    /// angular rate in deg/s. 5,180 reaches a sensor that refreshes at 100 Hz as 20 Hz.
    #[arg(long, value_name = "ACC,HZ[,RATE]", allow_negative_numbers = true, value_parser = vibration)]
    pub vibration: Option<Vibration>,

    /// Supply of the servo in V (3 to 7.4, whole at 6), if not for the whole flight from when and until
    /// when after the release, in s, and what is left of it while the servo stalls, if it is a weak one: 4.8,
    /// 4.5,0.2,0.6 or 6,0,3,4. Speed and stall torque follow it.
    #[arg(long, value_name = "V[,FROM,UNTIL[,V]]", allow_negative_numbers = true, value_parser = supply)]
    pub servo_supply: Option<SupplySag>,

    /// Thrust that grows from this share at release, in % (0 to 100), to the whole after so many
    /// seconds (above 0, at most 10): 40,0.5.
    #[arg(long, value_name = "PCT,S", allow_negative_numbers = true, value_parser = thrust_ramp)]
    pub thrust_ramp: Option<ThrustRamp>,

    /// Temperature of the sensor's chip at power-on and in the end in C (-40 to 85), the time constant
    /// between them in s and, if it is not the typical 0.015, the drift of the gyroscope's bias in
    /// deg/s/K: 20,45,60 or 20,45,60,0.03.
    #[arg(long, value_name = "C,C,S[,DPS_K]", allow_negative_numbers = true, value_parser = temperature)]
    pub temperature: Option<Temperature>,
}

impl Disturb {
    /// As the rig takes them, those of a scenario where there is no option.
    pub fn over(&self, scenario: Disturbances) -> Disturbances {
        Disturbances {
            vibration: self.vibration.or(scenario.vibration),
            supply: self.servo_supply.or(scenario.supply),
            thrust: self.thrust_ramp.or(scenario.thrust),
            temperature: self.temperature.or(scenario.temperature),
        }
    }
}

/// Numbers between commas.
fn numbers(text: &str) -> Option<Vec<f64>> {
    text.split(',').map(|n| n.trim().parse().ok()).collect()
}

fn vibration(text: &str) -> Result<Vibration, String> {
    let (acc_m_s2, frequency_hz, rate_dps) = match numbers(text).as_deref() {
        Some(&[force, hz]) => (force, hz, None),
        Some(&[force, hz, rate]) => (force, hz, Some(rate)),
        _ => return Err("a vibration is m/s2 and Hz, such as 5,180".into()),
    };
    let entry = VibrationEntry {
        acc_m_s2,
        rate_dps,
        frequency_hz,
    };
    entry.try_into()
}

fn supply(text: &str) -> Result<SupplySag, String> {
    let (volts, from_s, until_s, stall_volts) = match numbers(text).as_deref() {
        Some(&[volts]) => (volts, 0.0, None, None),
        Some(&[volts, from, until]) => (volts, from, Some(until), None),
        Some(&[volts, from, until, stall]) => (volts, from, Some(until), Some(stall)),
        _ => return Err("a supply is V, or V and two times in s, such as 4.5,0.2,0.6".into()),
    };
    let entry = SupplyEntry {
        volts,
        stall_volts,
        from_s,
        until_s,
    };
    entry.try_into()
}

fn thrust_ramp(text: &str) -> Result<ThrustRamp, String> {
    let Some(&[from_pct, seconds]) = numbers(text).as_deref() else {
        return Err("a thrust ramp is % at release and s, such as 40,0.5".into());
    };
    RampEntry { from_pct, seconds }.try_into()
}

fn temperature(text: &str) -> Result<Temperature, String> {
    let (from_c, to_c, time_constant_s, gyro_dps_k) = match numbers(text).as_deref() {
        Some(&[from, to, seconds]) => (from, to, seconds, typical_gyro_dps_k()),
        Some(&[from, to, seconds, drift]) => (from, to, seconds, drift),
        _ => return Err("a temperature is two in C and a time in s, such as 20,45,60".into()),
    };
    let entry = TemperatureEntry {
        from_c,
        to_c,
        time_constant_s,
        gyro_dps_k,
        acc_mg_k: 0.0,
    };
    entry.try_into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn disturbances_have_units_and_ranges() {
        let shaking = vibration("5, 180").unwrap();
        assert_eq!(shaking, Vibration::new(5.0, 180.0));
        let rate = vibration("5,180,10").unwrap().rate_rad_s;
        assert!((rate.to_degrees() - 10.0).abs() < 1e-9);
        assert_eq!(supply("4.8").unwrap().until_s, f64::INFINITY);
        let sag = supply("4.5,0.2,0.6").unwrap();
        assert_eq!((sag.volts, sag.from_s, sag.until_s), (4.5, 0.2, 0.6));
        assert_eq!(sag.stall_volts, 4.5);
        assert_eq!(supply("6,0,3,4").unwrap().stall_volts, 4.0);
        let ramp = thrust_ramp("40,0.5").unwrap();
        assert_eq!((ramp.from_share, ramp.seconds), (0.4, 0.5));
        let warm = temperature("20,45,60").unwrap();
        assert_eq!((warm.warm_up.from_c, warm.warm_up.to_c), (20.0, 45.0));
        assert!((warm.gyro_rad_s_k.to_degrees() - 0.015).abs() < 1e-12);
        let drift = temperature("20,45,60,-0.03").unwrap().gyro_rad_s_k;
        assert!((drift.to_degrees() + 0.03).abs() < 1e-12);
        for bad in ["20,45", "20,200,60", "20,45,0", "20,45,60,NaN", "NaN,45,60"] {
            assert!(temperature(bad).is_err(), "{bad}");
        }
        for bad in ["5", "5,0", "5,500", "-1,180", "5,NaN", "5,180,-1", "a,b"] {
            assert!(vibration(bad).is_err(), "{bad}");
        }
        for bad in [
            "2",
            "9",
            "NaN",
            "4.5,0.2",
            "4.5,0.6,0.2",
            "4.5,-1,2",
            "4.5,0,NaN",
            "4.5,0,1,5",
            "4.5,0,1,0.5",
            "4.5,0,1,NaN",
        ] {
            assert!(supply(bad).is_err(), "{bad}");
        }
        for bad in ["40", "101,1", "-1,1", "40,0", "40,11", "NaN,1", "40,NaN"] {
            assert!(thrust_ramp(bad).is_err(), "{bad}");
        }
    }
}
