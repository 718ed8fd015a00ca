use super::*;
use crate::board::{I2cCut, I2cEvent, I2cPins, I2cReply, Pin, Unconnected};
use crate::tests::*;

const TCC0: u32 = 0x4200_2000;
const SERCOM3: u32 = 0x4200_1400;

#[test]
fn the_hal_starts_48_mhz_with_and_without_held_synchronisation() {
    for hold in [Ticks::ZERO, Ticks(300)] {
        let mut bench = Bench::new(hold, Unconnected);
        assert_eq!(bench.peripherals.cycle, 48 << FRACTION);
        bench.start_clocks();
        assert_eq!(bench.peripherals.cycle, 1 << FRACTION);
        assert_eq!(bench.peripherals.nvmctrl.wait_states(), 1);
        assert_eq!(bench.peripherals.violations.first, []);
    }
}

/// A chip whose DFLL is 3.1 % slow, with its clocks started.
fn slow_clocks() -> Bench {
    let options = Options { dfll_error_ppm: -31_000, ..Options::default() };
    let mut bench = Bench::with(&options, Unconnected);
    bench.start_clocks();
    bench
}

#[test]
fn a_slow_dfll_slows_core_and_timers_until_frames_come() {
    let mut bench = slow_clocks();
    // 1 / 0.969 of a tick.
    assert_eq!(bench.peripherals.cycle, 67_633);
    let frame = |bench: &mut Bench| {
        bench.pass(Ticks::from_ms(1));
        let now = bench.now;
        bench.peripherals.start_of_frame(now);
    };
    let locked = |bench: &mut Bench| bench.r32(SYSCTRL + 0x0C) >> 6 & 1 != 0;
    for _ in 0..13 {
        frame(&mut bench);
    }
    assert!(bench.peripherals.cycle > 1 << FRACTION);
    for _ in 0..8 {
        assert!(!locked(&mut bench));
        frame(&mut bench);
    }
    assert!(locked(&mut bench));
    assert_eq!(bench.peripherals.cycle, 1 << FRACTION);
    // The value stays when the frames end, and is read after READREQ only.
    bench.pass(Ticks::from_ms(5000));
    assert_eq!(bench.peripherals.cycle, 1 << FRACTION);
    assert_eq!(bench.r32(SYSCTRL + 0x28) & 0x3FF, 0x1FF);
    bench.w8(SYSCTRL + 0x30, 0x80);
    let value = bench.r32(SYSCTRL + 0x28);
    assert_eq!(value, (0x1F << 10) | (0x1FF + 135));
    // The next start from that value is right at once.
    let mut next = slow_clocks();
    next.w32(SYSCTRL + 0x28, value);
    assert_eq!(next.peripherals.cycle.abs_diff(1 << FRACTION), 3);
}

#[test]
fn the_watchdogs_clock_follows_the_slow_oscillator() {
    // The watchdog bites after 128 cycles of OSCULP32K / 32, of the fastest and the slowest.
    for (hz, limit_us) in [(41_000, 100_000), (28_500, 143_719)] {
        let options = Options { osculp32k_hz: hz, ..Options::default() };
        let mut bench = Bench::with(&options, Unconnected);
        bench.generator(4, 3, 32);
        bench.route(3, 4);
        bench.w8(0x4000_1001, 0x04);
        bench.w8(0x4000_1000, 0x02);
        bench.wait(0x4000_1007, Width::Byte, 0x80, false);
        bench.pass(Ticks::from_us(limit_us - 1100));
        assert_eq!(bench.peripherals.pending_reset.take(), None, "{hz} Hz");
        bench.pass(Ticks::from_us(1200));
        let cause = bench.peripherals.pending_reset.take();
        assert_eq!(cause, Some(ResetCause::Watchdog), "{hz} Hz");
    }
}

