//! The system control space, 0xE000_E000 (ARM DDI 0419, B3.2 to B3.4).
//!
//! | address | register | behaviour |
//! |---|---|---|
//! | E008 | ACTLR | reads as zero |
//! | E010-E01C | SysTick | see `systick` |
//! | E100, E180 | NVIC_ISER, ICER | read the enabled interrupts |
//! | E200, E280 | NVIC_ISPR, ICPR | read the pending interrupts |
//! | E400-E41C | NVIC_IPR0-7 | 2 bits a byte |
//! | ED00 | CPUID | Cortex-M0+ r0p1 |
//! | ED04 | ICSR | pends NMI, PendSV, SysTick; VECTACTIVE, VECTPENDING, ISRPENDING |
//! | ED08 | VTOR | bits 31:8 |
//! | ED0C | AIRCR | SYSRESETREQ with the key |
//! | ED10 | SCR | SLEEPONEXIT, SLEEPDEEP (sleeping with it stops the chip), SEVONPEND |
//! | ED14 | CCR | STKALIGN and UNALIGN_TRP, fixed |
//! | ED1C, ED20 | SHPR2, SHPR3 | SVCall; PendSV, SysTick |
//! | ED90-EDA0 | MPU | reads as zero: there is none |
//! | EDF0, EDFC | DHCSR, DEMCR | read as zero (no debugger), writes are ignored |
//!
//! Left out: SHCSR and DFSR, which only a debugger reaches; VECTCLRACTIVE, which belongs to halted
//! debugging. Any other address, and any access that is not a word, stops the chip.

use super::nvic::{IRQ0, NMI, PENDSV, SYSTICK, exceptions, irqs};
use super::systick::CALIBRATION;
use super::{Core, Outcome, Trap};
use crate::fault::FaultKind;
use crate::peripherals::{ResetCause, Width};

/// VTOR bits that the Cortex-M0+ has.
pub(super) const VTOR_MASK: u32 = 0xFFFF_FF00;

/// ARM, Cortex-M0+, r0p1.
const CPUID: u32 = 0x410C_C601;
const CCR: u32 = 1 << 9 | 1 << 3;
const VECTKEY: u32 = 0x05FA;
const AIRCR_READ: u32 = 0xFA05_0000;
const SYSRESETREQ: u32 = 1 << 2;

/// What ICSR pends, with the bits that set and clear it.
const PENDABLE: [(u8, u32, u32); 3] =
    [(NMI, 1 << 31, 0), (PENDSV, 1 << 28, 1 << 27), (SYSTICK, 1 << 26, 1 << 25)];
const ICSR_ISRPENDING: u32 = 1 << 22;

pub(super) const SCR_SLEEPONEXIT: u32 = 1 << 1;
pub(super) const SCR_SLEEPDEEP: u32 = 1 << 2;
pub(super) const SCR_SEVONPEND: u32 = 1 << 4;

impl Core {
    pub(super) fn read_system_control(&mut self, address: u32, width: Width) -> Outcome<u32> {
        if !matches!(width, Width::Word) {
            return Err(unmodelled(address, width));
        }
        Ok(match address & 0xFFF {
            0x008 | 0xD90..=0xDA0 | 0xDF0 | 0xDFC => 0,
            0x010 => self.systick.read_control(),
            0x014 => self.systick.reload,
            0x018 => self.systick.count(self.now, self.cycle),
            0x01C => CALIBRATION,
            0x100 | 0x180 => irqs(self.nvic.enabled),
            0x200 | 0x280 => irqs(self.nvic.pending),
            offset @ 0x400..=0x41C => self.nvic.priority_word(IRQ0 + offset as u8),
            0xD00 => CPUID,
            0xD04 => self.icsr(),
            0xD08 => self.vtor,
            0xD0C => AIRCR_READ,
            0xD10 => self.scr,
            0xD14 => CCR,
            0xD1C => self.nvic.priority_word(8),
            0xD20 => self.nvic.priority_word(12),
            _ => return Err(unmodelled(address, width)),
        })
    }

    pub(super) fn write_system_control(
        &mut self,
        address: u32,
        width: Width,
        value: u32,
    ) -> Outcome<()> {
        if !matches!(width, Width::Word) {
            return Err(unmodelled(address, width));
        }
        let before = self.nvic.pending;
        match address & 0xFFF {
            0x008 | 0x01C | 0xD00 | 0xD14 | 0xDF0 | 0xDFC => {}
            0x010 => self.systick.write_control(value, self.now, self.cycle),
            0x014 => self.systick.set_reload(value),
            0x018 => self.systick.clear(self.now, self.cycle),
            0x100 => self.nvic.enabled |= exceptions(value),
            0x180 => self.nvic.enabled &= !exceptions(value),
            0x200 => self.nvic.pending |= exceptions(value),
            0x280 => self.nvic.pending &= !exceptions(value),
            offset @ 0x400..=0x41C => self.nvic.set_priority_word(IRQ0 + offset as u8, value),
            0xD04 => self.set_icsr(value),
            0xD08 => self.vtor = value & VTOR_MASK,
            0xD0C => {
                if value >> 16 == VECTKEY && value & SYSRESETREQ != 0 {
                    self.reset_request = Some(ResetCause::System);
                }
            }
            0xD10 => self.scr = value & (SCR_SLEEPONEXIT | SCR_SLEEPDEEP | SCR_SEVONPEND),
            0xD1C => self.nvic.set_priority_word(8, value),
            0xD20 => self.nvic.set_priority_word(12, value),
            _ => return Err(unmodelled(address, width)),
        }
        self.note_pending(before);
        Ok(())
    }

    fn icsr(&self) -> u32 {
        let first = self.nvic.first_pending().map_or(0, |(exception, _)| exception);
        let waits = irqs(self.nvic.pending) != 0;
        let mut icsr = u32::from(self.ipsr) | u32::from(first) << 12;
        icsr |= if waits { ICSR_ISRPENDING } else { 0 };
        for (exception, set, _) in PENDABLE {
            icsr |= if self.nvic.is_pending(exception) { set } else { 0 };
        }
        icsr
    }

    fn set_icsr(&mut self, value: u32) {
        for (exception, set, clear) in PENDABLE {
            if value & clear != 0 {
                self.nvic.pending &= !(1 << exception);
            }
            if value & set != 0 {
                self.nvic.pend(exception);
            }
        }
    }

    /// SEVONPEND: an exception that pends and did not `before` is an event.
    pub(super) fn note_pending(&mut self, before: u64) {
        let is_new = self.nvic.pending & !before != 0;
        self.event |= is_new && self.scr & SCR_SEVONPEND != 0;
    }
}

fn unmodelled(address: u32, width: Width) -> Box<Trap> {
    Trap::Unmodelled(FaultKind::SystemControl { address, width }).into()
}
