//! The DFLL, held against what start-up has left in it. It is no row of the
//! [table](super::registers): start-of-frame tunes it all the time.

use tvc_nano::SelfCheck;

use super::clocks::{set_dfll as set, sysctrl};
use super::registers;
use super::time::soon;

/// The factory's calibration of the DFLL: the upper word of the two that hold it, and where COARSE
/// begins there (data sheet table 10-5, bits 58 to 63).
const CALIBRATION: *const u32 = 0x0080_6024 as *const u32;
const COARSE_AT: u32 = 26;
/// The HAL takes this COARSE if all bits of the calibration are set, which a chip without one has.
const COARSE_WITHOUT: u8 = 0x1F;

/// Start-of-frame moves FINE by ten steps a millisecond at most. What a flipped bit has added
/// beyond that stays: USB does not work with such a clock.
const FINE_JUMP: u16 = 200;

/// What start-up has left.
pub(crate) struct DfllCheck {
    control: u16,
    coarse: u8,
    /// FINE at the newest look.
    fine: u16,
}

impl DfllCheck {
    /// What is set now.
    pub(crate) fn new() -> Self {
        Self {
            control: sysctrl().dfllctrl().read().bits(),
            coarse: coarse(),
            fine: fine(),
        }
    }

    /// Puts FINE right where it has jumped.
    ///
    /// # Errors
    /// The DFLL runs at a frequency of its own, which only a reset puts right.
    pub(crate) fn look(&mut self) -> Result<(), SelfCheck> {
        let dfll = sysctrl();
        if coarse() != self.coarse || dfll.dfllctrl().read().bits() != self.control {
            // The pulses up to the reset are to be right.
            set(dfll, self.coarse, self.fine, self.control);
            return Err(SelfCheck::Clock);
        }
        if fine().abs_diff(self.fine) > FINE_JUMP {
            set(dfll, self.coarse, self.fine, self.control);
        } else {
            self.fine = fine();
        }
        // For the next look.
        dfll.dfllsync().write(|w| w.readreq().set_bit());
        Ok(())
    }
}

/// Whether processor and timer run at 48 MHz as far as registers tell: what a start with a damaged
/// image has set up may be wrong itself. The DFLL has its COARSE, and generator 0 takes it
/// undivided. The calibration is read by code of its own, since the HAL's may be what is damaged.
pub(crate) fn is_as_meant() -> bool {
    /// GENCTRL's SRC for the DFLL, with GENEN, and the bits of both and of DIVSEL.
    const FROM_DFLL: u32 = 7 << 8 | 1 << 16;
    const SOURCE_BITS: u32 = 0x1F << 8 | 1 << 16 | 1 << 20;
    let dfll = sysctrl();
    dfll.dfllsync().write(|w| w.readreq().set_bit());
    let is_read = soon(|| dfll.pclksr().read().dfllrdy().bit_is_set());
    // SAFETY: a row of calibration that is always mapped.
    let fused = match (unsafe { CALIBRATION.read_volatile() } >> COARSE_AT) as u8 {
        0x3F => COARSE_WITHOUT,
        fused => fused,
    };
    let [dividers, division, control] = registers::processor();
    is_read
        && coarse() == fused
        && dividers == 0
        && control & SOURCE_BITS == FROM_DFLL
        && division >> 8 <= 1
}

/// The DFLL's coarse value as it was when it was asked for last.
fn coarse() -> u8 {
    sysctrl().dfllval().read().coarse().bits()
}

/// The same of its FINE.
fn fine() -> u16 {
    sysctrl().dfllval().read().fine().bits()
}
