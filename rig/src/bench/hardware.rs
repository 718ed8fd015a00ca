//! What the emulated parts are like where real ones differ from each other.
//!
//! Every difference has a key in [`KEYS`], by which the command line sets it: `KEY=VALUE`, several
//! with commas between them.

use super::BenchConfig;
use crate::bno055::{BusTiming, Magnetometer, MagnetometerHealth, RareStretch, RefreshRates};
use crate::bootloader::Bootloader;
use samd21::board::Ticks;
use std::fmt::Display;
use std::ops::RangeInclusive;
use std::str::FromStr;

/// What the emulated parts are like where real ones differ.
#[derive(Clone, Debug, PartialEq)]
pub struct Hardware {
    /// 7-bit address of the sensor: 0x28 or 0x29, by the level at its address pin.
    pub address: u8,
    /// How long a write to the sensor takes to act.
    pub late_registers: Ticks,
    /// A write to the sensor that follows sooner than this after the one before is lost.
    pub lost_within: Ticks,
    /// Refreshes of the sensor's data registers, each sensor's by itself.
    pub refresh: Option<RefreshRates>,
    /// Age and worth of the magnetic field.
    pub magnetometer: Magnetometer,
    /// Largest deviation of the sensor's clock, relative.
    pub clock_error: f64,
    /// Where the sensor sits, from the pivot along the body's axes, m.
    pub lever_m: [f64; 3],
    /// What runs between a reset and the image.
    pub bootloader: Bootloader,
    /// How long the sensor holds the clock line of its bus.
    pub bus: BusTiming,
}

