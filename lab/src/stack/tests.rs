//! Functions assembled by hand, whose stack is known, and interrupts on top of one another.

mod on_the_rig;

use std::collections::{BTreeMap, BTreeSet};

use samd21::chip::EXCEPTIONS;

use super::depth::{Bounded, Calls, Deepest};
use super::levels::levels;
use super::program::Program;
use super::value::Origin;
use super::walk::{Found, Target, explore};
use crate::functions::{Function, Functions};

/// Where the image and, behind its vector table, its code begin.
const IMAGE: u32 = 0x2000;
const CODE: u32 = IMAGE + 4 * 44;

const BX_LR: u16 = 0x4770;
const PUSH_LR: u16 = 0xB500;
const POP_PC: u16 = 0xBD00;

/// An image of functions and data at their addresses; data has no name.
fn program(parts: &[(u32, &str, &[u16])]) -> Program {
    let ends = parts.iter().map(|(at, _, halves)| at + 2 * halves.len() as u32);
    let mut bytes = vec![0; (ends.max().unwrap_or(CODE) - IMAGE) as usize];
    for (at, _, halves) in parts {
        let start = (at - IMAGE) as usize;
        for (place, half) in bytes[start..].chunks_exact_mut(2).zip(*halves) {
            place.copy_from_slice(&half.to_le_bytes());
        }
    }
    let named = parts.iter().filter(|(_, name, _)| !name.is_empty());
    let functions = named.map(|(start, name, halves)| Function {
        start: *start,
        length: 2 * halves.len() as u32,
        name: (*name).into(),
    });
    Program::new(IMAGE, bytes, Functions::new(functions), BTreeMap::new())
}

/// BL from one address to another (ARM DDI 0419, A6.7.13), within 4 KB.
fn bl(from: u32, to: u32) -> [u16; 2] {
    let offset = to.wrapping_sub(from + 4);
    let high = offset >> 12 & 0x7FF;
    [0xF000 | high as u16, 0xF800 | (offset >> 1 & 0x7FF) as u16]
}

/// The halves of a word.
fn word(word: u32) -> [u16; 2] {
    [word as u16, (word >> 16) as u16]
}

fn found(program: &Program) -> Found {
    explore(program, [CODE], &program.pointers())
}

fn calls(program: &Program, bounded: &[Bounded]) -> Calls {
    let found = found(program);
    assert_eq!(found.problems, BTreeSet::new());
    Calls::new(program, found.frames, program.pointers(), bounded)
}

/// The deepest way from the first function, which has a bound.
fn deepest(program: &Program) -> Deepest {
    let calls = calls(program, &[]);
    assert_eq!(calls.recursions(program), []);
    calls.deepest(CODE)
}

/// Why there is no bound.
fn problems(program: &Program) -> String {
    let found = found(program);
    let words: Vec<_> = found.problems.into_iter().map(|problem| problem.what).collect();
    words.join("; ")
}

/// A function that takes this number of bytes, gives them back and returns.
fn taking(bytes: u16) -> [u16; 3] {
    let words = bytes / 4;
    [0xB080 | words, 0xB000 | words, BX_LR]
}

#[test]
fn pushes_and_frames_add_up() {
    let f = [
        0xB570, // push {r4-r6, lr}
        0xB084, // sub sp, #16
        0xB004, // add sp, #16
        0xBD70, // pop {r4-r6, pc}
    ];
    assert_eq!(deepest(&program(&[(CODE, "f", &f)])).bytes, 32);
}

