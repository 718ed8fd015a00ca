//! Faults beyond the sensor: of the chip, of the program on it, and of the host.
//!
//! A flipped bit stays flipped: nothing ends it but the firmware or a reset, which restores what a
//! reset restores. A line that sticks, a clock that is off and a host that misbehaves last as long
//! as the fault does.

use client::request;
use rand::Rng;
use rand::seq::IndexedRandom;
use samd21::board::Ticks;
use samd21::upset::core_registers;
use tvc_nano::store;

use super::frames::{frame, valid_frame};
use super::judge::Blame;
use crate::fly::flight::{FlightError, Ready};
use crate::named_enum::named_enum;
use crate::rig::{ProgramEnd, Rig, SUPPLY_V};

named_enum! {
    /// A kind of fault beyond the sensor.
    SystemKind, "fault";
    /// A bit of the statics flips.
    RamStatics = "ram-statics",
    /// A bit of the stack that is in use flips.
    RamStack = "ram-stack",
    /// Up to eight bits of neighbouring words flip.
    RamBurst = "ram-burst",
    /// A bit of a register of the core flips while the program runs.
    CoreRegister = "core-register",
    /// A bit of the image in flash flips.
    FlashImage = "flash-image",
    /// A bit of the stored parameters flips, and the chip is reset.
    FlashParameters = "flash-parameters",
    /// A bit of the servo timer's registers flips.
    TimerRegister = "timer-register",
    /// A bit of the sensor bus' registers flips.
    BusRegister = "bus-register",
    /// A bit of a register of clocks and power flips.
    ClockRegister = "clock-register",
    /// A bit of a pin's registers flips.
    PinRegister = "pin-register",
    /// A bit of USB's registers flips.
    UsbRegister = "usb-register",
    /// A bit of the watchdog's registers flips.
    WatchdogRegister = "watchdog-register",
    /// A bit of SysTick or of the interrupt controller flips.
    InterruptRegister = "interrupt-register",
    /// A bit of the DSU's engine flips, which reads the image.
    EngineRegister = "engine-register",
    /// An interrupt line is always high.
    InterruptStorm = "interrupt-storm",
    /// An interrupt line is always low.
    InterruptLost = "interrupt-lost",
    /// The main clock stops.
    ClockStop = "clock-stop",
    /// The main clock runs up to 10 % too fast or too slow.
    ClockJump = "clock-jump",
    /// The program hangs, and interrupts go on.
    Hang = "hang",
    /// A handler of bus, frame or USB hangs.
    HangInterrupt = "hang-interrupt",
    /// The program hangs with interrupts held off.
    HangMasked = "hang-masked",
    /// The program meets what is no instruction.
    HardFault = "hard-fault",
    /// The stack grows into the statics.
    StackOverflow = "stack-overflow",
    /// A bit of the image flips that nothing executes: its check fails.
    FailedCheck = "failed-check",
    /// The supply dips, and the chip is reset at once.
    BrownOut = "brown-out",
    /// Somebody presses the reset button.
    ResetButton = "reset-button",
    /// The host orders a reboot, or the bootloader, which a vehicle that is armed refuses.
    Reboot = "reboot",
    /// The host sends noise as fast as it can.
    UsbFlood = "usb-flood",
    /// The host stops reading.
    UsbStall = "usb-stall",
    /// The cable comes out and in, and the bus is reset, again and again.
    UsbReplug = "usb-replug",
    /// The host suspends the bus and wakes it.
    UsbSuspend = "usb-suspend",
    /// The host resets the bus with the cable in, makes requests anew before they have ended, and
    /// misses acknowledgements.
    UsbErrors = "usb-errors",
    /// The host sends valid frames at random: any command, any parameter, any value.
    UsbFrames = "usb-frames",
    /// Two or three of the others at once.
    Several = "several",
}

impl SystemKind {
    /// Whether it is a flipped bit or a peripheral that fails: those of which the firmware itself
    /// has to notice, or to bear, all.
    pub fn is_upset(self) -> bool {
        self <= Self::ClockJump
    }

    /// Whether it resets the chip at once, from outside.
    fn resets(self) -> bool {
        matches!(self, Self::FlashParameters | Self::BrownOut | Self::ResetButton)
    }

    /// Which stray pulses count.
    fn blame(self) -> Blame {
        match self {
            Self::FlashParameters
            | Self::ClockStop
            | Self::HangMasked
            | Self::BrownOut
            | Self::ResetButton => Blame::None,
            Self::TimerRegister | Self::ClockRegister | Self::PinRegister => Blame::Last,
            _ => Blame::Each,
        }
    }

