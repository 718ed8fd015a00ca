//! Faults: which there are, what they leave behind, escalation, lockup, and how they print.

mod common;

use common::*;
use samd21::board::{Ticks, Unconnected};
use samd21::chip::Stop;
use samd21::fault::FaultKind;
use samd21::peripherals::{Refusal, ResetCause, Width};
use samd21::{Chip, Options};

/// Runs a program that faults at `offset` into a handler that stops; the chip and what faulted.
fn fault_at(offset: u32, program: &[u16], r0: u32) -> (Chip, FaultKind) {
    let mut chip = chip(program, &[(HARD_FAULT, code![log(3), BKPT])]);
    set(&mut chip, 0, r0);
    run_to_breakpoint(&mut chip);
    assert_eq!(logged(&chip), [3]);
    assert_eq!(chip.counters().hard_faults, 1);
    let fault = chip.last_hard_fault().expect("a fault").clone();
    assert_eq!(fault.pc, PROGRAM + offset);
    assert_eq!(word(&chip, STACK_TOP - 8), PROGRAM + offset, "stacked PC");
    (chip, fault.kind)
}

#[test]
fn accesses_that_are_not_aligned() {
    let cases = [
        (ldr(1, 0, 0), Some(Width::Word), None),
        (0x8801, Some(Width::Half), None), // LDRH R1, [R0]
        (0xC802, Some(Width::Word), None), // LDM R0!, {R1}
        (str(1, 0, 0), None, Some(Width::Word)),
        (0x8001, None, Some(Width::Half)), // STRH R1, [R0]
        (0xC002, None, Some(Width::Word)), // STM R0!, {R1}
    ];
    let address = 0x2000_0201;
    for (instruction, load, store) in cases {
        let (chip, kind) = fault_at(2, &code![NOP, instruction], address);
        let expected = match (load, store) {
            (Some(width), _) => FaultKind::UnalignedLoad { address, width },
            (_, Some(width)) => FaultKind::UnalignedStore { address, width },
            _ => unreachable!(),
        };
        assert_eq!(kind, expected);
        assert_eq!(word(&chip, STACK_TOP - 32), address, "the base keeps its value");
    }
    // A byte may be anywhere; two halves of a word make it unaligned.
    let (_, kind) = fault_at(2, &code![0x7801u16, ldr(1, 0, 0)], 0x2000_0202);
    assert!(matches!(kind, FaultKind::UnalignedLoad { .. }));
}

#[test]
fn accesses_where_nothing_answers() {
    for address in [0x0004_0000, 0x1FFF_FFFC, 0x2000_8000, 0x9000_0000] {
        let (_, kind) = fault_at(0, &code![ldr(1, 0, 0)], address);
        assert_eq!(kind, FaultKind::UnmappedLoad { address });
        let (_, kind) = fault_at(0, &code![str(1, 0, 0)], address);
        assert_eq!(kind, FaultKind::UnmappedStore { address });
    }
}

#[test]
fn accesses_that_a_peripheral_answers_with_an_exception() {
    // A byte for the flash's page buffer, and a protection that is asked for twice.
    const PAC1_WPSET: u32 = 0x4100_0004;
    let refusal = |offset, program: &[u16], r0| match fault_at(offset, program, r0).1 {
        FaultKind::Peripheral(error) => error.refusal,
        kind => panic!("{kind}"),
    };
    let page_buffer = refusal(0, &code![strb(1, 0)], 0x0003_0000);
    assert!(matches!(page_buffer, Refusal::Exception(_)));
    // The DSU is protected from reset on.
    let twice = refusal(2, &code![movs(1, 2), str(1, 0, 0)], PAC1_WPSET);
    assert!(matches!(twice, Refusal::Exception(_)));
    // The port is protected, and then written to.
    let port = code![movs(2, 0x41), lsls(2, 2, 16), adds(2, 0x44), lsls(2, 2, 8)];
    let program = [code![movs(1, 8), str(1, 0, 0)], port, code![str(1, 2, 4)]].concat();
    assert_eq!(refusal(12, &program, PAC1_WPSET), Refusal::Protected);
}

