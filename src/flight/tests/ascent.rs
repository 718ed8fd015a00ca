//! Free flight: launch and burnout by the acceleration, and the attitude by the gyroscope alone.

use super::*;

/// A desk in standby that looks for a launch, with gains that follow the burn.
fn desk(changes: &[(&str, f32)]) -> Desk {
    let mut params = params();
    let given = [
        ("FUSE_ACC", 0.0),
        ("LAUNCH_ACC", 15.0),
        ("BURNOUT_ACC", 5.0),
        ("PID_LAW", 0.0),
        ("PID_KI", 0.5),
        ("GS_ROWS", 2.0),
        ("GS1_KP", 1.0),
        ("GS2_S", 4.0),
        ("GS2_KP", 3.0),
    ];
    for (name, value) in given.iter().chain(changes) {
        params.set(name, *value).unwrap();
    }
    let mut desk = Desk::with(0.0, params, BootReport::default());
    feeling(&mut desk, PAD, REST);
    desk.command(Command::Arm).unwrap();
    desk
}

const PAD: [i16; 3] = [0, 0, -981];
/// A thrust that is 11 deg off the axis of a level vehicle.
const THRUST: [i16; 3] = [500, 0, -2_500];
const FALL: [i16; 3] = [0; 3];

/// `steps` steps of a vehicle that stays level and feels `acc`, counts.
fn feeling(desk: &mut Desk, acc: [i16; 3], steps: usize) -> Snapshot {
    let run = |desk: &mut Desk| {
        let level = reading(desk.now_us, 0.0, 0.0);
        desk.step_with(Ok(RawSample { acc, ..level }))
    };
    (0..steps).map(|_| run(desk)).last().unwrap()
}

fn tilt_deg(desk: &Desk) -> f32 {
    let [roll, pitch, _] = desk.flight.angles_rad();
    roll.hypot(pitch).to_degrees()
}

#[test]
fn a_launch_releases_and_a_burnout_ends_control() {
    let mut desk = desk(&[]);
    assert_eq!(feeling(&mut desk, PAD, 200).state, State::Armed);
    assert_eq!(feeling(&mut desk, THRUST, 9).state, State::Armed);
    assert!(feeling(&mut desk, THRUST, 3).state.is_active());
    assert!(feeling(&mut desk, THRUST, 500).state.is_active());
    assert!(feeling(&mut desk, FALL, 15).state.is_active());
    let end = feeling(&mut desk, FALL, 10);
    assert_eq!(end.state, State::Standby);
    assert_eq!(end.pulses[0], NEUTRAL);
}

#[test]
fn a_vehicle_that_is_not_armed_is_released_by_no_thrust() {
    let mut desk = desk(&[]);
    desk.command(Command::Disarm).unwrap();
    let thrust = feeling(&mut desk, THRUST, 100);
    assert_eq!((thrust.state, thrust.pulses[0]), (State::Standby, NEUTRAL));
}

/// The thrust shows a vertical 11 deg away. The gyroscope, which feels no turn, keeps the attitude;
/// the accelerometer, where it is left in, does not.
#[test]
fn thrust_is_no_vertical_in_free_flight() {
    for (fuse_acc, expected_deg) in [(0.0, 0.0..0.3), (1.0, 5.0..15.0)] {
        let mut desk = desk(&[("FUSE_ACC", fuse_acc)]);
        feeling(&mut desk, THRUST, 600);
        let tilt_deg = tilt_deg(&desk);
        assert!(expected_deg.contains(&tilt_deg), "{fuse_acc}: {tilt_deg}");
    }
}

#[test]
fn the_tilt_grows_uncertain_in_free_flight() {
    let mut desk = desk(&[]);
    let tilt_sd_deg = |desk: &Desk| desk.flight.attitude_sd_deg()[0];
    let pad = tilt_sd_deg(&desk);
    assert!((0.2..0.8).contains(&pad), "{pad}");
    feeling(&mut desk, THRUST, 200);
    let early = tilt_sd_deg(&desk);
    feeling(&mut desk, THRUST, 800);
    let late = tilt_sd_deg(&desk);
    assert!(early < 0.8 && late > 2.0, "{early} {late}");
    // What is left of it the accelerometer must find again.
    feeling(&mut desk, FALL, 100);
    assert!(tilt_sd_deg(&desk) > 2.0);
}

