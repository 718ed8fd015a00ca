//! Crank angle to servo pulse.
//!
//! `pulse = centre + direction * us_per_degree * (hold + angle)`, clamped to the command limits,
//! its change limited by the slew rate. Positive crank angles turn the rudder to positive angles,
//! which pitch the nose down.

use core::f32::consts::PI;

use tvc_pid::{Q16, Scalar};

use crate::axis::Axis;
use crate::config::{PULSE_MAX_US, PULSE_MIN_US};
use crate::params::{Fitting, Params};
use crate::store::Loaded;
use crate::words::words;

/// Width of a servo pulse in microseconds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct PulseUs(pub u16);

impl PulseUs {
    /// No pulse: the pin of an axis that is not steered.
    pub const NONE: Self = Self(0);
}

/// The pulses of rudders at rest: the centre and the holding angle, within the command limits.
/// [`PulseUs::NONE`] for an axis that is not steered.
///
/// This is the one safe output. Control falls back to it, and so do the watchdog, a failed
/// self-check and a fault.
pub fn neutral(params: &Params) -> [PulseUs; Axis::COUNT] {
    let axes = params.axes();
    Axis::ALL.map(|axis| {
        if axes.contains(&axis) { Servo::new(params, axis).neutral_pulse() } else { PulseUs::NONE }
    })
}

/// The pulses sent at power-on: [`neutral`]. If the stored parameters are lost, nobody knows which
/// axes the vehicle has. Then every axis gets a pulse, because a servo without a pulse stays where
/// it was when the chip was reset.
pub fn first_pulses(params: &Params, stored: Loaded) -> [PulseUs; Axis::COUNT] {
    match stored {
        Loaded::Corrupt => Axis::ALL.map(|axis| Servo::new(params, axis).neutral_pulse()),
        Loaded::Nothing | Loaded::Set { .. } => neutral(params),
    }
}

words! {
    /// The pulse that was commanded last.
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub struct Commanded {
        us: Q16,
    }
}

impl Commanded {
    /// A pulse at once, without slew and beyond the command limits: for those who look for them.
    pub fn now(pulse: PulseUs) -> Self {
        Self { us: Q16::from_bits(i32::from(pulse.0) << Q16::FRACTION) }
    }

    /// Rounded to the microsecond, and inside the hard range whatever came before.
    pub fn pulse(&self) -> PulseUs {
        rounded(self.us)
    }
}

/// The map from crank angle to pulse.
#[derive(Clone, Debug, PartialEq)]
pub struct Servo {
    neutral_us: Q16,
    us_per_rad: Q16,
    min_us: Q16,
    max_us: Q16,
    /// Largest change in a microsecond, us, times 2^32.
    slew_q32: u32,
}

impl Servo {
    /// An axis' servo.
    pub fn new(params: &Params, axis: Axis) -> Self {
        let Fitting { centre_us, hold_deg, direction, min_us, max_us } = params.fitting(axis);
        let us_per_deg = direction * params.srv_us_per_deg();
        let min_us = min_us.max(PULSE_MIN_US);
        let max_us = max_us.min(PULSE_MAX_US);
        let neutral_us = centre_us + us_per_deg * hold_deg;
        let neutral_us = neutral_us.max(min_us).min(max_us).into();
        Self {
            neutral_us,
            us_per_rad: (us_per_deg * (180.0 / PI)).into(),
            min_us: min_us.into(),
            max_us: max_us.into(),
            slew_q32: (params.srv_slew_us_s() * (4_294_967_296.0 / 1.0e6)) as u32,
        }
    }

    /// The pulse for a crank angle (rad), `dt_us` after the last one.
    pub fn command(&self, last: Commanded, crank: Q16, dt_us: u32) -> Commanded {
        let wanted = self.neutral_us + self.us_per_rad * crank;
        let step = (u64::from(self.slew_q32) * u64::from(dt_us)) >> 16;
        let step = Q16::from_bits(step.min(i32::MAX as u64) as i32);
        let us = wanted.clamped(self.min_us, self.max_us).clamped(last.us - step, last.us + step);
        Commanded { us }
    }