#[test]
fn a_block_transfer_that_runs_out_of_memory_keeps_its_base() {
    // LDM R0!, {R1, R2} over the end of SRAM.
    let (chip, kind) = fault_at(0, &[0xC806], 0x2000_7FFC);
    assert_eq!(kind, FaultKind::UnmappedLoad { address: 0x2000_8000 });
    assert_eq!(word(&chip, STACK_TOP - 32), 0x2000_7FFC);
}

#[test]
fn undefined_instructions() {
    let half_words =
        [UDF, 0xB100, 0xB700, 0xBA80, 0xB660, 0xB671, 0xBF01, 0xB400, 0xBC00, 0xC000, 0xC800];
    for instruction in half_words {
        let (_, kind) = fault_at(0, &[instruction], 0);
        let encoding = u32::from(instruction);
        assert_eq!(kind, FaultKind::Undefined { encoding });
    }
    // UDF.W; MRS to SP; MSR to BASEPRI, which ARMv6-M has not; the first half of a 32-bit
    // instruction of ARMv7-M.
    for (first, second) in [(0xF7F0, 0xA000), (0xF3EF, 0x8D08), (0xF380, 0x8811), (0xE92D, 0x4FF0)]
    {
        let (_, kind) = fault_at(0, &[first, second], 0);
        let encoding = u32::from(first) << 16 | u32::from(second);
        assert_eq!(kind, FaultKind::Undefined { encoding });
    }
}

#[test]
fn branches_to_where_no_instruction_is() {
    for (target, reason) in [
        (0x600, FaultKind::NotThumb),
        (0x4000_0001, FaultKind::UnmappedFetch { address: 0x4000_0000 }),
        // In Thread mode this is no exception return.
        (0xFFFF_FFF9, FaultKind::UnmappedFetch { address: 0xFFFF_FFF8 }),
    ] {
        let mut chip = chip(&code![bx(0)], &[(HARD_FAULT, code![BKPT])]);
        set(&mut chip, 0, target);
        run_to_breakpoint(&mut chip);
        let fault = chip.last_hard_fault().expect("a fault");
        assert_eq!((fault.pc, &fault.kind), (target & !1, &reason));
        let thumb = word(&chip, STACK_TOP - 4) >> 24 & 1;
        assert_eq!(thumb, target & 1, "stacked T");
    }
}

#[test]
fn svc_is_escalated_where_its_priority_does_not_suffice() {
    let (_, kind) = fault_at(2, &code![CPSID, SVC], 0);
    assert_eq!(kind, FaultKind::SupervisorCall);

    // In SVCall itself.
    let mut chip = chip(&code![SVC], &[(SVCALL, code![SVC]), (HARD_FAULT, code![log(3), BKPT])]);
    run_to_breakpoint(&mut chip);
    assert_eq!(logged(&chip), [3]);
    assert_eq!(chip.registers().r[14], 0xFFFF_FFF1);
}

#[test]
fn a_fault_inside_of_hardfault_locks_the_core_up() {
    let mut chip = chip(&code![UDF], &[(HARD_FAULT, code![log(3), UDF])]);
    assert_eq!(run(&mut chip), Stop::Lockup);
    assert_eq!(logged(&chip), [3]);
    let lockup = chip.lockup().expect("locked up");
    assert_eq!(lockup.pc, 0x406);
    let cause = chip.last_hard_fault().expect("a fault");
    assert_eq!(cause.pc, PROGRAM, "the fault that was taken is kept");

    // Time goes on, for a watchdog; no instruction does.
    let before = chip.counters();
    let until = chip.now() + Ticks::from_ms(1);
    assert_eq!(chip.run_until(until, &mut Unconnected), Stop::Reached);
    assert_eq!(chip.now(), until);
    assert_eq!(chip.counters().instructions, before.instructions);

    // A reset ends it.
    chip.reset(ResetCause::External);
    load(&mut chip, PROGRAM, &[BKPT]);
    chip.boot(0);
    run_to_breakpoint(&mut chip);
    assert_eq!(chip.pc(), PROGRAM);
    assert!(chip.lockup().is_none());
}

