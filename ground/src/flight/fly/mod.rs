//! `tvc fly`: the image, on the virtual rig, brings the drone upright, or estimates attitude from a
//! recording.

pub mod faults;
pub mod figures;
mod flights;
mod live;
mod recording;
pub mod report;

use std::time::Instant;

use anyhow::{Context, Result};
use rig::Image;
use rig::flight::Setup;
use samd21::board::Ticks;

use crate::model::control_law;
use crate::out::exit::Verdict;
use crate::out::file::{print_json, write_whole};
use figures::{ImageFigures, LoopFigures, Spread};
mod options;
pub use options::{Fly, start_angle};

/// Flies as `options` say, prints the figures and writes the report.
pub fn run(options: &Fly) -> Result<Verdict> {
    // An unreadable recording is said before minutes of building.
    let recording = options.replay.as_deref().map(recording::open).transpose()?;
    let scenario = options.faults.as_deref();
    let scenario = scenario
        .map(|path| faults::read(path, options.seed, flights::FLIGHT_S))
        .transpose()?
        .unwrap_or_default();
    let mut setup = setup(options)?;
    let image = rig::image::build(&mut |line| eprintln!("{line}")).context("the image")?;
    setup.rig.bench.faults = scenario.faults;
    setup.rig.bench.disturbances = options.disturb.over(scenario.disturbances);
    let (figures, page) = match recording {
        Some(recording) => recording::play(&image, &recording, &setup)?,
        None => flights::fly(&image, &setup, scenario.entries, options)?,
    };
    let missed = figures.missed(options.servo);
    write_whole(&options.report, page.render(&figures, &missed)?.as_bytes())?;
    if options.json {
        print_json(&figures)?;
    } else {
        print!("{}", figures.text(options.servo));
    }
    eprintln!("report: {}", options.report.display());
    Ok(Verdict::naming(&missed))
}

fn setup(options: &Fly) -> Result<Setup> {
    let mut setup = Setup {
        gains: options.gains,
        ..Setup::with_polarity(options.servo, options.seed)
    };
    if let Some(path) = &options.params {
        let own = control_law::parameters(options.servo, None)?;
        let wanted = control_law::parameters(options.servo, Some(path))?;
        let changed = own.iter().zip(wanted.iter());
        setup.parameters = changed
            .filter(|((_, own), (_, wanted))| own != wanted)
            .map(|(_, (info, value))| (info.name.to_owned(), value))
            .collect();
    }
    let physics = control_law::setup(options.servo, options.drone.as_deref())?;
    setup.rig.bench.parameters = physics.drone;
    setup.rig.bench.servo = physics.servo;
    Ok(setup)
}

/// Wall time and simulated time of everything that was run.
struct Stopwatch {
    begun: Instant,
    simulated_s: f64,
    busy_s: f64,
}

impl Stopwatch {
    fn start() -> Self {
        Self {
            begun: Instant::now(),
            simulated_s: 0.0,
            busy_s: 0.0,
        }
    }

    fn add(&mut self, simulated_s: f64, busy_s: f64) {
        self.simulated_s += simulated_s;
        self.busy_s += busy_s;
    }

    /// Counts all that `rig` has run since power-on.
    fn boot(&mut self, rig: &rig::Rig) {
        let asleep = Ticks(rig.counters().sleep_ticks);
        self.add(
            rig.now().as_secs_f64(),
            rig.now().saturating_sub(asleep).as_secs_f64(),
        );
    }

    fn figures(&self) -> figures::EmulationFigures {
        let wall_s = self.begun.elapsed().as_secs_f64();
        figures::EmulationFigures {
            simulated_s: self.simulated_s,
            wall_s,
            real_time_factor: self.simulated_s / wall_s,
            busy_real_time_factor: self.busy_s / wall_s,
        }
    }
}

fn image_figures(image: &Image, stack_high_water: u32) -> ImageFigures {
    let sizes = image.sizes();
    ImageFigures {
        flash_bytes: sizes.flash.into(),
        static_ram_bytes: sizes.static_ram.into(),
        stack_high_water_bytes: stack_high_water.into(),
    }
}

impl From<rig::measure::Spread> for Spread {
    fn from(spread: rig::measure::Spread) -> Self {
        Self {
            mean: spread.mean,
            max: spread.max,
        }
    }
}

/// The loop's figures from the timings at 0 and at 1 flash wait state.
fn loop_figures(
    zero: &rig::measure::LoopTiming,
    one: &rig::measure::LoopTiming,
    cpu_load: f64,
) -> LoopFigures {
    LoopFigures {
        // The ticks are exact; their measurement by first and last edge is not.
        rate_hz: (one.rate_hz * 1e3).round() / 1e3,
        jitter_us_max: one.jitter_us_max,
        cycles_per_step_mean: zero.cycles_per_step.mean,
        cycles_per_step_max: zero.cycles_per_step.max as u64,
        cycles_per_step_mean_1ws: one.cycles_per_step.mean,
        cycles_per_step_max_1ws: one.cycles_per_step.max as u64,
        cpu_load,
    }
}
