//! Ctrl-C, so that a command that runs until then ends with its files whole.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use anyhow::{Context, Result};

static STOP: AtomicBool = AtomicBool::new(false);

/// A flag that Ctrl-C (and, on Unix, SIGTERM and SIGHUP) sets. Call once.
pub fn on_signal() -> Result<&'static AtomicBool> {
    ctrlc::set_handler(|| STOP.store(true, Ordering::Relaxed)).context("listening for Ctrl-C")?;
    Ok(&STOP)
}

/// Whether a command that has lasted so long shall end: it was told to, or its seconds are over.
pub fn asked(flag: &AtomicBool, lasted: Duration, longest_s: Option<f64>) -> bool {
    let is_over = |most_s| lasted >= Duration::from_secs_f64(most_s);
    flag.load(Ordering::Relaxed) || longest_s.is_some_and(is_over)
}
