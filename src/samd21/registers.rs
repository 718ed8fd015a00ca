//! The registers that must not change by themselves, in one table (addresses as in the data sheet).
//!
//! Those on which the pulses, the processor and the ticks depend are compared after every step,
//! behind its pulses; of the others [`AT_ONCE`] a step, all within five steps: 34 ms at 150 Hz.
//! What the flight itself changes is not here: the compare registers and the timer's period
//! ([`super::frame`]), and the DFLL, which start-of-frame tunes ([`super::dfll`]).

use atsamd_hal::pac::Interrupt;
use tvc_nano::registers::{Access, Patrol, Register, Width};

use super::i2c;
use crate::boards::WIRING;

/// Rows that are compared after every step.
const ALWAYS: usize = 25;
/// Rows of the servos' pins, the last ones.
const SERVO_ROWS: usize = 4;
/// Of the others, this number a step.
const AT_ONCE: usize = 4;

const PM: u32 = 0x4000_0400;
const GCLK: u32 = 0x4000_0C00;
const WDT: u32 = 0x4000_1000;
const TCC0: u32 = 0x4200_2000;
const SYSTICK: u32 = 0xE000_E010;
const RELOAD: u32 = SYSTICK + 4;
const NVIC_ENABLE: u32 = 0xE000_E100;
const NVIC_PRIORITY: u32 = 0xE000_E400;

/// GENDIV of a generator: 0 is the processor's and its peripherals', 1 that of the DFLL's
/// reference, 7 the watchdog's.
const fn division(id: u8) -> Register {
    word(GCLK + 8).of(id)
}

/// GENCTRL of one.
const fn generator(id: u8) -> Register {
    word(GCLK + 4).of(id)
}

/// CLKCTRL of a clock.
const fn clock(id: u8) -> Register {
    Register::new(GCLK + 2, Width::Half).of(id)
}

const fn word(at: u32) -> Register {
    Register::new(at, Width::Word)
}

const fn byte(at: u32) -> Register {
    Register::new(at, Width::Byte)
}

/// The lines of the flight in the NVIC; USB's is masked now and then.
const FLIGHT: u32 = 1 << Interrupt::WDT as u32 | 1 << Interrupt::TCC0 as u32 | 1 << i2c::INTERRUPT;

/// TC5's bus, which `bringup` turns on.
const SLOW_COUNTER_BUS: u32 = 1 << 13;

/// By how much the processor and its buses are slower than generator 0: CPUSEL to APBCSEL.
const DIVIDERS: Register = word(PM + 0x08);

const TABLE: [Register; 43] = [
    // TCC0: CTRLA, CTRLBSET, FCTRLA, FCTRLB, WEXCTRL, DRVCTRL, EVCTRL, PATT and WAVE; of STATUS,
    // STOP, DFS, PATTBV, WAVEBV and the states of faults.
    word(TCC0).stops(),
    byte(TCC0 + 0x05).stops(),
    word(TCC0 + 0x0C).stops(),
    word(TCC0 + 0x10).stops(),
    word(TCC0 + 0x14).stops(),
    word(TCC0 + 0x18).stops(),
    word(TCC0 + 0x20).stops(),
    Register::new(TCC0 + 0x38, Width::Half).stops(),
    word(TCC0 + 0x3C).stops(),
    word(TCC0 + 0x30).bits(0xF069).stops(),
    // The watchdog: ENABLE and WEN, PER, EWOFFSET; INTENSET.EW.
    word(WDT).bits(0x000F_0F06).stops(),
    byte(WDT + 5).bits(1).stops(),
    // The brown-out detector (BOD33).
    word(0x4000_0834),
    DIVIDERS,
    // AHBMASK and APBxMASK.
    word(PM + 0x14),
    word(PM + 0x18),
    word(PM + 0x1C),
    word(PM + 0x20).bits(!SLOW_COUNTER_BUS),
    division(0),
    generator(0),
    // The clocks of the servo's timer and of the sensor's bus.
    clock(0x1A),
    clock(i2c::CLOCK_ID),
    word(NVIC_ENABLE).bits(FLIGHT),
    // RVR, and of CSR what it counts and that it interrupts.
    word(RELOAD),
    word(SYSTICK).bits(0b111),
    // From here on, in turn. The clocks of the watchdog and of USB.
    division(1),
    generator(1),
    division(7),
    generator(7),
    clock(0x03),
    clock(0x06),
    // The priorities of lines 0 to 3 and 8 to 15.
    word(NVIC_PRIORITY),
    word(NVIC_PRIORITY + 8),
    word(NVIC_PRIORITY + 12),
    // USB.DESCADD: the controller would take other memory for its banks, and write there.
    word(0x4100_5024),
    // The sensor's lines and the servos' pins.
    WIRING.bus.sda.function(),
    WIRING.bus.sda.settings(),
    WIRING.bus.scl.function(),
    WIRING.bus.scl.settings(),
    WIRING.servos[0].pin.function(),
    WIRING.servos[0].pin.settings(),
    WIRING.servos[1].pin.function(),
    WIRING.servos[1].pin.settings(),
];

