//! The parts of a sound vehicle and the world that it stands in, drawn.

use std::f64::consts::TAU;
use std::ops::Range;

use rand::Rng;
use rand::seq::IndexedRandom;
use tvc_nano::Axis;

use super::super::Phase;
use crate::bench::EarthField;
use crate::disturbance::Temperature;
use crate::fly::flight::{ServoKind, Setup};
use crate::inertial::{ImuErrors, STANDARD_GRAVITY_M_S2};

/// Largest offsets by the data sheet: of the accelerometer, g, and of the gyroscope, deg/s.
const ACC_OFFSET_G: f64 = 0.08;
const GYR_OFFSET_DEG_S: f64 = 3.0;
/// What is left of the accelerometer's offset by a calibration, and what the self-test takes
/// without one, g.
const CALIBRATED_G: f64 = 0.005;
const UNCALIBRATED_G: f64 = 0.02;
/// Iron near the sensor, uT.
const IRON_UT: f64 = 40.0;

/// What was drawn, beside what stands in the setup.
pub(super) struct Parts {
    /// All of it in words.
    pub(super) words: String,
    /// Rate of the servo frame.
    pub(super) frame_hz: f64,
    /// Tilt at which the vehicle is held, and from which it is released, rad.
    pub(super) tilt_rad: [f64; Axis::COUNT],
}

/// A number as likely in each octave of a range.
pub(super) fn octaves(range: Range<f64>, dice: &mut impl Rng) -> f64 {
    let all = (range.end / range.start).ln();
    range.start * (all * dice.random_range(0.0..1.0)).exp()
}

/// Three numbers to either side of zero.
pub(super) fn three(limit: f64, dice: &mut impl Rng) -> [f64; 3] {
    [(); 3].map(|()| dice.random_range(-limit..=limit))
}

/// Gives a vehicle parts as sound ones may be, with those that `given` names as it says. Those
/// exist.
pub(super) fn draw(
    setup: &mut Setup,
    phase: Phase,
    given: &str,
    warms_up: bool,
    dice: &mut impl Rng,
) -> Parts {
    let mut hardware = hardware(phase, dice);
    let frame_hz = match setup.servo {
        ServoKind::S3003 => 50.0,
        ServoKind::Digital => *[300.0, 300.0, 200.0, 333.0].choose(dice).unwrap_or(&300.0),
    };
    let mut parameters = vec![("SRV_RATE_HZ", frame_hz)];
    // A slow bus, and ticks in every third frame of 3 ms, have time for no more.
    let is_slow = dice.random_bool(0.15);
    let longest_us = match frame_hz {
        _ if is_slow => 200,
        333.0 => 270,
        _ => 340,
    };
    if is_slow {
        parameters.push(("I2C_KHZ", 100.0));
    }
    if is_slow || dice.random_bool(0.7) {
        hardware.push(stretch(20..longest_us, dice));
    }
    hardware.push(given.to_owned());
    let hardware = hardware.join(",");
    setup.rig.hardware = hardware.parse().expect("parts are drawn within their ranges");

    let errors = errors(dice);
    setup.rig.bench.sensor.errors = errors;
    if let Some(stored) = &mut setup.rig.stored {
        let offsets = errors.acc_offset_m_s2.into_iter();
        for (name, offset) in ["CAL_ACC_OX", "CAL_ACC_OY", "CAL_ACC_OZ"].iter().zip(offsets) {
            let left = CALIBRATED_G * STANDARD_GRAVITY_M_S2;
            let known = offset + dice.random_range(-left..left);
            let set = stored.set(name, known as f32);
            debug_assert!(set.is_ok(), "{set:?}");
        }
    }
    setup.rig.bench.field = EarthField {
        strength_ut: dice.random_range(20.0..65.0),
        dip_rad: dice.random_range(-1.4..1.4),
        declination_rad: dice.random_range(0.0..TAU),
    };
    setup.rig.bench.heading_rad = dice.random_range(0.0..TAU);
    let temperature = (warms_up || dice.random_bool(0.3)).then(|| temperature(dice));
    setup.rig.bench.disturbances.temperature = temperature;
    let side = |most: f64, dice: &mut _| {
        let tilt = Rng::random_range(dice, 0.1..most);
        if Rng::random(dice) { tilt } else { -tilt }
    };
    let roll_rad = match setup.rig.bench.axes() {
        1 => 0.0,
        _ => side(0.3, dice),
    };
    let tilt_rad = [side(0.5, dice), roll_rad];
    let offsets = errors.gyro_bias_rad_s.unwrap_or_default();
    let offsets = offsets.map(|rad_s| format!("{:.1}", rad_s.to_degrees())).join("/");
    let mut words = format!("{hardware}; {frame_hz} Hz, gyro offset {offsets} deg/s");
    for (name, value) in &parameters[1..] {
        words += &format!(", {name} {value}");
    }
    if let Some(t) = temperature {
        words += &format!(", {:.0} to {:.0} C in {:.0} s", t.from_c, t.to_c, t.time_constant_s);
    }
    let named = parameters.into_iter();
    setup.parameters.extend(named.map(|(name, value)| (name.to_owned(), value as f32)));
    Parts { words, frame_hz, tilt_rad }
}

