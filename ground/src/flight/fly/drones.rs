//! Campaigns of the drones: many seeds, from tilts of one axis or of two, at several headings, with
//! and without spin; or vehicles that are not as their parameters say, drawn as those of
//! `tvc montecarlo`.
//!
//! A single flight is a draw: by the phases of frame and sensor alone its settling differs by a
//! tenth.

use anyhow::{Context, Result};
use client::StateKind;
use maud::{Markup, html};
use plant::dispersion::{Campaign, Ranges};
use plant::limit::{self, Actuator};
use plant::pitch_loop::COMMAND_LIMIT_RAD;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rig::flight::{FlightRecord, Release, Setup};
use rig::prepare;
use serde::Serialize;
use tvc_nano::Axis;

use super::figures::cycles;
use super::flights::{FLIGHT_S, START_RATE_RAD_S, STARTS_RAD};
use super::{Flying, since, told};
use design::vehicle::VehicleKind;
use flights::requirements;
use report::campaign::carry_out;
use report::distribution::Distribution;
use report::measure::{Figure, Figures, data, figure, rows};
use report::page::figure as picture;
use report::plot::{Line, Plot};

/// Tilts of the drone with two rudders, of one axis or of each, rad.
const JOINT_STARTS_RAD: [f64; 3] = [0.2, 0.4, 0.6];
/// Which axes are tilted, pitch and roll, and how a table calls that.
const DIRECTIONS: [([f64; 2], &str); 3] =
    [([1.0, 0.0], "pitch"), ([0.0, 1.0], "roll"), ([1.0, 1.0], "both")];
/// Rates about the drone's own vertical at the release, rad/s.
const SPINS_RAD_S: [f64; 2] = [0.0, 1.0];
/// Where the nose points, deg from north to the east.
const HEADINGS_DEG: [f64; 3] = [0.0, 90.0, 135.0];
/// Settling band, share of the start.
const BAND: f64 = 0.05;
/// The last part of a flight, in which what is left is measured, s.
const REST_S: f64 = 1.0;
/// The part of a flight that is drawn, s, and the time from point to point, ms.
const DRAWN_S: f64 = 1.5;
const DRAWN_EVERY: usize = 5;

/// How a drone is let go.
#[derive(Clone, Copy, Debug)]
struct Start {
    /// Which axes are tilted.
    axes: &'static str,
    size_rad: f64,
    tilt_rad: [f64; 2],
    spin_rad_s: f64,
}

impl Start {
    /// Tilted by a size in one of [`DIRECTIONS`], to a side.
    fn new(direction: usize, size_rad: f64, side: f64, spin_rad_s: f64) -> Self {
        let (direction, axes) = DIRECTIONS[direction];
        let tilt_rad = direction.map(|share| side * share * size_rad);
        Self { axes, size_rad, tilt_rad, spin_rad_s }
    }

    fn release(&self, vehicle: VehicleKind) -> Release {
        let Self { tilt_rad, spin_rad_s, .. } = *self;
        // On the pivot a rate has the sign of its pitch, in the joint that of its tilt.
        let rate_rad_s = match vehicle {
            VehicleKind::Drone => START_RATE_RAD_S.copysign(tilt_rad[0]),
            VehicleKind::Drone2 | VehicleKind::Rocket => START_RATE_RAD_S,
        };
        Release { tilt_rad, rate_rad_s, spin_rad_s }
    }
}

/// A drone that is booted once, and flown from several starts.
struct Boot {
    setup: Setup,
    seed: u64,
    heading_deg: f64,
    starts: Vec<Start>,
}

/// One flight: lists name pitch first, then roll.
#[derive(Clone, Debug, Serialize)]
struct Run {
    seed: u64,
    heading_deg: f64,
    spin_rad_s: f64,
    start_rad: [f64; 2],
    /// None for an axis that was upright.
    overshoot_pct: [Option<f64>; 2],
    settling_5pct_s: [Option<f64>; 2],
    /// Largest angle of an axis that was upright, of the start of the other; none if both were
    /// tilted.
    cross_coupling_pct: Option<f64>,
    stayed_active: bool,
    /// RMS of the pitch over the last part.
    #[serde(skip)]
    residual_mrad: f64,
    #[serde(skip)]
    start: Start,
    /// Time, s, and angles, deg.
    #[serde(skip)]
    path: Vec<(f64, [f64; 2])>,
}

