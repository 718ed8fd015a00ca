//! SYSCTRL: oscillators and supply supervision.
//!
//! | offset | register | behaviour |
//! |---|---|---|
//! | 00, 04, 08 | INTENCLR, INTENSET, INTFLAG | enables stored; flags of ready oscillators are set |
//! | 0C | PCLKSR | OSC32KRDY after STARTUP; OSC8MRDY; DFLLRDY; locks; BOD33RDY |
//! | 14 | XOSC32K | kept; never ready: there is no crystal |
//! | 18 | OSC32K | 32,768 Hz, ready STARTUP cycles after it is enabled |
//! | 1C | OSCULP32K | nominally 32,768 Hz, always on |
//! | 20 | OSC8M | 8 MHz / 2^PRESC, on from reset |
//! | 24, 28, 2C | DFLLCTRL, DFLLVAL, DFLLMUL | about 48 MHz when enabled (`dfll`); locks as below |
//! | 30 | DFLLSYNC | READREQ brings what the DFLL uses into DFLLVAL; until then it reads as before |
//! | 34 | BOD33 | from the user row at reset; ready at once while enabled (`bod33`) |
//! | 3C, 40 | VREG, VREF | stored |
//!
//! The DFLL runs 6 us after it is enabled (open loop needs no reference). In closed loop LCKC and
//! LCKF follow 500 us after the reference (GCLK 0) is there, with 48 MHz; with USBCRM, after 8
//! start-of-frame packets at 48 MHz. The value stays when the packets end, and DFLLRCS is set;
//! DFLLOOB is set while FINE is at an end of its range. Touching DFLLVAL or DFLLMUL with ONDEMAND
//! set freezes the real chip (errata 9905): that faults.
//!
//! | left out | why |
//! |---|---|
//! | XOSC, DPLL | not modelled: an access faults |
//! | frequency errors of OSC8M and OSC32K | nothing that is timed runs from them |
//! | ONDEMAND, RUNSTDBY | clocks that nobody asks for cost nothing here |

use super::ResetCause;
use super::access::{Bus, DONE, Lanes, RESERVED, Read, Refusal, Write};
use super::bod33::{self, Bod33};
use super::clock::Rate;
use super::dfll::Dfll;
use super::interrupts::Interrupts;
use super::map::Block;
use super::nvmctrl::DFLL_COARSE;
use crate::Options;
use crate::board::Ticks;

const ENABLE: u32 = 1 << 1;
const DFLL_CLOSED_LOOP: u32 = 1 << 2;
const DFLL_USB_RECOVERY: u32 = 1 << 5;
const ONDEMAND: u32 = 1 << 7;
const READREQ: u32 = 1 << 7;

const OSC32KRDY: u32 = 1 << 2;
const OSC8MRDY: u32 = 1 << 3;
const DFLLRDY: u32 = 1 << 4;
const DFLLOOB: u32 = 1 << 5;
const DFLLLCKF: u32 = 1 << 6;
const DFLLLCKC: u32 = 1 << 7;
const DFLLRCS: u32 = 1 << 8;
const BOD33RDY: u32 = 1 << 9;
const BOD33DET: u32 = 1 << 10;
const B33SRDY: u32 = 1 << 11;

/// Start-up of the DFLL (electrical characteristics, typical).
const DFLL_STARTUP: Ticks = Ticks::from_us(6);
/// Closed-loop lock time (typical).
const DFLL_LOCK: Ticks = Ticks::from_us(500);
/// Start-of-frame packets until USB clock recovery has locked.
const RECOVERY_FRAMES: u8 = 8;
/// Without a start-of-frame packet for this time, the DFLL's reference has stopped: an assumption,
/// since the data sheet gives none.
const REFERENCE_LOST: Ticks = Ticks::from_ms(3);
/// How often a drifting frequency is worked out anew.
const DRIFT_STEP: Ticks = Ticks::from_ms(100);
/// OSC32K.STARTUP to cycles of the oscillator.
const OSC32K_STARTUP: [u64; 8] = [3, 4, 6, 10, 18, 34, 66, 130];

