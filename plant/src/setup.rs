//! Drone, servo and timing from a TOML file.
//!
//! ```toml
//! [drone]
//! preset = "PHYS"              # PHYS, THESIS_TABLE, THESIS_TEXT; PHYS if left out
//! thrust_n = 28.5              # keys are the fields' names, numbers in the unit of the name
//! crank_length_m = "20 mm"     # or a text with another unit of the same kind
//!
//! [servo]
//! preset = "S3003"             # S3003, S3003_5V, DIGITAL
//! speed_rad_s = "300 deg/s"
//!
//! [timing]
//! preset = "ANALOGUE"          # ANALOGUE, DIGITAL, NANO_50HZ, NANO_300HZ
//! delay_s = "6 ms"
//! ```
//!
//! Every table may be left out. Unknown keys, units of the wrong kind and values out of range are
//! errors that name the key.

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use toml::{Table, Value};

use crate::parameters::{ParameterError, Parameters, by_name};
use crate::pitch_loop::Timing;
use crate::servo::ServoModel;

/// A drone with its servo and the timing of its loop.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Setup {
    /// The drone.
    pub drone: Parameters,
    /// The servo.
    pub servo: ServoModel,
    /// Sensor delay, control period and servo frame.
    pub timing: Timing,
}

/// Why a vehicle's file is refused.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SetupError {
    /// Not TOML.
    #[error("not TOML: {0}")]
    Syntax(String),
    /// A table that a vehicle's file does not have.
    #[error(
        "unknown table [{0}]: a vehicle's file has [drone], [servo], [timing] and [two_axes], or [rocket], [mounting] and [conditions]"
    )]
    UnknownTable(String),
    /// A key or preset that does not exist, or a value of the wrong type or out of range.
    #[error("[{table}] {message}")]
    Key {
        /// The table.
        table: &'static str,
        /// What is wrong, naming the key.
        message: String,
    },
}

impl Default for Setup {
    /// The recommended drone with an analogue servo.
    fn default() -> Self {
        Self { drone: Parameters::PHYS, servo: ServoModel::S3003, timing: Timing::ANALOGUE }
    }
}

impl Setup {
    /// Reads a vehicle's file of these tables alone.
    ///
    /// # Errors
    /// See [`SetupError`].
    pub fn parse(text: &str) -> Result<Self, SetupError> {
        let mut file: Table =
            text.parse().map_err(|error: toml::de::Error| SetupError::Syntax(error.to_string()))?;
        let setup = Self::take(&mut file, &Self::default())?;
        match file.keys().next() {
            Some(name) => Err(SetupError::UnknownTable(name.clone())),
            None => Ok(setup),
        }
    }

    /// Takes the tables of a setup out of a larger file; what it leaves out is as in `base`.
    ///
    /// # Errors
    /// See [`SetupError`].
    pub fn take(file: &mut Table, base: &Self) -> Result<Self, SetupError> {
        let setup = Self {
            drone: section(file, "drone", Some(base.drone), &Parameters::PRESETS)?,
            servo: section(file, "servo", Some(base.servo), &ServoModel::PRESETS)?,
            timing: section(file, "timing", Some(base.timing), &Timing::PRESETS)?,
        };
        setup.validate()?;
        Ok(setup)
    }

    /// Checks drone, servo and timing.
    ///
    /// # Errors
    /// The first value out of range.
    pub fn validate(&self) -> Result<(), SetupError> {
        let in_table = |table| {
            move |error: ParameterError| SetupError::Key { table, message: error.to_string() }
        };
        self.drone.validate().map_err(in_table("drone"))?;
        self.servo.validate().map_err(in_table("servo"))?;
        self.timing.validate().map_err(in_table("timing"))
    }

    /// The file's text, every key written out; [`Setup::parse`] reads it back exactly.
    pub fn to_toml(&self) -> String {
        toml::to_string(self).expect("numbers and names in tables are always TOML")
    }
}

