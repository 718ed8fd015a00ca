//! The keys of what can be set, and how their values are read and shown.

use super::Hardware;
use crate::bno055::{RareStretch, RefreshRates};
use crate::bootloader::Bootloader;
use crate::inertial::MagnetometerHealth;
use samd21::board::Ticks;
use samd21::peripherals::UserRow;
use samd21::usb_host::System;
use std::fmt::Display;
use std::ops::RangeInclusive;
use std::str::FromStr;

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
    kind: Kind,
}

/// Sets a choice.
type Set = fn(&mut Hardware);

/// What a value is, between which limits, and where it goes.
#[derive(Clone, Copy, Debug)]
enum Kind {
    Number(f64, f64, fn(&mut Hardware) -> &mut f64),
    /// A count of a unit of time, up to a longest one.
    Time(Ticks, u64, fn(&mut Hardware) -> &mut Ticks),
    /// How long the clock line is held: a number of us, or `MIN..MAX`.
    Hold(fn(&mut Hardware) -> &mut RangeInclusive<u64>),
    /// One of these names, and what it sets.
    Choice(&'static [(&'static str, Set)]),
    /// Anything else: how it is set and shown.
    Own(fn(&mut Hardware, &str) -> Result<(), String>, fn(&Hardware) -> String),
}
use Kind::{Choice, Hold, Number, Own, Time};

/// Longest hold of the clock line that can be set, us.
const LONGEST_HOLD_US: RangeInclusive<u64> = 0..=20_000;

/// All that can be set.
pub fn keys() -> impl Iterator<Item = &'static Key> {
    KEYS.iter()
}

/// Rows of a key: its name, value and kind; what it sets; where its range comes from.
macro_rules! keys {
    ($($name:literal = $value:literal, $kind:expr; $what:literal; $source:literal;)*) => {
        static KEYS: &[Key] = &[$(Key {
            name: $name,
            value: $value,
            what: $what,
            source: $source,
            kind: $kind,
        }),*];
    };
}

