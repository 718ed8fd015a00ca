use super::*;
use crate::board::Unconnected;
use crate::peripherals::violations::Violations;

mod extension;
mod flips;
mod waveforms;

/// WAVE.WAVEGEN.
const NPWM: u32 = 2;

/// A TCC at 48 MHz with the edges of one output: WO\[5\] (channel 1), if no other is asked for. A
/// released one counts as low.
struct Rig {
    tcc: Tcc,
    violations: Violations,
    output: u8,
    edges: Vec<(u64, bool)>,
    level: bool,
}

impl Rig {
    fn new(hold: Ticks) -> Self {
        let mut tcc = Tcc::new(0, hold);
        tcc.set_clock(Ticks::ZERO, Some(Rate::from_hz(48_000_000)));
        Self { tcc, violations: Violations::default(), output: 5, edges: Vec::new(), level: false }
    }

    fn try_write(&mut self, now: u64, offset: u32, lanes: Lanes) -> Write {
        self.run(now);
        let mut bus =
            Bus { now: Ticks(now), board: &mut Unconnected, violations: &mut self.violations };
        let done = self.tcc.write(&mut bus, offset, lanes);
        self.look(now);
        done
    }

    fn write(&mut self, now: u64, offset: u32, value: u32) {
        self.try_write(now, offset, Lanes::word(value)).unwrap();
    }

    fn command(&mut self, now: u64, set: u32) {
        self.try_write(now, 0x04, Lanes::new(set, 1, 1)).unwrap();
    }

    fn read(&mut self, now: u64, offset: u32) -> u32 {
        self.tcc.read(Ticks(now), offset).unwrap()
    }

    fn run(&mut self, until: u64) {
        while self.tcc.next() <= Ticks(until) {
            let at = self.tcc.next();
            self.tcc.advance(at);
            self.look(at.0);
        }
    }

    fn look(&mut self, now: u64) {
        let level = self.tcc.outputs().level(self.output) == Some(true);
        if level != self.level {
            self.level = level;
            self.edges.push((now, level));
        }
    }

    fn flip(&mut self, now: u64, offset: u32, bit: u32) {
        self.run(now);
        assert!(self.tcc.flip(Ticks(now), offset, bit), "{offset:#x} {bit}");
        self.look(now);
    }

    /// NPWM, PER 959999 (20 ms), CC1 as given, enabled at 0.
    fn servo(cc: u32) -> Self {
        let mut rig = Self::new(Ticks::ZERO);
        rig.write(0, 0x3C, NPWM);
        rig.write(0, 0x40, 959_999);
        rig.write(0, 0x48, cc);
        rig.write(0, 0x00, ENABLE);
        rig
    }
}

#[test]
fn a_servo_frame_follows_the_buffered_compare_from_the_next_overflow() {
    let mut rig = Rig::servo(72_000);
    rig.write(500_000, 0x74, 96_000);
    assert_eq!(rig.read(500_000, 0x30) & BUFFERS, CCBV0 << 1, "CCBV1, running");
    assert_eq!(rig.read(500_000, 0x48), 72_000);
    rig.run(2_000_000);
    assert_eq!(
        rig.edges,
        [(0, true), (72_000, false), (960_000, true), (960_000 + 96_000, false), (1_920_000, true)]
    );
    assert_eq!(rig.read(2_000_000, 0x30) & BUFFERS, 0);
    assert_eq!(rig.read(2_000_000, 0x48), 96_000);
}

#[test]
fn lupd_keeps_the_buffer_until_it_is_released() {
    let mut rig = Rig::servo(72_000);
    rig.command(10, u32::from(LUPD));
    rig.write(20, 0x74, 96_000);
    rig.run(1_000_000);
    assert_eq!(rig.read(1_000_000, 0x48), 72_000);
    assert_eq!(rig.read(1_000_000, 0x30) & BUFFERS, CCBV0 << 1);
    rig.try_write(1_000_000, 0x04, Lanes::new(u32::from(LUPD), 0, 1)).unwrap();
    rig.run(1_920_000);
    assert_eq!(rig.read(1_920_000, 0x48), 96_000);
}

#[test]
fn a_direct_compare_below_count_gives_a_long_pulse() {
    // COUNT is at 60,000 of a 72,000 pulse when CC becomes 50,000: the match is missed, the pin
    // stays high through the frame and the next pulse.
    let mut rig = Rig::servo(72_000);
    rig.write(60_000, 0x48, 50_000);
    rig.run(1_920_000);
    assert_eq!(rig.edges, [(0, true), (960_000 + 50_000, false), (1_920_000, true)]);
}

#[test]
fn zero_duty_gives_no_edge_and_full_duty_no_gap() {
    let mut rig = Rig::servo(0);
    rig.run(3_000_000);
    assert_eq!(rig.edges, []);
    let mut rig = Rig::servo(960_000);
    rig.run(3_000_000);
    assert_eq!(rig.edges, [(0, true)]);
}

#[test]
fn overflow_and_match_raise_flags_and_the_interrupt() {
    let mut rig = Rig::servo(72_000);
    rig.write(0, 0x28, OVF | MC0 << 1);
    rig.run(71_999);
    assert_eq!(rig.tcc.interrupts.irq(), 0);
    rig.run(72_000);
    assert_eq!(rig.read(72_000, 0x2C) & MC0 << 1, MC0 << 1);
    assert_eq!(rig.tcc.interrupts.irq(), 1 << 15);
    rig.write(72_001, 0x2C, MC0 << 1);
    assert_eq!(rig.tcc.interrupts.irq(), 0);
    rig.run(960_000);
    assert_eq!(rig.read(960_000, 0x2C) & OVF, OVF);
}

