//! Flights of the rocket through its burn: stable and unstable, with scheduled and constant gains,
//! and with the accelerometer left in the estimate, to show what that does.

use anyhow::{Context, Result, bail};
use maud::Markup;
use rig::bench::{RocketConfig, VehicleConfig, ZERO_RUDDER_US};
use rig::disturbance::Disturbances;
use rig::flight::FlightRecord;
use rig::ground_truth::Pulse;
use rig::rocket::{self, Airframe, Conditions, RocketLaw};
use rig::{ServoKind, prepare};
use samd21::board::Ticks;
use serde::Serialize;

use super::{Flying, since, told};
use crate::flight::fly::Fly;
use design::vehicle::{VehicleChoice, store};
use flights::requirements;
use report::campaign::carry_out;
use report::distribution::Distribution;
use report::exit::BadInput;
use report::measure::{Figure, Figures, Limit, data, figure, rows};
use report::page::figure as picture;
use report::plot::{Line, Plot};

/// How long the rocket stands armed on its pad, s: the gyroscope's offset is learned there.
const COUNTDOWN_S: f64 = 20.0;
/// How long a flight is followed behind the end of the burn, s.
const COAST_S: f64 = 2.0;
/// The first part of the control, which is not counted, s, and a share of the burn at most.
const LEFT_OUT_S: f64 = 2.0;
const LEFT_OUT: f64 = 0.25;
/// After the burn the pulses are neutral within this, s.
const NEUTRAL_S: f64 = 0.5;
/// From point to point of what is drawn, ms.
const DRAWN_EVERY: usize = 50;

/// What steers a flight.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Case<'a> {
    airframe: &'a Airframe,
    law: RocketLaw,
    attitude: AttitudeFrom,
}

/// What the attitude follows in flight.
#[derive(Clone, Copy, Debug, PartialEq)]
enum AttitudeFrom {
    /// The gyroscope alone, whose shift by acceleration was calibrated.
    Calibrated,
    /// The same without the calibration, to show what that does.
    Uncalibrated,
    /// The accelerometer too, to show what that does.
    Accelerometer,
}

impl<'a> Case<'a> {
    fn new(airframe: &'a Airframe, law: RocketLaw) -> Self {
        Self { airframe, law, attitude: AttitudeFrom::Calibrated }
    }

    /// All that are flown: of rockets that the tool knows, other laws for comparison.
    fn all(choice: &VehicleChoice, airframes: &'a [Airframe]) -> Vec<Self> {
        let scheduled = |airframe| Self::new(airframe, RocketLaw::Scheduled);
        if choice.file().is_some() {
            return airframes.iter().map(scheduled).collect();
        }
        let laws = |airframe: &'a Airframe| {
            let constant = RocketLaw::Constant(airframe.constant_gains);
            [RocketLaw::Scheduled, constant, RocketLaw::Cascade].map(|law| Self::new(airframe, law))
        };
        let last = airframes.first().into_iter().flat_map(|first| {
            [AttitudeFrom::Uncalibrated, AttitudeFrom::Accelerometer]
                .map(|attitude| Self { attitude, ..scheduled(first) })
        });
        airframes.iter().flat_map(laws).chain(last).collect()
    }

    fn control(&self) -> &'static str {
        match (self.law, self.attitude) {
            (_, AttitudeFrom::Uncalibrated) => "schedule, gyroscope not calibrated",
            (_, AttitudeFrom::Accelerometer) => "schedule, FUSE_ACC 1",
            (RocketLaw::Scheduled, _) => "schedule",
            (RocketLaw::Constant(_), _) => "constant gains",
            (RocketLaw::Cascade, _) => "cascade",
        }
    }

    fn name(&self) -> String {
        format!("{}, {}", self.airframe.name, self.control())
    }

    fn gimbal_limit_deg(&self) -> f64 {
        self.airframe.rocket().gimbal_limit_rad.to_degrees()
    }

    /// Whether the flight is held to the requirements: the others are for comparison.
    fn is_held(&self) -> bool {
        self.law == RocketLaw::Scheduled && self.attitude == AttitudeFrom::Calibrated
    }
}

