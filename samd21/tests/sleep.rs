//! Sleep, events, SysTick and resets.

mod common;

use common::*;
use samd21::Options;
use samd21::board::{Ticks, Unconnected};
use samd21::chip::Stop;
use samd21::peripherals::ResetCause;

/// Starts SysTick with a period of `period` (at most 256) cycles, with its exception.
fn start_systick(period: u16) -> [u16; 5] {
    [movs(0, period - 1), str(0, 3, RVR), str(0, 3, CVR), movs(0, 7), str(0, 3, CSR)]
}

#[test]
fn systick_comes_every_period_to_the_cycle() {
    let program = code![start_systick(200), HERE];
    let mut chip = chip(&program, &[(SYSTICK, code![log(15), BX_LR])]);
    for _ in 0..5 {
        step(&mut chip);
    }
    // The last store, which starts the timer, happens at its first cycle.
    let started = chip.now() - Ticks(2 * CYCLE);
    let until = started + Ticks(2000 * CYCLE - 2 * CYCLE);
    assert_eq!(chip.run_until(until, &mut Unconnected), Stop::Reached);
    assert_eq!(logged(&chip).len(), 9, "the tenth period is not over");
    let until = started + Ticks(2000 * CYCLE + 30 * CYCLE);
    assert_eq!(chip.run_until(until, &mut Unconnected), Stop::Reached);
    assert_eq!(logged(&chip).len(), 10);
}

#[test]
fn a_delay_by_countflag_takes_its_cycles() {
    // As delay loops do it: reload, clear, enable, wait for COUNTFLAG (bit 16).
    let program = code![
        movs(0, 99),
        str(0, 3, RVR),
        str(0, 3, CVR),
        movs(0, 5),
        str(0, 3, CSR),
        ldr(0, 3, CSR),
        lsls(0, 0, 15),
        0xD5FCu16, // BPL to the load
        ldr(1, 3, CSR),
        BKPT
    ];
    let mut chip = chip(&program, &[]);
    run_to_breakpoint(&mut chip);
    let cycles = chip.counters().cycles;
    assert!((100 + 6..100 + 6 + 12).contains(&cycles), "{cycles} cycles");
    assert_eq!(chip.registers().r[1], 0x0000_0005, "the first read has cleared COUNTFLAG");
}

#[test]
fn wfi_sleeps_to_the_next_interrupt() {
    let program = code![start_systick(256), WFI, log(1), BKPT];
    let mut chip = chip(&program, &[(SYSTICK, code![log(15), BX_LR])]);
    for _ in 0..5 {
        step(&mut chip);
    }
    let started = chip.now() - Ticks(2 * CYCLE);
    step(&mut chip);
    assert!(chip.is_asleep());
    let until = started + Ticks(256 * CYCLE);
    assert_eq!(chip.run_until(until, &mut Unconnected), Stop::Reached);
    // WFI takes 2 of the cycles.
    assert_eq!(chip.counters().sleep_ticks, 252 * CYCLE);
    run_to_breakpoint(&mut chip);
    assert_eq!(logged(&chip), [15, 1]);
}

#[test]
fn waking_takes_its_time_and_what_is_pending_already_none() {
    let program = code![start_systick(256), WFI, log(1), BKPT];
    let handler = [(SYSTICK, code![log(15), BX_LR])];
    let run_with = |wake_up| {
        let options = Options { wake_up, ..Options::default() };
        let mut chip = chip_with(options, &program, &handler);
        run_to_breakpoint(&mut chip);
        (chip.now(), chip.counters())
    };
    let (end, counters) = run_with(Ticks::ZERO);
    let (late_end, late) = run_with(Ticks::from_us(4));
    assert_eq!(late_end - end, Ticks::from_us(4));
    assert_eq!(late.cycles, counters.cycles, "it sleeps meanwhile");

    let options = Options { wake_up: Ticks::from_us(4), ..Options::default() };
    let program = code![CPSID, movs(0, 1), str(0, 5, 0), str(0, 6, 0), WFI, log(1), BKPT];
    let mut chip = chip_with(options, &program, &[]);
    run_to_breakpoint(&mut chip);
    assert_eq!(logged(&chip), [1]);
    assert_eq!(chip.counters().sleep_ticks, 0);
}

#[test]
fn wfi_wakes_with_primask_set_and_takes_nothing() {
    let program = code![CPSID, start_systick(100), WFI, log(1), CPSIE, log(2), BKPT];
    let mut chip = chip(&program, &[(SYSTICK, code![log(15), movs(0, 0), str(0, 3, CSR), BX_LR])]);
    run_to_breakpoint(&mut chip);
    assert_eq!(logged(&chip), [1, 15, 2]);
    assert!(chip.counters().sleep_ticks > 90 * CYCLE);
}