/// 0.5 deg/s for each g is 0.774 deg/s under 1.55 g more than on the pad, where the offset was
/// learned. The gyroscope of a vehicle that stays level reads nothing, so that what is taken off
/// turns the attitude.
#[test]
fn what_acceleration_shifts_is_taken_off_the_rates_in_free_flight() {
    for (name, axis) in [("GYR_PER_G_X", 0), ("GYR_PER_G_Y", 1)] {
        let mut desk = desk(&[(name, 0.5)]);
        feeling(&mut desk, PAD, 200);
        assert!(tilt_deg(&desk) < 0.05, "{name}: {}", tilt_deg(&desk));
        let begun_us = desk.now_us;
        feeling(&mut desk, [0, 0, -2_500], 500);
        let expected_deg = -0.774 * (desk.now_us - begun_us) as f32 * 1e-6;
        let angle_deg = desk.flight.angles_rad()[axis].to_degrees();
        assert!((angle_deg - expected_deg).abs() < 0.03, "{name}: {angle_deg} {expected_deg}");
    }
}

/// The same error asks for the more of the rudder the later it is in the burn.
#[test]
fn gains_follow_the_burn() {
    let crank = |thrust_steps: usize| {
        let mut desk = desk(&[("PID_KI", 0.0), ("PITCH_SET_DEG", 10.0)]);
        let setpoint = feeling(&mut desk, THRUST, thrust_steps);
        f32::from(setpoint.cranks[0]) / -10.0_f32.to_radians()
    };
    for (steps, expected) in [(20, 1.1), (210, 2.05), (410, 3.0), (900, 3.0)] {
        let kp = crank(steps);
        assert!((kp - expected).abs() < 0.1, "{steps}: {kp}");
    }
}

#[test]
fn rows_out_of_order_are_named_before_anything_is_armed() {
    let mut desk = desk(&[]);
    desk.command(Command::Disarm).unwrap();
    desk.flight.set_param("GS2_S", 0.0).unwrap();
    assert_eq!(desk.command(Command::Arm), Err(Refusal::Schedule));
    desk.flight.set_param("GS2_S", 3.0).unwrap();
    desk.command(Command::Arm).unwrap();
}

/// A flight that is resumed in the midst of the burn goes on with the same bits, and ends with it.
#[test]
fn another_flight_goes_on_through_the_burn() {
    for before in [5, 12, 300] {
        let mut desk = desk(&[("AXES", 2.0), ("SRV2_POLARITY", 1.0)]);
        let snapshot = feeling(&mut desk, THRUST, before);
        let mut words = Vec::new();
        desk.flight.tell(&mut |word| words.push(word));
        let mut other = Flight::new(desk.flight.params().clone(), BootReport::default()).unwrap();
        assert!(other.resume(&snapshot.sample.unwrap(), &words));
        let mut refresh = desk.refresh;
        for step in 0..600 {
            let acc = if step < 400 { THRUST } else { FALL };
            let now = Micros(desk.now_us);
            let sample = RawSample {
                acc,
                gyr: [step % 7, 3 - step % 5, 1],
                ..reading(desk.now_us, 0.0, 0.0)
            };
            let again = refresh.read(sample);
            let (here, there) = (desk.step_with(Ok(sample)), other.step(now, Ok(again)));
            assert_eq!(here.pulses, there.pulses, "{before}, {step}");
            assert_eq!(here.state, there.state, "{before}, {step}");
            assert_eq!(here.cranks, there.cranks, "{before}, {step}");
        }
        assert_eq!(desk.flight.state(), State::Standby);
    }
}
