//! What `tvc fly` measures, as the figures that it prints and holds to the requirements.

use client::LinkCounts;
use rig::image::Sizes;
use rig::measure::LoopTiming;

use flights::figures::{Run, spread, telemetry};
use flights::requirements;
use report::measure::{Figure, Figures, data, figure, rows, shown};
use rig::ServoKind;
use rig::bench::{FaultEntry, Since};
use rig::disturbance::Disturbances;

/// All that was measured, in flights or in a replay.
#[derive(Debug)]
pub struct Measured {
    /// Sizes of the image.
    pub image: Sizes,
    /// Deepest stack that was seen, bytes.
    pub stack_bytes: u32,
    /// Timing with 0 flash wait states, which only gives cycles.
    pub unhindered: LoopTiming,
    /// Timing with the wait state that the chip needs at 48 MHz.
    pub timing: LoopTiming,
    /// Share of time that the core is awake, with one wait state, 0 to 1.
    pub cpu_load: f64,
    /// What arrived over USB. A control step without its messages counts as lost.
    pub link: LinkCounts,
    /// The flights; none in a replay.
    pub runs: Vec<Run>,
    /// The faults that were switched on in every flight.
    pub faults: Vec<FaultEntry>,
    /// What disturbed the flights.
    pub disturbances: Option<Disturbances>,
    /// Speed of the emulation.
    pub emulation: Emulation,
    /// What a replayed recording adds.
    pub replay: Option<Figure>,
}

/// Simulated and real time of everything that was run.
#[derive(Debug, Default)]
pub struct Emulation {
    /// Time simulated, s.
    pub simulated_s: f64,
    /// Of which the emulated core was awake, s.
    pub busy_s: f64,
    /// Real time, s.
    pub wall_s: f64,
}

impl Measured {
    /// The figures, held to what is required with `servo`.
    pub fn figures(self, servo: ServoKind) -> Figures {
        let mut figures = vec![
            self.image_figures(),
            self.loop_figures(),
            spread(
                "latency_us",
                self.timing.latency_us,
                "burst start to pulse edge",
                Some(requirements::LATENCY_US),
            ),
            spread("sample_age_us", self.timing.sample_age_us, "sample's age at its burst", None),
            telemetry(self.link),
            rows("runs", self.runs.iter().map(|run| run.figures(servo))),
        ];
        if !self.faults.is_empty() {
            figures.push(data("faults", &self.faults));
        }
        for fault in &self.faults {
            let share = fault.probability.map(|p| format!(", share {p:.4}"));
            let length = fault.for_s.map_or(String::new(), |for_s| format!(" for {for_s} s"));
            let since = match fault.since {
                Since::Release => "",
                Since::PowerOn => " after power-on",
            };
            let when = format!("at {} s{since}{length}", fault.at_s);
            let how = when + &share.unwrap_or_default();
            figures.push(shown(format!("fault {}", fault.kind), how));
        }
        if let Some(disturbances) = &self.disturbances {
            figures.push(data("disturbances", disturbances));
            let lines = disturbances.rows().into_iter();
            figures.extend(lines.map(|(what, how)| shown(what, how)));
        }
        figures.push(self.emulation.figures());
        figures.extend(self.replay);
        figures.into()
    }

    fn image_figures(&self) -> Figure {
        let bytes = |key, count: u32, label| figure(key, count).shown(label, "bytes", 0);
        figure(
            "image",
            [
                bytes("flash_bytes", self.image.flash, "flash").limit(requirements::FLASH_BYTES),
                bytes("static_ram_bytes", self.image.static_ram, "static RAM")
                    .limit(requirements::STATIC_RAM_BYTES),
                bytes("stack_high_water_bytes", self.stack_bytes, "stack, deepest"),
            ],
        )
    }

    /// Keys without a suffix are for 0 flash wait states, `_1ws` for 1.
    fn loop_figures(&self) -> Figure {
        let (zero, one) = (self.unhindered.cycles_per_step, self.timing.cycles_per_step);
        // The ticks are exact; their measurement by first and last edge is not.
        let rate_hz = (self.timing.rate_hz * 1e3).round() / 1e3;
        figure(
            "loop",
            [
                figure("rate_hz", rate_hz)
                    .shown("control rate", "Hz", 2)
                    .limit(requirements::RATE_HZ),
                figure("strays", self.timing.strays)
                    .shown("pulses that nobody asked for", "", 0)
                    .limit(requirements::STRAY_PULSES),
                figure("jitter_us_max", self.timing.jitter_us_max)
                    .shown("jitter, worst", "us", 1)
                    .limit(requirements::JITTER_US),
                cycles(figure("cycles_per_step_mean", zero.mean), "0 wait states, mean"),
                cycles(figure("cycles_per_step_max", zero.max as u64), "0 wait states, worst"),
                cycles(figure("cycles_per_step_mean_1ws", one.mean), "1 wait state, mean"),
                cycles(figure("cycles_per_step_max_1ws", one.max as u64), "1 wait state, worst"),
                figure("cpu_load", self.cpu_load)
                    .shown("core awake, 1 wait state", "%", 1)
                    .scaled(100.0),
            ],
        )
    }
}

