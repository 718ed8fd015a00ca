//! The DFLL, compared with what start-up has left in it. It is no row of the
//! [table](super::registers): start-of-frame tunes it all the time.

use tvc_nano::SelfCheck;

use super::clocks::{DFLL_CONTROL, calibrated_coarse, set_fine, sysctrl};
use super::registers;
use super::time::soon;

/// Start-of-frame moves FINE by ten steps a millisecond at most. What a flipped bit has added
/// beyond that stays: USB does not work with such a clock.
const FINE_JUMP: u16 = 200;

/// FINE at the newest look.
pub(crate) struct DfllCheck {
    fine: u16,
    /// Its complement: a bit of either may flip.
    complement: u16,
}

impl DfllCheck {
    /// What is set now.
    pub(crate) fn new() -> Self {
        let fine = fine();
        Self { fine, complement: !fine }
    }

    /// Puts FINE right where it has jumped.
    ///
    /// # Errors
    /// The DFLL ran at another frequency, which only a reset puts right.
    pub(crate) fn look(&mut self) -> Result<(), SelfCheck> {
        let dfll = sysctrl();
        let is_kept = self.fine == !self.complement;
        if coarse() != calibrated_coarse() || dfll.dfllctrl().read().bits() != DFLL_CONTROL {
            return Err(SelfCheck::Clock);
        }
        if is_kept && fine().abs_diff(self.fine) > FINE_JUMP {
            set_fine(self.fine);
        } else {
            *self = Self::new();
        }
        // For the next look.
        dfll.dfllsync().write(|w| w.readreq().set_bit());
        Ok(())
    }
}

/// Sets the DFLL to its frequency where a register has lost that: the pulses up to a reset are to
/// be right.
pub(crate) fn restore() {
    if !is_as_meant() {
        set_fine(fine());
    }
}

/// Whether processor and timer run at 48 MHz as far as registers tell: what a start with a damaged
/// image has set up may be wrong itself. The calibration is read by code of this firmware, since
/// the HAL's may be what is damaged.
pub(crate) fn is_as_meant() -> bool {
    let dfll = sysctrl();
    dfll.dfllsync().write(|w| w.readreq().set_bit());
    let is_read = soon(|| dfll.pclksr().read().dfllrdy().bit_is_set());
    is_read && coarse() == calibrated_coarse() && registers::is_processor_right()
}

/// Whether FINE is that of a start, which nothing has tuned.
pub(crate) fn is_untuned() -> bool {
    /// The HAL's: the middle of the range.
    const START: u16 = 511;
    fine() == START
}

/// The DFLL's coarse value as it was when it was asked for last.
fn coarse() -> u8 {
    sysctrl().dfllval().read().coarse().bits()
}

/// The same of its FINE.
fn fine() -> u16 {
    sysctrl().dfllval().read().fine().bits()
}
