//! The flight on a desk: a rigid body on a pivot, a servo with a lag, and a sensor that says what
//! it should.

use std::boxed::Box;
use std::vec::Vec;

use proptest::prelude::*;
use proptest::test_runner::FileFailurePersistence::WithSource;

mod ascent;
mod axes;
mod memory;
mod states;

use super::*;
use crate::config::TEST_PULSE_US;
use crate::failsafe::{Command, Crash, Latch, Reason};
use crate::servo::Servo;
use tvc_imu::Refresh;

const PERIOD_US: u64 = 10_000;
const NEUTRAL: PulseUs = PulseUs(1524);
/// Steps of rest after which the gyro's offset is known and the attitude levelled with it.
const REST: usize = 560;

/// What a sensor at rest on a body pitched by `pitch_rad` reads, turning at `rate_rad_s`: gravity
/// of 9.81 m/s2, a field of 17 uT north and 47 uT down.
pub(crate) fn reading(time_us: u64, pitch_rad: f64, rate_rad_s: f64) -> RawSample {
    let (sin, cos) = pitch_rad.sin_cos();
    let counts = |value: f64| value.round() as i16;
    RawSample {
        time: Micros(time_us),
        acc: [counts(981.0 * sin), 0, counts(-981.0 * cos)],
        gyr: [0, counts(rate_rad_s.to_degrees() * 16.0), 0],
        mag: [
            counts(16.0 * (17.0 * cos - 47.0 * sin)),
            0,
            counts(16.0 * (17.0 * sin + 47.0 * cos)),
        ],
    }
}

/// Ticks every [`PERIOD_US`], as the slow bus has them.
pub(crate) fn params() -> Params {
    let mut params = Params::default();
    params.set("I2C_KHZ", 100.0).unwrap();
    params.set("SRV_POLARITY", 1.0).unwrap();
    params
}

/// The pivot: `pitch'' = -31.6 servo` (the reduced model of `plant`), the servo a lag of 40 ms at
/// 5.5 rad/s.
pub(crate) struct Desk {
    pub(crate) flight: Flight,
    pub(crate) now_us: u64,
    pub(crate) pitch: f64,
    pub(crate) rate: f64,
    servo: f64,
    free: bool,
    /// Every step's input, to play again.
    inputs: Vec<(Micros, Result<RawSample, SensorFault>)>,
    pub(crate) refresh: Refresh,
}

impl Desk {
    pub(crate) fn new(pitch: f64) -> Self {
        Self::with(pitch, params(), BootReport::default())
    }

    pub(crate) fn with(pitch: f64, params: Params, report: BootReport) -> Self {
        Self {
            flight: Flight::new(params, report).unwrap(),
            now_us: 0,
            pitch,
            rate: 0.0,
            servo: 0.0,
            free: false,
            inputs: Vec::new(),
            refresh: Refresh::default(),
        }
    }

    /// A desk that has passed its self-test.
    pub(crate) fn in_standby(pitch: f64) -> Self {
        let mut desk = Self::new(pitch);
        desk.run(REST);
        assert_eq!(desk.flight.state(), State::Standby);
        desk
    }

    fn active(pitch: f64) -> Self {
        let mut desk = Self::in_standby(pitch);
        desk.command(Command::Arm).unwrap();
        desk.run(10);
        desk.release();
        desk
    }

    /// Somebody looks at a rudder and finds it right.
    pub(crate) fn see(&mut self, polarity: &str) {
        for value in [2.0, 1.0] {
            self.flight.set_param(polarity, value).unwrap();
        }
    }

    fn release(&mut self) {
        self.command(Command::Release).unwrap();
        self.free = true;
        self.rate = 0.2;
    }

    fn command(&mut self, command: Command) -> Result<(), Refusal> {
        self.flight.command(Micros(self.now_us), command)
    }

    pub(crate) fn step_with(&mut self, reading: Result<RawSample, SensorFault>) -> Snapshot {
        self.inputs.push((Micros(self.now_us), reading));
        let reading = reading.map(|raw| self.refresh.read(raw));
        let outputs = self.flight.step(Micros(self.now_us), reading);
        self.advance(((f64::from(outputs.pulses[0].0) - 1523.6) / 10.0).to_radians());
        outputs
    }