keys! {
    "address" = "0x28|0x29",
        Choice(&[("0x28", |h| h.sensor.address = 0x28), ("0x29", |h| h.sensor.address = 0x29)]);
        "address of the sensor on the bus";
        "BNO055 data sheet, 4.6; on many boards the open pin gives 0x29";
    "stretch" = "US|MIN..MAX", Hold(|h| &mut h.sensor.bus.stretch_us);
        "how long the sensor holds SCL in each byte, us (0 to 20000)";
        "Bosch forum, td-p/7270: about 180 us";
    "stretch-rare" = "US@PROBABILITY", Own(rare, shown_rare);
        "a longer hold of some bytes instead, us (0 to 20000), and their share (0 to 1)";
        "Adafruit_BNO055: \"500us or more\" at times";
    "stop-read" = "US|MIN..MAX", Hold(|h| &mut h.sensor.bus.stop_read_us);
        "how long the sensor holds SCL before the STOP after a read, us (0 to 20000)";
        "Atmel's i2c_slave driver releases the line in its interrupt, as between bytes";
    "stop-write" = "US|MIN..MAX", Hold(|h| &mut h.sensor.bus.stop_write_us);
        "how long the sensor holds SCL before the STOP after a write, us (0 to 20000)";
        "SAM D20 data sheet, SERCOM I2C slave: it stretches before the acknowledge";
    "clock" = "PERCENT", Number(-5.0, 5.0, |h| &mut h.clock_percent);
        "error of the chip's 48 MHz without USB, % (-5 to 5)";
        "-3.1 on an ItsyBitsy M0 (atsamd-rs issue 549), -2.6 on a Metro M0 (CircuitPython pull \
         request 892)";
    "clock-drift" = "PPM_PER_S", Own(drift, |h| h.chip.dfll_drift_ppm_s.to_string());
        "growth of that error, ppm/s (-1000 to 1000); a host corrects it while it is there";
        "an estimate: chips warm up";
    "slow-clock" = "RATIO|seed", Own(slow_clock, shown_slow_clock);
        "the watchdog's oscillator, relative to 32768 Hz (0.87 to 1.4), or 0.87 to 1.25 by the \
         seed, as its phase is";
        "SAM D21 data sheet, OSCULP32K: 28.5 to 41 kHz over supply and temperature";
    "wake" = "US", Time(Ticks::from_us(1), 100, |h| &mut h.chip.wake_up);
        "how long the chip takes to wake from sleep, us (0 to 100)";
        "SAM D21 data sheet, wake-up time from IDLE: about 4 us";
    "systick" = "runs|stops",
        Choice(&[("runs", |h| h.chip.systick_stops = false), ("stops", |h| h.chip.systick_stops = true)]);
        "whether SysTick counts while the chip sleeps";
        "SAM D21 data sheet, table 16-4: IDLE 0 stops the CPU's clock; programs that count by \
         SysTick say that it goes on";
    "synchronise" = "CYCLES", Time(Ticks(1), 480, |h| &mut h.chip.syncbusy_hold);
        "how many cycles of 48 MHz a synchronised register takes (0 to 480)";
        "SAM D21 data sheet, 14.3: up to six of the peripheral's clock and three of the bus";
    "bridge" = "CYCLES", Time(Ticks(1), 8, |h| &mut h.chip.bridge_stall);
        "how many cycles of 48 MHz an access over the APB bridges costs beyond those of its \
         instruction (0 to 8)";
        "estimate: the data sheet gives none; rp2040js charges 1 to 2 for its own chip";
    "host" = "bare|linux|windows|macos",
        Choice(&[("bare", |h| h.chip.host = System::Bare), ("linux", |h| h.chip.host = System::Linux),
                  ("windows", |h| h.chip.host = System::Windows), ("macos", |h| h.chip.host = System::MacOs)]);
        "how the computer at the USB cable enumerates the chip and opens its port";
        "Linux, Microsoft's and Apple's drivers, as far as published (samd21::usb_host)";
    "user-row" = "shipped|erased|bootprot",
        Choice(&[("shipped", |h| h.chip.user_row = UserRow::SHIPPED),
                  ("erased", |h| h.chip.user_row = UserRow::ERASED),
                  ("bootprot", |h| h.chip.user_row = UserRow::PROTECTED)]);
        "the chip's fuses: as shipped, erased (the watchdog is always on), or with the \
         bootloader's 8 KB protected";
        "SAM D21 data sheet, NVM user row; uf2-samdx1 issue 107 for erased ones";
    "late-registers" = "US", Time(Ticks::from_us(1), 100_000, |h| &mut h.sensor.late_registers);
        "how long a write to the sensor takes to act and to be read back, us (0 to 100000)";
        "Adafruit_BNO055 waits 10 ms after each write; the data sheet asks for 2 us";
    "lost-within" = "US", Time(Ticks::from_us(1), 100_000, |h| &mut h.sensor.lost_within);
        "a write that follows the one before sooner than this is lost, us (0 to 100000)";
        "Adafruit_CircuitPython_BNO055, issue 91";
    "refresh" = "together|ACC/GYR/MAG", Own(refresh, shown_refresh);
        "refreshes of accelerometer and gyroscope (10 to 200) and magnetometer (1 to 100), Hz, \
         each with a phase of its own, instead of 100 Hz together";
        "nobody has published any for the modes without fusion";
    "field-age" = "MS", Time(Ticks::from_ms(1), 200, |h| &mut h.sensor.magnetometer.age);
        "how old the magnetic field is when it is converted, ms (0 to 200)";
        "estimate: 15 to 50 ms";
    "field" = "ok|dead|stuck",
        Choice(&[("ok", |h| h.sensor.magnetometer.health = MagnetometerHealth::Ok),
                  ("dead", |h| h.sensor.magnetometer.health = MagnetometerHealth::Dead),
                  ("stuck", |h| h.sensor.magnetometer.health = MagnetometerHealth::Stuck)]);
        "the magnetic field is right, (0, 0, 0), or the first one for ever";
        "users' reports of a field that stays zero";
    "sensor-clock" = "PCT", Number(0.0, 10.0, |h| &mut h.sensor_clock_percent);
        "largest deviation of the sensor's clock, by which it refreshes, % (0 to 10)";
        "estimate: 1 % for the internal oscillator; the data sheet gives none";
    "noise" = "RATIO", Number(0.0, 10.0, |h| &mut h.noise);
        "noise of accelerometer, gyroscope and magnetometer, relative to a typical chip's (0 to \
         10)";
        "BNO055 data sheet, table 0-2: typical densities only; parts differ";
    "gyro-per-g" = "DEG_S", Number(-1.0, 1.0, |h| &mut h.gyro_per_g_deg_s);
        "shift of the gyroscope's offset on all axes by 1 g along z, deg/s (-1 to 1)";
        "estimate: up to 0.1 for a gyroscope of this class";
    "lever" = "X/Y/Z", Own(lever, shown_lever);
        "where the sensor sits from the pivot: forward, right, down, mm (-500 to 500)";
        "the sensor's board is wider than the pivot; rigid-body kinematics";
    "bootloader" = "even|arduino|uf2|none",
        Choice(&[("even", |h| h.bootloader = Bootloader::Even),
                  ("arduino", |h| h.bootloader = Bootloader::Arduino),
                  ("uf2", |h| h.bootloader = Bootloader::Uf2),
                  ("none", |h| h.bootloader = Bootloader::None)]);
        "the bootloader; even is Arduino's with 0 and 500 ms instead of 1.8 and 501.8 ms";
        "ArduinoCore-samd 1.8.14, the shipped binary; uf2-samdx1, main.c";
    "jumper" = "yes|no", Choice(&[("yes", |h| h.jumper = true), ("no", |h| h.jumper = false)]);
        "a jumper leads the servo's signal from D3 to D2, where `tvc bringup` times it";
        "tvc bringup asks for one";
    "flash-time" = "RATIO", Number(0.1, 3.0, |h| &mut h.chip.flash_time);
        "how long erasing and writing flash take, relative to the data sheet's longest (0.1 to 3)";
        "SAM D21 data sheet, NVM characteristics: 6 ms a row, 2.5 ms a page at most";
    "crc-cycles" = "CYCLES", Number(1.0, 1000.0, |h| &mut h.chip.crc_word_cycles);
        "how many cycles of the core the DSU's engine takes for a word of flash (1 to 1000)";
        "estimate: the data sheet gives no time; tvc bringup measures it";
    "watchdog" = "ok|dead",
        Choice(&[("ok", |h| h.chip.watchdog_bites = true), ("dead", |h| h.chip.watchdog_bites = false)]);
        "whether the watchdog resets the chip";
        "to see that tvc bringup finds one that does not";
    "usb-loss" = "PROBABILITY", Number(0.0, 0.5, |h| &mut h.usb_loss);
        "the share of reads and writes of the port that are lost on their way (0 to 0.5)";
        "drivers and hubs that drop data; USB itself repeats what is damaged";
}