/// Shows cycles of a step.
pub fn cycles(figure: Figure, which: &str) -> Figure {
    figure.shown(format!("cycles a step, {which}"), "", 0)
}

impl Emulation {
    /// Counts what was run.
    pub fn add(&mut self, simulated_s: f64, busy_s: f64) {
        self.simulated_s += simulated_s;
        self.busy_s += busy_s;
    }

    fn figures(&self) -> Figure {
        let seconds = |key, s: f64, label| figure(key, s).shown(label, "s", 1);
        let factor = |key, s: f64, label| figure(key, s / self.wall_s).shown(label, "", 2);
        figure(
            "emulation",
            [
                seconds("simulated_s", self.simulated_s, "time simulated"),
                seconds("wall_s", self.wall_s, "time that it took"),
                factor("real_time_factor", self.simulated_s, "times real time"),
                factor("busy_real_time_factor", self.busy_s, "times real time, core awake"),
            ],
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rig::measure::Spread;

    fn spread(mean: f64, max: f64) -> Spread {
        Spread { mean, max, count: 300 }
    }

    fn good() -> Measured {
        let unhindered = LoopTiming {
            rate_hz: 100.0,
            jitter_us_max: 3.0,
            cycles_per_step: spread(3e4, 4e4),
            latency_us: spread(7000.0, 7100.0),
            sample_age_us: spread(5000.0, 10_000.0),
            ..LoopTiming::default()
        };
        Measured {
            image: Sizes { flash: 50_000, static_ram: 9_000 },
            stack_bytes: 900,
            timing: LoopTiming { cycles_per_step: spread(4e4, 5e4), ..unhindered },
            unhindered,
            cpu_load: 0.1,
            link: LinkCounts { messages: 900, ..LinkCounts::default() },
            runs: vec![Run {
                start_rad: 0.2,
                overshoot_pct: 1.0,
                rise_s: Some(0.5),
                settling_5pct_s: Some(0.6),
                final_error_rad: 0.001,
                stayed_active: true,
            }],
            faults: Vec::new(),
            disturbances: None,
            emulation: Emulation { simulated_s: 20.0, busy_s: 2.0, wall_s: 2.0 },
            replay: None,
        }
    }

    #[test]
    fn figures_within_the_requirements_miss_nothing() {
        let missed = good().figures(ServoKind::S3003).missed();
        assert_eq!(missed, Vec::<String>::new());
    }

    #[test]
    fn each_requirement_is_held() {
        let spoil: [fn(&mut Measured); 12] = [
            |f| f.timing.strays = 1,
            |f| f.runs[0].overshoot_pct = 5.1,
            |f| f.runs[0].settling_5pct_s = Some(0.76),
            |f| f.runs[0].settling_5pct_s = None,
            |f| f.runs[0].stayed_active = false,
            |f| f.timing.rate_hz = 99.9,
            |f| f.timing.jitter_us_max = 100.0,
            |f| f.timing.latency_us.mean = 8001.0,
            |f| f.link.lost = 1,
            |f| f.link.crc_errors = 1,
            |f| f.image.flash = 102_401,
            |f| f.image.static_ram = 24_577,
        ];
        for (index, spoil) in spoil.iter().enumerate() {
            let mut measured = good();
            spoil(&mut measured);
            let missed = measured.figures(ServoKind::S3003).missed();
            assert_eq!(missed.len(), 1, "requirement {index}");
        }
    }

    #[test]
    fn a_fast_servo_is_held_to_less_time() {
        let missed = good().figures(ServoKind::Digital).missed();
        let expected = "start 0.20 rad: 5 % settling: 0.600 s, required: at most 0.55";
        assert_eq!(missed, [expected]);
    }

    #[test]
    fn the_text_names_every_row() {
        let text = good().figures(ServoKind::S3003).text();
        for part in ["0.20", "0.600", "jitter", "10.00", "900", "at least 100"] {
            assert!(text.contains(part), "{part} is not in\n{text}");
        }
    }
}
