//! Settings by name: from `KEY=VALUE` to the configuration of a filter.

use tvc_fusion::{ComplementaryGains, Config, KalmanGains, MadgwickGains, MahonyGains, VqfGains};

use crate::{FilterName, Setting};

/// Name of a setting, and its field.
type Key<T> = (&'static str, fn(&mut T) -> &mut f32);

/// Name of a set of gains, and the function that makes it.
type Preset<T> = (&'static str, fn() -> T);

/// Gains that can be set by name.
pub(crate) trait Gains: Copy + Default + 'static {
    /// The settings.
    const KEYS: &'static [Key<Self>];
    /// Names of whole sets of gains.
    const PRESETS: &'static [Preset<Self>];
}

/// Settings by the fields that they set.
macro_rules! keys {
    ($($field:ident $(. $inner:ident)?)*) => {
        [$((
            concat!(stringify!($field) $(, ".", stringify!($inner))?),
            |config| &mut config.$field $(. $inner)?,
        )),*]
    };
}

/// Gains with these settings, and with these presets beside the default.
macro_rules! gains {
    ($gains:ty: $($field:ident)*; $($preset:ident)*) => {
        impl Gains for $gains {
            const KEYS: &'static [Key<Self>] = &keys! { $($field)* };
            const PRESETS: &'static [Preset<Self>] =
                &[("default", Self::default), $((stringify!($preset), Self::$preset)),*];
        }
    };
}

impl Gains for () {
    const KEYS: &'static [Key<Self>] = &[];
    const PRESETS: &'static [Preset<Self>] =
        &[("default", Self::default), ("thesis", Self::default)];
}

gains! { ComplementaryGains: acc_tau_s mag_tau_s; thesis }
gains! { MahonyGains: acc_per_s mag_per_s integral_per_s2; thesis }
gains! { MadgwickGains: beta_per_s; thesis }
gains! { KalmanGains: gyr_rad2_s gyr_scale_s bias_rad2_s3 bias_rad_s acc_rad2_s mag_rad2_s; }
gains! { VqfGains: acc_tau_s acc_smoothing_s mag_tau_s; published offline }

/// The settings that all filters share.
fn shared<G>() -> [Key<Config<G>>; 21] {
    keys! {
        acc_gate gyro_range_rad_s recovery_rad2_s gap_s start_up_s
        gyr_lag_s acc_lag_s mag_lag_s mag_lag_sd_s declination_rad
        rest.rate_rad_s rest.acc_m_s2 rest.time_s rest.max_bias_rad_s rest.tau_s rest.motion_tilt_rad
        field.gate field.tau_s field.adopt_s field.adopt_rate_rad_s field.reject_s
    }
}

/// The configuration that `settings` make of the defaults. Presets come first, wherever they stand.
///
/// # Errors
/// A preset or key that the filter has not, with those that it has; a value that is no number.
pub(crate) fn config<G: Gains>(
    filter: FilterName,
    gyro_range_rad_s: Option<f32>,
    settings: &[Setting],
) -> Result<Config<G>, String> {
    let mut config = Config::with_gains(G::default());
    if let Some(range) = gyro_range_rad_s {
        config.gyro_range_rad_s = config.gyro_range_rad_s.min(range);
    }
    let (presets, others): (Vec<_>, Vec<_>) =
        settings.iter().partition(|setting| setting.key == "preset");
    for setting in presets {
        let preset = G::PRESETS.iter().find(|(name, _)| *name == setting.value);
        let (_, gains) = preset.ok_or_else(|| {
            let known = joined(G::PRESETS.iter().map(|(name, _)| *name));
            format!("{filter} has no preset {}; its presets are {known}", setting.value)
        })?;
        config.gains = gains();
    }
    for setting in others {
        let value = setting.value.parse::<f32>();
        let value = value.map_err(|_| format!("{setting} is not a number"))?;
        *field(&mut config, &setting.key).ok_or_else(|| unknown::<G>(filter, &setting.key))? =
            value;
    }
    Ok(config)
}

fn field<'a, G: Gains>(config: &'a mut Config<G>, key: &str) -> Option<&'a mut f32> {
    let shared = shared::<G>().into_iter().find(|(name, _)| *name == key);
    if let Some((_, of)) = shared {
        return Some(of(config));
    }
    let (_, of) = G::KEYS.iter().find(|(name, _)| *name == key)?;
    Some(of(&mut config.gains))
}

fn unknown<G: Gains>(filter: FilterName, key: &str) -> String {
    let own = G::KEYS.iter().map(|(name, _)| *name);
    let shared = shared::<G>();
    let shared = shared.iter().map(|(name, _)| *name);
    let known = joined(std::iter::once("preset").chain(own).chain(shared));
    format!("{filter} has no setting {key}; its settings are {known}")
}

fn joined<'a>(names: impl Iterator<Item = &'a str>) -> String {
    names.collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn set(text: &[&str]) -> Vec<Setting> {
        text.iter().map(|text| text.parse().unwrap()).collect()
    }

    #[test]
    fn every_key_sets_a_field_of_its_own() {
        fn check<G: Gains + PartialEq>() {
            let keys: Vec<_> = shared::<G>()
                .iter()
                .map(|(name, _)| *name)
                .chain(G::KEYS.iter().map(|(name, _)| *name))
                .collect();
            let mut config = Config::<G>::default();
            for (value, key) in keys.iter().enumerate() {
                *field(&mut config, key).unwrap() = value as f32;
            }
            for (value, key) in keys.iter().enumerate() {
                assert_eq!(*field(&mut config, key).unwrap(), value as f32, "{key}");
            }
        }
        check::<()>();
        check::<ComplementaryGains>();
        check::<MahonyGains>();
        check::<MadgwickGains>();
        check::<VqfGains>();
        check::<KalmanGains>();
    }

    #[test]
    fn a_preset_gives_way_to_what_is_set_wherever_it_stands() {
        let settings = set(&["mag_per_s=0.3", "preset=thesis", "field.gate=inf"]);
        let config = config::<MahonyGains>(FilterName::Mahony, None, &settings).unwrap();
        assert_eq!(config.gains.acc_per_s, 0.5);
        assert_eq!(config.gains.mag_per_s, 0.3);
        assert_eq!(config.field.gate, f32::INFINITY);
    }

    #[test]
    fn the_recordings_range_narrows_the_default_but_not_what_is_set() {
        let of = |range, settings: &[&str]| {
            config::<VqfGains>(FilterName::Vqf, range, &set(settings)).unwrap().gyro_range_rad_s
        };
        assert_eq!(of(Some(8.0), &[]), 8.0);
        assert_eq!(of(Some(90.0), &[]), of(None, &[]));
        assert_eq!(of(Some(8.0), &["gyro_range_rad_s=20"]), 20.0);
    }

    #[test]
    fn errors_name_what_there_is() {
        let said = |settings: &[&str]| {
            config::<MadgwickGains>(FilterName::Madgwick, None, &set(settings))
                .unwrap_err()
                .to_string()
        };
        assert!(said(&["beta=1"]).contains("beta_per_s, acc_gate"));
        assert!(said(&["preset=best"]).contains("default, thesis"));
        assert!(said(&["beta_per_s=much"]).contains("beta_per_s=much is not a number"));
    }
}