/// Half of its time has passed at the nominal rate when the oscillator becomes a quarter faster.
#[test]
fn the_watchdog_comes_sooner_when_its_oscillator_becomes_faster() {
    let mut bench = Bench::new(Ticks::ZERO, Unconnected);
    bench.generator(4, 3, 32);
    bench.route(3, 4);
    bench.w8(0x4000_1001, 0x04);
    bench.w8(0x4000_1000, 0x02);
    bench.wait(0x4000_1007, Width::Byte, 0x80, false);
    bench.pass(Ticks::from_us(62_500));
    let now = bench.now;
    bench.peripherals.set_slow_oscillator(now, 40_960);
    bench.pass(Ticks::from_us(49_000));
    assert_eq!(bench.peripherals.pending_reset.take(), None);
    bench.pass(Ticks::from_us(2_000));
    let cause = bench.peripherals.pending_reset.take();
    assert_eq!(cause, Some(ResetCause::Watchdog));
}

#[test]
fn an_erased_user_row_resets_the_chip_every_second() {
    let options = Options { user_row: UserRow::ERASED, ..Options::default() };
    let mut bench = Bench::with(&options, Unconnected);
    for _ in 0..2 {
        bench.pass(Ticks::from_ms(990));
        assert_eq!(bench.peripherals.pending_reset.take(), None);
        bench.pass(Ticks::from_ms(20));
        let cause = bench.peripherals.pending_reset.take();
        assert_eq!(cause, Some(ResetCause::Watchdog));
        bench.reset(ResetCause::Watchdog);
    }
}

#[test]
fn a_user_reset_spares_the_32_khz_oscillators() {
    for (cause, survives) in [
        (ResetCause::System, true),
        (ResetCause::Watchdog, true),
        (ResetCause::External, true),
        (ResetCause::BrownOut33, false),
        (ResetCause::PowerOn, false),
    ] {
        let mut bench = Bench::new(Ticks::ZERO, Unconnected);
        bench.start_clocks();
        bench.reset(cause);
        let ready = bench.r32(SYSCTRL + 0x0C) & 1 << 2 != 0;
        assert_eq!(ready, survives, "{cause:?}");
        assert_eq!(bench.r32(SYSCTRL + 0x18) == 0x003F_0080, !survives);
        assert_eq!(bench.r32(SYSCTRL + 0x24), 0x80, "the DFLL is off");
        assert_eq!(bench.peripherals.cycle, 48 << FRACTION);
    }
}

/// What the start-up code of the Arduino core does with it, and a conversion.
#[test]
fn the_adc_keeps_its_set_up_and_gives_half_of_its_range() {
    const ADC: u32 = 0x4200_4000;
    let mut bench = Bench::new(Ticks::ZERO, Unconnected);
    bench.w32(PM_APBCMASK, 1 << 16);
    for (offset, value) in [(0x02, 0x05), (0x03, 0x3F)] {
        bench.w8(ADC + offset, value);
        assert_eq!(bench.r8(ADC + offset), value);
    }
    bench.w16(ADC + 4, 7 << 8 | 2 << 4);
    bench.w32(ADC + 0x10, 0x0F00_1800);
    bench.w8(ADC, 2);
    assert_eq!((bench.r8(ADC + 0x18), bench.r8(ADC + 0x19)), (0, 0));
    bench.w8(ADC + 0x17, 1);
    bench.w8(ADC + 0x0C, 2);
    assert_eq!((bench.r8(ADC + 0x18), bench.r16(ADC + 0x1A)), (1, 0x200));
    assert_eq!(bench.peripherals.irq_lines, 1 << 23);
    bench.w8(ADC + 0x18, 1);
    assert_eq!((bench.r8(ADC + 0x18), bench.peripherals.irq_lines), (0, 0));
    bench.w8(ADC, 1);
    assert_eq!((bench.r16(ADC + 4), bench.r8(ADC + 0x16)), (0, 0));
}

#[test]
fn accesses_that_no_model_covers_name_what_they_hit() {
    let mut bench = Bench::new(Ticks::ZERO, Unconnected);
    let message = |result: Result<u32, BusError>| result.unwrap_err().to_string();
    assert_eq!(
        message(bench.try_read(0x4200_4400, Width::Byte)),
        "AC at 0x42004400: the whole peripheral is not modelled"
    );
    assert_eq!(
        message(bench.try_read(SYSCTRL + 0x44, Width::Byte)),
        "SYSCTRL at 0x40000844: DPLLCTRLA is not modelled"
    );
    assert_eq!(
        message(bench.try_read(TCC0, Width::Word)),
        "TCC0 at 0x42002000: its bus clock is masked"
    );
    assert_eq!(message(bench.try_read(0x5000_0000, Width::Word)), "nothing at 0x50000000");
    assert_eq!(message(bench.try_read(PORT + 2, Width::Word)), "misaligned access at 0x41004402");
    assert_eq!(
        bench.try_write(0x4100_2000, Width::Byte, 1).unwrap_err().to_string(),
        "DSU at 0x41002000: write-protected by the PAC"
    );
}