/// A flight to be flown.
struct Flight<'a> {
    seed: u64,
    case: Case<'a>,
    on_pad: RocketConfig,
}

/// One flight.
#[derive(Clone, Debug, Serialize)]
struct Run<'a> {
    seed: u64,
    airframe: &'a str,
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
    case: Case<'a>,
    /// Time, s, and angle, deg.
    #[serde(skip)]
    path: Vec<(f64, f64)>,
}

/// Length of the longest flight of these, s.
pub fn longest_s(airframes: &[Airframe]) -> f64 {
    airframes.iter().map(|airframe| airframe.rocket().burn_s).fold(0.0, f64::max) + COAST_S
}

/// Options and disturbances that have no meaning for a rocket are refused by name.
///
/// # Errors
/// [`BadInput`], with what there is instead.
pub fn check(options: &Fly, disturbances: &Disturbances) -> Result<()> {
    let given = [
        ("thrust ramp", disturbances.thrust_ramp.is_some()),
        ("supply of a servo", disturbances.servo_supply.is_some()),
    ];
    if let Some((name, _)) = given.into_iter().find(|(_, is_given)| *is_given) {
        bail!(BadInput::new(format!(
            "a {name} disturbs a drone; what a rocket meets is in `[conditions]` of its file"
        )));
    }
    let given = [
        ("--servo", options.servo != ServoKind::S3003),
        ("--start", options.start.is_some()),
        ("--gains", options.gains.is_some()),
        ("--params", options.params.is_some() && options.vehicle.file().is_none()),
    ];
    if let Some((name, _)) = given.into_iter().find(|(_, is_given)| *is_given) {
        bail!(BadInput::new(format!(
            "{name} is the drone's, and a rocket has no use for it: its gains and gimbal are those of \
             `tvc tune --vehicle rocket`, or of its file"
        )));
    }
    Ok(())
}

/// What the rocket meets on its way: figures that the page tells in words.
fn conditions(met: &Conditions) -> Figure {
    figure(
        "conditions",
        [
            figure("rail_tilt_deg", met.rail_tilt_rad.to_degrees()),
            data("kicks_s", &met.kicks_s),
            figure("kick_rad_s", met.kick_rad_s),
            figure("misalignment_deg", met.misalignment_rad.to_degrees()),
            figure("wind_m_s", met.wind_m_s),
            figure("gust_m_s", met.gust_m_s),
            figure("gust_from_m", met.gust_from_m),
            figure("gust_depth_m", met.gust_depth_m),
            figure("turbulence_rms_m_s", met.turbulence_m_s),
            figure("turbulence_length_m", met.turbulence_length_m),
        ],
    )
}

fn conditions_in_words(met: &Conditions) -> String {
    let Conditions { kick_rad_s, wind_m_s, gust_m_s, gust_from_m, turbulence_m_s, .. } = met;
    let [first, second, third, last] = met.kicks_s;
    let kicks = match *kick_rad_s {
        0.0 => "There are no kicks.".to_owned(),
        kick => format!("Kicks of {kick} rad/s come at {first}, {second}, {third} and {last} s."),
    };
    format!(
        "The rail is {:.1} deg off the vertical, the thrust {:.1} deg off its axis. {kicks} \
         The wind is {wind_m_s} m/s. A gust rises to {gust_m_s} m/s and fades (1 - cos) from {gust_from_m} to \
         {} m. Turbulence is {turbulence_m_s} m/s rms in each direction with a length of {} m. All \
         directions come from the seed.",
        met.rail_tilt_rad.to_degrees(),
        met.misalignment_rad.to_degrees(),
        gust_from_m + met.gust_depth_m,
        met.turbulence_length_m,
    )
}

