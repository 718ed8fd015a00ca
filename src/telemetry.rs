//! MAVLink 2: what the host is told of the flight, and what it orders.
//!
//! Nothing here waits. Frames go into a queue from which the board sends what the host takes
//! ([`Telemetry::pending`], [`Telemetry::sent`]); when the host lags, whole frames are dropped and
//! counted, and their sequence numbers are spent, so that the host counts the same losses.
//!
//! | out | when |
//! |---|---|
//! | HEARTBEAT, SYS_STATUS | once a second, HEARTBEAT also at every change of state |
//! | CURRENT_MODE | every change of state |
//! | DEBUG_VECT `imu_bus` | once a second: mean and longest of the newest bursts, us, and how often the sensor gives new data, Hz |
//! | STATUSTEXT | every change of state and every refusal (the same one again after two seconds), with the reason; a magnetometer that fails; once a second what keeps the sensor from starting, and why control was given up or must be acknowledged |
//! | ATTITUDE_QUATERNION, SERVO_OUTPUT_RAW | every step |
//! | RAW_IMU | every step that had a sample: its untouched counts, stamped with its own time |
//! | NAMED_VALUE_FLOAT `crank` | every step: the crank angle that control asked for, rad, before limits |
//! | NAMED_VALUE_FLOAT `tilt_sd`, `head_sd` | once a second: standard deviations of tilt and heading, deg |
//! | NAMED_VALUE_FLOAT `gain` | once a second: the plant's gain that control estimates, in those of `PITCH_GAIN` |
//! | V2_EXTENSION | once a second from standby on, in parts: all that the flight remembers after a step ([`Flight::tell`]), from which a replay goes on behind lost frames |
//! | ATTITUDE | not by itself: at the interval that the host asks for |
//! | COMMAND_ACK | every command, COMMAND_LONG or COMMAND_INT, to the one that sent it; a gyro calibration is in progress once a second until it is accepted |
//! | PARAM_VALUE, PARAM_ERROR | on request; the parameter list one a step; after a refusal both |
//! | AUTOPILOT_VERSION, PROTOCOL_VERSION, MESSAGE_INTERVAL, AVAILABLE_MODES | on request; the modes one a step: every state with every reason, none of which a station can choose |
//! | MISSION_COUNT, MISSION_ACK | on request: there is no mission, fence or rally point, and none is taken |
//! | TIMESYNC, PING | on request |
//! | FILE_TRANSFER_PROTOCOL | every request for a file is refused at once: there are none |
//! | NAMED_VALUE_INT | on request: see [`bringup`] |
//! | LOG_ENTRY, LOG_DATA | on request: what the [`Recorder`](crate::Recorder) holds, a part a step |
//!
//! What comes every step comes less often if the host asks for that (MAV_CMD_SET_MESSAGE_INTERVAL),
//! until it opens the port again. ATTITUDE carries the same attitude as ATTITUDE_QUATERNION, for
//! clients that take only angles (MAVSDK's Euler angles, MAVProxy's horizon); QGroundControl takes
//! the quaternion.
//!
//! MAV_CMD_RUN_PREARM_CHECKS gets the COMMAND_ACK that an order to arm would get, without a text.
//!
//! On MAV_CMD_REQUEST_MESSAGE the vehicle sends any message that it streams once more.
//!
//! HEARTBEAT carries [`State::code`](crate::State::code) as `custom_mode`. Every frame has the
//! system id of `MAV_SYSID` as it was at start-up.

mod answers;
mod checksum;
mod commands;
mod download;
mod memory;
mod modes;
mod parser;
mod queue;
mod rates;
mod sending;
mod storage;
mod version;

use mavlink::dialects::common::{
    ATTITUDE_DATA, ATTITUDE_QUATERNION_DATA, DEBUG_VECT_DATA, HEARTBEAT_DATA, MavAutopilot,
    MavModeFlag, MavSeverity, MavState, MavSysStatusSensor, MavType, NAMED_VALUE_FLOAT_DATA,
    RAW_IMU_DATA, SERVO_OUTPUT_RAW_DATA, SYS_STATUS_DATA,
};
use tvc_imu::{Micros, RawSample};

