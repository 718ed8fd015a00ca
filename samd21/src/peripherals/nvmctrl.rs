//! NVMCTRL: flash controller, and the factory's rows in the auxiliary space.
//!
//! | offset | register | behaviour |
//! |---|---|---|
//! | 00 | CTRLA | CMD with CMDEX 0xA5: ER, WP, PBC, INVALL; they stall the CPU as below |
//! | 04 | CTRLB | RWS gives the flash wait states; MANW; the rest stored |
//! | 08 | PARAM | 4096 pages of 64 bytes |
//! | 0C, 10, 14 | INTENCLR, INTENSET, INTFLAG | READY, ERROR |
//! | 18 | STATUS | LOAD, PROGE, LOCKE, NVME; write one clears the errors |
//! | 1C | ADDR | byte address / 2; a write to the page buffer sets it |
//! | 20 | LOCK | from the user row; the lock bits lock nothing |
//! | flash | page buffer | 16- and 32-bit writes only; with MANW = 0 the page's last word programs it |
//! | 0080_4000 | user row | from the chip's options, read only; its BOOTPROT protects |
//! | 0080_6020, 0080_6030 | calibration, temperature log | plausible factory values |
//! | 0080_A00C, A040-A048 | serial number | made up |
//!
//! Erasing a row (256 bytes) takes 6 ms, programming a page 2.5 ms (the data sheet's maxima), or
//! what the chip's options make of that; the CPU runs from the same flash and stands still
//! meanwhile. Programming only clears bits. A reset meanwhile ends the command: some of the bits
//! that it was to change are changed then, more of them the later it comes.
//!
//! | left out | why |
//! |---|---|
//! | EAR, WAP (auxiliary rows), lock bits, security bit | not for an application: such a command faults |
//! | RWWEE | not on the D21A |
//! | bits that a command cut short has left between 0 and 1, which read as either | how often is not published |
//! | running on from RAM during a command | the CPU stands still, as it does with code in flash |
//! | cache and power modes | timing of fetches is the core's |

use super::access::{Bus, Lanes, RESERVED, Read, Refusal, Write};
use super::interrupts::Interrupts;
use super::map::Block;
use super::user_row::UserRow;
use crate::Options;
use crate::board::Ticks;
use crate::memory::{FLASH_SIZE, Memory};

const PAGE: u32 = 64;
const ROW: u32 = 256;
const ROW_ERASE: Ticks = Ticks::from_us(6000);
const PAGE_PROGRAM: Ticks = Ticks::from_us(2500);

const READY: u32 = 1 << 0;
const ERROR: u32 = 1 << 1;
const LOAD: u16 = 1 << 1;
const PROGE: u16 = 1 << 2;
const LOCKE: u16 = 1 << 3;
const NVME: u16 = 1 << 4;
const MANW: u32 = 1 << 7;

/// The factory's DFLL48M COARSE CAL.
pub(super) const DFLL_COARSE: u8 = 0x1F;

/// 0x0080_6020 (data sheet, NVM software calibration area): ADC linearity 0x80 and bias 2, OSC32K
/// 0x2E, USB TRANSN 5, TRANSP 29, TRIM 3, DFLL48M coarse 0x1F.
const CALIBRATION: u64 = 0x80 << 27
    | 2 << 35
    | 0x2E << 38
    | 5 << 45
    | 29 << 50
    | 3 << 55
    | (DFLL_COARSE as u64) << 58
    | 0x7FF_FFFF;

/// The 128-bit serial number, word 0 first (0x0080_A00C, 0x0080_A040, 44, 48).
const SERIAL_NUMBER: [u32; 4] = [0x5D21_0001, 0x5D21_0002, 0x5D21_0003, 0x5D21_0004];

/// 0x0080_6030: room 25.0 degrees, hot 85.0, their references and ADC readings.
const TEMPERATURE_LOG: u64 = 25 | 85 << 12 | 0x0C00 << 40 | 0x0E66 << 52;