#[test]
fn an_interrupt_that_is_not_enabled_wakes_nobody() {
    let mut chip = chip(&code![movs(0, 1), str(0, 6, 0), WFI, BKPT], &[]);
    assert_eq!(run(&mut chip), Stop::Reached);
    assert!(chip.is_asleep());
}

#[test]
fn a_sleep_without_an_event_lasts_until_the_time_asked_for() {
    let mut chip = chip(&code![WFI, BKPT], &[]);
    let until = Ticks::from_ms(1000);
    assert_eq!(chip.run_until(until, &mut Unconnected), Stop::Reached);
    assert_eq!(chip.now(), until);
    assert_eq!(chip.counters().instructions, 1);
    assert_eq!(chip.counters().cycles, 2);
    assert_eq!(chip.counters().sleep_ticks, until.0 - 2 * CYCLE);
}

#[test]
fn wfe_takes_the_event_that_is_there_and_sleeps_without_one() {
    let mut chip = chip(&code![SEV, WFE, log(1), WFE, log(2), BKPT], &[]);
    assert_eq!(run(&mut chip), Stop::Reached);
    assert_eq!(logged(&chip), [1]);
    assert!(chip.is_asleep());
}

#[test]
fn sevonpend_makes_an_event_of_an_interrupt_that_is_not_enabled() {
    for (scr, expected) in [(0x10, &[1u8][..]), (0, &[])] {
        let program =
            code![movs(0, scr), str(0, 4, SCR), movs(0, 1), str(0, 6, 0), WFE, log(1), BKPT];
        let mut chip = chip(&program, &[]);
        run(&mut chip);
        assert_eq!(logged(&chip), expected);
    }
}

#[test]
fn sleeponexit_goes_back_to_sleep_after_the_handler() {
    let program = code![movs(0, 2), str(0, 4, SCR), start_systick(200), WFI, log(1), BKPT];
    let mut chip = chip(&program, &[(SYSTICK, code![log(15), BX_LR])]);
    let until = chip.now() + Ticks(1900 * CYCLE);
    assert_eq!(chip.run_until(until, &mut Unconnected), Stop::Reached);
    assert_eq!(logged(&chip), [15; 9]);
    assert!(chip.is_asleep());
}

#[test]
fn yield_is_a_nop() {
    let mut chip = chip(&code![YIELD, log(1), BKPT], &[]);
    run_to_breakpoint(&mut chip);
    assert_eq!(logged(&chip), [1]);
    assert_eq!(chip.counters().sleep_ticks, 0);
}

#[test]
fn sysresetreq_stops_the_run_until_the_chip_is_reset() {
    let program = code![mrs(1, 16), CPSID, str(0, 4, AIRCR), HERE];
    let mut chip = chip(&program, &[]);
    set(&mut chip, 0, 0x05FA_0004);
    assert_eq!(run(&mut chip), Stop::Reset(ResetCause::System));
    assert_eq!(run(&mut chip), Stop::Reset(ResetCause::System));
    chip.memory.ram_mut()[0x300] = 0xA5;
    let before = chip.now();
    chip.reset(ResetCause::System);
    let until = before + Ticks::from_ms(500);
    assert_eq!(chip.hold_until(until, &mut Unconnected), Stop::Reached);
    assert_eq!(chip.now(), until);
    chip.boot(0);
    step(&mut chip);
    step(&mut chip);
    assert_eq!(chip.registers().r[1], 0, "PRIMASK is clear after a reset");
    assert_eq!(chip.memory.ram()[0x300], 0xA5, "SRAM keeps its content");
}

#[test]
fn a_reset_request_without_the_key_is_ignored() {
    let mut chip = chip(&code![str(0, 4, AIRCR), BKPT], &[]);
    set(&mut chip, 0, 0x0000_0004);
    run_to_breakpoint(&mut chip);
}

#[test]
fn a_clone_goes_its_own_way() {
    let program = code![start_systick(100), WFI, HERE];
    let mut first = chip(&program, &[(SYSTICK, code![log(15), BX_LR])]);
    run(&mut first);
    let mut second = first.clone();
    run(&mut first);
    assert_ne!(first.registers(), second.registers());
    run(&mut second);
    assert_eq!(first.registers(), second.registers());
    assert_eq!(first.counters(), second.counters());
    assert_eq!(first.memory.ram(), second.memory.ram());
}