#[derive(Clone, Debug, Default)]
pub(crate) struct Sysctrl {
    pub(crate) interrupts: Interrupts<{ u32::MAX }>,
    xosc32k: u32,
    osc32k: u32,
    osculp32k: u32,
    osc8m: u32,
    dfllctrl: u32,
    /// DFLLVAL as it was written or last asked for.
    dfllval: u32,
    pub(crate) dfll: Dfll,
    dfllmul: u32,
    pub(crate) bod33: Bod33,
    vreg: u32,
    vref: u32,
    osc32k_ready: Ticks,
    dfll_ready: Ticks,
    dfll_locked: Ticks,
    frames_until_lock: u8,
    /// The newest start-of-frame packet that the DFLL has seen.
    last_frame: Ticks,
    /// When a drifting frequency is next worked out.
    next_drift: Ticks,
    pub(crate) osculp32k_hz: u32,
    /// The DFLL stands still, whatever the registers say.
    pub(crate) dfll_stopped: bool,
}

impl Sysctrl {
    pub(crate) fn new(options: &Options) -> Self {
        let (error, drift) = (options.dfll_error_ppm, options.dfll_drift_ppm_s);
        Self {
            dfll: Dfll::new(error, drift, DFLL_COARSE),
            next_drift: Ticks::NEVER,
            osculp32k_hz: options.osculp32k_hz,
            bod33: Bod33::new(options.user_row.bod33()),
            interrupts: Interrupts::of(Block::Sysctrl),
            xosc32k: 0x80,
            osc32k: 0x003F_0080,
            osculp32k: 0x1F,
            osc8m: 0x8707_0382,
            dfllctrl: 0x80,
            osc32k_ready: Ticks::NEVER,
            dfll_ready: Ticks::NEVER,
            dfll_locked: Ticks::NEVER,
            frames_until_lock: RECOVERY_FRAMES,
            ..Self::default()
        }
    }

    /// As after a reset for this reason: the 32 kHz oscillators go on through one that is not of
    /// the supply (data sheet, reset controller, effects of the different resets). The options
    /// hold the rate of OSCULP32K, also one that it has come to since power-on.
    pub(crate) fn after_reset(&self, options: &Options, cause: ResetCause) -> Self {
        let fresh = Self {
            dfll: self.dfll.after_reset(),
            bod33: self.bod33.after_reset(options.user_row.bod33()),
            ..Self::new(options)
        };
        match cause {
            ResetCause::External | ResetCause::Watchdog | ResetCause::System => Self {
                xosc32k: self.xosc32k,
                osc32k: self.osc32k,
                osculp32k: self.osculp32k,
                osc32k_ready: self.osc32k_ready,
                ..fresh
            },
            _ => fresh,
        }
    }

    /// The 32,768 Hz oscillator, once it runs.
    pub(crate) fn osc32k(&self, now: Ticks) -> Option<Rate> {
        (now >= self.osc32k_ready).then(|| Rate::from_hz(32_768))
    }

    /// The ultra-low-power 32,768 Hz oscillator.
    pub(crate) fn osculp32k(&self) -> Rate {
        Rate::from_hz(u64::from(self.osculp32k_hz))
    }

    /// The 8 MHz oscillator behind its prescaler.
    pub(crate) fn osc8m(&self) -> Option<Rate> {
        (self.osc8m & ENABLE != 0).then(|| Rate::from_hz(8_000_000 >> (self.osc8m >> 8 & 3)))
    }

    /// The DFLL, once it runs.
    pub(crate) fn dfll(&self, now: Ticks) -> Option<Rate> {
        let runs = now >= self.dfll_ready && !self.dfll_stopped;
        runs.then(|| self.dfll.rate(now))
    }

