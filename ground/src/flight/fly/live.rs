//! What is to be seen while it flies: a line on a terminal that moves, plain lines elsewhere.

use std::io::IsTerminal;
use std::time::Duration;

use indicatif::{ProgressBar, ProgressStyle};
use rig::flight::{Progress, Stage};

/// Half the width of the pitch gauge, characters.
const HALF_GAUGE: i32 = 15;
/// Pitch at the end of the gauge, deg.
const GAUGE_DEG: f64 = 60.0;

/// A live line on standard error.
pub struct Live {
    bar: ProgressBar,
}

impl Live {
    /// Begins a line for `what`; where standard error is no terminal it is said once.
    pub fn begin(what: String) -> Self {
        if !std::io::stderr().is_terminal() {
            eprintln!("{what}");
            return Self {
                bar: ProgressBar::hidden(),
            };
        }
        let bar = ProgressBar::new_spinner().with_prefix(what);
        if let Ok(style) = ProgressStyle::with_template("{spinner} {prefix}  {msg}") {
            bar.set_style(style);
        }
        bar.enable_steady_tick(Duration::from_millis(120));
        Self { bar }
    }

    /// Shows where a flight stands.
    pub fn flight(&self, progress: &Progress) {
        let pitch = progress.pitch_rad.to_degrees();
        let rudder = progress.rudder_rad.to_degrees();
        let stage = match progress.stage {
            Stage::Boot => "boot  ",
            Stage::Tilt => "tilt  ",
            Stage::Flight => "flight",
        };
        self.bar.set_message(format!(
            "{stage} {:5.2} s  pitch {pitch:+6.1} deg {}  rudder {rudder:+6.1} deg",
            progress.time_s,
            gauge(pitch)
        ));
    }

    /// Shows how far a recording has been played.
    pub fn played(&self, seconds: f64, of: f64) {
        self.bar.set_message(format!("{seconds:5.1} of {of:.1} s"));
    }

    /// Ends the line.
    pub fn end(self) {
        self.bar.finish_and_clear();
    }
}

/// An angle as a mark on a scale with zero in the middle.
pub fn gauge(angle_deg: f64) -> String {
    let at = (angle_deg / GAUGE_DEG * f64::from(HALF_GAUGE)).round() as i32;
    let at = at.clamp(-HALF_GAUGE, HALF_GAUGE);
    (-HALF_GAUGE..=HALF_GAUGE)
        .map(|i| match i {
            i if i == at => '#',
            0 => '|',
            _ => '.',
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_gauge_has_its_mark_where_pitch_is_and_stays_its_width() {
        assert_eq!(gauge(0.0).find('#'), Some(15));
        assert_eq!(gauge(60.0).find('#'), Some(30));
        assert_eq!(gauge(-500.0).find('#'), Some(0));
        assert!(gauge(30.0).contains('|'));
        assert_eq!(gauge(f64::NAN).len(), 31);
    }
}