impl Run {
    fn of(record: &FlightRecord, boot: &Boot, start: Start) -> Result<Self> {
        let start_rad = record.start_rad;
        let [pitch, roll] = [Axis::Pitch, Axis::Roll].map(|axis| {
            let tilted = start_rad[axis.index()] != 0.0;
            tilted.then(|| record.response(axis)).transpose()
        });
        let responses = [pitch?, roll?];
        let motion = record.motion.iter();
        let path: Vec<(f64, [f64; 2])> =
            motion.map(|m| (since(record, m.time), m.tilt_rad)).collect();
        let rest = path.iter().filter(|(at_s, _)| *at_s >= FLIGHT_S - REST_S);
        let rest: Vec<f64> = rest.map(|(_, [pitch, _])| pitch * pitch).collect();
        let upright = start_rad.iter().position(|start| *start == 0.0);
        let cross_coupling_pct = upright.map(|axis| {
            let largest = path.iter().map(|(_, tilt)| tilt[axis].abs());
            100.0 * largest.fold(0.0, f64::max) / start_rad[1 - axis].abs()
        });
        let of = |figure: fn(&plant::StepResponse) -> Option<f64>| {
            [0, 1].map(|axis| responses[axis].as_ref().and_then(figure))
        };
        Ok(Self {
            seed: boot.seed,
            heading_deg: boot.heading_deg,
            spin_rad_s: start.spin_rad_s,
            start_rad,
            overshoot_pct: of(|response| Some(response.overshoot_pct())),
            settling_5pct_s: of(|response| response.settling_s(BAND)),
            cross_coupling_pct,
            stayed_active: record.final_state == Some(StateKind::Active),
            residual_mrad: 1e3 * (rest.iter().sum::<f64>() / rest.len().max(1) as f64).sqrt(),
            start,
            path: path
                .into_iter()
                .filter(|(at_s, _)| *at_s <= DRAWN_S)
                .step_by(DRAWN_EVERY)
                .map(|(at_s, tilt)| (at_s, tilt.map(f64::to_degrees)))
                .collect(),
        })
    }

    /// Whether these axes were tilted so far.
    fn is_from(&self, size_rad: f64, axes: &str) -> bool {
        self.start.size_rad == size_rad && self.start.axes == axes
    }

    /// Those of two figures whose axes were tilted.
    fn tilted(&self, figures: [Option<f64>; 2]) -> impl Iterator<Item = Option<f64>> {
        let axes = self.start_rad.into_iter().zip(figures);
        axes.filter(|(start, _)| *start != 0.0).map(|(_, figure)| figure)
    }

    /// What the thesis requires of every release.
    fn is_within(&self) -> bool {
        let met = |figures, most: f64| {
            self.tilted(figures).all(|figure| figure.is_some_and(|value| value <= most))
        };
        self.stayed_active && met(self.overshoot_pct, 30.0) && met(self.settling_5pct_s, 1.5)
    }
}

/// How a figure of the tilted axes is distributed.
fn over(runs: &[&Run], of: impl Fn(&Run) -> [Option<f64>; 2]) -> Distribution {
    Distribution::of(runs.iter().flat_map(|run| run.tilted(of(run))))
}