/// Takes one table out of a file: its preset, or else `base`, overridden by its other keys. Without
/// either every key must be there.
///
/// # Errors
/// [`SetupError::Key`]: no preset of this name, a key that is unknown or missing, a value of a
/// wrong kind.
pub fn section<T: Copy + Serialize + DeserializeOwned>(
    file: &mut Table,
    table: &'static str,
    mut base: Option<T>,
    presets: &[(&str, T)],
) -> Result<T, SetupError> {
    let refuse = |message: String| SetupError::Key { table, message };
    let mut overrides = match (file.remove(table), base) {
        (None, Some(base)) => return Ok(base),
        (None, None) => return Err(refuse("is missing".into())),
        (Some(Value::Table(overrides)), _) => overrides,
        (Some(_), _) => return Err(refuse("must be a table".into())),
    };
    match overrides.remove("preset") {
        None => {}
        Some(Value::String(name)) => {
            base = Some(by_name(presets, &name).ok_or_else(|| {
                let known: Vec<&str> = presets.iter().map(|preset| preset.0).collect();
                refuse(format!("preset {name} does not exist: {}", known.join(", ")))
            })?);
        }
        Some(_) => return Err(refuse("preset must be a name".into())),
    }
    let merged = base.map_or(Ok(Table::new()), Table::try_from);
    let mut merged = merged.map_err(|error| refuse(error.to_string()))?;
    for (key, value) in overrides {
        let value = in_si(&key, value).map_err(refuse)?;
        merged.insert(key, value);
    }
    merged.try_into().map_err(|error: toml::de::Error| refuse(error.message().to_string()))
}

/// A value in the unit of its key: numbers as they are, texts with their unit converted, tables and
/// arrays entry by entry.
pub(crate) fn in_si(key: &str, value: Value) -> Result<Value, String> {
    match value {
        Value::Integer(whole) => Ok(Value::Float(whole as f64)),
        Value::Array(values) => values
            .into_iter()
            .map(|value| in_si(key, value))
            .collect::<Result<_, _>>()
            .map(Value::Array),
        Value::Table(entries) => entries
            .into_iter()
            .map(|(key, value)| in_si(&key, value).map(|value| (key, value)))
            .collect::<Result<_, _>>()
            .map(Value::Table),
        Value::String(text) => match units(key) {
            None => Ok(Value::String(text)),
            Some(units) => quantity(&text, units)
                .map(Value::Float)
                .map_err(|problem| format!("{key} = \"{text}\": {problem}")),
        },
        other => Ok(other),
    }
}

/// `"12.5 mm"` in the unit whose factor is one.
fn quantity(text: &str, units: &[(&str, f64)]) -> Result<f64, String> {
    let text = text.trim();
    let (number, unit) = text.split_at(text.find(char::is_whitespace).unwrap_or(text.len()));
    let number: f64 = number.parse().map_err(|_| format!("{number} is not a number"))?;
    let unit = unit.trim();
    match units.iter().find(|(name, _)| *name == unit) {
        Some((_, factor)) => Ok(number * factor),
        None => {
            let known: Vec<&str> = units.iter().map(|(name, _)| *name).collect();
            Err(format!("the unit must be one of: {}", known.join(", ")))
        }
    }
}

