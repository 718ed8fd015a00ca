//! The image on the rig with a sensor or a cable that fails in mid-flight.

use crate::{firmware, ready};
use client::{Failure, StateKind};
use rig::bno055::Fault;
use rig::faults::neutral_us;
use rig::ground_station::{Answer, GroundStationError};
use rig::ground_truth::{Pulse, Step};
use rig::{ProgramEnd, Ready, ResetCause, ServoKind, Setup, Ticks, prepare};
use std::ops::RangeInclusive;
use tvc_nano::{Axis, Params};

pub(crate) fn ms(ms: u64) -> Ticks {
    Ticks::from_ms(ms)
}

/// Whether the image refused an order.
pub(crate) fn is_refused(answer: &Answer) -> bool {
    matches!(answer, Err(GroundStationError::Request { failure: Failure::Refused { .. }, .. }))
}

/// The neutral pulse of the default parameters, us.
pub(crate) fn default_neutral_us() -> RangeInclusive<f64> {
    neutral_us(&Params::default(), Axis::Pitch)
}

/// Released from a tilt, and flying for long enough that the rudder is off neutral.
fn in_flight() -> Ready {
    released(ready(), &default_neutral_us())
}

/// Lets go of the drone of `flight`, whose neutral pulse is `neutral_us`.
pub(crate) fn released(mut flight: Ready, neutral_us: &RangeInclusive<f64>) -> Ready {
    let Ready { rig, station, .. } = &mut flight;
    rig.environment.tilt_clamp_to([0.4, 0.0]);
    station.run(rig, ms(2000)).unwrap();
    station.arm(rig).unwrap();
    station.release(rig, 0.2).unwrap();
    station.run(rig, ms(150)).unwrap();
    let last = rig.truth().pulses_of(Axis::Pitch).last().unwrap();
    assert!(!neutral_us.contains(&last.width_us()), "{}", last.width_us());
    flight
}

/// Pulses never stopped: one every 20 ms, none outside the travel.
pub(crate) fn assert_pulses_went_on(pulses: &[Pulse], length: Ticks) {
    let expected = length.as_us_f64() / 20_000.0;
    assert!(pulses.len() as f64 > expected - 2.0, "{} pulses", pulses.len());
    for pair in pulses.windows(2) {
        assert_eq!((pair[1].rise - pair[0].rise).as_us(), 20_000);
    }
    for pulse in pulses {
        assert!((853.0..=2193.0).contains(&pulse.width_us()), "{}", pulse.width_us());
    }
}

fn neutral_in_time_and_back_by_the_operator(fault: Fault, word: &str) {
    let mut flight = in_flight();
    let Ready { rig, station, .. } = &mut flight;
    let texts = station.received().texts.len();
    let at = rig.now();
    rig.inject(fault);
    station.run(rig, ms(250)).unwrap();
    let texts_in_time = station.received().texts.len();
    station.run(rig, ms(750)).unwrap();

    // From 100 ms on, every pulse is neutral.
    let pulses = rig.truth().pulses_since(Axis::Pitch, at);
    assert_pulses_went_on(pulses, ms(1000));
    for pulse in pulses.iter().filter(|p| p.rise >= at + ms(100)) {
        assert!(
            default_neutral_us().contains(&pulse.width_us()),
            "{fault:?}: {}",
            pulse.width_us()
        );
    }
    // State and reason have arrived, the reason within 250 ms.
    assert_eq!(station.state(), Some(StateKind::Failsafe), "{fault:?}");
    let told = &station.received().texts[texts..texts_in_time];
    let reason = told.iter().find(|t| t.starts_with("failsafe"));
    let reason = reason.unwrap_or_else(|| panic!("{fault:?}: {told:?}"));
    assert!(reason.contains(word), "{fault:?}: {reason}");
    // While the fault lasts there is no way out, and never one straight to active.
    assert!(is_refused(&station.arm(rig)));
    if fault != Fault::ConfigReset {
        assert!(is_refused(&station.disarm(rig)));
    }

    rig.clear(fault);
    rig.environment.catch();
    rig.environment.tilt_clamp_to([0.0, 0.0]);
    // The attitude and the gyro offset are found anew.
    station.run(rig, ms(8000)).unwrap();
    assert_eq!(station.state(), Some(StateKind::Failsafe), "{fault:?}: only the operator ends it");
    assert!(is_refused(&station.release(rig, 0.0)));
    assert!(is_refused(&station.arm(rig)));
    station.disarm(rig).unwrap();
    station.wait_for_state(rig, ms(500), StateKind::Standby).unwrap();
    station.arm(rig).unwrap();
    assert!(rig.resets().is_empty());
}

