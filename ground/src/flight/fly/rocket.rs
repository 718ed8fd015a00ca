//! Flights of the rocket through its burn: stable and unstable, with scheduled and constant gains,
//! and with the accelerometer left in the estimate, to show what that does.

use anyhow::{Context, Result, anyhow};
use indicatif::{ProgressBar, ProgressStyle};
use maud::{Markup, html};
use rayon::prelude::*;
use rig::bench::{RocketConfig, SHAFT_PER_GIMBAL, VehicleConfig, ZERO_RUDDER_US};
use rig::flight::{FlightRecord, Setup};
use rig::ground_truth::Pulse;
use rig::rocket::{self, Airframe, RocketLaw};
use rig::{Image, ServoKind, prepare};
use samd21::board::Ticks;
use serde::Serialize;

use super::flights::with_wait_states;
use crate::flight::fly::Fly;
use crate::flight::requirements;
use report::distribution::Distribution;
use report::exit::BadInput;
use report::measure::{Figures, data, figure, rows};
use report::page::{figure as picture, page, verdicts};
use report::plot::{Line, Plot};

/// How long the rocket stands armed on its pad, s: the gyroscope's offset is learned there.
const COUNTDOWN_S: f64 = 20.0;
/// How long a flight is followed behind the end of the burn, s.
const COAST_S: f64 = 2.0;
/// The first part of the control, which is not counted, s.
const LEFT_OUT_S: f64 = 2.0;
/// After the burn the pulses are neutral within this, s.
const NEUTRAL_S: f64 = 0.5;
/// From point to point of what is drawn, ms.
const DRAWN_EVERY: usize = 50;

/// What steers a flight.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Case {
    airframe: Airframe,
    law: RocketLaw,
    /// The accelerometer stays in the estimate.
    accelerometer: bool,
}

impl Case {
    /// All that are flown.
    fn all() -> Vec<Self> {
        let of = |airframe, law| Self {
            airframe,
            law,
            accelerometer: false,
        };
        let mut all = Vec::new();
        for airframe in Airframe::ALL {
            all.push(of(airframe, RocketLaw::Scheduled));
            all.push(of(airframe, RocketLaw::Constant(airframe.constant_gains())));
            all.push(of(airframe, RocketLaw::Cascade));
        }
        all.push(Self {
            accelerometer: true,
            ..of(Airframe::Stable, RocketLaw::Scheduled)
        });
        all
    }

    fn control(&self) -> &'static str {
        match self.law {
            RocketLaw::Scheduled if self.accelerometer => "schedule, FUSE_ACC 1",
            RocketLaw::Scheduled => "schedule",
            RocketLaw::Constant(_) => "constant gains",
            RocketLaw::Cascade => "cascade",
        }
    }

    /// Whether the flight is held to the requirements: the others are for comparison.
    fn is_held(&self) -> bool {
        self.law == RocketLaw::Scheduled && !self.accelerometer
    }
}

/// One flight.
#[derive(Clone, Debug, Serialize)]
struct Run {
    seed: u64,
    airframe: &'static str,
    control: &'static str,
    /// Angle of the axis from the vertical, from 2 s after the launch was seen to the burnout.
    error_rms_deg: f64,
    error_max_deg: f64,
    /// What it was at the burnout, and what the image believed.
    error_end_deg: f64,
    believed_end_deg: Option<f64>,
    /// Standard deviation of the tilt that the image told last.
    tilt_sd_deg: Option<f32>,
    /// From ignition until the image saw the launch, and from burnout until control ended.
    launch_seen_s: Option<f64>,
    end_seen_s: Option<f64>,
    gimbal_max_deg: f64,
    pulses_within_limits: bool,
    neutral_after_burnout: bool,
    stayed_active: bool,
    #[serde(skip)]
    case: Option<Case>,
    /// Time, s, and angle, deg.
    #[serde(skip)]
    path: Vec<(f64, f64)>,
}

