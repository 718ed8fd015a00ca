//! What `lab stack` prints.

use std::collections::BTreeSet;

use super::Analysis;
use super::depth::Bounded;
use super::levels::{FRAME_BYTES, Level, exception_name};
use super::seen::Seen;
use super::value::Origin;
use super::walk::{Call, Target};
use flights::requirements;
use report::measure::Limit::AtMost;
use report::measure::{Figure, Figures, figure, note, rows};

/// What main is called among the levels.
const MAIN: &str = "main";

/// All figures of an image with `room` bytes for its stack, at most `top` rows of the largest
/// functions.
pub fn figures(analysis: &Analysis, seen: &Seen, room: u32, top: usize) -> Figures {
    let worst = analysis.worst();
    let share = worst.map(|worst| 100.0 * f64::from(worst) / f64::from(room));
    let bytes = |key, label, bytes: u32| figure(key, bytes).shown(label, "bytes", 0);
    Figures::from(
        [
            figure("worst_bytes", worst)
                .shown("worst case of the stack", "bytes", 0)
                .or("no bound"),
            bytes("room_bytes", "RAM that the statics leave", room),
            figure("share_pct", share)
                .shown("worst case of this", "%", 1)
                .or("no bound")
                .limit(requirements::STACK_PCT),
            bytes("seen_bytes", "deepest that the rig has seen", seen.bytes)
                .limit(worst.map(|worst| AtMost(worst.into()))),
            bytes(
                "not_followed_bytes",
                "instructions that no path leads to",
                analysis.not_followed,
            ),
            rows("levels", level_rows(analysis)),
            rows("path", path_rows(analysis)),
            rows("largest", largest(analysis, top)),
            rows("indirect", indirect(analysis)),
            rows("handlers", handlers(analysis, seen)),
            rows("bounds", bounds(analysis)),
            rows("problems", problems(analysis)),
        ]
        .into_iter()
        .chain(bounds_in_words(analysis).into_iter().map(note)),
    )
}

/// What a level is called.
pub fn level_name(level: &Level) -> String {
    match level.exception {
        2 | 3 => exception_name(level.exception),
        _ => format!("priority {}", level.priority),
    }
}

fn level_rows(analysis: &Analysis) -> Vec<[Figure; 4]> {
    let row = |level: String, handler: String, stacked: u32, bytes: u32| {
        [
            figure("level", level).shown("level", "", 0),
            figure("handler", handler).shown("deepest handler", "", 0),
            figure("frame_bytes", stacked).shown("stacked", "bytes", 0),
            figure("bytes", bytes).shown("its own", "bytes", 0),
        ]
    };
    let name = |path: &[super::depth::Step]| {
        let first = path.first();
        first.map_or_else(String::new, |step| analysis.program.name(step.function))
    };
    let main = (analysis.problems.is_empty()).then(|| {
        let main = &analysis.main;
        row(MAIN.into(), name(&main.path), 0, main.bytes)
    });
    let levels = analysis.levels.iter().map(|level| {
        let handler =
            format!("{} ({})", name(&level.deepest.path), exception_name(level.exception));
        row(level_name(level), handler, FRAME_BYTES, level.deepest.bytes)
    });
    main.into_iter().chain(levels).collect()
}

fn path_rows(analysis: &Analysis) -> Vec<[Figure; 3]> {
    let main = std::iter::once((MAIN.to_owned(), &analysis.main));
    let levels = analysis.levels.iter();
    let levels = levels.map(|level| (level_name(level), &level.deepest));
    let steps = main.chain(levels).flat_map(|(level, deepest)| {
        deepest.path.iter().map(move |step| {
            [
                figure("function", analysis.program.name(step.function)).shown(
                    "deepest way",
                    "",
                    0,
                ),
                figure("level", level.as_str()).shown("level", "", 0),
                figure("bytes", step.bytes).shown("bytes", "", 0),
            ]
        })
    });
    steps.collect()
}

