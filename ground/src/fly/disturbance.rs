//! What disturbed the flights, as figures.

use rig::disturbance::{Disturbances, SupplySag, ThrustRamp, Vibration};
use serde::Serialize;

/// What disturbed the flights. Times count from the release, in s.
#[derive(Debug, Serialize)]
pub struct DisturbanceFigures {
    /// The unbalanced propeller.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub vibration: Option<VibrationFigures>,
    /// The servo's supply.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub servo_supply: Option<SupplyFigures>,
    /// The growing thrust.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub thrust_ramp: Option<RampFigures>,
}

/// Amplitudes and frequency of a vibration.
#[derive(Debug, Serialize)]
#[allow(missing_docs, reason = "the units are in the names")]
pub struct VibrationFigures {
    pub acc_m_s2: f64,
    pub rate_dps: f64,
    pub frequency_hz: f64,
}

/// Voltage of a sag and when; without an end it lasts.
#[derive(Debug, Serialize)]
#[allow(missing_docs, reason = "the units are in the names")]
pub struct SupplyFigures {
    pub volts: f64,
    pub from_s: f64,
    pub until_s: Option<f64>,
}

/// Thrust at release and time to the whole.
#[derive(Debug, Serialize)]
#[allow(missing_docs, reason = "the units are in the names")]
pub struct RampFigures {
    pub from_pct: f64,
    pub seconds: f64,
}

impl DisturbanceFigures {
    /// The figures, unless nothing disturbs.
    pub fn of(disturbances: &Disturbances) -> Option<Self> {
        (*disturbances != Disturbances::default()).then(|| Self {
            vibration: disturbances.vibration.map(Into::into),
            servo_supply: disturbances.supply.map(Into::into),
            thrust_ramp: disturbances.thrust.map(Into::into),
        })
    }

    /// A line each for a table: what, how.
    pub fn rows(&self) -> Vec<(&'static str, String)> {
        let vibration = self.vibration.as_ref().map(|v| {
            let how = format!(
                "{} m/s2 and {:.1} deg/s at {} Hz",
                v.acc_m_s2, v.rate_dps, v.frequency_hz
            );
            ("propeller vibration", how)
        });
        let supply = self.servo_supply.as_ref().map(|s| {
            let when = match s.until_s {
                Some(until_s) => format!("from {} to {until_s} s", s.from_s),
                None => format!("from {} s on", s.from_s),
            };
            ("servo supply", format!("{} V {when}", s.volts))
        });
        let ramp = self.thrust_ramp.as_ref().map(|r| {
            let how = format!("{} to 100 % in {} s", r.from_pct, r.seconds);
            ("thrust", how)
        });
        [vibration, supply, ramp].into_iter().flatten().collect()
    }
}

impl From<Vibration> for VibrationFigures {
    fn from(vibration: Vibration) -> Self {
        Self {
            acc_m_s2: vibration.force_m_s2,
            rate_dps: vibration.rate_rad_s.to_degrees(),
            frequency_hz: vibration.frequency_hz,
        }
    }
}

impl From<SupplySag> for SupplyFigures {
    fn from(sag: SupplySag) -> Self {
        Self {
            volts: sag.volts,
            from_s: sag.from_s,
            until_s: sag.until_s.is_finite().then_some(sag.until_s),
        }
    }
}

impl From<ThrustRamp> for RampFigures {
    fn from(ramp: ThrustRamp) -> Self {
        Self {
            from_pct: 100.0 * ramp.from_share,
            seconds: ramp.seconds,
        }
    }
}
