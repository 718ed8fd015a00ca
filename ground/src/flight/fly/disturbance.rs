//! What disturbs the flights: as a scenario file says it, as the rig takes it, and as the figures tell it.

use rig::bno055::WarmUp;
use rig::disturbance::{Disturbances, SupplySag, Temperature, ThrustRamp, Vibration};
use serde::{Deserialize, Serialize};

/// Standard gravity, m/s^2.
const STANDARD_GRAVITY_M_S2: f64 = 9.80665;

/// What disturbs the flights. Times count from the release, those of the temperature from power-on, in s.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct DisturbanceFigures {
    /// The unbalanced propeller.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub vibration: Option<VibrationEntry>,
    /// The servo's supply.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub servo_supply: Option<SupplyEntry>,
    /// The growing thrust.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub thrust_ramp: Option<RampEntry>,
    /// The sensor that warms up.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub temperature: Option<TemperatureEntry>,
}

/// Amplitudes and frequency of a vibration; without a rate, what a mount gives that yields over 0.1 m.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs, reason = "the units are in the names")]
pub struct VibrationEntry {
    pub acc_m_s2: f64,
    pub rate_dps: Option<f64>,
    pub frequency_hz: f64,
}

/// Voltage of a sag without current and at the servo's stall current (the same if it is left out), and when; without an
/// end it lasts.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs, reason = "the units are in the names")]
pub struct SupplyEntry {
    pub volts: f64,
    pub stall_volts: Option<f64>,
    #[serde(default)]
    pub from_s: f64,
    pub until_s: Option<f64>,
}

/// Thrust at release and time to the whole.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs, reason = "the units are in the names")]
pub struct RampEntry {
    pub from_pct: f64,
    pub seconds: f64,
}

/// Temperatures of the sensor's chip and what they do; the drifts are per K from 25 deg C.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs, reason = "the units are in the names")]
pub struct TemperatureEntry {
    pub from_c: f64,
    pub to_c: f64,
    pub time_constant_s: f64,
    #[serde(default = "typical_gyro_dps_k")]
    pub gyro_dps_k: f64,
    #[serde(default)]
    pub acc_mg_k: f64,
}

/// The data sheet's typical value.
pub const fn typical_gyro_dps_k() -> f64 {
    0.015
}

impl DisturbanceFigures {
    /// The figures, unless nothing disturbs.
    pub fn of(disturbances: &Disturbances) -> Option<Self> {
        (*disturbances != Disturbances::default()).then(|| Self {
            vibration: disturbances.vibration.map(Into::into),
            servo_supply: disturbances.supply.map(Into::into),
            thrust_ramp: disturbances.thrust.map(Into::into),
            temperature: disturbances.temperature.map(Into::into),
        })
    }

    /// A line each for a table: what, how.
    pub fn rows(&self) -> Vec<(&'static str, String)> {
        let vibration = self.vibration.as_ref().map(|v| {
            let rate = v.rate_dps.unwrap_or_default();
            let how = format!(
                "{} m/s2 and {rate:.1} deg/s at {} Hz",
                v.acc_m_s2, v.frequency_hz
            );
            ("propeller vibration", how)
        });
        let supply = self.servo_supply.as_ref().map(|s| {
            let when = match s.until_s {
                Some(until_s) => format!("from {} to {until_s} s", s.from_s),
                None => format!("from {} s on", s.from_s),
            };
            let weak = s.stall_volts.filter(|stall| *stall < s.volts);
            let weak = weak.map(|stall| format!(", {stall} V at stall"));
            let weak = weak.unwrap_or_default();
            ("servo supply", format!("{} V{weak} {when}", s.volts))
        });
        let ramp = self.thrust_ramp.as_ref().map(|r| {
            let how = format!("{} to 100 % in {} s", r.from_pct, r.seconds);
            ("thrust", how)
        });
        let temperature = self.temperature.as_ref().map(|t| {
            let how = format!(
                "{} to {} C in {} s, {:.3} deg/s/K",
                t.from_c, t.to_c, t.time_constant_s, t.gyro_dps_k
            );
            ("sensor temperature", how)
        });
        [vibration, supply, ramp, temperature]
            .into_iter()
            .flatten()
            .collect()
    }
}

impl From<Vibration> for VibrationEntry {
    fn from(vibration: Vibration) -> Self {
        Self {
            acc_m_s2: vibration.force_m_s2,
            rate_dps: Some(vibration.rate_rad_s.to_degrees()),
            frequency_hz: vibration.frequency_hz,
        }
    }
}