#[test]
fn the_cpu_cannot_be_left_without_a_clock() {
    let mut bench = Bench::new(Ticks::ZERO, Unconnected);
    bench.w32(GCLK + 8, 1 << 8);
    // There is no crystal.
    let from_crystal = 5 << 8 | 1 << 16;
    let error = bench.try_write(GCLK + 4, Width::Word, from_crystal).unwrap_err();
    assert!(matches!(error.refusal, Refusal::Forbidden(_)));
}

#[test]
fn flash_without_a_wait_state_is_noted_above_24_mhz() {
    let mut bench = Bench::new(Ticks::ZERO, Unconnected);
    bench.start_clocks();
    assert_eq!(bench.peripherals.violations.count, 0);
    bench.w32(NVMCTRL + 4, 1 << 7);
    assert_eq!(bench.peripherals.nvmctrl.wait_states(), 0);
    assert_eq!(bench.peripherals.violations.count, 1);
    assert_eq!(bench.peripherals.violations.first[0].peripheral, "NVMCTRL");
}

#[test]
fn factory_rows_are_read_by_bytes() {
    let mut bench = Bench::new(Ticks::ZERO, Unconnected);
    let row = (0..8)
        .fold(0, |row: u64, byte| row | u64::from(bench.r8(0x0080_6020 + byte)) << (8 * byte));
    assert_eq!(row >> 58, 0x1F);
    assert_eq!(bench.r32(0x0080_A00C), 0x5D21_0001);
    assert_eq!(bench.r32(0x4100_2018), 0x1001_0305);
}

#[test]
fn the_iobus_is_the_port() {
    let mut bench = Bench::new(Ticks::ZERO, Unconnected);
    bench.w32(0x6000_0008, 1 << 17);
    assert_eq!(bench.r32(PORT), 1 << 17);
    assert_eq!(bench.r32(0x6000_0080), 0);
}

#[test]
fn a_protected_peripheral_refuses_writes_but_not_reads() {
    let mut bench = Bench::new(Ticks::ZERO, Unconnected);
    bench.w32(0x4000_0004, 1 << 3);
    assert!(bench.try_read(GCLK + 4, Width::Word).is_ok());
    assert_eq!(
        bench.try_write(GCLK + 4, Width::Word, 0),
        Err(BusError { addr: GCLK + 4, peripheral: "GCLK", refusal: Refusal::Protected })
    );
}

/// Notes edges; acknowledges address 0x29 on the I2C bus at the pins `i2c`.
struct Recorder {
    i2c: I2cPins,
    edges: Vec<(Ticks, Pin, bool)>,
    cuts: Vec<(Ticks, I2cCut)>,
    last: Ticks,
}

impl Recorder {
    fn new(sda: Pin, scl: Pin) -> Self {
        Self { i2c: I2cPins { sda, scl }, edges: Vec::new(), cuts: Vec::new(), last: Ticks::ZERO }
    }

    fn order(&mut self, now: Ticks) {
        assert!(now >= self.last, "the board was called back in time");
        self.last = now;
    }
}

impl Board for Recorder {
    fn i2c_pins(&self) -> Option<I2cPins> {
        Some(self.i2c)
    }
    fn i2c(&mut self, now: Ticks, event: I2cEvent) -> I2cReply {
        self.order(now);
        match event {
            I2cEvent::Start { address: 0x29, .. } => I2cReply::ACK,
            _ => I2cReply::NAK,
        }
    }
    fn i2c_cut(&mut self, now: Ticks, cut: I2cCut) {
        self.order(now);
        self.cuts.push((now, cut));
    }
    fn pin(&mut self, now: Ticks, pin: Pin, level: bool) {
        self.order(now);
        self.edges.push((now, pin, level));
    }
}

