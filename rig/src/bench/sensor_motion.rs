//! A sensor moved by hand: laid down, rested on its six faces, and turned through all directions,
//! as a calibration asks for.
//!
//! [`record`] reads the emulated BNO055 by its registers, without a firmware, and returns its
//! counts with their errors and noise.

use super::{EarthField, stimulus};
use crate::bno055::registers::{page0, page1};
use crate::bno055::{self, Bno055, Mode, Stimulus};
use bno055_driver::config::Sensors;
use calibration::poses::Face;
use nalgebra::{UnitQuaternion, Vector3};
use samd21::board::{I2cEvent, Ticks};
use std::f64::consts::{FRAC_PI_2, PI, TAU};

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

/// The motions of a recording: a rest, six faces, a turn through all directions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionPlan {
    /// The magnetic field.
    pub field: EarthField,
    /// Gravity, m/s2.
    pub gravity_m_s2: f64,
    /// How long the sensor is turned through all directions at the end, s.
    pub turning_s: f64,
    /// Amplitude of the rate at which the sensor trembles in the first rest, rad/s.
    pub tremble_rad_s: f64,
}

impl Default for MotionPlan {
    /// In Copenhagen, turning for a minute, on a steady table.
    fn default() -> Self {
        Self {
            field: EarthField::COPENHAGEN,
            gravity_m_s2: 9.80665,
            turning_s: 60.0,
            tremble_rad_s: 0.0,
        }
    }
}

/// A sample: time, us, and the words of accelerometer, magnetometer and gyroscope.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sample {
    /// Since the recording began.
    pub time_us: u64,
    /// Accelerometer, counts of 0.01 m/s2.
    pub acc: [i16; 3],
    /// Magnetometer, counts of 1/16 uT.
    pub mag: [i16; 3],
    /// Gyroscope, counts of 1/16 deg/s.
    pub gyr: [i16; 3],
}

/// How the sensor is moved.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SensorMotion {
    /// It lies still.
    Rest,
    /// It is held unsteadily: amplitude of the rate, rad/s.
    Tremble(f64),
    /// It turns the shortest way to this attitude, sensor to north-east-down, in this number of
    /// seconds, and rests there.
    To(UnitQuaternion<f64>, f64),
    /// It turns through all directions.
    Turn,
    /// It turns about its z alone, at 1 rad/s.
    Spin,
    /// A hand shakes it.
    Shake(Shake),
}

/// A hand swings the sensor to and fro about all axes, and along them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shake {
    /// Greatest rate about each axis, rad/s.
    pub rate_rad_s: f64,
    /// Greatest acceleration along each, m/s^2.
    pub acc_m_s2: f64,
    /// Swings a second, about.
    pub swings_hz: f64,
    /// How long, s.
    pub seconds: f64,
}

impl Shake {
    /// Frequency and phase of each axis, by the first.
    const AXES: [(f64, f64); 3] = [(1.0, 0.0), (0.83, 2.1), (1.13, 4.2)];
    /// A hand begins and ends within this time, s.
    const EASE_S: f64 = 0.15;

    /// Three swings with this amplitude.
    fn swing(&self, amplitude: f64, since_s: f64, ahead: f64) -> Vector3<f64> {
        let to_end_s = (self.seconds - since_s).min(since_s).max(0.0);
        let eased = FRAC_PI_2.min(FRAC_PI_2 * to_end_s / Self::EASE_S).sin();
        let axes = Self::AXES
            .map(|(share, phase)| (TAU * share * self.swings_hz * since_s + phase + ahead).sin());
        Vector3::from(axes) * (amplitude * eased * eased)
    }
}

impl SensorMotion {
    /// Rate about the sensor's axes, rad/s, `since_s` after the motion began.
    fn rate(&self, since_s: f64, attitude: &UnitQuaternion<f64>) -> Vector3<f64> {
        match *self {
            Self::Rest => Vector3::zeros(),
            Self::Tremble(rate) => {
                let phase = since_s * 9.0;
                Vector3::new(phase.sin(), (phase * 0.7).cos(), 0.0) * rate
            }
            Self::To(to, seconds) => {
                let left = seconds - since_s;
                if left <= 0.0 {
                    return Vector3::zeros();
                }
                (attitude.inverse() * to).scaled_axis() / left.max(STEP.as_secs_f64())
            }
            Self::Turn => Vector3::new(
                1.1 * (0.31 * since_s).sin(),
                0.9 * (0.23 * since_s).cos(),
                0.7 * (0.17 * since_s + 1.0).sin(),
            ),
            Self::Spin => Vector3::new(0.0, 0.0, 1.0),
            Self::Shake(shake) => shake.swing(shake.rate_rad_s, since_s, 0.0),
        }
    }
}

/// A sensor held in the hand.
#[derive(Clone, Debug)]
pub struct HeldSensor {
    attitude: UnitQuaternion<f64>,
    motion: SensorMotion,
    since_s: f64,
}

impl HeldSensor {
    /// Held still at an attitude, sensor to north-east-down.
    pub fn new(attitude: UnitQuaternion<f64>) -> Self {
        Self { attitude, motion: SensorMotion::Rest, since_s: 0.0 }
    }

    /// Begins to move it.
    pub fn begin(&mut self, motion: SensorMotion) {
        self.motion = motion;
        self.since_s = 0.0;
    }

    /// A step of the motion; the rate in it, rad/s about the sensor's axes.
    pub fn advance(&mut self, dt_s: f64) -> Vector3<f64> {
        let rate = self.motion.rate(self.since_s, &self.attitude);
        self.since_s += dt_s;
        self.attitude *= UnitQuaternion::from_scaled_axis(rate * dt_s);
        rate
    }

