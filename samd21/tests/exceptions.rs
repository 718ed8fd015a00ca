//! Exceptions: stacking, priorities, nesting, tail-chaining, late arrival, both stacks, and their
//! cycles (ARM DDI 0419, B1.5).

mod common;

use common::*;
use samd21::fault::FaultKind;

const RETURN_TO_THREAD: u32 = 0xFFFF_FFF9;

#[test]
fn entry_stacks_eight_words_and_takes_15_cycles() {
    let mut chip = chip(&code![SVC, BKPT], &[(SVCALL, code![BX_LR])]);
    let mut registers = chip.registers();
    for (i, register) in [0, 1, 2, 3, 12, 14].into_iter().enumerate() {
        registers.r[register] = 0x1111_1111 * (i as u32 + 1);
    }
    registers.xpsr = 0xA000_0000;
    chip.set_registers(&registers);

    assert_eq!(step(&mut chip), 15);

    let frame = STACK_TOP - 32;
    let words: Vec<u32> = (0..8).map(|i| word(&chip, frame + 4 * i)).collect();
    assert_eq!(words[..6], [1, 2, 3, 4, 5, 6].map(|i| 0x1111_1111 * i));
    assert_eq!(words[6], PROGRAM + 2, "behind the SVC");
    assert_eq!(words[7], 0xA100_0000);
    let inside = chip.registers();
    assert_eq!((inside.r[15], inside.r[13], inside.r[14]), (0x400, frame, RETURN_TO_THREAD));
    assert_eq!(inside.xpsr & 0x3F, u32::from(SVCALL));

    assert_eq!(step(&mut chip), 13);

    let after = chip.registers();
    assert_eq!(after.r[15], PROGRAM + 2);
    assert_eq!(after.xpsr, 0xA100_0000);
    assert_eq!(after.r[..15], registers.r[..15]);
}

#[test]
fn the_frame_is_aligned_to_eight_bytes_and_the_return_undoes_it() {
    let mut chip = chip(&code![SVC, BKPT], &[(SVCALL, code![BX_LR])]);
    let mut registers = chip.registers();
    registers.msp = STACK_TOP - 4;
    chip.set_registers(&registers);
    step(&mut chip);
    assert_eq!(chip.registers().msp, STACK_TOP - 40);
    assert_eq!(word(&chip, STACK_TOP - 12) & 1 << 9, 1 << 9, "stacked xPSR bit 9");
    step(&mut chip);
    assert_eq!(chip.registers().msp, STACK_TOP - 4);
    assert_eq!(chip.lowest_sp(), STACK_TOP - 40);
}

#[test]
fn pop_to_pc_returns_too() {
    // PUSH {R4, LR}; POP {R4, PC}
    let mut chip = chip(&code![SVC, BKPT], &[(SVCALL, code![0xB510, 0xBD10])]);
    step(&mut chip);
    assert_eq!(step(&mut chip), 3);
    assert_eq!(step(&mut chip), 1 + 2 + 13);
    assert_eq!(chip.pc(), PROGRAM + 2);
}

/// Enables interrupts 0 to 2 and gives them priorities 3, 2, 1; R2 points to NVIC_IPR0.
fn three_priorities() -> Vec<u16> {
    code![
        movs(0, 7),
        str(0, 5, 0),
        movs(1, 0x40),
        lsls(0, 1, 16),
        movs(1, 0x80),
        lsls(1, 1, 8),
        0x1840u16, // adds r0, r0, r1
        adds(0, 0xC0),
        str(0, 2, 0),
    ]
}

fn pend(irqs: u16) -> [u16; 2] {
    [movs(0, irqs), str(0, 6, 0)]
}

#[test]
fn a_higher_priority_interrupts_a_handler_and_a_lower_one_waits() {
    let mut program = three_priorities();
    program.extend(code![pend(0b010), log(9), BKPT]);
    let mut chip = chip(
        &program,
        &[
            (irq(0), code![log(0), BX_LR]),
            // Pends both its neighbours: 2 nests at once, 0 follows.
            (irq(1), code![log(1), pend(0b101), log(11), BX_LR]),
            (irq(2), code![log(2), mov(0, 14), 0x43C0u16, strb(0, 7), adds(7, 1), BX_LR]),
        ],
    );
    set(&mut chip, 2, 0xE000_E400);
    run_to_breakpoint(&mut chip);
    // Inside of 2, LR is 0xFFFF_FFF1 (its complement is logged).
    assert_eq!(logged(&chip), [1, 2, 0x0E, 11, 0, 9]);
    assert_eq!(chip.counters().exceptions, 3);
}