/// Options that have no meaning for a rocket are refused by name.
///
/// # Errors
/// [`BadInput`], with what there is instead.
pub fn check(options: &Fly) -> Result<()> {
    let given = [
        ("--servo", options.servo != ServoKind::S3003),
        ("--start", options.start.is_some()),
        ("--gains", options.gains.is_some()),
        ("--params", options.params.is_some()),
        ("--drone", options.drone.is_some()),
    ];
    match given.into_iter().find(|(_, is_given)| *is_given) {
        None => Ok(()),
        Some((name, _)) => Err(BadInput::new(format!(
            "{name} is the drone's, and --vehicle rocket has no use for it: its gains and gimbal are \
             those of `tvc tune --vehicle rocket`"
        ))
        .into()),
    }
}

/// Flies `count` rockets that are not as their images were told, with scheduled gains; the figures
/// and the page.
pub fn fly_dispersed(
    image: &Image,
    setup: &Setup,
    count: u32,
    options: &Fly,
) -> Result<(Figures, String)> {
    let bar = progress(count.into(), "rockets")?;
    let runs: Vec<Run> = (0..u64::from(count))
        .into_par_iter()
        .map(|index| {
            let seed = options.seed + index;
            let (airframe, on_pad) = rocket::dispersed(seed);
            let case = Case {
                airframe,
                law: RocketLaw::Scheduled,
                accelerometer: false,
            };
            let run = fly_one(image, setup, seed, case, on_pad)
                .with_context(|| format!("flying rocket {index}"));
            bar.inc(1);
            run
        })
        .collect::<Result<_>>()?;
    bar.finish_and_clear();
    let within = runs.iter().filter(|run| run.is_within()).count();
    let rms = Distribution::of(runs.iter().map(|run| Some(run.error_rms_deg)));
    let figures = Figures::from([
        figure("vehicle", options.vehicle.name()),
        figure("seed", options.seed),
        figure("vehicles", count).shown("rockets", "", 0),
        figure("within_pct", 100.0 * within as f64 / f64::from(count))
            .shown(
                "error at most 2 deg rms, in control, neutral behind the burn",
                "%",
                2,
            )
            .limit(requirements::DISPERSED_WITHIN_PCT),
        rms.figure("error_rms_deg", ("error rms", "deg", 2), [None; 2]),
        data("conditions", &Conditions::STATED),
        data("runs", &runs),
    ]);
    let title = format!("{count} dispersed rockets on the virtual rig");
    let lines = runs.iter().map(|run| {
        let colour = usize::from(!run.is_within());
        Line::new("", colour, run.path.clone())
    });
    let plot = Plot::new("time since ignition, s", "error, deg", lines.collect());
    let body = html! {
        (verdicts(&figures.missed()))
        p { (Conditions::STATED.words()) }
        p {
            "Each rocket differs from what its image was told: thrust by up to 5 %, inertia by 20 %, \
             propellant by 3 %, the dry centre of mass by 0.3 m, the static margin by 0.4 diameters, \
             speed and bandwidth of the gimbal by 20 %; wind, gust, rail and misalignment are anything \
             up to the above. Every other airframe is unstable."
        }
        (figures.lines().markup())
        (picture("The error of all rockets over each other.", plot.svg()?))
    };
    Ok((figures, page(&title, body)))
}

fn progress(count: u64, what: &str) -> Result<ProgressBar> {
    let bar = ProgressBar::new(count);
    let template = format!("{{bar:40}} {{pos}}/{{len}} {what}, {{eta}} to go");
    bar.set_style(ProgressStyle::with_template(&template)?);
    Ok(bar)
}

