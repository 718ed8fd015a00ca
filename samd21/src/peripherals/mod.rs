//! The peripherals at register level, and the bus that reaches them.
//!
//! Each file opens with the registers that it models and what it leaves out. An access that no
//! model covers stops the chip with an error that names peripheral and register; misuse that the
//! real chip silently ignores is noted in [`Violations`].
//!
//! D21-nnn is page nnn of the SAM D21 data sheet, DS40001882D.
//!
//! | file | models |
//! |---|---|
//! | `pm`, `sysctrl`, `gclk` | clocks and reset cause |
//! | `nvmctrl`, `user_row` | flash programming, factory rows, settings at reset |
//! | `port` | pins and their multiplexers |
//! | `sercom` | I2C masters, USARTs |
//! | `tcc` | TCC0-TCC2: waveforms |
//! | `tc` | TC3-TC5: time bases |
//! | `usb` | USB device controller; [`usb_host`](crate::usb_host) is the other end of the cable |
//! | `eic` | external interrupts |
//! | `wdt` | watchdog |
//! | `pac`, `dsu` | write protection; device identity, CRC-32 of the flash |
//! | `adc` | registers alone: a conversion gives half of its range |
//! | `priorities` | priorities in DMAC and HMATRIX, without effect |
//!
//! `map` has their addresses, interrupt lines and clocks, `multiplexer` what the pins lead to.
//!
//! RTC, MTB, EVSYS, AC, DAC, PTC, I2S, TC6 and TC7 are not modelled: an access
//! faults.

mod access;
mod adc;
mod bod33;
mod clock;
mod counter;
mod dfll;
mod dsu;
mod eic;
mod error;
mod gclk;
mod interrupts;
mod map;
mod multiplexer;
mod nvmctrl;
mod pac;
mod pm;
mod port;
mod priorities;
mod sercom;
mod sysctrl;
mod tc;
mod tcc;
#[cfg(test)]
mod tests;
pub(crate) mod usb;
mod user_row;
mod violations;
mod wdt;

pub use error::{BusError, Refusal, ResetCause, Width};
pub use user_row::UserRow;
pub use violations::{Violation, Violations};

use crate::Options;
use crate::board::{Board, I2cCut, Ticks};
use crate::memory::{FLASH_SIZE, Memory};
use access::{Bus, Lanes, Read, Write};
pub(crate) use clock::FRACTION;
use gclk::SERCOM_SLOW;
use map::{Block, Bridge, Entry};

/// All peripherals of one chip.
#[derive(Clone, Debug)]
pub(crate) struct Peripherals {
    options: Options,
    pac: pac::Pac,
    pm: pm::Pm,
    pub(crate) sysctrl: sysctrl::Sysctrl,
    pub(crate) gclk: gclk::Gclk,
    dsu: dsu::Dsu,
    eic: eic::Eic,
    pub(crate) nvmctrl: nvmctrl::Nvmctrl,
    port: port::Port,
    priorities: priorities::Priorities,
    adc: adc::Adc,
    sercom: [sercom::Sercom; 6],
    tc: [tc::Tc; 3],
    tcc: [tcc::Tcc; 3],
    pub(crate) usb: usb::Usb,
    wdt: wdt::Wdt,
    /// Misuse since power-on that the real chip would have swallowed.
    pub(crate) violations: Violations,
    /// Length of a CPU cycle in parts of a tick.
    pub(crate) cycle: u64,
    /// The flash is read faster than it can be.
    flash_overrun: bool,
    pub(crate) irq_lines: u32,
    pub(crate) next: Ticks,
    pub(crate) last: Ticks,
    /// A reset that a peripheral asks for.
    pub(crate) pending_reset: Option<ResetCause>,
    /// A transfer that a reset has cut, of which the board is yet to learn.
    cut: Option<I2cCut>,
}

