//! `tvc tune --vehicle rocket`: what a schedule's gains are best made for, and the best constant
//! gains beside it, on the model of the rocket in wind and with kicks.

use anyhow::{Result, bail};
use client::Parameter;
use rig::ServoKind;
use rig::rocket::{self, Airframe, Design, RocketLaw};
use tvc_nano::Params;
use tvc_pid::Gains;

use super::search::{self, CANDIDATES};
use super::{Tune, write};
use crate::ascent::{self, Outcome};
use crate::vehicle::store;
use report::exit::{BadInput, Verdict};
use report::measure::{Figure, Figures, figure, rows};
use report::progress;

/// Seeds of the flights by which gains are judged, beyond those that anybody flies by default.
const SEEDS: std::ops::Range<u64> = 10_001..10_005;
/// Each is flown with gains as they are, and with weaker and stronger ones. Good gains have some
/// 4 dB to spare.
const EFFECTS: [f64; 3] = [1.0, 0.7, 1.6];
/// What gains cost that the image refuses.
const REFUSED: f64 = 1e3;

/// Highest crossover of the rate's loop at any time of the burn, rad/s for each Hz of the first
/// bending mode, which the model leaves out: nearly a sixth of it.
const CROSSOVER_RAD_S_PER_HZ: f64 = 1.0;

/// Finds both for each airframe and compares them. A file gets all parameters of its image.
pub fn run(options: &Tune, airframes: Vec<Airframe>) -> Result<Verdict> {
    let given = [
        ("--servo", options.servo != ServoKind::S3003),
        ("--overshoot", options.overshoot != Tune::OVERSHOOT_PCT),
        ("--settling", options.settling.is_some()),
        ("--margin", options.margin != Tune::MARGIN_DB),
        ("--params", options.params.is_some()),
    ];
    if let Some((name, _)) = given.into_iter().find(|(_, is_given)| *is_given) {
        bail!(BadInput::new(format!("{name} is the drone's, and a rocket has no use for it")));
    }
    if options.out.is_some() && airframes.len() > 1 {
        bail!(BadInput::new(
            "--out is for one rocket, and --vehicle rocket is a stable and an unstable one: name a file, such as vehicles/hobby_rocket.toml"
        ));
    }
    let evaluations = u64::from(options.generations) * 2 * airframes.len() as u64;
    let bar = progress::bar(evaluations, search::BAR);
    let mut found = Vec::new();
    for mut airframe in airframes {
        let told = |_: &[f64; 3], least: f64| {
            bar.set_message(format!("{:.3} deg", least.to_degrees()));
            bar.inc(1);
        };
        let (generations, seed) = (options.generations, options.seed);
        let design = airframe.design;
        let start = [design.natural_rad_s, design.damping, design.integral];
        let cost = |x: &[f64; 3]| {
            let mut designed = airframe.clone();
            designed.design = of_design(*x);
            cost(&designed, None)
        };
        let (design, design_cost) = search::minimise(start, generations, seed, cost, told);

        let Gains { kp, ki, kd } = airframe.constant_gains;
        let start = [kp, ki, kd].map(f64::from);
        let cost = |x: &[f64; 3]| self::cost(&airframe, Some(of_gains(*x)));
        let (gains, gains_cost) = search::minimise(start, generations, seed, cost, told);
        airframe.design = of_design(design);
        found.push((airframe, design_cost, of_gains(gains), gains_cost));
    }
    bar.finish_and_clear();
    let schedules = found.iter().map(|(airframe, cost, ..)| {
        let design = airframe.design;
        [
            figure("airframe", airframe.name.as_str()).shown("airframe", "", 0),
            figure("natural_rad_s", design.natural_rad_s).shown("natural frequency", "rad/s", 3),
            figure("damping", design.damping).shown("damping", "", 3),
            figure("integral", design.integral).shown("integral", "", 3),
            error(*cost),
        ]
    });
    let constants = found.iter().map(|(airframe, _, gains, cost)| {
        [
            figure("airframe", airframe.name.as_str()).shown("airframe", "", 0),
            figure("kp", f64::from(gains.kp)).shown("constant kp", "rad/rad", 4),
            figure("ki", f64::from(gains.ki)).shown("ki", "1/s", 4),
            figure("kd", f64::from(gains.kd)).shown("kd", "s", 4),
            error(*cost),
        ]
    });
    let is_better = found.iter().all(|(_, schedule, _, constant)| schedule < constant);
    let table: Vec<_> = found
        .iter()
        .map(|(airframe, ..)| gain_rows(airframe))
        .collect::<Result<Vec<_>>>()?
        .concat();
    let figures = Figures::from([
        figure("seed", options.seed),
        figure("candidates", u64::from(options.generations) * CANDIDATES as u64),
        rows("schedules", schedules.collect::<Vec<_>>()),
        rows("constant", constants.collect::<Vec<_>>()),
        rows("rows", table),
        figure("schedule_is_better", is_better),
    ]);
    let verdict = figures.conclude(options.json, None)?;
    if let (Some(out), [(airframe, ..)]) = (&options.out, found.as_slice()) {
        let parameters = rocket::parameters(airframe, RocketLaw::Scheduled).into_iter();
        let rows: Vec<_> = parameters.map(|(name, value)| Parameter { name, value }).collect();
        write(out, &rows)?;
    }
    Ok(verdict)
}