#[test]
fn a_call_counts_from_where_it_is_made() {
    let [g, h] = [CODE + 0x20, CODE + 0x40];
    let [call_g, call_h] = [bl(CODE + 2, g), bl(CODE + 8, h)];
    let f = [
        PUSH_LR, call_g[0], call_g[1], // 4 bytes and those of g
        0xB090,    // sub sp, #64
        call_h[0], call_h[1], // 68 bytes and those of h
        0xB010,    // add sp, #64
        POP_PC,
    ];
    let program = program(&[(CODE, "f", &f), (g, "g", &taking(100)), (h, "h", &taking(40))]);
    let deepest = deepest(&program);
    assert_eq!(deepest.bytes, 68 + 40);
    let names = deepest.path.iter().map(|step| program.name(step.function));
    assert_eq!(names.collect::<Vec<_>>(), ["f", "h"]);
    let bytes = deepest.path.iter().map(|step| step.bytes);
    assert_eq!(bytes.collect::<Vec<_>>(), [68, 40]);
}

#[test]
fn a_tail_call_takes_the_place_of_its_caller() {
    let g = CODE + 0x10;
    let f = [
        0xB086, // sub sp, #24
        0xB006, // add sp, #24
        0xE004, // b g
    ];
    let small = program(&[(CODE, "f", &f), (g, "g", &taking(16))]);
    assert_eq!(deepest(&small).bytes, 24);
    let large = program(&[(CODE, "f", &f), (g, "g", &taking(80))]);
    assert_eq!(deepest(&large).bytes, 80);
    // Without giving its own back, it would leave it behind.
    let f = [0xB086, 0x46C0, 0xE004];
    let wrong = program(&[(CODE, "f", &f), (g, "g", &taking(16))]);
    assert!(problems(&wrong).contains("its stack in use"), "{}", problems(&wrong));
}

/// As the compiler makes a frame of more than 508 bytes, and gives it back by the frame pointer.
#[test]
fn a_large_frame_comes_out_of_a_literal() {
    let size = word(2000_u32.wrapping_neg());
    let f = [
        0xB5F0, // push {r4-r7, lr}
        0xAF03, // add r7, sp, #12
        0x4E02, // ldr r6, =-2000
        0x44B5, // add sp, r6
        0x1FFE, // subs r6, r7, #7
        0x3E05, // subs r6, #5
        0x46B5, // mov sp, r6
        0xBDF0, // pop {r4-r7, pc}
        size[0], size[1],
    ];
    // The literal stands at CODE + 16: 0x4E02 reads from (CODE + 4 + 4) + 4 * 2.
    let program = program(&[(CODE, "f", &f)]);
    assert_eq!(deepest(&program).bytes, 20 + 2000);
}

#[test]
fn what_stands_behind_a_call_that_never_returns_is_no_code() {
    let g = CODE + 0x10;
    let call = bl(CODE + 2, g);
    // 0xFFFF is no instruction.
    let f = [PUSH_LR, call[0], call[1], 0xFFFF, 0xFFFF];
    let endless = [0xB081, 0xE7FE]; // sub sp, #4; b to itself
    let program = program(&[(CODE, "f", &f), (g, "g", &endless)]);
    assert_eq!(deepest(&program).bytes, 8);
}

/// A vtable of Rust: what drops it, size, alignment, then methods.
#[test]
fn a_call_by_a_vtable_reaches_the_methods_at_its_offset() {
    let [first, second, other] = [CODE + 0x20, CODE + 0x30, CODE + 0x40];
    let data = CODE + 0x60;
    let table = [0, 8, 4, first | 1, second | 1];
    // A pointer of its own behind it, and where both begin.
    let rest = [other | 1, data, data + 20];
    let words: Vec<_> = table.into_iter().chain(rest).flat_map(word).collect();
    let by = |load: u16| {
        [
            PUSH_LR, 0x6841, // ldr r1, [r0, #4]
            load,   // ldr r2, [...]
            0x4790, // blx r2
            POP_PC,
        ]
    };
    for (load, from, expected) in [
        (0x68CA, Origin::Offset(12), vec![first]), // ldr r2, [r1, #12]
        (0x690A, Origin::Offset(16), vec![second]), // ldr r2, [r1, #16]
        (0x684A, Origin::Offset(4), vec![other]),  // ldr r2, [r1, #4]
        (0x58CA, Origin::Indexed, vec![other]),    // ldr r2, [r1, r3]
        (0x43CA, Origin::Unknown, vec![first, second, other]), // mvns r2, r1
    ] {
        let program = program(&[
            (CODE, "f", &by(load)),
            (first, "first", &taking(40)),
            (second, "second", &taking(80)),
            (other, "other", &taking(120)),
            (data, "", &words),
        ]);
        let calls = calls(&program, &[]);
        let call = &calls.frames[&CODE].calls[&(CODE + 6)];
        assert_eq!(call.targets, BTreeSet::from([Target::Pointer(from)]));
        let reached: Vec<_> = calls.reached_by(call).into_iter().collect();
        assert_eq!(reached, expected, "{from:?}");
        let most = expected.iter().map(|target| calls.deepest(*target).bytes);
        assert_eq!(calls.deepest(CODE).bytes, 4 + most.max().unwrap());
    }
}

