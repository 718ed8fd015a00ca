//! `tvc fly`: the image, on the virtual rig, brings the drone upright, or estimates attitude from a
//! recording.

mod dispersed;
mod distribution;
pub mod faults;
mod figures;
pub mod flights;
pub mod live;
pub mod options;
mod recording;
mod report;
mod rocket;
mod two_axes;

use std::num::NonZeroU32;
use std::time::Instant;

use anyhow::{Result, anyhow};
use rig::flight::Setup;
use samd21::board::Ticks;

use crate::flight::vehicle::VehicleKind;
use crate::model::control_law;
use ::report::exit::Verdict;
use figures::Emulation;
pub use options::{Fly, start_angle};

/// Flies as `options` say, prints the figures and writes the report.
pub fn run(options: &Fly) -> Result<Verdict> {
    // An unreadable recording is reported before minutes of building.
    let recording = options
        .recording
        .as_deref()
        .map(recording::open)
        .transpose()?;
    let scenario = options.faults.as_deref();
    let scenario = scenario
        .map(|path| faults::read(path, options.seed, flights::FLIGHT_S))
        .transpose()?
        .unwrap_or_default();
    if options.vehicle == VehicleKind::Rocket {
        rocket::check(options)?;
    }
    let mut setup = setup(options)?;
    let image = options.image.image()?;
    setup.rig.bench.faults = scenario.faults;
    setup.rig.bench.disturbances = options.disturb.over(scenario.disturbances);
    if options.vehicle == VehicleKind::Rocket {
        let (figures, page) = match options.dispersed {
            Some(count) => rocket::fly_dispersed(&image, &setup, count.get(), options)?,
            None => {
                let seeds = options.seeds.map_or(1, NonZeroU32::get);
                rocket::fly(&image, &setup, seeds, options)?
            }
        };
        return figures.conclude(options.json, Some((&options.report, page)));
    }
    if let Some(count) = options.dispersed {
        let (figures, page) = dispersed::fly(&image, &setup, count.get(), options)?;
        return figures.conclude(options.json, Some((&options.report, page)));
    }
    if options.vehicle == VehicleKind::Drone2 {
        let seeds = options.seeds.map_or(1, NonZeroU32::get);
        let (figures, page) = two_axes::fly(&image, &setup, seeds, options)?;
        return figures.conclude(options.json, Some((&options.report, page)));
    }
    if let Some(seeds) = options.seeds {
        let (figures, page) = distribution::fly(&image, &setup, seeds.get(), options)?;
        return figures.conclude(options.json, Some((&options.report, page)));
    }
    let (measured, page) = match recording {
        Some(recording) => recording::play(&image, &recording, &setup)?,
        None => flights::fly(&image, &setup, scenario.entries, options)?,
    };
    let figures = measured.figures(options.servo);
    let page = page.render(&figures)?;
    figures.conclude(options.json, Some((&options.report, page)))
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
    if let Some(filter) = options.filter {
        let stored = setup.rig.stored.get_or_insert_default();
        let set = stored.set("FUSE_FILTER", filter.value());
        set.map_err(|error| anyhow!("{error}"))?;
    }
    options.vehicle.hang(&mut setup.rig)?;
    let physics = control_law::setup(options.servo, options.drone.as_deref())?;
    setup.rig.bench.parameters = physics.drone;
    setup.rig.bench.servo = physics.servo;
    setup.rig.hardware = options.hardware.hardware()?;
    Ok(setup)
}

/// Counts real and simulated time of everything that is run.
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

    /// Ends the count.
    fn stop(&self) -> Emulation {
        Emulation {
            simulated_s: self.simulated_s,
            busy_s: self.busy_s,
            wall_s: self.begun.elapsed().as_secs_f64(),
        }
    }
}