impl Key {
    /// Sets the value that a text says.
    pub(super) fn set(&self, hardware: &mut Hardware, text: &str) -> Result<(), String> {
        match self.kind {
            Number(least, most, field) => put(field(hardware), number(text, least..=most)),
            Time(unit, most, field) => {
                put(field(hardware), number(text, 0..=most).map(|n| unit * n))
            }
            Hold(field) => put(field(hardware), range(text)),
            Choice(all) => {
                let found = all.iter().find(|(name, _)| *name == text);
                found.ok_or("must be one of these")?.1(hardware);
                Ok(())
            }
            Own(set, _) => set(hardware, text),
        }
    }

    /// The value as it is set.
    pub(super) fn show(&self, hardware: &Hardware) -> String {
        let mut copy = hardware.clone();
        match self.kind {
            Number(.., field) => field(&mut copy).to_string(),
            Time(unit, _, field) => (field(&mut copy).0 / unit.0).to_string(),
            Hold(field) => {
                let (least, most) = field(&mut copy).clone().into_inner();
                if least == most { least.to_string() } else { format!("{least}..{most}") }
            }
            Choice(all) => {
                let found = all.iter().find(|(_, choose)| {
                    choose(&mut copy);
                    copy == *hardware
                });
                found.map_or("own", |(name, _)| name).into()
            }
            Own(_, show) => show(hardware),
        }
    }
}

