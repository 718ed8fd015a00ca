//! What the host asks, and what it gets.

use core::fmt;

use bno055_driver::Micros;
use mavlink::dialects::common::{
    AUTOPILOT_VERSION_DATA, COMMAND_ACK_DATA, COMMAND_LONG_DATA, HEARTBEAT_DATA,
    LOG_REQUEST_DATA_DATA, LOG_REQUEST_END_DATA, LOG_REQUEST_LIST_DATA, MavCmd, MavParamType,
    MavProtocolCapability, MavResult, NAMED_VALUE_INT_DATA, PARAM_REQUEST_LIST_DATA,
    PARAM_REQUEST_READ_DATA, PARAM_SET_DATA, PARAM_VALUE_DATA, TIMESYNC_DATA,
};
use mavlink::types::CharArray;
use mavlink::{MavlinkVersion, MessageData};

use super::parser::Message;
use super::queue::Priority;
use super::{OVERHEAD, Reset, Telemetry, milliseconds};
use crate::bringup;
use crate::config::{COMPONENT_ID, PULSE_MAX_US, PULSE_MIN_US, SYSTEM_ID};
use crate::failsafe::{Command, Refusal, RefusalKind, State};
use crate::flight::Flight;
use crate::params::{Change, Info, ParamError, Params, TABLE};
use crate::servo::PulseUs;

/// MAV_CMD_DO_GRIPPER's second parameter: let go (GRIPPER_ACTION_RELEASE).
const GRIPPER_RELEASE: f32 = 0.0;

/// Tells builds of the same version apart: a sum over the sources of the image, zero on the host.
const BUILD_ID: [u8; 8] = match option_env!("TVC_BUILD_ID") {
    Some(text) => match u64::from_str_radix(text, 16) {
        Ok(id) => id.to_be_bytes(),
        Err(_) => [0; 8],
    },
    None => [0; 8],
};

/// A PARAM_VALUE frame's length.
const PARAM_VALUE_FRAME: usize = OVERHEAD + PARAM_VALUE_DATA::ENCODED_LEN;

impl Telemetry {
    /// Do what a message asks. `None` for one whose payload means nothing.
    pub(super) fn answer(
        &mut self,
        now: Micros,
        message: &Message,
        flight: &mut Flight,
    ) -> Option<()> {
        match message.id {
            HEARTBEAT_DATA::ID => flight.host_heard(now),
            TIMESYNC_DATA::ID => self.synchronise(now, &decode(message)?),
            PARAM_REQUEST_LIST_DATA::ID => {
                let request: PARAM_REQUEST_LIST_DATA = decode(message)?;
                if is_for_us(request.target_system, request.target_component) {
                    self.list = Some(0);
                }
            }
            PARAM_REQUEST_READ_DATA::ID => self.read_param(&decode(message)?, flight.params()),
            PARAM_SET_DATA::ID => self.set_param(&decode(message)?, flight),
            COMMAND_LONG_DATA::ID => self.command(now, message, flight),
            LOG_REQUEST_LIST_DATA::ID => self.order_log_list(&decode(message)?),
            LOG_REQUEST_DATA_DATA::ID => self.order_log_data(&decode(message)?),
            LOG_REQUEST_END_DATA::ID => self.end_log_data(),
            _ => {}
        }
        Some(())
    }

    /// Send the next parameter of a list under way, when there is room for it.
    pub(super) fn continue_list(&mut self, params: &Params) {
        let Some(index) = self.list else { return };
        match params.by_index(index) {
            None => self.list = None,
            Some((info, value)) => {
                if self.queue.has_room(PARAM_VALUE_FRAME, Priority::Stream) {
                    self.param_value(index, info, value);
                    self.list = Some(index + 1);
                }
            }
        }
    }

    fn synchronise(&mut self, now: Micros, request: &TIMESYNC_DATA) {
        // tc1 = 0 asks; anything else is somebody's answer.
        if let TIMESYNC_DATA { tc1: 0, ts1 } = *request {
            let tc1 = now.0.wrapping_mul(1000) as i64;
            self.send_event(&TIMESYNC_DATA { tc1, ts1 });
        }
    }

