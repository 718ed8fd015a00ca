//! `tvc replay`: the firmware's own library on the counts and times of a log.
//!
//! From a moment at which the firmware began its estimate anew (power-on, or the calibration that
//! `tvc record` asks for) the library, given the same counts, times, parameters and commands, gives
//! the same bits. Frames that were lost on the way to the log end that, until the estimate begins
//! anew or the vehicle tells all that its flight remembers, which it does once a second.

mod filter;
mod page;
mod table;

use std::collections::BTreeMap;
use std::path::PathBuf;

use anyhow::{Result, bail};
use clap::Args;
use client::state::{is_in_operation, reason_of, state_of};
use client::{ReasonKind, StateKind};
use mavlink::dialects::common::{MavCmd, MavResult};
use recordings::FilterName;
use tvc_nano::{BootReport, Command, Flight, Micros, RawSample, Refresh, SensorFault};

use flights::arguments::parameter;
use flights::log::{self, Event, Step};
use report::exit::{BadInput, Verdict};
use report::file::write_whole;
use report::kind;
use report::measure::{Figures, data, figure, note, rows, some};

/// Options of `tvc replay`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  tvc replay flight.tlog                 the firmware's library on the log's counts, bit for bit
  tvc replay flight.tlog --param SFC_GAIN_S=0.4    what other gains would have commanded
  tvc replay flight.tlog --filter madgwick     another filter's pitch beside the firmware's
  tvc replay flight.tlog --offline --report both.html    the pitch as it is known afterwards
  tvc replay flight.tlog --csv both.csv        both runs as a table, side by side

The motion is the log's: it does not answer to what is changed.
Behind lost frames it compares again from the vehicle's next full state on, which comes once a second.
Exit status: 0 equal wherever it can be compared, 1 a difference or nothing to compare, 2 unusable input.")]
pub struct Replay {
    /// A telemetry log (.tlog, .mcap).
    #[arg(value_name = "LOG")]
    pub log: PathBuf,

    /// Run with another value of a parameter; may be given more than once.
    #[arg(long = "param", value_name = "NAME=VALUE", value_parser = parameter)]
    pub parameters: Vec<(String, f32)>,

    /// Run another filter beside.
    #[arg(long, value_enum)]
    pub filter: Option<FilterName>,

    /// Run that filter, or else vqf, in both directions of time: what comes later counts too, and
    /// the pitch is nearer to the truth than any that was known in flight.
    #[arg(long)]
    pub offline: bool,

    /// Print one JSON object on standard output and nothing else there.
    #[arg(long)]
    pub json: bool,

    /// Write both runs as a table, side by side; `tvc log convert` writes the log's own steps.
    #[arg(long, value_name = "FILE.csv", value_parser = kind::table)]
    pub csv: Option<PathBuf>,

    /// Write an HTML page with both runs.
    #[arg(long, value_name = "FILE.html", value_parser = kind::page)]
    pub report: Option<PathBuf>,
}

/// A step as logged and as replayed.
#[derive(Clone, Copy, Debug)]
pub struct Pair {
    /// As logged.
    pub logged: Step,
    /// As replayed.
    pub again: Step,
    /// All that the step depends on is known: both must be equal bit for bit.
    pub exact: bool,
}

/// What a replay comes to.
#[derive(Debug, Default)]
pub struct Comparison {
    /// Control steps in the log.
    pub steps: usize,
    /// Steps of which all is known that they depend on.
    pub compared: usize,
    /// The first and the last of each stretch of these, by the vehicle's clock, s.
    pub compared_s: Vec<[f64; 2]>,
    /// Of these, steps whose attitude, rates, command and pulse are the same, bit for bit.
    pub equal: usize,
    /// Time of the first that is not, by the vehicle's clock, s.
    pub first_difference_s: Option<f64>,
    /// Steps without a usable sample.
    pub missed: usize,
    /// Frames lost on the way to the log.
    pub lost: u64,
    /// Times of the steps before which frames are lost, by the vehicle's clock, s.
    pub gaps_s: Vec<f64>,
    /// Largest difference of pitch, rad.
    pub pitch_difference_rad_max: f64,
    /// Largest difference of the pulse, us.
    pub pulse_difference_us_max: u16,
    /// Commands of the log that the library refused.
    pub refused: Vec<String>,
    /// Parameters that were given other values.
    pub changed: BTreeMap<String, f32>,
    /// RMS difference between the other filter's pitch and the firmware's, rad.
    pub filter_difference_rad_rms: Option<f64>,
}

