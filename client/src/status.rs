//! What a vehicle tells of itself, as one object: for the monitor and for programs that plot.

use mavlink::dialects::common::{MavMessage, MavSysStatusSensor, SYS_STATUS_DATA};
use serde::Serialize;
use tvc_nano::failsafe::StateKind;
use tvc_nano::{Axis, Params};

use crate::Client;

/// The newest of everything. Serialized, it is a line of `tvc monitor --json` and a datagram of
/// `tvc forward`.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Status {
    /// The vehicle's clock at the newest attitude, s.
    pub timestamp: f64,
    /// Where the flight stands.
    pub state: String,
    /// Why it stands there, as the vehicle said it.
    pub reason: String,
    /// The armed flag.
    pub armed: bool,
    /// Roll, pitch and yaw, rad.
    pub attitude_rad: [f64; 3],
    /// Rates about the body's axes, rad/s.
    pub rate_rad_s: [f32; 3],
    /// Pulse commanded, us.
    pub pulse_us: u16,
    /// Servo angle commanded, from the centre, rad.
    pub servo_rad: f64,
    /// The same of the second servo; `None` for a vehicle with one axis.
    pub second_servo: Option<Commanded>,
    /// Standard deviation of the tilt, deg; `None` before the vehicle has said so.
    pub tilt_sd_deg: Option<f32>,
    /// The same of the heading: more than 100 where nothing shows it.
    pub heading_sd_deg: Option<f32>,
    /// The plant's gain that control estimates, in those of `PITCH_GAIN`.
    pub plant_gain: Option<f32>,
    /// Rates, losses and load.
    #[serde(flatten)]
    pub health: LinkHealth,
    /// Texts since the last object.
    pub texts: Vec<String>,
    /// Everything that is enabled is healthy; `None` before the vehicle has said so.
    pub healthy: Option<bool>,
}

/// What a servo is commanded.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Commanded {
    /// Pulse, us.
    pub pulse_us: u16,
    /// Angle from the centre, rad.
    pub servo_rad: f64,
}

/// How well sensor, processor and link do. What the vehicle tells once a second is `None` before.
#[derive(Clone, Debug, Default, Serialize)]
pub struct LinkHealth {
    /// Attitudes a second, by the vehicle's clock.
    pub attitude_hz: f64,
    /// Share of time for which the processor was awake, 0 to 1.
    pub load: Option<f64>,
    /// Frames that arrived whole.
    pub messages: u64,
    /// Frames missing by their sequence numbers.
    pub lost: u64,
    /// Frames with a wrong checksum.
    pub crc_errors: u64,
    /// Frames that the vehicle dropped because nobody took them, modulo 65,536.
    pub dropped: Option<u16>,
    /// Steps without a usable sample since start-up, modulo 65,536.
    pub missed: Option<u16>,
    /// Failed transfers on the sensor's bus.
    pub bus_errors: Option<u16>,
}

/// Keeps a [`Status`] up to date.
#[derive(Clone, Debug)]
pub struct StatusTracker {
    status: Status,
    servos: [ServoMap; Axis::COUNT],
    /// First and last attitude since the last object, ms, and their number.
    window: Option<(u32, u32, u32)>,
}

/// From pulse back to angle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ServoMap {
    centre_us: f64,
    us_per_rad: f64,
}

impl ServoMap {
    /// Of an axis' servo, by the vehicle's parameters.
    pub fn of(params: &Params, axis: Axis) -> Self {
        let fitting = params.fitting(axis);
        Self::new(fitting.centre_us, params.srv_us_per_deg(), fitting.direction)
    }

    /// By the pulse at the centre, us, the pulse for a degree, us, and the direction, 1 or -1.
    pub fn new(centre_us: f32, us_per_deg: f32, direction: f32) -> Self {
        Self {
            centre_us: centre_us.into(),
            us_per_rad: f64::from(direction) * f64::from(us_per_deg).to_degrees(),
        }
    }

    /// Servo angle from the centre, rad.
    pub fn angle_rad(&self, pulse_us: u16) -> f64 {
        (f64::from(pulse_us) - self.centre_us) / self.us_per_rad
    }
}

impl StatusTracker {
    /// Nothing heard yet.
    pub fn new(servos: [ServoMap; Axis::COUNT]) -> Self {
        Self { status: Status::default(), servos, window: None }
    }

