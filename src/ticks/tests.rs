use super::*;

fn timing(frame_hz: u32, i2c_khz: u32) -> Timing {
    Timing { sensor: Kind::default(), frame_hz, i2c_khz, stretch_us: 180 }
}

#[test]
fn there_are_as_many_ticks_as_the_table_says() {
    for (frame_hz, fast, slow) in [
        (50, (3, 1, 6_666), (2, 1, 10_000)),
        (100, (1, 1, 10_000), (1, 1, 10_000)),
        (200, (1, 2, 10_000), (1, 2, 10_000)),
        (300, (1, 2, 6_666), (1, 3, 10_000)),
        (333, (1, 3, 9_009), (1, 3, 9_009)),
    ] {
        for (i2c_khz, expected) in [(400, fast), (100, slow)] {
            let plan = TickPlan::new(&timing(frame_hz, i2c_khz));
            let found = (plan.ticks_per_frame, plan.frames_per_tick, plan.period_us(frame_hz));
            assert_eq!(found, expected, "{frame_hz} Hz, {i2c_khz} kHz");
        }
    }
}

/// By hand: 520 us + 21 stretched bytes; four more of a short transfer, with 23 us each; 190 us
/// of STOP, and 680 us more where there is room. Without 12 of the bytes, the last burst of
/// several in a frame begins later.
#[test]
fn a_slower_sensor_is_sampled_less_often_and_a_fast_one_later() {
    for (stretch_us, lead_us, per_frame, too_slow) in [
        (20, 2_260, 3, false),
        (180, 5_620, 3, false),
        (207, 6_187, 3, false),
        (208, 6_208, 2, false),
        (350, 9_190, 2, false),
        (367, 9_547, 2, false),
        (368, 9_568, 1, true),
    ] {
        let timing = Timing { stretch_us, ..timing(50, 400) };
        let plan = TickPlan::new(&timing);
        let found = (timing.sample_lead_us(), plan.ticks_per_frame, timing.is_too_slow());
        assert_eq!(found, (lead_us, per_frame, too_slow), "{stretch_us} us");
        let later_us = if per_frame > 1 { 12 * (23 + stretch_us) } else { 0 };
        assert_eq!(timing.lead_us(), lead_us - later_us, "{stretch_us} us");
        assert_eq!(timing.stretch_of(timing.burst_us()), stretch_us);
        let digital = Timing { frame_hz: 300, ..timing };
        let frames = [2, 3, 4][3 - usize::from(per_frame)];
        assert_eq!(TickPlan::new(&digital).frames_per_tick, frames, "{stretch_us} us");
    }
}

#[test]
fn bursts_are_measured_a_window_at_a_time_but_for_the_longest() {
    let measured = |last: [u32; 2]| {
        let mut gauge = BurstGauge::default();
        for _ in 0..BurstGauge::WINDOW - 2 {
            gauge.add(4_400);
        }
        gauge.add(last[0]);
        assert_eq!(gauge.times(), BurstTimes::default());
        gauge.add(last[1]);
        gauge.times()
    };
    for last in [[4_720, 32_651], [32_651, 4_720]] {
        let times = measured(last);
        assert_eq!((times.mean_us, times.max_us), (4_405, 4_720));
        assert_eq!(times.planned_us(0), 4_405, "the reserve has room for it");
    }
    assert_eq!(measured([6_000, 6_000]).planned_us(0), 5_600);
    assert_eq!(measured([4_400, 4_400]).planned_us(0), 4_400);
    for (mean_us, stop_us, planned_us) in
        [(4_500, 200, 4_500), (4_500, 500, 5_100), (7_900, 500, 7_950), (8_000, 500, 8_000)]
    {
        let times = BurstTimes { mean_us, max_us: mean_us };
        assert_eq!(times.planned_us(stop_us), planned_us, "{mean_us}, {stop_us}");
    }
}

