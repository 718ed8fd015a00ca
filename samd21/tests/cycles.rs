//! Cycles of instructions (ARM DDI 0484, 3.3) and of flash wait states.

mod common;

use common::*;
use samd21::Options;
use samd21::board::Ticks;

#[test]
fn every_kind_of_instruction_takes_its_cycles() {
    let cases: [(&str, &[u16], u64); 33] = [
        ("MOVS", &[movs(0, 1)], 1),
        ("ADDS", &[adds(0, 1)], 1),
        ("LSLS", &[lsls(0, 1, 3)], 1),
        ("MULS", &[0x4348], 1),
        ("CMP", &[0x2801], 1),
        ("ADD SP", &[0xB001], 1),
        ("ADR", &[0xA001], 1),
        ("REV", &[0xBA08], 1),
        ("MOV high", &[0x4688], 1),
        ("MOV PC", &[0x468F], 2),
        ("ADD PC", &[0x4487], 2),
        ("LDR", &[0x6811], 2),
        ("LDRB register", &[0x5C11], 2),
        ("LDR literal", &[0x4801], 2),
        ("STR", &[0x6011], 2),
        ("STRH SP", &[0x8011], 2),
        ("LDM 1", &[0xCA02], 2),
        ("LDM 3", &[0xCA0B], 4),
        ("STM 2", &[0xC203], 3),
        ("PUSH 2", &[0xB410], 2),
        ("PUSH 9", &[0xB5FF], 10),
        ("POP 4", &[0xBC0F], 5),
        ("B", &[0xE000], 2),
        ("BNE not taken", &[0xD100], 1),
        ("BEQ taken", &[0xD000], 2),
        ("BL", &[0xF000, 0xF800], 3),
        ("BX", &[0x4708], 2),
        ("BLX", &[0x4788], 2),
        ("MRS", &mrs(0, 0), 3),
        ("MSR", &msr(0, 0), 3),
        ("DSB", &[0xF3BF, 0x8F4F], 3),
        ("CPSID", &[CPSID], 1),
        ("NOP", &[NOP], 1),
    ];
    for (name, code, cycles) in cases {
        let mut chip = chip(code, &[]);
        let mut registers = chip.registers();
        registers.r[..3].copy_from_slice(&[0, 0x201, 0x2000_0800]);
        registers.xpsr = 0x4000_0000;
        registers.msp = STACK_TOP - 64;
        chip.set_registers(&registers);
        assert_eq!(step(&mut chip), cycles, "{name}");
    }
}

#[test]
fn pop_to_pc_takes_three_more_than_its_registers() {
    let mut chip = chip(&code![0xBD10u16], &[]); // POP {R4, PC}
    let mut registers = chip.registers();
    registers.msp = 0x2000_1000;
    chip.set_registers(&registers);
    chip.memory.ram_mut()[0x1004..0x1008].copy_from_slice(&0x601_u32.to_le_bytes());
    assert_eq!(step(&mut chip), 3 + 2);
    assert_eq!(chip.pc(), 0x600);
}

#[test]
fn the_iobus_answers_in_one_cycle() {
    // PORT's direction register of group A by APB and by IOBUS.
    for (address, cycles) in [(0x4100_4400, 2), (0x6000_0000, 1)] {
        let mut chip = chip(&code![ldr(0, 0, 0), str(1, 0, 0), str(1, 2, 0)], &[]);
        set(&mut chip, 0, address);
        set(&mut chip, 2, address);
        assert_eq!(step(&mut chip), cycles);
        set(&mut chip, 0, 0x2000_0000);
        assert_eq!(step(&mut chip), 2);
        assert_eq!(step(&mut chip), cycles);
    }
}

/// The stall of a bridge comes on top of an access over it, not of one of the IOBUS or of RAM.
#[test]
fn a_bridge_costs_what_the_options_say() {
    let ends_at = |address, bridge_stall| {
        let options = Options { bridge_stall, ..Options::default() };
        let mut chip = chip_with(options, &code![ldr(0, 1, 0), str(0, 1, 0), BKPT], &[]);
        set(&mut chip, 1, address);
        run_to_breakpoint(&mut chip);
        chip.now().0
    };
    for (address, stalled) in [(0x4100_4400, 2 * 4), (0x6000_0000, 0), (0x2000_0000, 0)] {
        let later = ends_at(address, Ticks(4)) - ends_at(address, Ticks::ZERO);
        assert_eq!(later, stalled, "{address:#x}");
    }
}

fn with_wait_states(wait_states: u8, program: &[u16]) -> samd21::Chip {
    let options = Options { wait_states: Some(wait_states), ..Options::default() };
    chip_with(options, program, &[])
}

#[test]
fn straight_code_waits_once_for_eight_bytes() {
    for wait_states in [0, 1, 2] {
        let mut program = vec![NOP; 16];
        program.push(BKPT);
        let mut chip = with_wait_states(wait_states, &program);
        run_to_breakpoint(&mut chip);
        // 4 lines of NOPs and the one with the BKPT.
        let waits = 5 * u64::from(wait_states);
        assert_eq!(chip.counters().flash_wait_cycles, waits);
        assert_eq!(chip.counters().cycles, 16 + waits);
    }
}

#[test]
fn a_loop_that_fits_into_64_bytes_waits_only_at_first() {
    // A line of its own, then 62 bytes of loop, and the BKPT in their last line.
    let mut program = code![movs(0, 100), NOP, NOP, NOP, subs(0, 1)];
    program.extend([NOP; 29]);
    program.extend(code![0xD1E0u16, BKPT]);
    let mut chip = with_wait_states(1, &program);
    run_to_breakpoint(&mut chip);
    assert_eq!(chip.counters().flash_wait_cycles, 1 + 8);

    // A literal in a line of the same index throws the code out: two misses each time round.
    let mut program = code![movs(0, 100), NOP, NOP, NOP, 0x490Fu16, subs(0, 1), 0xD1FCu16, BKPT];
    program.resize(64, NOP);
    let mut chip = with_wait_states(1, &program);
    run_to_breakpoint(&mut chip);
    let waits = chip.counters().flash_wait_cycles;
    assert!((200..=204).contains(&waits), "{waits}");
}

#[test]
fn code_in_sram_waits_for_nothing() {
    let mut chip = with_wait_states(1, &code![bx(0)]);
    let code: Vec<u8> =
        [NOP, NOP, NOP, NOP, NOP, BKPT].iter().flat_map(|half| half.to_le_bytes()).collect();
    chip.memory.ram_mut()[0x800..0x800 + code.len()].copy_from_slice(&code);
    set(&mut chip, 0, 0x2000_0801);
    run_to_breakpoint(&mut chip);
    assert_eq!(chip.counters().flash_wait_cycles, 1);
}
