//! What the image does to vehicles that nothing is wrong with: a sample of `lab faults --sound`.

use crate::{firmware, with_two_axes};
use rig::bno055::Fault;
use rig::faults::{Alarms, Ending, Phase, Sound, SoundKind};
use rig::{ServoKind, Setup, Ticks};

fn vehicle(servo: ServoKind, axes: usize, phase: Phase) -> Sound {
    let mut setup = Setup::with_polarity(servo, 1);
    if axes == 2 {
        setup = with_two_axes(setup);
    }
    Sound::new(firmware(), setup, phase)
}

/// Each kind in one of its phases, with either servo, and with one rudder or two. Flash takes what
/// the data sheet says at most.
#[test]
fn a_sound_vehicle_is_left_alone() {
    use {Phase::*, ServoKind::*, SoundKind::*};
    let runs = [
        (Rest, Start, S3003, 1),
        (Rest, Flight, Digital, 2),
        (Vibration, Flight, S3003, 1),
        (Knocks, Flight, Digital, 1),
        (Hand, Standby, S3003, 2),
        (FastHand, Armed, Digital, 1),
        (WarmUp, Failsafe, S3003, 1),
        (Frames, Flight, S3003, 2),
        (Orders, Armed, Digital, 1),
        (Flood, Flight, S3003, 1),
        (Noise, Flight, Digital, 2),
        (Saves, Standby, Digital, 1),
        (SetUp, Standby, S3003, 1),
    ];
    let mut frames = 0;
    for (kind, phase, servo, axes) in runs {
        let mut sound = vehicle(servo, axes, phase);
        sound.length = Some(Ticks::from_ms(6_000));
        let sound = sound.with_hardware("flash-time=1").unwrap();
        let outcome = sound.run(kind, 0).unwrap();
        assert_eq!(outcome.verdict.ending, Ending::Recovered, "{outcome:?}");
        assert!(outcome.watched.bursts > 400, "{outcome:?}");
        frames += outcome.watched.frames;
    }
    assert!(frames > 5_000, "{frames}");
}

/// What was drawn again is the same run.
#[test]
fn a_sound_run_can_be_repeated() {
    let run = || {
        let mut sound = vehicle(ServoKind::S3003, 1, Phase::Standby);
        sound.length = Some(Ticks::from_ms(500));
        sound.run(SoundKind::Knocks, 7)
    };
    assert_eq!(format!("{:?}", run().unwrap()), format!("{:?}", run().unwrap()));
}

/// The judge sees what a sensor that is not sound does: refused bursts and steps without one, a
/// failsafe, and a vehicle that does not come back to standby.
#[test]
fn a_vehicle_that_is_not_sound_has_alarms() {
    let of = |phase, fault| {
        let mut sound = vehicle(ServoKind::S3003, 1, phase);
        sound.length = Some(Ticks::from_ms(2_000));
        sound.fault = Some(fault);
        let outcome = sound.run(SoundKind::Rest, 0).unwrap();
        match outcome.verdict.ending {
            Ending::Alarmed(alarms) => alarms,
            _ => panic!("{fault:?}: {outcome:?}"),
        }
    };
    let Alarms { refused, failsafes, .. } = of(Phase::Flight, Fault::GyroDead);
    assert!(refused > 0 && failsafes == 1, "{refused} {failsafes}");
    let Alarms { refused, lost, .. } = of(Phase::Flight, Fault::Naks { probability: 1e-2 });
    assert!(lost > 0 && refused == 0, "{lost} {refused}");
    let Alarms { failsafes, .. } = of(Phase::Armed, Fault::Unplugged);
    assert_eq!(failsafes, 1);
    let Alarms { states, .. } = of(Phase::Start, Fault::Unplugged);
    assert_eq!(states, 1);
}