#[test]
fn unplugged() {
    neutral_in_time_and_back_by_the_operator(Fault::Unplugged, "does not answer");
}

#[test]
fn data_line_stuck() {
    neutral_in_time_and_back_by_the_operator(Fault::SdaStuck, "IMU");
}

#[test]
fn clock_line_stuck() {
    neutral_in_time_and_back_by_the_operator(Fault::SclStuck, "IMU");
}

#[test]
fn reset_to_config() {
    neutral_in_time_and_back_by_the_operator(Fault::ConfigReset, "IMU");
}

#[test]
fn all_ones() {
    neutral_in_time_and_back_by_the_operator(Fault::AllOnes, "all ones");
}

#[test]
fn frozen() {
    neutral_in_time_and_back_by_the_operator(Fault::Frozen, "frozen");
}

/// A silent bus wakes nobody: the loop must see by itself that the burst is too late for its step,
/// and step before the edge that the pulse is for.
#[test]
fn the_step_of_a_missed_sample_comes_before_its_edge() {
    let flight = in_flight();
    let mut missed = 0;
    // From any instant of a frame, for as long as the first transfer hangs.
    for instant in 0..20 {
        let mut flight = flight.clone();
        let Ready { rig, station, .. } = &mut flight;
        station.run(rig, ms(instant)).unwrap();
        let at = rig.now();
        rig.inject(Fault::SclStuck);
        station.run(rig, ms(14)).unwrap();
        let until = rig.now();
        station.run(rig, ms(20)).unwrap();
        let truth = rig.truth();
        // The last tick before each edge comes 3.3 ms before it.
        let lead = Ticks::from_us(3_300);
        let edges = truth.pulses_of(Axis::Pitch).iter().map(|pulse| pulse.rise);
        for edge in edges.filter(|edge| *edge >= at + lead && *edge < until) {
            let in_time = |step: &&Step| step.start + lead > edge && step.end < edge;
            let steps = truth.steps.iter().filter(in_time).count();
            assert_eq!(steps, 1, "{instant}: steps before the edge at {edge}");
            missed += 1;
        }
    }
    assert!(missed > 5, "{missed}");
}

/// A slave that hangs inside a byte lets go after a few clocks: the image gives them.
#[test]
fn a_slave_inside_a_byte_is_clocked_free() {
    let mut flight = in_flight();
    let Ready { rig, station, .. } = &mut flight;
    rig.inject(Fault::SdaHeld { clocks: 7 });
    station.run(rig, ms(500)).unwrap();
    assert!(!rig.environment.sensor.held_low(rig.now()).sda);
    let last = rig.truth().bursts.last().unwrap();
    assert!(rig.now() - last.end < ms(20), "bursts go on");
}

/// A reset in the middle of a byte leaves the sensor with bits that it has not sent. The image
/// clocks it through them, wherever in 20 ms the reset comes. A sensor that then holds the clock,
/// too, takes a second attempt.
#[test]
fn a_reset_in_mid_transfer_delays_the_sensor_by_25_ms_at_most() {
    let flight = in_flight();
    let mut held = 0;
    let mut delays = Vec::new();
    for instant in 0..240 {
        let mut rig = flight.rig.clone();
        rig.run_for(Ticks::from_us(instant * 83)).unwrap();
        rig.press_reset();
        rig.run_for(Ticks::from_us(1)).unwrap();
        held += usize::from(rig.environment.held_low(rig.now()).sda);
        while rig.in_bootloader() {
            rig.run_for(ms(1)).unwrap();
        }
        let (started, bursts) = (rig.now(), rig.truth().bursts.len());
        while rig.truth().bursts.len() == bursts {
            assert!(rig.now() < started + ms(1000), "{instant}: no burst");
            rig.run_for(ms(1)).unwrap();
        }
        delays.push(rig.now() - started);
    }
    assert!(held > 20, "the sensor held SDA behind {held} resets only");
    let (shortest, longest) = (delays.iter().min().unwrap(), delays.iter().max().unwrap());
    assert!(*longest - *shortest < ms(25), "{shortest} to {longest}");
}