impl Flying<'_> {
    /// Boots each drone and flies all of its starts; the bar counts the boots as `what`.
    fn fly_drones(&self, what: &str, boots: &[Boot]) -> Result<Vec<Run>> {
        let runs = carry_out(what, boots, None, |boot| {
            let ready = prepare(self.image, &boot.setup, &mut |_| ())?;
            let runs = boot.starts.iter().map(|start| {
                let release = start.release(self.vehicle.kind);
                let record = ready.fly_from(&release, FLIGHT_S, &mut |_| ());
                let record = record.with_context(|| {
                    let ([pitch, roll], seed) = (release.tilt_rad, boot.seed);
                    format!("flying from {pitch} and {roll} rad, number {seed}")
                })?;
                Run::of(&record, boot, *start)
            });
            runs.collect::<Result<Vec<_>>>()
        })?;
        Ok(runs.into_iter().flatten().collect())
    }

    /// The tilts that are flown from: the option's, or else these.
    fn sizes(&self, usual: [f64; 3]) -> Vec<f64> {
        self.options.start.map_or(usual.to_vec(), |start| vec![start])
    }

    /// What all campaigns of drones begin with.
    fn named(&self) -> [Figure; 3] {
        [
            figure("vehicle", self.vehicle.kind.name()),
            figure("servo", self.options.servo.name()),
            figure("seed", self.options.seed),
        ]
    }

    /// Flies every start with each of `count` seeds, to either side in turn; the figures and the
    /// page.
    pub(super) fn seeds(&self, count: u32) -> Result<(Figures, String)> {
        let sizes = self.sizes(STARTS_RAD);
        let boots = self.seeded(count).map(|(seed, side)| {
            let start = |size_rad: &f64| {
                let start = Start::new(0, *size_rad, side, 0.0);
                // The sign of a zero is part of what the instant of the release is drawn from.
                Start { tilt_rad: [start.tilt_rad[0], 0.0], ..start }
            };
            let starts = sizes.iter().map(start).collect();
            Boot { setup: self.setup(seed), seed, heading_deg: 0.0, starts }
        });
        let runs = self.fly_drones("seeds", &boots.collect::<Vec<_>>())?;
        let servo = self.options.servo;
        let table = sizes.iter().map(|&size| {
            let of: Vec<&Run> = runs.iter().filter(|run| run.start.size_rad == size).collect();
            let limit_s = limit_s(self.setup, size)?;
            let ratio = over(&of, |run| run.settling_5pct_s.map(|s| s.map(|s| s / limit_s)));
            let overshoot = over(&of, |run| run.overshoot_pct);
            let settling = over(&of, |run| run.settling_5pct_s);
            let residual = over(&of, |run| [Some(run.residual_mrad); 2]);
            let ratio_limits = requirements::settling_ratio(servo).map(Some);
            let overshoot_limits = requirements::OVERSHOOT_DISTRIBUTION.map(Some);
            Ok([
                figure("start_rad", size).shown("start", "rad", 2),
                figure("limit_s", limit_s).shown("limit", "s", 3),
                ratio.figure("ratio", ("times the limit", "", 2), ratio_limits),
                overshoot.figure("overshoot_pct", ("overshoot", "%", 1), overshoot_limits),
                settling.figure("settling_5pct_s", ("5 % settling", "s", 3), [None; 2]),
                residual.figure("residual_mrad", ("residual", "mrad", 1), [None; 2]),
            ])
        });
        let [_, servo_name, seed] = self.named();
        let table = table.collect::<Result<Vec<_>>>()?;
        let seeds = figure("seeds", count);
        let figures = Figures::from([servo_name, seed, seeds, rows("distribution", table)]);
        let servo = servo.name();
        let title = format!("{count} flights from each tilt on the virtual rig: servo {servo}");
        let words = "Figures of the drone's true pitch, released with 0.2 rad/s away from upright, \
             to either side in turn. The limit is bang-bang control with the rudder's rate \
             limited, without delay and lag; the residual is the rms of the pitch over the last \
             second.";
        Ok(told(&title, &[words], figures, "distribution", &plots(&sizes, 1, &runs)?))
    }

    /// Flies the drone with two rudders with each of `count` seeds; the figures and the page.
    pub(super) fn two_axes(&self, count: u32) -> Result<(Figures, String)> {
        let sizes = self.sizes(JOINT_STARTS_RAD);
        let places = sizes.iter().flat_map(|size| [0, 1, 2].map(|axes| (*size, axes)));
        let places: Vec<(f64, usize)> = places.collect();
        let boots = self.seeded(count).flat_map(|(seed, side)| {
            HEADINGS_DEG.map(|heading_deg| {
                let starts = places.iter().flat_map(|(size_rad, axes)| {
                    SPINS_RAD_S.map(|spin_rad_s| Start::new(*axes, *size_rad, side, spin_rad_s))
                });
                let starts = starts.collect();
                let mut setup = self.setup(seed);
                setup.rig.bench.heading_rad = heading_deg.to_radians();
                Boot { setup, seed, heading_deg, starts }
            })
        });
        let runs = self.fly_drones("headings", &boots.collect::<Vec<_>>())?;
        let rows_of =
            places.iter().map(|(size, axes)| self.joint_row(*size, DIRECTIONS[*axes].1, &runs));
        let figures = self.named().into_iter().chain([
            figure("seeds", count),
            self.cycles(sizes[0])?,
            rows("starts", rows_of),
            data("runs", &runs),
        ]);
        let (servo, flights) = (self.options.servo.name(), runs.len());
        let title = format!("Two axes on the virtual rig: servos {servo}, {flights} flights");
        let words = "Parts of the drone's true tilt in axes that do not spin with it. It is \
             released with 0.2 rad/s away from upright, tilted in one axis and in both. It spins \
             with 0 and 1 rad/s, and its nose points north, east and south-east. Cross \
             coupling is the largest angle of an axis that was upright, as a share of the other's \
             start.";
        Ok(told(&title, &[words], figures.into(), "starts", &plots(&sizes, 3, &runs)?))
    }

    /// The row of a tilt of some axes.
    fn joint_row(&self, size: f64, axes: &str, runs: &[Run]) -> [Figure; 6] {
        let of: Vec<&Run> = runs.iter().filter(|run| run.is_from(size, axes)).collect();
        // A run that has left control has neither settled nor a bounded overshoot.
        let held = |run: &Run, figures: [Option<f64>; 2]| {
            figures.map(|figure| figure.filter(|_| run.stayed_active))
        };
        let overshoot = over(&of, |run| held(run, run.overshoot_pct));
        let settling = over(&of, |run| held(run, run.settling_5pct_s));
        let cross = of.iter().filter_map(|run| run.cross_coupling_pct).reduce(f64::max);
        let within = |value: f64| value.is_finite().then_some(value);
        [
            figure("start_rad", size).shown("start", "rad", 2),
            figure("axes", axes).shown("axes", "", 0),
            figure("overshoot_pct", within(overshoot.worst))
                .shown("overshoot, worst", "%", 1)
                .or("lost")
                .limit(requirements::OVERSHOOT_PCT),
            figure("settling_5pct_mean_s", within(settling.mean))
                .shown("5 % settling, mean", "s", 3)
                .or("never"),
            figure("settling_5pct_s", within(settling.worst))
                .shown("worst", "s", 3)
                .or("never")
                .limit(requirements::settling_s(self.options.servo)),
            figure("cross_coupling_pct", cross)
                .shown("cross coupling", "%", 1)
                .limit((axes != "both").then_some(requirements::CROSS_COUPLING_PCT)),
        ]
    }

    /// Cycles of a step of both axes without wait states.
    fn cycles(&self, size_rad: f64) -> Result<Figure> {
        let mut setup = self.with_wait_states(0);
        setup.rig.bench.faults.clear();
        let release =
            Release { tilt_rad: [size_rad; 2], rate_rad_s: START_RATE_RAD_S, spin_rad_s: 0.0 };
        let ready = prepare(self.image, &setup, &mut |_| ())?;
        let record = ready.fly_from(&release, 1.0, &mut |_| ())?;
        let spread = record.timing.cycles_per_step;
        let mean = cycles(figure("cycles_per_step_mean", spread.mean), "0 wait states, mean");
        let worst = cycles(figure("cycles_per_step_max", spread.max), "0 wait states, worst");
        Ok(figure("loop", [mean, worst]))
    }

    /// Flies `count` vehicles that are not as their parameters say, one flight each; the figures
    /// and the page.
    pub(super) fn dispersed(&self, count: u32) -> Result<(Figures, String)> {
        let Self { options, .. } = self;
        let nominal = self.vehicle.setup;
        let campaign = Campaign::new(options.seed, count.into());
        let campaign = Campaign { ranges: Ranges::WIDE, ..campaign };
        let is_joint = self.vehicle.kind != VehicleKind::Drone;
        let sizes = self.sizes(if is_joint { JOINT_STARTS_RAD } else { STARTS_RAD });
        let boots = campaign.indices().map(|index| {
            let draw = campaign.draw(index);
            let drawn = draw.setup(&nominal);
            let mut dice = ChaCha8Rng::seed_from_u64(draw.noise_seed);
            let heading_deg = dice.random_range(-180.0..180.0);
            let spin_rad_s = dice.random_range(-1.0..1.0);
            let direction = dice.random_range(0..DIRECTIONS.len());
            let (direction, spin_rad_s) = if is_joint { (direction, spin_rad_s) } else { (0, 0.0) };
            let size_rad = sizes[(index % sizes.len() as u64) as usize];
            let side = draw.start_rad.signum();
            let mut setup = self.setup(draw.noise_seed);
            setup.rig.bench.parameters = drawn.drone;
            setup.rig.bench.servo = drawn.servo;
            setup.rig.bench.heading_rad = f64::to_radians(heading_deg);
            let starts = vec![Start::new(direction, size_rad, side, spin_rad_s)];
            Boot { setup, seed: index, heading_deg, starts }
        });
        let runs = self.fly_drones("vehicles", &boots.collect::<Vec<_>>())?;
        let all: Vec<&Run> = runs.iter().collect();
        let overshoot = over(&all, |run| run.overshoot_pct);
        let settling = over(&all, |run| run.settling_5pct_s);
        let passed = runs.iter().filter(|run| run.is_within()).count();
        let within_pct = 100.0 * passed as f64 / f64::from(count);
        let figures = self.named().into_iter().chain([
            figure("vehicles", count).shown("vehicles", "", 0),
            figure("within_pct", within_pct)
                .shown("overshoot at most 30 %, settled within 1.5 s", "%", 2)
                .limit(requirements::DISPERSED_WITHIN_PCT),
            overshoot.figure("overshoot_pct", ("overshoot", "%", 1), [None; 2]),
            settling.figure("settling_5pct_s", ("5 % settling", "s", 3), [None; 2]),
            data("runs", &runs),
        ]);
        let (vehicle, servo) = (self.vehicle.kind.name(), options.servo.name());
        let title =
            format!("{count} dispersed vehicles on the virtual rig: {vehicle}, servo {servo}");
        let words = "Thrust and inertia of each vehicle differ by up to 30 % from what its \
             parameters say, and its centre of mass by up to 20 mm in height. Its servos differ by \
             up to 20 % in speed and torque and by half in play. The supply is up to 15 % low.";
        let lines = runs.iter().map(|run| {
            let path = run.path.iter();
            let path = path.map(|(at_s, [pitch, roll])| (*at_s, pitch.hypot(*roll)));
            Line::new("", usize::from(!run.is_within()), path.collect())
        });
        let plot = Plot::new("time since release, s", "tilt, deg", lines.collect());
        let plot = picture("The tilt of all vehicles over each other.", plot.svg()?);
        Ok(told(&title, &[words], figures.into(), "", &[plot]))
    }
}

