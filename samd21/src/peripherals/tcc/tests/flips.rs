//! Bits that flip while servo pulses of 1.5 ms go out, 20 ms apart, counted at 48 MHz.

use super::*;

/// The edges of a servo's timer in the first 50 ms, with a bit that flips at 10 ms, between two
/// pulses.
fn flipped(offset: u32, bit: u32) -> Vec<(u64, bool)> {
    flipped_at(480_000, offset, bit)
}

fn flipped_at(at: u64, offset: u32, bit: u32) -> Vec<(u64, bool)> {
    let mut rig = Rig::servo(72_000);
    rig.flip(at, offset, bit);
    rig.run(2_400_000);
    rig.edges
}

/// What they are without a flip.
const SOUND: [(u64, bool); 6] = [
    (0, true),
    (72_000, false),
    (960_000, true),
    (1_032_000, false),
    (1_920_000, true),
    (1_992_000, false),
];

#[test]
fn bits_that_do_nothing_alone() {
    for (offset, bits) in [
        (0x00, vec![11, 12, 13]),
        // HALT, BLANK, KEEP and the rest without a source.
        (0x0C, vec![0, 3, 4, 5, 6, 7, 8, 9, 10, 12, 16, 24]),
        (0x10, vec![0, 3, 4, 5, 6, 7, 8, 9, 10, 12, 16, 24]),
        // OTMX 1 gives WO[5] channel 1 still; DTIEN0 is another pair's, DTLS and DTHS nobody's.
        (0x14, vec![0, 8, 16, 31]),
        // NREx and NRVx, the inversion of others, filters.
        (0x18, vec![5, 13, 20, 24]),
        (0x1C, vec![16, 18]),
        (0x20, vec![0, 3, 4, 6, 8, 12, 14, 16, 24]),
        (0x38, vec![4, 13]),
        // SWAP of two equal outputs; polarity and circular buffer of another channel, CIPEREN
        // without a second period.
        (0x3C, vec![8, 16, 25]),
        (0x64, vec![5]),
        (0x68, vec![17]),
    ] {
        for bit in bits {
            assert_eq!(flipped(offset, bit), SOUND, "{offset:#x} {bit}");
        }
    }
}

#[test]
fn no_pulse_from_then_on() {
    let silent = &SOUND[..2];
    // OTMX 2: channel 0, which has no pulse. SRC INVERT of fault B. PGE5. CC1's buffer of 0 that
    // becomes valid. RAMP2, in whose cycles A channel 1 has none, comes below.
    for (offset, bit) in [(0x14, 1), (0x10, 1), (0x38, 5), (0x30, 17)] {
        assert_eq!(flipped(offset, bit), silent, "{offset:#x} {bit}");
    }
    // The counter stands: STOP, FAULT0, FAULT1, the command, events to be counted, CPTEN1.
    for (offset, bit) in
        [(0x30, 0), (0x30, 14), (0x30, 15), (0x04, 6), (0x20, 1), (0x20, 2), (0x20, 5), (0x00, 25)]
    {
        assert_eq!(flipped(offset, bit), silent, "{offset:#x} {bit}");
    }
}

#[test]
fn a_pin_that_is_high_for_ever() {
    let first = SOUND[0];
    // Within a pulse: events to be counted, capture, the reserved way of generation.
    for (offset, bit) in [(0x20, 1), (0x00, 25), (0x3C, 0)] {
        assert_eq!(flipped_at(36_000, offset, bit), [first], "{offset:#x} {bit}");
    }
    // What releases the pin makes it low.
    for (offset, bit) in [(0x30, 0), (0x30, 14), (0x04, 6)] {
        let cut = [first, (36_000, false)];
        assert_eq!(flipped_at(36_000, offset, bit), cut, "{offset:#x} {bit}");
    }
    // COUNT beyond the period: 2^20 counts are added to 0.75 ms of the pulse, and the end is at
    // 2^24.
    let mut rig = Rig::servo(72_000);
    rig.flip(36_000, 0x34, 20);
    let end = 36_000 + (1 << 24) - (1 << 20) - 36_000;
    rig.run(end + 72_000);
    assert_eq!(rig.edges, [first, (end + 72_000, false)]);
}