impl Default for Hardware {
    fn default() -> Self {
        Self {
            address: 0x28,
            late_registers: Ticks::ZERO,
            lost_within: Ticks::ZERO,
            refresh: None,
            magnetometer: Magnetometer::default(),
            clock_error: 0.01,
            lever_m: [0.0; 3],
            bootloader: Bootloader::default(),
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

/// Longest time that a write to the sensor can be late, us.
const LATEST_US: RangeInclusive<u64> = 0..=100_000;

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
        name: "late-registers",
        value: "US",
        what: "how long a write to the sensor takes to act and to be read back, us (0 to 100000)",
        source: "Adafruit_BNO055 waits 10 ms after each write; the data sheet asks for 2 us",
        set: |hardware, text| {
            let late = number(text, LATEST_US).map(Ticks::from_us);
            put(&mut hardware.late_registers, late)
        },
        show: |hardware| hardware.late_registers.as_us().to_string(),
    },
    Key {
        name: "lost-within",
        value: "US",
        what: "a write that follows sooner than this after the one before is lost, us (0 to 100000)",
        source: "Adafruit_CircuitPython_BNO055, issue 91",
        set: |hardware, text| {
            let within = number(text, LATEST_US).map(Ticks::from_us);
            put(&mut hardware.lost_within, within)
        },
        show: |hardware| hardware.lost_within.as_us().to_string(),
    },
    Key {
        name: "refresh",
        value: "together|ACC/GYR/MAG",
        what: "refreshes of accelerometer and gyroscope (10 to 200) and magnetometer (1 to 100), \
               Hz, each with a phase of its own, instead of 100 Hz together",
        source: "unknown in the modes without fusion; 35 Hz is where a set-up takes it for frozen",
        set: |hardware, text| put(&mut hardware.refresh, refresh(text)),
        show: |hardware| {
            hardware.refresh.map_or("together".into(), |rates| {
                format!("{}/{}/{}", rates.acc_hz, rates.gyr_hz, rates.mag_hz)
            })
        },
    },
    Key {
        name: "field-age",
        value: "MS",
        what: "how old the magnetic field is when it is converted, ms (0 to 200)",
        source: "estimate: 15 to 50 ms",
        set: |hardware, text| {
            let age = number(text, 0..=200).map(Ticks::from_ms);
            put(&mut hardware.magnetometer.age, age)
        },
        show: |hardware| (hardware.magnetometer.age.as_us() / 1000).to_string(),
    },
    Key {
        name: "field",
        value: "ok|dead|stuck",
        what: "the magnetic field is right, (0, 0, 0), or the first one for ever",
        source: "users' reports of a field that stays zero",
        set: |hardware, text| {
            let healths = [
                MagnetometerHealth::Ok,
                MagnetometerHealth::Dead,
                MagnetometerHealth::Stuck,
            ];
            let health = one_of(text, healths, MagnetometerHealth::name);
            put(&mut hardware.magnetometer.health, health)
        },
        show: |hardware| hardware.magnetometer.health.name().into(),
    },
    Key {
        name: "sensor-clock",
        value: "PCT",
        what: "largest deviation of the sensor's clock, by which it refreshes, % (0 to 10)",
        source: "estimate: 1 % for the internal oscillator; the data sheet gives none",
        set: |hardware, text| {
            let error = number(text, 0.0..=10.0).map(|pct| pct / 100.0);
            put(&mut hardware.clock_error, error)
        },
        show: |hardware| (hardware.clock_error * 100.0).to_string(),
    },
    Key {
        name: "lever",
        value: "X/Y/Z",
        what: "where the sensor sits from the pivot: forward, right, down, mm (-500 to 500)",
        source: "rigid-body kinematics; the board is wider than the pivot",
        set: |hardware, text| {
            let lever_m = three(text, [-500.0..=500.0, -500.0..=500.0, -500.0..=500.0]);
            put(
                &mut hardware.lever_m,
                lever_m.map(|mm| mm.map(|mm| mm / 1000.0)),
            )
        },
        show: |hardware| {
            let [x, y, z] = hardware.lever_m.map(|m| m * 1000.0);
            format!("{x}/{y}/{z}")
        },
    },
    Key {
        name: "bootloader",
        value: "even|arduino|uf2|none",
        what: "the bootloader; even is Arduino's with 0 and 500 ms instead of 1.8 and 501.8 ms",
        source: "ArduinoCore-samd 1.8.14, the shipped binary; uf2-samdx1, main.c",
        set: |hardware, text| {
            let bootloader = one_of(text, Bootloader::ALL, Bootloader::name);
            put(&mut hardware.bootloader, bootloader)
        },
        show: |hardware| hardware.bootloader.name().into(),
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

    /// The bench as it differs.
    pub(crate) fn fit(&self, bench: &mut BenchConfig) {
        bench.lever_m = self.lever_m;
        let sensor = &mut bench.sensor;
        sensor.address = self.address;
        sensor.bus = self.bus.clone();
        sensor.late_registers = self.late_registers;
        sensor.lost_within = self.lost_within;
        sensor.refresh = self.refresh;
        sensor.magnetometer = self.magnetometer;
        sensor.clock_error = self.clock_error;
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

/// Numbers with slashes between them, each within its limits.
fn three(text: &str, limits: [RangeInclusive<f64>; 3]) -> Result<[f64; 3], String> {
    let parts: Vec<&str> = text.split('/').collect();
    let (&[x, y, z], [in_x, in_y, in_z]) = (parts.as_slice(), limits) else {
        return Err(format!(
            "`{text}` is not three numbers with slashes between them"
        ));
    };
    Ok([number(x, in_x)?, number(y, in_y)?, number(z, in_z)?])
}

fn refresh(text: &str) -> Result<Option<RefreshRates>, String> {
    if text == "together" {
        return Ok(None);
    }
    let [acc_hz, gyr_hz, mag_hz] = three(text, [10.0..=200.0, 10.0..=200.0, 1.0..=100.0])?;
    Ok(Some(RefreshRates {
        acc_hz,
        gyr_hz,
        mag_hz,
    }))
}

/// The one of `all` that has this name.
fn one_of<T: Copy, const N: usize>(
    text: &str,
    all: [T; N],
    name: fn(T) -> &'static str,
) -> Result<T, String> {
    let found = all.into_iter().find(|&one| name(one) == text);
    found.ok_or_else(|| format!("`{text}` is none of them"))
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
        let expected = Hardware {
            address: 0x29,
            bus,
            ..Hardware::default()
        };
        assert_eq!(hardware, expected);
    }

    #[test]
    fn settings_of_the_sensor_reach_the_bench() {
        let hardware: Hardware = "late-registers=20000,lost-within=5000,refresh=62.5/80/20,\
             field-age=30,field=dead,sensor-clock=3,lever=20/-5/-130,bootloader=uf2"
            .parse()
            .unwrap();
        assert_eq!(hardware.bootloader, Bootloader::Uf2);
        let mut bench = BenchConfig::default();
        hardware.fit(&mut bench);
        assert_eq!(bench.lever_m, [0.02, -0.005, -0.13]);
        let sensor = bench.sensor;
        assert_eq!(sensor.late_registers, Ticks::from_ms(20));
        assert_eq!(sensor.lost_within, Ticks::from_ms(5));
        let rates = RefreshRates {
            acc_hz: 62.5,
            gyr_hz: 80.0,
            mag_hz: 20.0,
        };
        assert_eq!(sensor.refresh, Some(rates));
        assert_eq!(sensor.magnetometer.age, Ticks::from_ms(30));
        assert_eq!(sensor.magnetometer.health, MagnetometerHealth::Dead);
        assert_eq!(sensor.clock_error, 0.03);
    }

    /// What nobody sets is as on a bench without any hardware.
    #[test]
    fn the_default_changes_nothing() {
        let mut bench = BenchConfig::default();
        Hardware::default().fit(&mut bench);
        assert_eq!(
            format!("{bench:?}"),
            format!("{:?}", BenchConfig::default())
        );
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
        assert!(refused("strech=3").contains("the keys are address, late-registers,"));
        assert!(refused("stretch").starts_with("stretch=US|MIN..MAX: how long"));
        for bad in [
            "stretch=x",
            "stretch=200..160",
            "stretch=20001",
            "stretch-rare=500",
            "stretch-rare=500@2",
            "stretch-rare=500@NaN",
            "address=40",
            "late-registers=-1",
            "refresh=100/100",
            "refresh=100/100/NaN",
            "refresh=5/100/20",
            "field=gone",
            "field-age=201",
            "sensor-clock=11",
            "lever=0/0",
            "lever=0/0/501",
            "bootloader=grub",
        ] {
            let why = refused(bad);
            assert!(why.starts_with(bad.split('=').next().unwrap()), "{why}");
        }
    }
}
