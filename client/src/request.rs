//! What a ground station says to the vehicle, as messages.

use mavlink::MessageData;
use mavlink::dialects::common::{
    AUTOPILOT_VERSION_DATA, COMMAND_LONG_DATA, HEARTBEAT_DATA, LOG_REQUEST_DATA_DATA,
    LOG_REQUEST_LIST_DATA, MavAutopilot, MavCmd, MavMessage, MavModeFlag, MavParamType,
    MavSeverity, MavState, MavType, PARAM_REQUEST_LIST_DATA, PARAM_REQUEST_READ_DATA,
    PARAM_SET_DATA, STATUSTEXT_DATA, TIMESYNC_DATA,
};
use mavlink::types::CharArray;
use tvc_nano::Axis;
use tvc_nano::bringup::What;
use tvc_nano::config::COMPONENT_ID;

/// Any vehicle: [`Client`](crate::Client) puts the number of the one that it hears in its place.
const ANY: u8 = 0;

/// A command with its first parameters; the others are zero.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Order {
    /// What a person calls it.
    pub name: &'static str,
    /// The command.
    pub command: MavCmd,
    /// Its first two parameters.
    pub params: [f32; 2],
}

/// Whether [`ARM`] would be obeyed; a refusal says why not, without words.
pub const MAY_ARM: Order = Order {
    name: "say whether it can be armed",
    command: MavCmd::MAV_CMD_RUN_PREARM_CHECKS,
    params: [0.0, 0.0],
};

/// Standby to armed.
pub const ARM: Order =
    Order { name: "arm", command: MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, params: [1.0, 0.0] };

/// Back to standby; acknowledges a failsafe or a latched fault.
pub const DISARM: Order =
    Order { name: "disarm", command: MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, params: [0.0, 0.0] };

/// Armed to active: gripper 1, action 0 (release).
pub const RELEASE: Order =
    Order { name: "release", command: MavCmd::MAV_CMD_DO_GRIPPER, params: [1.0, 0.0] };

/// Start anew, as after power-on.
pub const REBOOT: Order = Order {
    name: "reboot",
    command: MavCmd::MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN,
    params: [1.0, 0.0],
};

/// Begin the estimate anew: gyro calibration.
pub const CALIBRATE: Order =
    Order { name: "calibrate", command: MavCmd::MAV_CMD_PREFLIGHT_CALIBRATION, params: [1.0, 0.0] };

/// AUTOPILOT_VERSION: the firmware's version and build.
pub const VERSION: Order = Order {
    name: "tell its version",
    command: MavCmd::MAV_CMD_REQUEST_MESSAGE,
    params: [AUTOPILOT_VERSION_DATA::ID as f32, 0.0],
};

/// A pulse for the set-up of an axis' servo, us; the firmware holds it for two seconds.
pub fn servo(axis: Axis, pulse_us: f32) -> Order {
    Order {
        name: "hold a pulse",
        command: MavCmd::MAV_CMD_DO_SET_SERVO,
        params: [(1 + axis.index()) as f32, pulse_us],
    }
}

/// Another time between two messages of the kind `id`, us: 0 for the vehicle's own, -1 for none at
/// all. It lasts until the port is opened again.
pub fn message_interval(id: u32, interval_us: f32) -> Order {
    Order {
        name: "change a message's rate",
        command: MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL,
        params: [id as f32, interval_us],
    }
}

/// Stores the parameters as they are.
pub const SAVE: Order = storage("save the parameters", 1.0);
/// Back to the stored parameters.
pub const RELOAD: Order = storage("reload the parameters", 0.0);
/// Back to the default parameters; what is stored stays until the next save.
pub const RESET: Order = storage("reset the parameters", 2.0);

const fn storage(name: &'static str, action: f32) -> Order {
    Order { name, command: MavCmd::MAV_CMD_PREFLIGHT_STORAGE, params: [action, 0.0] }
}

/// The command of all orders to the board itself.
pub const BRINGUP: MavCmd = MavCmd::MAV_CMD_USER_1;