fn put<T>(field: &mut T, value: Result<T, String>) -> Result<(), String> {
    *field = value?;
    Ok(())
}

/// A number within `limits`.
pub(crate) fn number<T>(text: &str, limits: RangeInclusive<T>) -> Result<T, String>
where
    T: FromStr + PartialOrd + Display,
{
    let number = text.trim().parse().ok();
    number.filter(|number| limits.contains(number)).ok_or_else(|| {
        let (least, most) = (limits.start(), limits.end());
        format!("`{text}` is no number from {least} to {most}")
    })
}

fn range(text: &str) -> Result<RangeInclusive<u64>, String> {
    let (least, most) = text.split_once("..").unwrap_or((text, text));
    let range = number(least, LONGEST_HOLD_US)?..=number(most, LONGEST_HOLD_US)?;
    if range.is_empty() {
        return Err(format!("`{text}` has its larger number first"));
    }
    Ok(range)
}

fn drift(hardware: &mut Hardware, text: &str) -> Result<(), String> {
    put(&mut hardware.chip.dfll_drift_ppm_s, number(text, -1000..=1000))
}

fn rare(hardware: &mut Hardware, text: &str) -> Result<(), String> {
    let read = || {
        let (us, probability) = text.split_once('@').unwrap_or((text, ""));
        let (us, probability) = (number(us, LONGEST_HOLD_US)?, number(probability, 0.0..=1.0)?);
        Ok::<_, String>(RareStretch { us, probability })
    };
    hardware.sensor.bus.stretch_rare = (text != "none").then(read).transpose()?;
    Ok(())
}

fn shown_rare(hardware: &Hardware) -> String {
    let rare = hardware.sensor.bus.stretch_rare;
    rare.map_or("none".into(), |rare| format!("{}@{}", rare.us, rare.probability))
}

fn slow_clock(hardware: &mut Hardware, text: &str) -> Result<(), String> {
    let given = text != "seed";
    put(&mut hardware.slow_clock, given.then(|| number(text, 0.87..=1.4)).transpose())
}

fn shown_slow_clock(hardware: &Hardware) -> String {
    let ratio = hardware.slow_clock;
    ratio.map_or("seed".into(), |ratio| ratio.to_string())
}

/// Numbers with slashes between them, each within its limits.
fn three(text: &str, limits: [RangeInclusive<f64>; 3]) -> Result<[f64; 3], String> {
    let parts: Vec<&str> = text.split('/').collect();
    let (&[x, y, z], [in_x, in_y, in_z]) = (parts.as_slice(), limits) else {
        return Err(format!("`{text}` is not three numbers with slashes between them"));
    };
    Ok([number(x, in_x)?, number(y, in_y)?, number(z, in_z)?])
}

fn refresh(hardware: &mut Hardware, text: &str) -> Result<(), String> {
    hardware.sensor.refresh = if text == "together" {
        None
    } else {
        let [acc_hz, gyr_hz, mag_hz] = three(text, [10.0..=200.0, 10.0..=200.0, 1.0..=100.0])?;
        Some(RefreshRates { acc_hz, gyr_hz, mag_hz })
    };
    Ok(())
}

fn shown_refresh(hardware: &Hardware) -> String {
    let shown = |rates: RefreshRates| format!("{}/{}/{}", rates.acc_hz, rates.gyr_hz, rates.mag_hz);
    hardware.sensor.refresh.map_or("together".into(), shown)
}

fn lever(hardware: &mut Hardware, text: &str) -> Result<(), String> {
    let limits = -500.0..=500.0;
    let lever_m = three(text, [limits.clone(), limits.clone(), limits])?;
    hardware.lever_m = lever_m.map(|mm| mm / 1000.0);
    Ok(())
}

fn shown_lever(hardware: &Hardware) -> String {
    let [x, y, z] = hardware.lever_m.map(|m| m * 1000.0);
    format!("{x}/{y}/{z}")
}
