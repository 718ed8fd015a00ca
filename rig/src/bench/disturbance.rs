//! Disturbances of a flight other than faults of the sensor: the propeller vibrates, the servo's
//! supply sags, the thrust rises slowly, the sensor warms up.
//!
//! Each disturbance can be written in two ways: as a table of a scenario file (serde), and as
//! numbers with commas between them on the command line ([`FromStr`]). Both have the same units and
//! ranges. Times count from the release, those of [`Temperature`] from power-on.

use crate::inertial::{ImuErrors, STANDARD_GRAVITY_M_S2, WarmUp};
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;
use std::ops::RangeInclusive;
use std::str::FromStr;

/// Supply at which the figures of the rig's servos hold, V.
pub const RATED_SUPPLY_V: f64 = 6.0;
/// Arm over which a vibrating mount tilts the sensor, m: half the drone's width, an estimate.
const MOUNT_ARM_M: f64 = 0.1;
/// Drift of the gyroscope's bias that the data sheet calls typical, deg/s/K.
const TYPICAL_GYRO_DPS_K: f64 = 0.015;

/// Disturbances of a flight; none by default.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
#[cfg_attr(feature = "clap", derive(clap::Args))]
#[cfg_attr(
    feature = "clap",
    command(next_help_heading = "Disturbances (docs/reference/faults.md has ranges and examples)")
)]
pub struct Disturbances {
    /// Unbalanced propeller: m/s2, Hz[, deg/s[, harmonics, wander in %]].
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(
        feature = "clap",
        arg(long, value_name = "ACC,HZ,...", allow_negative_numbers = true)
    )]
    pub vibration: Option<Vibration>,
    /// Servo supply, V (nominal 6)[, from, until, s[, V while it stalls]].
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "clap", arg(long, value_name = "V,...", allow_negative_numbers = true))]
    pub servo_supply: Option<SupplySag>,
    /// Thrust at the release, %, and the time until it is whole, s.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "clap", arg(long, value_name = "PCT,S", allow_negative_numbers = true))]
    pub thrust_ramp: Option<ThrustRamp>,
    /// Sensor at power-on and in the end, C; time constant, s[, drift].
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(
        feature = "clap",
        arg(long, value_name = "C,C,S,...", allow_negative_numbers = true)
    )]
    pub temperature: Option<Temperature>,
}

impl Disturbances {
    /// These, and of the others what these lack.
    pub fn over(&self, others: Self) -> Self {
        Self {
            vibration: self.vibration.or(others.vibration),
            servo_supply: self.servo_supply.or(others.servo_supply),
            thrust_ramp: self.thrust_ramp.or(others.thrust_ramp),
            temperature: self.temperature.or(others.temperature),
        }
    }

    /// Checks every value against its range.
    ///
    /// # Errors
    /// The first value out of its range, with the range.
    pub fn check(&self) -> Result<(), String> {
        self.vibration.map_or(Ok(()), |it| it.check())?;
        self.servo_supply.map_or(Ok(()), |it| it.check())?;
        self.thrust_ramp.map_or(Ok(()), |it| it.check())?;
        self.temperature.map_or(Ok(()), |it| it.check())
    }

    /// These disturbances with every default filled in, to report them; `None` if there are none.
    pub fn report(&self) -> Option<Self> {
        (*self != Self::default()).then(|| Self {
            vibration: self.vibration.map(|vibration| Vibration {
                rate_dps: Some(vibration.rate_rad_s().to_degrees()),
                ..vibration
            }),
            servo_supply: self
                .servo_supply
                .map(|sag| SupplySag { stall_volts: Some(sag.stall_volts()), ..sag }),
            ..*self
        })
    }

    /// Rows of a table: the name of each disturbance and its values.
    pub fn rows(&self) -> Vec<(&'static str, String)> {
        let vibration = self.vibration.map(|v| {
            let rate_dps = v.rate_rad_s().to_degrees();
            let acc_m_s2 = v.acc_m_s2;
            let wander = match v.wander_pct {
                0.0 => String::new(),
                pct => format!(" +-{pct} %"),
            };
            let harmonics = match v.harmonics {
                0 => String::new(),
                more => format!(", {more} harmonics"),
            };
            let how = format!(
                "{acc_m_s2} m/s2 and {rate_dps:.1} deg/s at {} Hz{wander}{harmonics}",
                v.frequency_hz
            );
            ("propeller vibration", how)
        });
        let supply = self.servo_supply.map(|s| {
            let when = match s.until_s {
                Some(until_s) => format!("from {} to {until_s} s", s.from_s),
                None => format!("from {} s on", s.from_s),
            };
            let stall = match s.stall_volts() {
                stall if stall < s.volts => format!(", {stall} V at stall"),
                _ => String::new(),
            };
            ("servo supply", format!("{} V{stall} {when}", s.volts))
        });
        let ramp = self.thrust_ramp.map(|r| {
            let how = format!("{} to 100 % in {} s", r.from_pct, r.seconds);
            ("thrust", how)
        });
        let temperature = self.temperature.map(|t| {
            let (from_c, to_c, seconds) = (t.from_c, t.to_c, t.time_constant_s);
            let drift = t.gyro_dps_k;
            let how = format!("{from_c} to {to_c} C in {seconds} s, {drift:.3} deg/s/K");
            ("sensor temperature", how)
        });
        [vibration, supply, ramp, temperature].into_iter().flatten().collect()
    }
}