/// The functions with the largest stack of their own.
fn largest(analysis: &Analysis, top: usize) -> Vec<[Figure; 4]> {
    let mut functions: Vec<_> = analysis.calls.frames().iter().collect();
    functions.sort_by_key(|(_, frame)| std::cmp::Reverse(frame.own));
    let functions = functions.into_iter().take(top);
    let row = |(function, own): (u32, u32)| {
        let deepest =
            (analysis.problems.is_empty()).then(|| analysis.calls.deepest(function).bytes);
        [
            figure("function", analysis.program.name(function)).shown("largest functions", "", 0),
            figure("at", format!("0x{function:x}")),
            figure("own_bytes", own).shown("its own", "bytes", 0),
            figure("bytes", deepest).shown("with its calls", "bytes", 0).or("no bound"),
        ]
    };
    functions.map(|(function, frame)| row((*function, frame.own))).collect()
}

/// Every call by a pointer, with what it may reach.
fn indirect(analysis: &Analysis) -> Vec<[Figure; 5]> {
    let program = &analysis.program;
    let row = |function: u32, at: u32, call: &Call| {
        let origins = call.targets.iter().filter_map(|target| match target {
            Target::Function(_) => None,
            Target::Pointer(Origin::Offset(offset)) => Some(format!("offset {offset}")),
            Target::Pointer(Origin::Indexed) => Some("an array".into()),
            Target::Pointer(Origin::Unknown) => Some("not known".into()),
        });
        let origins: Vec<_> = origins.collect();
        let reached = analysis.calls.reached_by(call);
        let names = reached.iter().map(|target| program.name(*target));
        (!origins.is_empty()).then(|| {
            [
                figure("function", program.name(function)).shown("calls by a pointer", "", 0),
                figure("at", format!("0x{at:x}")).shown("at", "", 0),
                figure("from", origins.join(", ")).shown("loaded from", "", 0),
                figure("candidates", reached.len()).shown("may reach", "functions", 0),
                rows("targets", names).unseen(),
            ]
        })
    };
    let mut found = Vec::new();
    for (function, frame) in analysis.calls.frames() {
        let calls = frame.calls.iter();
        found.extend(calls.filter_map(|(at, call)| row(*function, *at, call)));
    }
    found
}

fn handlers(analysis: &Analysis, seen: &Seen) -> Vec<[Figure; 3]> {
    let exceptions = analysis.handlers.range(2..seen.priorities.len());
    let row = |(exception, handler): (&usize, &u32)| {
        [
            figure("exception", exception_name(*exception)),
            figure("handler", analysis.program.name(*handler)),
            figure("priority", f64::from(seen.priorities[*exception])),
        ]
    };
    exceptions.map(row).collect()
}

/// The bounds of recursion that were needed.
fn bounds(analysis: &Analysis) -> Vec<[Figure; 3]> {
    let row = |bound: &Bounded| {
        [
            figure("function", bound.function.as_str()),
            figure("times", u64::from(bound.times)),
            figure("why", bound.why.as_str()),
        ]
    };
    needed(analysis).map(row).collect()
}

fn needed(analysis: &Analysis) -> impl Iterator<Item = &Bounded> {
    let frames = analysis.calls.frames();
    let names: BTreeSet<_> = frames.keys().map(|at| analysis.program.name(*at)).collect();
    let bounds = analysis.bounds.iter();
    bounds.filter(move |bound| names.contains(&bound.function))
}

/// What each bound of recursion says, in a sentence.
pub fn bounds_in_words(analysis: &Analysis) -> Vec<String> {
    let words = |bound: &Bounded| {
        let Bounded { function, times, why } = bound;
        let times = match times {
            1 => "once".into(),
            _ => format!("{times} times"),
        };
        format!("{function} is taken to be on the stack {times} at most: {why}.")
    };
    needed(analysis).map(words).collect()
}

fn problems(analysis: &Analysis) -> Vec<[Figure; 2]> {
    let row = |problem: &super::Problem| {
        [
            figure("at", analysis.program.name(problem.at)).shown("no bound", "", 0),
            figure("what", problem.what.as_str()).shown("why", "", 0),
        ]
    };
    analysis.problems.iter().map(row).collect()
}
