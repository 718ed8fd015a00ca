//! What the host asks, and what it gets.

use core::array;

use heapless::Vec;
use mavlink::dialects::common::{
    COMMAND_INT_DATA, COMMAND_LONG_DATA, FILE_TRANSFER_PROTOCOL_DATA, HEARTBEAT_DATA,
    LOG_REQUEST_DATA_DATA, LOG_REQUEST_END_DATA, LOG_REQUEST_LIST_DATA, MISSION_ACK_DATA,
    MISSION_CLEAR_ALL_DATA, MISSION_COUNT_DATA, MISSION_REQUEST_LIST_DATA, MavMissionResult,
    MavParamError, MavParamType, PARAM_ERROR_DATA, PARAM_REQUEST_LIST_DATA,
    PARAM_REQUEST_READ_DATA, PARAM_SET_DATA, PARAM_VALUE_DATA, TIMESYNC_DATA,
};
use mavlink::types::CharArray;
use mavlink::{MavlinkVersion, MessageData};
use tvc_imu::Micros;

use super::parser::{Address, Message, Ping};
use super::queue::Priority;
use super::{OVERHEAD, Telemetry};
use crate::config::COMPONENT_ID;
use crate::flight::Flight;
use crate::params::{Change, Info, ParamError, Params, TABLE};

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
        if !self.is_for_us(message.target) {
            return Some(());
        }
        self.asker = message.source;
        match message.id {
            HEARTBEAT_DATA::ID => flight.host_heard(now),
            Ping::ID => self.answer_ping(message),
            TIMESYNC_DATA::ID => self.synchronise(now, &decode(message)?),
            PARAM_REQUEST_LIST_DATA::ID => self.list = Some(0),
            PARAM_REQUEST_READ_DATA::ID => self.read_param(&decode(message)?, flight.params()),
            PARAM_SET_DATA::ID => self.set_param(&decode(message)?, flight),
            // The vehicle flies no missions: it has none, and takes none.
            MISSION_REQUEST_LIST_DATA::ID => self.count_no_mission(message.byte(2)),
            MISSION_CLEAR_ALL_DATA::ID => self.answer_mission(true, message.byte(2)),
            MISSION_COUNT_DATA::ID => {
                let is_empty = [0, 1].map(|at| message.byte(at)) == [0, 0];
                self.answer_mission(is_empty, message.byte(4));
            }
            FILE_TRANSFER_PROTOCOL_DATA::ID => self.refuse_file(message),
            // Both have what counts here at the same places.
            COMMAND_LONG_DATA::ID | COMMAND_INT_DATA::ID => self.command(now, message, flight),
            LOG_REQUEST_LIST_DATA::ID => self.order_log_list(),
            LOG_REQUEST_DATA_DATA::ID => self.order_log_data(&decode(message)?),
            LOG_REQUEST_END_DATA::ID => self.end_log_data(),
            _ => {}
        }
        Some(())
    }

    /// Addressed to this vehicle, or to all.
    fn is_for_us(&self, [system, component]: Address) -> bool {
        (system == self.identity.system || system == 0)
            && (component == COMPONENT_ID || component == 0)
    }

    /// Send the next parameter of a list under way, when there is room for it. Says whether there
    /// is one.
    pub(super) fn continue_list(&mut self, params: &Params) -> bool {
        let row = self.list.and_then(|index| Some((index, params.by_index(index)?)));
        let Some((index, (info, value))) = row else {
            self.list = None;
            return false;
        };
        if self.queue.has_room(PARAM_VALUE_FRAME, Priority::Stream) {
            self.param_value(index, info, value);
            self.list = Some(index + 1);
        }
        true
    }

    fn synchronise(&mut self, now: Micros, request: &TIMESYNC_DATA) {
        // tc1 = 0 asks; anything else is somebody's answer.
        if let TIMESYNC_DATA { tc1: 0, ts1 } = *request {
            let tc1 = now.0.wrapping_mul(1000) as i64;
            self.send_event(&TIMESYNC_DATA { tc1, ts1 });
        }
    }

    /// PING with the asker's address, which is 0 in a question: anything else is somebody's answer.
    fn answer_ping(&mut self, message: &Message) {
        let [system, component] = self.asker;
        if message.byte(12) == 0 {
            let payload: [u8; Ping::ENCODED_LEN] = array::from_fn(|at| match at {
                12 => system,
                13 => component,
                _ => message.byte(at),
            });
            self.send_payload::<Ping>(Priority::Event, &payload);
        }
    }

    /// MISSION_COUNT: none of this type.
    fn count_no_mission(&mut self, mission_type: u8) {
        let [system, component] = self.asker;
        let payload = [0, 0, system, component, mission_type];
        self.send_payload::<MISSION_COUNT_DATA>(Priority::Event, &payload);
    }

    /// MISSION_ACK.
    fn answer_mission(&mut self, accepted: bool, mission_type: u8) {
        let [system, component] = self.asker;
        let result = match accepted {
            true => MavMissionResult::MAV_MISSION_ACCEPTED,
            false => MavMissionResult::MAV_MISSION_UNSUPPORTED,
        };
        let payload = [system, component, result as u8, mission_type];
        self.send_payload::<MISSION_ACK_DATA>(Priority::Event, &payload);
    }

    /// FILE_TRANSFER_PROTOCOL: there are no files. Without an answer MAVProxy asks for its
    /// parameters' file again and again before it asks for the parameters.
    fn refuse_file(&mut self, message: &Message) {
        const REFUSED: u8 = 129;
        /// An operation that is not known.
        const UNKNOWN: u8 = 7;
        let [system, component] = self.asker;
        let number = u16::from_le_bytes([message.byte(3), message.byte(4)]);
        let [low, high] = number.wrapping_add(1).to_le_bytes();
        let (session, operation) = (message.byte(5), message.byte(6));
        let payload = [
            0, system, component, low, high, session, REFUSED, 1, operation, 0, 0, 0, 0, 0, 0,
            UNKNOWN,
        ];
        self.send_payload::<FILE_TRANSFER_PROTOCOL_DATA>(Priority::Event, &payload);
    }

    fn read_param(&mut self, request: &PARAM_REQUEST_READ_DATA, params: &Params) {
        // A negative index asks by name.
        let index = usize::try_from(request.param_index).ok();
        let index = index.or_else(|| Some(find(&request.param_id)?.0));
        match index.filter(|index| *index < Params::count()) {
            Some(index) => self.report_param(index, params),
            None => self.param_error(&request.param_id, request.param_index, &ParamError::Unknown),
        }
    }

    /// Change a parameter and tell its value, which after a refusal is the old one.
    fn set_param(&mut self, request: &PARAM_SET_DATA, flight: &mut Flight) {
        let Some((index, info)) = find(&request.param_id) else {
            return self.param_error(&request.param_id, -1, &ParamError::Unknown);
        };
        if let Err(error) = flight.set_param(info.name, request.param_value) {
            self.param_error(&request.param_id, -1, &error);
        }
        self.report_param(index, flight.params());
        if info.change == Change::Turning {
            for index in Params::POLARITIES {
                self.report_param(index, flight.params());
            }
        }
    }

    /// Tell the value of the parameter with this index.
    #[inline(never)]
    pub fn report_param(&mut self, index: usize, params: &Params) {
        if let Some((info, value)) = params.by_index(index) {
            self.param_value(index, info, value);
        }
    }

    /// PARAM_ERROR, and in words for stations that do not know it yet.
    fn param_error(&mut self, id: &[u8; 16], index: i16, error: &ParamError) {
        let code = match error {
            ParamError::Unknown => MavParamError::MAV_PARAM_ERROR_DOES_NOT_EXIST,
            ParamError::OutOfRange(_) | ParamError::OldLaw => {
                MavParamError::MAV_PARAM_ERROR_VALUE_OUT_OF_RANGE
            }
            ParamError::Armed { .. } | ParamError::ArmedAll | ParamError::Unseen { .. } => {
                MavParamError::MAV_PARAM_ERROR_PERMISSION_DENIED
            }
        };
        let mut payload: Vec<u8, { PARAM_ERROR_DATA::ENCODED_LEN }> = Vec::new();
        for field in [&index.to_le_bytes()[..], &self.asker, id, &[code as u8]] {
            // There is room for all of them.
            let _ = payload.extend_from_slice(field);
        }
        self.send_payload::<PARAM_ERROR_DATA>(Priority::Event, &payload);
        self.refuse_param(error);
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
