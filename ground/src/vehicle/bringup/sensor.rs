//! The rows about the sensor and its bus, by what the vehicle streams.

use std::ops::RangeInclusive;
use std::time::Duration;

use anyhow::Result;
use mavlink::dialects::common::{MavSysStatusSensor, RAW_IMU_DATA};
use nalgebra::Vector3;
use tvc_nano::bringup::What;
use tvc_nano::sensor::Kind;

use super::row::{Check, Row, checks};
use super::session::{Heard, Session};
use crate::vehicle::calibrate::keyboard::{Keyboard, Typed};

checks! {
    SENSOR "sensor":
        "nothing usable from the sensor: the state's reason says what; look at power, SDA, SCL \
         and, on a clone, at S0 and S1, which must choose I2C";
    SECOND "second sensor":
        "with SENSOR 2 one of the two sensors gives nothing usable: set SENSOR to the other, 0 or 1, \
         to see its reason";
    ADDRESS "address":
        "the firmware takes either address; on clones an open address pin gives 0x29";
    STOP "stop":
        "the sensor holds the clock before a STOP for another time than expected; up to 500 us \
         the firmware copes. Note it for the rig: --hardware stop-read=US";
    STRETCH "stretch":
        "the sensor holds the clock in each byte for another time than expected. Note it for the \
         rig: --hardware stretch=US";
    BURST "burst":
        "a reading takes too long for its step: shorten the cable, check the pull-ups and I2C_KHZ";
    TICKS "ticks":
        "the processor's time and the servo's timer disagree, perhaps in sleep: report it";
    REFRESH "refresh":
        "the sensor gives new data at another rate: the delay in control changes. Note it for the \
         rig: --hardware refresh=ACC/GYR/MAG";
    FIELD "field":
        "the magnetometer gives nothing: heading drifts, pitch does not need it; for heading take \
         another sensor";
    NOISE "noise": "hold the sensor still; if it is, its supply or the sensor is bad";
    ERRORS "bus errors": "transfers fail: shorten the cable, add an extender, lower I2C_KHZ";
    LOAD "load": "the processor is busier than on the rig: report it with this table";
    SCALE "gyro scale":
        "the gyroscope does not turn as far as gravity does: its range is not what was set";
}

/// What a sound sensor of a kind shows.
struct Expected {
    /// Its 7-bit address.
    address: u32,
    /// Times for which it holds the clock, us: before a STOP, and in each byte.
    stop_us: RangeInclusive<f64>,
    stretch_us: RangeInclusive<f64>,
    /// Longest burst, us.
    burst_us: f32,
    /// New data that are seen in a second, of accelerations and rates. Accelerations are read at
    /// two of three ticks only, so that a part of their refreshes goes unseen.
    acc_hz: RangeInclusive<f64>,
    gyr_hz: RangeInclusive<f64>,
}

/// Of 100 refreshes a second some 48 to 60 are seen in the accelerations, by the length of the
/// bursts, of 50 some 43.
const BNO055: Expected = Expected {
    address: 0x28,
    stop_us: 120.0..=240.0,
    stretch_us: 150.0..=210.0,
    burst_us: 5300.0,
    acc_hz: 45.0..=105.0,
    gyr_hz: 80.0..=105.0,
};

/// It refreshes faster than it is read, but one reading in ten equals the reading before.
const LSM6DS3: Expected = Expected {
    address: 0x6A,
    stop_us: 0.0..=60.0,
    stretch_us: 0.0..=20.0,
    burst_us: 900.0,
    acc_hz: 60.0..=300.0,
    gyr_hz: 100.0..=300.0,
};

/// The checks that need samples.
const OF_SAMPLES: [Check; 8] = [ADDRESS, STOP, STRETCH, BURST, TICKS, REFRESH, FIELD, NOISE];