    /// Neutral rudder at once, without slew: the safe output.
    pub fn neutral(&self) -> Commanded {
        Commanded { us: self.neutral_us }
    }

    /// What [`neutral`] gives for the parameters in use.
    pub fn neutral_pulse(&self) -> PulseUs {
        rounded(self.neutral_us)
    }

    /// The crank angle at which the command limit cuts in, the nearer of the two sides.
    pub fn travel_rad(&self) -> f32 {
        let travel_us = (self.max_us - self.neutral_us).min(self.neutral_us - self.min_us);
        f32::from(travel_us) / f32::from(self.us_per_rad).abs()
    }
}

fn rounded(us: Q16) -> PulseUs {
    const LEAST: i32 = (PULSE_MIN_US as i32) << Q16::FRACTION;
    const MOST: i32 = (PULSE_MAX_US as i32) << Q16::FRACTION;
    let us = us.to_bits().clamp(LEAST, MOST);
    PulseUs(((us + (1 << (Q16::FRACTION - 1))) >> Q16::FRACTION) as u16)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const SECOND_US: u32 = 1_000_000;

    fn servo(changes: &[(&str, f32)]) -> Running {
        let mut params = Params::default();
        for (name, value) in changes {
            params.set(name, *value).unwrap();
        }
        Running::new(&params, Axis::Pitch)
    }

    struct Running {
        servo: Servo,
        last: Commanded,
    }

    impl Running {
        fn new(params: &Params, axis: Axis) -> Self {
            let servo = Servo::new(params, axis);
            let last = servo.neutral();
            Self { servo, last }
        }

        fn command(&mut self, crank: Q16, dt_us: u32) -> PulseUs {
            self.last = self.servo.command(self.last, crank, dt_us);
            self.last.pulse()
        }

        fn neutral(&mut self) -> PulseUs {
            self.last = self.servo.neutral();
            self.last.pulse()
        }
    }

    #[test]
    fn neutral_is_the_trimmed_centre() {
        assert_eq!(servo(&[]).neutral(), PulseUs(1524));
        assert_eq!(servo(&[("SRV_CENTRE_US", 1500.2)]).neutral(), PulseUs(1500));
    }

    #[test]
    fn neutral_is_where_the_drone_is_held_against_its_lateral_offset() {
        assert_eq!(servo(&[("SRV_HOLD_DEG", 3.0)]).neutral(), PulseUs(1554));
        let mut reversed = servo(&[("SRV_HOLD_DEG", 3.0), ("SRV_DIR", -1.0)]);
        assert_eq!(reversed.neutral(), PulseUs(1494));
        assert_eq!(reversed.command(0.0.into(), SECOND_US), PulseUs(1494));
        assert_eq!(reversed.command(10.0_f32.to_radians().into(), SECOND_US), PulseUs(1394));
    }

    /// The pulse of a crash and of the time before the first step is the one that the flight rests
    /// at.
    #[test]
    fn there_is_one_neutral_pulse() {
        for (hold, expected) in [(-10.0, 1424), (0.0, 1524), (3.0, 1554)] {
            let mut params = Params::default();
            params.set("SRV_HOLD_DEG", hold).unwrap();
            let mut servo = Running::new(&params, Axis::Pitch);
            servo.command(0.3.into(), SECOND_US);
            assert_eq!(neutral(&params), [PulseUs(expected), PulseUs::NONE]);
            assert_eq!(servo.servo.neutral_pulse(), PulseUs(expected));
            assert_eq!(servo.neutral(), PulseUs(expected));
        }
    }

    #[test]
    fn each_servo_has_its_own_fitting() {
        let mut params = Params::default();
        for (name, value) in [
            ("AXES", 2.0),
            ("SRV2_CENTRE_US", 1500.0),
            ("SRV2_DIR", -1.0),
            ("SRV2_HOLD_DEG", 2.0),
            ("SRV2_MAX_US", 1800.0),
        ] {
            params.set(name, value).unwrap();
        }
        assert_eq!(neutral(&params), [PulseUs(1524), PulseUs(1480)]);
        let of_one_axis = Params::default();
        let first = |stored| first_pulses(&of_one_axis, stored);
        assert_eq!(first(Loaded::Nothing), [PulseUs(1524), PulseUs::NONE]);
        assert_eq!(first(Loaded::Corrupt), [PulseUs(1524); 2]);
        let pulse = |axis, crank: f32| {
            let mut servo = Running::new(&params, axis);
            servo.command(crank.into(), SECOND_US)
        };
        // 0.1 rad are 57.3 us.
        assert_eq!(pulse(Axis::Pitch, 0.1), PulseUs(1581));
        assert_eq!(pulse(Axis::Roll, 0.1), PulseUs(1423));
        assert_eq!(pulse(Axis::Roll, -1.0), PulseUs(1800));
    }

    #[test]
    fn no_holding_angle_leaves_the_limits() {
        for hold in [-10.0, 10.0] {
            let mut servo = servo(&[
                ("SRV_HOLD_DEG", hold),
                ("SRV_US_PER_DEG", 20.0),
                ("SRV_MIN_US", 1400.0),
                ("SRV_MAX_US", 1640.0),
            ]);
            assert!((1400..=1640).contains(&servo.neutral().0));
            assert!(servo.servo.travel_rad() >= 0.0);
        }
    }

    #[test]
    fn a_pulse_that_is_tried_passes_the_command_limits_and_no_others() {
        assert_eq!(Commanded::now(PulseUs(900)).pulse(), PulseUs(900));
        assert_eq!(Commanded::now(PulseUs(500)).pulse(), PulseUs(853));
    }

    #[test]
    fn ten_degrees_are_a_hundred_microseconds_in_the_servos_direction() {
        let angle = 10.0_f32.to_radians();
        assert_eq!(servo(&[]).command(angle.into(), SECOND_US), PulseUs(1624));
        assert_eq!(servo(&[]).command((-angle).into(), SECOND_US), PulseUs(1424));
        assert_eq!(servo(&[("SRV_DIR", -1.0)]).command(angle.into(), SECOND_US), PulseUs(1424));
        assert_eq!(
            servo(&[("SRV_US_PER_DEG", 8.0)]).command(angle.into(), SECOND_US),
            PulseUs(1604)
        );
    }

    #[test]
    fn the_pulse_moves_no_faster_than_the_slew_rate() {
        let mut servo = servo(&[]);
        assert_eq!(servo.command(1.0.into(), 10_000), PulseUs(1624));
        assert_eq!(servo.command(1.0.into(), 10_000), PulseUs(1724));
        assert_eq!(servo.command((-1.0).into(), 20_000), PulseUs(1524));
        assert_eq!(servo.command(1.0.into(), 0), PulseUs(1524));
    }

    #[test]
    fn neutral_does_not_wait_for_the_slew_rate() {
        let mut servo = servo(&[]);
        servo.command(1.0.into(), SECOND_US);
        assert_eq!(servo.neutral(), PulseUs(1524));
    }

    #[test]
    fn travel_is_sixty_degrees_by_default() {
        assert!((servo(&[]).servo.travel_rad() - 60.0_f32.to_radians()).abs() < 1e-5);
    }

    proptest! {
        #[test]
        fn no_angle_and_no_parameter_leaves_the_limits(
            angle in proptest::num::f32::ANY,
            dt_us in 0_u32..10_000_000,
            min in 853.0_f32..=1400.0,
            max in 1640.0_f32..=2193.0,
            centre in 1420.0_f32..=1620.0,
            direction in prop_oneof![Just(-1.0_f32), Just(1.0)],
        ) {
            let mut servo = servo(&[
                ("SRV_MIN_US", min), ("SRV_MAX_US", max), ("SRV_CENTRE_US", centre), ("SRV_DIR", direction),
            ]);
            let pulse = f32::from(servo.command(angle.into(), dt_us).0);
            prop_assert!(pulse >= min - 0.5 && pulse <= max + 0.5);
        }
    }
}
