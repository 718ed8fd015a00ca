//! What has a name on the command line has the same one in files.

use std::fmt::Display;
use std::str::FromStr;

use serde::{Deserialize, Deserializer, Serializer, de::Error};

pub fn serialize<T: Display, S: Serializer>(value: &T, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_str(value)
}

pub fn deserialize<'de, T, D>(deserializer: D) -> Result<T, D::Error>
where
    T: FromStr<Err = String>,
    D: Deserializer<'de>,
{
    let name = String::deserialize(deserializer)?;
    name.parse().map_err(D::Error::custom)
}

/// The same for what the command line lists.
pub mod choice {
    use super::{Deserialize, Deserializer, Error, Serializer};
    use clap::ValueEnum;

    pub fn serialize<T: ValueEnum, S: Serializer>(
        value: &T,
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        let value = value.to_possible_value();
        serializer.serialize_str(value.as_ref().map_or("", |value| value.get_name()))
    }

    pub fn deserialize<'de, T, D>(deserializer: D) -> Result<T, D::Error>
    where
        T: ValueEnum,
        D: Deserializer<'de>,
    {
        let name = String::deserialize(deserializer)?;
        let refused = |why| D::Error::custom(format!("{why}: {name}"));
        T::from_str(&name, false).map_err(refused)
    }
}