    /// Whether it may lose the stored parameters, which the next start tells.
    pub(super) fn spoils_store(self) -> bool {
        matches!(self, Self::FlashParameters | Self::Several)
    }

    /// Whether the host may change by it what the vehicle is told to do.
    pub(super) fn commands(self) -> bool {
        self == Self::UsbFrames
    }
}

/// A fault that was drawn: what it is, in words, and what it does while it lasts.
#[derive(Clone, Debug)]
pub(super) struct SystemFault {
    /// In words: which bit of what.
    pub(super) what: String,
    /// Which stray pulses count.
    pub(super) blame: Blame,
    kinds: Vec<SystemKind>,
    stuck: Vec<u8>,
    /// Error that the main clock has meanwhile.
    pub(super) shifted_ppm: f64,
}

const RAM: u32 = 0x2000_0000;
/// How far ahead the program is looked for awake.
const AWAKE_WITHIN: Ticks = Ticks::from_ms(20);
/// What is done by a host that misbehaves is done so often.
pub(super) const HOST_PERIOD: Ticks = Ticks::from_ms(1);

impl SystemFault {
    /// A bit of a register flips.
    pub(super) fn flip(kind: SystemKind, rig: &mut Rig, address: u32, bit: u8) -> Self {
        rig.flip_register(address, bit);
        Self { what: format!("{kind}: {}", self::bit(address, bit)), ..Self::of(kind.blame()) }
    }

    /// None yet.
    pub(super) fn of(blame: Blame) -> Self {
        Self { what: String::new(), blame, kinds: Vec::new(), stuck: Vec::new(), shifted_ppm: 0.0 }
    }