#[test]
fn of_equal_priorities_the_lowest_number_goes_first_and_nothing_nests() {
    let program = code![movs(0, 7), str(0, 5, 0), CPSID, pend(0b110), CPSIE, log(9), BKPT];
    let mut chip = chip(
        &program,
        &[
            (irq(0), code![log(0), BX_LR]),
            (irq(1), code![log(1), pend(0b001), log(11), BX_LR]),
            (irq(2), code![log(2), BX_LR]),
        ],
    );
    run_to_breakpoint(&mut chip);
    assert_eq!(logged(&chip), [1, 11, 0, 2, 9]);
}

#[test]
fn a_waiting_exception_is_tail_chained_in_7_cycles_without_stacking_again() {
    let program = code![movs(0, 3), str(0, 5, 0), CPSID, pend(0b11), CPSIE, BKPT];
    let mut chip = chip(&program, &[(irq(0), code![BX_LR]), (irq(1), code![BX_LR])]);
    for _ in 0..5 {
        step(&mut chip);
    }
    assert_eq!(chip.pc(), PROGRAM + 10);
    assert_eq!(step(&mut chip), 1, "CPSIE");
    assert_eq!(step(&mut chip), 15);
    assert_eq!(chip.pc(), 0x400);
    let inside = chip.registers();
    assert_eq!(step(&mut chip), 2 + 11 + 7, "BX and the tail-chained entry");
    assert_eq!(chip.pc(), 0x500);
    assert_eq!(chip.registers().msp, inside.msp);
    assert_eq!(chip.registers().r[14], RETURN_TO_THREAD);
    assert_eq!(step(&mut chip), 13);
    assert_eq!(chip.pc(), PROGRAM + 12);
    assert_eq!(chip.registers().msp, STACK_TOP);
}

#[test]
fn what_arrives_during_the_stacking_with_a_higher_priority_goes_first() {
    // PendSV at priority 3; SysTick, at 0, runs out 13 cycles after PendSV is pended, in
    // the 15 that its entry takes.
    let program = code![
        movs(0, 0xC0),
        lsls(0, 0, 16),
        str(0, 4, SHPR3),
        movs(0, 16),
        str(0, 3, RVR),
        movs(1, 1),
        lsls(1, 1, 28),
        movs(0, 7),
        str(0, 3, CSR),
        str(1, 4, ICSR),
        HERE,
    ];
    let mut chip = chip(
        &program,
        &[
            (PENDSV, code![log(14), BKPT]),
            // Stops the timer.
            (SYSTICK, code![log(15), movs(0, 0), str(0, 3, CSR), BX_LR]),
        ],
    );
    run_to_breakpoint(&mut chip);
    assert_eq!(logged(&chip), [15, 14]);
    assert_eq!(chip.registers().msp, STACK_TOP - 32, "one frame");
    assert_eq!(word(&chip, STACK_TOP - 8), PROGRAM + 20, "HERE was never reached before");
}

#[test]
fn primask_holds_back_everything_but_hardfault() {
    let program = code![movs(0, 1), str(0, 5, 0), CPSID, pend(1), log(1), CPSIE, log(2), BKPT];
    let mut chip = chip(&program, &[(irq(0), code![log(16), BX_LR])]);
    run_to_breakpoint(&mut chip);
    assert_eq!(logged(&chip), [1, 16, 2]);

    let program = code![CPSID, UDF, BKPT];
    let mut chip = chip_with_skipping_hard_fault(&program);
    run_to_breakpoint(&mut chip);
    assert_eq!(logged(&chip), [3]);
}

/// Its HardFault handler logs and returns behind the faulting 16-bit instruction.
fn chip_with_skipping_hard_fault(program: &[u16]) -> samd21::Chip {
    chip(
        program,
        &[(
            HARD_FAULT,
            // LDR R0, [SP, #24]; ADDS R0, #2; STR R0, [SP, #24]
            code![log(3), 0x9806u16, adds(0, 2), 0x9006u16, BX_LR],
        )],
    )
}

#[test]
fn pending_bits_can_be_set_cleared_and_read() {
    // R5 + 0x80: ICER; R6 + 0x80: ICPR.
    let mut chip = chip(
        &code![
            CPSID,
            movs(0, 5),
            str(0, 5, 0),
            str(0, 6, 0),
            ldr(1, 6, 0),
            movs(0, 1),
            str(0, 2, 0),
            ldr(2, 6, 0),
            BKPT
        ],
        &[],
    );
    set(&mut chip, 2, 0xE000_E280);
    run_to_breakpoint(&mut chip);
    let r = chip.registers().r;
    assert_eq!((r[1], r[2]), (5, 4));
}

#[test]
fn icsr_tells_what_is_active_and_what_waits() {
    let program = code![
        movs(0, 0xC0),
        lsls(0, 0, 16),
        str(0, 4, SHPR3), // PendSV 3, SysTick 0
        movs(1, 1),
        lsls(1, 1, 26),
        str(1, 4, ICSR),
        BKPT
    ];
    let handler = code![movs(1, 1), lsls(1, 1, 28), str(1, 4, ICSR), ldr(2, 4, ICSR), BKPT];
    let mut chip = chip(&program, &[(SYSTICK, handler)]);
    run_to_breakpoint(&mut chip);
    // PENDSVSET, VECTPENDING 14, VECTACTIVE 15.
    assert_eq!(chip.registers().r[2], 1 << 28 | 14 << 12 | 15);
}