/// A command that changes flash.
#[derive(Clone, Debug)]
struct Command {
    since: Ticks,
    address: u32,
    /// What was there before.
    before: Box<[u8]>,
}

#[derive(Clone, Debug)]
pub(crate) struct Nvmctrl {
    ctrlb: u32,
    /// READY is not in its flags: that follows from the time.
    interrupts: Interrupts<{ READY | ERROR }>,
    status: u16,
    address: u32,
    page: [u8; PAGE as usize],
    busy_until: Ticks,
    /// The command that is carried out until then.
    command: Option<Command>,
    user_row: UserRow,
    time_percent: u32,
}

impl Nvmctrl {
    pub(crate) fn new(options: &Options) -> Self {
        Self {
            ctrlb: 0,
            interrupts: Interrupts::of(Block::Nvmctrl),
            status: 0,
            address: 0,
            page: [0xFF; PAGE as usize],
            busy_until: Ticks::ZERO,
            command: None,
            user_row: options.user_row,
            time_percent: (options.flash_time * 100.0).round() as u32,
        }
    }

    /// Flash wait states, CTRLB.RWS.
    pub(crate) fn wait_states(&self) -> u8 {
        (self.ctrlb >> 1 & 0xF) as u8
    }

    pub(crate) fn irq(&self, now: Ticks) -> u32 {
        let requested = self.flags(now) & self.interrupts.enabled != 0;
        self.interrupts.irq_if(requested)
    }

    /// When the command going on ends.
    pub(crate) fn next(&self, after: Ticks) -> Ticks {
        if self.busy_until > after { self.busy_until } else { Ticks::NEVER }
    }

    fn flags(&self, now: Ticks) -> u32 {
        let ready = if now >= self.busy_until { READY } else { 0 };
        ready | self.interrupts.flags
    }

    pub(crate) fn read(&self, now: Ticks, offset: u32) -> Read {
        Ok(match offset {
            0x00 => 0,
            0x04 => self.ctrlb,
            0x08 => (3 << 16) | (FLASH_SIZE / PAGE),
            0x0C | 0x10 => self.interrupts.enabled,
            0x14 => self.flags(now),
            0x18 => u32::from(self.status),
            0x1C => self.address,
            0x20 => self.user_row.word(1) >> 16,
            _ => return Err(RESERVED),
        })
    }

    /// A word of the auxiliary space, `None` where nothing is.
    pub(crate) fn read_auxiliary(&self, addr: u32) -> Option<u32> {
        Some(match addr {
            0x0080_4000 => self.user_row.word(0),
            0x0080_4004 => self.user_row.word(1),
            0x0080_4008..0x0080_4100 => u32::MAX,
            0x0080_6020 => CALIBRATION as u32,
            0x0080_6024 => (CALIBRATION >> 32) as u32,
            0x0080_6030 => TEMPERATURE_LOG as u32,
            0x0080_6034 => (TEMPERATURE_LOG >> 32) as u32,
            0x0080_6000..0x0080_6040 => u32::MAX,
            0x0080_A00C => SERIAL_NUMBER[0],
            0x0080_A040 => SERIAL_NUMBER[1],
            0x0080_A044 => SERIAL_NUMBER[2],
            0x0080_A048 => SERIAL_NUMBER[3],
            _ => return None,
        })
    }

    pub(crate) fn write(
        &mut self,
        bus: &mut Bus<'_>,
        offset: u32,
        lanes: Lanes,
        memory: &mut Memory,
    ) -> Write {
        match offset {
            0x00 => {
                if let Some(command) = lanes.half(0, 0) {
                    return self.command(bus, command, memory);
                }
            }
            0x04 => self.ctrlb = lanes.merge(self.ctrlb) & 0x0007_039E,
            0x08 | 0x20 => {}
            0x0C | 0x10 | 0x14 => self.interrupts.write_words(offset - 0x0C, lanes),
            0x18 => self.status &= !(lanes.bits() as u16),
            0x1C => self.address = lanes.merge(self.address) & 0x003F_FFFF,
            _ => return Err(RESERVED),
        }
        Ok(Ticks::ZERO)
    }

