//! The peripherals driven by addresses, as firmware does: for tests.

use crate::Options;
use crate::board::{Board, Ticks, Unconnected};
use crate::bus::Bus;
use crate::memory::Memory;
use crate::peripherals::{BusError, Peripherals, ResetCause, Width};
use crate::usb_host::{Host, System};

pub(crate) const PM_APBCMASK: u32 = 0x4000_0420;
pub(crate) const SYSCTRL: u32 = 0x4000_0800;
pub(crate) const GCLK: u32 = 0x4000_0C00;
pub(crate) const NVMCTRL: u32 = 0x4100_4000;
pub(crate) const PORT: u32 = 0x4100_4400;

/// Peripherals, memory, USB host, board and time.
#[derive(Clone)]
pub(crate) struct Bench<B: Board = Unconnected> {
    pub(crate) peripherals: Peripherals,
    pub(crate) memory: Memory,
    pub(crate) usb_host: Host,
    pub(crate) board: B,
    pub(crate) now: Ticks,
}

impl<B: Board> Bench<B> {
    pub(crate) fn new(hold: Ticks, board: B) -> Self {
        let options = Options { syncbusy_hold: hold, ..Options::default() };
        Self::with(&options, board)
    }

    pub(crate) fn with(options: &Options, board: B) -> Self {
        Self {
            peripherals: Peripherals::new(options),
            memory: Memory::new(1),
            usb_host: Host::of(System::Bare),
            board,
            now: Ticks::ZERO,
        }
    }

    pub(crate) fn bus(&mut self) -> Bus<'_> {
        Bus {
            memory: &mut self.memory,
            peripherals: &mut self.peripherals,
            usb_host: &mut self.usb_host,
            board: &mut self.board,
        }
    }

    pub(crate) fn try_read(&mut self, addr: u32, width: Width) -> Result<u32, BusError> {
        self.pass(Ticks(2));
        let now = self.now;
        self.bus().read(now, addr, width).map(|(value, _)| value)
    }

    pub(crate) fn try_write(
        &mut self,
        addr: u32,
        width: Width,
        value: u32,
    ) -> Result<Ticks, BusError> {
        self.pass(Ticks(2));
        let now = self.now;
        let stall = self.bus().write(now, addr, width, value)?;
        self.pass(stall);
        Ok(stall)
    }

    pub(crate) fn r8(&mut self, addr: u32) -> u8 {
        self.try_read(addr, Width::Byte).unwrap() as u8
    }

    pub(crate) fn r16(&mut self, addr: u32) -> u16 {
        self.try_read(addr, Width::Half).unwrap() as u16
    }

    pub(crate) fn r32(&mut self, addr: u32) -> u32 {
        self.try_read(addr, Width::Word).unwrap()
    }

    pub(crate) fn w8(&mut self, addr: u32, value: u8) -> Ticks {
        self.try_write(addr, Width::Byte, u32::from(value)).unwrap()
    }

    pub(crate) fn w16(&mut self, addr: u32, value: u16) -> Ticks {
        self.try_write(addr, Width::Half, u32::from(value)).unwrap()
    }

    pub(crate) fn w32(&mut self, addr: u32, value: u32) -> Ticks {
        self.try_write(addr, Width::Word, value).unwrap()
    }

    /// Resets the peripherals.
    pub(crate) fn reset(&mut self, cause: ResetCause) {
        self.peripherals.reset(self.now, cause, &mut self.memory);
    }

    /// Lets time pass.
    pub(crate) fn pass(&mut self, time: Ticks) {
        self.now += time;
        let now = self.now;
        self.bus().advance(now);
        self.bus().settle(now);
    }

    /// Polls a register until all bits of `mask` are as `set` says.
    pub(crate) fn wait(&mut self, addr: u32, width: Width, mask: u32, set: bool) {
        let begin = self.now;
        loop {
            let bits = self.try_read(addr, width).unwrap() & mask;
            if bits == if set { mask } else { 0 } {
                return;
            }
            assert!(
                self.now < begin + Ticks::from_ms(50),
                "{addr:#010x} stays {bits:#x} of {mask:#x}"
            );
            self.pass(Ticks(20));
        }
    }

    fn wait_gclk(&mut self) {
        self.wait(GCLK + 1, Width::Byte, 0x80, false);
    }

    /// 48 MHz the way the HAL's `with_internal_32kosc` starts it.
    pub(crate) fn start_clocks(&mut self) {
        let ctrlb = self.r32(NVMCTRL + 4);
        self.w32(NVMCTRL + 4, ctrlb | 1 << 1);
        self.w32(NVMCTRL + 4, ctrlb | 1 << 1 | 1 << 7);
        self.w32(0x4000_0418, 0x7F);
        let osc32k = 0x2E << 16 | 6 << 8 | 1 << 6 | 1 << 2 | 1 << 1;
        self.w32(SYSCTRL + 0x18, osc32k);
        self.wait(SYSCTRL + 0x0C, Width::Word, 1 << 2, true);
        self.w8(GCLK, 1);
        self.wait(GCLK, Width::Byte, 1, false);
        self.wait_gclk();
        self.generator(1, 4, 1);
        self.route(0, 1);
        self.w16(SYSCTRL + 0x24, 0);
        self.wait(SYSCTRL + 0x0C, Width::Word, 1 << 4, true);
        self.w32(SYSCTRL + 0x28, 0x1F << 10 | 0x1FF);
        self.w32(SYSCTRL + 0x2C, 7 << 26 | 10 << 16 | 48_000);
        let mode = 1 << 10 | 1 << 8 | 1 << 5 | 1 << 2;
        self.w16(SYSCTRL + 0x24, mode);
        self.wait(SYSCTRL + 0x0C, Width::Word, 1 << 4, true);
        self.w16(SYSCTRL + 0x24, mode | 1 << 1);
        self.wait(SYSCTRL + 0x0C, Width::Word, 1 << 4, true);
        self.generator(0, 7, 1);
        let osc8m = self.r32(SYSCTRL + 0x20);
        self.w32(SYSCTRL + 0x20, osc8m & !(3 << 8 | 1 << 7));
        for select in 0..4 {
            self.w8(0x4000_0408 + select, 0);
        }
    }

    /// Divides a source onto a generator and enables it.
    pub(crate) fn generator(&mut self, id: u32, source: u32, div: u32) {
        self.w32(GCLK + 8, id | div << 8);
        self.wait_gclk();
        self.w32(GCLK + 4, id | source << 8 | 1 << 16 | 1 << 17 | 1 << 19);
        self.wait_gclk();
    }

    /// Routes a generator to a peripheral clock.
    pub(crate) fn route(&mut self, id: u16, generator: u16) {
        self.w16(GCLK + 2, id | generator << 8 | 1 << 14);
        self.wait_gclk();
    }

    /// Gives a pin to a peripheral function, as the HAL does.
    pub(crate) fn multiplex(&mut self, group: u32, pin: u32, function: u32) {
        let value = (pin >> 4) << 31 | 1 << 30 | 1 << 28 | function << 24 | 1 << 16;
        self.w32(PORT + 0x80 * group + 0x28, value | 1 << (pin & 15));
    }
}