/// Clocks, then the servo's timer: 20 ms frames of 1.5 ms on PB11.
fn servo_bench() -> Bench<Recorder> {
    let mut bench = Bench::new(Ticks::ZERO, Recorder::new(Pin::b(8), Pin::b(9)));
    bench.start_clocks();
    let mask = bench.r32(PM_APBCMASK);
    bench.w32(PM_APBCMASK, mask | 1 << 8 | 1 << 6);
    bench.route(0x1A, 0);
    bench.w32(TCC0 + 0x3C, 2);
    bench.w32(TCC0 + 0x40, 959_999);
    bench.w32(TCC0 + 0x48, 72_000);
    bench.multiplex(1, 11, 5);
    bench
}

#[test]
fn the_servo_pin_shows_exact_edges_however_coarsely_time_is_advanced() {
    let mut bench = servo_bench();
    bench.w32(TCC0, 2);
    let start = bench.now;
    bench.w32(TCC0 + 0x74, 96_000);
    bench.pass(Ticks::from_ms(50));
    let edge = |ticks, level| (start + Ticks(ticks), Pin::b(11), level);
    assert_eq!(
        bench.board.edges,
        [
            edge(0, true),
            edge(72_000, false),
            edge(960_000, true),
            edge(960_000 + 96_000, false),
            edge(1_920_000, true),
            edge(1_920_000 + 96_000, false),
        ]
    );
}

#[test]
fn a_reset_lets_the_pins_go_and_tells_why() {
    let mut bench = servo_bench();
    bench.w32(TCC0, 2);
    let now = bench.now + Ticks(500);
    bench.now = now;
    bench.reset(ResetCause::Watchdog);
    bench.pass(Ticks(10));
    assert_eq!(bench.board.edges.last(), Some(&(now, Pin::b(11), false)));
    assert_eq!(bench.r8(0x4000_0438), 0x20);
    assert_eq!(bench.peripherals.cycle, 48 << FRACTION);
    assert!(bench.try_read(TCC0, Width::Word).is_err());
}

/// Clocks, then a SERCOM as I2C master through these pads at 400 kHz, bus idle.
fn i2c_bench(sercom: u32, sda: Pin, scl: Pin, function: u32) -> Bench<Recorder> {
    let base = 0x4200_0800 + 0x400 * sercom;
    let mut bench = Bench::new(Ticks::ZERO, Recorder::new(sda, scl));
    bench.start_clocks();
    let mask = bench.r32(PM_APBCMASK);
    bench.w32(PM_APBCMASK, mask | 1 << (2 + sercom));
    bench.route(0x14 + sercom as u16, 0);
    for pin in [sda, scl] {
        bench.multiplex(u32::from(pin.group), u32::from(pin.index), function);
    }
    bench.w32(base, 5 << 2);
    bench.w32(base + 0x0C, 59);
    bench.w32(base, 5 << 2 | 2);
    bench.w16(base + 0x1A, 1 << 4);
    bench
}

#[test]
fn scl_shows_at_its_pin_and_a_reset_cuts_the_transfer() {
    let mut bench = i2c_bench(4, Pin::b(8), Pin::b(9), 3);
    bench.w16(PORT + 0x80 + 0x48, 0x0303);
    let lines = |bench: &mut Bench<Recorder>| bench.r32(PORT + 0x80 + 0x20) >> 8 & 3;
    assert_eq!(lines(&mut bench), 3);
    bench.w32(0x4200_1800 + 0x24, 0x29 << 1);
    bench.pass(Ticks::from_us(40));
    assert_eq!(lines(&mut bench), 1, "SCL is held for the next byte");
    bench.w32(0x4200_1800 + 0x24, 0x29 << 1 | 1);
    // Repeated START, address and six clocks, of 142 ticks each, behind the write.
    bench.pass(Ticks(142 * 16 + 71));
    let now = bench.now;
    bench.reset(ResetCause::Watchdog);
    bench.pass(Ticks(10));
    assert_eq!(bench.board.cuts, [(now, I2cCut { clocks: 6, stretch: Ticks::ZERO })]);
}

