//! The keys for what the sensor does with its registers, where it sits, and which bootloader runs.

use super::{Key, number, put};
use crate::bno055::{MagnetometerHealth, RefreshRates};
use crate::bootloader::Bootloader;
use samd21::board::Ticks;
use std::ops::RangeInclusive;

/// Longest time that a write to the sensor can be late, us.
const LATEST_US: RangeInclusive<u64> = 0..=100_000;

pub(super) const KEYS: &[Key] = &[
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
        what: "a write that follows the one before sooner than this is lost, us (0 to 100000)",
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
        source: "nobody has published any for the modes without fusion",
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
        name: "noise",
        value: "RATIO",
        what: "noise of accelerometer, gyroscope and magnetometer, relative to a typical chip's \
               (0 to 10)",
        source: "BNO055 data sheet, table 0-2: typical densities only; parts differ",
        set: |hardware, text| put(&mut hardware.noise, number(text, 0.0..=10.0)),
        show: |hardware| hardware.noise.to_string(),
    },
    Key {
        name: "gyro-per-g",
        value: "DEG_S",
        what: "shift of the gyroscope's offset on all axes by 1 g along z, deg/s (-1 to 1)",
        source: "estimate: up to 0.1 for a gyroscope of this class",
        set: |hardware, text| put(&mut hardware.gyro_per_g_deg_s, number(text, -1.0..=1.0)),
        show: |hardware| hardware.gyro_per_g_deg_s.to_string(),
    },
    Key {
        name: "lever",
        value: "X/Y/Z",
        what: "where the sensor sits from the pivot: forward, right, down, mm (-500 to 500)",
        source: "the sensor's board is wider than the pivot; rigid-body kinematics",
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
];

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

#[cfg(test)]
mod tests {
    use super::super::Hardware;
    use super::*;
    use crate::bench::BenchConfig;

    #[test]
    fn settings_of_the_sensor_reach_the_bench() {
        let hardware: Hardware = "late-registers=20000,lost-within=5000,refresh=62.5/80/20,\
             field-age=30,field=dead,sensor-clock=3,noise=3,gyro-per-g=0.1,lever=20/-5/-130,bootloader=uf2"
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
        let typical = crate::bno055::ImuErrors::TYPICAL;
        assert_eq!(
            sensor.errors.gyro_noise_density,
            3.0 * typical.gyro_noise_density
        );
        assert_eq!(sensor.errors.mag_noise_ut, 3.0 * typical.mag_noise_ut);
        let per_g = sensor.errors.gyro_per_g_rad_s;
        assert!(
            per_g
                .iter()
                .all(|shift| (shift.to_degrees() - 0.1).abs() < 1e-12)
        );
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
    fn what_is_impossible_is_refused() {
        for bad in [
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
            let why = bad.parse::<Hardware>().unwrap_err();
            assert!(why.starts_with(bad.split('=').next().unwrap()), "{why}");
        }
    }
}
