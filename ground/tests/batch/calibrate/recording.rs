//! A recording of a sensor that is moved by hand as a calibration asks for, out of the emulated
//! BNO055, without a firmware: counts with their errors and noise.

use bno055_driver::config::Sensors;
use bno055_driver::registers::{ACC_CONFIG, ACC_DATA, OPR_MODE, PAGE_ID, UNIT_SEL};
use calibration::poses::Face;
use nalgebra::Vector3;
use rig::Ticks;
use rig::bench::EarthField;
use rig::bno055::{Bno055, Config, Mode};
use rig::inertial::Stimulus;
use rig::sensor_motion::{HeldSensor, SensorMotion, resting};
use samd21::board::I2cEvent;

/// Step in which the sensor is moved, and period in which it is read.
const STEP: Ticks = Ticks::from_us(500);
const PERIOD: Ticks = Ticks::from_ms(10);
/// Times at which the chip has booted for certain and at which it runs in its mode.
const BOOTED: Ticks = Ticks::from_ms(750);
const START: Ticks = Ticks::from_ms(900);
/// Rest at the beginning, rest on each face, and time of a turn between two faces, s.
const REST_S: f64 = 12.0;
const FACE_S: f64 = 3.0;
const BETWEEN_S: f64 = 1.5;
const GRAVITY_M_S2: f64 = 9.80665;

/// The motions of a recording: a rest, six faces, a turn through all directions.
#[derive(Clone, Copy, Debug)]
pub(super) struct MotionPlan {
    /// How long the sensor is turned through all directions at the end, s.
    pub(super) turning_s: f64,
    /// Amplitude of the rate at which the sensor trembles in the first rest, rad/s.
    pub(super) tremble_rad_s: f64,
}

impl Default for MotionPlan {
    /// Turning for a minute, on a steady table.
    fn default() -> Self {
        Self { turning_s: 60.0, tremble_rad_s: 0.0 }
    }
}

impl MotionPlan {
    /// The motions, with the length of each, s.
    fn steps(&self) -> Vec<(SensorMotion, f64)> {
        let first = match self.tremble_rad_s {
            0.0 => SensorMotion::Rest,
            rate => SensorMotion::Tremble(rate),
        };
        let mut steps = vec![(first, REST_S)];
        steps.extend(
            Face::ALL.map(|face| (SensorMotion::To(resting(face), BETWEEN_S), BETWEEN_S + FACE_S)),
        );
        steps.push((SensorMotion::Turn, self.turning_s));
        steps
    }
}

/// A sample: time, us, and the words of accelerometer, magnetometer and gyroscope.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sample {
    /// Since the recording began.
    pub(super) time_us: u64,
    /// Accelerometer, counts of 0.01 m/s2.
    pub(super) acc: [i16; 3],
    /// Magnetometer, counts of 1/16 uT.
    pub(super) mag: [i16; 3],
    /// Gyroscope, counts of 1/16 deg/s.
    pub(super) gyr: [i16; 3],
}

/// Records the procedure in Copenhagen: rest, six faces, a slow turn through all directions.
pub(super) fn record(sensor: Config, plan: &MotionPlan) -> Vec<Sample> {
    let mut held = HeldSensor::new(resting(Face::TopUp));
    let mut now = START;
    let mut chip = start(sensor, &felt(&held, Vector3::zeros()));
    let mut samples = Vec::new();
    for (motion, seconds) in plan.steps() {
        held.begin(motion);
        let end = now + Ticks::from_secs_f64(seconds);
        while now < end {
            let rate = held.advance(STEP.as_secs_f64());
            now += STEP;
            chip.sense(now, &felt(&held, rate));
            if (now - START).0.is_multiple_of(PERIOD.0) {
                samples.push(read(&mut chip, now));
            }
        }
    }
    samples
}

/// What the sensor feels while it turns at `rate`, rad/s.
fn felt(held: &HeldSensor, rate: Vector3<f64>) -> Stimulus {
    let to_sensor = held.attitude().inverse();
    let field = EarthField::COPENHAGEN.north_east_down();
    Stimulus {
        specific_force_m_s2: (to_sensor * Vector3::new(0.0, 0.0, -GRAVITY_M_S2)).into(),
        rate_rad_s: rate.into(),
        field_ut: (to_sensor * Vector3::from(field)).into(),
        attitude: Stimulus::REST.attitude,
    }
}

/// A chip in AMG mode with the driver's ranges and bandwidths, at rest while it starts.
fn start(sensor: Config, still: &Stimulus) -> Bno055 {
    let mut chip = Bno055::new(sensor);
    let lie = |chip: &mut Bno055, from: Ticks, to: Ticks| {
        for step in 1..=(to - from).0 / STEP.0 {
            chip.sense(from + STEP * step, still);
        }
    };
    lie(&mut chip, Ticks::ZERO, BOOTED);
    write(&mut chip, UNIT_SEL, &[0]);
    write(&mut chip, PAGE_ID, &[1]);
    write(&mut chip, ACC_CONFIG, &Sensors::default().registers());
    write(&mut chip, PAGE_ID, &[0]);
    write(&mut chip, OPR_MODE, &[Mode::Amg as u8]);
    lie(&mut chip, BOOTED, START);
    chip
}

/// Writes registers as soon as the chip has booted.
fn write(chip: &mut Bno055, register: u8, values: &[u8]) {
    let start = I2cEvent::Start { address: chip.address(), read: false };
    chip.i2c(BOOTED, start);
    chip.i2c(BOOTED, I2cEvent::Write(register));
    for value in values {
        chip.i2c(BOOTED, I2cEvent::Write(*value));
    }
    chip.i2c(BOOTED, I2cEvent::Stop);
}

fn read(chip: &mut Bno055, now: Ticks) -> Sample {
    let address = chip.address();
    let start = |read| I2cEvent::Start { address, read };
    let mut event = |event| chip.i2c(now, event).data;
    for step in [start(false), I2cEvent::Write(ACC_DATA), start(true)] {
        event(step);
    }
    let words =
        [(); 9].map(|()| i16::from_le_bytes([event(I2cEvent::Read), event(I2cEvent::Read)]));
    event(I2cEvent::Stop);
    let [ax, ay, az, mx, my, mz, gx, gy, gz] = words;
    Sample {
        time_us: (now - START).as_us(),
        acc: [ax, ay, az],
        mag: [mx, my, mz],
        gyr: [gx, gy, gz],
    }
}

#[test]
fn the_procedure_rests_on_every_face_and_then_turns() {
    let sensor = Config { errors: rig::inertial::ImuErrors::NONE, ..Config::default() };
    let plan = MotionPlan { turning_s: 5.0, ..MotionPlan::default() };
    let samples = record(sensor, &plan);
    assert_eq!(samples.len(), 4400);
    let at = |s: f64| samples[(s * 100.0) as usize];
    assert_eq!((at(6.0).acc, at(6.0).gyr), ([0, 0, -981], [0; 3]));
    let mut seen: Vec<[i16; 3]> = (0..6).map(|face| at(15.0 + 4.5 * f64::from(face)).acc).collect();
    seen.sort();
    let mut faces =
        vec![[0, 0, -981], [0, 0, 981], [0, -981, 0], [0, 981, 0], [981, 0, 0], [-981, 0, 0]];
    faces.sort();
    assert_eq!(seen, faces);
    assert!(at(43.0).gyr.iter().any(|w| w.abs() > 400));
    let strength = |s: &Sample| s.mag.iter().map(|m| f64::from(*m).powi(2)).sum::<f64>().sqrt();
    assert!((strength(&at(43.0)) / 16.0 - 50.0).abs() < 0.5);
}