/// A burst has wrong words every tenth of a second or so. Of two within 20 ms the second would be a
/// failsafe.
#[test]
fn spikes_are_ridden_out() {
    for later_ms in [0, 13, 26] {
        let mut flight = in_flight();
        let Ready { rig, station, .. } = &mut flight;
        station.run(rig, ms(later_ms)).unwrap();
        // The rates alone are read 2.3 ms before a burst: one reading at most is hit.
        let faults =
            [Fault::Spikes { probability: 0.15 }, Fault::CorruptWords { probability: 0.15 }];
        for _ in 0..30 {
            faults.into_iter().for_each(|fault| rig.inject(fault));
            station.run(rig, ms(2)).unwrap();
            faults.into_iter().for_each(|fault| rig.clear(fault));
            station.run(rig, ms(100)).unwrap();
        }
        let wrong = rig.truth().bursts.iter().filter(|burst| !burst.valid).count();
        assert!(wrong > 3, "{wrong} bursts were wrong");
        assert_eq!(station.state(), Some(StateKind::Active), "{:?}", station.last_text());
        let pitch = rig.environment.vehicle().pitch_rad();
        assert!(pitch.abs() < 0.05, "{pitch}");
    }
}

#[test]
fn a_hung_loop_is_reset_and_told() {
    let mut flight = in_flight();
    let Ready { rig, station, .. } = &mut flight;
    let at = rig.now();
    rig.end_program(ProgramEnd::Hang);
    station.run(rig, ms(450)).unwrap();
    assert_eq!(rig.resets().len(), 1, "the firmware resets");
    let (fired, cause) = rig.resets()[0];
    let before = station.received().texts.len();
    // The early warning of the watchdog puts the rudder to neutral, and resets behind a pulse.
    assert_eq!(cause, ResetCause::System);
    let last = rig.truth().pulses_of(Axis::Pitch).last().unwrap();
    assert!(last.fall < fired && fired - at < ms(400));
    assert!(default_neutral_us().contains(&last.width_us()), "{}", last.width_us());
    // The bootloader costs half a second, then pulses are back and the reason is told.
    station.run(rig, ms(600)).unwrap();
    let back = rig.truth().pulses_since(Axis::Pitch, fired)[0];
    assert!(back.rise - fired < ms(600), "{}", back.rise - fired);
    assert!(default_neutral_us().contains(&back.width_us()));
    station.connect(rig).unwrap();
    station.wait_for_state(rig, ms(2000), StateKind::Latched).unwrap();
    let told = &station.received().texts[before..];
    assert!(told.iter().any(|t| t.contains("latched fault")), "{told:?}");
    assert!(is_refused(&station.arm(rig)));
    rig.environment.catch();
    rig.environment.tilt_clamp_to([0.0, 0.0]);
    station.disarm(rig).unwrap();
    station.wait_for_state(rig, ms(6000), StateKind::Standby).unwrap();
}

/// A wrong jump leads to the start while a pulse is on its way: the set-up of the clocks neither
/// cuts nor lengthens it.
#[test]
fn a_jump_to_the_start_spoils_no_pulse() {
    for lead_us in [10, 400, 800, 1200] {
        let mut flight = in_flight();
        let Ready { rig, station, .. } = &mut flight;
        let risen = rig.truth().high[Axis::Pitch.index()].map(|high| high.rise);
        while rig.truth().high[Axis::Pitch.index()].is_none_or(|high| Some(high.rise) == risen) {
            rig.run_for(Ticks::from_us(5)).unwrap();
        }
        rig.run_for(Ticks::from_us(lead_us)).unwrap();
        let at = rig.now();
        let start = rig.image().bytes()[4..8].try_into().unwrap();
        let mut registers = rig.chip.registers();
        registers.r[15] = u32::from_le_bytes(start) & !1;
        rig.chip.set_registers(&registers);
        station.run(rig, ms(600)).unwrap();
        let pulses = rig.truth().pulses_since(Axis::Pitch, at - ms(3));
        assert!(pulses.len() > 2, "{} pulses", pulses.len());
        for pulse in pulses {
            let is_neutral = default_neutral_us().contains(&pulse.width_us());
            assert!(is_neutral || pulse.is_as_asked(0.0), "{} us", pulse.width_us());
        }
        assert!(default_neutral_us().contains(&pulses.last().unwrap().width_us()));
    }
}