    fn read_param(&mut self, request: &PARAM_REQUEST_READ_DATA, params: &Params) {
        if !is_for_us(request.target_system, request.target_component) {
            return;
        }
        // A negative index asks by name.
        let index = usize::try_from(request.param_index).ok();
        let index = index.or_else(|| Some(find(&request.param_id)?.0));
        match index.filter(|index| *index < Params::count()) {
            Some(index) => self.report_param(index, params),
            None => self.refuse_param(&ParamError::Unknown),
        }
    }

    /// Change a parameter and tell its value, which after a refusal is the old one.
    fn set_param(&mut self, request: &PARAM_SET_DATA, flight: &mut Flight) {
        if !is_for_us(request.target_system, request.target_component) {
            return;
        }
        let Some((index, info)) = find(&request.param_id) else {
            return self.refuse_param(&ParamError::Unknown);
        };
        if let Err(error) = flight.set_param(info.name, request.param_value) {
            self.refuse_param(&error);
        }
        self.report_param(index, flight.params());
        if info.change == Change::Turning {
            self.report_param(Params::POLARITY, flight.params());
        }
    }

    /// Tell the value of the parameter with this index.
    pub fn report_param(&mut self, index: usize, params: &Params) {
        if let Some((info, value)) = params.by_index(index) {
            self.param_value(index, info, value);
        }
    }

    pub(super) fn refuse_param(&mut self, error: &ParamError) {
        self.warn(format_args!("{error}"));
    }

    fn param_value(&mut self, index: usize, info: &Info, value: f32) {
        self.send_event(&PARAM_VALUE_DATA {
            param_value: value,
            param_count: Params::count() as u16,
            param_index: index as u16,
            param_id: CharArray::from(info.name),
            param_type: MavParamType::MAV_PARAM_TYPE_REAL32,
        });
    }

    fn command(&mut self, now: Micros, message: &Message, flight: &mut Flight) {
        let Order {
            param1,
            param2,
            command,
            target_system,
            target_component,
        } = Order::decode(&message.payload);
        if !is_for_us(target_system, target_component) {
            return;
        }
        const ARM_DISARM: u16 = MavCmd::MAV_CMD_COMPONENT_ARM_DISARM as u16;
        const GRIPPER: u16 = MavCmd::MAV_CMD_DO_GRIPPER as u16;
        const INTERVAL: u16 = MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL as u16;
        // MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES, which older clients still send.
        const CAPABILITIES: u16 = 520;
        const REBOOT: u16 = MavCmd::MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN as u16;
        const CALIBRATION: u16 = MavCmd::MAV_CMD_PREFLIGHT_CALIBRATION as u16;
        const SERVO: u16 = MavCmd::MAV_CMD_DO_SET_SERVO as u16;
        const STORAGE: u16 = MavCmd::MAV_CMD_PREFLIGHT_STORAGE as u16;
        const REQUEST_MESSAGE: u16 = MavCmd::MAV_CMD_REQUEST_MESSAGE as u16;
        let step_us = flight.params().control_period_us();
        let answer = match command {
            ARM_DISARM if param1 == 1.0 => self.order(now, Command::Arm, flight),
            ARM_DISARM if param1 == 0.0 => self.order(now, Command::Disarm, flight),
            GRIPPER if param2 == GRIPPER_RELEASE => self.order(now, Command::Release, flight),
            CALIBRATION if param1 == 1.0 => self.calibrate(flight),
            SERVO if param1 == 1.0 && (PULSE_MIN_US..=PULSE_MAX_US).contains(&param2) => {
                let pulse = PulseUs(param2 as u16);
                self.order(now, Command::TestPulse(pulse), flight)
            }
            // Answered when it is done.
            STORAGE => return self.order_storage(param1, flight),
            bringup::COMMAND if flight.state().is_idle() => {
                // Answered when it is done.
                self.bringup = Some(bringup::Order {
                    what: param1 as u8,
                    number: param2.to_bits(),
                });
                return;
            }
            bringup::COMMAND => Err(Refusal::WrongState(flight.state()).kind()),
            REBOOT if param1 == 1.0 => self.reset(Reset::Restart, flight),
            REBOOT if param1 == 3.0 => self.reset(Reset::Bootloader, flight),
            INTERVAL if self.rates.set(param1, param2, step_us) => Ok(()),
            ARM_DISARM | GRIPPER | CALIBRATION | SERVO | REBOOT | INTERVAL => {
                return self.acknowledge(command, MavResult::MAV_RESULT_DENIED);
            }
            CAPABILITIES => self.version(),
            REQUEST_MESSAGE if param1 == AUTOPILOT_VERSION_DATA::ID as f32 => self.version(),
            _ => return self.acknowledge(command, MavResult::MAV_RESULT_UNSUPPORTED),
        };
        match answer {
            Ok(()) => self.acknowledge(command, MavResult::MAV_RESULT_ACCEPTED),
            Err(refusal) => self.acknowledge_refusal(command, refusal),
        }
    }

