//! Flights of the image with vehicles that are not as their parameters say: mass, thrust, inertia
//! and servo of each are drawn as those of `tvc montecarlo`.

use anyhow::{Context, Result};
use indicatif::{ProgressBar, ProgressStyle};
use maud::{Markup, html};
use plant::dispersion::{Campaign, Draw, Ranges};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use rig::flight::{Release, Setup};
use rig::{Image, prepare};

use super::flights::{FLIGHT_S, START_RATE_RAD_S, STARTS_RAD, with_wait_states};
use super::two_axes::{self, DIRECTIONS, Run};
use crate::flight::fly::Fly;
use crate::flight::requirements;
use crate::flight::vehicle::VehicleKind;
use crate::model::control_law;
use report::distribution::Distribution;
use report::measure::{Figures, data, figure};
use report::page::{figure as picture, page, verdicts};
use report::plot::{Line, Plot};

/// Flies `count` vehicles, one flight each; the figures and the page.
pub fn fly(image: &Image, setup: &Setup, count: u32, options: &Fly) -> Result<(Figures, String)> {
    let campaign = Campaign {
        ranges: Ranges::WIDE,
        ..Campaign::new(options.seed, count.into())
    };
    let bar = ProgressBar::new(count.into());
    if let Ok(style) = ProgressStyle::with_template("{bar:40} {pos}/{len} vehicles, {eta} to go") {
        bar.set_style(style);
    }
    let runs: Vec<Run> = (0..u64::from(count))
        .into_par_iter()
        .map(|index| {
            let run = fly_one(image, setup, &campaign.draw(index), options)
                .with_context(|| format!("flying vehicle {index}"));
            bar.inc(1);
            run
        })
        .collect::<Result<_>>()?;
    bar.finish_and_clear();

    let passed = runs.iter().filter(|run| is_within(run)).count();
    let overshoot = runs.iter().flat_map(|run| tilted(run, run.overshoot_pct));
    let settling = runs.iter().flat_map(|run| tilted(run, run.settling_5pct_s));
    let overshoot = Distribution::of(overshoot);
    let settling = Distribution::of(settling);
    let figures = Figures::from([
        figure("vehicle", options.vehicle.name()),
        figure("servo", options.servo.name()),
        figure("seed", options.seed),
        figure("vehicles", count).shown("vehicles", "", 0),
        figure("within_pct", 100.0 * passed as f64 / f64::from(count))
            .shown("overshoot at most 30 %, settled within 1.5 s", "%", 2)
            .limit(requirements::DISPERSED_WITHIN_PCT),
        overshoot.figure("overshoot_pct", ("overshoot", "%", 1), [None; 2]),
        settling.figure("settling_5pct_s", ("5 % settling", "s", 3), [None; 2]),
        data("runs", &runs),
    ]);
    let title = format!(
        "{count} dispersed vehicles on the virtual rig: {}, servo {}",
        options.vehicle.name(),
        options.servo.name()
    );
    let body = html! {
        (verdicts(&figures.missed()))
        p {
            "Thrust and inertia of each vehicle differ by up to 30 % from what its parameters say, its \
             centre of mass by up to 20 mm in height, its servos by up to 20 % in speed and torque, \
             their play by half, and the supply is up to 15 % low."
        }
        (figures.lines().markup())
        (plot(&runs)?)
    };
    Ok((figures, page(&title, body)))
}

/// Boots with the vehicle of a draw and flies it once.
fn fly_one(image: &Image, setup: &Setup, draw: &Draw, options: &Fly) -> Result<Run> {
    let nominal = control_law::setup(options.servo, options.drone.as_deref())?;
    let drawn = draw.setup(&nominal);
    let mut one = setup.clone();
    one.rig = with_wait_states(setup, 1);
    one.rig.seed = draw.noise_seed;
    one.rig.bench.parameters = drawn.drone;
    one.rig.bench.servo = drawn.servo;
    let mut dice = ChaCha8Rng::seed_from_u64(draw.noise_seed);
    let heading_deg = dice.random_range(-180.0..180.0);
    let mut spin_rad_s = dice.random_range(-1.0..1.0);
    let (mut direction, name) = DIRECTIONS[dice.random_range(0..DIRECTIONS.len())];
    let mut sizes = two_axes::STARTS_RAD;
    if options.vehicle == VehicleKind::Drone {
        (direction, spin_rad_s, sizes) = ([1.0, 0.0], 0.0, STARTS_RAD);
    }
    one.rig.bench.heading_rad = f64::to_radians(heading_deg);
    let size_rad = options
        .start
        .unwrap_or(sizes[(draw.index % sizes.len() as u64) as usize]);
    let side = draw.start_rad.signum();
    let tilt_rad = direction.map(|share| side * share * size_rad);
    // On the pivot a rate has the sign of its pitch, in the joint that of its tilt.
    let rate_rad_s = match options.vehicle {
        VehicleKind::Drone => START_RATE_RAD_S.copysign(tilt_rad[0]),
        VehicleKind::Drone2 | VehicleKind::Rocket => START_RATE_RAD_S,
    };
    let release = Release {
        tilt_rad,
        rate_rad_s,
        spin_rad_s,
    };
    let ready = prepare(image, &one, &mut |_| ())?;
    let record = ready.fly_from(&release, FLIGHT_S, &mut |_| ())?;
    Ok(Run {
        seed: draw.index,
        heading_deg,
        spin_rad_s,
        direction: name,
        size_rad,
        ..Run::of(&record)?
    })
}

/// The figures of the axes that were tilted.
fn tilted(run: &Run, figures: [Option<f64>; 2]) -> impl Iterator<Item = Option<f64>> {
    let axes = run.start_rad.into_iter().zip(figures);
    axes.filter(|(start, _)| *start != 0.0)
        .map(|(_, figure)| figure)
}

/// What the thesis requires of every release.
fn is_within(run: &Run) -> bool {
    let met = |figures, most: f64| {
        tilted(run, figures).all(|figure| figure.is_some_and(|value| value <= most))
    };
    run.stayed_active && met(run.overshoot_pct, 30.0) && met(run.settling_5pct_s, 1.5)
}

fn plot(runs: &[Run]) -> Result<Markup> {
    let lines = runs.iter().map(|run| {
        let path = run.path.iter();
        let path = path.map(|(at_s, [pitch, roll])| (*at_s, pitch.hypot(*roll)));
        Line::new("", if is_within(run) { 0 } else { 1 }, path.collect())
    });
    let plot = Plot::new("time since release, s", "tilt, deg", lines.collect());
    Ok(html! {
        (picture("The tilt of all vehicles over each other.", plot.svg()?))
    })
}
