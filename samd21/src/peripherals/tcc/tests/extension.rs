//! From the channels to the pins: matrix, dead times, swap, pattern, inversion.

use super::*;

/// A timer with cycles of 1,000 counts, CCx at 100, 300, 500 and 700, and these registers.
fn rig(wexctrl: u32, drvctrl: u32, patt: u32, swap: u32) -> Rig {
    rig_at(5, wexctrl, drvctrl, patt, swap)
}

fn rig_at(output: u8, wexctrl: u32, drvctrl: u32, patt: u32, swap: u32) -> Rig {
    let mut rig = Rig::new(Ticks::ZERO);
    rig.output = output;
    rig.write(0, 0x14, wexctrl);
    rig.write(0, 0x18, drvctrl);
    rig.write(0, 0x38, patt);
    rig.write(0, 0x3C, NPWM | swap << 24);
    rig.write(0, 0x40, 999);
    for (channel, cc) in (0..).zip([100, 300, 500, 700]) {
        rig.write(0, 0x44 + 4 * channel, cc);
    }
    rig.write(0, 0x00, ENABLE);
    rig
}

/// Levels of all outputs at `now`.
fn levels(rig: &mut Rig, now: u64) -> u8 {
    rig.run(now);
    let outputs = rig.tcc.outputs();
    assert_eq!(outputs.driven, 0xFF);
    outputs.high
}

/// Table 31-4. At 50 all channels are high, at 200 all but 0, at 400 channels 2 and 3.
#[test]
fn the_matrix_distributes_the_channels() {
    for (otmx, at_200, at_400) in
        [(0, 0b1110_1110, 0b1100_1100), (1, 0b1010_1010, 0), (2, 0, 0), (3, 0b1111_1110, 0)]
    {
        let mut rig = rig(otmx, 0, 0, 0);
        let seen = [50, 200, 400].map(|now| levels(&mut rig, now));
        assert_eq!(seen, [0xFF, at_200, at_400], "OTMX {otmx}");
    }
}

/// Channel 1 is high from 0 to 300. The low side, WO\[1\], rises 40 cycles late, and the high side,
/// WO\[5\], is the inverse and rises 60 cycles late.
#[test]
fn dead_times_part_low_and_high_side() {
    let wexctrl = 1 << 9 | 40 << 16 | 60 << 24;
    let mut low = rig_at(1, wexctrl, 0, 0, 0);
    low.run(1100);
    assert_eq!(low.edges, [(40, true), (300, false), (1040, true)]);
    let mut high = rig(wexctrl, 0, 0, 0);
    high.run(1400);
    assert_eq!(high.edges, [(360, true), (1000, false), (1360, true)]);
    // Without a dead time it is the inverse alone; other pairs are as they are.
    let mut inverse = rig(1 << 9, 0, 0, 0);
    assert_eq!(levels(&mut inverse, 50), 0b1101_1111);
    assert_eq!(levels(&mut inverse, 400), 0b1110_1100);
    // SWAP1 gives WO[1] the high side.
    let mut swapped = rig_at(1, wexctrl, 0, 0, 1 << 1);
    swapped.run(1400);
    assert_eq!(swapped.edges, [(360, true), (1000, false), (1360, true)]);
}

#[test]
fn the_pattern_overrides_and_inversion_comes_last() {
    // PGE5 alone: low. With PGV5: high.
    let mut low = rig(0, 0, 0x0020, 0);
    assert_eq!(levels(&mut low, 50), 0b1101_1111);
    let mut high = rig(0, 0, 0x2020, 0);
    assert_eq!(levels(&mut high, 400), 0b1110_1100);
    // INVEN5 turns pulse and gap round, and what the pattern gives.
    let mut inverted = rig(0, 1 << 21, 0, 0);
    inverted.run(1400);
    assert_eq!(inverted.edges, [(300, true), (1000, false), (1300, true)]);
    let mut both = rig(0, 1 << 21, 0x2020, 0);
    assert_eq!(levels(&mut both, 50), 0b1101_1111);
}
