//! The figures of `tvc fly`: what `--json` prints, and the requirements that they are held to.

use std::fmt::Write;

use comfy_table::presets::NOTHING;
use comfy_table::{CellAlignment, Table};
use serde::Serialize;

use rig::ServoKind;
use rig::bench::FaultEntry;
use rig::disturbance::Disturbances;

/// Everything that `tvc fly --json` prints, as one object.
#[derive(Debug, Serialize)]
pub struct Figures {
    /// The image's size.
    pub image: ImageFigures,
    /// The control loop's timing.
    #[serde(rename = "loop")]
    pub control: LoopFigures,
    /// From the start of a sample's burst to the rising edge of the pulse that carries it.
    pub latency_us: Spread,
    /// How old the sensor's registers were when their burst began: free phase of the sensor's clock.
    pub sample_age_us: Spread,
    /// What arrived over USB.
    pub telemetry: TelemetryFigures,
    /// One entry a flight; empty for a replay.
    pub runs: Vec<RunFigures>,
    /// The faults that were switched on in every flight, when there were any.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub faults: Vec<FaultEntry>,
    /// What disturbed the flights, when something did.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub disturbances: Option<Disturbances>,
    /// How fast the emulation was.
    pub emulation: EmulationFigures,
    /// Scores of a replayed recording.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub replay: Option<ReplayFigures>,
}

/// Memory of the image.
#[derive(Debug, Serialize)]
pub struct ImageFigures {
    /// Bytes of flash that the image occupies.
    pub flash_bytes: u64,
    /// Bytes of RAM for statics.
    pub static_ram_bytes: u64,
    /// Deepest stack that was seen, bytes.
    pub stack_high_water_bytes: u64,
}

/// Timing of the control loop. Cycles without a suffix are for 0 flash wait states, `_1ws` for 1,
/// which the chip needs at 48 MHz.
#[derive(Debug, Serialize)]
pub struct LoopFigures {
    /// Bursts a second.
    pub rate_hz: f64,
    /// Largest deviation of the time between bursts from its mean.
    pub jitter_us_max: f64,
    /// From the end of a burst's handling to its pulse written; interrupts included.
    pub cycles_per_step_mean: f64,
    /// The longest step.
    pub cycles_per_step_max: u64,
    /// The mean with one wait state.
    pub cycles_per_step_mean_1ws: f64,
    /// The longest step with one wait state.
    pub cycles_per_step_max_1ws: u64,
    /// Share of time that the core is awake, with one wait state, 0 to 1.
    pub cpu_load: f64,
}

/// Mean and maximum of a time, us.
#[derive(Debug, Serialize)]
pub struct Spread {
    /// Mean, us.
    pub mean: f64,
    /// Maximum, us.
    pub max: f64,
}

/// What the ground received.
#[derive(Debug, Default, Serialize)]
pub struct TelemetryFigures {
    /// Frames that arrived whole.
    pub messages: u64,
    /// Frames missing by their sequence numbers, and control steps without their messages.
    pub lost: u64,
    /// Frames with a wrong checksum.
    pub crc_errors: u64,
}

/// One flight: figures of the drone's true pitch.
#[derive(Debug, Serialize)]
pub struct RunFigures {
    /// Tilt at release, rad.
    pub start_rad: f64,
    /// Excursion past upright, percent of the start.
    pub overshoot_pct: f64,
    /// Time to a tenth of the start, s.
    pub rise_s: Option<f64>,
    /// Time after which pitch stays within 5 % of the start, s; none if it never does.
    pub settling_5pct_s: Option<f64>,
    /// Mean pitch over the last tenth of the flight, rad.
    pub final_error_rad: f64,
    /// Whether the firmware was still in control at the end.
    pub stayed_active: bool,
}

/// Speed of the emulation.
#[derive(Debug, Serialize)]
pub struct EmulationFigures {
    /// Time simulated, s.
    pub simulated_s: f64,
    /// Time that it took, s.
    pub wall_s: f64,
    /// Simulated over wall time; sleep costs nothing.
    pub real_time_factor: f64,
    /// The same for the time that the emulated core was awake.
    pub busy_real_time_factor: f64,
}

