//! The HTML page of `lab stack`: a picture of the stack, and the tables.

use maud::{Markup, html};

use super::Analysis;
use super::figures::bounds_in_words;
use super::levels::Level;
use super::seen::Seen;
use flights::requirements;
use report::measure::Figures;
use report::page::{page, verdicts};

/// Width of the picture, height of the stack and of the whole, SVG units.
const WIDTH: f64 = 860.0;
const STACK: f64 = 40.0;
const HEIGHT: f64 = 84.0;
/// Fills of neighbours.
const FILLS: [&str; 4] = ["#a9c9ec", "#f6c79b", "#a9d8bf", "#d9b8dc"];

/// The whole page; the stack has `room` bytes.
pub fn render(
    title: &str,
    figures: &Figures,
    analysis: &Analysis,
    seen: &Seen,
    room: u32,
) -> String {
    let body = html! {
        (verdicts(&figures.missed()))
        figure {
            (picture(analysis, seen, room))
            figcaption {
                "The stack at its deepest, as wide as the RAM that the statics leave. Each box is a "
                "function on the deepest way, or what an exception stacks; a box under the pointer "
                "tells its name. The lines are the deepest that the rig has seen and the limit."
            }
        }
        (figures.lines().markup())
        @for (heading, key) in [
            ("Levels", "levels"), ("The deepest way", "path"), ("Largest functions", "largest"),
            ("Calls by a pointer", "indirect"), ("Why there is no bound", "problems"),
        ] {
            @let table = figures.table(key);
            @if !table.is_empty() { h2 { (heading) } (table.markup()) }
        }
        h2 { "Recursion" }
        @for words in bounds_in_words(analysis) { p { (words) } }
        footer {
            "From the machine code of the image; the priorities of interrupts and the deepest stack "
            "seen are those of an emulated SAMD21. Nothing here was measured on a board."
        }
    };
    page(title, body)
}

fn picture(analysis: &Analysis, seen: &Seen, room: u32) -> Markup {
    let scale = WIDTH / f64::from(room.max(1));
    let (mut boxes, mut x) = (Vec::new(), 0.0);
    let mut place = |name: String, bytes: u32| {
        boxes.push((name, bytes, x));
        x += scale * f64::from(bytes);
    };
    for Level { name: level, exception, stacked, deepest } in &analysis.levels {
        if exception.is_some() {
            place(format!("{level}: stacked by the exception"), *stacked);
        }
        for step in &deepest.path {
            place(format!("{level}: {}", analysis.program.name(step.function)), step.bytes);
        }
    }
    let limit = requirements::STACK_PCT.range().1;
    let marks = [
        (f64::from(seen.bytes), format!("seen: {} bytes", seen.bytes), 58.0),
        (f64::from(room) * limit / 100.0, format!("limit: {limit} %"), 76.0),
    ];
    let at = |value: f64| format!("{value:.2}");
    html! {
        svg xmlns="http://www.w3.org/2000/svg" viewBox={ "0 0 " (WIDTH) " " (HEIGHT) }
            width="100%" font-family="sans-serif" font-size="12" {
            rect width=(WIDTH) height=(STACK) fill="#f2f2f2" {}
            @for (index, (name, bytes, left)) in boxes.iter().enumerate() {
                rect x=(at(*left)) width=(at(scale * f64::from(*bytes))) height=(STACK)
                    fill=(FILLS[index % FILLS.len()]) {
                    title { (format!("{name}: {bytes} bytes")) }
                }
            }
            @for (bytes, label, y) in &marks {
                line x1=(at(bytes * scale)) x2=(at(bytes * scale)) y1="0" y2=(at(*y))
                    stroke="#333" stroke-dasharray="3 2" {}
                text x=(at(bytes * scale + 4.0)) y=(at(*y)) { (label) }
            }
        }
    }
}
