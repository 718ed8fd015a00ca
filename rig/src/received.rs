//! What has arrived from the image, by kind of message.

use client::state::state_of;
use client::{StateKind, text};
use mavlink::dialects::common::{MavMessage, SYS_STATUS_DATA};
use samd21::board::Ticks;
use std::collections::BTreeMap;

/// A HEARTBEAT.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Heartbeat {
    /// When it arrived.
    pub at: Ticks,
    /// State of the flight; `None` for a number that is no state.
    pub state: Option<StateKind>,
    /// Code of the reason for the state, 0 for none.
    pub reason: u8,
}

/// An ATTITUDE_QUATERNION.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Attitude {
    /// When it arrived.
    pub at: Ticks,
    /// The image's clock at the sample, ms.
    pub time_ms: u32,
    /// `[w, x, y, z]`, body to north-east-down.
    pub quaternion: [f32; 4],
    /// Rates about the body's axes, rad/s.
    pub rate_rad_s: [f32; 3],
}

impl Attitude {
    /// Pitch, nose up, rad.
    pub fn pitch_rad(&self) -> f64 {
        let [w, x, y, z] = self.quaternion.map(f64::from);
        (2.0 * (w * y - x * z)).clamp(-1.0, 1.0).asin()
    }
}

/// A SERVO_OUTPUT_RAW.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ServoOutput {
    /// The image's clock at the step, us; wraps after 71 minutes.
    pub time_us: u32,
    /// Pulse commanded, us.
    pub pulse_us: u16,
}

/// A RAW_IMU: the sensor's counts as they were read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RawImu {
    /// When it arrived.
    pub at: Ticks,
    /// The image's clock at the start of the burst, us.
    pub time_us: u64,
    /// Accelerometer, sensor axes.
    pub acc: [i16; 3],
    /// Gyroscope, sensor axes.
    pub gyr: [i16; 3],
    /// Magnetometer, sensor axes.
    pub mag: [i16; 3],
}

impl RawImu {
    /// The nine words as the sensor's registers have them: accelerometer, magnetometer, gyroscope.
    pub fn words(&self) -> [i16; 9] {
        let ([a, b, c], [d, e, f], [g, h, i]) = (self.acc, self.mag, self.gyr);
        [a, b, c, d, e, f, g, h, i]
    }
}

/// A DEBUG_VECT `imu_bus`: how long the sensor's bursts took.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BusReport {
    /// Mean of the newest bursts, us.
    pub mean_us: f32,
    /// The longest of them, us.
    pub max_us: f32,
}

/// Everything that has arrived.
#[derive(Clone, Debug, Default)]
pub struct Received {
    /// Heartbeats.
    pub heartbeats: Vec<Heartbeat>,
    /// Attitudes.
    pub attitudes: Vec<Attitude>,
    /// Servo outputs.
    pub servos: Vec<ServoOutput>,
    /// Raw samples.
    pub samples: Vec<RawImu>,
    /// What the image says about the sensor's bus.
    pub bus: Vec<BusReport>,
    /// What the image says about the uncertainty of the tilt (`tilt_sd`), deg.
    pub tilt_sd_deg: Vec<(Ticks, f32)>,
    /// Texts.
    pub texts: Vec<String>,
    /// System states with the time they arrived.
    pub status: Vec<(Ticks, SYS_STATUS_DATA)>,
    /// Parameters by name, as reported last.
    pub parameters: BTreeMap<String, f32>,
}

impl Received {
    /// Adds a message to those of its kind; other kinds are dropped.
    pub(crate) fn take(&mut self, at: Ticks, message: MavMessage) {
        match message {
            MavMessage::HEARTBEAT(m) => self.heartbeats.push(Heartbeat {
                at,
                state: state_of(m.custom_mode),
                reason: (m.custom_mode >> 8) as u8,
            }),
            MavMessage::ATTITUDE_QUATERNION(m) => self.attitudes.push(Attitude {
                at,
                time_ms: m.time_boot_ms,
                quaternion: [m.q1, m.q2, m.q3, m.q4],
                rate_rad_s: [m.rollspeed, m.pitchspeed, m.yawspeed],
            }),
            MavMessage::SERVO_OUTPUT_RAW(m) => {
                self.servos.push(ServoOutput { time_us: m.time_usec, pulse_us: m.servo1_raw })
            }
            MavMessage::RAW_IMU(m) => self.samples.push(RawImu {
                at,
                time_us: m.time_usec,
                acc: [m.xacc, m.yacc, m.zacc],
                gyr: [m.xgyro, m.ygyro, m.zgyro],
                mag: [m.xmag, m.ymag, m.zmag],
            }),
            MavMessage::DEBUG_VECT(m) if text(&m.name) == "imu_bus" => {
                self.bus.push(BusReport { mean_us: m.x, max_us: m.y })
            }
            MavMessage::NAMED_VALUE_FLOAT(m) if text(&m.name) == "tilt_sd" => {
                self.tilt_sd_deg.push((at, m.value));
            }
            MavMessage::STATUSTEXT(m) => self.texts.push(text(&m.text).to_owned()),
            MavMessage::SYS_STATUS(m) => self.status.push((at, m)),
            MavMessage::PARAM_VALUE(m) => {
                self.parameters.insert(text(&m.param_id).to_owned(), m.param_value);
            }
            _ => {}
        }
    }
}
