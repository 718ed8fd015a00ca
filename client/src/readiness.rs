//! Why an order to arm would be refused, by what the vehicle tells without being asked: for whoever
//! wants to know before the order is given.

use mavlink::dialects::common::{MavMessage, MavSysStatusSensor, SYS_STATUS_DATA};
use tvc_nano::Params;
use tvc_nano::config::ARM_TILT_DEG;
use tvc_nano::failsafe::{RefusalKind, StateCode};
use tvc_nano::params::Polarity;

/// The newest of what decides about arming.
#[derive(Clone, Debug, Default)]
pub struct Readiness {
    code: Option<StateCode>,
    status: Option<SYS_STATUS_DATA>,
    cos_tilt: Option<f32>,
}

impl Readiness {
    /// Takes in a message of the vehicle.
    pub fn take(&mut self, message: &MavMessage) {
        match message {
            MavMessage::HEARTBEAT(beat) => self.code = StateCode::try_from(beat.custom_mode).ok(),
            MavMessage::SYS_STATUS(status) => self.status = Some(status.clone()),
            MavMessage::ATTITUDE_QUATERNION(m) => {
                self.cos_tilt = Some(1.0 - 2.0 * (m.q2 * m.q2 + m.q3 * m.q3));
            }
            _ => {}
        }
    }

    /// State and reason by the last heartbeat; `None` before it, or for unknown ones.
    pub fn code(&self) -> Option<StateCode> {
        self.code
    }

    /// Load and health, as told last.
    pub fn status(&self) -> Option<&SYS_STATUS_DATA> {
        self.status.as_ref()
    }

    /// Whether an order to arm would be obeyed, as the vehicle says once a second; `None` before.
    pub fn is_ready(&self) -> Option<bool> {
        self.is_healthy(MavSysStatusSensor::MAV_SYS_STATUS_PREARM_CHECK)
    }

    /// Whether an attitude has been told.
    pub fn is_level_known(&self) -> bool {
        self.cos_tilt.is_some()
    }

    /// Why an order to arm would be refused, in the vehicle's own words where they are known;
    /// `None` if it would be obeyed, or nothing has been told yet. The reasons are tried in the
    /// order in which the vehicle tries them.
    pub fn refusal(&self, params: &Params) -> Option<String> {
        if self.is_ready()? {
            return None;
        }
        let state = self.code.filter(|code| *code != StateCode::Standby);
        if let Some(state) = state {
            return Some(format!("in {state}"));
        }
        let cos_limit = (ARM_TILT_DEG as f32).to_radians().cos();
        let sensor = MavSysStatusSensor::MAV_SYS_STATUS_SENSOR_3D_GYRO;
        let attitude = MavSysStatusSensor::MAV_SYS_STATUS_AHRS;
        let kind = if params.timing().is_too_slow() {
            RefusalKind::SlowBus
        } else if params.polarity() != Polarity::Checked {
            RefusalKind::Polarity
        } else if self.is_healthy(sensor) == Some(false) {
            RefusalKind::Sensor
        } else if self.is_healthy(attitude) == Some(false) {
            RefusalKind::Settling
        } else if self.cos_tilt.is_some_and(|cos| cos < cos_limit) {
            RefusalKind::Tilt
        } else {
            RefusalKind::BiasUnknown
        };
        Some(kind.to_string())
    }

    fn is_healthy(&self, what: MavSysStatusSensor) -> Option<bool> {
        let status = self.status.as_ref()?;
        Some(status.onboard_control_sensors_health.contains(what))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavlink::dialects::common::{ATTITUDE_QUATERNION_DATA, HEARTBEAT_DATA};

    const ALL: MavSysStatusSensor = MavSysStatusSensor::all();
    const CHECK: MavSysStatusSensor = MavSysStatusSensor::MAV_SYS_STATUS_PREARM_CHECK;

    fn readiness(code: StateCode, healthy: MavSysStatusSensor, tilt_deg: f32) -> Readiness {
        let mut readiness = Readiness::default();
        readiness.take(&MavMessage::HEARTBEAT(HEARTBEAT_DATA {
            custom_mode: code.number(),
            ..HEARTBEAT_DATA::default()
        }));
        readiness.take(&MavMessage::SYS_STATUS(SYS_STATUS_DATA {
            onboard_control_sensors_health: healthy,
            ..SYS_STATUS_DATA::default()
        }));
        let half = tilt_deg.to_radians() / 2.0;
        readiness.take(&MavMessage::ATTITUDE_QUATERNION(ATTITUDE_QUATERNION_DATA {
            q1: half.cos(),
            q3: half.sin(),
            ..ATTITUDE_QUATERNION_DATA::default()
        }));
        readiness
    }

    #[test]
    fn the_reason_is_the_one_that_the_vehicle_would_give() {
        let mut params = Params::default();
        let told =
            |code, healthy, tilt, params: &Params| readiness(code, healthy, tilt).refusal(params);
        let standby = StateCode::Standby;
        let not_ready = ALL.difference(CHECK);
        let polarity = RefusalKind::Polarity.to_string();
        assert_eq!(told(standby, not_ready, 0.0, &params), Some(polarity));
        params.set("SRV_POLARITY", 1.0).unwrap();
        let sensor = not_ready.difference(MavSysStatusSensor::MAV_SYS_STATUS_SENSOR_3D_GYRO);
        let attitude = not_ready.difference(MavSysStatusSensor::MAV_SYS_STATUS_AHRS);
        for (code, healthy, tilt, words) in [
            (
                StateCode::Boot,
                not_ready,
                0.0,
                "in boot: waiting for the sensor",
            ),
            (standby, sensor, 0.0, "sensor not ready"),
            (standby, attitude, 0.0, "attitude still settling"),
            (standby, not_ready, 51.0, "tilt beyond 50 deg"),
            (standby, not_ready, 49.0, "gyro offset unknown: hold still"),
        ] {
            assert_eq!(told(code, healthy, tilt, &params).as_deref(), Some(words));
        }
        assert_eq!(told(standby, ALL, 80.0, &params), None);
        params.set("I2C_STRETCH_US", 400.0).unwrap();
        let slow = told(standby, not_ready, 0.0, &params);
        assert_eq!(slow, Some(RefusalKind::SlowBus.to_string()));
    }

    #[test]
    fn nothing_is_known_before_it_is_told() {
        let readiness = Readiness::default();
        assert_eq!(readiness.is_ready(), None);
        assert_eq!(readiness.refusal(&Params::default()), None);
    }
}