impl TryFrom<VibrationEntry> for Vibration {
    type Error = String;

    fn try_from(entry: VibrationEntry) -> Result<Self, String> {
        if !(0.0..=40.0).contains(&entry.acc_m_s2) {
            return Err("a vibration is 0 to 40 m/s2".into());
        }
        if !(1.0..=Vibration::HIGHEST_HZ).contains(&entry.frequency_hz) {
            return Err(format!("a vibration has 1 to {} Hz", Vibration::HIGHEST_HZ));
        }
        let vibration = Vibration::new(entry.acc_m_s2, entry.frequency_hz);
        match entry.rate_dps {
            None => Ok(vibration),
            Some(rate) if (0.0..=500.0).contains(&rate) => Ok(Vibration {
                rate_rad_s: rate.to_radians(),
                ..vibration
            }),
            Some(_) => Err("the angular rate of a vibration is 0 to 500 deg/s".into()),
        }
    }
}

impl From<SupplySag> for SupplyEntry {
    fn from(sag: SupplySag) -> Self {
        Self {
            volts: sag.volts,
            stall_volts: Some(sag.stall_volts),
            from_s: sag.from_s,
            until_s: sag.until_s.is_finite().then_some(sag.until_s),
        }
    }
}

impl TryFrom<SupplyEntry> for SupplySag {
    type Error = String;

    fn try_from(entry: SupplyEntry) -> Result<Self, String> {
        if !(3.0..=7.4).contains(&entry.volts) {
            return Err("the supply of a servo is 3 to 7.4 V".into());
        }
        let stall_volts = entry.stall_volts.unwrap_or(entry.volts);
        if !(1.0..=entry.volts).contains(&stall_volts) {
            return Err("the supply at stall is 1 V to the one without current".into());
        }
        let until_s = entry.until_s.unwrap_or(f64::INFINITY);
        if entry.from_s >= 0.0 && until_s > entry.from_s {
            Ok(Self {
                volts: entry.volts,
                stall_volts,
                from_s: entry.from_s,
                until_s,
            })
        } else {
            Err("a sag begins at 0 s or later and ends after it began".into())
        }
    }
}

impl From<ThrustRamp> for RampEntry {
    fn from(ramp: ThrustRamp) -> Self {
        Self {
            from_pct: 100.0 * ramp.from_share,
            seconds: ramp.seconds,
        }
    }
}

impl TryFrom<RampEntry> for ThrustRamp {
    type Error = String;

    fn try_from(entry: RampEntry) -> Result<Self, String> {
        if !(0.0..=100.0).contains(&entry.from_pct) {
            return Err("the thrust at release is 0 to 100 %".into());
        }
        if !(entry.seconds > 0.0 && entry.seconds <= 10.0) {
            return Err("a thrust ramp takes more than 0 and at most 10 s".into());
        }
        Ok(Self {
            from_share: entry.from_pct / 100.0,
            seconds: entry.seconds,
        })
    }
}

impl From<Temperature> for TemperatureEntry {
    fn from(temperature: Temperature) -> Self {
        let warm_up = temperature.warm_up;
        Self {
            from_c: warm_up.from_c,
            to_c: warm_up.to_c,
            time_constant_s: warm_up.time_constant_s,
            gyro_dps_k: temperature.gyro_rad_s_k.to_degrees(),
            acc_mg_k: temperature.acc_m_s2_k / STANDARD_GRAVITY_M_S2 * 1e3,
        }
    }
}

impl TryFrom<TemperatureEntry> for Temperature {
    type Error = String;

    fn try_from(entry: TemperatureEntry) -> Result<Self, String> {
        let works = -40.0..=85.0;
        if !works.contains(&entry.from_c) || !works.contains(&entry.to_c) {
            return Err("the sensor's temperature is -40 to 85 C".into());
        }
        if !(entry.time_constant_s > 0.0 && entry.time_constant_s <= 3600.0) {
            return Err("warming up takes more than 0 and at most 3600 s".into());
        }
        if !(-1.0..=1.0).contains(&entry.gyro_dps_k) || !(-20.0..=20.0).contains(&entry.acc_mg_k) {
            return Err("the drift is at most 1 deg/s/K and 20 mg/K".into());
        }
        Ok(Self {
            warm_up: WarmUp {
                from_c: entry.from_c,
                to_c: entry.to_c,
                time_constant_s: entry.time_constant_s,
            },
            gyro_rad_s_k: entry.gyro_dps_k.to_radians(),
            acc_m_s2_k: entry.acc_mg_k * 1e-3 * STANDARD_GRAVITY_M_S2,
        })
    }
}
