//! The HTML page of a profile: the chart, and the tables.

use maud::{Markup, html};

use super::tree::Node;
use report::measure::Figures;
use report::page::page;

/// Width of the chart and height of a row, SVG units.
const WIDTH: f64 = 860.0;
const ROW: f64 = 22.0;
/// Narrower boxes are left out.
const NARROWEST: f64 = 0.5;
/// Width of a letter of the labels.
const LETTER: f64 = 6.2;
/// Fills by depth, light enough for black letters.
const FILLS: [&str; 5] = ["#d9d9d9", "#a9c9ec", "#f6c79b", "#a9d8bf", "#d9b8dc"];

/// The whole page; `unit` is what `parts` of the window are.
pub fn render(title: &str, figures: &Figures, root: &Node, parts: f64, unit: &str) -> String {
    let mut boxes = Vec::new();
    lay_out(&mut boxes, root, "all cycles awake", (0.0, 0), WIDTH / root.cycles.max(1) as f64);
    let depth = boxes.iter().map(|b| b.depth).max().unwrap_or(0);
    let height = ROW * f64::from(depth + 1);
    let body = html! {
        figure {
            svg xmlns="http://www.w3.org/2000/svg" viewBox={ "0 0 " (WIDTH) " " (height) }
                width="100%" font-family="sans-serif" font-size="12" {
                @for one in &boxes { (drawn(one, root.cycles, parts, unit)) }
            }
            figcaption {
                "Each box is as wide as its cycles. Below all cycles are thread and interrupts, below \
                 these the functions of the image, and below each what was inlined into it. What a \
                 function takes for itself has nothing below. A box under the pointer tells its name."
            }
        }
        (figures.lines().markup())
        (figures.table("contexts").markup())
        h2 { "Functions" }
        (figures.table("functions").markup())
        h2 { "Inlined functions" }
        (figures.table("inlined").markup())
        footer {
            "The firmware image on an emulated SAMD21 at exact instruction timing. Nothing here was "
            "measured on a board."
        }
    };
    page(title, body)
}

struct Placed<'a> {
    name: &'a str,
    cycles: u64,
    x: f64,
    width: f64,
    depth: u32,
}

fn lay_out<'a>(
    boxes: &mut Vec<Placed<'a>>,
    node: &'a Node,
    name: &'a str,
    (mut x, depth): (f64, u32),
    scale: f64,
) {
    let width = node.cycles as f64 * scale;
    if width < NARROWEST {
        return;
    }
    let cycles = node.cycles;
    boxes.push(Placed { name, cycles, x, width, depth });
    for (name, node) in node.sorted() {
        lay_out(boxes, node, name, (x, depth + 1), scale);
        x += node.cycles as f64 * scale;
    }
}

fn drawn(one: &Placed<'_>, all: u64, parts: f64, unit: &str) -> Markup {
    let y = ROW * f64::from(one.depth);
    let letters = ((one.width - 6.0) / LETTER) as usize;
    let label = short(one.name, letters);
    let share = 100.0 * one.cycles as f64 / all.max(1) as f64;
    let each = one.cycles as f64 / parts;
    let at = |value: f64| format!("{value:.2}");
    html! {
        g {
            title { (format!("{}: {each:.1} cycles a {unit}, {share:.2} %", one.name)) }
            rect x=(at(one.x)) y=(at(y)) width=(at(one.width)) height=(ROW - 1.0)
                fill=(FILLS[one.depth as usize % FILLS.len()]) stroke="white" stroke-width="0.5" {}
            @if !label.is_empty() {
                text x=(at(one.x + 3.0)) y=(at(y + 15.0)) { (label) }
            }
        }
    }
}

/// A name in at most `letters` letters: without the path of its modules, then cut; empty where it
/// would say nothing.
fn short(name: &str, letters: usize) -> String {
    let plain = if name.len() <= letters || name.starts_with('<') {
        name
    } else {
        name.rsplit("::").next().unwrap_or(name)
    };
    match plain.chars().count() {
        count if count <= letters => plain.to_owned(),
        _ if letters < 4 => String::new(),
        _ => plain.chars().take(letters - 1).chain(['…']).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_fit_their_boxes() {
        assert_eq!(short("tvc::flight::step", 40), "tvc::flight::step");
        assert_eq!(short("tvc::flight::step", 6), "step");
        assert_eq!(short("tvc::flight::measure", 5), "meas…");
        assert_eq!(short("tvc::flight::measure", 2), "");
    }
}