    /// Begins a fault of this kind, too.
    ///
    /// # Errors
    /// The rig stopped.
    pub(super) fn add(
        &mut self,
        kind: SystemKind,
        ready: &mut Ready,
        dice: &mut impl Rng,
    ) -> Result<(), FlightError> {
        let rig = &mut ready.rig;
        let what = match kind {
            SystemKind::RamStatics => {
                let statics = rig.image().sizes().static_ram;
                flip_ram(rig, RAM + dice.random_range(0..statics), dice.random_range(0..8))
            }
            SystemKind::RamStack => {
                let top = rig.image().stack_top();
                let used = rig.chip.registers().msp.clamp(RAM, top - 4)..top;
                flip_ram(rig, dice.random_range(used), dice.random_range(0..8))
            }
            SystemKind::RamBurst => {
                let statics = rig.image().sizes().static_ram;
                let first = dice.random_range(0..statics);
                let flips = dice.random_range(2..=8);
                let each: Vec<_> = (0..flips)
                    .map(|_| {
                        let address = RAM + (first + dice.random_range(0..16)) % statics;
                        flip_ram(rig, address, dice.random_range(0..8))
                    })
                    .collect();
                each.join(", ")
            }
            SystemKind::CoreRegister => flip_core(rig, dice)?,
            SystemKind::FlashImage => {
                let length = rig.image().bytes().len() as u32;
                let address = rig.image().address() + dice.random_range(0..length);
                flip_flash(rig, address, dice.random_range(0..8))
            }
            SystemKind::FlashParameters => {
                let place = dice.random_range(0..store::STORE_BYTES as u32);
                let what = flip_flash(rig, store::STORE_ADDRESS + place, dice.random_range(0..8));
                rig.press_reset();
                what
            }
            SystemKind::TimerRegister => flip_register(rig, TIMER, dice),
            SystemKind::BusRegister => flip_register(rig, BUS, dice),
            SystemKind::ClockRegister => flip_register(rig, CLOCKS, dice),
            SystemKind::PinRegister => flip_register(rig, PINS, dice),
            SystemKind::UsbRegister => flip_register(rig, USB, dice),
            SystemKind::WatchdogRegister => flip_register(rig, WATCHDOG, dice),
            SystemKind::InterruptRegister => flip_register(rig, INTERRUPTS, dice),
            SystemKind::EngineRegister => flip_register(rig, ENGINE, dice),
            SystemKind::InterruptStorm => {
                let line = dice.random_range(0..LINES);
                rig.chip.stick_interrupt(line, Some(true));
                self.stuck.push(line);
                format!("line {line} high")
            }
            SystemKind::InterruptLost => {
                let line = *USED_LINES.choose(dice).unwrap_or(&0);
                rig.chip.stick_interrupt(line, Some(false));
                self.stuck.push(line);
                format!("line {line} low")
            }
            SystemKind::ClockStop => {
                rig.chip.stop_dfll(true);
                "the DFLL stands still".into()
            }
            SystemKind::ClockJump => {
                let ppm = dice.random_range(-100_000.0..100_000.0_f64).round();
                rig.chip.shift_dfll(ppm);
                self.shifted_ppm += ppm;
                format!("the DFLL is {ppm} ppm off")
            }
            SystemKind::Hang => {
                run_into_loop(rig)?;
                end(rig, ProgramEnd::Hang)
            }
            SystemKind::HangInterrupt => {
                let line = *HANDLERS.choose(dice).unwrap_or(&15);
                run_into_handler(rig, line)?;
                format!("handler of line {line}, {}", end(rig, ProgramEnd::Hang))
            }
            SystemKind::HangMasked => {
                let what = end(rig, ProgramEnd::Hang);
                let mut registers = rig.chip.registers();
                registers.primask = true;
                rig.chip.set_registers(&registers);
                what + ", interrupts held off"
            }
            SystemKind::HardFault => end(rig, ProgramEnd::HardFault),
            SystemKind::StackOverflow => end(rig, ProgramEnd::StackOverflow),
            SystemKind::FailedCheck => {
                let address = rig.image().address() + RESERVED_VECTOR;
                flip_flash(rig, address + dice.random_range(0..4), dice.random_range(0..8))
            }
            SystemKind::BrownOut => {
                let volts = dice.random_range(1.6..2.7);
                let us = 10_f64.powf(dice.random_range(1.0..4.3));
                rig.set_supply(volts);
                rig.run_for(Ticks::from_us(us as u64))?;
                rig.set_supply(SUPPLY_V);
                format!("the supply dips to {volts:.2} V for {us:.0} us")
            }
            SystemKind::ResetButton => {
                rig.press_reset();
                "reset button".into()
            }
            SystemKind::Reboot => {
                let action = if dice.random() { 1.0 } else { 3.0 };
                let order = request::Order { params: [action, 0.0], ..request::REBOOT };
                rig.usb_write(&frame(&order.message()));
                format!("action {action}")
            }
            SystemKind::UsbFlood => "noise".into(),
            SystemKind::UsbStall => "nothing is read".into(),
            SystemKind::UsbReplug => "out and in".into(),
            SystemKind::UsbSuspend => "asleep and awake".into(),
            SystemKind::UsbErrors => "resets, aborted requests, lost acknowledgements".into(),
            SystemKind::UsbFrames => "valid frames at random".into(),
            SystemKind::Several => {
                let mut resets = 0;
                for _ in 0..dice.random_range(2..=3) {
                    let others = SystemKind::ALL.len() - 1;
                    let kind = SystemKind::ALL[dice.random_range(0..others)];
                    resets += u32::from(kind.resets());
                    // A host that gives orders is a kind of its own: what it leads to is no fault.
                    // Two resets at once are a double tap, which asks for the bootloader. The
                    // watchdog alone ends a hang with interrupts held off.
                    let is_unguarded = self.kinds.contains(&match kind {
                        SystemKind::HangMasked => SystemKind::WatchdogRegister,
                        SystemKind::WatchdogRegister => SystemKind::HangMasked,
                        _ => SystemKind::Several,
                    });
                    if !kind.commands() && !is_unguarded && (resets <= 1 || !kind.resets()) {
                        self.add(kind, ready, dice)?;
                    }
                }
                return Ok(());
            }
        };
        if !self.what.is_empty() {
            self.what += "; ";
        }
        self.what += &format!("{kind}: {what}");
        self.kinds.push(kind);
        self.blame = self.blame.max(kind.blame());
        Ok(())
    }

    /// What the host does every millisecond while the fault lasts.
    pub(super) fn act(&self, millisecond: u64, rig: &mut Rig, dice: &mut impl Rng) {
        for kind in &self.kinds {
            match kind {
                SystemKind::UsbFlood if rig.chip.usb_host.unsent() < 4096 => {
                    let noise: [u8; 512] = std::array::from_fn(|_| dice.random());
                    rig.usb_write(&noise);
                }
                SystemKind::UsbStall => rig.chip.usb_host.pause_reading(true),
                SystemKind::UsbReplug => match millisecond % 40 {
                    0 => rig.chip.usb_host.detach(),
                    4 => rig.chip.usb_host.attach(),
                    _ => {}
                },
                SystemKind::UsbSuspend => match millisecond % 20 {
                    0 => rig.chip.usb_host.suspend(),
                    10 => rig.chip.usb_host.resume(),
                    _ => {}
                },
                SystemKind::UsbErrors => {
                    let host = &mut rig.chip.usb_host;
                    host.lose_acknowledgement();
                    // Of some requests alone, so that others end.
                    if dice.random_bool(0.3) {
                        host.abort_request();
                    }
                    if millisecond % 200 == 100 {
                        host.reset_bus();
                    }
                }
                SystemKind::UsbFrames => rig.usb_write(&valid_frame(dice)),
                _ => {}
            }
        }
    }