impl Peripherals {
    /// As after power-on.
    pub(crate) fn new(options: &Options) -> Self {
        let mut peripherals = Self {
            options: options.clone(),
            pac: pac::Pac::new(),
            pm: pm::Pm::new(ResetCause::PowerOn),
            sysctrl: sysctrl::Sysctrl::new(options),
            gclk: gclk::Gclk::new(options),
            dsu: dsu::Dsu::new(options.crc_word_cycles.round() as u32),
            eic: eic::Eic::new(options.syncbusy_hold),
            nvmctrl: nvmctrl::Nvmctrl::new(options),
            port: port::Port::default(),
            priorities: priorities::Priorities::new(),
            adc: adc::Adc::new(),
            sercom: [0, 1, 2, 3, 4, 5]
                .map(|index| sercom::Sercom::new(index, options.syncbusy_hold)),
            tc: [0, 1, 2].map(|index| tc::Tc::new(index, options.syncbusy_hold)),
            tcc: [0, 1, 2].map(|index| tcc::Tcc::new(index, options.syncbusy_hold)),
            usb: usb::Usb::new(options.syncbusy_hold),
            wdt: wdt::Wdt::new(options),
            violations: Violations::default(),
            cycle: 48 << FRACTION,
            flash_overrun: false,
            irq_lines: 0,
            next: Ticks::NEVER,
            last: Ticks::ZERO,
            pending_reset: None,
            cut: None,
        };
        peripherals.retime(Ticks::ZERO);
        peripherals.wdt.power_up(Ticks::ZERO);
        peripherals.refresh(Ticks::ZERO);
        peripherals
    }

    /// All registers as after a reset for this reason, which ends what flash was doing. The board
    /// learns of the released pins and of a transfer that is cut when time goes on.
    pub(crate) fn reset(&mut self, now: Ticks, cause: ResetCause, memory: &mut Memory) {
        self.nvmctrl.cut_short(now, memory, self.options.seed);
        self.port.reset();
        let fresh = Self::new(&self.options);
        *self = Self {
            pm: pm::Pm::new(cause),
            sysctrl: self.sysctrl.after_reset(&self.options, cause),
            port: self.port.clone(),
            violations: self.violations.clone(),
            cut: self.sercom.iter().find_map(|sercom| sercom.cut(now)),
            last: now,
            ..fresh
        };
        self.retime(now);
        self.wdt.power_up(now);
        self.refresh(now);
        // The board is to learn of what the reset has changed.
        self.next = now;
    }

    /// Reads a register, or a word of the auxiliary flash rows. Flash, SRAM and the core's own
    /// registers are not reached this way.
    pub(crate) fn read(
        &mut self,
        now: Ticks,
        addr: u32,
        width: Width,
        board: &dyn Board,
    ) -> Result<u32, BusError> {
        let word = if addr.is_multiple_of(width.bytes()) {
            self.read_word(now, addr & !3, board)
        } else {
            Err(Refusal::Misaligned)
        };
        let shifted = word.map_err(|refusal| refused(addr, refusal))? >> (8 * (addr & 3));
        Ok(shifted & u32::MAX >> (32 - 8 * width.bytes()))
    }

    fn read_word(&mut self, now: Ticks, addr: u32, board: &dyn Board) -> Read {
        if (0x0080_0000..0x0100_0000).contains(&addr) {
            return self.nvmctrl.read_auxiliary(addr).ok_or(Refusal::Unmapped);
        }
        let entry = self.locate(addr)?;
        let offset = entry.offset(addr);
        match entry.block {
            Block::Pac(index) => self.pac.read(index, offset),
            Block::Pm => self.pm.read(offset),
            Block::Sysctrl => self.sysctrl.read(now, offset),
            Block::Gclk => self.gclk.read(now, offset),
            Block::Dsu => self.dsu.read(now, offset),
            Block::Eic => self.eic.read(now, offset),
            Block::Nvmctrl => self.nvmctrl.read(now, offset),
            Block::Port => {
                let word = self.port.read(now, offset, board)?;
                let is_held = self.sercom.iter().any(|sercom| sercom.holds_scl(now));
                let scl = board.i2c_pins().map(|lines| lines.scl).filter(|_| is_held);
                Ok(word & !scl.map_or(0, |scl| port::input_mask(scl, offset)))
            }
            Block::Sercom(index) => self.sercom[index].read(now, offset, board),
            Block::Tc(index) => self.tc[index].read(now, offset),
            Block::Tcc(index) => self.tcc[index].read(now, offset),
            Block::Usb => self.usb.read(now, offset),
            Block::Wdt => self.wdt.read(offset),
            Block::Adc => self.adc.read(offset),
            Block::Dmac => self.priorities.read_dmac(offset),
            Block::Matrix => self.priorities.read_matrix(offset),
            Block::Unmodelled => Err(Refusal::Unmodelled("the whole peripheral")),
        }
    }

