//! What has arrived from the image, sorted.

use client::state::state_of;
use client::{StateKind, text};
use mavlink::dialects::common::{MavMessage, MavModeFlag, MavSeverity, SYS_STATUS_DATA};
use samd21::board::Ticks;
use std::collections::BTreeMap;

/// A HEARTBEAT.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Heartbeat {
    /// When it arrived.
    pub at: Ticks,
    /// Where the flight stands.
    pub state: Option<StateKind>,
    /// Why, 0 for no reason.
    pub reason: u8,
    /// The armed flag.
    pub armed: bool,
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
    /// When it arrived.
    pub at: Ticks,
    /// The image's clock at the step, us; wraps after 71 minutes.
    pub time_us: u32,
    /// Pulse commanded, us.
    pub pulse_us: u16,
}

/// A RAW_IMU: the sensor's untouched counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RawImu {
    /// When it arrived.
    pub at: Ticks,
    /// The image's clock at the start of the burst, us.
    pub time_us: u64,
    /// Accelerometer.
    pub acc: [i16; 3],
    /// Gyroscope.
    pub gyr: [i16; 3],
    /// Magnetometer.
    pub mag: [i16; 3],
}

impl RawImu {
    /// The nine words as the sensor's registers have them: accelerometer, magnetometer, gyroscope.
    pub fn words(&self) -> [i16; 9] {
        let ([a, b, c], [d, e, f], [g, h, i]) = (self.acc, self.mag, self.gyr);
        [a, b, c, d, e, f, g, h, i]
    }
}

/// A STATUSTEXT.
#[derive(Clone, Debug, PartialEq)]
pub struct Text {
    /// When it arrived.
    pub at: Ticks,
    /// How bad it is.
    pub severity: MavSeverity,
    /// What it says.
    pub text: String,
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
    /// Texts.
    pub texts: Vec<Text>,
    /// System states with the time they arrived.
    pub status: Vec<(Ticks, SYS_STATUS_DATA)>,
    /// Parameters as last told.
    pub parameters: BTreeMap<String, f32>,
}

impl Received {
    /// Sorts a message in.
    pub(crate) fn take(&mut self, at: Ticks, message: MavMessage) {
        match message {
            MavMessage::HEARTBEAT(m) => self.heartbeats.push(Heartbeat {
                at,
                state: state_of(m.custom_mode),
                reason: (m.custom_mode >> 8) as u8,
                armed: m
                    .base_mode
                    .contains(MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED),
            }),
            MavMessage::ATTITUDE_QUATERNION(m) => self.attitudes.push(Attitude {
                at,
                time_ms: m.time_boot_ms,
                quaternion: [m.q1, m.q2, m.q3, m.q4],
                rate_rad_s: [m.rollspeed, m.pitchspeed, m.yawspeed],
            }),
            MavMessage::SERVO_OUTPUT_RAW(m) => self.servos.push(ServoOutput {
                at,
                time_us: m.time_usec,
                pulse_us: m.servo1_raw,
            }),
            MavMessage::RAW_IMU(m) => self.samples.push(RawImu {
                at,
                time_us: m.time_usec,
                acc: [m.xacc, m.yacc, m.zacc],
                gyr: [m.xgyro, m.ygyro, m.zgyro],
                mag: [m.xmag, m.ymag, m.zmag],
            }),
            MavMessage::STATUSTEXT(m) => self.texts.push(Text {
                at,
                severity: m.severity,
                text: text(&m.text).to_owned(),
            }),
            MavMessage::SYS_STATUS(m) => self.status.push((at, m)),
            MavMessage::PARAM_VALUE(m) => {
                let name = text(&m.param_id).to_owned();
                self.parameters.insert(name, m.param_value);
            }
            _ => {}
        }
    }
}
