//! The HTML page of `tvc replay`: both runs in the same plots.

use std::path::Path;

use anyhow::Result;
use maud::html;

use super::{Comparison, Pair};
use flights::log::Step;
use report::page::{figure, page};
use report::plot::{Line, Plot};

/// The whole page.
pub fn render(
    log: &Path,
    found: &Comparison,
    pairs: &[Pair],
    other: Option<&[(f64, f64)]>,
) -> Result<String> {
    let begin = pairs.first().map_or(0.0, |pair| pair.logged.time_s());
    let line = |of: fn(&Pair) -> &Step, value: fn(&Step) -> f64| -> Vec<(f64, f64)> {
        pairs.iter().map(|pair| (pair.logged.time_s() - begin, value(of(pair)))).collect()
    };
    let both = |value: fn(&Step) -> f64| {
        vec![
            Line::new("logged", 0, line(|pair| &pair.logged, value)),
            Line::new("replayed", 1, line(|pair| &pair.again, value)),
        ]
    };
    let mut pitch = both(|step| step.pitch_rad().to_degrees());
    if let Some(other) = other {
        let other = other.iter();
        let points = other.map(|(time, pitch)| (time - begin, pitch.to_degrees()));
        pitch.push(Line::new("other filter", 2, points.collect()));
    }
    let plot = |y, lines| Plot::new("time, s", y, lines);
    let pulse = both(|step| f64::from(step.pulses_us[0]));
    let body = html! {
        (found.figures().lines().markup())
        @for why in &found.refused { p { (why) } }
        h2 { "Pitch" }
        (figure("Pitch as the vehicle told it and as its library gives it here.", plot("pitch, deg", pitch).svg()?))
        h2 { "Pulse" }
        (figure("The pulse commanded. The motion is the log's: it does not answer to what is changed.", plot("pulse, us", pulse).svg()?))
    };
    Ok(page(&format!("Replay of {}", log.display()), body))
}
