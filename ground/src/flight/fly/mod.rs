//! `tvc fly`: the image, on the virtual rig, brings the drone upright, or estimates attitude from a
//! recording; once, or in campaigns of many seeds and vehicles.

mod drones;
pub mod faults;
mod figures;
pub mod flights;
pub mod live;
pub mod options;
mod recording;
mod report;
mod rocket;

use std::num::NonZeroU32;

use anyhow::{Result, bail};
use maud::{Markup, html};
use rig::Image;
use rig::flight::{FlightRecord, Setup};
use samd21::board::Ticks;

use ::flights::param_file;
use ::report::exit::{BadInput, Verdict};
use ::report::measure::Figures;
use ::report::page::{page, verdicts};
use design::control_law;
use design::vehicle::{Vehicle, VehicleKind, store};
pub use options::{Fly, tilt_angle};

/// Flies as `options` say, prints the figures and writes the report.
pub fn run(options: &Fly) -> Result<Verdict> {
    use VehicleKind::{Drone, Drone2, Rocket};
    // An unreadable recording is reported before minutes of building.
    let recording = options.recording.as_deref().map(recording::open).transpose()?;
    let vehicle = options.vehicle.read(options.servo)?;
    let length_s = match vehicle.kind {
        Rocket => rocket::longest_s(&vehicle.airframes),
        Drone | Drone2 => flights::FLIGHT_S,
    };
    let scenario = faults::read(options.faults.as_deref(), options.seed, length_s)?;
    let disturbances = options.disturb.over(scenario.disturbances);
    if vehicle.kind == Rocket {
        rocket::check(options, &disturbances)?;
    }
    if options.vcd.is_some() && vehicle.kind != Drone {
        bail!(BadInput::new("--vcd is for --vehicle drone"));
    }
    let mut setup = setup(options, &vehicle)?;
    let image = options.image.image()?;
    setup.rig.bench.faults = scenario.faults;
    setup.rig.bench.waves = options.vcd.is_some();
    setup.rig.bench.disturbances = disturbances;
    let flying = Flying { image: &image, setup: &setup, options, vehicle: &vehicle };
    let [seeds, dispersed] = [options.seeds, options.dispersed].map(|n| n.map(NonZeroU32::get));
    let (figures, page) = match (vehicle.kind, dispersed, seeds) {
        (Rocket, Some(count), _) => flying.dispersed_rockets(count)?,
        (Rocket, None, seeds) => flying.rockets(seeds.unwrap_or(1))?,
        (Drone | Drone2, Some(count), _) => flying.dispersed(count)?,
        (Drone2, None, seeds) => flying.two_axes(seeds.unwrap_or(1))?,
        (Drone, None, Some(seeds)) => flying.seeds(seeds)?,
        (Drone, None, None) => match recording {
            Some(recording) => flying.play(&recording)?,
            None => flying.starts(scenario.entries)?,
        },
    };
    figures.conclude(options.json, Some((&options.report, page)))
}

fn setup(options: &Fly, vehicle: &Vehicle) -> Result<Setup> {
    let mut setup = Setup::with_polarity(options.servo, options.seed);
    if let Some((kp, kd)) = options.gains {
        let law = [("PID_LAW", 0.0), ("PID_KP", kp), ("PID_KD", kd)];
        setup.parameters = law.map(|(name, value)| (name.to_owned(), value)).to_vec();
    }
    if let (VehicleKind::Rocket, Some(path)) = (vehicle.kind, &options.params) {
        let rows = param_file::read(path)?.rows.into_iter();
        setup.parameters = rows.map(|row| (row.name, row.value)).collect();
    } else if let Some(path) = &options.params {
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
        store(stored, [("FUSE_FILTER", filter.value())])?;
    }
    options.sensor.fit(&mut setup.rig)?;
    setup.rig.hardware = options.hardware.hardware()?;
    vehicle.hang(&mut setup.rig)?;
    Ok(setup)
}

/// What is flown.
struct Flying<'a> {
    image: &'a Image,
    setup: &'a Setup,
    options: &'a Fly,
    vehicle: &'a Vehicle,
}

impl Flying<'_> {
    /// With the chip's own wait state and this seed.
    fn setup(&self, seed: u64) -> Setup {
        let mut setup = self.with_wait_states(1);
        setup.rig.seed = seed;
        setup
    }

    /// With this number of wait states of the flash.
    fn with_wait_states(&self, states: u8) -> Setup {
        let mut setup = self.setup.clone();
        setup.rig.hardware.chip.wait_states = Some(states);
        setup
    }

    /// The `count` seeds of a campaign, with the side that each is flown to.
    fn seeded(&self, count: u32) -> impl Iterator<Item = (u64, f64)> {
        let seeds = (0..u64::from(count)).map(|index| self.options.seed.wrapping_add(index));
        seeds.map(|seed| (seed, if seed.is_multiple_of(2) { -1.0 } else { 1.0 }))
    }
}

/// The figures of a campaign, and its page with the table under `key`, or with all lines if that is
/// empty.
fn told(
    title: &str,
    words: &[&str],
    figures: Figures,
    key: &str,
    pictures: &[Markup],
) -> (Figures, String) {
    let table = match key {
        "" => figures.lines(),
        key => figures.table(key),
    };
    let body = html! {
        (verdicts(&figures.missed()))
        @for words in words { p { (words) } }
        (table.markup())
        @for picture in pictures { (picture) }
    };
    (figures, page(title, body))
}

/// Time since the release, s.
fn since(record: &FlightRecord, at: Ticks) -> f64 {
    at.saturating_sub(record.released).as_secs_f64()
}