    /// A write to the flash's own address range: it fills the page buffer.
    pub(crate) fn load_page_buffer(
        &mut self,
        bus: &mut Bus<'_>,
        addr: u32,
        bytes: u32,
        value: u32,
        memory: &mut Memory,
    ) -> Write {
        if bytes == 1 {
            // Data sheet 22.6.4.3: a system exception.
            return Err(Refusal::Exception("the page buffer takes no byte writes"));
        }
        let start = (addr % PAGE) as usize;
        let length = bytes as usize;
        self.page[start..start + length].copy_from_slice(&value.to_le_bytes()[..length]);
        self.address = addr / 2;
        self.status |= LOAD;
        if self.ctrlb & MANW == 0 && start + length == PAGE as usize {
            return self.program(bus, memory);
        }
        Ok(Ticks::ZERO)
    }

    fn command(&mut self, bus: &mut Bus<'_>, command: u16, memory: &mut Memory) -> Write {
        if command >> 8 != 0xA5 {
            return self.refuse(bus, PROGE, "command without the key 0xA5");
        }
        match command & 0x7F {
            0x02 => {
                let row = self.address * 2 / ROW * ROW;
                self.change(bus, memory, (row, ROW), ROW_ERASE, |_, memory| {
                    memory.erase(row, ROW as usize)
                })
            }
            0x04 => self.program(bus, memory),
            0x44 => {
                self.clear_page_buffer();
                Ok(Ticks::ZERO)
            }
            0x46 => Ok(Ticks::ZERO),
            _ => Err(Refusal::Unmodelled("this CTRLA.CMD")),
        }
    }

    fn program(&mut self, bus: &mut Bus<'_>, memory: &mut Memory) -> Write {
        let page = self.address * 2 / PAGE * PAGE;
        self.change(bus, memory, (page, PAGE), PAGE_PROGRAM, |nvmctrl, memory| {
            memory.program(page, &nvmctrl.page)?;
            nvmctrl.clear_page_buffer();
            Some(())
        })
    }

    /// Carries out a command on the flash `at` an address and of a length, unless BOOTPROT refuses.
    /// Keeps what is there, for a reset that may come before the command's end. Is busy for as long
    /// as the command takes on this chip, `longest` on any.
    fn change(
        &mut self,
        bus: &mut Bus<'_>,
        memory: &mut Memory,
        at: (u32, u32),
        longest: Ticks,
        carry_out: impl FnOnce(&mut Self, &mut Memory) -> Option<()>,
    ) -> Write {
        let (address, length) = at;
        if address < self.user_row.protected_bytes() {
            return self.refuse(bus, LOCKE, "command into flash that BOOTPROT protects");
        }
        let before = memory.bytes(address, length as usize).map(Into::into);
        self.command = before.map(|before| Command { since: bus.now, address, before });
        if carry_out(self, memory).is_none() {
            return self.refuse(bus, NVME, "command with ADDR outside of flash");
        }
        let time = longest * u64::from(self.time_percent) / 100;
        self.busy_until = bus.now + time;
        Ok(time)
    }

    /// A reset: a command that has not ended leaves flash as far as it has come.
    pub(super) fn cut_short(&mut self, now: Ticks, memory: &mut Memory, seed: u64) {
        let Some(command) = self.command.take_if(|_| now < self.busy_until) else {
            return;
        };
        let [passed, all] = [now, self.busy_until].map(|at| at.saturating_sub(command.since).0);
        let share = passed as f64 / all as f64;
        // It was read from there.
        let _ = memory.undo_in_part(command.address, &command.before, share, seed ^ now.0);
    }

    /// The command is not carried out, takes no time, and leaves `error` in STATUS.
    fn refuse(&mut self, bus: &mut Bus<'_>, error: u16, what: &'static str) -> Write {
        self.status |= error;
        self.interrupts.flags |= ERROR;
        bus.note("NVMCTRL", what);
        Ok(Ticks::ZERO)
    }

