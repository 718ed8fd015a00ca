//! A table with a row for each run, as CSV.

use plant::dispersion::{Draw, Outcome};
use serde::{Deserialize, Serialize};

use report::campaign;

/// A run: the campaign that it belongs to, what it drew, and its result.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// Seed of the campaign.
    pub seed: u64,
    /// The servo, by its name on the command line.
    pub servo: String,
    /// Range of the lateral offset, either side, mm.
    pub lateral_mm: f64,
    /// Number of the run.
    pub run: u64,
    /// Pitch at the start, rad.
    pub start_rad: f64,
    /// Factor on the thrust.
    pub thrust: f64,
    /// Factor on the inertia.
    pub inertia: f64,
    /// Offset of the centre of mass, vertical, mm.
    pub cm_vertical_mm: f64,
    /// Offset of the centre of mass, lateral, mm.
    pub cm_lateral_mm: f64,
    /// Factor on the servo's speed.
    pub servo_speed: f64,
    /// Factor on the servo's stall torque.
    pub stall: f64,
    /// Supply, as a share of the nominal one.
    pub supply: f64,
    /// Factor on the backlash.
    pub backlash: f64,
    /// Change of the sensor's delay, ms.
    pub delay_ms: f64,
    /// Frame phase, 0 to 1.
    pub phase: f64,
    /// Overshoot, percent of the start.
    pub overshoot_pct: f64,
    /// Rise to 10 % of the start, s; empty if never.
    pub rise_s: Option<f64>,
    /// Settling to 5 % of the start, s; empty if never.
    pub settling_5pct_s: Option<f64>,
    /// Settling to 2 % of the start, s; empty if never.
    pub settling_2pct_s: Option<f64>,
    /// Settling to 0.02 rad, s; empty if never.
    pub settling_20mrad_s: Option<f64>,
    /// Mean error at the end, rad.
    pub final_error_rad: f64,
    /// Whether it met what is required.
    pub pass: bool,
}

impl Row {
    /// The row of a run.
    pub fn new(servo: &str, seed: u64, lateral_mm: f64, draw: &Draw, outcome: &Outcome) -> Self {
        Self {
            seed,
            servo: servo.into(),
            lateral_mm,
            run: outcome.index,
            start_rad: outcome.start_rad,
            thrust: draw.thrust,
            inertia: draw.inertia,
            cm_vertical_mm: 1e3 * draw.cm_vertical_m,
            cm_lateral_mm: 1e3 * draw.cm_lateral_m,
            servo_speed: draw.servo_speed,
            stall: draw.stall,
            supply: draw.supply,
            backlash: draw.backlash,
            delay_ms: 1e3 * draw.delay_s,
            phase: draw.phase,
            overshoot_pct: outcome.overshoot_pct,
            rise_s: outcome.rise_s,
            settling_5pct_s: outcome.settling_5pct_s,
            settling_2pct_s: outcome.settling_2pct_s,
            settling_20mrad_s: outcome.settling_20mrad_s,
            final_error_rad: outcome.final_error_rad,
            pass: outcome.passes(),
        }
    }
}

impl campaign::Row for Row {
    fn check(&self, first: &Self) -> Result<(), String> {
        let campaign = |row: &Self| (row.seed, row.servo.clone(), row.lateral_mm.to_bits());
        match campaign(self) == campaign(first) {
            true => Ok(()),
            false => Err("of another campaign: seed, servo or lateral offset differ".into()),
        }
    }

    fn place(&self) -> impl Ord {
        self.run
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    impl Row {
        /// Of a drone with this thrust that settled after this time, s, or never.
        pub fn flown(run: u64, thrust: f64, settling_5pct_s: Option<f64>) -> Self {
            let start = [0.2, -0.4, 0.8][run as usize % 3];
            let settling = settling_5pct_s.map_or(String::new(), |s| s.to_string());
            let pass = settling_5pct_s.is_some();
            let row = format!(
                "1,s3003,0,{run},{start},{thrust},1,0,0,1,1,1,1,0,0,2,0.3,{settling},,,0,{pass}"
            );
            let mut reader =
                csv::ReaderBuilder::new().has_headers(false).from_reader(row.as_bytes());
            reader.deserialize().next().unwrap().unwrap()
        }
    }
}