impl Flying<'_> {
    /// Flies `count` rockets that are not as their images were told, with scheduled gains; the
    /// figures and the page.
    pub(super) fn dispersed_rockets(&self, count: u32) -> Result<(Figures, String)> {
        let airframes = &self.vehicle.airframes;
        let met = &airframes[0].conditions;
        let flights: Vec<Flight<'_>> = self
            .seeded(count)
            .map(|(seed, _)| {
                let airframe = &airframes[(seed % airframes.len() as u64) as usize];
                let on_pad = rocket::dispersed(seed, airframe);
                Flight { seed, case: Case::new(airframe, RocketLaw::Scheduled), on_pad }
            })
            .collect();
        let runs = self.fly_rockets("rockets", &flights)?;
        let within = runs.iter().filter(|run| run.is_within()).count();
        let within_pct = 100.0 * within as f64 / f64::from(count);
        let rms = Distribution::of(runs.iter().map(|run| Some(run.error_rms_deg)));
        let words = "at most 2 deg rms, 4 deg at burnout, in control, then neutral";
        let figures = Figures::from([
            figure("vehicle", self.vehicle.kind.name()),
            figure("seed", self.options.seed),
            figure("vehicles", count).shown("rockets", "", 0),
            figure("within_pct", within_pct)
                .shown(words, "%", 2)
                .limit(requirements::DISPERSED_WITHIN_PCT),
            rms.figure("error_rms_deg", ("error rms", "deg", 2), [None; 2]),
            conditions(met),
            data("runs", &runs),
        ]);
        let title = format!("{count} dispersed rockets on the virtual rig");
        let plot = plot("The error of all rockets over each other.", &runs, |_| true)?;
        let turns = if airframes.len() > 1 { " Every other airframe is unstable." } else { "" };
        let words = "Each rocket differs from what its image was told: thrust by up to 5 %, \
             inertia by 20 %, propellant by 3 %, the dry centre of mass by 0.3 m. The static margin \
             differs by up to 0.4 diameters, speed and bandwidth of the gimbal by 20 %. Wind, gust, \
             rail and misalignment are drawn up to the above.";
        Ok(told(
            &title,
            &[&conditions_in_words(met), &(words.to_owned() + turns)],
            figures,
            "",
            &[plot],
        ))
    }

    /// Flies all cases with each of `count` seeds; the figures and the page.
    pub(super) fn rockets(&self, count: u32) -> Result<(Figures, String)> {
        let airframes = &self.vehicle.airframes;
        let met = &airframes[0].conditions;
        let cases = Case::all(&self.options.vehicle, airframes);
        let flights = self.seeded(count).flat_map(|(seed, _)| {
            cases.iter().map(move |case| {
                let on_pad = case.airframe.on_pad(seed);
                Flight { seed, case: *case, on_pad }
            })
        });
        let runs = self.fly_rockets("flights", &flights.collect::<Vec<_>>())?;
        let row = |case: &Case| {
            let of: Vec<&Run> = runs.iter().filter(|run| run.case == *case).collect();
            summary(*case, &of)
        };
        let figures = Figures::from([
            figure("vehicle", self.vehicle.kind.name()),
            figure("seed", self.options.seed),
            figure("seeds", count),
            conditions(met),
            rows("cases", cases.iter().map(row)),
            data("runs", &runs),
        ]);
        let plots = cases.iter().map(|case| plot(&case.name(), &runs, |run| run.case == *case));
        let plots = plots.collect::<Result<Vec<_>>>()?;
        let flights = runs.len();
        let title = format!("A rocket through its burn on the virtual rig: {flights} flights");
        let words = format!(
            "The error is the true angle of the rocket's axis from the vertical, from \
             {:.1} s after the launch was seen to the end of the burn. The image arms on its pad, \
             sees launch and burnout in the acceleration, and flies on its gyroscope alone.{}",
            left_out_s(airframes[0].rocket().burn_s),
            if cases.iter().any(|case| !case.is_held() && case.law == RocketLaw::Scheduled) {
                " In the last two cases the gyroscope's shift by acceleration was not calibrated, \
                 and the accelerometer corrects the attitude, as it does for a drone that hangs."
            } else {
                ""
            }
        );
        Ok(told(&title, &[&conditions_in_words(met), &words], figures, "cases", &plots))
    }

    fn fly_rockets<'a>(&self, what: &str, flights: &[Flight<'a>]) -> Result<Vec<Run<'a>>> {
        carry_out(what, flights, None, |flight| {
            let Flight { seed, case, .. } = flight;
            let run = self.fly_rocket(flight);
            run.with_context(|| format!("flying the rocket {}, with seed {seed}", case.name()))
        })
    }

    /// Boots with the rocket on its pad and flies it once.
    fn fly_rocket<'a>(&self, flight: &Flight<'a>) -> Result<Run<'a>> {
        let Flight { seed, case, on_pad } = flight;
        let mut setup = self.setup(*seed);
        setup.rig.bench.vehicle = VehicleConfig::Rocket(Box::new(on_pad.clone()));
        let stored = setup.rig.stored.get_or_insert_default();
        let mut parameters = rocket::parameters(case.airframe, case.law);
        match case.attitude {
            AttitudeFrom::Uncalibrated => {
                let told = [("GYR_PER_G", 0.1), ("GYR_PER_G_X", 0.0), ("GYR_PER_G_Y", 0.0)];
                parameters.extend(told.map(|(name, value)| (name.to_owned(), value)));
            }
            AttitudeFrom::Accelerometer => parameters.push(("FUSE_ACC".to_owned(), 1.0)),
            AttitudeFrom::Calibrated => {
                let per_g_deg_s = setup.rig.hardware.gyro_per_g_deg_s;
                parameters.extend(rocket::calibrated(per_g_deg_s, *seed));
            }
        }
        store(stored, parameters)?;
        let burn_s = on_pad.parameters.rocket.burn_s;
        let ready = prepare(self.image, &setup, &mut |_| ())?;
        let length_s = burn_s + COAST_S;
        let record = ready.launch(on_pad.start_rad, COUNTDOWN_S, length_s, &mut |_| ())?;
        Ok(Run::of(&record, burn_s, *seed, *case))
    }
}

