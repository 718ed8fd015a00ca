//! What the emulated parts are like where real ones differ from each other.
//!
//! Every difference has a key in [`KEYS`], by which the command line sets it: `KEY=VALUE`, several
//! with commas between them.

use crate::bno055::{self, BusTiming, RareStretch};
use std::fmt::Display;
use std::ops::RangeInclusive;
use std::str::FromStr;

/// What the emulated parts are like where real ones differ.
#[derive(Clone, Debug, PartialEq)]
pub struct Hardware {
    /// 7-bit address of the sensor: 0x28 or 0x29, by the level at its address pin.
    pub address: u8,
    /// How long the sensor holds the clock line of its bus.
    pub bus: BusTiming,
}

impl Default for Hardware {
    fn default() -> Self {
        Self {
            address: 0x28,
            bus: BusTiming::default(),
        }
    }
}

/// A difference between parts that can be set.
#[derive(Clone, Copy, Debug)]
pub struct Key {
    /// Its name on the command line.
    pub name: &'static str,
    /// What its value looks like.
    pub value: &'static str,
    /// What it sets, with unit and range.
    pub what: &'static str,
    /// Where its range comes from.
    pub source: &'static str,
    set: fn(&mut Hardware, &str) -> Result<(), String>,
    show: fn(&Hardware) -> String,
}

/// Longest hold of the clock line that can be set, us.
const LONGEST_HOLD_US: RangeInclusive<u64> = 0..=20_000;

/// All that can be set.
pub const KEYS: &[Key] = &[
    Key {
        name: "address",
        value: "0x28|0x29",
        what: "address of the sensor on the bus",
        source: "BNO055 data sheet, 4.6; on many boards the open pin gives 0x29",
        set: |hardware, text| {
            hardware.address = match text {
                "0x28" => 0x28,
                "0x29" => 0x29,
                _ => return Err("must be 0x28 or 0x29".into()),
            };
            Ok(())
        },
        show: |hardware| format!("{:#04x}", hardware.address),
    },
    Key {
        name: "stretch",
        value: "US|MIN..MAX",
        what: "how long the sensor holds SCL in each byte, us (0 to 20000)",
        source: "Bosch forum, td-p/7270: about 180 us",
        set: |hardware, text| put(&mut hardware.bus.stretch_us, range(text, LONGEST_HOLD_US)),
        show: |hardware| shown(&hardware.bus.stretch_us),
    },
    Key {
        name: "stretch-rare",
        value: "US@PROBABILITY",
        what: "a longer hold of some bytes instead, us (0 to 20000), and their share (0 to 1)",
        source: "Adafruit_BNO055: \"500us or more\" at times",
        set: |hardware, text| put(&mut hardware.bus.stretch_rare, rare(text).map(Some)),
        show: |hardware| {
            let rare = hardware.bus.stretch_rare;
            rare.map_or("none".into(), |rare| {
                format!("{}@{}", rare.us, rare.probability)
            })
        },
    },
    Key {
        name: "stop-read",
        value: "US|MIN..MAX",
        what: "how long the sensor holds SCL before the STOP after a read, us (0 to 20000)",
        source: "Atmel's i2c_slave driver releases the line in its interrupt, as between bytes",
        set: |hardware, text| put(&mut hardware.bus.stop_read_us, range(text, LONGEST_HOLD_US)),
        show: |hardware| shown(&hardware.bus.stop_read_us),
    },
    Key {
        name: "stop-write",
        value: "US|MIN..MAX",
        what: "how long the sensor holds SCL before the STOP after a write, us (0 to 20000)",
        source: "SAM D20 data sheet, SERCOM I2C slave: it stretches before the acknowledge",
        set: |hardware, text| {
            put(
                &mut hardware.bus.stop_write_us,
                range(text, LONGEST_HOLD_US),
            )
        },
        show: |hardware| shown(&hardware.bus.stop_write_us),
    },
];