    /// Ends what lasts: lines, clocks, the host.
    pub(super) fn end(&self, rig: &mut Rig) {
        for line in &self.stuck {
            rig.chip.stick_interrupt(*line, None);
        }
        if self.kinds.contains(&SystemKind::ClockStop) {
            rig.chip.stop_dfll(false);
        }
        if self.shifted_ppm != 0.0 {
            rig.chip.shift_dfll(-self.shifted_ppm);
        }
        let is_of_host = |kind| SystemKind::UsbFlood <= kind && kind <= SystemKind::UsbFrames;
        if self.kinds.iter().copied().any(is_of_host) {
            let host = &mut rig.chip.usb_host;
            host.pause_reading(false);
            host.resume();
            host.attach();
        }
    }
}

/// Runs on into the main loop with interrupts on: within a handler and with interrupts held off the
/// program hangs by kinds of their own.
fn run_into_loop(rig: &mut Rig) -> Result<(), FlightError> {
    /// Far longer than the loop stays out of either.
    const TRIES: usize = 10_000;
    for _ in 0..TRIES {
        let registers = rig.chip.registers();
        if !registers.primask && registers.xpsr & 0x1FF == 0 {
            break;
        }
        rig.run_for(Ticks(20))?;
    }
    Ok(())
}

fn end(rig: &mut Rig, end: ProgramEnd) -> String {
    let address = rig.end_program(end).unwrap_or_default();
    format!("at {address:#x}")
}

fn flip_ram(rig: &mut Rig, address: u32, bit: u8) -> String {
    if let Some(byte) = rig.chip.memory.ram_mut().get_mut((address - RAM) as usize) {
        *byte ^= 1 << bit;
    }
    format!("bit {bit} of {address:#x}{}", named(rig, address))
}

fn flip_flash(rig: &mut Rig, address: u32, bit: u8) -> String {
    let flipped = rig.chip.memory.flash()[address as usize] ^ 1 << bit;
    rig.chip.load_flash(address, &[flipped]);
    format!("bit {bit} of {address:#x}{}", named(rig, address))
}

/// In what of the image an address lies.
fn named(rig: &Rig, address: u32) -> String {
    let symbol = rig.image().symbol_at(address);
    symbol.map_or_else(String::new, |symbol| format!(" ({symbol})"))
}

/// A bit of R0 to R12, SP, LR, PC or the flags, while the program runs.
fn flip_core(rig: &mut Rig, dice: &mut impl Rng) -> Result<String, FlightError> {
    let limit = rig.now() + AWAKE_WITHIN;
    while rig.chip.is_asleep() && rig.now() < limit {
        rig.run_for(Ticks::from_us(20))?;
    }
    rig.run_for(Ticks(dice.random_range(0..2_000)))?;
    let mut registers = rig.chip.registers();
    let (which, bit) = (dice.random_range(0..17), dice.random_range(0..32));
    let mask = 1_u32 << bit;
    match which {
        13 => registers.msp ^= mask,
        16 => registers.xpsr ^= 1 << (28 + bit % 4),
        _ => registers.r[which] ^= mask,
    }
    rig.chip.set_registers(&registers);
    Ok(match which {
        16 => format!("flag {}", 28 + bit % 4),
        _ => format!("bit {bit} of r{which}"),
    })
}

/// A peripheral's first address, and the offsets of the registers whose bits flip.
type Registers = &'static [(u32, &'static [u32])];