    pub(crate) fn step(&mut self) -> Snapshot {
        let sample = reading(self.now_us, self.pitch, self.rate);
        self.step_with(Ok(sample))
    }

    pub(crate) fn run(&mut self, steps: usize) -> Snapshot {
        (0..steps).map(|_| self.step()).last().unwrap()
    }

    fn advance(&mut self, commanded: f64) {
        self.now_us += PERIOD_US;
        let dt = 1e-4;
        for _ in 0..100 {
            let speed = ((commanded - self.servo) / 0.04).clamp(-5.5, 5.5);
            self.servo += speed * dt;
            if self.free {
                self.rate -= 31.6 * self.servo * dt;
                self.pitch += self.rate * dt;
            }
        }
    }
}

/// A turn of 0.8 rad within half a second. The accelerometer shows it late, and the attitude has
/// the newest rates for a whole period: without a correction it is 1 mrad off for seconds.
#[test]
fn a_turn_leaves_nothing_in_the_attitude() {
    let lag_s = f64::from(crate::config::ACC_LAG_S) - 0.5e-6 * PERIOD_US as f64;
    let mut desk = Desk::in_standby(0.8);
    let begun_us = desk.now_us;
    let turned = |at_s: f64| {
        let share = (at_s / 0.5).clamp(0.0, 1.0);
        let phase = core::f64::consts::PI * share;
        (0.4 * (1.0 + phase.cos()), -0.8 * core::f64::consts::PI * phase.sin())
    };
    for _ in 0..300 {
        let now_s = (desk.now_us - begun_us) as f64 * 1e-6;
        let (acc_pitch, rate) = (turned(now_s - lag_s).0, turned(now_s).1);
        desk.step_with(Ok(reading(desk.now_us, acc_pitch, rate)));
        if now_s > 0.6 {
            let pitch = desk.flight.angles_rad()[1];
            assert!(pitch.abs() < 5e-4, "{now_s} s: {pitch}");
        }
    }
}

#[test]
fn from_boot_to_upright() {
    for start in [0.2, 0.4, 0.8, -0.8] {
        let mut desk = Desk::new(start);
        let mut states = Vec::new();
        for _ in 0..REST {
            let outputs = desk.step();
            assert_eq!(outputs.pulses[0], NEUTRAL);
            let code = outputs.state.code();
            if states.last() != Some(&code) {
                states.push(code);
            }
        }
        assert_eq!(states, [1, 2], "self-test, standby");
        desk.command(Command::Arm).unwrap();
        assert_eq!(desk.run(20).pulses[0], NEUTRAL);
        desk.release();
        let mut furthest: f64 = 0.0;
        for _ in 0..200 {
            desk.step();
            furthest = furthest.min(desk.pitch * start.signum());
        }
        assert!(desk.pitch.abs() < 0.02, "{start}: ends at {}", desk.pitch);
        assert!(furthest > -0.05 * start.abs() - 0.01, "{start}: overshoots to {furthest}");
    }
}

#[test]
fn a_positive_pitch_asks_for_a_longer_pulse() {
    let mut desk = Desk::active(0.4);
    desk.rate = 0.0;
    let outputs = desk.run(10);
    assert!(outputs.pulses[0] > NEUTRAL && f32::from(outputs.cranks[0]) > 0.1);
}

#[test]
fn the_same_inputs_give_the_same_bits() {
    let mut desk = Desk::active(0.8);
    desk.run(20);
    desk.step_with(Err(SensorFault::Late));
    desk.run(50);
    let bits = |flight: &Flight| {
        let q = flight.attitude().orientation;
        [q.w, q.x, q.y, q.z].map(f32::to_bits)
    };
    let mut replay = Flight::new(params(), BootReport::default()).unwrap();
    let mut refresh = Refresh::default();
    for (now, reading) in &desk.inputs {
        replay.step(*now, reading.map(|raw| refresh.read(raw)));
    }
    assert_eq!(bits(&replay), bits(&desk.flight));
}