/// Counts by hand, for a timer at 3 MHz.
#[test]
fn the_timer_ticks_its_lead_before_the_edge_and_evenly_before_that() {
    let lead_us = |i2c_khz| timing(50, i2c_khz).lead_us();
    assert_eq!((lead_us(400), lead_us(100)), (3_184, 3_820));
    let plan = |frame_hz, i2c_khz| TimerPlan::new(3, &timing(frame_hz, i2c_khz));
    let slow = plan(50, 400);
    assert_eq!((slow.period, slow.tick_period_us), (60_000, 6_666));
    // The last would be at 43,140 with a whole burst.
    assert_eq!(slow.ticks, [50_448, 23_140, 3_140]);
    assert_eq!(plan(50, 100).ticks, [48_540, 8_820, 8_820]);
    let fast = plan(300, 400);
    assert_eq!((fast.period, fast.tick_period_us), (10_000, 6_666));
    assert_eq!((fast.ticks[0], fast.plan.frames_per_tick), (3_140, 2));
    assert_eq!(plan(0, 400), plan(50, 400));
    assert_eq!(plan(1_000, 400), plan(333, 400));
}

#[test]
fn every_tick_lies_in_its_frame() {
    for frame_hz in [50, 100, 200, 300, 333] {
        for i2c_khz in [100, 400] {
            let plan = TimerPlan::new(3, &timing(frame_hz, i2c_khz));
            assert!(plan.ticks.iter().all(|tick| *tick < plan.period), "{plan:?}");
        }
    }
}

#[test]
fn a_burst_belongs_to_its_step_until_that_is_taken_without_it() {
    let mut tick = NewestTick::new(Micros(0));
    assert!(!tick.burst_over() && !tick.is_missed(Micros(1_000_000)));
    assert!(!tick.came(Micros(10_000), false, &timing(50, 400)));
    assert_eq!(tick.burst_due(), Some(Micros(15_300)));
    assert!(!tick.is_missed(Micros(15_299)));
    assert!(tick.burst_over(), "in time");
    assert!(!tick.is_missed(Micros(15_300)), "the step has been taken");
    assert!(!tick.came(Micros(20_000), false, &timing(50, 100)));
    assert!(!tick.is_missed(Micros(26_739)));
    assert!(tick.is_missed(Micros(26_740)));
    assert!(!tick.is_missed(Micros(26_741)), "once");
    assert!(!tick.burst_over(), "late");
    // 12 bytes of 203 us fewer.
    assert!(!tick.came(Micros(30_000), true, &timing(50, 400)));
    assert_eq!(tick.burst_due(), Some(Micros(32_864)));
    // The processor has stood still from before that: a step is due, and another one later.
    assert!(tick.came(Micros(36_667), false, &timing(50, 400)));
    assert_eq!(tick.burst_due(), Some(Micros(41_967)));
    assert!(!tick.is_lost(Micros(76_667)) && tick.is_lost(Micros(76_668)));
}

#[test]
fn a_short_transfer_goes_between_two_bursts_if_it_is_over_before_the_next() {
    let mut tick = NewestTick::new(Micros(0));
    assert!(!tick.came(Micros(10_000), false, &timing(50, 400)));
    let read = Transfer::Read { register: 0, len: 1 };
    // Four bytes of 243 us each and 200 us of reserve, 6,666 us after the tick.
    let fits = |now| tick.leaves_time_for(Micros(now), &read, &timing(50, 400), 200, 6_666);
    assert!(fits(15_493) && !fits(15_494));
    assert!(!tick.leaves_time_for(Micros(15_493), &read, &timing(50, 100), 200, 6_666));
    // Behind a burst of the rates alone the next tick comes 2,436 us earlier.
    assert!(tick.came(Micros(10_000), true, &timing(50, 400)));
    let fits = |now| tick.leaves_time_for(Micros(now), &read, &timing(50, 400), 200, 6_666);
    assert!(fits(13_057) && !fits(13_058));
}

/// A damaged log can have any time between two steps.
#[test]
fn a_tick_may_come_any_time_after_the_last() {
    let plan = Ticks::new(&timing(50, 400));
    let mut ticks = CarriedTicks::default();
    ticks.seen(Micros(0));
    for at in [u64::from(u32::MAX) - 1, u64::from(u32::MAX) + 5, u64::MAX] {
        ticks.tick(&plan, Micros(at));
        assert!(ticks.to_go < 3, "{}", ticks.to_go);
    }
}