/// Settings of `--hardware`.
fn hardware(phase: Phase, dice: &mut impl Rng) -> Vec<String> {
    let host = ["bare", "linux", "windows", "macos"].choose(dice).unwrap_or(&"bare");
    let mut settings = vec![
        "sensor-clock=3".to_owned(),
        format!("noise={:.2}", octaves(0.5..3.0, dice)),
        format!("flash-time={:.2}", octaves(0.3..1.0, dice)),
        format!("slow-clock={:.3}", dice.random_range(0.87..1.25)),
        format!("clock={:.2}", dice.random_range(-3.1..3.1)),
        format!("wake={}", dice.random_range(2..=10)),
        format!("host={host}"),
        format!("gyro-per-g={:.2}", dice.random_range(-0.1..0.1)),
        format!("field-age={}", dice.random_range(0..=60)),
    ];
    if dice.random() {
        // A loop flies with rates that are refreshed so often.
        let slowest_hz = if phase == Phase::Flight { 35.0 } else { 10.0 };
        let [acc_hz, gyr_hz] = [10.0, slowest_hz].map(|slowest| octaves(slowest..200.0, dice));
        let mag_hz = octaves(1.0..100.0, dice);
        settings.push(format!("refresh={acc_hz:.1}/{gyr_hz:.1}/{mag_hz:.1}"));
    }
    if dice.random_bool(0.3) {
        settings.push(format!("late-registers={}", dice.random_range(0..40_000)));
    }
    if dice.random_bool(0.5) {
        settings.push(format!("stop-read={}", dice.random_range(0..=300)));
    }
    if dice.random_bool(0.3) {
        settings.push(format!("stop-write={}", dice.random_range(0..=200)));
    }
    for other in ["address=0x29", "bootloader=arduino", "bootloader=uf2", "user-row=bootprot"] {
        if dice.random_bool(0.3) {
            settings.push(other.into());
        }
    }
    settings
}

/// A sensor that holds each byte about as long as the others, or each for another time.
fn stretch(range_us: Range<u64>, dice: &mut impl Rng) -> String {
    let least = dice.random_range(range_us.clone());
    let most = dice.random_range(least..range_us.end.min(least + 150));
    format!("stretch={least}..{most}")
}

fn errors(dice: &mut impl Rng) -> ImuErrors {
    let acc_g = if dice.random() { ACC_OFFSET_G } else { UNCALIBRATED_G };
    let mut soft_iron = ImuErrors::NONE.soft_iron;
    for part in soft_iron.as_flattened_mut() {
        *part += dice.random_range(-0.1..0.1);
    }
    ImuErrors {
        gyro_bias_rad_s: Some(three(GYR_OFFSET_DEG_S.to_radians(), dice)),
        gyro_scale: three(0.01, dice),
        acc_offset_m_s2: three(acc_g * STANDARD_GRAVITY_M_S2, dice),
        acc_scale: three(0.01, dice),
        hard_iron_ut: three(IRON_UT, dice),
        soft_iron,
        ..ImuErrors::TYPICAL
    }
}

fn temperature(dice: &mut impl Rng) -> Temperature {
    let from_c = dice.random_range(-10.0..40.0);
    Temperature {
        from_c,
        to_c: from_c + dice.random_range(-20.0..40.0),
        time_constant_s: octaves(20.0..300.0, dice),
        gyro_dps_k: dice.random_range(-0.03..0.03),
        acc_mg_k: dice.random_range(-1.0..1.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{Stream, generator};

    #[test]
    fn what_is_drawn_is_possible_and_what_is_given_holds() {
        for seed in 0..500 {
            let mut dice = generator(seed, Stream::Campaign);
            let servo = [ServoKind::S3003, ServoKind::Digital][seed as usize % 2];
            let mut setup = Setup::with_polarity(servo, seed);
            let parts = draw(&mut setup, Phase::Flight, "noise=2,stretch=111", false, &mut dice);
            assert_eq!(setup.rig.hardware.noise, 2.0, "{}", parts.words);
            assert_eq!(setup.rig.hardware.sensor.bus.stretch_us, 111..=111);
            assert!(setup.rig.bench.disturbances.check().is_ok(), "{}", parts.words);
            for (name, value) in &setup.parameters {
                let mut params = tvc_nano::Params::default();
                assert!(params.set(name, *value).is_ok(), "{name} {value}");
            }
        }
    }
}