/// An order to the board itself, as `tvc bringup` gives it, with a number by which its answer is
/// known: [`Client::board_value`](crate::Client::board_value).
pub fn bringup(what: What, number: u32) -> Order {
    Order {
        name: "examine the board",
        command: BRINGUP,
        params: [f32::from(what as u8), f32::from_bits(number)],
    }
}

impl Order {
    /// Whether this is the order to the board itself with this number.
    pub(crate) fn asks_board(&self, number: u32) -> bool {
        self.command == BRINGUP && self.params[1].to_bits() == number
    }

    /// As COMMAND_LONG.
    pub fn message(&self) -> MavMessage {
        let [param1, param2] = self.params;
        MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
            param1,
            param2,
            command: self.command,
            target_system: ANY,
            target_component: COMPONENT_ID,
            ..COMMAND_LONG_DATA::default()
        })
    }
}

/// HEARTBEAT of a ground station.
pub fn heartbeat() -> MavMessage {
    MavMessage::HEARTBEAT(HEARTBEAT_DATA {
        custom_mode: 0,
        mavtype: MavType::MAV_TYPE_GCS,
        autopilot: MavAutopilot::MAV_AUTOPILOT_INVALID,
        base_mode: MavModeFlag::empty(),
        system_status: MavState::MAV_STATE_ACTIVE,
        mavlink_version: 3,
    })
}

/// PARAM_SET.
pub fn set_parameter(name: &str, value: f32) -> MavMessage {
    MavMessage::PARAM_SET(PARAM_SET_DATA {
        param_value: value,
        target_system: ANY,
        target_component: COMPONENT_ID,
        param_id: CharArray::from(name),
        param_type: MavParamType::MAV_PARAM_TYPE_REAL32,
    })
}

/// PARAM_REQUEST_READ by name.
pub fn read_parameter(name: &str) -> MavMessage {
    read(-1, name)
}

/// PARAM_REQUEST_READ by index in the vehicle's list.
pub fn read_parameter_at(index: u16) -> MavMessage {
    read(index as i16, "")
}

fn read(param_index: i16, name: &str) -> MavMessage {
    MavMessage::PARAM_REQUEST_READ(PARAM_REQUEST_READ_DATA {
        param_index,
        target_system: ANY,
        target_component: COMPONENT_ID,
        param_id: CharArray::from(name),
    })
}

/// PARAM_REQUEST_LIST.
pub fn list_parameters() -> MavMessage {
    MavMessage::PARAM_REQUEST_LIST(PARAM_REQUEST_LIST_DATA {
        target_system: ANY,
        target_component: COMPONENT_ID,
    })
}

/// LOG_REQUEST_LIST: whether the recorder holds a release.
pub fn list_logs() -> MavMessage {
    MavMessage::LOG_REQUEST_LIST(LOG_REQUEST_LIST_DATA {
        start: 0,
        end: u16::MAX,
        target_system: ANY,
        target_component: COMPONENT_ID,
    })
}

/// LOG_REQUEST_DATA: the recorder's bytes from `offset` on.
pub fn log_data(offset: u32, count: u32) -> MavMessage {
    MavMessage::LOG_REQUEST_DATA(LOG_REQUEST_DATA_DATA {
        ofs: offset,
        count,
        id: 0,
        target_system: ANY,
        target_component: COMPONENT_ID,
    })
}

/// TIMESYNC that asks for the vehicle's clock; `ts1_ns` comes back with the answer.
pub fn time(ts1_ns: i64) -> MavMessage {
    MavMessage::TIMESYNC(TIMESYNC_DATA { tc1: 0, ts1: ts1_ns })
}

/// STATUSTEXT of at most 50 characters, which the firmware ignores: for whoever reads the link
/// along.
pub fn status_text(text: &str) -> MavMessage {
    MavMessage::STATUSTEXT(STATUSTEXT_DATA {
        severity: MavSeverity::MAV_SEVERITY_NOTICE,
        text: CharArray::from(text),
    })
}

/// The text of a STATUSTEXT; `None` of any other message, and where it is no UTF-8.
pub fn text_of(message: &MavMessage) -> Option<&str> {
    match message {
        MavMessage::STATUSTEXT(status) => status.text.to_str().ok(),
        _ => None,
    }
}