#[test]
fn vectors_come_from_vtor() {
    let mut chip = chip(&code![str(0, 4, VTOR), SVC, BKPT], &[]);
    set(&mut chip, 0, 0x2000_0000);
    chip.memory.ram_mut()[44..48].copy_from_slice(&0x601_u32.to_le_bytes());
    load(&mut chip, 0x600, &code![log(1), BX_LR]);
    run_to_breakpoint(&mut chip);
    assert_eq!(chip.pc(), PROGRAM + 4);
    assert_eq!(logged(&chip), [1]);
}

#[test]
fn thread_mode_on_psp_is_interrupted_onto_psp_and_handlers_use_msp() {
    // MSR PSP, R0; MSR CONTROL, R1; ISB; PUSH {R4}; SVC
    let program = code![msr(9, 0), msr(20, 1), [0xF3BFu16, 0x8F6F], 0xB410u16, SVC, BKPT];
    let mut chip = chip(&program, &[(SVCALL, code![mrs(2, 20), mov(8, 14), BX_LR])]);
    set(&mut chip, 0, 0x2000_1000);
    set(&mut chip, 1, 2);
    for _ in 0..4 {
        step(&mut chip);
    }
    assert_eq!(chip.registers().psp, 0x2000_0FFC);
    step(&mut chip);
    let inside = chip.registers();
    assert_eq!(inside.psp, 0x2000_0FD8, "32 bytes and 4 to align");
    assert_eq!((inside.msp, inside.r[13]), (STACK_TOP, STACK_TOP));
    assert!(!inside.spsel);
    run_to_breakpoint(&mut chip);
    let after = chip.registers();
    assert_eq!(after.r[8], 0xFFFF_FFFD);
    assert_eq!((after.psp, after.r[13], after.msp), (0x2000_0FFC, 0x2000_0FFC, STACK_TOP));
    assert!(after.spsel);
    assert_eq!(chip.lowest_sp(), STACK_TOP, "PSP does not count");
}

#[test]
fn a_handler_can_switch_to_another_threads_frame() {
    let mut chip = chip(
        &code![SVC, BKPT],
        &[(SVCALL, code![msr(9, 0), 0x43CEu16, bx(6)])], // MVNS R6, R1; BX R6
    );
    // A frame of a thread at 0x600 with R0 = 7, and EXC_RETURN 0xFFFF_FFFD made of R1.
    let frame = [7, 0, 0, 0, 0, 0, 0x600, 0x4100_0000_u32];
    for (at, value) in (0x800..).step_by(4).zip(frame) {
        chip.memory.ram_mut()[at..at + 4].copy_from_slice(&value.to_le_bytes());
    }
    load(&mut chip, 0x600, &[BKPT]);
    set(&mut chip, 0, 0x2000_0800);
    set(&mut chip, 1, 2);
    run_to_breakpoint(&mut chip);
    let after = chip.registers();
    assert_eq!((after.r[15], after.r[0], after.psp), (0x600, 7, 0x2000_0820));
    assert_eq!(after.xpsr & 0xF000_003F, 0x4000_0000);
    assert!(after.spsel);
    assert_eq!(after.msp, STACK_TOP - 32, "the first thread's frame is still there");
}

#[test]
fn returns_that_do_not_fit_raise_hardfault() {
    // To a handler (0xFFFF_FFF1) when none is left; to a value that does not exist.
    for complement in [0x0E, 0x0A, 0x01] {
        let mut chip = chip(
            &code![SVC, BKPT],
            &[
                (SVCALL, code![movs(0, complement), 0x43C6u16, bx(6)]), // MVNS R6, R0
                (HARD_FAULT, code![log(3), BKPT]),
            ],
        );
        run_to_breakpoint(&mut chip);
        assert_eq!(logged(&chip), [3]);
        let value = !u32::from(complement);
        let fault = chip.last_hard_fault().expect("a fault");
        assert_eq!(fault.kind, FaultKind::ExceptionReturn { value });
        assert_eq!(fault.pc, 0x404);
    }
}

#[test]
fn an_interrupt_nests_in_svcall_of_low_priority() {
    let program = code![
        movs(0, 1),
        str(0, 5, 0),
        movs(0, 0xC0),
        lsls(0, 0, 24),
        str(0, 4, SHPR2),
        SVC,
        log(9),
        BKPT
    ];
    let mut chip = chip(
        &program,
        &[(SVCALL, code![log(11), pend(1), log(12), BX_LR]), (irq(0), code![log(16), BX_LR])],
    );
    run_to_breakpoint(&mut chip);
    assert_eq!(logged(&chip), [11, 16, 12, 9]);
}
