//! `tvc tune --vehicle rocket`: what a schedule's gains are best made for, and the best constant
//! gains beside it, on the model of the rocket in wind and with kicks.

use std::f64::consts::PI;

use anyhow::{Context, Result};
use indicatif::{ProgressBar, ProgressStyle};
use nalgebra::{UnitQuaternion, Vector3};
use rig::bench::{Rocket, SHAFT_PER_GIMBAL};
use rig::rocket::{Airframe, Design, ROWS_S};
use tvc_pid::{Config, Gains, Pid, Schedule};

use super::Tune;
use super::search::{self, CANDIDATES};
use crate::out::exit::Verdict;
use crate::out::measure::{Figure, Figures, figure, rows};

/// Period of the control, s, and steps of the physics to one.
const PERIOD_S: f64 = 1.0 / 150.0;
const STEPS: u32 = 4;
/// Ticks of control to a servo frame, the last of which the next pulse carries.
const TICKS: u32 = 3;
/// From the sample until its pulse has ended, in steps of the physics: 12 ms.
const EFFECT_STEPS: usize = 7;
/// Seeds of the flights by which gains are judged, beyond those that anybody flies by default.
const SEEDS: std::ops::Range<u64> = 10_001..10_005;
/// Each is flown with gains as they are, and with weaker and stronger ones: such are wanted that
/// have some 4 dB to spare.
const EFFECTS: [f64; 3] = [1.0, 0.7, 1.6];
/// Highest crossover of the rate's loop at any time of the burn, rad/s: a sixth of the first
/// bending mode of a rocket like this (some 6 Hz, an estimate), which the model leaves out.
const CROSSOVER_RAD_S: f64 = 6.0;
/// The first part of the flight, which is not counted, s.
const LEFT_OUT_S: f64 = 2.1;
/// A rocket that is tilted by more is lost, rad.
const LOST_RAD: f64 = 60.0 * PI / 180.0;
/// Cost of a second in which the rocket is lost, rad rms.
const LOST_COST: f64 = 1.0;

/// How gains come about.
#[derive(Clone, Copy, Debug)]
enum Law {
    Scheduled(Design),
    Constant(Gains),
}

/// Finds both and compares them.
pub fn run(options: &Tune) -> Result<Verdict> {
    let evaluations = u64::from(options.generations) * 4;
    let bar = ProgressBar::new(evaluations);
    if let Ok(style) =
        ProgressStyle::with_template("{bar:40} generation {pos}/{len}, {eta} left, cost {msg}")
    {
        bar.set_style(style);
    }
    let mut found = Vec::new();
    for airframe in Airframe::ALL {
        let told = |least: f64| {
            bar.set_message(format!("{:.3} deg", least.to_degrees()));
            bar.inc(1);
        };
        let (generations, seed) = (options.generations, options.seed);
        let design = airframe.design();
        let start = [design.natural_rad_s, design.damping, design.integral];
        let cost = |x: &[f64; 3]| cost(airframe, Law::Scheduled(of_design(*x)));
        let (design, design_cost) = search::minimise(start, generations, seed, cost, told);

        let Gains { kp, ki, kd } = airframe.constant_gains();
        let start = [kp, ki, kd].map(f64::from);
        let cost = |x: &[f64; 3]| self::cost(airframe, Law::Constant(of_gains(*x)));
        let (gains, gains_cost) = search::minimise(start, generations, seed, cost, told);
        found.push((
            airframe,
            of_design(design),
            design_cost,
            of_gains(gains),
            gains_cost,
        ));
    }
    bar.finish_and_clear();
    let schedules = found.iter().map(|(airframe, design, cost, ..)| {
        [
            figure("airframe", airframe.name()).shown("airframe", "", 0),
            figure("natural_rad_s", design.natural_rad_s).shown("natural frequency", "rad/s", 3),
            figure("damping", design.damping).shown("damping", "", 3),
            figure("integral", design.integral).shown("integral", "", 3),
            error(*cost),
        ]
    });
    let constants = found.iter().map(|(airframe, _, _, gains, cost)| {
        [
            figure("airframe", airframe.name()).shown("airframe", "", 0),
            figure("kp", f64::from(gains.kp)).shown("constant kp", "rad/rad", 4),
            figure("ki", f64::from(gains.ki)).shown("ki", "1/s", 4),
            figure("kd", f64::from(gains.kd)).shown("kd", "s", 4),
            error(*cost),
        ]
    });
    let is_better = found
        .iter()
        .all(|(_, _, schedule, _, constant)| schedule < constant);
    let table: Vec<_> = found
        .iter()
        .map(|(airframe, design, ..)| gain_rows(*airframe, *design))
        .collect::<Result<Vec<_>>>()?
        .concat();
    let figures = Figures::from([
        figure("seed", options.seed),
        figure(
            "candidates",
            u64::from(options.generations) * CANDIDATES as u64,
        ),
        rows("schedules", schedules.collect::<Vec<_>>()),
        rows("constant", constants.collect::<Vec<_>>()),
        rows("rows", table),
        figure("schedule_is_better", is_better),
    ]);
    figures.conclude(options.json, None)
}

fn error(cost_rad: f64) -> Figure {
    figure("error_rms_deg", cost_rad.to_degrees()).shown("error rms", "deg", 3)
}

