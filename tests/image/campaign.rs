//! A sample of the campaign of faults; `lab faults` carries out the whole of it.

use crate::{firmware, ready, with_two_axes};
use rig::bno055::FaultKind;
use rig::faults::{Campaign, Case, Ending, Kind, Phase, Plan, SystemKind};
use rig::{Ready, ServoKind, Setup, Ticks, prepare};
use std::collections::BTreeSet;

/// Of every kind this many runs.
const RUNS: u32 = 2;

#[test]
fn faults_at_random_instants_end_recovered_or_neutral() {
    let frame_hz = f64::from(ServoKind::S3003.frame_hz());
    let campaign = Campaign::new(&ready(), frame_hz, Phase::Flight, 1).unwrap();
    let (mut recovered, mut neutral) = (0, 0);
    let sample = FaultKind::ALL
        .into_iter()
        .flat_map(|kind| (0..RUNS).map(move |number| Case { kind: Kind::Sensor(kind), number }));
    // In these two a rate has its highest bit flipped in two bursts on end, which looks like a
    // turn.
    let twice = [7, 27].map(|number| Case { kind: Kind::Sensor(FaultKind::Spikes), number });
    for case in sample.chain(twice) {
        let outcome = campaign.run(case).unwrap();
        match outcome.verdict.ending {
            Ending::Recovered => recovered += 1,
            Ending::Neutral => neutral += 1,
            _ => panic!("{outcome:?}"),
        }
    }
    // The sample has faults that are ridden out and faults that end the flight.
    assert!(recovered >= 5 && neutral >= 5, "{recovered}, {neutral}");
}

/// A rudder that is held off its centre is at neutral there, and nowhere else.
#[test]
fn faults_of_a_vehicle_whose_rudder_is_held_off_its_centre_end_so_too() {
    let mut setup = Setup::with_polarity(ServoKind::S3003, 1);
    setup.rig.bench.parameters = setup.rig.bench.parameters.with_lateral_offset(5e-3);
    setup.parameters.push(("SRV_HOLD_DEG".into(), -2.29));
    let ready = prepare(firmware(), &setup, &mut |_| {}).unwrap();
    let frame_hz = f64::from(ServoKind::S3003.frame_hz());
    let campaign = Campaign::new(&ready, frame_hz, Phase::Flight, 1).unwrap();
    let mut neutral = 0;
    for kind in
        [FaultKind::Unplugged, FaultKind::SdaStuck, FaultKind::ConfigReset, FaultKind::Frozen]
    {
        for number in 0..2 {
            let outcome = campaign.run(Case { kind: Kind::Sensor(kind), number }).unwrap();
            match outcome.verdict.ending {
                Ending::Recovered => {}
                Ending::Neutral => neutral += 1,
                _ => panic!("{outcome:?}"),
            }
        }
    }
    assert!(neutral >= 4, "{neutral}");
}

/// The same case of the same campaign is the same run, whatever was run before it.
#[test]
fn a_run_can_be_repeated() {
    let frame_hz = f64::from(ServoKind::S3003.frame_hz());
    let campaign = || Campaign::new(&ready(), frame_hz, Phase::Flight, 7).unwrap();
    let case = Case { kind: Kind::Sensor(FaultKind::BitFlips), number: 3 };
    let (one, two) = (campaign(), campaign());
    let _ = two.run(Case { kind: Kind::Sensor(FaultKind::Spikes), number: 0 });
    let (one, two) = (one.run(case).unwrap(), two.run(case).unwrap());
    assert_eq!(format!("{one:?}"), format!("{two:?}"));
}

#[test]
fn faults_beyond_the_sensor_never_drive_a_rudder_wrongly_for_long() {
    beyond_the_sensor(&ready(), ServoKind::S3003, 20);
}

/// Beyond the sensor: of every kind a few. docs/reference/campaigns.md has what thousands showed.
pub(crate) fn beyond_the_sensor(ready: &Ready, servo: ServoKind, least_harmless: u32) {
    let campaign = Campaign::new(ready, f64::from(servo.frame_hz()), Phase::Flight, 1).unwrap();
    let (mut restarted, mut noticed, mut harmless) = (0, 0, 0);
    // A flipped bit of the image may make the program do what the emulated chip does not model.
    let mut unmodelled = 0;
    for kind in SystemKind::ALL {
        for number in 0..3 {
            let outcome = campaign.run(Case { kind: Kind::System(kind), number }).unwrap();
            match outcome.verdict.ending {
                Ending::Recovered | Ending::Neutral => {}
                Ending::Restarted => restarted += 1,
                Ending::Unmodelled(_) => unmodelled += 1,
                _ => panic!("{outcome:?}"),
            }
            noticed += u32::from(outcome.verdict.noticed);
            harmless += u32::from(outcome.verdict.harmless);
        }
    }
    assert!(unmodelled <= 1, "{unmodelled}");
    assert!(
        restarted >= 20 && noticed > restarted && harmless >= least_harmless,
        "{restarted} {noticed} {harmless}"
    );
}