#[test]
fn any_sercom_is_an_i2c_master_through_the_pads_that_reach_the_boards_bus() {
    // SERCOM, SDA, SCL, multiplexer function: the Nano 33 IoT's, then those of other boards.
    for (sercom, sda, scl, function) in [
        (4, Pin::b(8), Pin::b(9), 3),
        (3, Pin::a(22), Pin::a(23), 2),
        (2, Pin::a(12), Pin::a(13), 2),
        (2, Pin::a(8), Pin::a(9), 3),
        (0, Pin::a(8), Pin::a(9), 2),
    ] {
        let base = 0x4200_0800 + 0x400 * sercom;
        let mut bench = i2c_bench(sercom, sda, scl, function);
        bench.w8(base + 0x16, 1);
        bench.w32(base + 0x24, 0x29 << 1);
        assert_eq!(bench.peripherals.irq_lines, 0);
        bench.pass(Ticks::from_us(40));
        assert_eq!(bench.peripherals.irq_lines, 1 << (9 + sercom));
        assert_eq!(bench.r16(base + 0x1A), 2 << 4 | 1 << 7);
        assert_eq!(bench.peripherals.violations.first, []);
    }
}

#[test]
fn a_sercom_whose_pads_lie_elsewhere_does_not_reach_the_boards_bus() {
    let mut bench = Bench::new(Ticks::ZERO, Recorder::new(Pin::b(8), Pin::b(9)));
    bench.start_clocks();
    let mask = bench.r32(PM_APBCMASK);
    bench.w32(PM_APBCMASK, mask | 1 << 5);
    bench.route(0x17, 0);
    bench.multiplex(0, 22, 2);
    bench.multiplex(0, 23, 2);
    bench.w32(SERCOM3, 5 << 2);
    bench.w32(SERCOM3, 5 << 2 | 2);
    bench.w16(SERCOM3 + 0x1A, 1 << 4);
    bench.w32(SERCOM3 + 0x24, 0x29 << 1);
    bench.pass(Ticks::from_us(400));
    // Nobody acknowledges: RXNACK with MB.
    assert_eq!(bench.r8(SERCOM3 + 0x18) & 1, 1);
    assert_eq!(bench.r16(SERCOM3 + 0x1A) & 1 << 2, 1 << 2);
    let violations = &bench.peripherals.violations.first;
    assert_eq!(violations[0].peripheral, "SERCOM3");
}

#[test]
fn time_to_the_next_event_does_not_change_what_happens() {
    let mut fine = servo_bench();
    fine.w32(TCC0, 2);
    let mut coarse = servo_bench();
    coarse.w32(TCC0, 2);
    for _ in 0..60_000 {
        fine.pass(Ticks(48));
    }
    coarse.pass(Ticks(48 * 60_000));
    assert_eq!(fine.board.edges, coarse.board.edges);
}

/// A switch on PA07.
#[derive(Default)]
struct Switch {
    closed: bool,
}

impl Board for Switch {
    fn input(&self, _now: Ticks, pin: Pin) -> Option<bool> {
        (pin == Pin::a(7)).then_some(!self.closed)
    }
}

#[test]
fn a_switch_interrupts_on_the_edge_that_is_sensed() {
    const EIC: u32 = 0x4000_1800;
    for (sense, on_close, on_open) in [(1, false, true), (2, true, false), (3, true, true)] {
        let mut bench = Bench::new(Ticks::ZERO, Switch::default());
        bench.start_clocks();
        bench.route(5, 0);
        bench.multiplex(0, 7, 0);
        bench.w32(EIC + 0x18, sense << 28);
        bench.w32(EIC + 0x0C, 1 << 7);
        bench.w8(EIC, 2);
        bench.pass(Ticks::from_ms(1));
        assert_eq!(bench.peripherals.irq_lines & 1 << 4, 0);
        for (closed, interrupts) in [(true, on_close), (false, on_open)] {
            bench.board.closed = closed;
            bench.pass(Ticks::from_us(200));
            let expected = if interrupts { 1 << 4 } else { 0 };
            assert_eq!(bench.peripherals.irq_lines & 1 << 4, expected);
            bench.w32(EIC + 0x10, 1 << 7);
            assert_eq!(bench.peripherals.irq_lines & 1 << 4, 0);
        }
    }
}

