//! Progress of a flight: one line that is redrawn on a terminal, plain lines elsewhere.

use std::time::Duration;

use indicatif::ProgressBar;
use rig::flight::{Progress, Stage};

use report::gauge::gauge;
use report::progress::spinner;

/// A live line on standard error.
pub struct Live {
    bar: ProgressBar,
}

impl Live {
    /// Begins a line for `what`; where standard error is no terminal, `what` is printed once.
    pub fn begin(what: String) -> Self {
        let bar = spinner("{spinner} {prefix}  {msg}");
        if bar.is_hidden() {
            eprintln!("{what}");
        } else {
            bar.set_prefix(what);
            bar.enable_steady_tick(Duration::from_millis(120));
        }
        Self { bar }
    }

    /// Shows where a flight stands.
    pub fn flight(&self, progress: &Progress) {
        let pitch = progress.tilt_rad[0].to_degrees();
        let rudder = progress.rudders_rad[0].to_degrees();
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
