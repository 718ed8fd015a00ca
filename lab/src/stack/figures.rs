//! What `lab stack` prints.

use super::Analysis;
use super::depth::Bounded;
use super::seen::Seen;
use super::value::Origin;
use super::walk::Target;
use crate::functions::exception_name;
use flights::requirements;
use report::measure::Limit::AtMost;
use report::measure::{Figure, Figures, figure, note, rows};

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
        .chain(bounds_in_words(analysis).map(note)),
    )
}

fn level_rows(analysis: &Analysis) -> impl Iterator<Item = [Figure; 4]> {
    analysis.levels.iter().map(|level| {
        let first = level.deepest.path.first();
        let mut handler =
            first.map_or_else(String::new, |step| analysis.program.name(step.function));
        if let Some(exception) = level.exception {
            handler += &format!(" ({})", exception_name(exception));
        }
        [
            figure("level", level.name.as_str()).shown("level", "", 0),
            figure("handler", handler).shown("deepest handler", "", 0),
            figure("frame_bytes", level.stacked).shown("stacked", "bytes", 0),
            figure("bytes", level.deepest.bytes).shown("its own", "bytes", 0),
        ]
    })
}

fn path_rows(analysis: &Analysis) -> impl Iterator<Item = [Figure; 3]> {
    analysis.levels.iter().flat_map(|level| {
        level.deepest.path.iter().map(|step| {
            let name = analysis.program.name(step.function);
            [
                figure("function", name).shown("deepest way", "", 0),
                figure("level", level.name.as_str()).shown("level", "", 0),
                figure("bytes", step.bytes).shown("bytes", "", 0),
            ]
        })
    })
}

/// The functions with the largest stack of their own.
fn largest(analysis: &Analysis, top: usize) -> Vec<[Figure; 4]> {
    let mut functions: Vec<_> = analysis.calls.frames.iter().collect();
    functions.sort_by_key(|(_, frame)| std::cmp::Reverse(frame.own));
    let rows = functions.into_iter().take(top).map(|(&function, frame)| {
        let deepest =
            (analysis.problems.is_empty()).then(|| analysis.calls.deepest(function).bytes);
        [
            figure("function", analysis.program.name(function)).shown("largest functions", "", 0),
            figure("at", format!("0x{function:x}")),
            figure("own_bytes", frame.own).shown("its own", "bytes", 0),
            figure("bytes", deepest).shown("with its calls", "bytes", 0).or("no bound"),
        ]
    });
    rows.collect()
}

/// Every call by a pointer, with what it may reach.
fn indirect(analysis: &Analysis) -> Vec<[Figure; 5]> {
    let program = &analysis.program;
    let mut found = Vec::new();
    for (function, frame) in &analysis.calls.frames {
        for (at, call) in &frame.calls {
            let origins = call.targets.iter().filter_map(Target::origin);
            let origins = origins.map(|origin| match origin {
                Origin::Offset(offset) => format!("offset {offset}"),
                Origin::Indexed => "an array".into(),
                Origin::Unknown => "not known".into(),
            });
            let origins: Vec<String> = origins.collect();
            if origins.is_empty() {
                continue;
            }
            let reached = analysis.calls.reached_by(call);
            let names = reached.iter().map(|target| program.name(*target));
            found.push([
                figure("function", program.name(*function)).shown("calls by a pointer", "", 0),
                figure("at", format!("0x{at:x}")).shown("at", "", 0),
                figure("from", origins.join(", ")).shown("loaded from", "", 0),
                figure("candidates", reached.len()).shown("may reach", "functions", 0),
                rows("targets", names).unseen(),
            ]);
        }
    }
    found
}

fn handlers(analysis: &Analysis, seen: &Seen) -> impl Iterator<Item = [Figure; 3]> {
    let exceptions = analysis.handlers.range(2..seen.priorities.len());
    exceptions.map(|(exception, handler)| {
        [
            figure("exception", exception_name(*exception)),
            figure("handler", analysis.program.name(*handler)),
            figure("priority", f64::from(seen.priorities[*exception])),
        ]
    })
}

/// The bounds of recursion that were needed.
fn bounds(analysis: &Analysis) -> impl Iterator<Item = [Figure; 3]> {
    analysis.bounds.iter().map(|bound| {
        [
            figure("function", bound.function.as_str()),
            figure("times", u64::from(bound.times)),
            figure("why", bound.why.as_str()),
        ]
    })
}

/// What each bound of recursion says, in a sentence.
pub fn bounds_in_words(analysis: &Analysis) -> impl Iterator<Item = String> {
    analysis.bounds.iter().map(|Bounded { function, times, why }| {
        let times = match times {
            1 => "once".into(),
            _ => format!("{times} times"),
        };
        format!("{function} is taken to be on the stack {times} at most: {why}.")
    })
}

fn problems(analysis: &Analysis) -> impl Iterator<Item = [Figure; 2]> {
    analysis.problems.iter().map(|problem| {
        [
            figure("at", analysis.program.name(problem.at)).shown("no bound", "", 0),
            figure("what", problem.what.as_str()).shown("why", "", 0),
        ]
    })
}