/// In every phase but the flight, in which [`beyond_the_sensor`] has them: what resets the chip or
/// hangs it, and what flips where the phase's own memory, clocks and pulses are made.
#[test]
fn faults_in_every_phase_leave_the_rudder_at_neutral_and_the_stored_parameters_whole() {
    let kinds = [
        SystemKind::RamBurst,
        SystemKind::CoreRegister,
        SystemKind::FlashImage,
        SystemKind::TimerRegister,
        SystemKind::ClockRegister,
        SystemKind::Hang,
        SystemKind::HangMasked,
        SystemKind::BrownOut,
        SystemKind::ResetButton,
        SystemKind::UsbFrames,
        SystemKind::Several,
    ];
    let ready = ready();
    let frame_hz = f64::from(ServoKind::S3003.frame_hz());
    for phase in Phase::ALL {
        if phase == Phase::Flight {
            continue;
        }
        let campaign = Campaign::new(&ready, frame_hz, phase, 1).unwrap();
        let mut restarted = 0;
        for kind in kinds {
            let outcome = campaign.run(Case { kind: Kind::System(kind), number: 0 }).unwrap();
            match outcome.verdict.ending {
                Ending::Recovered | Ending::Neutral => {}
                Ending::Restarted => restarted += 1,
                _ => panic!("{phase}: {outcome:?}"),
            }
        }
        assert!(restarted >= 4, "{phase}: {restarted}");
    }
}

/// A flipped bit of the image is noticed, whether or not it would have done harm. It ends in a
/// reset with the rudder at neutral. One of eight may do what the emulated chip does not model.
#[test]
fn a_flipped_bit_of_the_image_is_noticed() {
    let frame_hz = f64::from(ServoKind::S3003.frame_hz());
    let campaign = Campaign::new(&ready(), frame_hz, Phase::Flight, 2).unwrap();
    let mut unmodelled = 0;
    for number in 0..8 {
        let kind = Kind::System(SystemKind::FlashImage);
        let outcome = campaign.run(Case { kind, number }).unwrap();
        if let Ending::Unmodelled(_) = outcome.verdict.ending {
            unmodelled += 1;
            continue;
        }
        let is_safe = outcome.verdict.ending == Ending::Restarted
            && outcome.verdict.wrong < Ticks::from_ms(100);
        assert!(outcome.verdict.noticed && is_safe, "{outcome:?}");
    }
    assert!(unmodelled <= 1, "{unmodelled}");
}

/// What ends in a reset by the firmware itself, by the slowest and the fastest frame and with one
/// rudder and two: no pulse is cut. `lab faults --resets` has more of it.
#[test]
fn a_reset_by_the_firmware_cuts_no_pulse() {
    let mut cut = Vec::new();
    let mut resets = 0;
    for (servo, two_axes) in [(ServoKind::S3003, false), (ServoKind::Digital, true)] {
        let ready = vehicle(servo, two_axes);
        for phase in Plan::Resets.phases() {
            let frame_hz = f64::from(servo.frame_hz());
            let mut campaign = Campaign::new(&ready, frame_hz, phase, 1).unwrap();
            campaign.plan = Plan::Resets;
            for kind in Plan::Resets.kinds(phase) {
                for number in 0..6 {
                    let outcome = campaign.run(Case { kind, number }).unwrap();
                    resets += u32::from(outcome.verdict.ending == Ending::Restarted);
                    if matches!(outcome.verdict.ending, Ending::Unsafe(_))
                        || outcome.verdict.strays > 0
                    {
                        cut.push(format!(
                            "{phase}, {}: {:?}",
                            outcome.fault, outcome.verdict.ending
                        ));
                    }
                }
            }
        }
    }
    assert!(cut.is_empty(), "{} of 84: {cut:#?}", cut.len());
    assert!(resets > 75, "{resets}");
}

/// Each register of the servo timer by one bit of its own, and each bit that by itself could turn
/// the rudder's pulses round, move or stop them for ever. `lab faults --timer-bits` has all.
#[test]
fn a_flipped_bit_of_the_servo_timer_steers_for_a_moment_at_most() {
    // OTMX, DTIEN1, INVEN5, PGE5, the sources of fault A and B, events to be counted, CPTEN1.
    const BITS: [&str; 9] = [
        "bit 1 of TCC0.WEXCTRL",
        "bit 9 of TCC0.WEXCTRL",
        "bit 21 of TCC0.DRVCTRL",
        "bit 5 of TCC0.PATT",
        "bit 1 of TCC0.FCTRLA",
        "bit 1 of TCC0.FCTRLB",
        "bit 1 of TCC0.EVCTRL",
        "bit 5 of TCC0.EVCTRL",
        "bit 25 of TCC0.CTRLA",
    ];
    let frame_hz = f64::from(ServoKind::S3003.frame_hz());
    let mut campaign = Campaign::new(&ready(), frame_hz, Phase::Flight, 1).unwrap();
    campaign.plan = Plan::TimerBits;
    let bits = campaign.timer_bits();
    let (mut registers, mut wrong) = (BTreeSet::new(), Vec::new());
    for (number, bit) in (0..).zip(&bits) {
        let (_, register) = bit.rsplit_once(' ').unwrap();
        if registers.insert(register) || BITS.contains(&bit.as_str()) {
            let kind = Kind::System(SystemKind::TimerRegister);
            let outcome = campaign.run(Case { kind, number }).unwrap();
            assert!(outcome.fault.contains(bit), "{} {bit}", outcome.fault);
            if outcome.verdict.for_ever || outcome.verdict.wrong > Ticks::from_ms(200) {
                wrong.push(format!("{bit}: {:?}", outcome.verdict.ending));
            }
        }
    }
    assert_eq!(registers.len(), 26);
    assert!(BITS.iter().all(|bit| bits.iter().any(|one| one == bit)));
    assert!(wrong.is_empty(), "{wrong:#?}");
}

/// A vehicle in standby.
fn vehicle(servo: ServoKind, two_axes: bool) -> Ready {
    let mut setup = Setup::with_polarity(servo, 1);
    if two_axes {
        setup = with_two_axes(setup);
    }
    prepare(firmware(), &setup, &mut |_| {}).unwrap()
}