#[test]
fn a_hardfault_that_cannot_be_stacked_locks_the_core_up() {
    let mut chip = chip(&code![UDF], &[(HARD_FAULT, code![BKPT])]);
    let mut registers = chip.registers();
    registers.msp = 0x2000_0010;
    chip.set_registers(&registers);
    assert_eq!(run(&mut chip), Stop::Lockup);
    let address = 0x1FFF_FFF0;
    assert_eq!(chip.lockup().expect("locked up").kind, FaultKind::UnmappedStore { address });
}

#[test]
fn an_interrupt_that_cannot_be_stacked_becomes_hardfault() {
    let mut chip =
        chip(&code![SVC], &[(SVCALL, code![log(11), BKPT]), (HARD_FAULT, code![log(3), BKPT])]);
    let mut registers = chip.registers();
    registers.msp = 0x2000_0000;
    chip.set_registers(&registers);
    run_to_breakpoint(&mut chip);
    assert_eq!(logged(&chip), [3]);
    assert_eq!(chip.registers().msp, 0x1FFF_FFE0);
}

#[test]
fn an_erased_flash_locks_up_at_boot() {
    let mut chip = Chip::new(Options::default());
    chip.boot(0);
    assert_eq!(run(&mut chip), Stop::Lockup);
}

#[test]
fn what_no_model_covers_stops_the_chip_before_the_instruction() {
    // SHCSR is for debuggers.
    let mut chip = chip(&code![NOP, ldr(0, 4, 9)], &[]);
    let stop = run(&mut chip);
    assert_eq!(
        stop.to_string(),
        "pc 0x00000102: word access to 0xe000ed24 in the system control space: not modelled"
    );
    assert_eq!(chip.pc(), PROGRAM + 2);
    assert_eq!(run(&mut chip), stop, "and again");

    let mut chip = common::chip(&code![strb(0, 4)], &[]);
    assert!(matches!(run(&mut chip), Stop::Fault(_)));

    let mut chip = common::chip(&code![movs(0, 4), str(0, 4, SCR), WFI], &[]);
    assert_eq!(
        run(&mut chip).to_string(),
        "pc 0x00000104: WFI or WFE with SCR.SLEEPDEEP: not modelled"
    );
}

#[test]
fn faults_print_on_one_line() {
    let lines = [
        (ldr(1, 0, 0), 0x2000_0201, "word load from 0x20000201 is not aligned"),
        (0x8001, 0x2000_0203, "half-word store to 0x20000203 is not aligned"),
        (ldr(1, 0, 0), 0x9000_0000, "load from 0x90000000, where nothing answers"),
        (UDF, 0, "undefined instruction 0xde00"),
    ];
    for (instruction, r0, text) in lines {
        let (chip, _) = fault_at(0, &[instruction, NOP], r0);
        let fault = chip.last_hard_fault().expect("a fault");
        assert_eq!(fault.to_string(), format!("pc 0x00000100: {text}"));
    }
}

#[test]
fn the_trail_leads_to_where_the_core_is() {
    // BL +4; (skipped); B +0 forward; BKPT
    let mut chip = chip(&code![0xF000u16, 0xF801, NOP, 0xE000u16, NOP, BKPT], &[]);
    run_to_breakpoint(&mut chip);
    let trail: Vec<_> = chip.trail().collect();
    assert_eq!(trail, [(PROGRAM, PROGRAM + 6), (PROGRAM + 6, PROGRAM + 10)]);
}