#[test]
fn a_glitch_of_forty_milliseconds_holds_the_last_command() {
    let mut desk = Desk::active(0.4);
    let held = desk.run(5).pulses[0];
    assert_ne!(held, NEUTRAL);
    for missed in 1..=5 {
        let outputs = desk.step_with(Err(SensorFault::Timeout));
        assert_eq!(outputs.pulses[0], held);
        assert!(outputs.state.is_active() && !outputs.sensor_healthy);
        assert_eq!(outputs.missed, missed);
    }
    assert!(desk.run(5).sensor_healthy);
}

#[test]
fn what_turned_while_samples_were_missed_is_made_good() {
    for missed in 1..=3 {
        let mut desk = Desk::in_standby(0.0);
        desk.rate = 1.0;
        for step in 0..40 {
            desk.pitch += 0.01;
            if (20..20 + missed).contains(&step) {
                desk.step_with(Err(SensorFault::Torn));
            } else {
                desk.step();
            }
        }
        let attitude = desk.flight.attitude();
        assert!(!attitude.flags.gap, "{missed}");
        let pitch = attitude.orientation.pitch();
        assert!((f64::from(pitch) - desk.pitch).abs() < 0.005, "{missed}: {pitch}");
    }
}

#[test]
fn after_a_long_loss_the_attitude_starts_over_before_arming() {
    let mut desk = Desk::active(0.4);
    for _ in 0..200 {
        desk.step_with(Err(SensorFault::Nak));
    }
    desk.free = false;
    (desk.pitch, desk.rate) = (-0.5, 0.0);
    let pitch = desk.run(60).orientation.quaternion().pitch();
    assert!((pitch + 0.5).abs() < 0.02, "{pitch}");
    assert!(desk.command(Command::Disarm).is_err(), "still settling");
    desk.run(200);
    desk.command(Command::Disarm).unwrap();
    assert_eq!(desk.command(Command::Arm), Err(Refusal::BiasUnknown));
    desk.run(REST);
    desk.command(Command::Arm).unwrap();
}

#[test]
fn a_sample_that_is_not_newer_is_late() {
    let mut desk = Desk::active(0.2);
    let sample = reading(desk.now_us, desk.pitch, desk.rate);
    assert!(desk.step_with(Ok(sample)).sample.is_some());
    assert!(desk.step_with(Ok(sample)).sample.is_none());
    let older = RawSample { time: Micros(sample.time.0 - 1), ..sample };
    let outputs = desk.step_with(Ok(older));
    assert_eq!((outputs.sample, outputs.missed), (None, 2));
}

#[test]
fn a_sample_that_is_too_old_when_it_comes_is_as_bad_as_none() {
    let mut desk = Desk::active(0.2);
    desk.run(5);
    desk.now_us += 80_000;
    let old = reading(desk.now_us - 70_000, desk.pitch, desk.rate);
    assert_eq!(desk.step_with(Ok(old)).pulses[0], NEUTRAL);
    assert_eq!(desk.flight.state(), State::Failsafe(Reason::StaleData));
}

#[test]
fn gains_change_in_flight_and_frame_rate_bus_calibration_and_mount_do_not() {
    let mut desk = Desk::active(0.4);
    desk.flight.set_param("PID_KP", 1.6).unwrap();
    for (name, value) in [
        ("SRV_RATE_HZ", 300.0),
        ("I2C_KHZ", 100.0),
        ("SRV_DIR", -1.0),
        ("CAL_GYR_OY", 1.0),
        ("MNT_PITCH_DEG", 1.0),
    ] {
        assert_eq!(desk.flight.set_param(name, value), Err(ParamError::Armed { name }));
    }
    assert_eq!(desk.flight.replace_params(params()), Err(ParamError::ArmedAll));
    desk.command(Command::Disarm).unwrap();
    desk.flight.set_param("SRV_RATE_HZ", 300.0).unwrap();
    assert_eq!(desk.flight.params().srv_rate_hz(), 300.0);
    desk.command(Command::Arm).unwrap();
}