    /// How long reading at `addr` stalls the bus.
    pub(crate) fn read_stall(&self, addr: u32) -> Ticks {
        let is_count = addr & 0x3FC == tc::COUNT;
        let count = match is_count.then(|| map::find(addr)).flatten() {
            Some(Entry { block: Block::Tc(index), .. }) => {
                Ticks((self.tc[*index].count_stall_cycles() * self.cycle) >> FRACTION)
            }
            _ => Ticks::ZERO,
        };
        count + self.bridge_stall(addr)
    }

    /// How long an APB bridge stalls the bus for an access at `addr`.
    pub(crate) fn bridge_stall(&self, addr: u32) -> Ticks {
        match addr >> 24 {
            0x40..=0x42 => self.options.bridge_stall,
            _ => Ticks::ZERO,
        }
    }

    /// Writes a register, or, in the address range of the flash, the page buffer. Returns how long
    /// the bus stalls the CPU beyond the access itself. What was due until `now` has run.
    pub(crate) fn write(
        &mut self,
        now: Ticks,
        addr: u32,
        width: Width,
        value: u32,
        memory: &mut Memory,
        board: &mut dyn Board,
    ) -> Result<Ticks, BusError> {
        let bus = &mut Bus { now, board, violations: &mut self.violations };
        let stall = if !addr.is_multiple_of(width.bytes()) {
            Err(Refusal::Misaligned)
        } else if addr < FLASH_SIZE {
            self.nvmctrl.load_page_buffer(bus, addr, width.bytes(), value, memory)
        } else {
            let lanes = Lanes::new(value, addr & 3, width.bytes());
            self.write_word(now, addr & !3, lanes, memory, board)
        };
        if let Ok(time) = stall {
            self.dsu.hold(now, time);
        }
        stall.map_err(|refusal| refused(addr, refusal))
    }

    fn write_word(
        &mut self,
        now: Ticks,
        addr: u32,
        lanes: Lanes,
        memory: &mut Memory,
        board: &mut dyn Board,
    ) -> Write {
        let entry = self.locate(addr)?;
        if self.pac.protects(entry.bridge, entry.index) {
            return Err(Refusal::Protected);
        }
        let bus = &mut Bus { now, board, violations: &mut self.violations };
        let offset = entry.offset(addr);
        let stall = match entry.block {
            Block::Pac(index) => self.pac.write(index, offset, lanes),
            Block::Pm => self.pm.write(offset, lanes),
            Block::Sysctrl => {
                let reference = entry.clock.and_then(|id| self.gclk.clock(id));
                self.sysctrl.write(bus, offset, lanes, reference.is_some())
            }
            Block::Gclk => self.gclk.write(bus, offset, lanes),
            Block::Dsu => self.dsu.write(bus, offset, lanes, memory, self.cycle),
            Block::Eic => self.eic.write(bus, offset, lanes, &self.port),
            Block::Nvmctrl => self.nvmctrl.write(bus, offset, lanes, memory),
            Block::Port => self.port.write(bus, offset, lanes),
            Block::Sercom(index) => self.sercom[index].write(bus, offset, lanes),
            Block::Tc(index) => self.tc[index].write(bus, offset, lanes),
            Block::Tcc(index) => self.tcc[index].write(bus, offset, lanes),
            Block::Usb => self.usb.write(bus, offset, lanes),
            Block::Wdt => self.wdt.write(bus, offset, lanes),
            Block::Adc => self.adc.write(bus, offset, lanes),
            Block::Dmac => self.priorities.write_dmac(offset, lanes),
            Block::Matrix => self.priorities.write_matrix(offset, lanes),
            Block::Unmodelled => Err(Refusal::Unmodelled("the whole peripheral")),
        }?;
        let has_clocks = matches!(entry.block, Block::Pm | Block::Sysctrl | Block::Gclk);
        if has_clocks && !self.retime(now) {
            return Err(Refusal::Forbidden("generator 0, the CPU's clock, stands still"));
        }
        match entry.block {
            Block::Tcc(index) => self.drive(now, index, board),
            Block::Tc(_) => self.tc[2].is_slave = self.tc[1].is_32_bits(),
            Block::Port => self.connect_pads(board),
            _ => {}
        }
        self.check_flash(now);
        self.refresh(now);
        Ok(stall)
    }

