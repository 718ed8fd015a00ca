//! What can be said about disturbances of the rig.

use ::rig::disturbance::{Disturbances, SupplySag, ThrustRamp, Vibration};
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

    /// Supply of the servo in V (3 to 7.4, whole at 6) and, if not for the whole flight, from when and
    /// until when after the release, in s: 4.8 or 4.5,0.2,0.6. Speed and stall torque follow it.
    #[arg(long, value_name = "V[,FROM,UNTIL]", allow_negative_numbers = true, value_parser = supply)]
    pub servo_supply: Option<SupplySag>,

    /// Thrust that grows from this share at release, in % (0 to 100), to the whole after so many
    /// seconds (above 0, at most 10): 40,0.5.
    #[arg(long, value_name = "PCT,S", allow_negative_numbers = true, value_parser = thrust_ramp)]
    pub thrust_ramp: Option<ThrustRamp>,
}

impl Disturb {
    /// As the rig takes them.
    pub fn all(&self) -> Disturbances {
        Disturbances {
            vibration: self.vibration,
            supply: self.servo_supply,
            thrust: self.thrust_ramp,
        }
    }
}

/// Numbers between commas.
fn numbers(text: &str) -> Option<Vec<f64>> {
    text.split(',').map(|n| n.trim().parse().ok()).collect()
}

fn vibration(text: &str) -> Result<Vibration, String> {
    let (force_m_s2, frequency_hz, rate) = match numbers(text).as_deref() {
        Some(&[force, hz]) => (force, hz, None),
        Some(&[force, hz, rate]) => (force, hz, Some(rate)),
        _ => return Err("a vibration is m/s2 and Hz, such as 5,180".into()),
    };
    if !(0.0..=40.0).contains(&force_m_s2) {
        return Err("a vibration is 0 to 40 m/s2".into());
    }
    if !(1.0..=Vibration::HIGHEST_HZ).contains(&frequency_hz) {
        return Err(format!("a vibration has 1 to {} Hz", Vibration::HIGHEST_HZ));
    }
    let vibration = Vibration::new(force_m_s2, frequency_hz);
    match rate {
        None => Ok(vibration),
        Some(rate) if (0.0..=500.0).contains(&rate) => Ok(Vibration {
            rate_rad_s: rate.to_radians(),
            ..vibration
        }),
        Some(_) => Err("the angular rate of a vibration is 0 to 500 deg/s".into()),
    }
}

fn supply(text: &str) -> Result<SupplySag, String> {
    let (volts, from_s, until_s) = match numbers(text).as_deref() {
        Some(&[volts]) => (volts, 0.0, f64::INFINITY),
        Some(&[volts, from_s, until_s]) => (volts, from_s, until_s),
        _ => return Err("a supply is V, or V and two times in s, such as 4.5,0.2,0.6".into()),
    };
    if !(3.0..=7.4).contains(&volts) {
        return Err("the supply of a servo is 3 to 7.4 V".into());
    }
    if from_s >= 0.0 && until_s > from_s {
        Ok(SupplySag {
            volts,
            from_s,
            until_s,
        })
    } else {
        Err("a sag begins at 0 s or later and ends after it began".into())
    }
}

fn thrust_ramp(text: &str) -> Result<ThrustRamp, String> {
    let Some(&[percent, seconds]) = numbers(text).as_deref() else {
        return Err("a thrust ramp is % at release and s, such as 40,0.5".into());
    };
    if !(0.0..=100.0).contains(&percent) {
        return Err("the thrust at release is 0 to 100 %".into());
    }
    if !(seconds > 0.0 && seconds <= 10.0) {
        return Err("a thrust ramp takes more than 0 and at most 10 s".into());
    }
    Ok(ThrustRamp {
        from_share: percent / 100.0,
        seconds,
    })
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
        let ramp = thrust_ramp("40,0.5").unwrap();
        assert_eq!((ramp.from_share, ramp.seconds), (0.4, 0.5));
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
        ] {
            assert!(supply(bad).is_err(), "{bad}");
        }
        for bad in ["40", "101,1", "-1,1", "40,0", "40,11", "NaN,1", "40,NaN"] {
            assert!(thrust_ramp(bad).is_err(), "{bad}");
        }
    }
}