    /// A bit of a register flips: see [`upset`](crate::upset).
    pub(crate) fn flip(&mut self, offset: u32, bit: u32) -> bool {
        let mask = 1 << bit;
        match offset {
            0x24 if mask == ENABLE => {
                self.dfllctrl ^= mask;
                self.dfll_stopped = !self.dfll_stopped;
            }
            0x28 if bit < 16 => self.dfll.load(self.dfll.value() ^ mask),
            0x34 if bod33::BITS & mask != 0 => self.bod33.write(self.bod33.register ^ mask),
            _ => return false,
        }
        true
    }

    /// When a clock comes up, or changes, by itself.
    pub(crate) fn next(&self, after: Ticks) -> Ticks {
        let oscillators = [self.osc32k_ready, self.dfll_ready];
        let times = oscillators.into_iter().chain([self.dfll_locked, self.next_drift]);
        times.filter(|&at| at > after).min().unwrap_or(Ticks::NEVER)
    }

    /// The USB host's start-of-frame packet arrives; whether that changes the DFLL's frequency.
    pub(crate) fn start_of_frame(&mut self, now: Ticks) -> bool {
        if !self.recovers_from_usb() || now < self.dfll_ready {
            return false;
        }
        self.last_frame = now;
        let before = self.dfll.rate(now);
        let exact = self.dfll.regulate(now, self.dfllmul >> 16 & 0x3FF);
        if exact && self.frames_until_lock > 0 {
            self.frames_until_lock -= 1;
            if self.frames_until_lock == 0 {
                self.dfll_locked = now;
            }
        }
        self.dfll.rate(now) != before
    }

    fn recovers_from_usb(&self) -> bool {
        let needed = ENABLE | DFLL_CLOSED_LOOP | DFLL_USB_RECOVERY;
        self.dfllctrl & needed == needed
    }

    /// Whether the reference that the DFLL follows has stopped.
    fn has_lost_frames(&self, now: Ticks) -> bool {
        self.has_frames() && now.saturating_sub(self.last_frame) >= REFERENCE_LOST
    }

    /// Whether the DFLL follows start-of-frame packets, of which the first has come.
    fn has_frames(&self) -> bool {
        self.recovers_from_usb() && self.last_frame > Ticks::ZERO
    }

    fn status(&self, now: Ticks) -> u32 {
        let flags = [
            (B33SRDY, true),
            (BOD33RDY, self.bod33.is_enabled()),
            (BOD33DET, self.bod33.is_low()),
            (OSC32KRDY, now >= self.osc32k_ready),
            (OSC8MRDY, self.osc8m & ENABLE != 0),
            // Ready for the next register write: also while the DFLL is off.
            (DFLLRDY, self.dfllctrl & ENABLE == 0 || now >= self.dfll_ready),
            (DFLLOOB, self.has_frames() && self.dfll.is_at_limit()),
            (DFLLLCKF | DFLLLCKC, now >= self.dfll_locked),
            (DFLLRCS, self.has_lost_frames(now)),
        ];
        flags.into_iter().filter(|(_, is_set)| *is_set).fold(0, |status, (flag, _)| status | flag)
    }

    /// What comes by itself at `now`: oscillators are ready, the DFLL locks or drifts.
    pub(crate) fn advance(&mut self, now: Ticks) {
        self.interrupts.flags |= self.status(now) & 0x3F;
        if self.next_drift <= now {
            self.next_drift = now + DRIFT_STEP;
        }
        if self.dfll_locked == now && !self.recovers_from_usb() {
            self.dfll.lock(now);
        }
    }

    pub(crate) fn read(&self, now: Ticks, offset: u32) -> Read {
        Ok(match offset {
            0x00 | 0x04 | 0x08 => self.interrupts.read_words(offset),
            0x0C => self.status(now),
            0x14 => self.xosc32k,
            0x18 => self.osc32k,
            0x1C => self.osculp32k,
            0x20 => self.osc8m,
            0x24 => self.dfllctrl,
            0x28 => self.dfllval,
            0x2C => self.dfllmul,
            0x30 => 0,
            0x34 => self.bod33.register,
            0x3C => self.vreg,
            0x40 => self.vref,
            _ => return Err(name(offset)),
        })
    }