/// The rows of an airframe's schedule, as the image takes them: shaft angles.
fn gain_rows(airframe: Airframe, design: Design) -> Result<Vec<[Figure; 5]>> {
    let rocket = plant::rocket::Rocket::new(&airframe.parameters())?;
    let row = |at_s: f64| {
        let Gains { kp, ki, kd } = design.gains(&rocket, at_s);
        let shaft = |gain: f32| f64::from(gain) * SHAFT_PER_GIMBAL;
        [
            figure("airframe", airframe.name()).shown("airframe", "", 0),
            figure("s", at_s).shown("GSn_S", "s", 0),
            figure("kp", shaft(kp)).shown("GSn_KP", "rad/rad", 3),
            figure("ki", shaft(ki)).shown("GSn_KI", "1/s", 3),
            figure("kd", shaft(kd)).shown("GSn_KD", "s", 3),
        ]
    };
    Ok(ROWS_S.map(row).into())
}

fn of_design([natural_rad_s, damping, integral]: [f64; 3]) -> Design {
    Design {
        natural_rad_s,
        damping,
        integral,
    }
}

fn of_gains(gains: [f64; 3]) -> Gains {
    let [kp, ki, kd] = gains.map(|gain| gain as f32);
    Gains { kp, ki, kd }
}

/// Mean of the flights' errors, rad rms, those with weaker and stronger gains among them; and more
/// where the crossover is too high.
fn cost(airframe: Airframe, law: Law) -> f64 {
    let Ok(table) = plant::rocket::Rocket::new(&airframe.parameters()) else {
        return f64::INFINITY;
    };
    let crossover = |at_s: f64| {
        let gains = match law {
            Law::Constant(gains) => gains,
            Law::Scheduled(design) => design.gains(&table, at_s),
        };
        f64::from(gains.kd) * table.at(at_s).mu_c
    };
    let highest = ROWS_S.map(crossover).into_iter().fold(0.0, f64::max);
    if highest > CROSSOVER_RAD_S {
        return highest;
    }
    let flights = SEEDS.flat_map(|seed| EFFECTS.map(|effect| (seed, effect)));
    let errors = flights.map(|(seed, effect)| fly(airframe, law, seed, effect));
    let sum: f64 = errors.map(|error| error.unwrap_or(f64::INFINITY)).sum();
    sum / (SEEDS.count() * EFFECTS.len()) as f64
}

/// A flight in which the gimbal is sent to `effect` times what the law asks for: its error, rad
/// rms.
fn fly(airframe: Airframe, law: Law, seed: u64, effect: f64) -> Result<f64> {
    let on_pad = airframe.on_pad(seed);
    let [pitch, roll] = on_pad.start_rad;
    let attitude = UnitQuaternion::from_scaled_axis(Vector3::new(roll, pitch, 0.0));
    let burn_s = on_pad.parameters.rocket.burn_s;
    let mut rocket = Rocket::new(&on_pad, attitude)?;
    let table = plant::rocket::Rocket::new(&airframe.parameters())?;
    // The gains are off, not how far the gimbal turns.
    let limit = (airframe.parameters().gimbal_limit_rad / effect) as f32;
    let config = |gains| Config {
        gains,
        limit: -limit..=limit,
        ..Config::new(PERIOD_S as f32)
    };
    let (first, schedule) = match law {
        Law::Constant(gains) => (gains, Schedule::<f32, 6>::default()),
        Law::Scheduled(design) => {
            let row = |at_s: f64| (at_s as f32, config(design.gains(&table, at_s)));
            let schedule = Schedule::new(ROWS_S.map(row));
            let schedule = schedule.map_err(|error| anyhow::anyhow!("the schedule: {error}"))?;
            (design.gains(&table, 0.0), schedule)
        }
    };
    let law = || Pid::<f32>::new(&config(first)).ok();
    let mut laws = [law().context("gains")?, law().context("gains")?];
    let dt_s = PERIOD_S / f64::from(STEPS);
    // What the actuators are sent to over the next steps, the nearest first.
    let mut under_way = [[0.0; 2]; EFFECT_STEPS];
    let (mut square, mut counted) = (0.0, 0.0);
    let mut output = [0.0; 2];
    rocket.ignite();
    let ticks = (burn_s / PERIOD_S) as u32;
    for tick in 0..ticks {
        let now_s = f64::from(tick) * PERIOD_S;
        let tilt = rocket.ascent().tilt_rad();
        let error = tilt[0].hypot(tilt[1]);
        if error > LOST_RAD {
            return Ok(LOST_COST * (burn_s - now_s) + 1.0);
        }
        if now_s >= LEFT_OUT_S {
            square += error * error;
            counted += 1.0;
        }
        let [roll_rate, pitch_rate, _] = rocket.ascent().rates_rad_s();
        if let Some(gains) = schedule.at(now_s as f32) {
            laws.iter_mut().for_each(|law| law.set_coefficients(gains));
        }
        let inputs = tilt.into_iter().zip([pitch_rate, roll_rate]);
        for ((law, (angle, rate)), output) in laws.iter_mut().zip(inputs).zip(&mut output) {
            *output = -f64::from(law.update(0.0, angle as f32, rate as f32));
        }
        for step in 0..STEPS {
            if tick % TICKS == TICKS - 1 && step == 0 {
                under_way[EFFECT_STEPS - 1] = output;
            }
            let [now, rest @ ..] = under_way;
            rocket.step(dt_s, now.map(|gimbal| effect * gimbal * SHAFT_PER_GIMBAL));
            under_way[..EFFECT_STEPS - 1].copy_from_slice(&rest);
        }
    }
    Ok((square / f64::max(counted, 1.0)).sqrt())
}