#[test]
fn time_goes_on_when_an_event_turns_out_to_be_overdue() {
    // USB on without its pads: the bus has been idle for long when they come.
    let mut bench = Bench::new(Ticks::ZERO, Unconnected);
    bench.start_clocks();
    bench.route(6, 0);
    bench.w8(0x4100_5000, 2);
    bench.w16(0x4100_5008, 0);
    bench.pass(Ticks::from_ms(20));
    bench.multiplex(0, 24, 6);
    bench.multiplex(0, 25, 6);
    bench.pass(Ticks::from_ms(20));
    assert_eq!(bench.r16(0x4100_501C) & 1, 1, "SUSPEND");
    assert_eq!(bench.peripherals.violations.count, 1);
}

#[test]
fn a_reset_at_the_very_start_does_no_harm() {
    let mut bench = Bench::new(Ticks::ZERO, Unconnected);
    bench.reset(ResetCause::External);
    bench.pass(Ticks(1));
    assert_eq!(bench.r8(0x4000_0438), 0x10);
}

#[test]
fn the_flash_interrupts_when_it_is_ready_again() {
    let mut bench = Bench::new(Ticks::ZERO, Unconnected);
    bench.w32(NVMCTRL + 0x1C, 0x4000 / 2);
    bench.w8(NVMCTRL + 0x10, 1);
    assert_eq!(bench.peripherals.irq_lines, 1 << 5);
    let now = bench.now;
    let command = bench.bus().write(now, NVMCTRL, Width::Half, 0xA502);
    assert_eq!(command, Ok(Ticks::from_us(6000)));
    assert_eq!(bench.peripherals.irq_lines, 0);
    let end = now + Ticks::from_us(6000);
    assert_eq!(bench.peripherals.next, end);
    bench.pass(Ticks::from_us(6000));
    assert_eq!(bench.peripherals.irq_lines, 1 << 5);
}

/// A bit of the multiplexer leads the servo's pin to a TC: it is released, and firmware that leads
/// it back to its timer is not refused.
#[test]
fn a_pin_that_a_flip_leads_elsewhere_is_released_and_can_be_led_back() {
    let mut bench = servo_bench();
    bench.multiplex(1, 10, 5);
    bench.w32(TCC0, 2);
    bench.pass(Ticks(500));
    let (now, pmux) = (bench.now, PORT + 0x80 + 0x34);
    // PB11 and PB10 share a byte.
    for bit in [8 + 4, 8] {
        assert!(bench.peripherals.flip(now, pmux, bit, &mut bench.board));
    }
    assert_eq!(bench.board.edges.last(), Some(&(now, Pin::b(11), false)));
    assert_eq!(bench.r8(pmux + 1), 0x44);
    bench.multiplex(1, 11, 5);
    assert_eq!(bench.r8(pmux + 1), 0x54);
    let (_, pin, level) = bench.board.edges.last().copied().unwrap();
    assert_eq!((pin, level), (Pin::b(11), true));
}

/// Start-up code of other projects raises the priority of the SRAM on the bus matrix.
#[test]
fn priorities_on_the_bus_matrix_are_stored() {
    let mut bench = Bench::new(Ticks::ZERO, Unconnected);
    bench.w32(0x4100_7120, 2);
    assert_eq!(bench.r32(0x4100_7120), 2);
    assert_eq!(bench.r32(0x4100_480C), 0x15 << 16);
    bench.w8(0x4100_480E, 0x2A);
    assert_eq!(bench.r32(0x4100_480C), 0x2A << 16);
}

#[test]
fn a_count_read_without_a_request_stalls_the_bus() {
    let mut bench = Bench::new(Ticks::ZERO, Unconnected);
    bench.start_clocks();
    let count = 0x4200_3010;
    let stall = |bench: &Bench| bench.peripherals.read_stall(count);
    assert_eq!(stall(&bench), Ticks(14));
    assert_eq!(bench.peripherals.read_stall(count - 4), Ticks::ZERO);
}