/// Replays as `options` say.
pub fn run(options: &Replay) -> Result<Verdict> {
    let flight = log::Flight::read(&options.log)?;
    let changed: BTreeMap<String, f32> = options.parameters.iter().cloned().collect();
    let (pairs, refused) = replay(&flight, &changed)?;
    if pairs.is_empty() {
        let log = options.log.display();
        bail!(BadInput::new(format!("{log} has no control steps to replay")));
    }
    let mut found = compare(&pairs);
    (found.missed, found.lost) = (flight.missed(), flight.lost());
    found.gaps_s = gaps_s(&flight);
    (found.refused, found.changed) = (refused, changed);
    let chosen = options.filter.or(options.offline.then_some(FilterName::Vqf));
    let other = chosen
        .map(|chosen| filter::pitches(chosen, options.offline, &flight, &flight.parameters()));
    let other = other.transpose()?;
    let rms = |other: &Vec<(f64, f64)>| filter::difference_rms(other, &flight);
    found.filter_difference_rad_rms = other.as_ref().map(rms);
    let page = options.report.as_deref().map(|path| {
        let page = page::render(&options.log, &found, &pairs, other.as_deref())?;
        anyhow::Ok((path, page))
    });
    let concluded = found.figures().conclude(options.json, page.transpose()?);
    if let Some(path) = &options.csv {
        write_whole(path, table::text(&pairs, other.as_deref()).as_bytes())?;
        eprintln!("wrote {}", path.display());
    }
    concluded?;
    let as_logged = found.compared > 0 && found.equal == found.compared;
    Ok(Verdict::of(as_logged || !found.changed.is_empty()))
}

/// The times of the steps before which frames are lost.
fn gaps_s(flight: &log::Flight) -> Vec<f64> {
    let mut after_gap = false;
    let at_gap = |event: &Event| match event {
        Event::Gap(_) => {
            after_gap = true;
            None
        }
        Event::Step(step) => std::mem::take(&mut after_gap).then(|| step.time_s()),
        _ => None,
    };
    flight.events.iter().filter_map(at_gap).collect()
}

impl Comparison {
    /// For a person and for `--json`.
    pub fn figures(&self) -> Figures {
        let stretches = self.compared_s.iter().map(|[from, to]| format!("{from:.3} to {to:.3} s"));
        let gaps = self.gaps_s.iter().map(|at_s| format!("{at_s:.3} s"));
        let mut figures = vec![
            figure("steps", self.steps).shown("control steps", "", 0),
            figure("compared", self.compared).shown("  that can be compared", "", 0),
            data("compared_s", &self.compared_s).said("  from a full state on", some(stretches)),
            figure("equal", self.equal).shown("  equal bit for bit", "", 0),
            figure("first_difference_s", self.first_difference_s).shown(
                "  first difference",
                "s",
                3,
            ),
            figure("missed", self.missed).shown("  without a sample", "", 0),
            figure("lost", self.lost).shown("frames lost", "", 0),
            data("gaps_s", &self.gaps_s).said("  gaps", some(gaps)),
            figure("pitch_difference_rad_max", self.pitch_difference_rad_max).shown(
                "pitch differs by at most",
                "rad",
                4,
            ),
            figure("pulse_difference_us_max", self.pulse_difference_us_max).shown(
                "pulse differs by at most",
                "us",
                0,
            ),
            rows("refused", self.refused.iter().map(String::as_str)),
            data("changed", &self.changed),
        ];
        figures.extend(self.filter_difference_rad_rms.map(|rms| {
            figure("filter_difference_rad_rms", rms)
                .shown("the other filter's pitch differs by, rms", "deg", 3)
                .scaled(1_f64.to_degrees())
        }));
        if !self.changed.is_empty() {
            let changed = self.changed.iter().map(|(name, value)| format!("{name} = {value}"));
            figures.push(note(format!("with {}", changed.collect::<Vec<_>>().join(", "))));
        } else if self.compared == 0 {
            figures.push(note(
                "nothing to compare bit for bit: the log holds neither the beginning of an estimate \
                 nor a full state with the parameters that it tells",
            ));
        }
        figures.extend(self.refused.iter().map(note));
        Figures::from(figures)
    }
}