/// The sensor's rows, by what was heard in the last seconds.
///
/// # Errors
/// The vehicle no longer answers.
pub fn rows(session: &mut Session) -> Result<Vec<Row>> {
    let heard = std::mem::take(&mut session.heard);
    let mut rows = Vec::new();
    let rate = session.parameter("SRV_RATE_HZ")?.unwrap_or(50.0);
    let kind = Kind::of(session.parameter("SENSOR")?.unwrap_or_default());
    let expected = if kind == Kind::Lsm6ds3 { &LSM6DS3 } else { &BNO055 };
    let stretch = session.parameter("I2C_STRETCH_US")?;
    let Heard { samples, status, bursts, .. } = &heard;
    let state = session.link.client().state_name();
    if samples.len() < 100 {
        let reason = session.reason();
        rows.push(SENSOR.failed("150 samples a second", format!("{state}: {reason}")));
        rows.extend(OF_SAMPLES.map(|check| check.skipped("needs the sensor")));
    } else {
        rows.push(SENSOR.of("samples", format!("{} samples, {state}", samples.len()), true));
        let summary = session.measure(What::Bus)?.unwrap_or_default();
        let (address, stop) = (summary >> 24, summary & 0xFF_FFFF);
        let found = format!("{address:#04x}");
        rows.push(ADDRESS.of(
            format!("{:#04x}", expected.address),
            found,
            address == expected.address,
        ));
        rows.push(STOP.within(stop.into(), expected.stop_us.clone(), "us"));
        if let Some(us) = stretch {
            rows.push(STRETCH.within(us.into(), expected.stretch_us.clone(), "us"));
        }
        rows.push(burst(bursts, expected.burst_us));
        rows.push(ticks(samples, rate.into()));
        rows.push(refresh(samples, expected));
        rows.push(if kind.description().has_mag {
            field(samples)
        } else {
            FIELD.skipped("the sensor has no magnetometer")
        });
        rows.push(noise(samples));
    }
    if let (Some(first), Some(last)) = (status.first(), status.last()) {
        if kind == Kind::Both {
            let gyro = MavSysStatusSensor::MAV_SYS_STATUS_SENSOR_3D_GYRO2;
            let stands_by = last.onboard_control_sensors_health.contains(gyro);
            let found = if stands_by { "stands by" } else { "missing" };
            rows.push(SECOND.of("stands by", found, stands_by));
        }
        let errors = last.errors_count3.wrapping_sub(first.errors_count3);
        let repairs = last.errors_count4.wrapping_sub(first.errors_count4);
        rows.push(ERRORS.of(
            "0 errors, 0 repairs",
            format!("{errors} errors, {repairs} repairs"),
            errors == 0 && repairs == 0,
        ));
        rows.push(LOAD.within(f64::from(last.load) * 0.1, 4.0..=60.0, "%"));
    }
    Ok(rows)
}

fn burst(bursts: &[[f32; 3]], most_us: f32) -> Row {
    let Some([mean, longest, _]) = bursts.last() else {
        return BURST.skipped("the vehicle has told none");
    };
    let found = format!("mean {mean:.0} us, longest {longest:.0} us");
    BURST.of(format!("{most_us} us at most"), found, *longest <= most_us)
}

/// Pairs of samples of successive ticks.
fn pairs(samples: &[RAW_IMU_DATA]) -> impl Iterator<Item = (&RAW_IMU_DATA, &RAW_IMU_DATA)> {
    let pairs = samples.iter().zip(samples.iter().skip(1));
    pairs.filter(|(a, b)| (2_000..9_000).contains(&b.time_usec.wrapping_sub(a.time_usec)))
}

fn ticks(samples: &[RAW_IMU_DATA], rate_hz: f64) -> Row {
    let apart = |(a, b): (&RAW_IMU_DATA, &RAW_IMU_DATA)| (b.time_usec - a.time_usec) as f64;
    let (sum, count) =
        pairs(samples).fold((0.0, 0.0), |(sum, count), pair| (sum + apart(pair), count + 1.0));
    // Up to three ticks a frame, or one in several frames: a whole number of either.
    let (mean, frame) = (sum / f64::max(count, 1.0), 1e6 / rate_hz);
    let ideal =
        if mean < frame { frame / (frame / mean).round() } else { frame * (mean / frame).round() };
    TICKS.of(
        format!("{ideal:.2} us +-0.05 %"),
        format!("{mean:.2} us"),
        (mean / ideal - 1.0).abs() <= 5e-4,
    )
}

/// Changes a second of the liveliest axis. By single axes, since a refresh in the midst of a burst
/// shows in some of its words now and in the others next time.
fn changes(samples: &[RAW_IMU_DATA], of: impl Fn(&RAW_IMU_DATA) -> [i16; 3]) -> f64 {
    let (mut changed, mut time_us) = ([0.0_f64; 3], 0.0);
    for (a, b) in pairs(samples) {
        for (axis, changed) in changed.iter_mut().enumerate() {
            *changed += f64::from(u8::from(of(a)[axis] != of(b)[axis]));
        }
        time_us += (b.time_usec - a.time_usec) as f64;
    }
    changed.into_iter().fold(0.0, f64::max) * 1e6 / f64::max(time_us, 1.0)
}

/// The magnetometer's is told and not judged: its noise is less than a count.
fn refresh(samples: &[RAW_IMU_DATA], expected: &Expected) -> Row {
    let acc = changes(samples, acceleration);
    let gyr = changes(samples, rate);
    let mag = changes(samples, magnetic);
    let text = |hz: &RangeInclusive<f64>| format!("{} to {}", hz.start(), hz.end());
    REFRESH.of(
        format!(
            "acc {}, gyr {} Hz (equal readings count as one)",
            text(&expected.acc_hz),
            text(&expected.gyr_hz)
        ),
        format!("acc {acc:.0}, gyr {gyr:.0}, mag {mag:.0} Hz or more"),
        expected.acc_hz.contains(&acc) && expected.gyr_hz.contains(&gyr),
    )
}