/// Flies all of it with each of `seeds` seeds; the figures and the page.
pub fn fly(image: &Image, setup: &Setup, seeds: u32, options: &Fly) -> Result<(Figures, String)> {
    let cases = Case::all();
    let flights: Vec<(u64, Case)> = (0..u64::from(seeds))
        .flat_map(|index| cases.iter().map(move |case| (index, *case)))
        .map(|(index, case)| (options.seed + index, case))
        .collect();
    let bar = progress(flights.len() as u64, "flights")?;
    let runs: Vec<Run> = flights
        .into_par_iter()
        .map(|(seed, case)| {
            let on_pad = case.airframe.on_pad(seed);
            let run = fly_one(image, setup, seed, case, on_pad).with_context(|| {
                let (airframe, control) = (case.airframe.name(), case.control());
                format!("flying the {airframe} rocket, {control}, with seed {seed}")
            });
            bar.inc(1);
            run
        })
        .collect::<Result<_>>()?;
    bar.finish_and_clear();

    let of = |case: Case| runs.iter().filter(move |run| run.case == Some(case));
    let figures = Figures::from([
        figure("vehicle", options.vehicle.name()),
        figure("seed", options.seed),
        figure("seeds", seeds),
        data("conditions", &Conditions::STATED),
        rows("cases", cases.iter().map(|case| summary(*case, of(*case)))),
        data("runs", &runs),
    ]);
    let plots: Vec<Markup> = cases
        .iter()
        .map(|case| plot(*case, of(*case)))
        .collect::<Result<_>>()?;
    let title = format!(
        "A rocket through its burn on the virtual rig: {} flights",
        runs.len()
    );
    let body = html! {
        (verdicts(&figures.missed()))
        p { (Conditions::STATED.words()) }
        p {
            "The error is the true angle of the rocket's axis from the vertical, from "
            (LEFT_OUT_S) " s after the launch was seen to the end of the burn. The image arms on its \
             pad, sees launch and burnout in the acceleration, and flies on its gyroscope alone; in the \
             last case the accelerometer corrects the attitude, as it does for a drone that hangs."
        }
        (figures.table("cases").markup())
        @for plot in &plots { (plot) }
    };
    Ok((figures, page(&title, body)))
}

/// What the rocket meets on its way.
#[derive(Serialize)]
struct Conditions {
    rail_tilt_deg: f64,
    kicks_s: [f64; 4],
    kick_rad_s: f64,
    misalignment_deg: f64,
    wind_m_s: f64,
    gust_m_s: f64,
    gust_from_m: f64,
    gust_depth_m: f64,
    turbulence_rms_m_s: f64,
    turbulence_length_m: f64,
}

impl Conditions {
    const STATED: Self = Self {
        rail_tilt_deg: rocket::RAIL_TILT_RAD * 180.0 / std::f64::consts::PI,
        kicks_s: rocket::KICKS_S,
        kick_rad_s: rocket::KICK_RAD_S,
        misalignment_deg: rocket::MISALIGNMENT_RAD * 180.0 / std::f64::consts::PI,
        wind_m_s: rocket::WIND_M_S,
        gust_m_s: rocket::GUST_M_S,
        gust_from_m: rocket::GUST_LAYER_M[0],
        gust_depth_m: rocket::GUST_LAYER_M[1],
        turbulence_rms_m_s: rocket::TURBULENCE[0],
        turbulence_length_m: rocket::TURBULENCE[1],
    };

    fn words(&self) -> String {
        let [first, second, third, last] = self.kicks_s;
        format!(
            "A rail {:.0} deg off the vertical; kicks of {} rad/s at {first}, {second}, {third} and \
             {last} s, which turn the rocket by some 5 deg; a thrust {:.0} deg off its axis; {} m/s of \
             wind, a gust that rises to {} m/s and fades (1 - cos) from {} to {} m, and turbulence of {} \
             m/s rms in each direction with a length of {} m. All directions come from the seed.",
            self.rail_tilt_deg,
            self.kick_rad_s,
            self.misalignment_deg,
            self.wind_m_s,
            self.gust_m_s,
            self.gust_from_m,
            self.gust_from_m + self.gust_depth_m,
            self.turbulence_rms_m_s,
            self.turbulence_length_m,
        )
    }
}