    fn clear_page_buffer(&mut self) {
        self.page = [0xFF; PAGE as usize];
        self.status &= !LOAD;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn nvmctrl(user_row: UserRow) -> Nvmctrl {
        Nvmctrl::new(&Options { user_row, ..Options::default() })
    }

    struct Rig {
        nvmctrl: Nvmctrl,
        memory: Memory,
        now: Ticks,
    }

    impl Rig {
        fn new() -> Self {
            Self {
                nvmctrl: nvmctrl(UserRow::SHIPPED),
                memory: Memory::new(0),
                now: Ticks::from_ms(1),
            }
        }

        fn write(&mut self, offset: u32, value: u32) -> Ticks {
            let Self { nvmctrl, memory, now } = self;
            Bus::alone(*now, |bus| nvmctrl.write(bus, offset, Lanes::word(value), memory)).unwrap()
        }

        fn load(&mut self, addr: u32, bytes: u32, value: u32) -> Write {
            let Self { nvmctrl, memory, now } = self;
            Bus::alone(*now, |bus| nvmctrl.load_page_buffer(bus, addr, bytes, value, memory))
        }
    }

    #[test]
    fn slow_flash_takes_as_much_longer() {
        let mut rig = Rig::new();
        rig.nvmctrl.time_percent = 150;
        rig.write(0x1C, 0x3F00 / 2);
        assert_eq!(rig.write(0x00, 0xA502), Ticks::from_ms(9));
        rig.now += ROW_ERASE;
        assert_eq!(rig.nvmctrl.read(rig.now, 0x14), Ok(0), "not ready");
    }

    #[test]
    fn a_row_is_erased_and_a_page_programmed_with_their_stalls() {
        let mut rig = Rig::new();
        rig.memory.load(0x3F00, &[0; 0x100]).expect("it fits");
        rig.write(0x04, MANW | 2);
        assert_eq!(rig.nvmctrl.wait_states(), 1);
        rig.write(0x1C, 0x3F00 / 2);
        assert_eq!(rig.write(0x00, 0xA502), ROW_ERASE);
        assert_eq!(rig.memory.read_u32(0x3F00), Some(u32::MAX));
        assert_eq!(rig.nvmctrl.read(rig.now, 0x14), Ok(0), "not ready");
        rig.now += ROW_ERASE;
        assert_eq!(rig.nvmctrl.read(rig.now, 0x14), Ok(READY));

        rig.write(0x00, 0xA544);
        rig.load(0x3F40, 4, 0x1234_5678).unwrap();
        rig.load(0x3F44, 2, 0xABCD).unwrap();
        assert_eq!(rig.nvmctrl.read(rig.now, 0x1C), Ok(0x3F44 / 2));
        assert_eq!(rig.memory.read_u32(0x3F40), Some(u32::MAX), "only loaded");
        assert_eq!(rig.write(0x00, 0xA504), PAGE_PROGRAM);
        assert_eq!(rig.memory.read_u32(0x3F40), Some(0x1234_5678));
        assert_eq!(rig.memory.read_u32(0x3F44), Some(0xFFFF_ABCD));

        // A second programming only clears bits.
        rig.load(0x3F40, 4, 0xFF00_FF00).unwrap();
        rig.write(0x00, 0xA504);
        assert_eq!(rig.memory.read_u32(0x3F40), Some(0x1200_5600));
    }

    #[test]
    fn a_reset_leaves_what_was_under_way_half_done_and_what_had_ended_as_it_is() {
        let mut rig = Rig::new();
        rig.memory.load(0x3F00, &[0; 0x100]).expect("it fits");
        rig.write(0x1C, 0x3F00 / 2);
        rig.write(0x00, 0xA502);
        let erased = |rig: &Rig, after| {
            let (mut nvmctrl, mut memory) = (rig.nvmctrl.clone(), rig.memory.clone());
            nvmctrl.cut_short(rig.now + after, &mut memory, 1);
            let row = memory.bytes(0x3F00, 256).unwrap();
            row.iter().map(|byte| byte.count_ones()).sum::<u32>()
        };
        // Of 2,048 bits, to within five standard deviations.
        for share in [0, 1, 2, 3] {
            let ones = erased(&rig, ROW_ERASE * share / 4);
            assert!(ones.abs_diff(512 * share as u32) < 113, "{share}: {ones}");
        }
        assert_eq!(erased(&rig, ROW_ERASE), 2048, "it has ended");

        rig.now += ROW_ERASE;
        rig.load(0x3F40, 4, 0).unwrap();
        rig.write(0x00, 0xA504);
        let ones = erased(&rig, PAGE_PROGRAM / 2);
        assert!((2048 - 32 + 1..2048).contains(&ones), "{ones}");
    }

    #[test]
    fn bootprot_refuses_its_area_and_nothing_beyond() {
        let mut rig = Rig::new();
        rig.nvmctrl = nvmctrl(UserRow::PROTECTED);
        rig.memory.load(0x1F00, &[0; 0x200]).expect("it fits");
        rig.write(0x1C, 0x1F00 / 2);
        assert_eq!(rig.write(0x00, 0xA502), Ticks::ZERO);
        assert_eq!(rig.memory.read_u32(0x1F00), Some(0));
        assert_eq!(rig.nvmctrl.read(rig.now, 0x18), Ok(u32::from(LOCKE)));
        assert_eq!(rig.nvmctrl.read(rig.now, 0x14), Ok(READY | ERROR));
        rig.write(0x18, u32::from(LOCKE));
        rig.write(0x04, MANW);
        rig.load(0x1F00, 4, 5).unwrap();
        assert_eq!(rig.write(0x00, 0xA504), Ticks::ZERO);
        assert_eq!(rig.nvmctrl.status & LOCKE, LOCKE);
        rig.write(0x1C, 0x2000 / 2);
        assert_eq!(rig.write(0x00, 0xA502), ROW_ERASE);
        assert_eq!(rig.memory.read_u32(0x2000), Some(u32::MAX));
    }

    #[test]
    fn without_manw_the_last_word_programs_the_page() {
        let mut rig = Rig::new();
        assert_eq!(rig.load(0x4038, 4, 0x0BAD_F00D), Ok(Ticks::ZERO));
        assert_eq!(rig.load(0x403C, 4, 0), Ok(PAGE_PROGRAM));
        assert_eq!(rig.memory.read_u32(0x4038), Some(0x0BAD_F00D));
    }

    #[test]
    fn byte_writes_and_bad_keys_do_not_program() {
        let mut rig = Rig::new();
        assert!(rig.load(0x4000, 1, 0).is_err());
        rig.write(0x00, 0x0004);
        assert_eq!(rig.nvmctrl.status & PROGE, PROGE);
        assert_eq!(rig.memory.read_u32(0x4000), Some(u32::MAX));
    }

    #[test]
    fn calibration_reads_as_the_hal_extracts_it() {
        let nvmctrl = nvmctrl(UserRow::SHIPPED);
        let low = u64::from(nvmctrl.read_auxiliary(0x0080_6020).unwrap());
        let row = low | u64::from(nvmctrl.read_auxiliary(0x0080_6024).unwrap()) << 32;
        assert_eq!(row >> 58 & 0x3F, 0x1F, "DFLL coarse");
        assert_eq!(row >> 55 & 0x7, 3, "USB trim");
        assert_eq!(row >> 50 & 0x1F, 29, "USB TRANSP");
        assert_eq!(row >> 45 & 0x1F, 5, "USB TRANSN");
        assert_eq!(row >> 38 & 0x7F, 0x2E, "OSC32K");
        assert_eq!(nvmctrl.read_auxiliary(0x0080_A048), Some(0x5D21_0004));
        assert_eq!(nvmctrl.read_auxiliary(0x0080_5000), None);
    }
}
