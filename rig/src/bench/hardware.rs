//! What the emulated parts are like where real ones differ from each other.
//!
//! Every difference has a key ([`keys`]), by which the command line sets it: `KEY=VALUE`, several
//! with commas between them.

mod board;
mod sensor;

use super::BenchConfig;
use crate::bno055::{BusTiming, Magnetometer, RareStretch, RefreshRates};
use crate::bootloader::Bootloader;
use crate::random::{Stream, generator};
use rand::Rng;
use samd21::Options;
use samd21::board::Ticks;
use samd21::peripherals::UserRow;
use samd21::usb_host::System;
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
    /// Noise of all three sensors, relative to a typical chip's.
    pub noise: f64,
    /// Shift of the gyroscope's offset by a specific force of 1 g along z, deg/s.
    pub gyro_per_g_deg_s: f64,
    /// Where the sensor sits, from the pivot along the body's axes, m.
    pub lever_m: [f64; 3],
    /// What runs between a reset and the image.
    pub bootloader: Bootloader,
    /// How long the sensor holds the clock line of its bus.
    pub bus: BusTiming,
    /// Error of the chip's 48 MHz while no USB host corrects it, %.
    pub clock_percent: f64,
    /// How fast that error grows, ppm/s.
    pub clock_drift_ppm_s: i32,
    /// Frequency of the chip's slow oscillator, which the watchdog runs on, relative to 32,768 Hz;
    /// drawn from the rig's seed if it is not given.
    pub slow_clock: Option<f64>,
    /// How long the chip takes to wake from sleep, us.
    pub wake_us: u64,
    /// The operating system at the other end of the USB cable.
    pub host: System,
    /// The chip's user row.
    pub user_row: UserRow,
    /// A jumper leads the servo's signal from D3 to D2.
    pub jumper: bool,
    /// How long erasing and writing flash take, relative to the data sheet's longest.
    pub flash_time: f64,
    /// The watchdog resets the chip.
    pub watchdog_works: bool,
    /// Probability that a read or a write of the port is lost on its way.
    pub usb_loss: f64,
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
            noise: 1.0,
            gyro_per_g_deg_s: 0.0,
            lever_m: [0.0; 3],
            bootloader: Bootloader::default(),
            bus: BusTiming::default(),
            clock_percent: 0.0,
            clock_drift_ppm_s: 0,
            slow_clock: None,
            wake_us: 4,
            host: System::Bare,
            user_row: UserRow::SHIPPED,
            jumper: true,
            flash_time: 1.0,
            watchdog_works: true,
            usb_loss: 0.0,
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

/// The slow oscillator by its data sheet, relative to 32,768 Hz.
const SLOW_CLOCK: RangeInclusive<f64> = 0.87..=1.25;
/// Longest hold of the clock line that can be set, us.
const LONGEST_HOLD_US: RangeInclusive<u64> = 0..=20_000;

/// The user rows that can be chosen.
const USER_ROWS: [(&str, UserRow); 3] = [
    ("shipped", UserRow::SHIPPED),
    ("erased", UserRow::ERASED),
    ("bootprot", UserRow::PROTECTED),
];

