//! A sensor moved by hand: laid down, rested on its six faces, and turned through all directions,
//! as a calibration asks for.

use calibration::poses::Face;
use nalgebra::{UnitQuaternion, Vector3};
use samd21::board::Ticks;
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// Step in which the sensor is moved.
const STEP: Ticks = Ticks::from_us(500);

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
    /// A hand that holds it unsteadily.
    pub const TREMBLE: Self = Self::Tremble(0.08);

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

#[cfg(test)]
mod tests {
    use super::*;

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
}