use crate::axis::Axis;
use crate::board_status::BoardStatus;
use crate::bringup;
use crate::config::{HEARTBEAT_PERIOD_US, HOST_GONE_US};
use crate::failsafe::{Command, RefusalKind, State};
use crate::flight::{Flight, Snapshot};
use crate::sensor::SensorStatus;
use crate::servo::PulseUs;
use crate::store::Saving;
use download::Download;
use parser::{Address, Parser};
use queue::{Priority, Queue};
use rates::{Rates, Stream};
use storage::StorageOrder;

pub use memory::{MEMORY_TYPE, PART_WORDS, WORDS as MEMORY_WORDS};
pub use version::Identity;

/// Longest payload of a message that is sent as the dialect encodes it: STATUSTEXT's.
const MAX_PAYLOAD: usize = 51;
/// What HEARTBEAT says of the protocol.
const MAVLINK_VERSION: u32 = 3;
/// Heartbeats for which a sensor that should stand by may be missing: a start takes four.
const STANDBY_PATIENCE: u8 = 10;
/// Header and checksum.
const OVERHEAD: usize = 10 + 2;

/// The resets that the host may ask for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reset {
    /// Start anew.
    Restart,
    /// Into the bootloader, to be programmed.
    Bootloader,
}

/// Both directions of the link, and what waits for the host.
#[derive(Clone, Debug)]
pub struct Telemetry {
    identity: Identity,
    queue: Queue,
    parser: Parser,
    /// To whom acknowledgements go.
    asker: Address,
    /// When the host's last whole message came.
    heard_at: Option<Micros>,
    sequence: u8,
    /// [`State::code`] that the host has been told.
    announced: Option<u32>,
    heartbeat_at: Option<Micros>,
    /// The driver's count of fresh bursts at the last heartbeat.
    fresh: u32,
    /// The host is to be told what the flight remembers.
    memory_due: bool,
    /// The host has been told of the magnetometer whether it measures a field.
    field_told: bool,
    /// Heartbeats in a row without the sensor that should stand by.
    standby_missing: u8,
    /// Next parameter of a list under way.
    list: Option<usize>,
    /// The next mode to tell of, and where that ends.
    modes: (usize, usize),
    /// What the host wants done with stored parameters, and who that is.
    storage: Option<(StorageOrder, Address)>,
    /// How far the save is that it asks for.
    saving: Option<Saving>,
    download: Download,
    rates: Rates,
    reset: Option<Reset>,
    /// Who waits for a calibration to end.
    calibration: Option<Address>,
    /// The refusal that was told last, and when.
    refused: Option<(RefusalKind, Micros)>,
    /// What `tvc bringup` wants of the board.
    bringup: Option<(bringup::Order, Address)>,
}

impl Telemetry {
    /// Nothing sent, nothing received.
    pub const fn new(identity: Identity) -> Self {
        Self {
            identity,
            queue: Queue::new(),
            parser: Parser::new(),
            asker: [0; 2],
            heard_at: None,
            sequence: 0,
            announced: None,
            heartbeat_at: None,
            fresh: 0,
            memory_due: false,
            field_told: true,
            standby_missing: 0,
            list: None,
            modes: (0, 0),
            storage: None,
            saving: None,
            download: Download::new(),
            rates: Rates::new(),
            reset: None,
            calibration: None,
            refused: None,
            bringup: None,
        }
    }

    /// As new, for a new listener. In place: a new value would take 2 KB of stack on its way here.
    pub fn restart(&mut self) {
        let Self {
            identity: _,
            queue,
            parser,
            asker: _,
            heard_at: _,
            sequence,
            announced,
            heartbeat_at,
            fresh: _,
            memory_due,
            field_told,
            standby_missing,
            list,
            modes,
            storage,
            saving,
            download,
            rates,
            reset,
            calibration,
            refused,
            bringup,
        } = self;
        queue.restart();
        *parser = Parser::new();
        *download = Download::new();
        *rates = Rates::new();
        *sequence = 0;
        (*announced, *heartbeat_at, *list) = (None, None, None);
        (*storage, *reset, *calibration, *bringup) = (None, None, None, None);
        *refused = None;
        *saving = None;
        (*modes, *memory_due, *field_told) = ((0, 0), false, true);
        *standby_missing = 0;
    }

