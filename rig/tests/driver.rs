//! The driver at the emulated sensor, without chip and firmware: of a sound sensor no burst is
//! refused, whatever its ranges, bandwidths, refresh rates and noise, at rest and in motion.

use bno055_driver::config::{
    AccBandwidth, AccRange, Config, GyrBandwidth, GyrRange, Mode, Sensors,
};
use bno055_driver::{BusError, Driver, Imu, Micros, Next, SensorFault, Transfer};
use nalgebra::{UnitQuaternion, Vector3};
use rand::Rng;
use rig::Ticks;
use rig::bno055::{Bno055, Fault, RefreshRates};
use rig::inertial::{ImuErrors, Stimulus};
use rig::random::{Stream, generator};
use rig::sensor_motion::{HeldSensor, SensorMotion, Shake};
use samd21::board::I2cEvent;
use std::collections::BTreeMap;

const GYR: [GyrBandwidth; 8] = [
    GyrBandwidth::Hz523,
    GyrBandwidth::Hz230,
    GyrBandwidth::Hz116,
    GyrBandwidth::Hz64,
    GyrBandwidth::Hz47,
    GyrBandwidth::Hz32,
    GyrBandwidth::Hz23,
    GyrBandwidth::Hz12,
];
const GYR_RANGES: [GyrRange; 5] =
    [GyrRange::Dps2000, GyrRange::Dps1000, GyrRange::Dps500, GyrRange::Dps250, GyrRange::Dps125];
const ACC: [AccBandwidth; 8] = [
    AccBandwidth::Hz7_81,
    AccBandwidth::Hz15_63,
    AccBandwidth::Hz31_25,
    AccBandwidth::Hz62_5,
    AccBandwidth::Hz125,
    AccBandwidth::Hz250,
    AccBandwidth::Hz500,
    AccBandwidth::Hz1000,
];
const ACC_RANGES: [AccRange; 4] = [AccRange::G2, AccRange::G4, AccRange::G8, AccRange::G16];
/// Cases that have every bandwidth with every range of the same sensor.
const CASES: u64 = 160;

/// Step in which the sensor is moved.
const STEP: Ticks = Ticks::from_us(500);
/// Longest time from power-on to the first burst, and of a set-up.
const BOOTED: Ticks = Ticks::from_ms(3_000);
/// A byte on the bus, stretched.
const BYTE: Ticks = Ticks::from_us(200);

/// A number as likely in each octave of a range.
fn octaves(least: f64, most: f64, dice: &mut impl Rng) -> f64 {
    least * (most / least).powf(dice.random_range(0.0..1.0))
}

/// A sensor in a hand, and the driver that reads it.
struct Bench {
    chip: Bno055,
    driver: Driver,
    held: HeldSensor,
    field_ut: Vector3<f64>,
    now: Ticks,
    sensed: Ticks,
    /// Until when it is moved as it is.
    moved: Ticks,
    /// The rates and accelerations of the fastest motion, rad/s and m/s^2; at rest none.
    fastest: Option<[f64; 2]>,
    tick: Ticks,
    /// Ticks from one that reads the rates alone to the next.
    alone: Option<u64>,
    words: String,
}

