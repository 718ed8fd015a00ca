//! Where a log comes from: its date, and the builds of the vehicle and of the tool that kept it.

use std::time::{Duration, UNIX_EPOCH};

use client::request::text_of;
use mavlink::dialects::common::{AUTOPILOT_VERSION_DATA, MavMessage};

use super::Entry;
use report::measure::{Figure, figure};

/// The last second of the year 9999, us since 1970: later dates have no such form.
const LAST_DATE_US: u64 = 253_402_300_799_000_000;

/// Where a log comes from, as far as it tells.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Origin {
    /// Time of its first message, us since 1970.
    begun_us: Option<u64>,
    vehicle: Option<String>,
    tool: Option<String>,
}

impl Origin {
    /// By the messages of a log.
    pub fn of(entries: &[Entry]) -> Self {
        let mut origin = Self::default();
        for entry in entries {
            origin.take(entry);
        }
        origin
    }

    /// Takes the next message of the log.
    pub fn take(&mut self, entry: &Entry) {
        self.begun_us.get_or_insert(entry.time_us);
        match &entry.message {
            MavMessage::AUTOPILOT_VERSION(told) if entry.from_vehicle => {
                self.vehicle = Some(vehicle_build(told));
            }
            message if !entry.from_vehicle && self.tool.is_none() => {
                let words = text_of(message).filter(|words| words.starts_with("tvc "));
                self.tool = words.map(str::to_owned);
            }
            _ => {}
        }
    }

    /// As figures of a report.
    pub fn figures(&self) -> Figure {
        let date = self.begun_us.map(date);
        figure(
            "origin",
            [
                figure("date", date).shown("date", "", 0).or("unknown"),
                figure("vehicle", self.vehicle.clone())
                    .shown("vehicle's build", "", 0)
                    .or("not told"),
                figure("tool", self.tool.clone()).shown("kept by", "", 0).or("another program"),
            ],
        )
    }
}

/// A time in us since 1970 as a date with its time of day, UTC.
fn date(us: u64) -> String {
    let date = UNIX_EPOCH + Duration::from_micros(us.min(LAST_DATE_US));
    humantime::format_rfc3339_seconds(date).to_string()
}

/// The firmware's version, and what tells builds of it apart.
pub fn vehicle_build(told: &AUTOPILOT_VERSION_DATA) -> String {
    let [major, minor, patch, _] = told.flight_sw_version.to_be_bytes();
    let id = told.flight_custom_version;
    let id = match std::str::from_utf8(&id) {
        Ok(text) if text.bytes().all(|byte| byte.is_ascii_graphic()) => text.to_owned(),
        _ => format!("{:016x}", u64::from_be_bytes(id)),
    };
    format!("{major}.{minor}.{patch} {id}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::log::tests::TOOL;
    use client::request::status_text;
    use report::measure::Figures;

    #[test]
    fn a_log_tells_its_date_and_both_builds() {
        let entry = |from_vehicle, message| Entry {
            time_us: 1_764_000_000_000_000,
            from_vehicle,
            message,
            lost_before: 0,
        };
        let version = AUTOPILOT_VERSION_DATA {
            flight_sw_version: 0x0001_02FF,
            flight_custom_version: *b"0a1b2c3d",
            ..AUTOPILOT_VERSION_DATA::default()
        };
        assert_eq!(vehicle_build(&version), "0.1.2 0a1b2c3d");
        let entries = [
            entry(true, status_text("tvc is what a vehicle may say")),
            entry(false, status_text(TOOL)),
            entry(true, MavMessage::AUTOPILOT_VERSION(version)),
        ];
        let origin =
            serde_json::json!(Figures::from(vec![Origin::of(&entries).figures()]))["origin"]
                .clone();
        assert_eq!(origin["date"], "2025-11-24T16:00:00Z");
        assert_eq!(origin["vehicle"], "0.1.2 0a1b2c3d");
        assert_eq!(origin["tool"], TOOL);
        assert_eq!(Origin::of(&[]), Origin::default());
    }
}