    /// Queue the messages of a step.
    pub fn record(
        &mut self,
        snapshot: &Snapshot,
        flight: &Flight,
        sensor: &SensorStatus,
        board: &BoardStatus,
    ) {
        if self.announced.is_none() {
            self.report_stored(flight.stored());
            if flight.params().clock_fine().is_none() {
                self.warn(format_args!("clock: raw, up to 3 % off without USB"));
            }
        }
        self.announce(&snapshot.state);
        self.stream(snapshot, flight);
        self.watch_field(snapshot);
        let due =
            self.heartbeat_at.is_none_or(|last| snapshot.now.since(last) >= HEARTBEAT_PERIOD_US);
        if self.rates.due(Stream::Heartbeat) || due {
            self.heartbeat(&snapshot.state);
        }
        if self.rates.due(Stream::Status) || due {
            self.system_status(snapshot, flight, sensor, board);
        }
        self.memory_due |= self.rates.due(Stream::Memory) || due;
        if due {
            self.heartbeat_at = Some(snapshot.now);
            self.bus_status(snapshot, sensor.fresh, board);
            self.estimates(snapshot, flight);
            self.watch_standby(sensor);
            match (&snapshot.state, snapshot.fault) {
                (State::Boot, Some(fault)) => self.warn(format_args!("{fault}")),
                // Who begins to listen now is to know why.
                (State::Failsafe(_) | State::Latched(_), _) => self.tell_state(&snapshot.state),
                _ => {}
            }
        }
        self.follow_calibration(flight, due);
        if !self.continue_list(flight.params()) {
            self.continue_modes();
        }
    }

    /// What the host has not taken yet, oldest first.
    pub fn pending(&self) -> &[u8] {
        self.queue.pending()
    }

    /// The host has taken the first `count` bytes of [`Telemetry::pending`].
    pub fn sent(&mut self, count: usize) {
        self.queue.sent(count);
    }

    /// Frames dropped because the host did not take them.
    pub fn dropped(&self) -> u32 {
        self.queue.dropped()
    }

    /// Take bytes from the host, in pieces of any size, and obey the messages in them. Bytes that
    /// make no message are ignored.
    pub fn receive(&mut self, now: Micros, bytes: &[u8], flight: &mut Flight) {
        self.hear(now, bytes, Some(flight));
    }

    /// Take bytes from a host that would not hear an answer: their messages say that it is there,
    /// and are not obeyed.
    pub fn listen(&mut self, now: Micros, bytes: &[u8]) {
        self.hear(now, bytes, None);
    }

    fn hear(&mut self, now: Micros, bytes: &[u8], mut flight: Option<&mut Flight>) {
        for &byte in bytes {
            self.parser.push(byte);
            while let Some(message) = self.parser.next_message() {
                self.heard_at = Some(now);
                if let Some(flight) = &mut flight {
                    // A payload that means nothing is ignored.
                    let _ = self.answer(now, &message, flight);
                }
            }
        }
    }

    /// Whether the host has sent a whole message lately.
    pub fn has_heard(&self, now: Micros) -> bool {
        self.heard_at.is_some_and(|heard| now.since(heard) < HOST_GONE_US)
    }

    /// A reset that the host has asked for, once. It was not armed then.
    pub fn take_reset(&mut self) -> Option<Reset> {
        self.reset.take()
    }

    /// Tell the host of a change of state, at once and in words.
    fn announce(&mut self, state: &State) {
        let code = state.code();
        if self.announced == Some(code) {
            return;
        }
        self.announced = Some(code);
        self.heartbeat(state);
        self.current_mode(code);
        self.tell_state(state);
    }