/// The keys for the chips, the bus between them and the host.
const KEYS: &[Key] = &[
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
    Key {
        name: "clock",
        value: "PERCENT",
        what: "error of the chip's 48 MHz without USB, % (-5 to 5)",
        source: "-3.1 on an ItsyBitsy M0 (atsamd-rs issue 549), -2.6 on a Metro M0 (CircuitPython \
                 pull request 892)",
        set: |hardware, text| put(&mut hardware.clock_percent, number(text, -5.0..=5.0)),
        show: |hardware| hardware.clock_percent.to_string(),
    },
    Key {
        name: "clock-drift",
        value: "PPM_PER_S",
        what: "growth of that error, ppm/s (-1000 to 1000); a host corrects it while it is there",
        source: "an estimate: chips warm up",
        set: |hardware, text| put(&mut hardware.clock_drift_ppm_s, number(text, -1000..=1000)),
        show: |hardware| hardware.clock_drift_ppm_s.to_string(),
    },
    Key {
        name: "slow-clock",
        value: "RATIO|seed",
        what: "the watchdog's oscillator, relative to 32768 Hz (0.87 to 1.4), or 0.87 to 1.25 by \
               the seed, as its phase is",
        source: "SAM D21 data sheet, OSCULP32K: 28.5 to 41 kHz over supply and temperature",
        set: |hardware, text| {
            let ratio = match text {
                "seed" => Ok(None),
                _ => number(text, 0.87..=1.4).map(Some),
            };
            put(&mut hardware.slow_clock, ratio)
        },
        show: |hardware| {
            hardware
                .slow_clock
                .map_or("seed".into(), |ratio| ratio.to_string())
        },
    },
    Key {
        name: "wake",
        value: "US",
        what: "how long the chip takes to wake from sleep, us (0 to 100)",
        source: "SAM D21 data sheet, wake-up time from IDLE: about 4 us",
        set: |hardware, text| put(&mut hardware.wake_us, number(text, 0..=100)),
        show: |hardware| hardware.wake_us.to_string(),
    },
    Key {
        name: "host",
        value: "bare|linux|windows|macos",
        what: "how the computer at the USB cable enumerates the chip and opens its port",
        source: "Linux, Microsoft's and Apple's drivers, as far as published (samd21::usb_host)",
        set: |hardware, text| {
            let found = System::ALL.into_iter().find(|host| host.name() == text);
            let unknown = "must be one of these".to_owned();
            put(&mut hardware.host, found.ok_or(unknown))
        },
        show: |hardware| hardware.host.name().into(),
    },
    Key {
        name: "user-row",
        value: "shipped|erased|bootprot",
        what: "the chip's fuses: as shipped, erased (the watchdog is always on), or with the \
               bootloader's 8 KB protected",
        source: "SAM D21 data sheet, NVM user row; uf2-samdx1 issue 107 for erased ones",
        set: |hardware, text| {
            let found = USER_ROWS.iter().find(|(name, _)| *name == text);
            let unknown = "must be one of these".to_owned();
            put(
                &mut hardware.user_row,
                found.map(|(_, row)| *row).ok_or(unknown),
            )
        },
        show: |hardware| {
            let found = USER_ROWS.iter().find(|(_, row)| *row == hardware.user_row);
            found.map_or("own", |(name, _)| name).into()
        },
    },
];

/// All that can be set.
pub fn keys() -> impl Iterator<Item = &'static Key> {
    KEYS.iter().chain(sensor::KEYS).chain(board::KEYS)
}

impl Hardware {
    /// Sets what `KEY=VALUE` says.
    ///
    /// # Errors
    /// There is no such key, or its value is none of those that are possible; the text lists them.
    pub fn set(&mut self, setting: &str) -> Result<(), String> {
        let (name, value) = setting.split_once('=').unwrap_or((setting, ""));
        let (name, value) = (name.trim(), value.trim());
        let Some(key) = keys().find(|key| key.name == name) else {
            let names: Vec<&str> = keys().map(|key| key.name).collect();
            let names = names.join(", ");
            return Err(format!("there is no key `{name}`; the keys are {names}"));
        };
        (key.set)(self, value).map_err(|why| format!("{name}={}: {}; {why}", key.value, key.what))
    }