/// The row of a case.
fn summary(case: Case<'_>, runs: &[&Run<'_>]) -> [Figure; 9] {
    let over = |of: fn(&Run<'_>) -> Option<f64>| Distribution::of(runs.iter().map(|run| of(run)));
    let rms = over(|run| Some(run.error_rms_deg));
    let sd = over(|run| run.tilt_sd_deg.map(f64::from));
    let worst =
        |key, of, label, decimals| figure(key, over(of).worst).shown(label, "deg", decimals);
    let held = |limit| case.is_held().then_some(limit);
    let all = |key, is_one: fn(&Run<'_>) -> bool, label| {
        let all = figure(key, runs.iter().all(|run| is_one(run)));
        all.shown(label, "", 0).limit(held(requirements::IN_CONTROL))
    };
    [
        figure("case", case.name()).shown("airframe, control", "", 0),
        figure("error_rms_mean_deg", rms.mean).shown("error rms, mean", "deg", 2),
        worst("error_rms_deg", |run| Some(run.error_rms_deg), "worst", 2)
            .limit(held(requirements::ASCENT_ERROR_RMS_DEG)),
        worst("error_max_deg", |run| Some(run.error_max_deg), "largest error", 1),
        worst("error_end_deg", |run| Some(run.error_end_deg), "at burnout", 2)
            .limit(held(requirements::ASCENT_ERROR_END_DEG)),
        figure("tilt_sd_deg", sd.mean.is_finite().then_some(sd.mean))
            .shown("tilt_sd", "deg", 1)
            .or("-"),
        worst("gimbal_max_deg", |run| Some(run.gimbal_max_deg), "gimbal", 2)
            .limit(held(Limit::AtMost(case.gimbal_limit_deg() + 1e-6))),
        all("in_control", |run| run.is_in_control(), "in control, pulses within limits"),
        all("neutral_after_burnout", |run| run.neutral_after_burnout, "neutral after burnout"),
    ]
}

impl<'a> Run<'a> {
    /// Whether it does what is required of a flight.
    fn is_within(&self) -> bool {
        self.error_rms_deg <= requirements::ASCENT_ERROR_MOST_DEG
            && self.error_end_deg <= requirements::ASCENT_END_MOST_DEG
            && self.is_in_control()
            && self.neutral_after_burnout
    }

    fn is_in_control(&self) -> bool {
        self.stayed_active && self.pulses_within_limits
    }

    fn of(record: &FlightRecord, burn_s: f64, seed: u64, case: Case<'a>) -> Self {
        let seconds = |at: Ticks| since(record, at);
        let angle_deg = |tilt: [f64; 2]| tilt[0].hypot(tilt[1]).to_degrees();
        let path: Vec<(f64, f64)> =
            record.motion.iter().map(|m| (seconds(m.time), angle_deg(m.tilt_rad))).collect();
        let states = record.received.heartbeats.iter();
        let active = |is_active: bool, after_s: f64| {
            let mut states = states.clone().map(|beat| (seconds(beat.at), beat.state));
            let wanted = |state| (state == Some(client::StateKind::Active)) == is_active;
            states.find(|(at_s, state)| *at_s >= after_s && wanted(*state))
        };
        let launch_seen_s = active(true, 0.0).map(|(at_s, _)| at_s);
        let end_seen_s = active(false, launch_seen_s.unwrap_or(0.0)).map(|(at_s, _)| at_s);
        let from_s = launch_seen_s.unwrap_or(0.0) + left_out_s(burn_s);
        // Afterwards the accelerometer is believed again.
        let ended = |at: Ticks| end_seen_s.is_some_and(|end_s| seconds(at) >= end_s);
        let mut told = record.received.tilt_sd_deg.iter().rev();
        let tilt_sd_deg = told.find(|(at, _)| !ended(*at)).map(|(_, sd_deg)| *sd_deg);
        let errors = path.iter().filter(|(at_s, _)| (from_s..burn_s).contains(at_s));
        let errors: Vec<f64> = errors.map(|(_, error)| *error).collect();
        let square: f64 = errors.iter().map(|error| error * error).sum();
        let gimbal = record.motion.iter().flat_map(|m| m.rudders_rad);
        let believed = record.received.attitudes.iter().rev();
        let mut believed = believed.skip_while(|attitude| seconds(attitude.at) > burn_s);
        let pulses = || record.pulses.iter().chain(&record.roll_pulses);
        let limit_us = |pulse: &Pulse| (pulse.width_us() - ZERO_RUDDER_US).abs();
        let per_gimbal = case.airframe.mounting.shaft_per_gimbal;
        let shaft_us = 10.0 * per_gimbal * case.gimbal_limit_deg() + 1.0;
        Self {
            seed,
            airframe: &case.airframe.name,
            control: case.control(),
            case,
            error_rms_deg: (square / errors.len().max(1) as f64).sqrt(),
            error_max_deg: errors.iter().copied().fold(0.0, f64::max),
            error_end_deg: errors.last().copied().unwrap_or(f64::NAN),
            believed_end_deg: believed.next().map(|attitude| {
                let [w, x, y, z] = attitude.quaternion.map(f64::from);
                2.0 * x.hypot(y).atan2(w.hypot(z)).to_degrees()
            }),
            tilt_sd_deg,
            launch_seen_s,
            end_seen_s: end_seen_s.map(|at_s| at_s - burn_s),
            gimbal_max_deg: gimbal.fold(0.0, |most: f64, angle| most.max(angle.abs())).to_degrees(),
            pulses_within_limits: pulses()
                .all(|pulse| limit_us(pulse) <= shaft_us && pulse.is_as_asked(0.0)),
            neutral_after_burnout: pulses()
                .filter(|pulse| seconds(pulse.rise) > burn_s + NEUTRAL_S)
                .all(|pulse| limit_us(pulse) <= 1.0),
            stayed_active: end_seen_s.is_some_and(|at_s| at_s >= burn_s),
            path: path
                .into_iter()
                .filter(|(at_s, _)| *at_s <= burn_s + NEUTRAL_S)
                .step_by(DRAWN_EVERY)
                .collect(),
        }
    }
}

/// The first part of the control, which is not counted, s.
fn left_out_s(burn_s: f64) -> f64 {
    LEFT_OUT_S.min(LEFT_OUT * burn_s)
}

/// Flights over each other; those that are not within the requirements have another colour.
fn plot(caption: &str, runs: &[Run<'_>], is_one: impl Fn(&Run<'_>) -> bool) -> Result<Markup> {
    let lines = runs.iter().filter(|run| is_one(run));
    let lines = lines.map(|run| Line::new("", usize::from(!run.is_within()), run.path.clone()));
    let plot = Plot::new("time since ignition, s", "error, deg", lines.collect());
    Ok(picture(caption, plot.svg()?))
}