fn error(cost_rad: f64) -> Figure {
    figure("error_rms_deg", cost_rad.to_degrees()).shown("error rms", "deg", 3)
}

/// The rows of an airframe's schedule, as the image takes them: shaft angles.
fn gain_rows(airframe: &Airframe) -> Result<Vec<[Figure; 5]>> {
    let rocket = plant::rocket::Rocket::new(airframe.rocket())?;
    let row = |at_s: f64| {
        let Gains { kp, ki, kd } = airframe.design.gains(&rocket, at_s);
        let shaft = |gain: f32| f64::from(gain) * airframe.mounting.shaft_per_gimbal;
        [
            figure("airframe", airframe.name.as_str()).shown("airframe", "", 0),
            figure("s", at_s).shown("GSn_S", "s", 0),
            figure("kp", shaft(kp)).shown("GSn_KP", "rad/rad", 3),
            figure("ki", shaft(ki)).shown("GSn_KI", "1/s", 3),
            figure("kd", shaft(kd)).shown("GSn_KD", "s", 3),
        ]
    };
    Ok(airframe.rows_s().map(row).into())
}

fn of_design([natural_rad_s, damping, integral]: [f64; 3]) -> Design {
    Design { natural_rad_s, damping, integral }
}

fn of_gains(gains: [f64; 3]) -> Gains {
    let [kp, ki, kd] = gains.map(|gain| gain as f32);
    Gains { kp, ki, kd }
}

/// Mean of the flights' errors, rad rms, those with weaker and stronger gains among them. It is
/// more where the crossover is too high, and most where the image refuses the gains.
fn cost(airframe: &Airframe, constant: Option<Gains>) -> f64 {
    let Ok(table) = plant::rocket::Rocket::new(airframe.rocket()) else {
        return f64::INFINITY;
    };
    let crossover = |at_s: f64| {
        let gains = constant.unwrap_or_else(|| airframe.design.gains(&table, at_s));
        f64::from(gains.kd) * table.at(at_s).mu_c
    };
    let highest = airframe.rows_s().map(crossover).into_iter().fold(0.0, f64::max);
    if highest > CROSSOVER_RAD_S_PER_HZ * airframe.rocket().bending_hz {
        return highest;
    }
    let law = constant.map_or(RocketLaw::Scheduled, RocketLaw::Constant);
    if store(&mut Params::default(), rocket::parameters(airframe, law)).is_err() {
        return REFUSED;
    }
    let flights = SEEDS.flat_map(|seed| EFFECTS.map(|effect| (seed, effect)));
    let burn_s = airframe.rocket().burn_s;
    let errors = flights.map(|(seed, effect)| {
        match ascent::fly(&airframe.on_pad(seed), airframe, constant, effect) {
            Ok(Outcome::Flown(error_rad)) => error_rad,
            // The sooner it is lost, the worse.
            Ok(Outcome::LostAt(at_s)) => burn_s - at_s + 1.0,
            Err(_) => f64::INFINITY,
        }
    });
    let sum: f64 = errors.sum();
    sum / (SEEDS.count() * EFFECTS.len()) as f64
}