    /// The pins of a TCC follow its outputs.
    fn drive(&mut self, now: Ticks, tcc: usize, board: &mut dyn Board) {
        let outputs = self.tcc[tcc].outputs();
        self.port.drive(now, tcc as u8, outputs, board);
    }

    /// The peripheral at `addr`, if its bus clock runs.
    fn locate(&self, addr: u32) -> Result<&'static Entry, Refusal> {
        let entry = map::find(addr).ok_or(Refusal::Unmapped)?;
        if entry.block != Block::Unmodelled && !self.pm.is_clocked(entry.bridge, entry.index) {
            return Err(Refusal::Unclocked);
        }
        Ok(entry)
    }

    /// The multiplexers of pins may have changed: the SERCOM that they connect to the board's I2C
    /// bus, and whether USB has its pads.
    fn connect_pads(&mut self, board: &dyn Board) {
        let master = board.i2c_pins().and_then(|lines| self.port.i2c_master(lines));
        for (index, sercom) in self.sercom.iter_mut().enumerate() {
            sercom.connected = master == Some(index);
        }
        self.usb.pads = self.port.usb_routed();
    }

    /// The USB host's start-of-frame packet arrives, which the DFLL may lock to.
    pub(crate) fn start_of_frame(&mut self, now: Ticks) {
        if self.sysctrl.start_of_frame(now) {
            self.retime(now);
        }
    }

    /// Runs what is due at `due`, or at the last event's time if that was later. Returns the time
    /// at which it ran.
    pub(crate) fn run(&mut self, due: Ticks, board: &mut dyn Board) -> Ticks {
        let now = due.max(self.last);
        self.last = now;
        self.port.publish_pending(now, board);
        if let Some(cut) = self.cut.take() {
            board.i2c_cut(now, cut);
        }
        if self.sysctrl.next(now.saturating_sub(Ticks(1))) == now {
            self.sysctrl.advance(now);
            self.retime(now);
        }
        let bus = &mut Bus { now, board, violations: &mut self.violations };
        for sercom in &mut self.sercom {
            if sercom.next() <= now {
                sercom.advance(bus);
            }
        }
        for (index, tcc) in self.tcc.iter_mut().enumerate() {
            if tcc.next() <= now {
                tcc.advance(now);
                self.port.drive(now, index as u8, tcc.outputs(), bus.board);
            }
        }
        if self.eic.next_sample <= now {
            self.eic.advance(bus, &self.port);
        }
        for tc in &mut self.tc {
            if tc.next() <= now {
                tc.advance(now);
            }
        }
        self.usb.advance(now);
        if self.wdt.next() <= now {
            self.wdt.advance(now);
        }
        now
    }

    /// Hands new clock rates on after a change; false if the CPU is left without a clock.
    fn retime(&mut self, now: Ticks) -> bool {
        self.gclk.resolve(now, &self.sysctrl);
        let slow = self.gclk.clock(SERCOM_SLOW).is_some();
        for entry in &map::ENTRIES {
            let Some(id) = entry.clock else { continue };
            let clock = self.gclk.clock(id);
            match entry.block {
                Block::Sercom(index) => self.sercom[index].set_clocks(now, clock, slow),
                Block::Tcc(index) => self.tcc[index].set_clock(now, clock),
                Block::Tc(index) => self.tc[index].set_clock(now, clock),
                Block::Eic => self.eic.set_clock(now, clock.is_some()),
                Block::Usb => self.usb.set_clock(now, clock),
                Block::Wdt => self.wdt.set_clock(now, clock),
                _ => {}
            }
        }
        let Some(main) = self.gclk.main() else {
            return false;
        };
        self.cycle = main.divided(self.pm.cpu_divisor()).cycle();
        true
    }

    /// Changes an oscillator.
    pub(crate) fn disturb(&mut self, now: Ticks, change: impl FnOnce(&mut sysctrl::Sysctrl)) {
        change(&mut self.sysctrl);
        self.retime(now);
        self.refresh(now);
    }

    /// See [`Chip::set_slow_oscillator`](crate::Chip::set_slow_oscillator).
    pub(crate) fn set_slow_oscillator(&mut self, now: Ticks, hz: u32) {
        self.options.osculp32k_hz = hz;
        self.disturb(now, |sysctrl| sysctrl.osculp32k_hz = hz);
    }

    /// See [`Chip::set_supply`](crate::Chip::set_supply).
    pub(crate) fn set_supply(&mut self, now: Ticks, mv: u32) -> bool {
        self.disturb(now, |sysctrl| sysctrl.bod33.set_supply(mv));
        self.pending_reset.take_if(|cause| *cause == ResetCause::BrownOut33).is_some()
    }

    /// See [`Chip::flip_register`](crate::Chip::flip_register).
    pub(crate) fn flip(&mut self, now: Ticks, addr: u32, bit: u8, board: &mut dyn Board) -> bool {
        let Ok(entry) = self.locate(addr) else {
            return false;
        };
        let (offset, bit) = (entry.offset(addr), u32::from(bit % 32));
        let flipped = match entry.block {
            Block::Pm => self.pm.flip(offset, bit),
            Block::Sysctrl => self.sysctrl.flip(offset, bit),
            Block::Gclk => self.gclk.flip(offset, bit),
            Block::Sercom(index) => self.sercom[index].flip(offset, bit),
            Block::Tcc(index) => {
                let flipped = self.tcc[index].flip(now, offset, bit);
                self.drive(now, index, board);
                flipped
            }
            Block::Dsu => self.dsu.flip(now, offset, bit),
            Block::Usb => self.usb.flip(offset, bit),
            Block::Wdt => self.wdt.flip(now, offset, bit),
            Block::Port => self.flip_port(now, offset, bit, board),
            _ => false,
        };
        if flipped {
            self.retime(now);
            self.refresh(now);
        }
        flipped
    }

    /// PORT's registers are written as they are read.
    fn flip_port(&mut self, now: Ticks, offset: u32, bit: u32, board: &mut dyn Board) -> bool {
        let stored = matches!(offset & 0x7F, 0x00 | 0x10 | 0x30..0x60);
        let Some(word) = stored.then(|| self.port.read(now, offset, board).ok()).flatten() else {
            return false;
        };
        let bus = &mut Bus { now, board, violations: &mut self.violations };
        let flipped = Lanes::new(word ^ 1 << bit, 0, 4);
        // What is refused has been written nonetheless.
        let _ = self.port.write(bus, offset, flipped);
        let now_read = self.port.read(now, offset, board);
        self.connect_pads(board);
        now_read.is_ok_and(|read| read != word)
    }

    /// Notes when the CPU begins to outrun the flash, which needs a wait state above 24 MHz (at
    /// 3.3 V).
    fn check_flash(&mut self, now: Ticks) {
        let overrun = self.cycle < 2 << FRACTION && self.nvmctrl.wait_states() == 0;
        if overrun && !self.flash_overrun {
            self.violations.note(now, "NVMCTRL", "flash without a wait state above 24 MHz");
        }
        self.flash_overrun = overrun;
    }

    /// Works out `next` and `irq_lines`, and takes resets that are asked for.
    pub(crate) fn refresh(&mut self, now: Ticks) {
        if self.wdt.take_bite() {
            self.pending_reset = Some(ResetCause::Watchdog);
        }
        if self.sysctrl.bod33.take_reset() {
            self.pending_reset = Some(ResetCause::BrownOut33);
        }
        let mut next = self.sysctrl.next(now).min(self.nvmctrl.next(now));
        next = next.min(self.eic.next_sample).min(self.usb.next());
        next = next.min(self.wdt.next());
        let mut lines =
            self.pm.interrupts.irq() | self.sysctrl.interrupts.irq() | self.wdt.interrupts.irq();
        lines |= self.adc.interrupts.irq()
            | self.eic.interrupts.irq()
            | self.nvmctrl.irq(now)
            | self.usb.irq();
        for sercom in &self.sercom {
            next = next.min(sercom.next());
            lines |= sercom.irq();
        }
        for tcc in &self.tcc {
            next = next.min(tcc.next());
            lines |= tcc.interrupts.irq();
        }
        for tc in &self.tc {
            next = next.min(tc.next());
            lines |= tc.interrupts.irq();
        }
        self.next = next;
        self.irq_lines = lines;
    }
}

/// Adds to a refusal where it was.
#[cold]
fn refused(addr: u32, refusal: Refusal) -> BusError {
    let peripheral =
        if addr < FLASH_SIZE { "NVMCTRL" } else { map::find(addr).map_or("", |entry| entry.name) };
    BusError { addr, peripheral, refusal }
}