/// What makes the processor's frequency from the DFLL's, and the value of its bits: no divider, and
/// generator 0 runs (GENEN) from the DFLL (SRC 7), undivided (DIV 0 or 1, no DIVSEL).
const PROCESSOR: [(Register, u32); 3] = [
    (DIVIDERS, 0),
    (division(0).bits(0x00FF_FE00), 0),
    (generator(0).bits(0x0011_1F00), 0x0001_0700),
];

/// The same of the watchdog: generator 7 runs from OSCULP32K (SRC 3), by 32.
const WATCHDOG: [(Register, u32); 2] =
    [(division(7).bits(0x00FF_FF00), 32 << 8), (generator(7).bits(0x0011_1F00), 0x0001_0300)];

/// Whether the processor runs at the DFLL's frequency.
pub(crate) fn is_processor_right() -> bool {
    let mut rows = PROCESSOR.iter();
    rows.all(|(register, value)| (Bus.read(register) ^ value) & register.mask == 0)
}

/// Has processor and watchdog run at their frequencies, should a register have lost that.
pub(crate) fn restore_clocks() {
    for (register, value) in PROCESSOR.iter().chain(&WATCHDOG) {
        let now = Bus.read(register);
        if (now ^ value) & register.mask != 0 {
            Bus.write(register, now & !register.mask | value);
        }
    }
}

/// Compares them.
pub(crate) struct Registers(Patrol<{ TABLE.len() }>);

impl Registers {
    /// As they are now: once all is set up.
    pub(crate) fn new() -> Self {
        Self(Patrol::new(&TABLE, ALWAYS, AT_ONCE, &mut Bus))
    }

    /// A servo's pin has been given to the timer, or has not.
    pub(crate) fn renew_servos(&mut self) {
        self.0.renew(TABLE.len() - SERVO_ROWS, &mut Bus);
    }

    /// Puts right what can be; `false` if only a reset does.
    #[must_use]
    pub(crate) fn look(&mut self) -> bool {
        self.0.look(&mut Bus)
    }
}

/// The chip's buses.
struct Bus;

impl Access for Bus {
    #[inline]
    fn read(&mut self, register: &Register) -> u32 {
        let at = register.at as usize;
        // SAFETY: a register of the table, that is always mapped and that reading does not change;
        // the byte selects what shows, and after start-up only the main loop comes here.
        unsafe {
            if let Some(select) = register.select {
                (at as *mut u8).write_volatile(select);
            }
            match register.width {
                Width::Byte => (at as *const u8).read_volatile().into(),
                Width::Half => (at as *const u16).read_volatile().into(),
                Width::Word => (at as *const u32).read_volatile(),
            }
        }
    }

    fn write(&mut self, register: &Register, value: u32) {
        let at = register.at as usize;
        // SAFETY: as it was; where a byte selects, the value has it in it.
        unsafe {
            match register.width {
                Width::Byte => (at as *mut u8).write_volatile(value as u8),
                Width::Half => (at as *mut u16).write_volatile(value as u16),
                Width::Word => (at as *mut u32).write_volatile(value),
            }
            if register.at == RELOAD {
                // What counts down from another value begins anew.
                cortex_m::Peripherals::steal().SYST.clear_current();
            }
        }
    }
}