/// An unbalanced propeller at a constant speed. Its force turns in the plane of the propeller,
/// perpendicular to the body's z axis; the mount yields and tilts the sensor at the same frequency.
///
/// It acts on the sensor at every step of the physics, before the sensor's filter and sampling, so
/// that frequencies above half the refresh rate are aliased. One close to a multiple of that rate
/// arrives as a slow swing, and one that wanders sweeps through what the controller answers to.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Vibration {
    /// Amplitude of the acceleration along the body's x and y, m/s^2, 0 to 40.
    pub acc_m_s2: f64,
    /// Amplitude of the angular rate about the body's x and y, deg/s, 0 to 500. By default the
    /// mount yields over an arm of 0.1 m: the rate is the vibration's speed divided by that.
    pub rate_dps: Option<f64>,
    /// Turns of the propeller a second, 1 to [`Vibration::HIGHEST_HZ`].
    pub frequency_hz: f64,
    /// Further lines at whole multiples of the frequency, 0 to 4, each with half the amplitude of
    /// the line before; with all that wanders, the highest is at most [`Vibration::HIGHEST_HZ`].
    #[serde(default, skip_serializing_if = "is_default")]
    pub harmonics: u8,
    /// How far the frequency wanders to either side, % of it, 0 to 20; over some seconds, as the
    /// speed of a propeller on a battery does.
    #[serde(default, skip_serializing_if = "is_default")]
    pub wander_pct: f64,
}

/// True for what a report leaves out.
pub(super) fn is_default<T: Default + PartialEq>(value: &T) -> bool {
    *value == T::default()
}

/// Periods of the two swings that the wandering of the frequency is made of, s: they have no common
/// multiple within a flight.
const WANDER_S: [f64; 2] = [5.0, 3.1];

impl Vibration {
    /// Highest frequency that the steps of the physics, 0.5 ms, still resolve, Hz.
    pub const HIGHEST_HZ: f64 = 400.0;

    fn check(&self) -> Result<(), String> {
        within(0.0..=40.0, self.acc_m_s2, "a vibration is 0 to 40 m/s2")?;
        let hertz = format!("a vibration has 1 to {} Hz", Self::HIGHEST_HZ);
        within(1.0..=Self::HIGHEST_HZ, self.frequency_hz, &hertz)?;
        let why = "the angular rate of a vibration is 0 to 500 deg/s";
        within(0.0..=500.0, self.rate_dps.unwrap_or(0.0), why)?;
        within(0.0..=4.0, f64::from(self.harmonics), "a vibration has 0 to 4 harmonics")?;
        within(0.0..=20.0, self.wander_pct, "the frequency of a vibration wanders by 0 to 20 %")?;
        let highest_hz =
            self.frequency_hz * f64::from(1 + self.harmonics) * (1.0 + self.wander_pct / 100.0);
        let why = format!("the highest line of a vibration has at most {} Hz", Self::HIGHEST_HZ);
        within(0.0..=Self::HIGHEST_HZ, highest_hz, &why)
    }

    /// Amplitude of the angular rate about the body's x and y, rad/s.
    fn rate_rad_s(&self) -> f64 {
        match self.rate_dps {
            Some(rate_dps) => rate_dps.to_radians(),
            None => self.acc_m_s2 / (TAU * self.frequency_hz) / MOUNT_ARM_M,
        }
    }

    /// Specific force (m/s^2) and rate (rad/s) along the body's axes at a time, s.
    pub(crate) fn at(&self, time_s: f64) -> ([f64; 3], [f64; 3]) {
        let turns = self.frequency_hz * (time_s + self.ahead_s(time_s));
        let (mut sum_cos, mut sum_sin, mut share) = (0.0, 0.0, 1.0);
        for line in 0..=self.harmonics {
            let (sin, cos) = (TAU * turns * f64::from(line + 1)).sin_cos();
            sum_cos += share * cos;
            sum_sin += share * sin;
            share *= 0.5;
        }
        let turning = |amplitude: f64| [amplitude * sum_cos, amplitude * sum_sin, 0.0];
        (turning(self.acc_m_s2), turning(self.rate_rad_s()))
    }

