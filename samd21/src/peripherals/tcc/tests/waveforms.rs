//! Ramps, polarities, ways of generation, commands and buffers.

use super::*;

/// WAVE.RAMP: RAMP2A, RAMP2.
const RAMP2A: u32 = 1 << 4;
const RAMP2: u32 = 2 << 4;

/// A timer with cycles of 1,000 counts and CC1 at 300, enabled at 0 with these bits of WAVE and of
/// CTRLB.
fn short(wave: u32, ctrlb: u8) -> Rig {
    short_at(5, wave, ctrlb)
}

/// The same, with another output than that of channel 1.
fn short_at(output: u8, wave: u32, ctrlb: u8) -> Rig {
    let mut rig = Rig::new(Ticks::ZERO);
    rig.output = output;
    rig.write(0, 0x3C, wave);
    rig.write(0, 0x40, 999);
    rig.write(0, 0x44, 200);
    rig.write(0, 0x48, 300);
    rig.command(0, u32::from(ctrlb));
    rig.write(0, 0x00, ENABLE);
    rig
}

fn rises_and_falls(rig: &Rig) -> (Vec<u64>, Vec<u64>) {
    let (up, down): (Vec<_>, Vec<_>) = rig.edges.iter().partition(|(_, level)| *level);
    let times = |edges: Vec<(u64, bool)>| edges.into_iter().map(|(at, _)| at).collect();
    (times(up), times(down))
}

/// Table 31-3: counting down it is set by the match with CC and cleared at 0.
#[test]
fn counting_down_the_pulse_is_at_the_end_of_the_cycle() {
    let mut rig = short(NPWM, DIR);
    rig.run(2500);
    // From 0 it goes on at the top, with the count 1; 699 counts later it is at 300.
    assert_eq!(rises_and_falls(&rig), (vec![0, 1 + 699, 1001 + 699], vec![1, 1001, 2001]));
    assert_eq!(rig.read(2500, 0x2C) & OVF, OVF);
}

#[test]
fn a_direction_that_changes_in_a_pulse_brings_the_count_back() {
    let mut rig = short(NPWM, 0);
    rig.command(100, u32::from(DIR));
    rig.run(1000);
    // Up for 100 counts, down for 100 and the count 0; then from the top to 300.
    assert_eq!(rig.edges, [(0, true), (201, false), (201 + 699, true)]);
}

#[test]
fn polarity_turns_the_pulse_round() {
    let mut rig = short(NPWM | 1 << 17, 0);
    rig.run(2000);
    assert_eq!(rises_and_falls(&rig), (vec![300, 1300], vec![1000, 2000]));
}

#[test]
fn frequency_generation_toggles_at_the_match() {
    let mut normal = short(0, 0);
    normal.run(3000);
    assert_eq!(normal.edges, [(300, true), (1300, false), (2300, true)]);
    // The top is CC0: cycles of 201 counts, so CC1, which is beyond, is never met.
    let mut matched = short_at(4, 1, 0);
    matched.run(500);
    assert_eq!(matched.edges, [(200, true), (401, false)]);
}

/// Set by the match on the way up, cleared by that on the way down; twice TOP a cycle.
#[test]
fn two_slopes_make_a_pulse_round_the_top() {
    for (generation, overflow) in [(5, 1998), (6, 999), (7, 999)] {
        let mut rig = short(generation, 0);
        rig.run(overflow - 1);
        assert_eq!(rig.read(overflow - 1, 0x2C) & OVF, 0, "{generation}");
        rig.run(4000);
        assert_eq!(rig.read(4000, 0x2C) & OVF, OVF);
        assert_eq!(
            rises_and_falls(&rig),
            (vec![300, 1998 + 300], vec![1998 - 300, 2 * 1998 - 300])
        );
    }
    // Critical: the second half of the channels says when it falls.
    let mut critical = short(4, 0);
    critical.write(0, 0x50, 700);
    critical.run(1998);
    assert_eq!(critical.edges, [(300, true), (1998 - 700, false)]);
}

#[test]
fn two_ramps_give_each_channel_every_other_cycle() {
    let mut odd = short(NPWM | RAMP2, 0);
    odd.run(4500);
    assert_eq!(rises_and_falls(&odd), (vec![1000, 3000], vec![1300, 3300]));
    let mut even = short_at(4, NPWM | RAMP2, 0);
    even.run(2500);
    assert_eq!(rises_and_falls(&even), (vec![0, 2000], vec![200, 2200]));
    // CC0 is that of both.
    let mut alternate = short(NPWM | RAMP2A, 0);
    alternate.run(2500);
    assert_eq!(alternate.edges, [(1000, true), (1200, false)]);
    // IDXCMD HOLD: the same cycle once more.
    let mut held = short(NPWM | RAMP2, IDXCMD);
    held.run(3500);
    assert_eq!(rises_and_falls(&held), (vec![2000], vec![2300]));
}