/// The early warning outranks the interrupts of bus and frame: whichever of them hangs, the rudder
/// is at neutral within the 62.5 ms of the warning and a frame. SysTick does the same after 65 ms,
/// if a flipped bit has turned the watchdog off at the same instant.
#[test]
fn an_interrupt_that_hangs_does_not_hold_the_rudder() {
    /// WDT.CTRL.
    const WATCHDOG: u32 = 0x4000_1000;
    let flight = in_flight();
    let handlers = [("SERCOM4", false), ("TCC0", false), ("SERCOM4", true), ("TCC0", true)];
    for (handler, without_watchdog) in handlers {
        let mut flight = flight.clone();
        let Ready { rig, station, .. } = &mut flight;
        let at = rig.now();
        if without_watchdog {
            assert!(rig.flip_register(WATCHDOG, 1), "ENABLE");
        }
        // Its first instruction is a branch to itself now.
        let entry = firmware().symbol(handler).expect(handler) & !1;
        rig.chip.load_flash(entry, &[0xFE, 0xE7]);
        station.run(rig, ms(400)).unwrap();
        let (reset, cause) = rig.resets()[0];
        assert_eq!(cause, ResetCause::System, "{handler}");
        assert!(reset < at + ms(220), "{handler}, {without_watchdog}: {}", reset - at);
        let warned = at + ms(65);
        let pulses =
            rig.truth().pulses_since(Axis::Pitch, warned).iter().filter(|pulse| pulse.fall < reset);
        let last =
            rig.truth().pulses_of(Axis::Pitch).iter().rfind(|pulse| pulse.fall < reset).unwrap();
        for pulse in pulses.filter(|pulse| pulse.rise > warned + ms(20)).chain([last]) {
            let width = pulse.width_us();
            assert!(default_neutral_us().contains(&width), "{handler}: {width}");
        }
    }
}

#[test]
fn a_brown_out_is_latched() {
    let mut flight = ready();
    let Ready { rig, station, .. } = &mut flight;
    rig.brown_out();
    station.run(rig, ms(700)).unwrap();
    station.connect(rig).unwrap();
    station.wait_for_state(rig, ms(2000), StateKind::Latched).unwrap();
    assert!(station.last_text().unwrap().contains("brown-out"));
}

/// The firmware's level is some 2.77 V falling: below it the chip is reset once, above it never.
/// A supply that stays low does not reset it again.
#[test]
fn the_supply_resets_the_chip_below_the_firmwares_level_once() {
    let standby = ready();
    let resets_at = |volts: f64| {
        let mut fork = standby.clone();
        let Ready { rig, station, .. } = &mut fork;
        rig.set_supply(volts);
        station.run(rig, ms(1500)).unwrap();
        let at_low = rig.resets().len();
        rig.set_supply(3.3);
        station.run(rig, ms(500)).unwrap();
        assert_eq!(rig.resets().len(), at_low);
        assert!(!rig.in_bootloader());
        at_low
    };
    assert_eq!([3.0, 2.80, 2.75, 2.0].map(resets_at), [0, 0, 1, 1]);
}

/// The record of a crash outlives the bootloader, which uses RAM of its own, and not the power.
#[test]
fn a_hard_fault_is_told_after_the_reset() {
    let mut flight = in_flight();
    let Ready { rig, station, .. } = &mut flight;
    let at = rig.now();
    let pc = rig.end_program(ProgramEnd::HardFault).unwrap();
    station.run(rig, ms(1200)).unwrap();
    assert_eq!(rig.resets().len(), 1);
    let (reset, _) = rig.resets()[0];
    let before = rig.truth().pulses_of(Axis::Pitch).iter().rfind(|p| p.fall < reset).unwrap();
    assert!(
        reset - at < ms(20) || default_neutral_us().contains(&before.width_us()),
        "{} us for {}",
        before.width_us(),
        reset - at
    );
    station.wait_for_state(rig, ms(3000), StateKind::Latched).unwrap();
    let reason = format!("hard fault at {pc:#010x}");
    let told = &station.received().texts;
    assert!(told.iter().any(|t| t.contains(&reason)), "{told:?}");

    rig.environment.catch();
    rig.environment.tilt_clamp_to([0.0, 0.0]);
    rig.power_cycle();
    station.connect(rig).unwrap();
    station.wait_for_state(rig, ms(8000), StateKind::Standby).unwrap();
}