    /// How far the propeller is ahead of an even one at a time, s: the integral of the relative
    /// deviation of its speed, which is `wander / 2 * sin(2 pi t / T)` summed over both periods.
    fn ahead_s(&self, time_s: f64) -> f64 {
        let each = self.wander_pct / 100.0 / WANDER_S.len() as f64;
        let swings = WANDER_S.map(|period_s| {
            let rate = TAU / period_s;
            each * (1.0 - (rate * time_s).cos()) / rate
        });
        swings.iter().sum()
    }
}

/// `ACC,HZ[,RATE[,HARMONICS,WANDER]]` in m/s^2, Hz, deg/s and %.
impl FromStr for Vibration {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let ([acc_m_s2, frequency_hz], [rate_dps, harmonics, wander_pct]) =
            numbers(text, &[2, 3, 5], "a vibration is m/s2 and Hz, such as 5,180")?;
        let harmonics = harmonics.unwrap_or(0.0);
        if harmonics.fract() != 0.0 || harmonics < 0.0 {
            return Err("a vibration has a whole number of harmonics".into());
        }
        let vibration = Self {
            acc_m_s2,
            rate_dps,
            frequency_hz,
            harmonics: harmonics as u8,
            wander_pct: wander_pct.unwrap_or(0.0),
        };
        vibration.check().map(|()| vibration)
    }
}

/// The servo's supply drops to `volts` for a while, and further with the servo's current; at other
/// times it is at 6 V.
///
/// Speed without load and stall torque are proportional to the supply: the data sheet's figures for
/// 6 V and 5 V, 0.19 and 0.22 s, 0.40 and 0.33 N m, agree with that to within 4 %. The current is
/// that of a DC motor.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct SupplySag {
    /// Supply during the sag without current, V, 3 to 7.4.
    pub volts: f64,
    /// Supply during the sag at the current that the servo draws when it stalls at 6 V, V, 1 to
    /// `volts`; `volts` by default.
    pub stall_volts: Option<f64>,
    /// Begin after the release, s, at least 0.
    #[serde(default)]
    pub from_s: f64,
    /// End after the release, s, after the begin; by default it lasts for the rest of the flight.
    pub until_s: Option<f64>,
}

impl SupplySag {
    fn check(&self) -> Result<(), String> {
        within(3.0..=7.4, self.volts, "the supply of a servo is 3 to 7.4 V")?;
        let why = "the supply at stall is 1 V to the one without current";
        within(1.0..=self.volts, self.stall_volts(), why)?;
        if self.from_s >= 0.0 && self.until_s() > self.from_s {
            Ok(())
        } else {
            Err("a sag begins at 0 s or later and ends after it began".into())
        }
    }

    fn stall_volts(&self) -> f64 {
        self.stall_volts.unwrap_or(self.volts)
    }

    fn until_s(&self) -> f64 {
        self.until_s.unwrap_or(f64::INFINITY)
    }

    /// The supply as a share of the rated one at a time after the release, s, while the servo draws
    /// this share of its stall current.
    pub(crate) fn share(&self, since_release_s: f64, current_share: f64) -> f64 {
        if (self.from_s..self.until_s()).contains(&since_release_s) {
            let drop = (self.volts - self.stall_volts()) * current_share.min(1.0);
            (self.volts - drop) / RATED_SUPPLY_V
        } else {
            1.0
        }
    }
}

/// `V[,FROM,UNTIL[,V]]`: supply in V, two times in s, and the supply at stall in V.
impl FromStr for SupplySag {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let why = "a supply is V, or V and two times in s, such as 4.5,0.2,0.6";
        let ([volts], [from_s, until_s, stall_volts]) = numbers(text, &[1, 3, 4], why)?;
        let sag = Self { volts, stall_volts, from_s: from_s.unwrap_or(0.0), until_s };
        sag.check().map(|()| sag)
    }
}

/// Thrust that rises linearly to its full value from the release on; before, it has its initial
/// value.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct ThrustRamp {
    /// Thrust at release, % of the full one, 0 to 100.
    pub from_pct: f64,
    /// Time to the full thrust, s, above 0 and at most 10.
    pub seconds: f64,
}