/// Runs the library over a log, with some parameters forced to other values. Also gives the
/// refusals.
///
/// # Errors
/// A forced value out of its range, or parameters of the log that make no flight.
pub fn replay(
    flight: &log::Flight,
    changed: &BTreeMap<String, f32>,
) -> Result<(Vec<Pair>, Vec<String>)> {
    let mut params = flight.parameters();
    for (name, value) in changed {
        params.set(name, *value).map_err(|error| BadInput::new(format!("{name}: {error}")))?;
    }
    let refresh = params.refresh();
    let mut run = Run {
        flight: Flight::new(params, BootReport::default())
            .map_err(|error| BadInput::new(format!("the log's parameters: {error}")))?,
        code: None,
        now: Micros(0),
        newest: None,
        refresh,
        knows_refresh: false,
        ordered: false,
        expected: None,
        exact: false,
        changed: !changed.is_empty(),
        refused: Vec::new(),
    };
    let mut pairs = Vec::new();
    for event in &flight.events {
        match event {
            Event::Step(step) => pairs.push(run.step(step)),
            Event::Gap(_) => (run.exact, run.knows_refresh) = (false, false),
            Event::Memory(words) if !run.exact => run.resume(words),
            Event::Memory(words) => run.flight.follow_frames(words),
            Event::State(code) => run.follow(*code),
            Event::Parameter(name, value) if !changed.contains_key(name) => {
                run.set(name, *value);
            }
            // It begins with this answer, and ends with another in standby.
            Event::Answer(
                MavCmd::MAV_CMD_PREFLIGHT_CALIBRATION,
                MavResult::MAV_RESULT_ACCEPTED | MavResult::MAV_RESULT_IN_PROGRESS,
            ) if run.is_starting() => {
                run.exact = run.flight.calibrate().is_ok() && run.knows_refresh;
            }
            Event::Answer(
                MavCmd::MAV_CMD_DO_GRIPPER | MavCmd::MAV_CMD_COMPONENT_ARM_DISARM,
                MavResult::MAV_RESULT_ACCEPTED,
            ) => run.ordered = true,
            _ => {}
        }
    }
    Ok((pairs, run.refused))
}

/// A replay under way.
struct Run {
    flight: Flight,
    /// The last `custom_mode` of the log.
    code: Option<u32>,
    now: Micros,
    /// The newest sample, and what is new in the next.
    newest: Option<RawSample>,
    refresh: Refresh,
    /// The log tells the refresh. The sensor's goes on where the vehicle begins anew.
    knows_refresh: bool,
    /// An order was obeyed since the last change of state.
    ordered: bool,
    /// What the vehicle has done by itself in the step that comes: launch, or end of its burn.
    expected: Option<Command>,
    exact: bool,
    /// Some parameters are others than the vehicle's.
    changed: bool,
    refused: Vec<String>,
}

impl Run {
    fn step(&mut self, logged: &Step) -> Pair {
        self.now = Micros(logged.now_us);
        if self.code.and_then(reason_of) != Some(ReasonKind::HostSilent) {
            self.flight.host_heard(self.now);
        }
        let reading = match logged.sample {
            Some(sample) => Ok(self.refresh.read(sample)),
            // The log has no faults: the vehicle's state tells whether the sensor was lost.
            None if self.lost_sensor() => Err(SensorFault::Reset),
            None => Err(SensorFault::Nak),
        };
        self.newest = logged.sample.or(self.newest);
        let snapshot = self.flight.step(self.now, reading);
        if let Some(command) = self.expected.take() {
            let mine = self.flight.state().kind();
            if (mine == StateKind::Active) != (command == Command::Release) {
                self.command(command);
            }
        }
        let q = snapshot.orientation.parts();
        let mut cranks_rad = logged.cranks_rad;
        for (crank, again) in cranks_rad.iter_mut().zip(snapshot.cranks) {
            *crank = crank.map(|_| again.into());
        }
        Pair {
            logged: *logged,
            again: Step {
                quaternion: [q.w, q.x, q.y, q.z],
                rate_rad_s: snapshot.rates.map(f32::from),
                cranks_rad,
                pulses_us: snapshot.pulses.map(|pulse| pulse.0),
                ..*logged
            },
            exact: self.exact,
        }
    }

    /// Goes on from all that the flight remembers after the newest sample.
    fn resume(&mut self, words: &[i32]) {
        if let Some(sample) = self.newest {
            let (words, refresh) = words.split_at(words.len().saturating_sub(Refresh::WORDS));
            let refresh: Vec<_> = refresh.iter().map(|word| word.cast_unsigned()).collect();
            if let Some(resumed) = Refresh::resumed(sample, &refresh) {
                (self.refresh, self.knows_refresh) = (resumed, true);
            }
            self.exact = self.flight.resume(&sample, words) || self.changed;
        }
    }