    /// The state in words.
    fn tell_state(&mut self, state: &State) {
        let severity = match state {
            State::Latched(_) => MavSeverity::MAV_SEVERITY_EMERGENCY,
            State::Failsafe(_) => MavSeverity::MAV_SEVERITY_CRITICAL,
            State::SelfTest(test) if test.failure.is_some() => MavSeverity::MAV_SEVERITY_WARNING,
            _ => MavSeverity::MAV_SEVERITY_INFO,
        };
        self.status_text(severity, format_args!("{state}"));
    }

    /// The messages of every step, each as the words of its payload: the dialect's own encoder
    /// takes several times as long.
    fn stream(&mut self, snapshot: &Snapshot, flight: &Flight) {
        let rates = || snapshot.rates.map(|rate| f32::from(rate).to_bits());
        let time = snapshot.sample.map_or(snapshot.now, |sample| sample.time);
        let time_boot_ms = milliseconds(time);
        if self.rates.due(Stream::Attitude) {
            let q = snapshot.orientation.parts();
            let [w, x, y, z] = [q.w, q.x, q.y, q.z].map(f32::to_bits);
            let [roll, pitch, yaw] = rates();
            let words = [time_boot_ms, w, x, y, z, roll, pitch, yaw];
            self.send_words::<ATTITUDE_QUATERNION_DATA>(Priority::Stream, &words);
        }
        if self.rates.due(Stream::Servo) {
            let [PulseUs(first), PulseUs(second)] = snapshot.pulses;
            let words = [snapshot.now.0 as u32, pair(first, second)];
            self.send_words::<SERVO_OUTPUT_RAW_DATA>(Priority::Stream, &words);
        }
        if let Some(sample) = &snapshot.sample
            && self.rates.due(Stream::Raw)
        {
            self.send_words::<RAW_IMU_DATA>(Priority::Stream, &raw_imu_words(sample));
        }
        if self.rates.due(Stream::Crank) {
            let steered = flight.params().axes().len();
            let cranks = snapshot.cranks.into_iter().zip(CRANK_WORDS);
            for (crank, [name, last]) in cranks.take(steered) {
                let crank_rad = f32::from(crank).to_bits();
                let words = [time_boot_ms, crank_rad, name, last];
                self.send_words::<NAMED_VALUE_FLOAT_DATA>(Priority::Stream, &words);
            }
        }
        if self.rates.due(Stream::Angles) {
            let [roll, pitch, yaw] = flight.angles_rad().map(f32::to_bits);
            let [rollspeed, pitchspeed, yawspeed] = rates();
            let words = [time_boot_ms, roll, pitch, yaw, rollspeed, pitchspeed, yawspeed];
            self.send_words::<ATTITUDE_DATA>(Priority::Stream, &words);
        }
    }

    fn heartbeat(&mut self, state: &State) {
        let mut base_mode = MavModeFlag::MAV_MODE_FLAG_CUSTOM_MODE_ENABLED;
        base_mode.set(MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED, state.is_armed());
        base_mode.set(MavModeFlag::MAV_MODE_FLAG_STABILIZE_ENABLED, state.is_active());
        let system_status = match state {
            State::Boot => MavState::MAV_STATE_BOOT,
            State::SelfTest(_) => MavState::MAV_STATE_CALIBRATING,
            State::Standby => MavState::MAV_STATE_STANDBY,
            State::Armed | State::Active { .. } => MavState::MAV_STATE_ACTIVE,
            State::Failsafe(_) => MavState::MAV_STATE_CRITICAL,
            State::Latched(_) => MavState::MAV_STATE_EMERGENCY,
        };
        let kind = u32::from_le_bytes([
            MavType::MAV_TYPE_ROCKET as u8,
            MavAutopilot::MAV_AUTOPILOT_GENERIC as u8,
            base_mode.bits(),
            system_status as u8,
        ]);
        self.send_words::<HEARTBEAT_DATA>(Priority::Event, &[state.code(), kind, MAVLINK_VERSION]);
    }