impl ThrustRamp {
    fn check(&self) -> Result<(), String> {
        within(0.0..=100.0, self.from_pct, "the thrust at release is 0 to 100 %")?;
        let why = "a thrust ramp takes more than 0 and at most 10 s";
        within(f64::MIN_POSITIVE..=10.0, self.seconds, why)
    }

    /// Share of the thrust at a time after the release, s.
    pub(crate) fn share(&self, since_release_s: f64) -> f64 {
        if since_release_s >= self.seconds {
            1.0
        } else {
            let from_share = self.from_pct / 100.0;
            from_share + (1.0 - from_share) * since_release_s / self.seconds
        }
    }
}

/// `PCT,S`: thrust at release in %, time to the full thrust in s.
impl FromStr for ThrustRamp {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let why = "a thrust ramp is % at release and s, such as 40,0.5";
        let ([from_pct, seconds], []) = numbers(text, &[2], why)?;
        let ramp = Self { from_pct, seconds };
        ramp.check().map(|()| ramp)
    }
}

/// The BNO055 warms up from power-on, and its offsets drift on every axis alike.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Temperature {
    /// The chip's temperature at power-on, deg C, -40 to 85.
    pub from_c: f64,
    /// The chip's final temperature, deg C, -40 to 85.
    pub to_c: f64,
    /// Time in which the difference to that shrinks to 37 %, s, above 0 and at most 3600.
    pub time_constant_s: f64,
    /// Drift of the gyroscope's bias, deg/s/K from 25 deg C, -1 to 1; by default the data sheet's
    /// typical value.
    #[serde(default = "typical_gyro_dps_k")]
    pub gyro_dps_k: f64,
    /// Drift of the accelerometer's offset, mg/K from 25 deg C, -20 to 20.
    #[serde(default)]
    pub acc_mg_k: f64,
}

const fn typical_gyro_dps_k() -> f64 {
    TYPICAL_GYRO_DPS_K
}

impl Temperature {
    fn check(&self) -> Result<(), String> {
        for celsius in [self.from_c, self.to_c] {
            within(-40.0..=85.0, celsius, "the sensor's temperature is -40 to 85 C")?;
        }
        let why = "warming up takes more than 0 and at most 3600 s";
        within(f64::MIN_POSITIVE..=3600.0, self.time_constant_s, why)?;
        let why = "the drift is at most 1 deg/s/K and 20 mg/K";
        within(-1.0..=1.0, self.gyro_dps_k, why)?;
        within(-20.0..=20.0, self.acc_mg_k, why)
    }

    /// `errors` with this warm-up and drift.
    pub(crate) fn of(&self, errors: ImuErrors) -> ImuErrors {
        ImuErrors {
            warm_up: WarmUp {
                from_c: self.from_c,
                to_c: self.to_c,
                time_constant_s: self.time_constant_s,
            },
            gyro_drift_rad_s_k: [self.gyro_dps_k.to_radians(); 3],
            acc_drift_m_s2_k: [self.acc_mg_k * 1e-3 * STANDARD_GRAVITY_M_S2; 3],
            ..errors
        }
    }
}

/// `C,C,S[,DPS_K[,MG_K]]`: two temperatures in deg C, the time constant in s, the gyroscope's drift
/// in deg/s/K, the accelerometer's in mg/K.
impl FromStr for Temperature {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let why = "a temperature is two in C and a time in s, such as 20,45,60";
        let ([from_c, to_c, time_constant_s], [drift, offset]) = numbers(text, &[3, 4, 5], why)?;
        let temperature = Self {
            from_c,
            to_c,
            time_constant_s,
            gyro_dps_k: drift.unwrap_or(TYPICAL_GYRO_DPS_K),
            acc_mg_k: offset.unwrap_or(0.0),
        };
        temperature.check().map(|()| temperature)
    }
}

/// `A` numbers and up to `B` more, with commas between them; `counts` says how many there can be.
fn numbers<const A: usize, const B: usize>(
    text: &str,
    counts: &[usize],
    why: &str,
) -> Result<([f64; A], [Option<f64>; B]), String> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|n| n.trim().parse().ok()).collect();
    let numbers = numbers.filter(|numbers| counts.contains(&numbers.len()));
    let numbers = numbers.ok_or_else(|| why.to_owned())?;
    let more = |at: usize| numbers.get(A + at).copied();
    Ok((std::array::from_fn(|at| numbers[at]), std::array::from_fn(more)))
}

/// Refuses a value out of its range; NaN is out of every range.
fn within(range: RangeInclusive<f64>, value: f64, why: &str) -> Result<(), String> {
    range.contains(&value).then_some(()).ok_or_else(|| why.to_owned())
}

#[cfg(test)]
mod tests;