#[test]
fn a_call_by_a_known_address_is_a_call_of_that_function() {
    let g = CODE + 0x20;
    let address = word(g | 1);
    let f = [
        PUSH_LR, 0x4901, // ldr r1, =g
        0x4788, // blx r1
        POP_PC, address[0], address[1],
    ];
    let program = program(&[(CODE, "f", &f), (g, "g", &taking(12))]);
    assert_eq!(deepest(&program).bytes, 16);
}

/// Calls itself while R0 is not 0.
fn recursive() -> Program {
    let call = bl(CODE + 8, CODE);
    program(&[(
        CODE,
        "f",
        &[
            0xB510, // push {r4, lr}
            0x2800, // cmp r0, #0
            0xD002, // beq to the pop
            0x3801, // subs r0, #1
            call[0], call[1], 0xBD10, // pop {r4, pc}
        ],
    )])
}

#[test]
fn recursion_has_no_bound_but_one_that_is_given() {
    let program = recursive();
    let unbounded = calls(&program, &[]).recursions(&program);
    assert_eq!(unbounded.len(), 1);
    assert_eq!(unbounded[0].what, "recursion without a bound: f calls f");
    let three = Bounded { function: "f".into(), times: 3, why: String::new() };
    let calls = calls(&program, &[three]);
    assert_eq!(calls.recursions(&program), []);
    assert_eq!(calls.deepest(CODE).bytes, 3 * 8);
    assert_eq!(calls.deepest(CODE).path.len(), 3);
}

/// As the compiler makes a jump by a table of bytes, here without a bound on the index.
#[test]
fn a_table_of_offsets_is_followed_to_its_end() {
    let f = [
        PUSH_LR, 0x4478, // add r0, pc
        0x7900, // ldrb r0, [r0, #4]
        0x0040, // lsls r0, r0, #1
        0x4487, // add pc, r0
        0x0401, // offsets 1 and 4: to CODE + 14 and CODE + 20
        0x0001, // offset 1, and a byte that fills up
        0xB090, // sub sp, #64
        0xB010, // add sp, #64
        POP_PC, 0xB0A0, // sub sp, #128
        0xB020, // add sp, #128
        POP_PC,
    ];
    let program = program(&[(CODE, "f", &f)]);
    assert_eq!(deepest(&program).bytes, 4 + 128);
}

#[test]
fn a_table_of_addresses_is_followed_and_ends_at_its_first_target() {
    let target = |at: u32| word((CODE + at) | 1);
    let [first, second] = [target(16), target(20)];
    let f = [
        0x0080, // lsls r0, r0, #2
        0xA101, // adr r1, the table
        0x5808, // ldr r0, [r1, r0]
        0x4687, // mov pc, r0
        first[0], first[1], second[0], second[1], 0xB090, 0xB010, // sub and add sp, #64
        0xB0A0, 0xB020, // sub and add sp, #128
        BX_LR,
    ];
    let program = program(&[(CODE, "f", &f)]);
    assert_eq!(deepest(&program).bytes, 128);
    let code = found(&program).code;
    assert!(!code.contains(&(CODE + 8)) && code.contains(&(CODE + 20)));
}