#[test]
fn circular_buffers_are_exchanged() {
    // CICCEN1, with 500 in the buffer.
    let mut rig = short(NPWM | 1 << 9, 0);
    rig.write(10, 0x74, 500);
    rig.run(2999);
    assert_eq!(rises_and_falls(&rig), (vec![0, 1000, 2000], vec![300, 1500, 2300]));
}

#[test]
fn wave_and_pattern_are_buffered_too() {
    let mut rig = short(NPWM, 0);
    rig.write(10, 0x68, NPWM | 1 << 17);
    rig.write(10, 0x64, 0x2020);
    assert_eq!(rig.read(10, 0x30) & BUFFERS, WAVEBV | PATTBV);
    rig.run(1100);
    // PGE5 with PGV5 from the update on.
    assert_eq!(rig.edges, [(0, true), (300, false), (1000, true)]);
    assert_eq!(rig.read(1100, 0x3C), NPWM | 1 << 17);
    assert_eq!(rig.read(1100, 0x38), 0x2020);
    assert_eq!(rig.read(1100, 0x30) & BUFFERS, 0);
}

#[test]
fn a_retrigger_begins_anew_and_auto_lock_locks_the_buffers() {
    let mut rig = short(NPWM, 0);
    rig.command(250, 1 << 5);
    rig.run(1300);
    assert_eq!(rig.edges, [(0, true), (550, false), (1250, true)]);
    let mut locked = Rig::new(Ticks::ZERO);
    locked.write(0, 0x3C, NPWM);
    locked.write(0, 0x40, 999);
    locked.write(0, 0x48, 300);
    locked.write(0, 0x00, ALOCK);
    locked.write(0, 0x00, ALOCK | ENABLE);
    locked.write(10, 0x74, 400);
    locked.run(1010);
    locked.write(1010, 0x74, 500);
    locked.run(2999);
    // The first update came, and locked the second.
    assert_eq!(rises_and_falls(&locked), (vec![0, 1000, 2000], vec![300, 1400, 2400]));
    assert_eq!(locked.read(2999, 0x04) & u32::from(LUPD), u32::from(LUPD));
}

#[test]
fn a_stop_releases_the_outputs_or_brings_them_to_the_safe_level() {
    let mut rig = short(NPWM, 0);
    rig.command(100, 2 << 5);
    assert_eq!(rig.tcc.outputs(), Waveforms::default());
    assert_eq!(rig.read(200, 0x30) & STATUS_STOP, STATUS_STOP);
    // A retrigger of a stopped timer goes on from where it stands.
    rig.command(500, 1 << 5);
    rig.run(2000);
    assert_eq!(
        rig.edges,
        [(0, true), (100, false), (500, true), (700, false), (1400, true), (1700, false)]
    );
    // NRE5 and NRV5.
    let mut safe = Rig::new(Ticks::ZERO);
    safe.write(0, 0x18, 1 << 5 | 1 << 13);
    safe.write(0, 0x3C, NPWM);
    safe.write(0, 0x40, 999);
    safe.write(0, 0x48, 300);
    safe.command(0, u32::from(ONESHOT));
    safe.write(0, 0x00, ENABLE);
    safe.run(5000);
    assert_eq!(safe.edges, [(0, true), (300, false), (1000, true)]);
    assert_eq!(safe.tcc.outputs().level(4), None);
}

#[test]
fn dithering_takes_the_lowest_bits() {
    // DITH4: PER 959,999 counts 60,000, CC 72,000 is 4,500.
    let mut rig = Rig::new(Ticks::ZERO);
    rig.write(0, 0x3C, NPWM);
    rig.write(0, 0x40, 959_999);
    rig.write(0, 0x48, 72_000);
    rig.write(0, 0x00, 1 << 5);
    rig.write(0, 0x00, 1 << 5 | ENABLE);
    rig.run(60_000);
    assert_eq!(rig.edges, [(0, true), (4500, false), (60_000, true)]);
    rig.command(61_000, 4 << 5);
    assert_eq!(rig.read(61_000, 0x34), 1000 << 4);
}