/// The shortest 5 % settling that the rudder's speed allows, s (docs/explanation/model.md).
fn limit_s(setup: &Setup, start_rad: f64) -> Result<f64> {
    let bench = &setup.rig.bench;
    let actuator = Actuator { rate_rad_s: bench.servo.speed_rad_s, limit_rad: COMMAND_LIMIT_RAD };
    let rate_rad_s = START_RATE_RAD_S.copysign(start_rad);
    let limit = limit::time_optimal(&bench.parameters, actuator, start_rad, rate_rad_s, 0.0)?;
    Ok(limit.response.settling_s(BAND).unwrap_or(limit.to_rest_s))
}

/// All flights from each size of tilt, the sign of their side taken off: a picture for each of the
/// first `directions`.
fn plots(sizes: &[f64], directions: usize, runs: &[Run]) -> Result<Vec<Markup>> {
    let mut parts = Vec::new();
    for size_rad in sizes {
        parts.push(html! { h2 { "From " (size_rad) " rad" } });
        for (_, axes) in &DIRECTIONS[..directions] {
            let of = runs.iter().filter(|run| run.is_from(*size_rad, axes));
            let line = |axis: usize, name: &'static str| {
                of.clone().enumerate().map(move |(index, run)| {
                    let side = run.start.tilt_rad.iter().sum::<f64>().signum();
                    let path = run.path.iter().map(|(at_s, tilt)| (*at_s, side * tilt[axis]));
                    Line::new(if index == 0 { name } else { "" }, axis, path.collect())
                })
            };
            let roll = line(1, "roll").filter(|_| directions > 1);
            let lines = line(0, "pitch").chain(roll).collect();
            let band = (BAND * size_rad).to_degrees().abs();
            let plot = Plot::new("time since release, s", "angle, deg", lines);
            let svg = plot.with_band(Some((-band, band))).svg()?;
            let caption =
                format!("Tilted: {axes}. All flights over each other, with the 5 % band.");
            parts.push(picture(&caption, svg));
        }
    }
    Ok(parts)
}