fn summary<'a>(
    case: Case,
    runs: impl Iterator<Item = &'a Run> + Clone,
) -> [report::measure::Figure; 9] {
    let rms = Distribution::of(runs.clone().map(|run| Some(run.error_rms_deg)));
    let largest = Distribution::of(runs.clone().map(|run| Some(run.error_max_deg)));
    let end = Distribution::of(runs.clone().map(|run| Some(run.error_end_deg)));
    let sd = Distribution::of(runs.clone().map(|run| run.tilt_sd_deg.map(f64::from)));
    let gimbal = Distribution::of(runs.clone().map(|run| Some(run.gimbal_max_deg)));
    let neutral = runs.clone().all(|run| run.neutral_after_burnout);
    let flown = runs
        .clone()
        .all(|run| run.stayed_active && run.pulses_within_limits);
    let held = |limit| case.is_held().then_some(limit);
    let within = |value: f64| value.is_finite().then_some(value);
    let name = format!("{}, {}", case.airframe.name(), case.control());
    [
        figure("case", name).shown("airframe, control", "", 0),
        figure("error_rms_mean_deg", rms.mean).shown("error rms, mean", "deg", 2),
        figure("error_rms_deg", rms.worst)
            .shown("worst", "deg", 2)
            .limit(held(requirements::ASCENT_ERROR_RMS_DEG)),
        figure("error_max_deg", largest.worst).shown("largest error", "deg", 1),
        figure("error_end_deg", end.worst).shown("at burnout", "deg", 2),
        figure("tilt_sd_deg", within(sd.mean))
            .shown("tilt_sd", "deg", 1)
            .or("-"),
        figure("gimbal_max_deg", gimbal.worst)
            .shown("gimbal", "deg", 2)
            .limit(held(requirements::GIMBAL_DEG)),
        figure("in_control", flown)
            .shown("in control, pulses within limits", "", 0)
            .limit(held(requirements::IN_CONTROL)),
        figure("neutral_after_burnout", neutral)
            .shown("neutral after burnout", "", 0)
            .limit(held(requirements::IN_CONTROL)),
    ]
}

/// Boots with the rocket on its pad and flies it once.
fn fly_one(
    image: &Image,
    setup: &Setup,
    seed: u64,
    case: Case,
    on_pad: RocketConfig,
) -> Result<Run> {
    let mut one = setup.clone();
    one.rig = with_wait_states(setup, 1);
    one.rig.seed = seed;
    let (tilt_rad, burn_s) = (on_pad.start_rad, on_pad.parameters.rocket.burn_s);
    one.rig.bench.vehicle = VehicleConfig::Rocket(Box::new(on_pad));
    let stored = one.rig.stored.get_or_insert_default();
    let mut parameters = rocket::parameters(case.airframe, case.law);
    if case.accelerometer {
        parameters.push(("FUSE_ACC".to_owned(), 1.0));
    }
    for (name, value) in &parameters {
        stored
            .set(name, *value)
            .map_err(|error| anyhow!("{error}"))?;
    }
    let ready = prepare(image, &one, &mut |_| ())?;
    let record = ready.launch(tilt_rad, COUNTDOWN_S, burn_s + COAST_S, &mut |_| ())?;
    Ok(Run {
        seed,
        airframe: case.airframe.name(),
        control: case.control(),
        case: Some(case),
        ..Run::of(&record, burn_s)
    })
}

impl Run {
    /// Whether it does what is required of a flight.
    fn is_within(&self) -> bool {
        self.error_rms_deg <= requirements::ASCENT_ERROR_MOST_DEG
            && self.stayed_active
            && self.pulses_within_limits
            && self.neutral_after_burnout
    }

