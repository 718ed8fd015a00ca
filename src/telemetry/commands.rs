//! What the host orders, and how it is acknowledged.

use core::fmt;

use mavlink::MessageData;
use mavlink::dialects::common::{
    AUTOPILOT_VERSION_DATA, AVAILABLE_MODES_DATA, COMMAND_ACK_DATA, CURRENT_MODE_DATA,
    MESSAGE_INTERVAL_DATA, MavCmd, MavResult, NAMED_VALUE_INT_DATA,
};
use tvc_imu::Micros;

use super::parser::Message;
use super::queue::Priority;
use super::version::ProtocolVersion;
use super::{Reset, Telemetry, milliseconds};
use crate::axis::Axis;
use crate::bringup;
use crate::config::{PULSE_MAX_US, PULSE_MIN_US};
use crate::failsafe::{Command, Refusal, RefusalKind, State};
use crate::flight::Flight;
use crate::params::whole;
use crate::servo::PulseUs;

const CALIBRATION: u16 = MavCmd::MAV_CMD_PREFLIGHT_CALIBRATION as u16;

/// The same refusal is told again after so long, us.
const REPEAT_US: u64 = 2_000_000;

/// MAV_CMD_DO_GRIPPER's second parameter: let go (GRIPPER_ACTION_RELEASE).
const GRIPPER_RELEASE: f32 = 0.0;

impl Telemetry {
    pub(super) fn command(&mut self, now: Micros, message: &Message, flight: &mut Flight) {
        let Order { param1, param2, command } = Order::decode(message);
        const ARM_DISARM: u16 = MavCmd::MAV_CMD_COMPONENT_ARM_DISARM as u16;
        const GRIPPER: u16 = MavCmd::MAV_CMD_DO_GRIPPER as u16;
        const INTERVAL: u16 = MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL as u16;
        // MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES, which older clients still send.
        const CAPABILITIES: u16 = 520;
        // MAV_CMD_GET_MESSAGE_INTERVAL; of the older clients, too.
        const GET_INTERVAL: u16 = 510;
        const READINESS: u16 = MavCmd::MAV_CMD_RUN_PREARM_CHECKS as u16;
        const REBOOT: u16 = MavCmd::MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN as u16;
        const SERVO: u16 = MavCmd::MAV_CMD_DO_SET_SERVO as u16;
        const STORAGE: u16 = MavCmd::MAV_CMD_PREFLIGHT_STORAGE as u16;
        const REQUEST_MESSAGE: u16 = MavCmd::MAV_CMD_REQUEST_MESSAGE as u16;
        let id = message_id(param1);
        let step_us = flight.params().control_period_us();
        let answer = match command {
            ARM_DISARM if param1 == 1.0 => self.order(now, Command::Arm, flight),
            ARM_DISARM if param1 == 0.0 => self.order(now, Command::Disarm, flight),
            GRIPPER if param2 == GRIPPER_RELEASE => self.order(now, Command::Release, flight),
            // A host asks again and again, so nothing is said besides.
            READINESS => flight.may(now, Command::Arm).map_err(|refusal| refusal.kind()),
            // Answered anew when it is done.
            CALIBRATION if param1 == 1.0 => match self.calibrate(now, flight) {
                Ok(()) => return self.acknowledge_progress(),
                refused => refused,
            },
            SERVO
                if (param1 == 1.0 || param1 == 2.0)
                    && (PULSE_MIN_US..=PULSE_MAX_US).contains(&param2) =>
            {
                let axis = if param1 == 1.0 { Axis::Pitch } else { Axis::Roll };
                let pulse = PulseUs(whole(param2) as u16);
                self.order(now, Command::TestPulse(axis, pulse), flight)
            }
            // Answered when it is done.
            STORAGE => return self.order_storage(param1, flight),
            bringup::COMMAND if flight.state().is_idle() => {
                // Answered when it is done.
                let order = bringup::Order {
                    what: whole(param1).clamp(0, u8::MAX.into()) as u8,
                    number: param2.to_bits(),
                };
                self.bringup = Some((order, self.asker));
                return;
            }
            bringup::COMMAND => Err(Refusal::WrongState(flight.state()).kind()),
            REBOOT if param1 == 1.0 => self.reset(now, Reset::Restart, flight),
            REBOOT if param1 == 3.0 => self.reset(now, Reset::Bootloader, flight),
            INTERVAL if self.rates.set(id, param2, step_us) => Ok(()),
            ARM_DISARM | GRIPPER | CALIBRATION | SERVO | REBOOT | INTERVAL => {
                return self.acknowledge(command, MavResult::MAV_RESULT_DENIED);
            }
            CAPABILITIES => {
                self.version();
                Ok(())
            }
            GET_INTERVAL => {
                self.message_interval(id, step_us);
                Ok(())
            }
            REQUEST_MESSAGE if self.order_message(id, param2, flight) => Ok(()),
            _ => return self.acknowledge(command, MavResult::MAV_RESULT_UNSUPPORTED),
        };
        match answer {
            Ok(()) => self.acknowledge(command, MavResult::MAV_RESULT_ACCEPTED),
            Err(refusal) => {
                let result = MavResult::MAV_RESULT_TEMPORARILY_REJECTED;
                self.acknowledge_with(command, result, refusal.code());
            }
        }
    }