    /// Takes in a message.
    pub fn take(&mut self, message: &MavMessage) {
        let status = &mut self.status;
        match message {
            MavMessage::STATUSTEXT(text) => {
                status.texts.push(crate::text(&text.text).to_owned());
            }
            MavMessage::ATTITUDE_QUATERNION(m) => {
                status.timestamp = f64::from(m.time_boot_ms) * 1e-3;
                status.attitude_rad = angles([m.q1, m.q2, m.q3, m.q4].map(f64::from));
                status.rate_rad_s = [m.rollspeed, m.pitchspeed, m.yawspeed];
                self.window = Some(match self.window {
                    Some((first, _, count)) => (first, m.time_boot_ms, count + 1),
                    None => (m.time_boot_ms, m.time_boot_ms, 0),
                });
            }
            MavMessage::SERVO_OUTPUT_RAW(m) => {
                let [first, second] = &self.servos;
                status.pulse_us = m.servo1_raw;
                status.servo_rad = first.angle_rad(m.servo1_raw);
                // One that is not steered has no pulse.
                status.second_servo = (m.servo2_raw > 0).then(|| Commanded {
                    pulse_us: m.servo2_raw,
                    servo_rad: second.angle_rad(m.servo2_raw),
                });
            }
            MavMessage::NAMED_VALUE_FLOAT(m) => match crate::text(&m.name) {
                "tilt_sd" => status.tilt_sd_deg = Some(m.value),
                "head_sd" => status.heading_sd_deg = Some(m.value),
                "gain" => status.plant_gain = Some(m.value),
                _ => {}
            },
            MavMessage::SYS_STATUS(m) => {
                status.health.load = Some(f64::from(m.load) * 1e-3);
                status.health.dropped = Some(m.errors_count1);
                status.health.missed = Some(m.errors_count2);
                status.health.bus_errors = Some(m.errors_count3);
                status.healthy = Some(sick(m).is_empty());
            }
            _ => {}
        }
    }

    /// The newest values as they are; texts and rate go on.
    pub fn peek(&self) -> &Status {
        &self.status
    }

    /// The present object; texts and rate begin anew.
    pub fn next(&mut self, client: &Client) -> Status {
        let (status, counts) = (&mut self.status, client.counts());
        status.state = client.state_name();
        status.reason = client.reason().to_owned();
        status.armed = client.state().is_some_and(StateKind::is_armed);
        let health = &mut status.health;
        health.messages = counts.messages;
        health.lost = counts.lost;
        health.crc_errors = counts.crc_errors;
        if let Some((first, last, count)) = self.window
            && last > first
        {
            health.attitude_hz = f64::from(count) * 1e3 / f64::from(last - first);
            self.window = Some((last, last, 0));
        }
        let now = status.clone();
        status.texts.clear();
        now
    }
}

/// What is enabled and not healthy. That a drone cannot be armed yet is no illness.
pub fn sick(status: &SYS_STATUS_DATA) -> MavSysStatusSensor {
    status
        .onboard_control_sensors_enabled
        .difference(status.onboard_control_sensors_health)
        .difference(MavSysStatusSensor::MAV_SYS_STATUS_PREARM_CHECK)
}

/// Whether the vehicle says that its attitude has not settled, or is not estimated.
pub fn is_unsettled(status: &SYS_STATUS_DATA) -> bool {
    sick(status).contains(MavSysStatusSensor::MAV_SYS_STATUS_AHRS)
}