#[test]
fn a_stack_overflow_is_told_after_the_reset() {
    let mut flight = in_flight();
    let Ready { rig, station, .. } = &mut flight;
    rig.end_program(ProgramEnd::StackOverflow).unwrap();
    let at = rig.now();
    station.run(rig, ms(1200)).unwrap();
    let (reset, _) = rig.resets()[0];
    let last = rig.truth().pulses_of(Axis::Pitch).iter().rfind(|p| p.fall < reset).unwrap();
    assert!(default_neutral_us().contains(&last.width_us()) && reset - at < ms(400));
    station.wait_for_state(rig, ms(3000), StateKind::Latched).unwrap();
    let told = &station.received().texts;
    let expected = "latched fault: self-check failed: stack overflow";
    assert!(told.iter().any(|t| t == expected), "{told:?}");
}

/// A drone whose mass is off its axis, with a rudder that is held against it.
fn held() -> (Ready, RangeInclusive<f64>) {
    const HOLD_DEG: f32 = -10.0;
    let mut params = Params::default();
    params.set("SRV_HOLD_DEG", HOLD_DEG).unwrap();
    let mut setup = Setup::with_polarity(ServoKind::S3003, 1);
    setup.parameters.push(("SRV_HOLD_DEG".into(), HOLD_DEG));
    let mut ready = prepare(firmware(), &setup, &mut |_| {}).unwrap();
    // Stored, so that the run after a reset knows it as well.
    ready.station.order(&mut ready.rig, client::request::SAVE).unwrap();
    (ready, neutral_us(&params, Axis::Pitch))
}

/// However a run ends, the rudder goes to where it holds the drone, and stays there after the
/// reset.
#[test]
fn hang_overflow_and_hard_fault_command_the_held_neutral() {
    let (ready, neutral) = held();
    assert!(neutral.contains(&1424.0) && !default_neutral_us().contains(&1424.0));
    let flight = released(ready, &neutral);
    for end in [ProgramEnd::Hang, ProgramEnd::HardFault, ProgramEnd::StackOverflow] {
        let mut flight = flight.clone();
        let Ready { rig, station, .. } = &mut flight;
        let at = rig.now();
        rig.end_program(end).unwrap();
        station.run(rig, ms(1200)).unwrap();
        assert_eq!(rig.resets().len(), 1, "{end:?}");
        let (reset, _) = rig.resets()[0];
        let pulses = rig.truth().pulses_since(Axis::Pitch, at);
        let (before, after): (Vec<&Pulse>, Vec<&Pulse>) =
            pulses.iter().partition(|p| p.fall < reset);
        let last = before.last().unwrap().width_us();
        assert!(neutral.contains(&last), "{end:?}: {last} before the reset");
        assert!(after.len() > 10, "{end:?}: {} pulses after", after.len());
        for pulse in after {
            let width = pulse.width_us();
            assert!(neutral.contains(&width), "{end:?}: {width} after the reset");
        }
    }
}

#[test]
fn a_laptop_that_stops_reading_or_goes_away_disturbs_nothing() {
    let mut flight = in_flight();
    let Ready { rig, station, .. } = &mut flight;
    let at = rig.now();
    rig.chip.usb_host.pause_reading(true);
    station.run(rig, ms(1000)).unwrap();
    rig.chip.usb_host.pause_reading(false);
    rig.chip.usb_host.detach();
    station.run(rig, ms(1000)).unwrap();
    rig.chip.usb_host.attach();
    station.run(rig, ms(1000)).unwrap();
    assert_pulses_went_on(rig.truth().pulses_since(Axis::Pitch, at), ms(3000));
    let pitch = rig.environment.vehicle().pitch_rad();
    assert!(pitch.abs() < 0.03, "{pitch}");
    let steps = rig.truth().steps.iter().filter(|s| s.start >= at).count();
    assert!((449..=451).contains(&steps), "{steps} steps in 3 s");
    let before = station.received().heartbeats.len();
    station.run(rig, ms(2000)).unwrap();
    assert!(station.received().heartbeats.len() > before);
    assert_eq!(station.state(), Some(StateKind::Active));
}

