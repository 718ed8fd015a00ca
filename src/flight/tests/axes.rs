//! Two axes: the roll axis has a law, a servo and a polarity of its own.

use super::*;

/// A desk that steers both axes, in standby.
fn desk() -> Desk {
    let mut params = params();
    params.set("AXES", 2.0).unwrap();
    params.set("SRV2_POLARITY", 1.0).unwrap();
    let mut desk = Desk::with(0.0, params, BootReport::default());
    tilted(&mut desk, 0.0, REST);
    assert_eq!(desk.flight.state(), State::Standby);
    desk
}

/// `steps` steps of a drone that is held, rolled by `roll`, rad.
fn tilted(desk: &mut Desk, roll: f64, steps: usize) -> Snapshot {
    let run = |desk: &mut Desk| {
        let level = reading(desk.now_us, 0.0, 0.0);
        let (sin, cos) = roll.sin_cos();
        let turned = |[x, y, z]: [i16; 3]| {
            let (y, z) = (f64::from(y), f64::from(z));
            [x, (cos * y + sin * z).round() as i16, (cos * z - sin * y).round() as i16]
        };
        desk.step_with(Ok(RawSample { acc: turned(level.acc), mag: turned(level.mag), ..level }))
    };
    (0..steps).map(|_| run(desk)).last().unwrap()
}

#[test]
fn an_axis_that_is_not_steered_has_no_pulse_and_no_test() {
    let mut desk = Desk::in_standby(0.0);
    assert_eq!(desk.step().pulses, [NEUTRAL, PulseUs::NONE]);
    assert_eq!(desk.flight.neutral(), [NEUTRAL, PulseUs::NONE]);
    let pulse = Command::TestPulse(Axis::Roll, PulseUs(1600));
    assert_eq!(desk.command(pulse), Err(Refusal::NotSteered));
    desk.flight.set_param("AXES", 2.0).unwrap();
    assert_eq!(desk.step().pulses, [NEUTRAL; 2]);
    desk.command(pulse).unwrap();
    assert_eq!(desk.step().pulses, [NEUTRAL, PulseUs(1600)]);
    desk.flight.set_param("AXES", 1.0).unwrap();
    assert_eq!(desk.step().pulses, [NEUTRAL, PulseUs::NONE]);
}

#[test]
fn both_rudders_must_have_been_seen_to_answer() {
    for (name, value) in [("SRV2_POLARITY", 0.0), ("SRV2_POLARITY", 2.0), ("SRV_POLARITY", 0.0)] {
        let mut desk = desk();
        desk.flight.set_param(name, value).unwrap();
        assert_eq!(desk.command(Command::Arm), Err(Refusal::Polarity), "{name} {value}");
        desk.see(name);
        assert_eq!(desk.command(Command::Arm), Ok(()));
    }
    let mut desk = desk();
    desk.flight.set_param("SRV2_DIR", -1.0).unwrap();
    assert_eq!(desk.command(Command::Arm), Err(Refusal::Polarity));
}

#[test]
fn the_rudder_that_is_watched_answers_and_the_other_rests() {
    let mut desk = desk();
    desk.flight.set_param("SRV2_POLARITY", 2.0).unwrap();
    desk.flight.host_heard(Micros(desk.now_us));
    // Some seconds, in which the estimate follows the accelerometer to the new tilt.
    for _ in 0..10 {
        tilted(&mut desk, 0.3, 100);
        desk.flight.host_heard(Micros(desk.now_us));
    }
    let [pitch, roll] = tilted(&mut desk, 0.3, 1).pulses;
    assert_eq!(pitch, NEUTRAL);
    // Right side down asks for positive crank angles, which are longer pulses.
    assert!(roll > PulseUs(1600), "{roll:?}");
}

#[test]
fn control_of_a_roll_moves_the_second_rudder_alone_and_its_end_brings_both_to_neutral() {
    let mut desk = desk();
    for _ in 0..10 {
        tilted(&mut desk, 0.3, 100);
    }
    desk.command(Command::Arm).unwrap();
    assert_eq!(tilted(&mut desk, 0.3, 10).pulses, [NEUTRAL; 2]);
    desk.command(Command::Release).unwrap();
    let [pitch, roll] = tilted(&mut desk, 0.3, 20).pulses;
    assert!(pitch.0.abs_diff(NEUTRAL.0) < 10, "{pitch:?}");
    assert!(roll > PulseUs(1600), "{roll:?}");
    while desk.flight.state().is_active() {
        desk.step_with(Err(SensorFault::Nak));
    }
    assert_eq!(desk.step_with(Err(SensorFault::Nak)).pulses, [NEUTRAL; 2]);
}

/// In flight one law takes the parameters over behind each step, for each takes some time.
#[test]
fn set_points_that_change_in_flight_count_one_step_after_another() {
    let mut desk = desk();
    desk.command(Command::Arm).unwrap();
    desk.command(Command::Release).unwrap();
    tilted(&mut desk, 0.0, 20);
    for name in ["PITCH_SET_DEG", "ROLL_SET_DEG"] {
        desk.flight.set_param(name, 10.0).unwrap();
    }
    let mut counts = || tilted(&mut desk, 0.0, 1).cranks.map(|crank| f32::from(crank) < -0.05);
    assert_eq!([counts(), counts(), counts()], [[false, false], [true, false], [true, true]]);
}