    /// `reference`: whether GCLK 0, the DFLL's reference, is routed.
    pub(crate) fn write(
        &mut self,
        bus: &mut Bus<'_>,
        offset: u32,
        lanes: Lanes,
        reference: bool,
    ) -> Write {
        match offset {
            0x00 | 0x04 | 0x08 => self.interrupts.write_words(offset, lanes),
            0x0C => {}
            0x14 => self.xosc32k = lanes.merge(self.xosc32k) & 0xFFFF,
            0x18 => self.write_osc32k(bus.now, lanes.merge(self.osc32k)),
            0x1C => self.osculp32k = lanes.merge(self.osculp32k) & 0xFF,
            0x20 => self.osc8m = lanes.merge(self.osc8m),
            0x24 => self.write_dfllctrl(bus, lanes.merge(self.dfllctrl) & 0xFFFF, reference),
            0x28 => {
                self.demand_dfll()?;
                self.dfllval = lanes.merge(self.dfllval) & 0xFFFF;
                self.dfll.load(self.dfllval);
            }
            0x2C => {
                self.demand_dfll()?;
                self.dfllmul = lanes.merge(self.dfllmul);
            }
            0x30 => {
                if lanes.bits() & READREQ != 0 {
                    self.dfllval = self.dfll.value();
                }
            }
            0x34 => self.bod33.write(lanes.merge(self.bod33.register) & bod33::BITS),
            0x3C => self.vreg = lanes.merge(self.vreg),
            0x40 => self.vref = lanes.merge(self.vref),
            _ => return Err(name(offset)),
        }
        DONE
    }

    fn write_osc32k(&mut self, now: Ticks, value: u32) {
        if value & ENABLE == 0 {
            self.osc32k_ready = Ticks::NEVER;
        } else if self.osc32k & ENABLE == 0 {
            let cycles = OSC32K_STARTUP[(value >> 8 & 7) as usize];
            self.osc32k_ready = now + Rate::from_hz(32_768).duration(cycles);
        }
        self.osc32k = value;
    }

    fn write_dfllctrl(&mut self, bus: &mut Bus<'_>, value: u32, reference: bool) {
        if self.status(bus.now) & DFLLRDY == 0 {
            bus.note("SYSCTRL", "DFLLCTRL written while DFLLRDY is 0");
        }
        let was_enabled = self.dfllctrl & ENABLE != 0;
        self.dfllctrl = value;
        if value & ENABLE == 0 {
            self.dfll_ready = Ticks::NEVER;
            self.dfll_locked = Ticks::NEVER;
            self.next_drift = Ticks::NEVER;
            return;
        }
        if !was_enabled {
            self.dfll_ready = bus.now + DFLL_STARTUP;
            if self.dfll.drifts() {
                self.next_drift = bus.now + DRIFT_STEP;
            }
        }
        self.frames_until_lock = RECOVERY_FRAMES;
        self.last_frame = Ticks::ZERO;
        self.dfll_locked =
            if value & DFLL_CLOSED_LOOP != 0 && value & DFLL_USB_RECOVERY == 0 && reference {
                bus.now + DFLL_LOCK
            } else {
                Ticks::NEVER
            };
    }

    fn demand_dfll(&self) -> Result<(), Refusal> {
        if self.dfllctrl & ONDEMAND != 0 && self.dfllctrl & ENABLE == 0 {
            return Err(Refusal::Forbidden(
                "a DFLL register written before DFLLCTRL.ONDEMAND was cleared freezes the chip (errata 9905)",
            ));
        }
        Ok(())
    }
}

