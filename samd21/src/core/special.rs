//! Hints, the 32-bit encodings and the special registers.

use super::flags::Flags;
use super::system_control::SCR_SLEEPDEEP;
use super::{Core, Outcome, PC, SP, Sleep, Trap, undefined};
use crate::bus::Bus;
use crate::fault::FaultKind;

impl Core {
    pub(super) fn hint(&mut self, op: u16) -> Outcome<u32> {
        match op {
            0xBF20 | 0xBF30 if self.scr & SCR_SLEEPDEEP != 0 => {
                return Err(Trap::Unmodelled(FaultKind::DeepSleep).into());
            }
            0xBF20 if self.event => self.event = false,
            0xBF20 => self.fall_asleep(Sleep::ForEvent),
            0xBF30 => self.fall_asleep(Sleep::ForInterrupt),
            0xBF40 => {
                self.event = true;
                return Ok(1);
            }
            // NOP, YIELD and hints that are not allocated.
            _ if op & 0xF == 0 => return Ok(1),
            _ => return Err(undefined(op.into())),
        }
        Ok(2)
    }

    fn fall_asleep(&mut self, sleep: Sleep) {
        self.sleep = Some(sleep);
        self.ask_attention();
    }

    /// The 32-bit encodings that `burst` leaves out: MRS and MSR; everything else is undefined.
    pub(super) fn wide(&mut self, bus: &mut Bus<'_>, op: u16, pc: u32) -> Outcome<u32> {
        let second = self.fetch(bus, pc.wrapping_add(2))?;
        let encoding = u32::from(op) << 16 | u32::from(second);
        self.pc = pc.wrapping_add(4);
        if encoding & 0xFFFF_F000 == 0xF3EF_8000 {
            let rd = (encoding >> 8 & 15) as usize;
            match self.special(encoding & 0xFF) {
                Some(value) if rd != SP && rd != PC => self.r[rd] = value,
                _ => return Err(undefined(encoding)),
            }
        } else if encoding & 0xFFF0_FF00 == 0xF380_8800 {
            let rn = (encoding >> 16 & 15) as usize;
            if rn == SP || rn == PC || !self.set_special(encoding & 0xFF, self.r[rn]) {
                return Err(undefined(encoding));
            }
        } else {
            return Err(undefined(encoding));
        }
        Ok(3)
    }

    /// A special register by its SYSm number; EPSR reads as zero.
    fn special(&self, number: u32) -> Option<u32> {
        let (msp, psp) = self.stack_pointers();
        Some(match number {
            0 | 2 => self.xpsr() & 0xF000_0000,
            1 | 3 => self.xpsr() & 0xF000_003F,
            5 | 7 => u32::from(self.ipsr),
            6 => 0,
            8 => msp,
            9 => psp,
            16 => u32::from(self.primask),
            20 => u32::from(self.spsel) << 1,
            _ => return None,
        })
    }

    /// Writes a special register; whether there is one with that number.
    fn set_special(&mut self, number: u32, value: u32) -> bool {
        match number {
            0..=3 => self.flags = Flags::of(value),
            // IPSR and EPSR: writes are ignored.
            5..=7 => {}
            8 if !self.uses_psp() => self.set_sp(value),
            9 if self.uses_psp() => self.set_sp(value),
            8 | 9 => self.other_sp = value & !3,
            16 => {
                self.primask = value & 1 != 0;
                self.ask_attention();
            }
            20 => {
                // In a handler the write is ignored; nPRIV does not exist on this chip.
                let spsel = value & 2 != 0;
                if self.ipsr == 0 && spsel != self.spsel {
                    std::mem::swap(&mut self.r[SP], &mut self.other_sp);
                    self.spsel = spsel;
                }
            }
            _ => return false,
        }
        true
    }
}