    /// No sample has led out of boot yet, as far as the log tells.
    fn is_starting(&self) -> bool {
        matches!(self.code.and_then(state_of), None | Some(StateKind::Boot))
    }

    fn lost_sensor(&self) -> bool {
        let Some(code) = self.code else {
            return self.newest.is_some();
        };
        match state_of(code) {
            Some(StateKind::Boot) => self.newest.is_some(),
            _ => reason_of(code) == Some(ReasonKind::Sensor),
        }
    }

    /// Gives the command that a change of state implies.
    fn follow(&mut self, code: u32) {
        let first = self.code.replace(code).is_none();
        let state = state_of(code);
        // From power-on the whole past is in the log.
        if first && state == Some(StateKind::Boot) && self.newest.is_none() {
            (self.exact, self.knows_refresh) = (true, true);
        }
        let mine = self.flight.state().kind();
        match state {
            Some(StateKind::Armed) if mine != StateKind::Armed => self.command(Command::Arm),
            Some(StateKind::Active) if mine != StateKind::Active => {
                self.follow_by(Command::Release)
            }
            Some(StateKind::Standby) if is_in_operation(mine) || mine == StateKind::Latched => {
                self.follow_by(Command::Disarm);
            }
            _ => {}
        }
        self.ordered = false;
    }

    /// Gives a command, unless nobody ordered it: a vehicle that sees its launch and the end of its
    /// burn tells the state in front of the step in which it does.
    fn follow_by(&mut self, command: Command) {
        let params = self.flight.params();
        let sees = match command {
            Command::Release => params.launch_acc() > 0.0,
            _ => params.burnout_acc() > 0.0 || params.burn_s() > 0.0,
        };
        if sees && !self.ordered {
            self.expected = Some(command);
        } else {
            self.command(command);
        }
    }

    fn command(&mut self, command: Command) {
        let answer = self.flight.command(self.now, command);
        // Where its past is unknown, a refusal says nothing.
        if let (Err(refusal), true) = (answer, self.exact) {
            self.refused.push(format!(
                "{:.3} s: the vehicle obeyed {command}, its library here refuses: {refusal}",
                self.now.0 as f64 * 1e-6
            ));
        }
    }

    fn set(&mut self, name: &str, value: f32) {
        let known = self.flight.params().value(name);
        if known.is_some_and(|known| known != value)
            && let Err(error) = self.flight.set_param(name, value)
        {
            self.refused
                .push(format!("{:.3} s: {name} = {value}: {error}", self.now.0 as f64 * 1e-6));
        }
    }
}

fn compare(pairs: &[Pair]) -> Comparison {
    let mut found = Comparison { steps: pairs.len(), ..Comparison::default() };
    let stretches = pairs.chunk_by(|a, b| a.exact == b.exact);
    let ends = stretches.filter_map(|stretch| Some((stretch.first()?, stretch.last()?)));
    let compared = ends.filter(|(first, _)| first.exact);
    found.compared_s =
        compared.map(|(first, last)| [first.logged.time_s(), last.logged.time_s()]).collect();
    // Before the first step whose past is known there is nothing to compare.
    let known = pairs.iter().position(|pair| pair.exact).unwrap_or(0);
    for Pair { logged, again, exact } in &pairs[known..] {
        let pitch = (logged.pitch_rad() - again.pitch_rad()).abs();
        found.pitch_difference_rad_max = found.pitch_difference_rad_max.max(pitch);
        for (logged, again) in logged.pulses_us.iter().zip(again.pulses_us) {
            let most = &mut found.pulse_difference_us_max;
            *most = (*most).max(logged.abs_diff(again));
        }
        if *exact {
            found.compared += 1;
            if same(logged, again) {
                found.equal += 1;
            } else if found.first_difference_s.is_none() {
                found.first_difference_s = Some(logged.time_s());
            }
        }
    }
    found
}

fn same(a: &Step, b: &Step) -> bool {
    let bits = |cranks: [Option<f32>; 2]| cranks.map(|crank| crank.map(f32::to_bits));
    a.quaternion.map(f32::to_bits) == b.quaternion.map(f32::to_bits)
        && a.rate_rad_s.map(f32::to_bits) == b.rate_rad_s.map(f32::to_bits)
        && bits(a.cranks_rad) == bits(b.cranks_rad)
        && a.pulses_us == b.pulses_us
}

#[cfg(test)]
mod tests;