    /// Sends a message, or notes it for the next step. Says whether it is one of the vehicle's.
    fn order_message(&mut self, id: u32, param2: f32, flight: &Flight) -> bool {
        match id {
            AUTOPILOT_VERSION_DATA::ID => self.version(),
            ProtocolVersion::ID => self.protocol_version(),
            CURRENT_MODE_DATA::ID => self.current_mode(flight.state().code()),
            AVAILABLE_MODES_DATA::ID => return self.order_modes(param2),
            MESSAGE_INTERVAL_DATA::ID => {
                self.message_interval(message_id(param2), flight.params().control_period_us());
            }
            _ => return self.rates.want(id),
        }
        true
    }

    /// MESSAGE_INTERVAL of the message with this number.
    fn message_interval(&mut self, id: u32, step_us: u32) {
        let [a, b, c, d] = self.rates.interval_us(id, step_us).to_le_bytes();
        let [low, high, ..] = id.to_le_bytes();
        let payload = [a, b, c, d, low, high];
        self.send_payload::<MESSAGE_INTERVAL_DATA>(Priority::Event, &payload);
    }

    fn order(&mut self, now: Micros, command: Command, flight: &mut Flight) -> Answer {
        let answer = flight.command(now, command);
        self.report_answer(now, format_args!("{command}"), answer, flight)
    }

    /// Gyro calibration: back to the self-test, the estimate begins anew.
    fn calibrate(&mut self, now: Micros, flight: &mut Flight) -> Answer {
        let answer = flight.calibrate();
        if answer.is_ok() {
            self.calibration = Some(self.asker);
        }
        self.report_answer(now, format_args!("calibration"), answer, flight)
    }

    /// Tells the end of a gyro calibration, and until then once a second that it goes on.
    pub(super) fn follow_calibration(&mut self, flight: &Flight, second: bool) {
        let Some(asker) = self.calibration else {
            return;
        };
        self.asker = asker;
        let state = flight.state();
        if flight.is_calibrated() || !state.is_idle() {
            self.calibration = None;
            let result = match state {
                State::Failsafe(_) => MavResult::MAV_RESULT_FAILED,
                _ => MavResult::MAV_RESULT_ACCEPTED,
            };
            self.acknowledge(CALIBRATION, result);
        } else if second {
            self.acknowledge_progress();
        }
    }

    /// A calibration goes on, nobody knows how long.
    fn acknowledge_progress(&mut self) {
        self.acknowledge_with(CALIBRATION, MavResult::MAV_RESULT_IN_PROGRESS, u8::MAX);
    }

    /// A reset stops the pulses for half a second: not while they may be needed.
    fn reset(&mut self, now: Micros, reset: Reset, flight: &Flight) -> Answer {
        let state = flight.state();
        if state.is_armed() || matches!(state, State::Failsafe(_)) {
            let refused = Err(Refusal::WrongState(state));
            return self.report_answer(now, format_args!("reboot"), refused, flight);
        }
        self.reset = Some(reset);
        Ok(())
    }

    /// An order to the board itself, once.
    pub fn take_bringup(&mut self) -> Option<bringup::Order> {
        let (order, asker) = self.bringup.take()?;
        self.asker = asker;
        Some(order)
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

    /// Tells the state that an order led to, or why it was refused: once, where a host asks again
    /// and again.
    fn report_answer(
        &mut self,
        now: Micros,
        order: fmt::Arguments<'_>,
        answer: Result<(), Refusal>,
        flight: &Flight,
    ) -> Answer {
        match &answer {
            Ok(()) => self.announce(&flight.state()),
            Err(refusal) => {
                let kind = refusal.kind();
                let is_told = |(told, at)| told == kind && now.since(at) < REPEAT_US;
                if !self.refused.is_some_and(is_told) {
                    self.refused = Some((kind, now));
                    self.warn(format_args!("{order} refused: {refusal}"));
                    if let Refusal::WrongState(state @ (State::Failsafe(_) | State::Latched(_))) =
                        refusal
                    {
                        self.tell_state(state);
                    }
                }
            }
        }
        answer.map_err(|refusal| refusal.kind())
    }

    /// COMMAND_ACK by the command's number: the dialect's type cannot carry one that it does not
    /// know.
    pub(super) fn acknowledge(&mut self, command: u16, result: MavResult) {
        self.acknowledge_with(command, result, 0);
    }

    /// COMMAND_ACK to the asker, with `detail` as its first extension, `progress`: of a command
    /// that is refused the [`RefusalKind`] as a number, of one that goes on 255, unknown.
    fn acknowledge_with(&mut self, command: u16, result: MavResult, detail: u8) {
        let [low, high] = command.to_le_bytes();
        let [system, component] = self.asker;
        let result = result as u8;
        let payload = [low, high, result, detail, 0, 0, 0, 0, system, component];
        self.send_payload::<COMMAND_ACK_DATA>(Priority::Event, &payload);
    }
}

/// The number of a message in a command's parameter; one that no message has for nonsense.
fn message_id(param: f32) -> u32 {
    let id = whole(param) as u32;
    if id as f32 == param { id } else { u32::MAX }
}

/// What becomes of an order that was understood.
type Answer = Result<(), RefusalKind>;

/// What counts of a COMMAND_LONG or COMMAND_INT. The dialect's own decoder is of no use: it knows
/// each of its 160 commands by a name, which takes 2 KB, and gives up on any other, which is yet to
/// be answered.
struct Order {
    param1: f32,
    param2: f32,
    command: u16,
}

impl Order {
    fn decode(message: &Message) -> Self {
        let float = |at: usize| {
            let bytes = [at, at + 1, at + 2, at + 3].map(|at| message.byte(at));
            f32::from_le_bytes(bytes)
        };
        Self {
            param1: float(0),
            param2: float(4),
            command: u16::from_le_bytes([28, 29].map(|at| message.byte(at))),
        }
    }
}
