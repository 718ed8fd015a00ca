//! A sample of the campaign of faults; `tvc faults` carries out the whole of it.

use crate::{firmware, ready};
use rig::bno055::FaultKind;
use rig::faults::{Campaign, Case, Ending, Kind, Phase, SystemKind};
use rig::{Ready, ServoKind, Setup, prepare};

/// Of every kind this many runs.
const RUNS: u32 = 2;

#[test]
fn faults_at_random_instants_end_recovered_or_neutral() {
    let frame_hz = f64::from(ServoKind::S3003.frame_hz());
    let campaign = Campaign::new(&ready(), frame_hz, Phase::Flight, 1).unwrap();
    let (mut recovered, mut neutral) = (0, 0);
    let sample = FaultKind::ALL.into_iter().flat_map(|kind| {
        (0..RUNS).map(move |number| Case {
            kind: Kind::Sensor(kind),
            number,
        })
    });
    // In these two a rate has its highest bit flipped in two bursts on end, which looks like a
    // turn.
    let twice = [7, 27].map(|number| Case {
        kind: Kind::Sensor(FaultKind::Spikes),
        number,
    });
    for case in sample.chain(twice) {
        let outcome = campaign.run(case).unwrap();
        match outcome.ending {
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
    for kind in [
        FaultKind::Unplugged,
        FaultKind::SdaStuck,
        FaultKind::ConfigReset,
        FaultKind::Frozen,
    ] {
        for number in 0..2 {
            let outcome = campaign
                .run(Case {
                    kind: Kind::Sensor(kind),
                    number,
                })
                .unwrap();
            match outcome.ending {
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
    let case = Case {
        kind: Kind::Sensor(FaultKind::BitFlips),
        number: 3,
    };
    let (one, two) = (campaign(), campaign());
    let _ = two.run(Case {
        kind: Kind::Sensor(FaultKind::Spikes),
        number: 0,
    });
    let (one, two) = (one.run(case).unwrap(), two.run(case).unwrap());
    assert_eq!(format!("{one:?}"), format!("{two:?}"));
}

#[test]
fn faults_beyond_the_sensor_never_drive_a_rudder_wrongly_for_long() {
    beyond_the_sensor(&ready(), ServoKind::S3003);
}

/// Beyond the sensor: of every kind a few. What a campaign of thousands shows is in docs/faults.md.
pub(crate) fn beyond_the_sensor(ready: &Ready, servo: ServoKind) {
    let campaign = Campaign::new(ready, f64::from(servo.frame_hz()), Phase::Flight, 1).unwrap();
    let (mut restarted, mut noticed, mut harmless) = (0, 0, 0);
    for kind in SystemKind::ALL {
        for number in 0..3 {
            let outcome = campaign
                .run(Case {
                    kind: Kind::System(kind),
                    number,
                })
                .unwrap();
            match outcome.ending {
                Ending::Recovered | Ending::Neutral => {}
                Ending::Restarted => restarted += 1,
                _ => panic!("{outcome:?}"),
            }
            noticed += u32::from(outcome.noticed);
            harmless += u32::from(outcome.harmless);
        }
    }
    assert!(restarted >= 20 && noticed > restarted && harmless >= 20);
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
            let outcome = campaign
                .run(Case {
                    kind: Kind::System(kind),
                    number: 0,
                })
                .unwrap();
            match outcome.ending {
                Ending::Recovered | Ending::Neutral => {}
                Ending::Restarted => restarted += 1,
                _ => panic!("{phase}: {outcome:?}"),
            }
        }
        assert!(restarted >= 4, "{phase}: {restarted}");
    }
}

/// A flipped bit of the image is noticed, whether or not it would have done harm, and ends in a
/// reset with the rudder at neutral.
#[test]
fn a_flipped_bit_of_the_image_is_noticed() {
    let frame_hz = f64::from(ServoKind::S3003.frame_hz());
    let campaign = Campaign::new(&ready(), frame_hz, Phase::Flight, 2).unwrap();
    for number in 0..8 {
        let kind = Kind::System(SystemKind::FlashImage);
        let outcome = campaign.run(Case { kind, number }).unwrap();
        let is_safe = outcome.ending == Ending::Restarted && outcome.wrong_ms < 100.0;
        assert!(outcome.noticed && is_safe, "{outcome:?}");
    }
}