/// All that can change a pulse.
const TIMER: Registers = &[(
    TIMER_BASE,
    &[
        0x00, 0x04, 0x0C, 0x10, 0x14, 0x18, 0x1C, 0x20, 0x28, 0x2C, 0x30, 0x34, 0x38, 0x3C, 0x40,
        0x44, 0x48, 0x4C, 0x50, 0x64, 0x68, 0x6C, 0x70, 0x74, 0x78, 0x7C,
    ],
)];
const TIMER_BASE: u32 = 0x4200_2000;
/// Their names, by a quarter of the offset.
const TIMER_NAMES: [&str; 32] = [
    "CTRLA", "CTRLB", "SYNCBUSY", "FCTRLA", "FCTRLB", "WEXCTRL", "DRVCTRL", "DBGCTRL", "EVCTRL",
    "INTENCLR", "INTENSET", "INTFLAG", "STATUS", "COUNT", "PATT", "WAVE", "PER", "CC0", "CC1",
    "CC2", "CC3", "", "", "", "", "PATTB", "WAVEB", "PERB", "CCB0", "CCB1", "CCB2", "CCB3",
];
const BUS: Registers = &[(0x4200_1800, &[0x00, 0x0C, 0x14, 0x24])];
/// The generators and clocks that are used, the dividers and masks, the DFLL and the brown-out
/// detector.
const CLOCKS: Registers = &[
    (0x4000_0C00, &[0x40, 0x44, 0x5C, 0x80, 0x84, 0x9C, 0x10C, 0x118, 0x160, 0x168]),
    (0x4000_0400, &[0x08, 0x14, 0x18, 0x1C, 0x20]),
    (0x4000_0800, &[0x24, 0x28, 0x34]),
];
/// Directions and levels of all pins; multiplexers and settings of those that are used: PA7, PA17,
/// PA24, PA25, PB8 to PB11.
const PINS: Registers = &[
    (0x4100_4400, &[0x00, 0x10, 0x3C, 0x44, 0x50, 0x58]),
    (0x4100_4480, &[0x00, 0x10, 0x34, 0x48]),
];
const USB: Registers =
    &[(0x4100_5000, &[0x00, 0x08, 0x18, 0x24, 0x100, 0x108, 0x120, 0x128, 0x140, 0x148])];
const WATCHDOG: Registers = &[(0x4000_1000, &[0x00, 0x04])];
const ENGINE: Registers = &[(0x4100_2000, &[0x00, 0x04, 0x08, 0x0C])];
const INTERRUPTS: Registers = &[
    (core_registers::SYST_CSR, &[0x0, 0x4]),
    (core_registers::NVIC_ISER, &[0x0]),
    (core_registers::NVIC_IPR, &[0x0, 0x4, 0x8, 0xC, 0x10, 0x14, 0x18]),
];

/// A bit of a register in words.
pub(super) fn bit(address: u32, bit: u8) -> String {
    let quarter = address.wrapping_sub(TIMER_BASE) as usize / 4;
    match TIMER_NAMES.get(quarter) {
        Some(name) => format!("bit {bit} of TCC0.{name}"),
        None => format!("bit {bit} of {address:#x}"),
    }
}

/// The bits of the servo timer that there are: address and bit.
pub(super) fn timer_bits(rig: &Rig) -> Vec<(u32, u8)> {
    let registers = TIMER.iter().flat_map(|(base, offsets)| {
        let addresses = offsets.iter().map(move |offset| base + offset);
        addresses.flat_map(|address| (0..32).map(move |bit| (address, bit)))
    });
    let mut fork = rig.clone();
    registers.filter(|(address, bit)| fork.flip_register(*address, *bit)).collect()
}

/// Runs until the handler of an interrupt line runs.
fn run_into_handler(rig: &mut Rig, line: u8) -> Result<(), FlightError> {
    let limit = rig.now() + AWAKE_WITHIN;
    let exception = 16 + u32::from(line);
    while rig.chip.registers().xpsr & 0x3F != exception && rig.now() < limit {
        rig.run_for(Ticks::from_us(1))?;
    }
    Ok(())
}

/// Lines whose handlers hang: SERCOM4, TCC0, USB.
const HANDLERS: [u8; 3] = [13, 15, 7];
/// Offset of a vector that the processor has no exception for, and that is no part of the seal.
const RESERVED_VECTOR: u32 = 0x28;

/// Interrupt lines of the chip.
const LINES: u8 = 28;
/// Those that the firmware uses: WDT, USB, SERCOM4, TCC0.
const USED_LINES: [u8; 4] = [2, 7, 13, 15];

/// Flips a bit of one of these registers, one that exists.
fn flip_register(rig: &mut Rig, registers: Registers, dice: &mut impl Rng) -> String {
    /// Far more than it takes to find a bit that exists.
    const TRIES: usize = 1_000;
    for _ in 0..TRIES {
        let Some((base, offsets)) = registers.choose(dice) else {
            break;
        };
        let address = base + offsets.choose(dice).unwrap_or(&0);
        let bit = dice.random_range(0..32);
        if rig.flip_register(address, bit) {
            return self::bit(address, bit);
        }
    }
    "no bit".into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kinds_have_names_of_their_own_and_are_found_by_them() {
        for (index, kind) in SystemKind::ALL.into_iter().enumerate() {
            assert_eq!(kind as usize, index);
            assert_eq!(kind.name().parse(), Ok(kind));
        }
        assert!("gremlins".parse::<SystemKind>().is_err());
        assert!(SystemKind::ClockJump.is_upset() && !SystemKind::Hang.is_upset());
    }
}
