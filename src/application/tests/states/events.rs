//! What may happen to a vehicle, and what the host may order.

use std::format;
use std::string::{String, ToString};
use std::vec::Vec;

use mavlink::dialects::common::MavCmd;

use super::vehicle::{Past, Said, TEST_PULSE, Vehicle};
use super::world::Trouble;
use super::*;
use crate::telemetry::tests::{heartbeat, order, set};

/// Commands of the host.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Ordered {
    Arm,
    Disarm,
    Release,
    /// Whether an order to arm would be obeyed.
    Check,
    Calibrate,
    Pulse,
    /// To the servo of an axis that is not steered.
    OtherPulse,
    Save,
    Reload,
    Defaults,
    Reboot,
    /// To show a word of memory.
    Peek,
    /// To arm by half.
    Nonsense,
    Takeoff,
}

impl Ordered {
    pub(super) const ALL: [Self; 14] = [
        Self::Arm,
        Self::Disarm,
        Self::Release,
        Self::Check,
        Self::Calibrate,
        Self::Pulse,
        Self::OtherPulse,
        Self::Save,
        Self::Reload,
        Self::Defaults,
        Self::Reboot,
        Self::Peek,
        Self::Nonsense,
        Self::Takeoff,
    ];

    fn message(self) -> (MavCmd, f32, f32) {
        let pulse_us = f32::from(TEST_PULSE.0);
        match self {
            Self::Arm => (MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, 1.0, 0.0),
            Self::Disarm => (MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, 0.0, 0.0),
            Self::Nonsense => (MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, 0.5, 0.0),
            Self::Release => (MavCmd::MAV_CMD_DO_GRIPPER, 1.0, 0.0),
            Self::Check => (MavCmd::MAV_CMD_RUN_PREARM_CHECKS, 0.0, 0.0),
            Self::Calibrate => (MavCmd::MAV_CMD_PREFLIGHT_CALIBRATION, 1.0, 0.0),
            Self::Pulse => (MavCmd::MAV_CMD_DO_SET_SERVO, 1.0, pulse_us),
            Self::OtherPulse => (MavCmd::MAV_CMD_DO_SET_SERVO, 2.0, pulse_us),
            Self::Reload => (MavCmd::MAV_CMD_PREFLIGHT_STORAGE, 0.0, 0.0),
            Self::Save => (MavCmd::MAV_CMD_PREFLIGHT_STORAGE, 1.0, 0.0),
            Self::Defaults => (MavCmd::MAV_CMD_PREFLIGHT_STORAGE, 2.0, 0.0),
            Self::Reboot => (MavCmd::MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1.0, 0.0),
            Self::Peek => (MavCmd::MAV_CMD_USER_1, 1.0, 1.0),
            Self::Takeoff => (MavCmd::MAV_CMD_NAV_TAKEOFF, 0.0, 0.0),
        }
    }

    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Arm => "arm",
            Self::Disarm => "disarm",
            Self::Release => "release",
            Self::Check => "ask whether it can be armed",
            Self::Calibrate => "calibrate",
            Self::Pulse => "try a pulse",
            Self::OtherPulse => "try a pulse on the second servo",
            Self::Save => "save parameters",
            Self::Reload => "reload parameters",
            Self::Defaults => "default parameters",
            Self::Reboot => "reboot",
            Self::Peek => "show a word of memory",
            Self::Nonsense => "arm by half",
            Self::Takeoff => "take off",
        }
    }

    pub(super) fn number(self) -> u16 {
        self.message().0 as u16
    }

    pub(super) fn is_of_storage(self) -> bool {
        matches!(self, Self::Save | Self::Reload | Self::Defaults)
    }

    fn packet(self) -> Vec<u8> {
        let (command, first, second) = self.message();
        order(command, first, second)
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Event {
    Order(Ordered),
    Set(&'static str, f32),
    Heartbeat,
    /// This number of steps at rest.
    Rest(u32),
    /// At rest until the gyro's offset is known, for six seconds at most, or 0.2 s where nobody
    /// waits for that.
    Settle,
    /// Turned by hand to this pitch, rad, at 1 rad/s.
    Tilt(f64),
    /// Half a second of being waved about.
    Shake,
    /// 2 g from tail to nose for 0.2 s.
    Thrust,
    /// This number of steps with a trouble of the sensor.
    Trouble(Trouble, u32),
    /// The sensor forgets its settings.
    SensorReset,
    Port(Port),
    /// Power off and on.
    Power,
    /// A bad end of the program, and a new start.
    Crash,
}

impl Event {
    pub(super) fn name(&self) -> String {
        match self {
            Event::Order(ordered) => ordered.name().to_string(),
            Event::Set(name, value) => format!("{name} {value}"),
            Event::Heartbeat => "heartbeat".to_string(),
            Event::Rest(steps) => format!("{} ms of rest", steps * 10),
            Event::Settle => "rest".to_string(),
            Event::Tilt(pitch) => format!("tilted to {pitch} rad"),
            Event::Shake => "shaken".to_string(),
            Event::Thrust => "thrust".to_string(),
            Event::Trouble(trouble, steps) => {
                let trouble = format!("{trouble:?}").to_lowercase();
                format!("sensor {trouble} for {} ms", steps * 10)
            }
            Event::SensorReset => "sensor resets".to_string(),
            Event::Port(port) => format!("port {port:?}").to_lowercase(),
            Event::Power => "power off and on".to_string(),
            Event::Crash => "watchdog".to_string(),
        }
    }

    /// What every search has.
    pub(super) fn common() -> Vec<Self> {
        std::vec![
            Event::Order(Ordered::Arm),
            Event::Order(Ordered::Release),
            Event::Order(Ordered::Disarm),
            Event::Rest(1),
            Event::Rest(20),
            Event::Settle,
            Event::Trouble(Trouble::Silent, 10),
        ]
    }

    /// What concerns rudder and host.
    pub(super) fn of_rudder() -> Vec<Self> {
        std::vec![
            Event::Order(Ordered::Pulse),
            Event::Set("SRV_POLARITY", 0.0),
            Event::Set("SRV_POLARITY", 1.0),
            Event::Set("SRV_POLARITY", 2.0),
            Event::Set("SRV_DIR", -1.0),
            Event::Set("FS_HOST", 1.0),
            Event::Set("FS_HOST", 0.0),
            Event::Heartbeat,
            Event::Tilt(0.3),
            Event::Tilt(0.95),
            Event::Tilt(1.15),
            Event::Tilt(0.0),
        ]
    }

    /// What concerns the estimate and its checks.
    pub(super) fn of_sensor() -> Vec<Self> {
        std::vec![
            Event::Order(Ordered::Calibrate),
            Event::Set("CAL_GYR_OY", 6.0),
            Event::Set("CAL_GYR_OY", 0.0),
            Event::Set("I2C_STRETCH_US", 900.0),
            Event::Set("I2C_STRETCH_US", 180.0),
            Event::Rest(150),
            Event::Shake,
            Event::SensorReset,
            Event::Trouble(Trouble::Silent, 3),
            Event::Trouble(Trouble::Silent, 60),
            Event::Trouble(Trouble::Late, 2),
            Event::Trouble(Trouble::Late, 10),
            Event::Trouble(Trouble::Ones, 10),
            Event::Trouble(Trouble::Frozen, 20),
            Event::Trouble(Trouble::Wild, 10),
        ]
    }

    /// What concerns the link and the start.
    pub(super) fn of_link() -> Vec<Self> {
        std::vec![
            Event::Order(Ordered::Reboot),
            Event::Order(Ordered::Calibrate),
            Event::Heartbeat,
            Event::Set("FS_HOST", 1.0),
            Event::Port(Port::Absent),
            Event::Port(Port::Silent),
            Event::Port(Port::Open),
            Event::Power,
            Event::Crash,
        ]
    }

    /// What concerns a rocket: its launch, and its schedule of gains.
    pub(super) fn of_rocket() -> Vec<Self> {
        std::vec![
            Event::Set("GS_ROWS", 0.0),
            Event::Set("GS_ROWS", 2.0),
            Event::Set("GS2_S", 0.0),
            Event::Set("GS2_S", 10.0),
            Event::Set("LAUNCH_ACC", 0.0),
            Event::Set("LAUNCH_ACC", 15.0),
            Event::Thrust,
            Event::Tilt(0.3),
            Event::Tilt(0.0),
        ]
    }

    /// What concerns stored parameters.
    pub(super) fn of_storage() -> Vec<Self> {
        std::vec![
            Event::Order(Ordered::Save),
            Event::Order(Ordered::Reload),
            Event::Order(Ordered::Defaults),
            Event::Set("PID_KP", 2.5),
            Event::Power,
        ]
    }

    /// All of them, and those that lead nowhere.
    pub(super) fn all() -> Vec<Self> {
        let mut all = Self::common();
        all.extend(Self::of_rudder());
        all.extend(Self::of_sensor());
        all.extend(Self::of_storage());
        all.extend(Self::of_link());
        all.extend(Self::of_rocket());
        all.extend([
            Event::Set("PID_KP", 11.0),
            Event::Set("PID_LAW", 0.0),
            Event::Set("NO_SUCH_NAME", 1.0),
        ]);
        all.extend(Ordered::ALL.map(Event::Order));
        let mut each = Vec::new();
        for event in all {
            if !each.contains(&event) {
                each.push(event);
            }
        }
        each
    }

    /// The host's packet, where there is one.
    pub(super) fn packet(&self) -> Option<Vec<u8>> {
        match self {
            Event::Order(ordered) => Some(ordered.packet()),
            Event::Set(name, value) => Some(set(name, *value)),
            Event::Heartbeat => Some(heartbeat()),
            _ => None,
        }
    }
}

impl Vehicle {
    /// Steps of what is no packet, each shown to `each` with the state before it.
    pub(super) fn undergo(&mut self, event: &Event, each: &mut impl FnMut(&Past, &Vehicle)) {
        match *event {
            Event::Order(_) | Event::Set(..) | Event::Heartbeat => self.steps(1, each),
            Event::Rest(steps) => self.steps(steps, each),
            Event::Settle => {
                let most = if self.state().is_idle() { 600 } else { 20 };
                for _ in 0..most {
                    self.steps(1, each);
                    if self.flight.is_calibrated() {
                        break;
                    }
                }
            }
            Event::Tilt(to) => {
                let way = to - self.world.chip.pitch_rad;
                self.world.chip.rate_rad_s = way.signum();
                if way != 0.0 {
                    self.steps((way.abs() * 100.0).round() as u32, each);
                }
                (self.world.chip.pitch_rad, self.world.chip.rate_rad_s) = (to, 0.0);
                self.steps(2, each);
            }
            Event::Shake => {
                let pitch = self.world.chip.pitch_rad;
                for rate in [1.0, -1.0, 1.0, -1.0, 1.0] {
                    self.world.chip.rate_rad_s = rate;
                    self.steps(10, each);
                }
                (self.world.chip.pitch_rad, self.world.chip.rate_rad_s) = (pitch, 0.0);
            }
            Event::Thrust => {
                self.world.chip.thrust = 981;
                self.steps(20, each);
                self.world.chip.thrust = 0;
            }
            Event::Trouble(trouble, steps) => {
                self.world.chip.trouble = trouble;
                self.steps(steps, each);
                self.world.chip.trouble = Trouble::None;
            }
            Event::SensorReset => {
                self.world.chip.power_on();
                self.steps(1, each);
            }
            Event::Port(port) => {
                self.world.port = port;
                self.turn(application::Event::Nothing);
            }
            Event::Power => self.restart(None),
            Event::Crash => self.restart(Some(Crash::Watchdog)),
        }
    }

    pub(super) fn steps(&mut self, count: u32, each: &mut impl FnMut(&Past, &Vehicle)) {
        for _ in 0..count {
            let past = Past {
                state: self.state(),
                storing: self.storing.map(|order| (order, self.stored().0.clone())),
                said: self.said.len(),
            };
            self.step();
            each(&past, self);
            if self.world.is_reset {
                self.restart(None);
            }
        }
    }

    /// A new start in the same place.
    fn restart(&mut self, crash: Option<Crash>) {
        let pitch_rad = self.world.chip.pitch_rad;
        *self = Vehicle::start(self.world.flash.clone(), crash);
        self.world.chip.pitch_rad = pitch_rad;
    }

    /// The answers to a command, of what has been said.
    pub(super) fn acks(said: &[Said], number: u16) -> Vec<(u8, u8)> {
        let acks = said.iter().filter_map(|said| match said {
            Said::Ack(command, result, detail) if *command == number => Some((*result, *detail)),
            _ => None,
        });
        acks.collect()
    }
}