fn name(offset: u32) -> Refusal {
    match offset {
        0x10 => Refusal::Unmodelled("XOSC"),
        0x44 => Refusal::Unmodelled("DPLLCTRLA"),
        0x48 => Refusal::Unmodelled("DPLLRATIO"),
        0x4C => Refusal::Unmodelled("DPLLCTRLB"),
        0x50 => Refusal::Unmodelled("DPLLSTATUS"),
        _ => RESERVED,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Options;

    fn write(sysctrl: &mut Sysctrl, us: u64, offset: u32, value: u32) -> Write {
        let now = Ticks::from_us(us);
        Bus::alone(now, |bus| sysctrl.write(bus, offset, Lanes::word(value), true))
    }

    fn status(sysctrl: &Sysctrl, us: u64) -> u32 {
        sysctrl.read(Ticks::from_us(us), 0x0C).unwrap()
    }

    #[test]
    fn osc32k_starts_after_66_cycles_and_the_crystal_never() {
        let mut sysctrl = Sysctrl::new(&Options::default());
        write(&mut sysctrl, 0, 0x18, 6 << 8 | 1 << 6 | 1 << 2 | 1 << 1).unwrap();
        write(&mut sysctrl, 0, 0x14, 0x06 << 8 | 1 << 1).unwrap();
        // 66 / 32768 Hz = 2014.2 us.
        assert_eq!(status(&sysctrl, 2014) & OSC32KRDY, 0);
        assert_eq!(status(&sysctrl, 2015) & OSC32KRDY, OSC32KRDY);
        assert!(sysctrl.osc32k(Ticks::from_us(2015)).is_some());
        assert_eq!(status(&sysctrl, 10_000_000) & 1 << 1, 0);
    }

    #[test]
    fn dfll_starts_as_the_hal_starts_it() {
        let mut sysctrl = Sysctrl::new(&Options::default());
        write(&mut sysctrl, 0, 0x24, 0).unwrap();
        assert_ne!(status(&sysctrl, 0) & DFLLRDY, 0);
        write(&mut sysctrl, 0, 0x28, 0x1F << 10 | 0x1FF).unwrap();
        write(&mut sysctrl, 0, 0x2C, 7 << 26 | 10 << 16 | 48_000).unwrap();
        let mode = 1 << 2 | 1 << 8 | 1 << 5 | 1 << 10;
        write(&mut sysctrl, 0, 0x24, mode).unwrap();
        write(&mut sysctrl, 0, 0x24, mode | ENABLE).unwrap();
        assert_eq!(status(&sysctrl, 5) & DFLLRDY, 0);
        assert_eq!(status(&sysctrl, 6) & DFLLRDY, DFLLRDY);
        assert_eq!(sysctrl.dfll(Ticks::from_us(6)).unwrap().hz(), 48e6);
        assert_eq!(status(&sysctrl, 10_000) & DFLLLCKF, 0, "no USB, no lock");
        for frame in 0..u64::from(RECOVERY_FRAMES) {
            sysctrl.start_of_frame(Ticks::from_ms(20 + frame));
        }
        assert_eq!(status(&sysctrl, 28_000) & (DFLLLCKF | DFLLRCS | DFLLOOB), DFLLLCKF);
        // The frames end: the value stays.
        assert_eq!(status(&sysctrl, 31_000) & (DFLLLCKF | DFLLRCS), DFLLLCKF | DFLLRCS);
        sysctrl.dfll.shift(200_000.0);
        for frame in 0..100 {
            sysctrl.start_of_frame(Ticks::from_ms(40 + frame));
        }
        assert_eq!(status(&sysctrl, 139_000) & (DFLLRCS | DFLLOOB), DFLLOOB);
    }

    #[test]
    fn writing_an_undemanded_dfll_is_refused() {
        let mut sysctrl = Sysctrl::new(&Options::default());
        assert!(matches!(write(&mut sysctrl, 0, 0x28, 0), Err(Refusal::Forbidden(_))));
    }
}