/// B reaches 2 KB: in a larger function the compiler jumps by BL, having saved LR.
#[test]
fn bl_within_a_function_is_a_jump() {
    let jump = bl(CODE + 2, CODE + 8);
    let f = [
        0xB510, // push {r4, lr}
        jump[0], jump[1], 0xFFFF, // no code
        0xBD10, // pop {r4, pc}
    ];
    let program = program(&[(CODE, "f", &f)]);
    let calls = calls(&program, &[]);
    assert_eq!(calls.deepest(CODE).bytes, 8);
    assert!(calls.frames[&CODE].calls.is_empty());
}

#[test]
fn a_stack_pointer_that_is_not_known_has_no_bound() {
    for (code, why) in [
        (&[0x4685, BX_LR][..], "sets the stack pointer"), // mov sp, r0
        (&[0xB082, 0xE7FD], "stack pointers that differ"), // sub sp, #8; b to it
        (&[0xB082, BX_LR], "returns with its stack in use"),
        (&[0xB002, BX_LR], "gives back more"),
        (&[0x4687], "jumps to what is not known"), // mov pc, r0
        (&[0xF380, 0x8808, BX_LR], "writes a stack pointer"), // msr msp, r0
        (&[0xFFFF, 0xFFFF], "no instruction"),
        (&[0x46C0], "is no code"), // the image ends
    ] {
        let program = program(&[(CODE, "f", code)]);
        assert!(problems(&program).contains(why), "{why}: {}", problems(&program));
    }
}

#[test]
fn one_handler_of_each_priority_is_on_the_stack() {
    let sizes = [(1, 8), (3, 20), (15, 24), (16, 60), (17, 40), (18, 16)];
    let functions: Vec<_> =
        sizes.iter().map(|(number, bytes)| (CODE + 0x10 * (number - 1), taking(*bytes))).collect();
    let vectors: Vec<_> = sizes
        .iter()
        .zip(&functions)
        .map(|((number, _), (at, _))| (IMAGE + 4 * number, word(at | 1)))
        .collect();
    let names = ["main", "hard fault", "tick", "first", "second", "third"];
    let functions = functions.iter().zip(names);
    let functions = functions.map(|((at, code), name)| (*at, name, &code[..]));
    let vectors = vectors.iter().map(|(at, words)| (*at, "", &words[..]));
    let parts: Vec<_> = functions.chain(vectors).collect();
    let program = program(&parts);
    let handlers = program.handlers();
    assert_eq!(handlers.len(), 6);
    let found = explore(&program, handlers.values().copied(), &program.pointers());
    let calls = Calls::new(&program, found.frames, program.pointers(), &[]);
    // The tick and the first two interrupts share a priority; the third is less urgent.
    let mut priorities = [0; EXCEPTIONS];
    (priorities[2], priorities[3]) = (-2, -1);
    for number in [15, 16, 17] {
        priorities[number] = 1;
    }
    priorities[18] = 3;
    let levels = levels(handlers[&1], &handlers, &priorities, &calls);
    let seen = levels.iter().map(|level| (&*level.name, level.exception, level.deepest.bytes));
    let expected = [
        ("main", None, 8),
        ("priority 3", Some(18), 16),
        ("priority 1", Some(16), 60),
        ("HardFault", Some(3), 20),
    ];
    assert_eq!(seen.collect::<Vec<_>>(), expected);
    // With the reset's own way and what three exceptions stack: 8 + 16 + 60 + 20 + 3 * 36.
    let analysis = super::Analysis::of(program, &priorities, &[]).unwrap();
    assert_eq!(analysis.worst(), Some(212));
}