impl Bench {
    fn new(case: u64, dice: &mut impl Rng) -> Self {
        let pick = case as usize;
        let sensors = Sensors {
            gyr_bandwidth: GYR[pick % 8],
            gyr_range: GYR_RANGES[pick / 8 % 5],
            // Every pair comes once in 32 cases, beside another pair of the gyroscope each time.
            acc_bandwidth: ACC[(pick + pick / 32) % 8],
            acc_range: ACC_RANGES[pick / 8 % 4],
            ..Sensors::default()
        };
        let noise = octaves(0.5, 3.0, dice);
        let refresh = dice.random_bool(0.7).then(|| RefreshRates {
            acc_hz: octaves(10.0, 200.0, dice),
            gyr_hz: octaves(10.0, 200.0, dice),
            mag_hz: octaves(1.0, 100.0, dice),
        });
        let three =
            |most: f64, dice: &mut _| [(); 3].map(|()| Rng::random_range(dice, -most..most));
        let errors = ImuErrors {
            gyro_bias_rad_s: Some(three(3_f64.to_radians(), dice)),
            gyro_noise_density: noise * ImuErrors::TYPICAL.gyro_noise_density,
            acc_noise_density: noise * ImuErrors::TYPICAL.acc_noise_density,
            mag_noise_ut: noise * ImuErrors::TYPICAL.mag_noise_ut,
            acc_offset_m_s2: three(0.8, dice),
            hard_iron_ut: three(40.0, dice),
            ..ImuErrors::TYPICAL
        };
        let fastest = dice.random::<bool>().then(|| {
            let range_rad_s = f64::from(sensors.gyr_range.dps()).to_radians();
            // What a hand does, and beyond the accelerometer's range.
            [15.7_f64.min(range_rad_s), 1.2 * 9.8 * f64::from(sensors.acc_range.g())]
        });
        let tick = Ticks::from_us(dice.random_range(6_500..=10_000));
        let alone = dice.random_bool(0.3).then_some(3);
        let words = format!(
            "case {case}: {sensors:?}, noise {noise:.2}, {refresh:?}, {}, every {} us",
            if fastest.is_some() { "in motion" } else { "at rest" },
            tick.as_us(),
        );
        Self {
            chip: Bno055::new(rig::bno055::Config {
                seed: dice.random(),
                errors,
                clock_error: 0.03,
                refresh,
                ..rig::bno055::Config::default()
            }),
            driver: Driver::new(Config {
                sensors,
                mode: Mode::Amg,
                needs_mag: false,
                ..Config::default()
            }),
            held: HeldSensor::new(UnitQuaternion::from_euler_angles(
                dice.random_range(-3.0..3.0),
                dice.random_range(-1.5..1.5),
                dice.random_range(-3.0..3.0),
            )),
            field_ut: Vector3::from(three(35.0, dice)),
            now: Ticks::ZERO,
            sensed: Ticks::ZERO,
            moved: Ticks::ZERO,
            fastest,
            tick,
            alone,
            words,
        }
    }

    /// Time passes.
    fn pass(&mut self, until: Ticks, dice: &mut impl Rng) {
        self.now = until;
        while self.sensed + STEP <= until {
            self.sensed += STEP;
            if let Some([rate_rad_s, acc_m_s2]) = self.fastest
                && self.sensed > self.moved
            {
                let shake = Shake {
                    rate_rad_s: octaves(0.01, rate_rad_s, dice),
                    acc_m_s2: octaves(0.1, acc_m_s2, dice),
                    swings_hz: octaves(0.2, 5.0, dice),
                    seconds: dice.random_range(0.5..4.0),
                };
                self.held.begin(SensorMotion::Shake(shake));
                let rest_s = dice.random_range(0.0..2.0);
                self.moved = self.sensed + Ticks::from_secs_f64(shake.seconds + rest_s);
            }
            let rate = self.held.advance(STEP.as_secs_f64());
            let back = self.held.attitude().inverse();
            let acceleration = Vector3::from(self.held.acceleration_m_s2());
            let force = back * Vector3::new(0.0, 0.0, -9.81) + acceleration;
            let truth = Stimulus {
                specific_force_m_s2: force.into(),
                rate_rad_s: rate.into(),
                field_ut: (back * self.field_ut).into(),
                ..Stimulus::REST
            };
            self.chip.sense(self.sensed, &truth);
        }
    }

    /// Carries out a transfer, byte by byte.
    fn transfer(&mut self, transfer: &Transfer, dice: &mut impl Rng) -> Result<Vec<u8>, BusError> {
        let address = self.chip.address();
        let start = |read| I2cEvent::Start { address, read };
        let (begin, read, write) = match transfer {
            Transfer::Read { register, len } => (*register, usize::from(*len), Vec::new()),
            Transfer::Write { register, bytes } => (*register, 0, bytes.as_slice().to_vec()),
        };
        let mut events = vec![start(false), I2cEvent::Write(begin)];
        events.extend(write.into_iter().map(I2cEvent::Write));
        if read > 0 {
            events.push(start(true));
            events.resize(events.len() + read, I2cEvent::Read);
        }
        let mut bytes = Vec::new();
        for event in events {
            let reply = self.chip.i2c(self.now, event);
            match event {
                I2cEvent::Read => bytes.push(reply.data),
                _ if !reply.ack => return Err(BusError::Nak),
                _ => {}
            }
            self.pass(self.now + BYTE, dice);
        }
        self.chip.i2c(self.now, I2cEvent::Stop);
        Ok(bytes)
    }