fn acceleration(sample: &RAW_IMU_DATA) -> [i16; 3] {
    [sample.xacc, sample.yacc, sample.zacc]
}

fn rate(sample: &RAW_IMU_DATA) -> [i16; 3] {
    [sample.xgyro, sample.ygyro, sample.zgyro]
}

fn magnetic(sample: &RAW_IMU_DATA) -> [i16; 3] {
    [sample.xmag, sample.ymag, sample.zmag]
}

fn field(samples: &[RAW_IMU_DATA]) -> Row {
    const EXPECTED: &str = "15 to 120 uT";
    if samples.iter().all(|sample| magnetic(sample) == [0; 3]) {
        return FIELD.failed(EXPECTED, "all readings are zero");
    }
    let norm = |m: &RAW_IMU_DATA| {
        let square = magnetic(m).map(|axis| f64::from(axis).powi(2));
        square.iter().sum::<f64>().sqrt() / 16.0
    };
    let mean = samples.iter().map(norm).sum::<f64>() / samples.len() as f64;
    let found = format!("{mean:.0} uT");
    FIELD.of(EXPECTED, found, (15.0..=120.0).contains(&mean))
}

fn noise(samples: &[RAW_IMU_DATA]) -> Row {
    let acc = spread(samples, acceleration) / 100.0;
    let gyr = spread(samples, rate) / 16.0;
    NOISE.of(
        "acc 0.2 m/s2, gyr 0.6 deg/s at most (standard deviation)",
        format!("acc {acc:.3} m/s2, gyr {gyr:.3} deg/s"),
        acc <= 0.2 && gyr <= 0.6,
    )
}

/// The largest standard deviation of three axes.
fn spread(samples: &[RAW_IMU_DATA], of: impl Fn(&RAW_IMU_DATA) -> [i16; 3]) -> f64 {
    let n = samples.len().max(1) as f64;
    let axis = |axis: usize| {
        let values = || samples.iter().map(|m| f64::from(of(m)[axis]));
        let mean = values().sum::<f64>() / n;
        (values().map(|value| (value - mean).powi(2)).sum::<f64>() / n).sqrt()
    };
    [0, 1, 2].map(axis).into_iter().fold(0.0, f64::max)
}

/// A turn by hand: the gyroscope's integral against the turn of gravity.
///
/// # Errors
/// The rig stopped.
pub fn scale(session: &mut Session, hands: bool) -> Result<Row> {
    const REST: Duration = Duration::from_millis(700);
    const PATIENCE: Duration = Duration::from_secs(60);
    if !hands {
        return Ok(SCALE.skipped("needs hands: run without --no-hands, at a board"));
    }
    eprintln!("lay the sensor flat and hold it still; then press Enter");
    let keyboard = Keyboard::listen();
    let pressed = |_: &mut Session| keyboard.poll() != Typed::Nothing;
    session.wait(PATIENCE, pressed)?;
    session.heard = Heard::default();
    session.listen(REST)?;
    let at_rest = session.heard.samples.len();
    eprintln!("turn it by 90 deg onto its edge, hold it still; then press Enter");
    session.wait(PATIENCE, pressed)?;
    let before_end = session.heard.samples.len();
    session.listen(REST)?;
    let samples = &session.heard.samples;
    if at_rest < 50 || samples.len() < before_end + 50 {
        return Ok(SCALE.skipped("needs the sensor"));
    }
    let acc = |m: &RAW_IMU_DATA| Vector3::from(acceleration(m)).map(f64::from);
    let gyr = |m: &RAW_IMU_DATA| Vector3::from(rate(m)).map(f64::from) / 16.0;
    let (from, to) = (mean(&samples[..at_rest], acc), mean(&samples[before_end..], acc));
    let bias = mean(&samples[..at_rest], gyr);
    let mut turned = Vector3::zeros();
    for pair in samples.windows(2) {
        let dt = pair[1].time_usec.wrapping_sub(pair[0].time_usec) as f64 * 1e-6;
        turned += (gyr(&pair[1]) - bias) * dt;
    }
    let tilted = (from.dot(&to) / (from.norm_squared() * to.norm_squared()).sqrt())
        .clamp(-1.0, 1.0)
        .acos()
        .to_degrees();
    let turned = turned.norm();
    Ok(SCALE.of(
        "as far as gravity, +-3 deg, 60 deg or more",
        format!("gyro {turned:.1} deg, gravity {tilted:.1} deg"),
        tilted > 60.0 && (turned - tilted).abs() <= 3.0,
    ))
}

fn mean(samples: &[RAW_IMU_DATA], of: impl Fn(&RAW_IMU_DATA) -> Vector3<f64>) -> Vector3<f64> {
    samples.iter().map(of).sum::<Vector3<f64>>() / samples.len().max(1) as f64
}