/// Attitude against optical truth, RMSE over the movement by the BROAD definition, deg.
#[derive(Debug, Serialize)]
pub struct ReplayFigures {
    /// Total orientation error.
    pub total_deg: f64,
    /// Error about the vertical.
    pub heading_deg: f64,
    /// Error of the vertical.
    pub inclination_deg: f64,
    /// Control steps whose quaternion equals the host library's, bit for bit.
    pub steps_equal: u64,
    /// Control steps compared.
    pub steps_compared: u64,
}

/// Largest overshoot of any flight, percent.
pub const OVERSHOOT_PCT: f64 = 5.0;
/// Lowest control rate, Hz.
const RATE_HZ: f64 = 100.0;
/// Largest jitter, us.
const JITTER_US: f64 = 100.0;
/// Largest mean latency, us, at a 50 Hz frame.
const LATENCY_US: f64 = 8000.0;
/// Largest image, bytes.
const FLASH_BYTES: u64 = 64 * 1024;
/// Most static RAM, bytes.
const STATIC_RAM_BYTES: u64 = 24 * 1024;
/// Least speed of the emulation.
const REAL_TIME_FACTOR: f64 = 3.0;
/// Largest inclination error of a replay, deg.
const INCLINATION_DEG: f64 = 5.0;

/// Longest 5 % settling time with `servo`, s.
pub fn settling_limit_s(servo: ServoKind) -> f64 {
    match servo {
        ServoKind::S3003 => 0.75,
        ServoKind::Digital => 0.55,
    }
}

/// The requirements that flights missed, a sentence each.
pub fn missed_by_runs(runs: &[RunFigures], servo: ServoKind) -> Vec<String> {
    let mut missed = Vec::new();
    let mut require = |met: bool, text: String| {
        if !met {
            missed.push(text);
        }
    };
    for run in runs {
        let start = format!("from {:.2} rad", run.start_rad);
        require(
            run.overshoot_pct <= OVERSHOOT_PCT,
            format!(
                "{start}: overshoot {:.1} %, allowed {OVERSHOOT_PCT} %",
                run.overshoot_pct
            ),
        );
        let limit = settling_limit_s(servo);
        match run.settling_5pct_s {
            Some(time) => require(
                time <= limit,
                format!("{start}: settled in {time:.3} s, allowed {limit} s"),
            ),
            None => require(false, format!("{start}: did not settle")),
        }
        require(run.stayed_active, format!("{start}: control was given up"));
    }
    missed
}

impl Figures {
    /// Every requirement that was missed, a sentence each.
    pub fn missed(&self, servo: ServoKind) -> Vec<String> {
        let mut missed = missed_by_runs(&self.runs, servo);
        let mut require = |met: bool, text: String| {
            if !met {
                missed.push(text);
            }
        };
        let control = &self.control;
        require(
            control.rate_hz >= RATE_HZ,
            format!("control rate {:.2} Hz, required 100", control.rate_hz),
        );
        require(
            control.jitter_us_max < JITTER_US,
            format!(
                "jitter {:.1} us, allowed {JITTER_US}",
                control.jitter_us_max
            ),
        );
        require(
            self.latency_us.mean <= LATENCY_US,
            format!(
                "mean latency {:.0} us, allowed {LATENCY_US}",
                self.latency_us.mean
            ),
        );
        require(
            self.telemetry.lost == 0 && self.telemetry.crc_errors == 0,
            format!(
                "{} messages lost, {} damaged",
                self.telemetry.lost, self.telemetry.crc_errors
            ),
        );
        require(
            self.image.flash_bytes <= FLASH_BYTES,
            format!(
                "image of {} bytes, allowed {FLASH_BYTES}",
                self.image.flash_bytes
            ),
        );
        require(
            self.image.static_ram_bytes <= STATIC_RAM_BYTES,
            format!(
                "{} bytes of static RAM, allowed {STATIC_RAM_BYTES}",
                self.image.static_ram_bytes
            ),
        );
        require(
            self.emulation.real_time_factor >= REAL_TIME_FACTOR,
            format!(
                "emulation at {:.1} times real time, required {REAL_TIME_FACTOR}",
                self.emulation.real_time_factor
            ),
        );
        if let Some(replay) = &self.replay {
            require(
                replay.inclination_deg <= INCLINATION_DEG,
                format!(
                    "inclination RMSE {:.2} deg, allowed {INCLINATION_DEG}",
                    replay.inclination_deg
                ),
            );
            require(
                replay.steps_equal == replay.steps_compared,
                format!(
                    "{} of {} quaternions differ from the host library's",
                    replay.steps_compared - replay.steps_equal,
                    replay.steps_compared
                ),
            );
        }
        missed
    }
}