    fn of(record: &FlightRecord, burn_s: f64) -> Self {
        let seconds = |at: Ticks| at.saturating_sub(record.released).as_secs_f64();
        let angle_deg = |tilt: [f64; 2]| tilt[0].hypot(tilt[1]).to_degrees();
        let path: Vec<(f64, f64)> = record
            .motion
            .iter()
            .map(|m| (seconds(m.time), angle_deg([m.pitch_rad, m.roll.roll_rad])))
            .collect();
        let states = record.received.heartbeats.iter();
        let active = |is_active: bool, after_s: f64| {
            let mut states = states.clone().map(|beat| (seconds(beat.at), beat.state));
            let wanted = |state| (state == Some(client::StateKind::Active)) == is_active;
            states.find(|(at_s, state)| *at_s >= after_s && wanted(*state))
        };
        let launch_seen_s = active(true, 0.0).map(|(at_s, _)| at_s);
        let end_seen_s = active(false, launch_seen_s.unwrap_or(0.0)).map(|(at_s, _)| at_s);
        let from_s = launch_seen_s.unwrap_or(0.0) + LEFT_OUT_S;
        // Afterwards the accelerometer is believed again.
        let ended = |at: Ticks| end_seen_s.is_some_and(|end_s| seconds(at) >= end_s);
        let told = record.received.tilt_sd_deg.iter();
        let told = told.rev().find(|(at, _)| !ended(*at));
        let sd_at_end = told.map(|(_, sd_deg)| *sd_deg);
        let errors = path
            .iter()
            .filter(|(at_s, _)| (from_s..burn_s).contains(at_s));
        let errors: Vec<f64> = errors.map(|(_, error)| *error).collect();
        let square: f64 = errors.iter().map(|error| error * error).sum();
        let gimbal = record
            .motion
            .iter()
            .flat_map(|m| [m.rudder_rad, m.roll.rudder_rad]);
        let believed = record.received.attitudes.iter().rev();
        let mut believed = believed.skip_while(|attitude| seconds(attitude.at) > burn_s);
        let pulses = || record.pulses.iter().chain(&record.roll_pulses);
        let limit_us = |pulse: &Pulse| (pulse.width_us() - ZERO_RUDDER_US).abs();
        let shaft_us = 10.0 * SHAFT_PER_GIMBAL * requirements::GIMBAL_LIMIT_DEG + 1.0;
        Self {
            seed: 0,
            airframe: "",
            control: "",
            error_rms_deg: (square / errors.len().max(1) as f64).sqrt(),
            error_max_deg: errors.iter().copied().fold(0.0, f64::max),
            error_end_deg: errors.last().copied().unwrap_or(f64::NAN),
            believed_end_deg: believed.next().map(|attitude| {
                let [w, x, y, z] = attitude.quaternion.map(f64::from);
                2.0 * x.hypot(y).atan2(w.hypot(z)).to_degrees()
            }),
            tilt_sd_deg: sd_at_end,
            launch_seen_s,
            end_seen_s: end_seen_s.map(|at_s| at_s - burn_s),
            gimbal_max_deg: gimbal
                .fold(0.0, |most: f64, angle| most.max(angle.abs()))
                .to_degrees(),
            pulses_within_limits: pulses()
                .all(|pulse| limit_us(pulse) <= shaft_us && pulse.is_as_asked(0.0)),
            neutral_after_burnout: pulses()
                .filter(|pulse| seconds(pulse.rise) > burn_s + NEUTRAL_S)
                .all(|pulse| limit_us(pulse) <= 1.0),
            stayed_active: end_seen_s.is_some_and(|at_s| at_s >= burn_s),
            case: None,
            path: path.into_iter().step_by(DRAWN_EVERY).collect(),
        }
    }
}

/// All flights of a case over each other.
fn plot<'a>(case: Case, runs: impl Iterator<Item = &'a Run>) -> Result<Markup> {
    let lines = runs.map(|run| Line::new("", 0, run.path.clone()));
    let plot = Plot::new("time since ignition, s", "error, deg", lines.collect());
    let caption = format!("{}, {}", case.airframe.name(), case.control());
    Ok(picture(&caption, plot.svg()?))
}