    /// Load and health. Sensors are present always, healthy while samples come; what is enabled but
    /// not healthy is what clients report as a fault. The check before arming is healthy where an
    /// order to arm is obeyed, and while the drone is armed.
    fn system_status(
        &mut self,
        snapshot: &Snapshot,
        flight: &Flight,
        sensor: &SensorStatus,
        board: &BoardStatus,
    ) {
        let inertial = MavSysStatusSensor::MAV_SYS_STATUS_SENSOR_3D_GYRO
            | MavSysStatusSensor::MAV_SYS_STATUS_SENSOR_3D_ACCEL;
        let magnetometer = MavSysStatusSensor::MAV_SYS_STATUS_SENSOR_3D_MAG;
        let has_mag = flight.params().sensor_kind().description().has_mag;
        let second = MavSysStatusSensor::MAV_SYS_STATUS_SENSOR_3D_GYRO2
            | MavSysStatusSensor::MAV_SYS_STATUS_SENSOR_3D_ACCEL2;
        let mut sensors = inertial;
        sensors.set(magnetometer, has_mag);
        sensors.set(second, sensor.standby.is_some());
        let attitude = MavSysStatusSensor::MAV_SYS_STATUS_AHRS;
        let control = MavSysStatusSensor::MAV_SYS_STATUS_SENSOR_ATTITUDE_STABILIZATION;
        let readiness = MavSysStatusSensor::MAV_SYS_STATUS_PREARM_CHECK;
        let enabled_control = match snapshot.state {
            State::Active { .. } | State::Failsafe(_) => control,
            _ => MavSysStatusSensor::empty(),
        };
        // There is no fence, so nothing is beyond it: MAVProxy calls anything else a breach.
        let mut health = MavSysStatusSensor::MAV_SYS_STATUS_GEOFENCE;
        health.set(inertial, snapshot.sensor_healthy);
        health.set(magnetometer, snapshot.sensor_healthy && snapshot.field_healthy);
        health.set(second, sensor.standby == Some(true));
        health.set(attitude, snapshot.sensor_healthy && snapshot.settled);
        health.set(control, !matches!(snapshot.state, State::Failsafe(_)));
        let is_ready = snapshot.state.is_armed() || flight.may(snapshot.now, Command::Arm).is_ok();
        health.set(readiness, is_ready);
        /// A battery that is not measured: its voltage, current and remaining charge.
        const UNKNOWN: u16 = u16::MAX;
        const NO_LOSS: u16 = 0;
        let words = [
            (sensors | attitude | control | readiness).bits(),
            (sensors | attitude | enabled_control | readiness).bits(),
            health.bits(),
            pair(board.load_permille, UNKNOWN),
            pair(UNKNOWN, NO_LOSS),
            pair(self.parser.crc_errors(), self.queue.dropped() as u16),
            pair(snapshot.missed as u16, board.bus_errors),
            pair(board.bus_recoveries, UNKNOWN & 0xFF),
        ];
        self.send_words::<SYS_STATUS_DATA>(Priority::Event, &words);
    }

    /// How uncertain tilt and heading are, and the plant's gain.
    #[inline(never)]
    fn estimates(&mut self, snapshot: &Snapshot, flight: &Flight) {
        let [tilt, heading] = flight.attitude_sd_deg();
        for (name, ends, value) in [
            (*b"tilt", *b"_sd\0", tilt),
            (*b"head", *b"_sd\0", heading),
            (*b"gain", [0; 4], flight.plant_gain().into()),
        ] {
            let [name, ends] = [name, ends].map(u32::from_le_bytes);
            let words = [milliseconds(snapshot.now), value.to_bits(), name, ends];
            self.send_words::<NAMED_VALUE_FLOAT_DATA>(Priority::Event, &words);
        }
    }

    /// How the sensor and its bus do. A second of the first call after a pause is longer.
    fn bus_status(&mut self, snapshot: &Snapshot, total: u32, board: &BoardStatus) {
        let fresh = total.wrapping_sub(self.fresh);
        self.fresh = total;
        let [mean_us, max_us, fresh] = [board.bursts.mean_us, board.bursts.max_us, fresh]
            .map(|number| (number as f32).to_bits());
        let [time_low, time_high] = halves(snapshot.now);
        let words = [time_low, time_high, mean_us, max_us, fresh, BUS_NAME[0], BUS_NAME[1]];
        self.send_words::<DEBUG_VECT_DATA>(Priority::Event, &words);
    }