#[test]
fn wrong_pulses() {
    // INVEN5 and DTIEN1, whose high side is WO[5]: the pulse is low and the gap high.
    for (offset, bit) in [(0x18, 21), (0x14, 9)] {
        let edges = flipped(offset, bit);
        assert_eq!(
            edges[2..],
            [
                (480_000, true),
                (960_000, false),
                (1_032_000, true),
                (1_920_000, false),
                (1_992_000, true),
            ],
            "{offset:#x} {bit}"
        );
    }
    // POL1: set by the match and cleared at the top from then on.
    assert_eq!(flipped(0x3C, 17)[2..], [(1_032_000, true), (1_920_000, false), (1_992_000, true)]);
    // WAVEGEN DSBOTH: 38.5 ms up to the top and down, of which it is high above 1.5 ms.
    let top = 480_000 + 479_999;
    assert_eq!(flipped(0x3C, 2)[2..], [(top + 959_999 + 72_000, true)],);
    // DIR in the midst of the gap: down to 1.5 ms, and from there to 0.
    assert_eq!(flipped(0x04, 0)[2..4], [(480_000 + 408_000, true), (480_000 + 480_001, false)]);
    // RETRIGGER within a pulse lengthens it.
    assert_eq!(flipped_at(36_000, 0x04, 5)[..2], [(0, true), (108_000, false)]);
    // RAMP2: every other frame. The first update makes it cycle B, which is channel 1's.
    assert_eq!(flipped(0x3C, 5), SOUND[..4]);
    // RAMP2A: with channel 0's width, which is 0.
    assert_eq!(flipped(0x3C, 4), SOUND[..2]);
    // CICCEN1 exchanges it with its buffer, which is 0.
    assert_eq!(flipped(0x3C, 9), [&SOUND[..2], &SOUND[4..]].concat());
    // RESOLUTION: COUNT is beyond the sixteenth of the period, and goes to 2^20.
    let end = 1 << 20;
    let edges = flipped(0x00, 5);
    assert_eq!(edges[2..5], [(end, true), (end + 4500, false), (end + 60_000, true)]);
}

#[test]
fn each_bit_that_flips_is_read_back_and_flips_back() {
    let mut bits = 0;
    for offset in (0..0x80).step_by(4) {
        for bit in 0..32 {
            // What is done once is not undone: a software reset, a command.
            if (offset, bit) == (0, 0) || offset == 4 && bit > 4 {
                continue;
            }
            let mut rig = Rig::servo(72_000);
            rig.run(480_000);
            if !rig.tcc.flip(Ticks(480_000), offset, bit) {
                continue;
            }
            bits += 1;
            rig.command(480_000, 4 << 5);
            let read = rig.read(480_000, offset) >> bit & 1;
            assert!(rig.tcc.flip(Ticks(480_000), offset, bit));
            rig.command(480_000, 4 << 5);
            let again = rig.read(480_000, offset) >> bit & 1;
            assert_eq!(read ^ 1, again, "{offset:#x} {bit}");
        }
    }
    // 11 registers of 24 bits; CTRLA 14, CTRLB 5, FCTRLx 2 times 26, WEXCTRL 22, DRVCTRL 32,
    // DBGCTRL 2, EVCTRL 23, INTENSET and INTFLAG 13, STATUS 11, PATTx 16, WAVEx 18.
    assert_eq!(bits, 264 + 14 + 5 + 52 + 22 + 32 + 2 + 23 + 26 + 11 + 32 + 36);
    let mut rig = Rig::servo(72_000);
    rig.flip(0, 0x00, 0);
    assert_eq!(rig.read(0, 0x40), 0xFF_FFFF, "SWRST");
    assert!(!rig.tcc.flip(Ticks(0), 0x08, 1), "SYNCBUSY");
    assert!(!rig.tcc.flip(Ticks(0), 0x40, 24), "beyond 24 bits");
}