    fn order(&mut self, now: Micros, command: Command, flight: &mut Flight) -> Answer {
        let answer = flight.command(now, command);
        self.report_answer(format_args!("{command}"), answer, flight)
    }

    /// Gyro calibration: back to the self-test, the estimate begins anew.
    fn calibrate(&mut self, flight: &mut Flight) -> Answer {
        let answer = flight.calibrate();
        self.report_answer(format_args!("calibration"), answer, flight)
    }

    /// A reset stops the pulses for half a second: not while they may be needed.
    fn reset(&mut self, reset: Reset, flight: &Flight) -> Answer {
        let state = flight.state();
        if state.is_armed() || matches!(state, State::Failsafe(_)) {
            let refused = Err(Refusal::WrongState(state));
            return self.report_answer(format_args!("reboot"), refused, flight);
        }
        self.reset = Some(reset);
        Ok(())
    }

    /// An order to the board itself, once.
    pub fn take_bringup(&mut self) -> Option<bringup::Order> {
        self.bringup.take()
    }

    /// Answers an order to the board itself: with a value, or that there is none.
    pub fn answer_bringup(&mut self, now: Micros, order: bringup::Order, value: Option<u32>) {
        let mut result = MavResult::MAV_RESULT_DENIED;
        if let Some(value) = value {
            result = MavResult::MAV_RESULT_ACCEPTED;
            let payload = bringup::answer(milliseconds(now), value, order.number);
            self.send_payload::<NAMED_VALUE_INT_DATA>(Priority::Event, &payload);
        }
        self.acknowledge(bringup::COMMAND, result);
    }

    /// Tells the state that an order led to, or why it was refused.
    fn report_answer(
        &mut self,
        order: fmt::Arguments<'_>,
        answer: Result<(), Refusal>,
        flight: &Flight,
    ) -> Answer {
        match &answer {
            Ok(()) => self.announce(&flight.state()),
            Err(refusal) => self.warn(format_args!("{order} refused: {refusal}")),
        }
        answer.map_err(|refusal| refusal.kind())
    }

    fn version(&mut self) -> Answer {
        self.send_event(&AUTOPILOT_VERSION_DATA {
            capabilities: MavProtocolCapability::MAV_PROTOCOL_CAPABILITY_MAVLINK2
                | MavProtocolCapability::MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_C_CAST,
            flight_sw_version: version_number(env!("CARGO_PKG_VERSION")),
            flight_custom_version: BUILD_ID,
            ..AUTOPILOT_VERSION_DATA::DEFAULT
        });
        Ok(())
    }

    /// COMMAND_ACK by the command's number: the dialect's type cannot carry one that it does not
    /// know.
    pub(super) fn acknowledge(&mut self, command: u16, result: MavResult) {
        let [low, high] = command.to_le_bytes();
        self.send_payload::<COMMAND_ACK_DATA>(Priority::Event, &[low, high, result as u8]);
    }

