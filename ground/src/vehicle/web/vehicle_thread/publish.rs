//! What the vehicle tells, for the pages.

use std::time::Duration;

use client::state::is_in_operation;
use client::status::{is_unsettled, sick};
use client::{Frame, Request, ServoMap, StateKind, text};
use mavlink::dialects::common::{MavMessage, SYS_STATUS_DATA};
use tvc_nano::Axis;

use super::super::model::{AxisMotion, Motion, ParameterRow, VehicleStatus};
use super::super::releases::Circumstances;
use super::{SILENCE, STATUS, Session};
use crate::vehicle::param::Row;

impl Session<'_> {
    pub(super) fn on_frames(&mut self, frames: &[Frame]) {
        let mut moved = false;
        for frame in frames {
            self.tracker.take(&frame.message);
            moved |= self.on_message(&frame.message);
            self.watch_releases(&frame.message);
        }
        let state = self.link.client().state();
        if self.state != state {
            if self.state.is_some() && matches!(state, Some(StateKind::Boot | StateKind::Latched)) {
                // After a reset the parameters are those of the flash.
                self.list = Some(self.link.request(Request::List));
            }
            self.state = state;
            self.status_due = Duration::ZERO;
        }
        if moved {
            let motion = self.motion();
            self.model.lock().motion = motion;
        }
    }

    /// Publishes a release that is complete.
    fn watch_releases(&mut self, message: &MavMessage) {
        let (client, model) = (self.link.client(), self.model);
        let releases = self.releases.take(message, || Circumstances {
            parameters: client.parameters().cloned().collect(),
            test: model.lock().test.under_way(),
            log: self.recording.as_ref().map(|path| path.display().to_string()),
        });
        if let Some(releases) = releases {
            *model.lock().releases = releases.to_vec();
        }
    }

    /// Whether the page's frame has changed.
    fn on_message(&mut self, message: &MavMessage) -> bool {
        match message {
            MavMessage::ATTITUDE_QUATERNION(_) => self.attitudes += 1,
            MavMessage::SERVO_OUTPUT_RAW(m) => self.step_us = m.time_usec,
            MavMessage::RAW_IMU(m) => {
                // Both are the vehicle's clock; the pulse's has 32 bits.
                let age_us = self.step_us.wrapping_sub(m.time_usec as u32);
                self.latency_ms = f64::from(age_us) * 1e-3;
            }
            MavMessage::SYS_STATUS(m) => self.health = m.clone(),
            MavMessage::STATUSTEXT(m) => {
                let time_s = self.tracker.peek().timestamp;
                let words = text(&m.text).to_owned();
                self.model.lock().add_text(time_s, m.severity as u8, words);
                self.status_due = Duration::ZERO;
            }
            MavMessage::PARAM_VALUE(m) => {
                // The table is this tool's own: a value that it does not allow is shown as it is,
                // and not used.
                let _ = self.params.set(text(&m.param_id), m.param_value);
            }
            MavMessage::TIMESYNC(m) if m.tc1 != 0 => {
                let ns = self.link.now().as_nanos() as i64 - m.ts1;
                self.round_trip_ms = (ns >= 0).then_some(rounded(ns as f64 * 1e-6));
            }
            _ => {}
        }
        matches!(
            message,
            MavMessage::ATTITUDE_QUATERNION(_)
                | MavMessage::SERVO_OUTPUT_RAW(_)
                | MavMessage::RAW_IMU(_)
        )
    }

    /// Publishes the parameters, if all are known and something about them has changed.
    pub(super) fn publish_parameters(&mut self) {
        let now = self.link.now();
        let client = self.link.client();
        if now < self.parameters_due || !client.has_all_parameters() {
            return;
        }
        self.parameters_due = now + STATUS;
        let parameters: Vec<_> = client.parameters().cloned().collect();
        let rows = Row::of_all(&parameters).into_iter().map(|row| {
            let stored = self.stored.value(&row.name, &self.host);
            ParameterRow::of(row, stored)
        });
        self.model.lock().parameters.renew(rows.collect());
    }

    fn motion(&mut self) -> Motion {
        let settling = self.is_settling();
        let status = self.tracker.peek();
        let motion = |axis, rate_rad_s: f32, pulse_us| AxisMotion {
            rate_deg_s: rounded(f64::from(rate_rad_s).to_degrees()),
            servo_deg: rounded(ServoMap::of(&self.params, axis).angle_rad(pulse_us).to_degrees()),
            pulse_us,
            set_deg: f64::from(self.params.setpoint_deg(axis)),
        };
        let [roll_rad_s, pitch_rad_s, _] = status.rate_rad_s;
        let second = status.second_servo;
        Motion {
            time_s: rounded(status.timestamp),
            count: self.attitudes,
            attitude_deg: status.attitude_rad.map(|rad| rounded(rad.to_degrees())),
            pitch: motion(Axis::Pitch, pitch_rad_s, status.pulse_us),
            roll: second.map(|servo| motion(Axis::Roll, roll_rad_s, servo.pulse_us)),
            tilt_sd_deg: status.tilt_sd_deg.map(|sd_deg| rounded(sd_deg.into())),
            heading_sd_deg: status.heading_sd_deg.map(|sd_deg| rounded(sd_deg.into())),
            latency_ms: rounded(self.latency_ms),
            load_pct: rounded(100.0 * status.health.load.unwrap_or_default()),
            settling,
        }
    }

    /// Whether the estimate has begun anew, by the state and the health that is told once a second.
    fn is_settling(&mut self) -> bool {
        let begins = [StateKind::Boot, StateKind::SelfTest];
        let state = self.link.client().state();
        state.is_some_and(|state| begins.contains(&state)) || is_unsettled(&self.health)
    }

    pub(super) fn publish_status(&mut self) {
        let now = self.link.now();
        self.status_due = now + STATUS;
        let status = self.tracker.next(self.link.client());
        let silence = self.link.client().heard().map(|at| now - at);
        let problem = match silence {
            Some(silence) if silence < SILENCE => String::new(),
            None => "waiting for the vehicle's heartbeat".into(),
            Some(silence) => format!(
                "nothing from the vehicle for {} s: does the firmware still run?",
                silence.as_secs()
            ),
        };
        let flight = self.link.client().state();
        let (can_arm, refusal) = self.readiness();
        let status = VehicleStatus {
            port: self.link.name().to_owned(),
            connected: problem.is_empty(),
            problem,
            state: status.state,
            reason: status.reason,
            armed: status.armed,
            in_operation: flight.is_some_and(is_in_operation),
            can_release: flight == Some(StateKind::Armed),
            can_arm,
            refusal,
            unhealthy: unhealthy(&self.health),
            health: status.health,
            round_trip_ms: self.round_trip_ms,
            recording: self.recording.as_ref().map(|path| path.display().to_string()),
            recording_failure: self.recording_failure.clone(),
        };
        *self.model.lock().status = status;
    }
}

/// What is enabled and not healthy, in words.
fn unhealthy(status: &SYS_STATUS_DATA) -> Vec<String> {
    let words = |name: &str| {
        let name = name.trim_start_matches("MAV_SYS_STATUS_");
        name.trim_start_matches("SENSOR_").replace('_', " ").to_lowercase()
    };
    sick(status).iter_names().map(|(name, _)| words(name)).collect()
}

/// Three decimals are enough to look at.
fn rounded(value: f64) -> f64 {
    (value * 1e3).round() / 1e3
}