/// The units that a key takes, by the ending of its name, and their size in the key's own.
fn units(key: &str) -> Option<&'static [(&'static str, f64)]> {
    const DEG: f64 = std::f64::consts::PI / 180.0;
    /// Endings; a longer one stands before the shorter ones that it ends in.
    const ENDINGS: [(&str, &[(&str, f64)]); 16] = [
        ("_n_m_rad", &[("N m/rad", 1.0), ("mN m/rad", 1e-3)]),
        ("_kg_m2_s", &[("kg m2/s", 1.0), ("g cm2/s", 1e-7)]),
        ("_kg_m2", &[("kg m2", 1.0), ("kg cm2", 1e-4), ("g cm2", 1e-7)]),
        ("_kg", &[("kg", 1.0), ("g", 1e-3)]),
        ("_n_m_per_v", &[("N m/V", 1.0), ("mN m/V", 1e-3)]),
        ("_n_m_s", &[("N m s", 1.0), ("mN m s", 1e-3)]),
        ("_n_m", &[("N m", 1.0), ("mN m", 1e-3), ("kgf cm", 0.0980665)]),
        ("_n", &[("N", 1.0), ("mN", 1e-3), ("kgf", 9.80665)]),
        ("_m_s2", &[("m/s2", 1.0)]),
        ("_m_s", &[("m/s", 1.0), ("km/h", 1.0 / 3.6)]),
        ("_m", &[("m", 1.0), ("mm", 1e-3), ("cm", 1e-2)]),
        ("_us_per_rad", &[("us/rad", 1.0), ("us/deg", 1.0 / DEG)]),
        ("_us", &[("us", 1.0), ("ms", 1e3)]),
        ("_rad_s", &[("rad/s", 1.0), ("deg/s", DEG)]),
        ("_rad", &[("rad", 1.0), ("mrad", 1e-3), ("deg", DEG)]),
        ("_s", &[("s", 1.0), ("ms", 1e-3), ("us", 1e-6)]),
    ];
    // `us_per_rad` has no prefix before its unit.
    let named = format!("_{key}");
    ENDINGS.iter().find(|(ending, _)| named.ends_with(ending)).map(|(_, units)| *units)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refusal(text: &str) -> String {
        Setup::parse(text).unwrap_err().to_string()
    }

    #[test]
    fn an_empty_file_is_the_default() {
        assert_eq!(Setup::parse("").unwrap(), Setup::default());
    }

    /// Else a file of a few bytes would ask for all memory, or for a run without end.
    #[test]
    fn a_delay_is_only_so_many_steps_long() {
        for period in ["step_s", "control_s", "frame_s"] {
            assert!(refusal(&format!("[timing]\n{period} = 1e-12")).contains(period));
        }
        assert!(refusal("[timing]\ndelay_s = 1e9").contains("delay_s"));
        assert!(refusal("[timing]\nrefresh_s = 2").contains("refresh_s"));
        let fine = Setup::parse("[timing]\nstep_s = 1e-5\ndelay_s = 1").unwrap();
        let Setup { drone, servo, timing } = fine;
        assert!(crate::pitch_loop::PitchLoop::new(&drone, servo, timing, 0.1, 0.0).is_ok());
    }

    #[test]
    fn presets_overrides_and_units() {
        let setup = Setup::parse(
            r#"
            [drone]
            preset = "THESIS_TEXT"
            thrust_n = 28
            crank_length_m = "21 mm"
            body_cm_m = ["1 mm", 0.03]
            [servo]
            preset = "digital"
            us_per_rad = "10 us/deg"
            speed_rad_s = "500 deg/s"
            stall_n_m = "4.1 kgf cm"
            signal_loss = { limp = { after_s = 0.2 } }
            [timing]
            delay_s = "6 ms"
            "#,
        )
        .unwrap();
        assert_eq!(
            setup.drone,
            Parameters {
                thrust_n: 28.0,
                crank_length_m: 0.021,
                body_cm_m: [0.001, 0.03],
                ..Parameters::THESIS_TEXT
            }
        );
        assert!((setup.servo.us_per_rad - ServoModel::DIGITAL.us_per_rad).abs() < 1e-9);
        assert!((setup.servo.speed_rad_s.to_degrees() - 500.0).abs() < 1e-9);
        assert!((setup.servo.stall_n_m - 0.40207).abs() < 1e-5);
        assert_eq!(setup.timing.delay_s, 6e-3);
    }

    #[test]
    fn what_is_written_is_read_back() {
        let mut setup = Setup::default();
        setup.drone.thrust_n = 28.123456789012345;
        setup.servo.signal_loss = crate::servo::SignalLoss::Limp { after_s: 0.3 };
        assert_eq!(Setup::parse(&setup.to_toml()).unwrap(), setup);
    }

    #[test]
    fn mistakes_are_named() {
        assert!(refusal("[drone]\nthrust = 3").contains("thrust"));
        assert!(refusal("[drone]\nbody_mass_kg = 0.0").contains("body_mass_kg is 0"));
        assert!(refusal("[drone]\nbody_mass_kg = \"2 mm\"").contains("must be one of: kg, g"));
        assert!(refusal("[drone]\nlink_length_m = 0.03").contains("cannot close"));
        assert!(refusal("[drone]\npreset = \"MAPLE\"").contains("THESIS_TABLE"));
        assert!(refusal("[servo]\nstall_n_m = -1").contains("[servo] stall_n_m is -1"));
        assert!(refusal("[timing]\nframe_s = 0").contains("frame_s is 0"));
        assert!(refusal("[plane]\nx = 1").contains("[plane]"));
        assert!(refusal("thrust").contains("not TOML"));
        assert!(refusal("[drone]\nthrust_n = true").contains("[drone]"));
        // Neither is an angle, nor a time.
        let units = |key: &str| units(key).map(|units| units[0].0);
        assert_eq!(units("stiffness_n_m_rad"), Some("N m/rad"));
        assert_eq!(units("rotor_momentum_kg_m2_s"), Some("kg m2/s"));
    }
}
