//! Programs and outcomes that `samd21/tools/differential.py --vectors` has stored: each was run on
//! Unicorn's Cortex-M0, and together they reach every encoding that the tool generates.
//!
//! To store them anew, from the repository's root: `python3 samd21/tools/differential.py
//! --sequences 320 --seed 7 --vectors samd21/tests/vectors/unicorn.bin`

#[allow(unreachable_pub)]
mod case;

use case::{Case, chip, take, words};

const STORED: &[u8] = include_bytes!("unicorn.bin");

#[test]
fn the_core_agrees_with_an_independent_one() {
    let mut rest = STORED;
    let seed = u64::from_le_bytes(take(&mut rest).expect("a seed"));
    let count = u32::from_le_bytes(take(&mut rest).expect("a count"));
    assert!(count >= 300, "{count} programs are stored");
    let mut chip = chip(seed);
    for number in 0..count {
        let case = Case::parse(&mut rest).expect("a program");
        let expected = words(&mut rest).expect("its outcome");
        let memory = u64::from_le_bytes(take(&mut rest).expect("its memory"));
        let outcome = case.run(&mut chip);
        assert_eq!(outcome, expected, "program {number}: registers");
        assert_eq!(fnv1a(chip.memory.ram()), memory, "program {number}: memory");
    }
    assert!(rest.is_empty());
}

/// 64-bit FNV-1a.
fn fnv1a(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xCBF2_9CE4_8422_2325, |hash, byte| {
        (hash ^ u64::from(*byte)).wrapping_mul(0x100_0000_01B3)
    })
}
