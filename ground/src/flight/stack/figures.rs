//! What `tvc stack` prints.

use super::Analysis;
use super::levels::{FRAME_BYTES, Level, exception_name};
use super::seen::Seen;
use super::value::Origin;
use super::walk::Target;
use crate::flight::requirements;
use crate::out::measure::Limit::AtMost;
use crate::out::measure::{Figure, Figures, figure, rows};

/// What main is called among the levels.
const MAIN: &str = "main";

/// All figures of an image with `room` bytes for its stack, at most `top` rows of the largest
/// functions.
pub fn figures(analysis: &Analysis, seen: &Seen, room: u32, top: usize) -> Figures {
    let worst = analysis.worst();
    let share = worst.map(|worst| 100.0 * f64::from(worst) / f64::from(room));
    let bytes = |key, label, bytes: u32| figure(key, bytes).shown(label, "bytes", 0);
    Figures::from([
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
    ])
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
        let handler = format!(
            "{} ({})",
            name(&level.deepest.path),
            exception_name(level.exception)
        );
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
fn largest(analysis: &Analysis, top: usize) -> Vec<[Figure; 3]> {
    let mut functions: Vec<_> = analysis.calls.frames().iter().collect();
    functions.sort_by_key(|(_, frame)| std::cmp::Reverse(frame.own));
    let functions = functions.into_iter().take(top);
    let row = |(function, own): (u32, u32)| {
        let deepest =
            (analysis.problems.is_empty()).then(|| analysis.calls.deepest(function).bytes);
        [
            figure("function", analysis.program.name(function)).shown("largest functions", "", 0),
            figure("own_bytes", own).shown("its own", "bytes", 0),
            figure("bytes", deepest)
                .shown("with its calls", "bytes", 0)
                .or("no bound"),
        ]
    };
    functions
        .map(|(function, frame)| row((*function, frame.own)))
        .collect()
}

/// Every call by a pointer, with what it may reach.
fn indirect(analysis: &Analysis) -> Vec<[Figure; 6]> {
    let program = &analysis.program;
    let frames = analysis.calls.frames().iter();
    let calls = frames.flat_map(|(function, frame)| {
        let calls = frame.calls.iter();
        calls.filter_map(move |(at, call)| match call.target {
            Target::Function(_) => None,
            Target::Pointer(origin) => Some((*function, *at, origin, call.target)),
        })
    });
    let row = |(function, at, origin, target)| {
        let targets = analysis.calls.targets(target);
        let names: Vec<_> = targets.iter().map(|target| program.name(*target)).collect();
        let deepest = targets.iter().max_by_key(|target| {
            let bounded = analysis.problems.is_empty();
            bounded.then(|| analysis.calls.deepest(**target).bytes)
        });
        let from = match origin {
            Origin::Offset(offset) => format!("offset {offset}"),
            Origin::Indexed => "an array".into(),
            Origin::Unknown => "not known".into(),
        };
        [
            figure("function", program.name(function)).shown("calls by a pointer", "", 0),
            figure("at", format!("0x{at:x}")).shown("at", "", 0),
            figure("from", from).shown("loaded from", "", 0),
            figure("candidates", names.len()).shown("may reach", "", 0),
            figure("deepest", deepest.map(|target| program.name(*target))).shown(
                "the deepest of them",
                "",
                0,
            ),
            rows("targets", names).unseen(),
        ]
    };
    calls.map(row).collect()
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
    let frames = analysis.calls.frames();
    let reached = |name: &String| {
        let mut names = frames
            .keys()
            .map(|function| analysis.program.name(*function));
        names.any(|other| other == *name)
    };
    let bounds = analysis
        .bounds
        .iter()
        .filter(|bound| reached(&bound.function));
    let row = |bound: &super::Bounded| {
        [
            figure("function", bound.function.as_str()).shown("recursion", "", 0),
            figure("times", u64::from(bound.times)).shown("at most", "times", 0),
            figure("why", bound.why.as_str()).shown("why", "", 0),
        ]
    };
    bounds.map(row).collect()
}

fn problems(analysis: &Analysis) -> Vec<[Figure; 2]> {
    let row = |problem: &super::Problem| {
        [
            figure("at", analysis.program.name(problem.at)).shown("no bound", "", 0),
            figure("what", problem.what.as_str()).shown("because it", "", 0),
        ]
    };
    analysis.problems.iter().map(row).collect()
}