/// Roll, pitch and yaw of `[w, x, y, z]`, body to earth, rad.
pub fn angles([w, x, y, z]: [f64; 4]) -> [f64; 3] {
    [
        (2.0 * (w * x + y * z)).atan2(1.0 - 2.0 * (x * x + y * y)),
        (2.0 * (w * y - x * z)).clamp(-1.0, 1.0).asin(),
        (2.0 * (w * z + x * y)).atan2(1.0 - 2.0 * (y * y + z * z)),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavlink::dialects::common::{ATTITUDE_QUATERNION_DATA, STATUSTEXT_DATA};

    #[test]
    fn a_second_servo_and_an_uncertain_tilt_are_there_when_they_are_told() {
        use mavlink::dialects::common::{NAMED_VALUE_FLOAT_DATA, SERVO_OUTPUT_RAW_DATA};
        let servos = [ServoMap::new(1523.6, 10.0, 1.0), ServoMap::new(1500.0, 10.0, -1.0)];
        let mut tracker = StatusTracker::new(servos);
        let mut pulses = |servo2_raw| {
            tracker.take(&MavMessage::SERVO_OUTPUT_RAW(SERVO_OUTPUT_RAW_DATA {
                servo1_raw: 1524,
                servo2_raw,
                ..SERVO_OUTPUT_RAW_DATA::default()
            }));
            tracker.peek().second_servo
        };
        assert_eq!(pulses(0), None);
        let second = pulses(1600).unwrap();
        assert_eq!(second.pulse_us, 1600);
        assert!((second.servo_rad + 10.0_f64.to_radians()).abs() < 1e-9);
        assert_eq!(tracker.peek().tilt_sd_deg, None);
        for (name, value) in [("tilt_sd", 1.5), ("head_sd", 4.0), ("gain", 1.25), ("other", 9.0)] {
            tracker.take(&MavMessage::NAMED_VALUE_FLOAT(NAMED_VALUE_FLOAT_DATA {
                name: name.into(),
                value,
                ..NAMED_VALUE_FLOAT_DATA::default()
            }));
        }
        assert_eq!(tracker.peek().tilt_sd_deg, Some(1.5));
        assert_eq!(tracker.peek().heading_sd_deg, Some(4.0));
        assert_eq!(tracker.peek().plant_gain, Some(1.25));
    }

    #[test]
    fn angles_are_those_of_an_independent_library() {
        let q = nalgebra::UnitQuaternion::from_euler_angles(0.3, -0.7, 2.1);
        let [roll, pitch, yaw] = angles([q.w, q.i, q.j, q.k]);
        for (angle, expected) in [(roll, 0.3), (pitch, -0.7), (yaw, 2.1)] {
            assert!((angle - expected).abs() < 1e-12);
        }
    }

    fn text(text: &str) -> MavMessage {
        MavMessage::STATUSTEXT(STATUSTEXT_DATA { text: text.into(), ..STATUSTEXT_DATA::default() })
    }

    #[test]
    fn the_rate_is_that_of_the_vehicles_clock() {
        let mut tracker = StatusTracker::new([ServoMap::new(1523.6, 10.0, 1.0); 2]);
        tracker.take(&text("armed"));
        for step in 0..=50 {
            tracker.take(&MavMessage::ATTITUDE_QUATERNION(ATTITUDE_QUATERNION_DATA {
                time_boot_ms: 1000 + 10 * step,
                q1: 1.0,
                ..ATTITUDE_QUATERNION_DATA::default()
            }));
        }
        let mut next = || tracker.next(&Client::default());
        let status = next();
        assert!((status.health.attitude_hz - 100.0).abs() < 1e-9);
        assert_eq!(status.texts, ["armed"]);
        assert!(next().texts.is_empty());
    }

    #[test]
    fn a_drone_that_cannot_be_armed_yet_is_not_unhealthy() {
        let gyro = MavSysStatusSensor::MAV_SYS_STATUS_SENSOR_3D_GYRO;
        let check = MavSysStatusSensor::MAV_SYS_STATUS_PREARM_CHECK;
        let status = |health| SYS_STATUS_DATA {
            onboard_control_sensors_enabled: gyro | check,
            onboard_control_sensors_health: health,
            ..SYS_STATUS_DATA::default()
        };
        assert_eq!(sick(&status(gyro)), MavSysStatusSensor::empty());
        assert_eq!(sick(&status(check)), gyro);
    }

    #[test]
    fn health_is_unknown_until_the_vehicle_tells_it() {
        let mut tracker = StatusTracker::new([ServoMap::new(1523.6, 10.0, 1.0); 2]);
        let status = tracker.next(&Client::default());
        assert_eq!((status.healthy, status.health.missed), (None, None));
        tracker.take(&MavMessage::SYS_STATUS(SYS_STATUS_DATA {
            errors_count2: 7,
            ..SYS_STATUS_DATA::default()
        }));
        let status = tracker.next(&Client::default());
        assert_eq!((status.healthy, status.health.missed), (Some(true), Some(7)));
    }

    #[test]
    fn a_pulse_of_ten_microseconds_is_a_degree() {
        let map = ServoMap::new(1523.6, 10.0, -1.0);
        assert!((map.angle_rad(1624).to_degrees() + 10.04).abs() < 1e-3);
    }
}