#[test]
fn zero_gains_leave_the_rudder_alone_and_the_setpoint_moves_it() {
    let mut desk = Desk::active(0.0);
    desk.free = false;
    desk.rate = 0.0;
    desk.flight.set_param("SFC_GAIN_S", 0.0).unwrap();
    assert_eq!(desk.run(5).pulses[0], NEUTRAL);
    desk.flight.set_param("SFC_GAIN_S", 0.5).unwrap();
    desk.flight.set_param("PITCH_SET_DEG", 10.0).unwrap();
    // The nose is too low: the crank goes to negative angles, and the pulse below the centre.
    assert!(desk.run(5).pulses[0] < PulseUs(1424));
}

/// The nose is 10 deg too low: the crank goes to -10 deg, 100 us below the centre.
#[test]
fn a_proportional_law_turns_the_rudder_in_proportion() {
    let mut desk = Desk::in_standby(0.0);
    for (name, value) in [("PID_LAW", 0.0), ("PID_KP", 1.0), ("PID_KD", 0.0)] {
        desk.flight.set_param(name, value).unwrap();
    }
    desk.flight.set_param("PITCH_SET_DEG", 10.0).unwrap();
    desk.command(Command::Arm).unwrap();
    desk.release();
    desk.free = false;
    desk.rate = 0.0;
    assert_eq!(desk.run(5).pulses[0], PulseUs(1424));
}

#[test]
fn a_declination_turns_the_heading() {
    let mut desk = Desk::in_standby(0.0);
    desk.flight.set_param("DECLINATION_DEG", 90.0).unwrap();
    let yaw = desk.run(1000).orientation.quaternion().euler().yaw_rad;
    assert!((yaw - 90.0_f32.to_radians()).abs() < 0.01, "{yaw}");
}

#[derive(Clone, Debug)]
enum Event {
    Sample { dt_us: i64, acc: [i16; 3], gyr: [i16; 3], mag: [i16; 3] },
    Honest,
    Miss(SensorFault),
    Order(Command),
    Set(usize, f32),
}

fn event() -> impl Strategy<Value = Event> {
    let counts = || prop::array::uniform3(any::<i16>());
    prop_oneof![
        2 => (-20_000_i64..200_000, counts(), counts(), counts())
            .prop_map(|(dt_us, acc, gyr, mag)| Event::Sample { dt_us, acc, gyr, mag }),
        10 => Just(Event::Honest),
        1 => prop_oneof![
            Just(SensorFault::Nak),
            Just(SensorFault::Reset),
            Just(SensorFault::AllOnes),
        ].prop_map(Event::Miss),
        3 => prop_oneof![
            Just(Command::Arm),
            Just(Command::Release),
            Just(Command::Disarm),
            (prop_oneof![Just(Axis::Pitch), Just(Axis::Roll)], any::<u16>())
                .prop_map(|(axis, us)| Command::TestPulse(axis, PulseUs(us))),
        ].prop_map(Event::Order),
        1 => (0..Params::count(), prop::num::f32::ANY).prop_map(|(index, value)| Event::Set(index, value)),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: 64,
        // Cases that once failed are kept beside this file and come first.
        failure_persistence: Some(Box::new(WithSource("proptest-regressions"))),
        ..ProptestConfig::default()
    })]

    /// Whatever comes, the pulses stay in the hard range, are neutral unless control is active or
    /// an idle servo is set up, and the attitude is finite.
    #[test]
    fn nothing_leaves_the_envelope(
        axes in prop_oneof![Just(1.0_f32), Just(2.0)],
        events in prop::collection::vec(event(), 1..300),
    ) {
        let mut desk = Desk::in_standby(0.3);
        desk.flight.set_param("AXES", axes).unwrap();
        desk.see("SRV2_POLARITY");
        let mut tested_until = [0; 2];
        for event in events {
            let outputs = match event {
                Event::Sample { dt_us, acc, gyr, mag } => {
                    let time = Micros(desk.now_us.saturating_add_signed(dt_us));
                    desk.step_with(Ok(RawSample { time, acc, gyr, mag }))
                }
                Event::Honest => desk.step(),
                Event::Miss(fault) => desk.step_with(Err(fault)),
                Event::Order(command) => {
                    if desk.command(command).is_ok()
                        && let Command::TestPulse(axis, _) = command
                    {
                        tested_until[axis.index()] = desk.now_us + TEST_PULSE_US;
                    }
                    continue;
                }
                Event::Set(index, value) => {
                    let name = desk.flight.params().by_index(index).unwrap().0.name;
                    let _ = desk.flight.set_param(name, value);
                    continue;
                }
            };
            let snapshot = outputs;
            let params = desk.flight.params();
            let steered = params.axes();
            for axis in Axis::ALL {
                let pulse = outputs.pulses[axis.index()];
                if !steered.contains(&axis) {
                    prop_assert_eq!(pulse, PulseUs::NONE);
                    continue;
                }
                prop_assert!((853..=2193).contains(&pulse.0));
                let set_up = snapshot.state.is_idle()
                    && (params.polarity(axis) == Polarity::Watched
                        || desk.now_us <= tested_until[axis.index()]);
                if !snapshot.state.is_active() && !set_up {
                    prop_assert_eq!(pulse, Servo::new(params, axis).neutral_pulse());
                }
            }
            let q = snapshot.orientation.quaternion();
            prop_assert!([q.w, q.x, q.y, q.z].iter().all(|c| c.is_finite()));
        }
    }
}