    /// COMMAND_ACK with the kind of the refusal as `result_param1`, an extension that clients
    /// without it ignore.
    fn acknowledge_refusal(&mut self, command: u16, refusal: RefusalKind) {
        let [low, high] = command.to_le_bytes();
        let result = MavResult::MAV_RESULT_TEMPORARILY_REJECTED as u8;
        let payload = [low, high, result, refusal.code()];
        self.send_payload::<COMMAND_ACK_DATA>(Priority::Event, &payload);
    }
}

/// What becomes of an order that was understood.
type Answer = Result<(), RefusalKind>;

/// What counts of a COMMAND_LONG. The dialect's own decoder is of no use: it knows each of its 160
/// commands by a name, which takes 2 KB, and gives up on any other, which is yet to be answered.
struct Order {
    param1: f32,
    param2: f32,
    command: u16,
    target_system: u8,
    target_component: u8,
}

impl Order {
    /// The fields at their places on the wire; trailing zeros may have been left out.
    fn decode(payload: &[u8]) -> Self {
        let byte = |at: usize| payload.get(at).copied().unwrap_or(0);
        let float = |at: usize| f32::from_le_bytes([at, at + 1, at + 2, at + 3].map(byte));
        Self {
            param1: float(0),
            param2: float(4),
            command: u16::from_le_bytes([28, 29].map(byte)),
            target_system: byte(30),
            target_component: byte(31),
        }
    }
}

fn decode<D: MessageData>(message: &Message) -> Option<D> {
    D::deser(MavlinkVersion::V2, &message.payload).ok()
}

/// Index and row of the parameter whose name is in `id`, which ends at a zero or fills the field.
fn find(id: &[u8; 16]) -> Option<(usize, &'static Info)> {
    let name = id.split(|byte| *byte == 0).next()?;
    let mut rows = TABLE.iter().enumerate();
    rows.find(|(_, info)| info.name.as_bytes() == name)
}

/// Addressed to this vehicle, or to all.
pub(super) fn is_for_us(system: u8, component: u8) -> bool {
    (system == SYSTEM_ID || system == 0) && (component == COMPONENT_ID || component == 0)
}

/// `major.minor.patch` as `flight_sw_version` has it: a byte each from the top, and below the
/// release type that a pre-release names (MAVLink's FIRMWARE_VERSION_TYPE). Build metadata is
/// ignored.
const fn version_number(version: &str) -> u32 {
    let mut number: u32 = 0;
    let mut part: u32 = 0;
    let mut release_type = OFFICIAL;
    let mut bytes = version.as_bytes();
    while let [byte, rest @ ..] = bytes {
        match *byte {
            b'.' => {
                number = number << 8 | part;
                part = 0;
            }
            digit @ b'0'..=b'9' => part = part * 10 + (digit - b'0') as u32,
            b'-' => {
                release_type = pre_release_type(rest);
                break;
            }
            _ => break,
        }
        bytes = rest;
    }
    (number << 8 | part) << 8 | release_type
}

/// FIRMWARE_VERSION_TYPE_OFFICIAL.
const OFFICIAL: u32 = 255;

/// The type of a pre-release by the word that it begins with: one for development where it is none
/// of MAVLink's.
const fn pre_release_type(name: &[u8]) -> u32 {
    match name {
        [b'a', b'l', b'p', b'h', b'a', ..] => 64,
        [b'b', b'e', b't', b'a', ..] => 128,
        [b'r', b'c', ..] => 192,
        _ => 0,
    }
}

#[cfg(test)]
mod tests {
    use super::version_number;

    #[test]
    fn a_version_is_a_byte_a_part_and_its_release_type() {
        for (version, word) in [
            ("0.1.0", 0x0001_00FF),
            ("1.22.255", 0x0116_FFFF),
            ("0.2.0-rc.1", 0x0002_00C0),
            ("0.2.0-beta", 0x0002_0080),
            ("0.2.0-alpha.3+5f2", 0x0002_0040),
            ("0.2.0-dev", 0x0002_0000),
            ("0.2.0+20261122", 0x0002_00FF),
        ] {
            assert_eq!(version_number(version), word, "{version}");
        }
    }
}