#[test]
fn the_prescaler_divides_and_a_new_period_moves_the_overflow() {
    let mut rig = Rig::new(Ticks::ZERO);
    rig.write(0, 0x3C, NPWM);
    rig.write(0, 0x40, 59_999);
    rig.write(0, 0x48, 4569);
    rig.write(0, 0x00, 4 << 8);
    rig.write(0, 0x00, 4 << 8 | ENABLE);
    rig.write(100, 0x6C, 29_999);
    rig.run(16 * 60_000 + 16 * 30_000);
    let frame = 16 * 60_000;
    assert_eq!(
        rig.edges,
        [
            (0, true),
            (16 * 4569, false),
            (frame, true),
            (frame + 16 * 4569, false),
            (frame + 16 * 30_000, true)
        ]
    );
}

#[test]
fn count_is_what_the_last_readsync_saw() {
    let mut rig = Rig::servo(72_000);
    assert_eq!(rig.read(5000, 0x34), 0);
    rig.command(5000, 4 << 5);
    assert_eq!(rig.read(5010, 0x34), 5000);
    rig.command(960_000 + 77, 4 << 5);
    assert_eq!(rig.read(960_100, 0x34), 77);
}

#[test]
fn a_second_write_while_synchronising_is_discarded_and_noted() {
    let mut rig = Rig::new(Ticks(200));
    rig.write(0, 0x74, 1000);
    assert_eq!(rig.read(199, 0x08), 1 << 20);
    rig.write(100, 0x74, 2000);
    assert_eq!(rig.read(200, 0x08), 0);
    assert_eq!(rig.read(200, 0x74), 1000);
    assert_eq!(rig.violations.count, 1);
    rig.write(200, 0x74, 3000);
    assert_eq!(rig.read(200, 0x74), 3000);
    assert_eq!(rig.violations.count, 1);
    // COUNT is not there before READSYNC has synchronised.
    rig.write(1000, 0x00, ENABLE);
    rig.command(2000, 4 << 5);
    assert_eq!(rig.read(2100, 0x34), 0);
    assert_eq!(rig.read(2200, 0x34), 1000);
}

#[test]
fn disabling_releases_the_pin_and_keeps_count() {
    let mut rig = Rig::servo(72_000);
    rig.write(30_000, 0x00, 0);
    assert_eq!(rig.edges, [(0, true), (30_000, false)]);
    assert_eq!(rig.tcc.next(), Ticks::NEVER);
    rig.write(40_000, 0x00, ENABLE);
    rig.run(90_000);
    assert_eq!(rig.edges[2..], [(40_000, true), (82_000, false)]);
}

#[test]
fn without_a_clock_nothing_counts_and_synchronisation_hangs() {
    let mut rig = Rig::new(Ticks::ZERO);
    rig.tcc.set_clock(Ticks(0), None);
    rig.write(0, 0x00, ENABLE);
    assert_eq!(rig.read(1_000_000, 0x08), 1 << 1);
    assert_eq!(rig.tcc.next(), Ticks::NEVER);
    rig.tcc.set_clock(Ticks(2_000_000), Some(Rate::from_hz(48_000_000)));
    assert_eq!(rig.read(2_000_000, 0x08), 0);
    assert_eq!(rig.tcc.next(), Ticks(2_000_000 + (1 << 24)));
}

#[test]
fn software_reset_forgets_all_but_the_clock() {
    let mut rig = Rig::servo(72_000);
    rig.write(1000, 0x00, SWRST);
    assert_eq!(rig.read(1000, 0x40), 0xFF_FFFF);
    assert_eq!(rig.read(1000, 0x00), 0);
    assert_eq!(rig.edges, [(0, true), (1000, false)]);
}

#[test]
fn what_is_not_modelled_is_loud() {
    let mut rig = Rig::new(Ticks::ZERO);
    let mut refused = |offset, lanes| rig.try_write(0, offset, lanes).is_err();
    assert!(refused(0x3C, Lanes::word(3)), "WAVEGEN, reserved");
    assert!(refused(0x3C, Lanes::word(1 << 12)), "WAVE, reserved");
    assert!(refused(0x0C, Lanes::word(2)), "FCTRLA, an event");
    assert!(refused(0x20, Lanes::word(1 << 14)), "EVCTRL, an event");
    assert!(refused(0x04, Lanes::new(5 << 5, 1, 1)), "a command, DMA");
    assert!(refused(0x00, Lanes::word(CPTEN0)), "capture, an event");
    assert!(!refused(0x14, Lanes::word(0)));
    let mut second = Rig::new(Ticks::ZERO);
    second.tcc = Tcc::new(1, Ticks::ZERO);
    assert!(second.try_write(0, 0x14, Lanes::word(1)).is_err(), "TCC1");
}

#[test]
fn enable_protected_registers_are_closed_while_it_runs() {
    let mut rig = Rig::servo(72_000);
    rig.write(10, 0x14, 2);
    rig.write(20, 0x18, 1 << 21);
    assert_eq!((rig.read(30, 0x14), rig.read(30, 0x18)), (0, 0));
    assert_eq!(rig.violations.count, 2);
}
