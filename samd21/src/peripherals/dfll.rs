//! The DFLL48M's frequency.
//!
//! COARSE and FINE of DFLLVAL set it: with the factory's COARSE and FINE 0x1FF it is 48 MHz and an
//! error that is the chip's own; it drifts with temperature. In closed loop with USB clock recovery
//! each start-of-frame packet moves FINE by at most DFLLMUL.FSTEP towards 48 MHz. When the packets
//! end, FINE stays.
//!
//! A step of FINE is 0.023 %, an estimate: 512 of them lie between the 46.5 MHz of an open loop and
//! the 52 MHz of one that ran to its end (atsamd-rs issue 549). A step of COARSE is taken for 4 %.
//!
//! The period is a whole number of 2^-16 ticks, 15 ppm: the core counts its time in them.

use super::clock::{FRACTION, Rate};
use crate::board::Ticks;

/// FINE at which the error of a chip is given.
const FINE_MIDDLE: f64 = 511.0;
const FINE_LAST: f64 = 1023.0;
/// Relative change of the frequency by one step.
const FINE_STEP: f64 = 230e-6;
const COARSE_STEP: f64 = 0.04;
/// Deviation that counts as none.
const EXACT: f64 = 1e-6;

/// What sets the frequency.
#[derive(Clone, Debug, Default)]
pub(crate) struct Dfll {
    /// Relative error at the factory's COARSE and the middle of FINE, and its growth in 1/s.
    error: f64,
    drift_per_s: f64,
    /// The factory's COARSE.
    calibrated: u8,
    coarse: u8,
    /// Between its steps too, as the loop dithers it.
    fine: f64,
}

impl Dfll {
    pub(super) fn new(error_ppm: i32, drift_ppm_s: i32, calibrated: u8) -> Self {
        Self {
            error: f64::from(error_ppm) * 1e-6,
            drift_per_s: f64::from(drift_ppm_s) * 1e-6,
            calibrated,
            ..Self::default()
        }
    }

    /// As after a reset: the error is the silicon's.
    pub(super) fn after_reset(&self) -> Self {
        Self { coarse: 0, fine: 0.0, ..self.clone() }
    }

    /// Writes DFLLVAL.
    pub(super) fn load(&mut self, value: u32) {
        self.coarse = (value >> 10 & 0x3F) as u8;
        self.fine = f64::from(value & 0x3FF);
    }

    /// DFLLVAL's COARSE and FINE.
    pub(super) fn value(&self) -> u32 {
        u32::from(self.coarse) << 10 | self.fine.round() as u32
    }

    /// Adds to the error, ppm.
    pub(crate) fn shift(&mut self, ppm: f64) {
        self.error += ppm * 1e-6;
    }

    /// Whether the frequency changes by itself.
    pub(super) fn drifts(&self) -> bool {
        self.drift_per_s != 0.0
    }

    /// The frequency, relative to 48 MHz, beyond it.
    fn deviation(&self, now: Ticks) -> f64 {
        self.error
            + self.drift_per_s * now.as_secs_f64()
            + COARSE_STEP * (f64::from(self.coarse) - f64::from(self.calibrated))
            + FINE_STEP * (self.fine - FINE_MIDDLE)
    }

    /// Moves FINE by at most `step` towards 48 MHz; whether it has got there.
    pub(super) fn regulate(&mut self, now: Ticks, step: u32) -> bool {
        let step = f64::from(step);
        let wanted = -self.deviation(now) / FINE_STEP;
        self.fine = (self.fine + wanted.clamp(-step, step)).clamp(0.0, FINE_LAST);
        self.deviation(now).abs() < EXACT
    }

    /// Whether FINE is at an end of its range.
    pub(super) fn is_at_limit(&self) -> bool {
        self.fine <= 0.0 || self.fine >= FINE_LAST
    }

    /// Finds COARSE and FINE of 48 MHz, as the closed loop does before it locks.
    pub(super) fn lock(&mut self, now: Ticks) {
        self.fine = FINE_MIDDLE;
        let steps = (-self.deviation(now) / COARSE_STEP).round();
        self.coarse = (f64::from(self.coarse) + steps).clamp(0.0, 63.0) as u8;
        self.regulate(now, u32::MAX);
    }

    /// The rate now. A DFLL to which no firmware has given a COARSE runs very slowly.
    pub(super) fn rate(&self, now: Ticks) -> Rate {
        let parts = f64::from(1_u32 << FRACTION);
        let frequency = (1.0 + self.deviation(now)).max(0.01);
        Rate::of_period((parts / frequency).round() as u64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FACTORY: u32 = 0x1F << 10 | 0x1FF;

    fn running(error_ppm: i32) -> Dfll {
        let mut dfll = Dfll::new(error_ppm, 0, 0x1F);
        dfll.load(FACTORY);
        dfll
    }

    #[test]
    fn a_chip_without_error_runs_at_48_mhz_exactly() {
        let dfll = running(0);
        assert_eq!(dfll.rate(Ticks::ZERO), Rate::from_hz(48_000_000));
        assert_eq!(dfll.value(), FACTORY);
    }

    #[test]
    fn the_loop_takes_an_error_away_and_its_value_serves_the_next_start() {
        let mut dfll = running(-31_000);
        assert!((dfll.rate(Ticks::ZERO).hz() - 46.512e6).abs() < 1e3);
        // 3.1 % are 134.8 steps, ten at a time.
        let packets = (1..).take_while(|_| !dfll.regulate(Ticks::ZERO, 10)).count();
        assert_eq!(packets, 13);
        assert_eq!(dfll.rate(Ticks::ZERO), Rate::from_hz(48_000_000));
        let mut next = running(-31_000);
        next.load(dfll.value());
        let error = next.rate(Ticks::ZERO).hz() / 48e6 - 1.0;
        assert!(error.abs() < FINE_STEP / 2.0 + 15e-6, "{error}");
    }

    #[test]
    fn a_reset_takes_the_value_but_not_the_error_of_the_silicon() {
        let mut dfll = running(0);
        dfll.shift(-31_000.0);
        let mut again = dfll.after_reset();
        assert_eq!(again.value(), 0);
        again.load(FACTORY);
        assert!((again.rate(Ticks::ZERO).hz() - 46.512e6).abs() < 1e3);
    }

    #[test]
    fn a_value_that_is_kept_drifts() {
        let mut dfll = Dfll::new(-31_000, 20, 0x1F);
        dfll.load(FACTORY);
        while !dfll.regulate(Ticks::from_ms(50), 10) {}
        let later = Ticks::from_ms(100_050);
        let error = dfll.rate(later).hz() / 48e6 - 1.0;
        assert!((error - 0.002).abs() < 16e-6, "{error}");
    }

    #[test]
    fn a_closed_loop_finds_coarse_itself() {
        let mut dfll = Dfll::new(-31_000, 0, 0x1F);
        assert!(dfll.rate(Ticks::ZERO).hz() < 1e6);
        dfll.lock(Ticks::ZERO);
        assert_eq!(dfll.rate(Ticks::ZERO), Rate::from_hz(48_000_000));
    }

    #[test]
    fn an_error_beyond_fine_stays() {
        let mut dfll = running(-200_000);
        assert!((0..1000).all(|_| !dfll.regulate(Ticks::ZERO, 10)));
        assert_eq!(dfll.value() & 0x3FF, 0x3FF);
    }
}