    /// A sensor that should stand by and cannot fly is told once.
    fn watch_standby(&mut self, sensor: &SensorStatus) {
        let is_missing = sensor.standby == Some(false);
        self.standby_missing = if is_missing { self.standby_missing.saturating_add(1) } else { 0 };
        if self.standby_missing == STANDBY_PATIENCE {
            self.warn(format_args!("second IMU does not stand by"));
        }
    }

    /// A magnetometer that stops measuring, or begins again, is told once.
    fn watch_field(&mut self, snapshot: &Snapshot) {
        let healthy = snapshot.field_healthy || !snapshot.sensor_healthy;
        if core::mem::replace(&mut self.field_told, healthy) != healthy && !healthy {
            self.warn(format_args!("no magnetic field: heading drifts"));
        }
    }
}

impl Default for Telemetry {
    fn default() -> Self {
        Self::new(Identity::default())
    }
}

/// Milliseconds since start-up. Wraps after 49 days, as MAVLink's field does.
///
/// Divides by hand, 16 bits at a time: the chip has no division, and a 64-bit one is slow and takes
/// 1 KB.
fn milliseconds(time: Micros) -> u32 {
    if let Ok(us) = u32::try_from(time.0) {
        // The first 71 minutes: 2^38 / 1000, rounded up, is exact for every number of 32 bits.
        return ((u64::from(us) * 274_877_907) >> 38) as u32;
    }
    let (mut quotient, mut remainder) = (0, 0);
    for shift in [48, 32, 16, 0] {
        let part = remainder << 16 | (time.0 >> shift) as u32 & 0xFFFF;
        quotient = (quotient << 16) | (part / 1000);
        remainder = part % 1000;
    }
    quotient
}

/// RAW_IMU as the vehicle sends it: untouched counts and their own time, us.
pub fn raw_imu(sample: &RawSample) -> RAW_IMU_DATA {
    let ([xacc, yacc, zacc], [xgyro, ygyro, zgyro], [xmag, ymag, zmag]) =
        (sample.acc, sample.gyr, sample.mag);
    RAW_IMU_DATA {
        time_usec: sample.time.0,
        xacc,
        yacc,
        zacc,
        xgyro,
        ygyro,
        zgyro,
        xmag,
        ymag,
        zmag,
    }
}

/// Names of the NAMED_VALUE_FLOATs with the crank angles that control asked for, rad, by axis. As
/// short as this, what every step sends of one axis goes into two packets.
pub const CRANKS: [&str; Axis::COUNT] = ["crank", "crank2"];

/// `imu_bus` as the words of a name.
const BUS_NAME: [u32; 2] = [u32::from_le_bytes(*b"imu_"), u32::from_le_bytes(*b"bus\0")];

/// [`CRANKS`] as the words of a name.
const CRANK_WORDS: [[u32; 2]; Axis::COUNT] = [
    [u32::from_le_bytes(*b"cran"), b'k' as u32],
    [u32::from_le_bytes(*b"cran"), u32::from_le_bytes(*b"k2\0\0")],
];

/// [`raw_imu`] as words.
fn raw_imu_words(sample: &RawSample) -> [u32; 7] {
    let ([xacc, yacc, zacc], [xgyro, ygyro, zgyro], [xmag, ymag, zmag]) =
        (sample.acc, sample.gyr, sample.mag);
    let signed = |low: i16, high: i16| pair(low.cast_unsigned(), high.cast_unsigned());
    let [time_low, time_high] = halves(sample.time);
    [
        time_low,
        time_high,
        signed(xacc, yacc),
        signed(zacc, xgyro),
        signed(ygyro, zgyro),
        signed(xmag, ymag),
        signed(zmag, 0),
    ]
}

/// Two fields in a word, the first in its lower half.
fn pair(first: u16, second: u16) -> u32 {
    u32::from(first) | u32::from(second) << 16
}

/// A time as two words, the lower one first.
fn halves(time: Micros) -> [u32; 2] {
    [time.0 as u32, (time.0 >> 32) as u32]
}

#[cfg(test)]
pub(crate) mod tests;