impl Hardware {
    /// Sets what `KEY=VALUE` says.
    ///
    /// # Errors
    /// There is no such key, or its value is none of those that are possible; the text lists them.
    pub fn set(&mut self, setting: &str) -> Result<(), String> {
        let (name, value) = setting.split_once('=').unwrap_or((setting, ""));
        let (name, value) = (name.trim(), value.trim());
        let Some(key) = KEYS.iter().find(|key| key.name == name) else {
            let names: Vec<&str> = KEYS.iter().map(|key| key.name).collect();
            let names = names.join(", ");
            return Err(format!("there is no key `{name}`; the keys are {names}"));
        };
        (key.set)(self, value).map_err(|why| format!("{name}={}: {}; {why}", key.value, key.what))
    }

    /// The keys, a line each, with their values and defaults.
    pub fn help() -> String {
        let default = Self::default();
        let lines = KEYS.iter().map(|key| {
            let Key {
                name, value, what, ..
            } = key;
            format!(
                "{name}={value}: {what} [default: {}]\n",
                (key.show)(&default)
            )
        });
        lines.collect()
    }

    /// The sensor as it differs.
    pub(crate) fn fit(&self, sensor: &mut bno055::Config) {
        sensor.address = self.address;
        sensor.bus = self.bus.clone();
    }
}

impl FromStr for Hardware {
    type Err = String;

    /// The default with settings, commas between them.
    fn from_str(text: &str) -> Result<Self, String> {
        let mut hardware = Self::default();
        for setting in text.split(',').filter(|setting| !setting.is_empty()) {
            hardware.set(setting)?;
        }
        Ok(hardware)
    }
}

fn put<T>(field: &mut T, value: Result<T, String>) -> Result<(), String> {
    *field = value?;
    Ok(())
}

/// A number within `limits`.
fn number<T>(text: &str, limits: RangeInclusive<T>) -> Result<T, String>
where
    T: FromStr + PartialOrd + Display,
{
    let number = text.trim().parse().ok();
    number
        .filter(|number| limits.contains(number))
        .ok_or_else(|| {
            let (least, most) = (limits.start(), limits.end());
            format!("`{text}` is no number from {least} to {most}")
        })
}

/// A number, or `MIN..MAX`.
fn range(text: &str, limits: RangeInclusive<u64>) -> Result<RangeInclusive<u64>, String> {
    let (least, most) = text.split_once("..").unwrap_or((text, text));
    let range = number(least, limits.clone())?..=number(most, limits)?;
    if range.is_empty() {
        return Err(format!("`{text}` has its larger number first"));
    }
    Ok(range)
}

fn rare(text: &str) -> Result<RareStretch, String> {
    let (us, probability) = text.split_once('@').unwrap_or((text, ""));
    Ok(RareStretch {
        us: number(us, LONGEST_HOLD_US)?,
        probability: number(probability, 0.0..=1.0)?,
    })
}

fn shown(range: &RangeInclusive<u64>) -> String {
    if range.start() == range.end() {
        range.start().to_string()
    } else {
        format!("{}..{}", range.start(), range.end())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_change_what_they_name_and_nothing_else() {
        let hardware: Hardware =
            "stop-read=160..200,stretch=210,address=0x29,stretch-rare=500@0.01"
                .parse()
                .unwrap();
        let bus = BusTiming {
            stretch_us: 210..=210,
            stretch_rare: Some(RareStretch {
                us: 500,
                probability: 0.01,
            }),
            stop_read_us: 160..=200,
            ..BusTiming::default()
        };
        assert_eq!(hardware, Hardware { address: 0x29, bus });
    }

    #[test]
    fn a_default_that_is_shown_can_be_given() {
        let default = Hardware::default();
        for key in KEYS {
            let shown = (key.show)(&default);
            if shown == "none" {
                continue;
            }
            let parsed = format!("{}={shown}", key.name).parse();
            assert_eq!(parsed, Ok(default.clone()), "{}", key.name);
        }
    }

    #[test]
    fn refusals_say_what_is_possible() {
        let refused = |text: &str| text.parse::<Hardware>().unwrap_err();
        assert!(refused("strech=3").contains("the keys are address, stretch,"));
        assert!(refused("stretch").starts_with("stretch=US|MIN..MAX: how long"));
        for bad in [
            "stretch=x",
            "stretch=200..160",
            "stretch=20001",
            "stretch-rare=500",
            "stretch-rare=500@2",
            "stretch-rare=500@NaN",
            "address=40",
        ] {
            let why = refused(bad);
            assert!(why.starts_with(bad.split('=').next().unwrap()), "{why}");
        }
    }
}
