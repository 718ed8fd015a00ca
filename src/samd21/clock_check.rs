//! The registers that make clocks, held against what start-up has left in them: what a flipped bit
//! has changed is written anew, or ends in a reset.

use atsamd_hal::pac;
use tvc_nano::SelfCheck;

use super::clocks::{set_dfll as set, sysctrl};
use super::i2c;
use super::time::soon;

/// Generators of GCLK: the processor's and its peripherals', that of the DFLL's reference, and the
/// watchdog's.
const GENERATORS: [u8; 3] = [0, 1, 4];
/// CLKCTRL.ID of the watchdog, USB, the sensor bus and the servo's timer.
const CLOCKS: [u8; 4] = [0x03, 0x06, i2c::CLOCK_ID, 0x1A];

/// GCLK's registers that stand for all clocks or generators: a byte that is written to one selects
/// which it shows. The PAC's writers know no other than by its name.
const CLKCTRL: *mut u16 = 0x4000_0C02 as *mut u16;
const GENCTRL: *mut u32 = 0x4000_0C04 as *mut u32;
const GENDIV: *mut u32 = 0x4000_0C08 as *mut u32;
/// PM.CPUSEL to APBCSEL: by how much the processor and its buses are slower than generator 0.
const DIVIDERS: *mut u32 = 0x4000_0408 as *mut u32;

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
pub(crate) struct ClockCheck {
    dividers: u32,
    /// AHBMASK and APBxMASK.
    buses: [u32; 4],
    generators: [Generator; GENERATORS.len()],
    clocks: [u16; CLOCKS.len()],
    dfll: u16,
    coarse: u8,
    /// The DFLL's FINE at the newest look.
    fine: u16,
    brown_out: u32,
    /// The generator and the clock that are looked at next.
    next: usize,
}

/// GENCTRL and GENDIV of a generator.
#[derive(Clone, Copy, PartialEq, Eq)]
struct Generator {
    control: u32,
    division: u32,
}

impl Generator {
    fn read(id: u8) -> Self {
        // SAFETY: reads what the byte selects; after start-up only the main loop comes here.
        let [control, division] = [GENCTRL, GENDIV].map(|register| unsafe {
            register.cast::<u8>().write_volatile(id);
            register.read_volatile()
        });
        Self { control, division }
    }

    /// Sets the generator with this ID as it was, if it is another.
    fn restore(self, id: u8) {
        if Self::read(id) != self {
            // SAFETY: as it was; the values have the ID in them.
            unsafe {
                GENDIV.write_volatile(self.division);
                GENCTRL.write_volatile(self.control);
            }
        }
    }
}

impl ClockCheck {
    /// What is set now.
    pub(crate) fn new() -> Self {
        Self {
            dividers: dividers(),
            buses: buses(),
            generators: GENERATORS.map(Generator::read),
            clocks: CLOCKS.map(clock),
            dfll: sysctrl().dfllctrl().read().bits(),
            coarse: coarse(),
            fine: fine(),
            brown_out: sysctrl().bod33().read().bits(),
            next: 0,
        }
    }

    /// Looks at all that the processor and the timer depend on at once, and at one of the other
    /// generators and clocks; sets what has changed as it was.
    ///
    /// # Errors
    /// What only a reset puts right: the DFLL runs at a frequency of its own, or the brown-out
    /// detector is not as it was set.
    pub(crate) fn put_right(&mut self) -> Result<(), SelfCheck> {
        if dividers() != self.dividers {
            // SAFETY: as it was.
            unsafe { DIVIDERS.write_volatile(self.dividers) };
        }
        self.turn_buses_on();
        let [main, ..] = self.generators;
        main.restore(GENERATORS[0]);
        self.next = (self.next + 1) % (GENERATORS.len() * CLOCKS.len());
        let (generator, client) = (self.next % GENERATORS.len(), self.next % CLOCKS.len());
        if let (Some(was), Some(id)) = (self.generators.get(generator), GENERATORS.get(generator)) {
            was.restore(*id);
        }
        if let (Some(was), Some(id)) = (self.clocks.get(client), CLOCKS.get(client))
            && clock(*id) != *was
        {
            // SAFETY: as it was; the value has the ID in it.
            unsafe { CLKCTRL.write_volatile(*was) };
        }
        self.check_dfll()?;
        if sysctrl().bod33().read().bits() != self.brown_out {
            return Err(SelfCheck::Registers);
        }
        Ok(())
    }

    /// A bus that is on beside those that were does no harm, and `bringup` turns one on for a
    /// timer.
    fn turn_buses_on(&self) {
        let now = buses();
        let mut wanted = now;
        for (bus, was) in wanted.iter_mut().zip(self.buses) {
            *bus |= was;
        }
        if now != wanted {
            let [ahb, a, b, c] = wanted;
            // SAFETY: the power manager's masks, and nothing off that was on; only the main loop
            // changes them.
            unsafe {
                let pm = &*pac::Pm::ptr();
                pm.ahbmask().write(|w| w.bits(ahb));
                pm.apbamask().write(|w| w.bits(a));
                pm.apbbmask().write(|w| w.bits(b));
                pm.apbcmask().write(|w| w.bits(c));
            }
        }
    }

    fn check_dfll(&mut self) -> Result<(), SelfCheck> {
        let dfll = sysctrl();
        if coarse() != self.coarse || dfll.dfllctrl().read().bits() != self.dfll {
            // The pulses up to the reset are to be right.
            set(dfll, self.coarse, self.fine, self.dfll);
            return Err(SelfCheck::Clock);
        }
        if fine().abs_diff(self.fine) > FINE_JUMP {
            set(dfll, self.coarse, self.fine, self.dfll);
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
    let Generator { control, division } = Generator::read(GENERATORS[0]);
    is_read
        && coarse() == fused
        && dividers() == 0
        && control & SOURCE_BITS == FROM_DFLL
        && division >> 8 <= 1
}

/// CLKCTRL of a clock.
fn clock(id: u8) -> u16 {
    // SAFETY: reads what the byte selects; after start-up only the main loop comes here.
    unsafe {
        CLKCTRL.cast::<u8>().write_volatile(id);
        CLKCTRL.read_volatile()
    }
}

fn dividers() -> u32 {
    // SAFETY: reads a register that is always mapped.
    unsafe { DIVIDERS.read_volatile() }
}

fn buses() -> [u32; 4] {
    // SAFETY: reads registers that are always mapped.
    let pm = unsafe { &*pac::Pm::ptr() };
    [
        pm.ahbmask().read().bits(),
        pm.apbamask().read().bits(),
        pm.apbbmask().read().bits(),
        pm.apbcmask().read().bits(),
    ]
}

/// The DFLL's coarse value as it was when it was asked for last.
fn coarse() -> u8 {
    sysctrl().dfllval().read().coarse().bits()
}

/// The same of its FINE.
fn fine() -> u16 {
    sysctrl().dfllval().read().fine().bits()
}