/// Names of the columns of [`run_rows`].
pub const RUN_COLUMNS: [&str; 5] = [
    "start, rad",
    "overshoot, %",
    "rise, s",
    "5 % settling, s",
    "final error, rad",
];

/// The flights, a row each, as texts.
pub fn run_rows(runs: &[RunFigures]) -> Vec<Vec<String>> {
    let seconds = |time: Option<f64>| time.map_or("never".into(), |time| format!("{time:.3}"));
    let row = |run: &RunFigures| {
        vec![
            format!("{:.2}", run.start_rad),
            format!("{:.1}", run.overshoot_pct),
            seconds(run.rise_s),
            seconds(run.settling_5pct_s),
            format!("{:+.4}", run.final_error_rad),
        ]
    };
    runs.iter().map(row).collect()
}

impl Figures {
    /// All that is not about single flights: name, figure, requirement (or nothing).
    pub fn rows(&self) -> Vec<Vec<String>> {
        let mut rows = Vec::new();
        let mut row = |name: &str, figure: String, required: &str| {
            rows.push(vec![name.to_string(), figure, required.to_string()]);
        };
        let (control, telemetry) = (&self.control, &self.telemetry);
        if let Some(replay) = &self.replay {
            row("total RMSE", format!("{:.2} deg", replay.total_deg), "");
            row("heading RMSE", format!("{:.2} deg", replay.heading_deg), "");
            row(
                "inclination RMSE",
                format!("{:.2} deg", replay.inclination_deg),
                "at most 5",
            );
            row(
                "quaternions equal to the host library's",
                format!("{} of {}", replay.steps_equal, replay.steps_compared),
                "all",
            );
        }
        row(
            "control rate",
            format!("{:.2} Hz", control.rate_hz),
            "at least 100",
        );
        row(
            "jitter, worst",
            format!("{:.1} us", control.jitter_us_max),
            "below 100",
        );
        row(
            "burst start to pulse edge, mean / worst",
            format!(
                "{:.0} / {:.0} us",
                self.latency_us.mean, self.latency_us.max
            ),
            "mean at most 8000",
        );
        row(
            "sample's own age, mean / worst",
            format!(
                "{:.0} / {:.0} us",
                self.sample_age_us.mean, self.sample_age_us.max
            ),
            "",
        );
        row(
            "cycles a step, 0 wait states, mean / worst",
            format!(
                "{:.0} / {}",
                control.cycles_per_step_mean, control.cycles_per_step_max
            ),
            "",
        );
        row(
            "cycles a step, 1 wait state, mean / worst",
            format!(
                "{:.0} / {}",
                control.cycles_per_step_mean_1ws, control.cycles_per_step_max_1ws
            ),
            "",
        );
        row(
            "core awake, 1 wait state",
            format!("{:.1} %", 100.0 * control.cpu_load),
            "",
        );
        row(
            "flash",
            format!("{} bytes", self.image.flash_bytes),
            &format!("at most {FLASH_BYTES}"),
        );
        row(
            "static RAM",
            format!("{} bytes", self.image.static_ram_bytes),
            &format!("at most {STATIC_RAM_BYTES}"),
        );
        row(
            "stack, deepest",
            format!("{} bytes", self.image.stack_high_water_bytes),
            "",
        );
        row(
            "messages / lost / damaged",
            format!(
                "{} / {} / {}",
                telemetry.messages, telemetry.lost, telemetry.crc_errors
            ),
            "none lost",
        );
        for (what, how) in self.disturbances.iter().flat_map(Disturbances::rows) {
            row(what, how, "");
        }
        for fault in &self.faults {
            let share = fault.probability.map(|p| format!(", share {p:.4}"));
            let when = format!("at {} s for {} s", fault.at_s, fault.for_s);
            let how = when + &share.unwrap_or_default();
            row(&format!("fault {}", fault.kind), how, "");
        }
        let emulation = &self.emulation;
        row(
            "emulation",
            format!(
                "{:.1} s in {:.1} s: {:.1} x real time",
                emulation.simulated_s, emulation.wall_s, emulation.real_time_factor
            ),
            "at least 3",
        );
        row(
            "emulation, core awake",
            format!("{:.2} x real time", emulation.busy_real_time_factor),
            "",
        );
        rows
    }

