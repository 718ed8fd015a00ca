//! `lab profile`: where the cycles of an image go, by function.

mod report;
pub mod symbols;
mod tree;

use std::path::PathBuf;

use anyhow::{Context, Result, bail, ensure};
use clap::Args;
use rig::profile::{Window, advance, run as run_window};
use rig::{Image, Rig, ServoKind, Setup, prepare};

use ::report::arguments::seconds;
use ::report::exit::{BadInput, Verdict};
use ::report::kind;
use ::report::measure::{Figures, figure, rows};
use ground::flight::fly::flights::START_RATE_RAD_S;
use ground::flight::fly::live::Live;
use ground::flight::fly::options::start_angle;
use ground::image::ImageOption;
use symbols::Symbols;
use tree::Node;

/// Options of `lab profile`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  cargo lab profile                                   a second of flight from 0.4 rad
  cargo lab profile --report report/profile.html      with a chart of all functions
  cargo lab profile --start 0.8 --wait-states 0       another flight, without flash wait states
  cargo lab profile --json > profile.json             figures for a script
  cargo lab profile --image other.elf --after 2 --seconds 1
                                                      any SAMD21 firmware, from 2 s after power-on

Cycles are exact and each is counted once: for the function of the image whose instruction took it.
Entering and leaving an interrupt counts for its handler. What was inlined is told by the debug
information of the image; without it, functions alone are named. Sleep is not among the cycles.

Exit status: 0 measured, 1 something failed, 2 unusable input.")]
pub struct Profile {
    /// The servo on the rig.
    #[arg(long, value_enum, default_value_t = ServoKind::S3003)]
    pub servo: ServoKind,

    /// Seed of all that is random: sensor noise and bias, clock phases.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,

    /// Tilt that is flown from, rad.
    #[arg(long, value_name = "RAD", default_value_t = 0.4, allow_negative_numbers = true, value_parser = start_angle)]
    pub start: f64,

    /// Flash wait states, whatever the image sets [default: as it sets them].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(0..=1))]
    pub wait_states: Option<u8>,

    /// No flight: any image, from this time since power-on, s.
    #[arg(long, value_name = "S", conflicts_with = "start", value_parser = seconds)]
    pub after: Option<f64>,

    /// Length of the window, s.
    #[arg(long, value_name = "S", default_value_t = 1.0, value_parser = seconds)]
    pub seconds: f64,

    /// Which image.
    #[command(flatten)]
    pub image: ImageOption,

    /// Rows of the tables on the terminal.
    #[arg(long, value_name = "N", default_value_t = 30)]
    pub top: usize,

    /// Where to write an HTML report with a chart of all functions.
    #[arg(long, value_name = "FILE.html", value_parser = kind::page)]
    pub report: Option<PathBuf>,

    /// Print one JSON object on standard output and nothing else there.
    #[arg(long)]
    pub json: bool,
}

/// Measures and prints the profile.
///
/// # Errors
/// An image that cannot be read or does not run, or does not fly where it should.
pub fn run(options: &Profile) -> Result<Verdict> {
    let firmware = options.image.firmware()?;
    let mut symbols = Symbols::read(&firmware.elf)?;
    if !symbols.has_inlined {
        eprintln!(
            "note: the image has no debug information: what was inlined counts for the function \
             that it is in"
        );
    }
    let window = measure(options, &firmware.image)?;
    ensure!(
        window.profile.total() == window.cycles,
        "{} cycles were counted by function, {} by the chip",
        window.profile.total(),
        window.cycles
    );
    if window.cycles == 0 {
        bail!(BadInput::new("the image slept all the time; try --after or a longer --seconds"));
    }
    let root = Node::new(&window.profile, &mut symbols);
    let (parts, unit) = match options.after {
        None => (window.steps as f64, "tick"),
        Some(_) => (window.seconds, "second"),
    };
    let figures = |top| figures(options, &window, &root, parts, unit, top);
    let title = format!("Profile: {} cycles awake in {:.2} s", window.cycles, window.seconds);
    let all = figures(usize::MAX);
    let page = options.report.as_deref();
    let page = page.map(|path| (path, report::render(&title, &all, &root, parts, unit)));
    let shown = if options.json { all } else { figures(options.top) };
    shown.conclude(options.json, page)
}

fn measure(options: &Profile, image: &Image) -> Result<Window> {
    let mut setup = Setup::with_polarity(options.servo, options.seed);
    setup.rig.hardware.chip.wait_states = options.wait_states;
    if let Some(after) = options.after {
        let mut rig = Rig::new(image, &setup.rig)?;
        let end = after + options.seconds;
        let live = Live::begin(format!("running the image for {end} s"));
        advance(&mut rig, after, &mut |now| live.played(now, end))?;
        let window = run_window(&mut rig, options.seconds, &mut |now| live.played(now, end))?;
        live.end();
        return Ok(window);
    }
    let live = Live::begin(format!("boot and flight from {} rad", options.start));
    let fly = || -> Result<Window> {
        let ready = prepare(image, &setup, &mut |progress| live.flight(progress))?;
        let rate = START_RATE_RAD_S.copysign(options.start);
        Ok(ready.profile(options.start, rate, options.seconds, &mut |progress| {
            live.flight(progress);
        })?)
    };
    let window =
        fly().context("the image does not fly; --after profiles one that is no autopilot")?;
    live.end();
    ensure!(window.steps > 0, "the image took no control step in the window");
    Ok(window)
}

/// What was measured, at most `top` rows in each table of functions.
fn figures(
    options: &Profile,
    window: &Window,
    root: &Node,
    parts: f64,
    unit: &'static str,
    top: usize,
) -> Figures {
    let key = if unit == "tick" { "cycles_per_tick" } else { "cycles_per_s" };
    let each = format!("cycles a {unit}");
    let cycles = |count: u64| figure(key, count as f64 / parts).shown(&*each, "", 1);
    let share = |count: u64| {
        figure("share_pct", 100.0 * count as f64 / window.cycles as f64).shown("share", "%", 2)
    };
    let contexts = root.sorted().into_iter().map(|(name, node)| {
        [figure("context", name).shown("where", "", 0), cycles(node.cycles), share(node.cycles)]
    });
    let functions = root.functions().into_iter().take(top).map(|(name, count)| {
        [figure("function", name).shown("function", "", 0), cycles(count), share(count)]
    });
    let inlined = root.inlined().into_iter().take(top).map(|((name, into), count)| {
        [
            figure("function", name).shown("inlined function", "", 0),
            figure("inlined_into", into).shown("in", "", 0),
            cycles(count),
            share(count),
        ]
    });
    Figures::from([
        figure("seed", options.seed),
        figure("window_s", window.seconds).shown("window", "s", 3),
        figure("ticks", window.steps).shown("control steps in it", "", 0),
        figure("cycles", window.cycles).shown("cycles awake", "", 0),
        cycles(window.cycles).shown(format!("cycles awake a {unit}"), "", 1),
        figure("asleep_pct", 100.0 * window.asleep_s / window.seconds).shown("asleep", "%", 1),
        rows("contexts", contexts),
        rows("functions", functions),
        rows("inlined", inlined),
    ])
}
