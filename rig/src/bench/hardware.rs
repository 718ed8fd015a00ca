//! What the emulated parts are like where real ones differ from each other.
//!
//! Every difference has a key ([`keys`]), by which the command line sets it: `KEY=VALUE`, several
//! with commas between them.

mod keys;

pub(crate) use keys::number;
pub use keys::{Key, keys};

use super::BenchConfig;
use crate::bno055;
use crate::bootloader::Bootloader;
use crate::random::{Stream, generator};
use rand::Rng;
use samd21::Options;
use samd21::board::Ticks;
use std::ops::RangeInclusive;
use std::str::FromStr;

/// What the emulated parts are like where real ones differ.
#[derive(Clone, Debug, PartialEq)]
pub struct Hardware {
    /// The sensor: its address, its bus, its registers, its refreshes and its magnetometer.
    pub sensor: bno055::Config,
    /// Largest deviation of the sensor's clock, %.
    pub sensor_clock_percent: f64,
    /// Noise of all three sensors, relative to a typical chip's.
    pub noise: f64,
    /// Shift of the gyroscope's offset by a specific force of 1 g along z, deg/s.
    pub gyro_per_g_deg_s: f64,
    /// Where the sensor sits, from the pivot along the body's axes, m.
    pub lever_m: [f64; 3],
    /// What runs between a reset and the image.
    pub bootloader: Bootloader,
    /// Error of the chip's 48 MHz while no USB host corrects it, %.
    pub clock_percent: f64,
    /// Frequency of the chip's slow oscillator, which the watchdog runs on, relative to 32,768 Hz;
    /// drawn from the rig's seed if it is not given.
    pub slow_clock: Option<f64>,
    /// The chip: its wait states, its synchronisation, its wake-up time, its user row, its flash,
    /// its DSU, its watchdog, the growth of its clock's error, and the host at the other end of its
    /// cable.
    pub chip: Options,
    /// A jumper leads the servo's signal from D3 to D2.
    pub jumper: bool,
    /// Probability that a read or a write of the port is lost on its way.
    pub usb_loss: f64,
}

impl Default for Hardware {
    fn default() -> Self {
        Self {
            sensor: bno055::Config::default(),
            sensor_clock_percent: 1.0,
            noise: 1.0,
            gyro_per_g_deg_s: 0.1,
            lever_m: [0.0; 3],
            bootloader: Bootloader::default(),
            clock_percent: 0.0,
            slow_clock: None,
            chip: Options { wake_up: Ticks::from_us(4), ..Options::default() },
            jumper: true,
            usb_loss: 0.0,
        }
    }
}

/// The slow oscillator by its data sheet, relative to 32,768 Hz.
const SLOW_CLOCK: RangeInclusive<f64> = 0.87..=1.25;

impl Hardware {
    /// Sets what `KEY=VALUE` says.
    ///
    /// # Errors
    /// There is no such key, or it cannot have this value; the text lists the possible ones.
    pub fn set(&mut self, setting: &str) -> Result<(), String> {
        let (name, value) = setting.split_once('=').unwrap_or((setting, ""));
        let (name, value) = (name.trim(), value.trim());
        let Some(key) = keys().find(|key| key.name == name) else {
            let names: Vec<&str> = keys().map(|key| key.name).collect();
            let names = names.join(", ");
            return Err(format!("there is no key `{name}`; the keys are {names}"));
        };
        key.set(self, value).map_err(|why| format!("{name}={}: {}; {why}", key.value, key.what))
    }

    /// The keys as a table in Markdown, with their defaults and sources.
    pub fn table() -> String {
        let default = Self::default();
        let rows = keys().map(|key| {
            let Key { name, value, what, source, .. } = key;
            let value = value.replace('|', "\\|");
            let shown = key.show(&default);
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
            osculp32k_hz: (self.slow_clock.unwrap_or(drawn) * 32_768.0).round() as u32,
            osculp32k_phase: Ticks(dice.random_range(0..CYCLE.0)),
            ..self.chip.clone()
        }
    }

    /// The bench as it differs.
    pub(crate) fn fit(&self, bench: &mut BenchConfig) {
        bench.lever_m = self.lever_m;
        bench.jumper = self.jumper;
        let sensor = &mut bench.sensor;
        *sensor = bno055::Config {
            seed: sensor.seed,
            errors: sensor.errors,
            clock_error: self.sensor_clock_percent / 100.0,
            ..self.sensor.clone()
        };
        let errors = &mut sensor.errors;
        errors.gyro_noise_density *= self.noise;
        errors.acc_noise_density *= self.noise;
        errors.mag_noise_ut *= self.noise;
        errors.gyro_per_g_rad_s = [self.gyro_per_g_deg_s.to_radians(); 3];
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

#[cfg(test)]
mod tests;