    /// Acceleration along the sensor's axes, m/s^2, without gravity.
    pub fn acceleration_m_s2(&self) -> [f64; 3] {
        match self.motion {
            SensorMotion::Shake(shake) => shake.swing(shake.acc_m_s2, self.since_s, 1.0).into(),
            _ => [0.0; 3],
        }
    }

    /// Sensor to north-east-down.
    pub fn attitude(&self) -> UnitQuaternion<f64> {
        self.attitude
    }

    /// It has arrived where it was to go.
    pub fn has_arrived(&self) -> bool {
        matches!(self.motion, SensorMotion::To(_, seconds) if self.since_s >= seconds)
    }
}

/// Sensor to north-east-down, of a sensor that rests on a face.
pub fn resting(face: Face) -> UnitQuaternion<f64> {
    let (roll, pitch) = match face {
        Face::TopUp => (0.0, 0.0),
        Face::BottomUp => (PI, 0.0),
        Face::LeftUp => (FRAC_PI_2, 0.0),
        Face::RightUp => (-FRAC_PI_2, 0.0),
        Face::NoseUp => (0.0, FRAC_PI_2),
        Face::NoseDown => (0.0, -FRAC_PI_2),
    };
    UnitQuaternion::from_euler_angles(roll, pitch, 0.3)
}

/// Records the procedure: rest, six faces, a slow turn through all directions.
pub fn record(sensor: bno055::Config, plan: &MotionPlan) -> Vec<Sample> {
    let mut held = HeldSensor::new(resting(Face::TopUp));
    let mut now = START;
    let feel = |held: &HeldSensor, rate| {
        stimulus::in_hand(&held.attitude, rate, &plan.field, plan.gravity_m_s2)
    };
    let mut chip = start(sensor, &feel(&held, Vector3::zeros()));
    let mut samples = Vec::new();
    for (motion, seconds) in plan.steps() {
        held.begin(motion);
        let end = now + Ticks::from_secs_f64(seconds);
        while now < end {
            let rate = held.advance(STEP.as_secs_f64());
            now += STEP;
            chip.sense(now, &feel(&held, rate));
            if (now - START).0.is_multiple_of(PERIOD.0) {
                samples.push(read(&mut chip, now));
            }
        }
    }
    samples
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

/// A chip in AMG mode with the driver's ranges and bandwidths, at rest while it starts.
fn start(sensor: bno055::Config, still: &Stimulus) -> Bno055 {
    let mut chip = Bno055::new(sensor);
    let lie = |chip: &mut Bno055, from: Ticks, to: Ticks| {
        for step in 1..=(to - from).0 / STEP.0 {
            chip.sense(from + STEP * step, still);
        }
    };
    lie(&mut chip, Ticks::ZERO, BOOTED);
    write(&mut chip, page0::UNIT_SEL, &[0]);
    write(&mut chip, page0::PAGE_ID, &[1]);
    write(&mut chip, page1::ACC_CONFIG, &Sensors::default().registers());
    write(&mut chip, page0::PAGE_ID, &[0]);
    write(&mut chip, page0::OPR_MODE, &[Mode::Amg as u8]);
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
    for step in [start(false), I2cEvent::Write(page0::ACC_DATA), start(true)] {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bno055::ImuErrors;

    #[test]
    fn a_shake_swings_as_far_as_asked_and_ends_at_rest() {
        let shake = Shake { rate_rad_s: 15.0, acc_m_s2: 40.0, swings_hz: 4.0, seconds: 2.0 };
        let mut held = HeldSensor::new(resting(Face::TopUp));
        held.begin(SensorMotion::Shake(shake));
        let (mut rate, mut acc, mut last): (f64, f64, _) = (0.0, 0.0, Vector3::zeros());
        for _ in 0..4000 {
            let now = held.advance(STEP.as_secs_f64());
            // Fast hands change a rate by 300 deg/s within 10 ms.
            assert!((now - last).abs().max() < 30_000_f64.to_radians() * STEP.as_secs_f64());
            rate = rate.max(now.abs().max());
            acc = acc.max(Vector3::from(held.acceleration_m_s2()).abs().max());
            last = now;
        }
        assert!((14.0..=15.0).contains(&rate) && (38.0..=40.0).contains(&acc));
        assert!(last.norm() < 0.1 && held.advance(STEP.as_secs_f64()).norm() < 1e-9);
    }

    #[test]
    fn the_procedure_rests_on_every_face_and_then_turns() {
        let sensor = bno055::Config { errors: ImuErrors::NONE, ..bno055::Config::default() };
        let plan = MotionPlan { turning_s: 5.0, ..MotionPlan::default() };
        let samples = record(sensor, &plan);
        assert_eq!(samples.len(), 4400);
        let at = |s: f64| samples[(s * 100.0) as usize];
        assert_eq!((at(6.0).acc, at(6.0).gyr), ([0, 0, -981], [0; 3]));
        let mut seen: Vec<[i16; 3]> =
            (0..6).map(|face| at(15.0 + 4.5 * f64::from(face)).acc).collect();
        seen.sort();
        let mut faces =
            vec![[0, 0, -981], [0, 0, 981], [0, -981, 0], [0, 981, 0], [981, 0, 0], [-981, 0, 0]];
        faces.sort();
        assert_eq!(seen, faces);
        assert!(at(43.0).gyr.iter().any(|w| w.abs() > 400));
        let strength = |s: &Sample| s.mag.iter().map(|m| f64::from(*m).powi(2)).sum::<f64>().sqrt();
        assert!((strength(&at(43.0)) / 16.0 - 50.0).abs() < 0.5);
    }
}