/// An image that lost a bit while nothing ran is left to the bootloader, and the servo gets neutral
/// pulses alone; the image that replaces it tells so.
#[test]
fn a_damaged_image_is_not_started_and_leaves_the_rudder_at_neutral() {
    let flight = in_flight();
    let image = firmware();
    let middle = (image.address() + image.bytes().len() as u32 / 2, 0x10);
    // The first instruction of what steers.
    let mut symbols = image.symbols();
    let (_, steer) = symbols.find(|(name, _)| name.contains("Flight5steer")).expect("a function");
    for (place, bit) in [middle, (steer & !1, 0x08)] {
        refuses_to_start(flight.clone(), place, bit);
    }
}

/// The processor locks up in code that each start runs, too: the rudder gets neutral pulses at the
/// first start, and before the bootloader has the board. No pulse is cut but the one in flight.
#[test]
fn a_lock_up_in_the_check_of_the_image_leaves_the_rudder_at_neutral() {
    /// `mov sp, pc`: the stack lies in flash.
    const STACK_IN_FLASH: [u8; 2] = 0x46FD_u16.to_le_bytes();
    let image = firmware();
    let mut symbols = image.symbols();
    let (_, check) = symbols.find(|(name, _)| name.contains("Engine5go_on")).expect("a function");
    let mut flight = in_flight();
    let Ready { rig, station, .. } = &mut flight;
    let at = rig.now();
    rig.chip.load_flash(check & !1, &STACK_IN_FLASH);
    station.run(rig, ms(3000)).unwrap();
    let resets: Vec<_> = rig.resets().iter().map(|(_, cause)| *cause).collect();
    assert_eq!(resets, [ResetCause::Watchdog, ResetCause::Watchdog, ResetCause::System]);
    assert!(rig.in_bootloader());
    let (first, _) = rig.resets()[0];
    let behind = rig.truth().pulses_since(Axis::Pitch, first);
    assert!(behind[0].rise - at < ms(800), "{}", behind[0].rise - at);
    assert!((30..38).contains(&behind.len()), "{}", behind.len());
    let neutral = default_neutral_us();
    assert!(behind.iter().all(|pulse| neutral.contains(&pulse.width_us())));
}

/// A handler that comes back with all interrupts held off, as a flipped bit in it may have it, ends
/// no flight: the main loop lets them go on when it sleeps next.
#[test]
fn interrupts_that_stay_held_off_go_on() {
    const SYSTICK: u32 = 15;
    /// TCC0, line 15.
    const TICK: u32 = 16 + 15;
    let mut flight = in_flight();
    let Ready { rig, station, .. } = &mut flight;
    for exception in [SYSTICK, TICK] {
        let mut registers = (0..100_000)
            .find_map(|_| {
                rig.run_for(Ticks(20)).unwrap();
                let registers = rig.chip.registers();
                let is_in_handler = !registers.primask && registers.xpsr & 0x1FF == exception;
                is_in_handler.then_some(registers)
            })
            .expect("the exception");
        registers.primask = true;
        rig.chip.set_registers(&registers);
        station.run(rig, ms(200)).unwrap();
        assert_eq!(rig.resets().len(), 0, "behind exception {exception}");
        assert_eq!(station.state(), Some(StateKind::Active));
    }
}

fn refuses_to_start(mut flight: Ready, place: u32, bit: u8) {
    let Ready { rig, station, .. } = &mut flight;
    let sound = rig.chip.memory.flash()[place as usize];
    rig.chip.load_flash(place, &[sound ^ bit]);
    rig.press_reset();
    let at = rig.now();
    station.run(rig, ms(2000)).unwrap();
    assert!(rig.in_bootloader());
    // Long enough for the servo to get there.
    let pulses = rig.truth().pulses_since(Axis::Pitch, at);
    assert!((30..34).contains(&pulses.len()), "{}", pulses.len());
    let neutral = default_neutral_us();
    assert!(pulses.iter().all(|pulse| neutral.contains(&pulse.width_us())));
    assert!(rig.environment.vehicle().rudders_rad()[0].abs() < 0.02);
    rig.environment.catch();
    rig.environment.tilt_clamp_to([0.0, 0.0]);
    // A programmer puts the image right and resets.
    rig.chip.load_flash(place, &[sound]);
    rig.press_reset();
    station.wait_for_state(rig, ms(4000), StateKind::Latched).unwrap();
    // The state is told before the reason.
    station.run(rig, ms(100)).unwrap();
    let told = &station.received().texts;
    let expected = "latched fault: self-check failed: flash";
    assert!(told.iter().any(|text| text == expected), "{told:?}");
}
