//! Small programs written instruction by instruction, on a bare chip.
//!
//! Flash: vectors at 0, every unused one pointing to a BKPT; the program at 0x100; handlers from
//! 0x400, 0x100 apart. R3 points to SysTick, R4 to SCB, R5 to NVIC_ISER, R6 to NVIC_ISPR, R7 to
//! the log in SRAM: handlers leave R4 to R7 alone, and `log` appends a byte.

#![allow(dead_code, unreachable_pub)]

use samd21::board::{Ticks, Unconnected};
use samd21::chip::Stop;
use samd21::{Chip, Options};

pub const PROGRAM: u32 = 0x100;
pub const STACK_TOP: u32 = 0x2000_2000;
pub const LOG: u32 = 0x2000_0100;
pub const BREAKPOINT: u32 = 0xF0;
/// A CPU cycle after reset: 1 MHz.
pub const CYCLE: u64 = 48;

pub const HARD_FAULT: u8 = 3;
pub const SVCALL: u8 = 11;
pub const PENDSV: u8 = 14;
pub const SYSTICK: u8 = 15;
pub const fn irq(n: u8) -> u8 {
    16 + n
}

// Word offsets from R4 (SCB, 0xE000_ED00).
pub const ICSR: u16 = 1;
pub const VTOR: u16 = 2;
pub const AIRCR: u16 = 3;
pub const SCR: u16 = 4;
pub const SHPR2: u16 = 7;
pub const SHPR3: u16 = 8;
// Word offsets from R3 (SysTick, 0xE000_E010).
pub const CSR: u16 = 0;
pub const RVR: u16 = 1;
pub const CVR: u16 = 2;

pub const NOP: u16 = 0xBF00;
pub const YIELD: u16 = 0xBF10;
pub const WFE: u16 = 0xBF20;
pub const WFI: u16 = 0xBF30;
pub const SEV: u16 = 0xBF40;
pub const BKPT: u16 = 0xBE00;
pub const SVC: u16 = 0xDF00;
pub const UDF: u16 = 0xDE00;
pub const CPSIE: u16 = 0xB662;
pub const CPSID: u16 = 0xB672;
pub const BX_LR: u16 = 0x4770;
/// B to itself.
pub const HERE: u16 = 0xE7FE;

pub const fn movs(rd: u16, imm8: u16) -> u16 {
    0x2000 | rd << 8 | imm8
}
pub const fn adds(rd: u16, imm8: u16) -> u16 {
    0x3000 | rd << 8 | imm8
}
pub const fn subs(rd: u16, imm8: u16) -> u16 {
    0x3800 | rd << 8 | imm8
}
pub const fn lsls(rd: u16, rm: u16, by: u16) -> u16 {
    by << 6 | rm << 3 | rd
}
/// LDR rt, [rn, 4 * words].
pub const fn ldr(rt: u16, rn: u16, words: u16) -> u16 {
    0x6800 | words << 6 | rn << 3 | rt
}
/// STR rt, [rn, 4 * words].
pub const fn str(rt: u16, rn: u16, words: u16) -> u16 {
    0x6000 | words << 6 | rn << 3 | rt
}
pub const fn strb(rt: u16, rn: u16) -> u16 {
    0x7000 | rn << 3 | rt
}
/// Any register to any.
pub const fn mov(rd: u16, rm: u16) -> u16 {
    0x4600 | (rd & 8) << 4 | rm << 3 | rd & 7
}
pub const fn bx(rm: u16) -> u16 {
    0x4700 | rm << 3
}
pub const fn mrs(rd: u16, number: u16) -> [u16; 2] {
    [0xF3EF, 0x8000 | rd << 8 | number]
}
pub const fn msr(number: u16, rn: u16) -> [u16; 2] {
    [0xF380 | rn, 0x8800 | number]
}
/// Appends a byte to the log; clobbers R0.
pub const fn log(byte: u16) -> [u16; 3] {
    [movs(0, byte), strb(0, 7), adds(7, 1)]
}

/// Strings pieces of code together.
#[macro_export]
macro_rules! code {
    ($($piece:expr),* $(,)?) => {{
        let mut code: Vec<u16> = Vec::new();
        $(code.extend_from_slice(&$crate::common::Piece::half_words($piece));)*
        code
    }};
}

pub trait Piece {
    fn half_words(self) -> Vec<u16>;
}
impl Piece for u16 {
    fn half_words(self) -> Vec<u16> {
        vec![self]
    }
}
impl<const N: usize> Piece for [u16; N] {
    fn half_words(self) -> Vec<u16> {
        self.to_vec()
    }
}

/// A chip about to run `program`.
pub fn chip(program: &[u16], handlers: &[(u8, Vec<u16>)]) -> Chip {
    chip_with(Options::default(), program, handlers)
}

pub fn chip_with(options: Options, program: &[u16], handlers: &[(u8, Vec<u16>)]) -> Chip {
    let mut chip = Chip::new(options);
    let mut vectors = [BREAKPOINT | 1; 48];
    vectors[0] = STACK_TOP;
    vectors[1] = PROGRAM | 1;
    load(&mut chip, BREAKPOINT, &[BKPT]);
    load(&mut chip, PROGRAM, program);
    for (at, (exception, code)) in (0x400..).step_by(0x100).zip(handlers) {
        vectors[usize::from(*exception)] = at | 1;
        load(&mut chip, at, code);
    }
    let words: Vec<u8> = vectors.iter().flat_map(|word| word.to_le_bytes()).collect();
    chip.load_flash(0, &words);
    chip.boot(0);
    let mut registers = chip.registers();
    registers.r[3] = 0xE000_E010;
    registers.r[4] = 0xE000_ED00;
    registers.r[5] = 0xE000_E100;
    registers.r[6] = 0xE000_E200;
    registers.r[7] = LOG;
    chip.set_registers(&registers);
    chip
}

pub fn load(chip: &mut Chip, address: u32, code: &[u16]) {
    let bytes: Vec<u8> = code.iter().flat_map(|half| half.to_le_bytes()).collect();
    chip.load_flash(address, &bytes);
}

/// Sets one register.
pub fn set(chip: &mut Chip, register: usize, value: u32) {
    let mut registers = chip.registers();
    registers.r[register] = value;
    chip.set_registers(&registers);
}

/// Runs 10,000 cycles at most.
pub fn run(chip: &mut Chip) -> Stop {
    let until = chip.now() + Ticks(10_000 * CYCLE);
    chip.run_until(until, &mut Unconnected)
}

/// Runs to a BKPT.
pub fn run_to_breakpoint(chip: &mut Chip) {
    let stop = run(chip);
    assert_eq!(stop, Stop::Breakpoint, "{stop}; {:?}", chip.last_hard_fault());
}

/// One instruction or exception entry; the cycles it took.
pub fn step(chip: &mut Chip) -> u64 {
    let before = chip.counters().cycles;
    let behind = chip.now() + Ticks(1);
    assert_eq!(chip.run_until(behind, &mut Unconnected), Stop::Reached);
    chip.counters().cycles - before
}

/// What has been logged.
pub fn logged(chip: &Chip) -> &[u8] {
    let end = chip.registers().r[7];
    chip.memory.bytes(LOG, (end - LOG) as usize).expect("R7 points into SRAM")
}

pub fn word(chip: &Chip, address: u32) -> u32 {
    chip.memory.read_u32(address).expect("in memory")
}