/// An offset of 1 deg/s is off the rate when arming is allowed.
#[test]
fn the_gyros_offset_is_taken_off_when_the_drone_may_be_armed() {
    let mut desk = Desk::new(0.3);
    while desk.command(Command::Arm).is_err() {
        let mut sample = reading(desk.now_us, desk.pitch, 0.0);
        sample.gyr[1] += 16;
        desk.step_with(Ok(sample));
        assert!(desk.now_us < 6_000_000);
    }
    let attitude = desk.flight.attitude();
    assert!((attitude.bias[1].to_degrees() - 1.0).abs() < 0.02, "{attitude:?}");
    assert!(attitude.rate[1].abs() < 1e-3, "{attitude:?}");
}

/// A flipped bit of a burst's start: it would be newer than all that come after it.
#[test]
fn a_sample_that_is_yet_to_come_is_not_believed() {
    let mut desk = Desk::active(0.2);
    for bit in [10, 28, 63] {
        let mut sample = reading(desk.now_us, desk.pitch, desk.rate);
        sample.time = Micros(sample.time.0 | 1 << bit);
        let ahead = sample.time.0 > desk.now_us;
        let snapshot = desk.step_with(Ok(sample));
        assert_eq!(snapshot.fault, ahead.then_some(SensorFault::Late), "{bit}");
        desk.run(20);
        assert!(desk.flight.state().is_active(), "{bit}");
    }
}

/// Nothing would be too old any more.
#[test]
fn a_clock_that_jumps_back_ends_control() {
    for back_us in [100_000, 2_000_000] {
        let mut desk = Desk::active(0.2);
        desk.run(5);
        desk.now_us -= back_us;
        let snapshot = desk.step();
        assert_eq!(snapshot.state.kind(), crate::failsafe::StateKind::Failsafe);
        assert_eq!(snapshot.pulses[0], NEUTRAL);
    }
}

/// A propeller that touches its guard saturates the accelerometer on all axes.
#[test]
fn a_saturated_accelerometer_does_not_turn_the_attitude() {
    for (ms, at) in [(20, 30), (50, 5), (300, 1), (300, 150)] {
        let mut desk = Desk::active(0.4);
        desk.run(at);
        for step in 0..ms * 1_000 / PERIOD_US as usize {
            let full = [7_845, -7_845][step % 2];
            let sample =
                RawSample { acc: [full; 3], ..reading(desk.now_us, desk.pitch, desk.rate) };
            desk.step_with(Ok(sample));
        }
        let state = desk.run(150).state;
        let [_, pitch, _] = desk.flight.angles_rad();
        let off = f64::from(pitch) - desk.pitch;
        assert!(state.is_active() && off.abs() < 0.01, "{ms}, {at}: {off}");
        assert!(desk.pitch.abs() < 0.01, "{ms}, {at}: {}", desk.pitch);
    }
}