    /// The keys, a line each, with their values and defaults.
    pub fn help() -> String {
        let default = Self::default();
        let lines = keys().map(|key| {
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

    /// The keys as a table in Markdown, with their defaults and sources.
    pub fn table() -> String {
        let default = Self::default();
        let rows = keys().map(|key| {
            let Key {
                name,
                value,
                what,
                source,
                ..
            } = key;
            let value = value.replace('|', "\\|");
            let shown = (key.show)(&default);
            format!("| `{name}` | `{value}` | {what} | {shown} | {source} |\n")
        });
        let head = "| key | value | what | default | source |\n|---|---|---|---|---|\n";
        head.to_owned() + &rows.collect::<String>()
    }

    /// The chip as it differs, with what is random in it from this seed.
    pub(crate) fn chip(&self, seed: u64) -> Options {
        /// A cycle of the watchdog's 1,024 Hz.
        const CYCLE: Ticks = Ticks(Ticks::PER_SECOND / 1024);
        let mut dice = generator(seed, Stream::SlowClock);
        let drawn = dice.random_range(SLOW_CLOCK);
        Options {
            seed,
            dfll_error_ppm: (self.clock_percent * 1e4).round() as i32,
            dfll_drift_ppm_s: self.clock_drift_ppm_s,
            osculp32k_hz: (self.slow_clock.unwrap_or(drawn) * 32_768.0).round() as u32,
            osculp32k_phase: Ticks(dice.random_range(0..CYCLE.0)),
            wake_up: Ticks::from_us(self.wake_us),
            host: self.host,
            user_row: self.user_row,
            flash_time_percent: (self.flash_time * 100.0).round() as u32,
            watchdog_bites: self.watchdog_works,
            ..Options::default()
        }
    }

    /// The bench as it differs.
    pub(crate) fn fit(&self, bench: &mut BenchConfig) {
        bench.lever_m = self.lever_m;
        bench.jumper = self.jumper;
        let sensor = &mut bench.sensor;
        sensor.address = self.address;
        sensor.bus = self.bus.clone();
        sensor.late_registers = self.late_registers;
        sensor.lost_within = self.lost_within;
        sensor.refresh = self.refresh;
        sensor.magnetometer = self.magnetometer;
        sensor.clock_error = self.clock_error;
        let errors = &mut sensor.errors;
        errors.gyro_noise_density *= self.noise;
        errors.acc_noise_density *= self.noise;
        errors.mag_noise_ut *= self.noise;
        if self.gyro_per_g_deg_s != 0.0 {
            sensor.errors.gyro_per_g_rad_s = [self.gyro_per_g_deg_s.to_radians(); 3];
        }
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
        let expected = Hardware {
            address: 0x29,
            bus,
            ..Hardware::default()
        };
        assert_eq!(hardware, expected);
    }

    #[test]
    fn the_chip_gets_what_is_set() {
        let hardware =
            "clock=-3.1,clock-drift=20,slow-clock=0.87,wake=7,host=windows,user-row=bootprot"
                .parse();
        let options = hardware.map(|hardware: Hardware| hardware.chip(1));
        let expected = Options {
            dfll_error_ppm: -31_000,
            dfll_drift_ppm_s: 20,
            osculp32k_hz: 28_508,
            osculp32k_phase: Hardware::default().chip(1).osculp32k_phase,
            wake_up: Ticks::from_us(7),
            seed: 1,
            host: System::Windows,
            user_row: UserRow::PROTECTED,
            ..Options::default()
        };
        assert_eq!(options, Ok(expected));
    }

    #[test]
    fn the_slow_oscillator_follows_the_seed() {
        let drawn: Vec<Options> = (0..100)
            .map(|seed| Hardware::default().chip(seed))
            .collect();
        assert_eq!(drawn[7], Hardware::default().chip(7));
        let spread = |of: fn(&Options) -> f64, least: f64, most: f64| {
            let all = || drawn.iter().map(of);
            let (low, high) = (all().fold(most, f64::min), all().fold(least, f64::max));
            let tenth = (most - least) / 10.0;
            assert!((least..least + tenth).contains(&low), "{low}");
            assert!((most - tenth..=most).contains(&high), "{high}");
        };
        spread(|chip| f64::from(chip.osculp32k_hz), 28_508.0, 40_960.0);
        spread(|chip| chip.osculp32k_phase.as_us_f64(), 0.0, 976.6);
        let ideal = Options {
            osculp32k_hz: 32_768,
            osculp32k_phase: drawn[1].osculp32k_phase,
            wake_up: Ticks::from_us(4),
            seed: 1,
            ..Options::default()
        };
        let given: Hardware = "slow-clock=1".parse().unwrap();
        assert_eq!(given.chip(1), ideal);
    }

    #[test]
    fn a_default_that_is_shown_can_be_given() {
        let default = Hardware::default();
        for key in keys() {
            let shown = (key.show)(&default);
            if shown == "none" {
                continue;
            }
            let parsed = format!("{}={shown}", key.name).parse();
            assert_eq!(parsed, Ok(default.clone()), "{}", key.name);
        }
    }

    /// `HARDWARE=overwrite` writes the page's table anew.
    #[test]
    fn the_page_of_the_documentation_has_the_table() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/hardware.md");
        let page = std::fs::read_to_string(path).unwrap();
        let (text, _) = page.split_once("| key |").unwrap();
        let wanted = text.to_owned() + &Hardware::table();
        if std::env::var_os("HARDWARE").is_some_and(|value| value == "overwrite") {
            std::fs::write(path, &wanted).unwrap();
        } else {
            assert_eq!(
                page, wanted,
                "HARDWARE=overwrite cargo test -p rig writes it anew"
            );
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