    /// Reads as many bursts, from the first on that was good, for as long as they should take; how
    /// many it were, and the faults of those that were refused.
    fn read(&mut self, bursts: u64, dice: &mut impl Rng) -> (u64, BTreeMap<String, u64>) {
        let mut refused = BTreeMap::new();
        let end = self.now + BOOTED + (self.tick + BYTE * 21) * bursts;
        let (mut next, mut read, mut is_good) = (Ticks::ZERO, 0, false);
        while read < bursts && self.now < end {
            match self.driver.next(Micros(self.now.as_us())) {
                Next::Transfer(transfer) => {
                    let outcome = self.transfer(&transfer, dice);
                    let outcome = outcome.as_deref().map_err(|error| *error);
                    self.driver.complete(Micros(self.now.as_us()), outcome);
                }
                Next::Wait(until) => {
                    let us = until.0.clamp(self.now.as_us() + 1, self.now.as_us() + 10_000);
                    self.pass(Ticks::from_us(us), dice);
                }
                Next::Sample => {
                    next += self.tick;
                    next = next.max(self.now);
                    self.pass(next, dice);
                    let alone = self.alone.filter(|every| read % every == 0);
                    let rates = alone.and_then(|_| self.driver.rates_burst());
                    let burst = rates.unwrap_or_else(|| self.driver.burst());
                    let started = Micros(self.now.as_us());
                    let outcome = self.transfer(&burst, dice);
                    let outcome = outcome.as_deref().map_err(|error| *error);
                    match self.driver.sample(started, outcome) {
                        Ok(_) => is_good = true,
                        // It has not refreshed yet behind the set-up.
                        Err(SensorFault::AllZero) if !is_good => {}
                        Err(fault) => *refused.entry(fault.to_string()).or_default() += 1,
                    }
                    read += u64::from(is_good);
                }
            }
        }
        (read, refused)
    }
}

/// Reads this number of bursts of each case; gives the refused bursts, in words.
fn refused(bursts: u64, seed: u64) -> Vec<String> {
    let cases = (0..CASES).filter_map(|case| {
        let mut dice = generator(seed << 32 | case, Stream::Campaign);
        let mut bench = Bench::new(case, &mut dice);
        let (read, faults) = bench.read(bursts, &mut dice);
        let starts = bench.driver.health().starts;
        let is_sound = faults.is_empty() && (read, starts) == (bursts, 1);
        let words = bench.words;
        (!is_sound).then(|| format!("{words}: {read} bursts, set up {starts} times, {faults:?}"))
    });
    cases.collect()
}

fn amount(variable: &str, usual: u64) -> u64 {
    match std::env::var(variable) {
        Ok(text) => text.parse().expect("a number"),
        Err(_) => usual,
    }
}

/// Some seconds of each case.
#[test]
fn no_burst_of_a_sound_sensor_is_refused() {
    let refused = refused(400, 1);
    assert!(refused.is_empty(), "{refused:#?}");
}

/// `BURSTS` in all, by `SEED`.
#[test]
#[ignore = "takes minutes: for whoever changes how bursts are judged"]
fn no_burst_of_a_sound_sensor_is_refused_for_hours() {
    let each = amount("BURSTS", 16_000_000).div_ceil(CASES);
    let refused = refused(each, amount("SEED", 1));
    println!("{} bursts", each * CASES);
    assert!(refused.is_empty(), "{} cases: {refused:#?}", refused.len());
}

/// A sensor that dies has bursts that are refused.
#[test]
fn bursts_of_a_dead_sensor_are_refused() {
    let mut dice = generator(1, Stream::Campaign);
    let mut bench = Bench::new(0, &mut dice);
    assert_eq!(bench.read(100, &mut dice), (100, BTreeMap::new()));
    bench.chip.inject(bench.now, Fault::GyroDead);
    let (read, faults) = bench.read(100, &mut dice);
    assert!(read < 100 && !faults.is_empty(), "{read} {faults:?}");
}
