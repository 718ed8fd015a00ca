//! Which filter, and how it runs.

use std::fmt;
use std::str::FromStr;

/// A filter, how it computes, what it sees, and what it is set to.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Choice {
    /// The filter.
    pub filter: FilterName,
    /// Its arithmetic.
    pub scalar: Scalar,
    /// Whether it sees the magnetometer.
    pub mode: Mode,
    /// Settings other than the defaults.
    pub settings: Vec<Setting>,
}

/// The filters of `tvc-fusion`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum FilterName {
    /// Integrated rates, aligned at the start only.
    Gyro,
    /// Complementary filter, on quaternions.
    Complementary,
    /// Mahony's explicit complementary filter.
    Mahony,
    /// Madgwick's gradient-descent filter.
    Madgwick,
    /// VQF class: acceleration smoothed in the earth frame.
    Vqf,
    /// Multiplicative Kalman filter of attitude and offset.
    Kalman,
}

/// Which sensors are used.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum Mode {
    /// Gyroscope and accelerometer.
    #[cfg_attr(feature = "clap", value(name = "6d"))]
    SixD,
    /// And magnetometer.
    #[cfg_attr(feature = "clap", value(name = "9d"))]
    NineD,
}

/// What a filter computes in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum Scalar {
    /// Single precision.
    F32,
    /// Double precision.
    F64,
    /// Integers, on counts.
    Fixed,
}

/// Another value for a setting of a filter.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Setting {
    /// Name of what is set.
    pub key: String,
    /// What it is set to, in SI units.
    pub value: String,
}

/// All values of a kind, shown by their names on the command line.
macro_rules! named {
    ($kind:ident: $($value:ident $name:literal),*) => {
        impl $kind {
            /// All of them.
            pub const ALL: &'static [Self] = &[$(Self::$value),*];
        }

        impl fmt::Display for $kind {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str(match self {
                    $(Self::$value => $name),*
                })
            }
        }
    };
}

named! {
    FilterName: Gyro "gyro", Complementary "complementary", Mahony "mahony",
    Madgwick "madgwick", Vqf "vqf", Kalman "kalman"
}
named! { Mode: SixD "6d", NineD "9d" }
named! { Scalar: F32 "f32", F64 "f64", Fixed "fixed" }

impl fmt::Display for Setting {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}={}", self.key, self.value)
    }
}

impl FromStr for Setting {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        match text.split_once('=') {
            Some((key, value)) if !key.trim().is_empty() && !value.trim().is_empty() => {
                Ok(Self { key: key.trim().to_owned(), value: value.trim().to_owned() })
            }
            _ => Err("a setting is KEY=VALUE, such as mag_tau_s=6"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_setting_is_a_key_and_a_value() {
        let set: Setting = " mag_tau_s = 6".parse().unwrap();
        assert_eq!((set.key.as_str(), set.value.as_str()), ("mag_tau_s", "6"));
        for bad in ["mag_tau_s", "=6", "mag_tau_s=", ""] {
            assert!(bad.parse::<Setting>().is_err(), "{bad}");
        }
    }

    #[cfg(feature = "clap")]
    #[test]
    fn values_have_the_names_of_the_command_line() {
        fn check<T: clap::ValueEnum + fmt::Display>() {
            for value in T::value_variants() {
                let name = value.to_possible_value().unwrap().get_name().to_owned();
                assert_eq!(value.to_string(), name);
            }
        }
        check::<FilterName>();
        check::<Mode>();
        check::<Scalar>();
    }
}