    /// Everything as text for a terminal.
    pub fn text(&self, servo: ServoKind) -> String {
        let mut text = String::new();
        if !self.runs.is_empty() {
            let limit = settling_limit_s(servo);
            // Writing to a string does not fail.
            let _ = writeln!(
                text,
                "{}\n",
                aligned(&RUN_COLUMNS, &run_rows(&self.runs), CellAlignment::Right)
            );
            let _ = writeln!(
                text,
                "required: overshoot <= {OVERSHOOT_PCT} %, 5 % settling <= {limit} s\n"
            );
        }
        let _ = writeln!(
            text,
            "{}",
            aligned(&ROW_COLUMNS, &self.rows(), CellAlignment::Left)
        );
        text
    }
}

/// Names of the columns of [`Figures::rows`].
pub const ROW_COLUMNS: [&str; 3] = ["", "measured", "required"];

/// A table for a terminal.
pub fn aligned(head: &[&str], rows: &[Vec<String>], alignment: CellAlignment) -> String {
    let mut table = Table::new();
    table
        .load_style(NOTHING)
        .set_header(head.to_vec())
        .add_rows(rows.to_vec());
    for column in table.column_iter_mut() {
        column.set_cell_alignment(alignment);
    }
    table.trim_fmt()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn good() -> Figures {
        Figures {
            image: ImageFigures {
                flash_bytes: 50_000,
                static_ram_bytes: 9_000,
                stack_high_water_bytes: 900,
            },
            control: LoopFigures {
                rate_hz: 100.0,
                jitter_us_max: 3.0,
                cycles_per_step_mean: 3e4,
                cycles_per_step_max: 40_000,
                cycles_per_step_mean_1ws: 4e4,
                cycles_per_step_max_1ws: 50_000,
                cpu_load: 0.1,
            },
            latency_us: Spread {
                mean: 7000.0,
                max: 7100.0,
            },
            sample_age_us: Spread {
                mean: 5000.0,
                max: 10_000.0,
            },
            telemetry: TelemetryFigures {
                messages: 900,
                lost: 0,
                crc_errors: 0,
            },
            runs: vec![RunFigures {
                start_rad: 0.2,
                overshoot_pct: 1.0,
                rise_s: Some(0.5),
                settling_5pct_s: Some(0.6),
                final_error_rad: 0.001,
                stayed_active: true,
            }],
            faults: Vec::new(),
            disturbances: None,
            emulation: EmulationFigures {
                simulated_s: 20.0,
                wall_s: 2.0,
                real_time_factor: 10.0,
                busy_real_time_factor: 1.0,
            },
            replay: None,
        }
    }

    #[test]
    fn figures_within_the_requirements_miss_nothing() {
        assert_eq!(good().missed(ServoKind::S3003), Vec::<String>::new());
    }

    #[test]
    fn each_requirement_is_held() {
        let spoil: [fn(&mut Figures); 12] = [
            |f| f.runs[0].overshoot_pct = 5.1,
            |f| f.runs[0].settling_5pct_s = Some(0.76),
            |f| f.runs[0].settling_5pct_s = None,
            |f| f.runs[0].stayed_active = false,
            |f| f.control.rate_hz = 99.9,
            |f| f.control.jitter_us_max = 100.0,
            |f| f.latency_us.mean = 8001.0,
            |f| f.telemetry.lost = 1,
            |f| f.telemetry.crc_errors = 1,
            |f| f.image.flash_bytes = 65_537,
            |f| f.image.static_ram_bytes = 24_577,
            |f| f.emulation.real_time_factor = 2.9,
        ];
        for (index, spoil) in spoil.iter().enumerate() {
            let mut figures = good();
            spoil(&mut figures);
            assert_eq!(
                figures.missed(ServoKind::S3003).len(),
                1,
                "requirement {index}"
            );
        }
    }

    #[test]
    fn a_fast_servo_is_held_to_less_time() {
        assert_eq!(good().missed(ServoKind::Digital).len(), 1);
    }

    #[test]
    fn the_text_names_every_row() {
        let text = good().text(ServoKind::S3003);
        for part in ["0.20", "0.600", "jitter", "10.0 x real time", "900 / 0 / 0"] {
            assert!(text.contains(part), "{part} is not in\n{text}");
        }
    }
}
