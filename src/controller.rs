//! The control laws as the parameters configure them, for one axis each.
//!
//! Angles are the crank's, in servo radians from zero rudder. Positive ones turn the vehicle to
//! negative angles, so that the crank is the negative of what the laws put out.

use core::f32::consts::PI;

use tvc_pid::{
    AntiWindup, Cascade, CascadeConfig, Coefficients, Config, Derivative, Gains, Law as _, Pd, Pid,
    Q16, Reading, Scalar, Surface, SurfaceConfig, SurfaceState,
};

use crate::axis::Axis;
use crate::config::TRIM_LIMIT_RAD;
use crate::params::Params;
use crate::words::Words;

/// What control is given with a sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Tilt about the axis, rad: of pitch, nose up positive; of roll, right side down.
    pub angle: Q16,
    /// Rate about the axis, rad/s.
    pub rate: Q16,
    /// How long before the sample the rate was measured, us, but for the lag of the sensor's
    /// filter; `None` where it repeats that of the sample before.
    pub rate_age_us: Option<u32>,
    /// Time between two refreshes of the rates, us.
    pub refresh_us: u32,
    /// A pulse carries what comes out of this sample.
    pub is_carried: bool,
}

/// The list of the laws: `PID_LAW`, the law, and what makes its configuration of the parameters and
/// the travel.
macro_rules! laws {
    ($($(#[$about:meta])* $number:literal: $law:ident = $config:ident,)*) => {
        /// The laws that `PID_LAW` chooses from.
        #[derive(Clone, Debug)]
        enum Law {
            $($(#[$about])* $law($law<Q16>),)*
        }

        /// What the law of an axis remembers.
        #[derive(Clone, Debug)]
        pub enum LawState {
            $($(#[$about])* $law(<$law<Q16> as tvc_pid::Law<Q16>>::State),)*
        }

        impl Law {
            fn update(
                &self,
                state: &mut LawState,
                setpoint: Q16,
                reading: &Reading<Q16>,
                is_sent: bool,
            ) -> Q16 {
                match (self, state) {
                    $((Self::$law(law), LawState::$law(state)) => {
                        law.update(state, setpoint, reading, is_sent)
                    })*
                    _ => Q16::ZERO,
                }
            }

            fn coast(&self, state: &mut LawState, is_sent: bool) {
                match (self, state) {
                    $((Self::$law(law), LawState::$law(state)) => law.coast(state, is_sent),)*
                    _ => {}
                }
            }

            fn reset(&self, state: &mut LawState, setpoint: Q16) {
                match (self, &mut *state) {
                    $((Self::$law(law), LawState::$law(state)) => law.reset(state, setpoint),)*
                    $((Self::$law(law), _) => *state = LawState::$law(law.at_rest()),)*
                }
            }

            /// Takes over changed parameters, without a bump unless they choose another law.
            /// Parameters within their ranges always make a law, to which a test holds them; did
            /// they not, the old law would stay.
            fn configure(&mut self, state: &mut LawState, params: &Params, travel_rad: f32) {
                $(if is_law(params, $number) {
                    // Not inlined, so that the stack holds one law at a time.
                    #[inline(never)]
                    fn configure(
                        law: &mut Law,
                        state: &mut LawState,
                        config: &<$law<Q16> as tvc_pid::Law<Q16>>::Config,
                    ) {
                        if let (Law::$law(law), LawState::$law(state)) = (&mut *law, &mut *state) {
                            let _ = law.retune(state, config);
                        } else if let Ok(new) = $law::new(config) {
                            *state = LawState::$law(new.at_rest());
                            *law = Law::$law(new);
                        }
                    }
                    configure(self, state, &$config(params, travel_rad));
                })*
            }

            fn with(&self, gains: &Coefficients<Q16>) -> Self {
                let mut law = self.clone();
                match &mut law {
                    $(Self::$law(law) => law.set_gains(gains),)*
                }
                law
            }
        }

        impl LawState {
            /// Words of the largest state.
            pub(crate) const WORDS: usize = {
                let mut most = 0;
                $(
                    let words = <<$law<Q16> as tvc_pid::Law<Q16>>::State as Words>::WORDS;
                    if words > most {
                        most = words;
                    }
                )*
                most
            };

            /// Of the law that the parameters choose, whose crank rests at zero rudder.
            pub fn at_rest(params: &Params) -> Self {
                $(if is_law(params, $number) {
                    return Self::$law(Default::default());
                })*
                Self::default()
            }

            /// The plant's gain as the law estimates it, in those of `PITCH_GAIN`; 1 where it does
            /// not.
            pub(crate) fn plant_gain(&self) -> Q16 {
                match self {
                    Self::Surface(state) => state.plant_gain(),
                    _ => Q16::ONE,
                }
            }

            /// Shows the words, and zeros up to those of the largest state.
            pub(crate) fn tell(&self, each: &mut dyn FnMut(i32)) {
                let told = match self {
                    $(Self::$law(state) => {
                        state.tell(each);
                        words_of(state)
                    })*
                };
                (told..Self::WORDS).for_each(|_| each(0));
            }

            /// Takes over the words that a state of the same law [told](Self::tell).
            pub(crate) fn resume(&mut self, next: &mut dyn FnMut() -> i32) {
                let told = match self {
                    $(Self::$law(state) => {
                        *state = Words::told(next);
                        words_of(state)
                    })*
                };
                (told..Self::WORDS).for_each(|_| {
                    next();
                });
            }
        }
    };
}

laws! {
    /// Proportional, integral and derivative.
    0.0: Pid = pid,
    /// The switching surface.
    2.0: Surface = surface,
    /// A loop of the angle around one of the rate.
    3.0: Cascade = cascade,
}

/// Whether the parameters choose this law, by its bits: floats take a call.
fn is_law(params: &Params, number: f32) -> bool {
    params.pid_law().to_bits() == number.to_bits()
}

const fn words_of<V: Words>(_: &V) -> usize {
    V::WORDS
}

/// Control of an axis: what is measured becomes a crank angle.
#[derive(Clone, Debug)]
pub struct Controller {
    law: Law,
    shown: Pd<Q16>,
    /// rad.
    setpoint: Q16,
    travel: Q16,
    ticks_per_us: TicksPerUs,
}

impl Default for LawState {
    fn default() -> Self {
        Self::Surface(SurfaceState::default())
    }
}

impl Controller {
    /// A controller with commands up to `travel_rad` either side.
    // Not inlined: its parts are large, and who builds it needs the stack for more.
    #[inline(never)]
    pub fn new(params: &Params, axis: Axis, travel_rad: f32) -> Self {
        let mut controller = Self {
            law: Law::Surface(Surface::default()),
            shown: Pd::default(),
            setpoint: Q16::ZERO,
            travel: Q16::ZERO,
            ticks_per_us: TicksPerUs::new(params),
        };
        controller.configure(&mut LawState::default(), params, axis, travel_rad);
        controller
    }

    /// Take over changed parameters, without a bump unless they choose another law.
    pub fn configure(
        &mut self,
        state: &mut LawState,
        params: &Params,
        axis: Axis,
        travel_rad: f32,
    ) {
        self.setpoint = (params.setpoint_deg(axis) * (PI / 180.0)).into();
        self.travel = travel_rad.into();
        self.ticks_per_us = TicksPerUs::new(params);
        self.shown = Pd { kp: params.pid_kp().into(), kd: params.pid_kd().into() };
        self.law.configure(state, params, travel_rad);
    }

    /// One sample gives the crank angle (rad). `gains` are those of a schedule.
    pub fn update(
        &self,
        state: &mut LawState,
        sample: &Sample,
        gains: Option<&Coefficients<Q16>>,
    ) -> Q16 {
        let ticks_per_us = self.ticks_per_us;
        // The angle is the sum of the rates, each of which counts for a whole period: half of one
        // more than has passed.
        let reading = Reading {
            value: sample.angle,
            rate: sample.rate,
            age: sample.rate_age_us.map(|us| ticks_per_us.times(us)),
            value_lead: ticks_per_us.times(sample.refresh_us / 2),
        };
        let mut update = |law: &Law| law.update(state, self.setpoint, &reading, sample.is_carried);
        -match gains {
            None => update(&self.law),
            Some(gains) => update(&self.law.with(gains)),
        }
    }

    /// The crank angle (rad) that answers a tilt of a vehicle that is held, for somebody who looks
    /// which way the rudder turns: in proportion, as no law that knows the rudder's speed does it.
    pub fn show(&self, sample: &Sample) -> Q16 {
        let output = self.shown.update(self.setpoint, sample.angle, sample.rate);
        (-output).clamped(-self.travel, self.travel)
    }

    /// A sample is missing: the crank angle stays.
    pub fn coast(&self, state: &mut LawState, is_carried: bool) {
        self.law.coast(state, is_carried);
    }

    /// The drone is held or the rudder is neutral for another reason: start afresh.
    pub fn reset(&self, state: &mut LawState) {
        self.law.reset(state, self.setpoint);
    }
}

/// What a microsecond is of the time between two ticks, times 2^26.
#[derive(Clone, Copy, Debug)]
struct TicksPerUs(u32);

impl TicksPerUs {
    fn new(params: &Params) -> Self {
        Self((1 << 26) / params.control_period_us().max(1))
    }

    /// Microseconds, up to 0.4 s, as ticks.
    fn times(self, us: u32) -> Q16 {
        Q16::from_bits(((us.min(400_000) * self.0) >> 10) as i32)
    }
}

#[inline(never)]
fn period_s(params: &Params) -> f32 {
    params.control_period_us() as f32 * 1.0e-6
}

fn pid(params: &Params, travel_rad: f32) -> Config {
    Config { limit: -travel_rad..=travel_rad, ..pid_with(params, constant_gains(params)) }
}

/// A PID controller with these gains, and no limits of its own.
fn pid_with(params: &Params, gains: Gains) -> Config {
    Config { gains, derivative: Derivative::Rate, ..Config::new(period_s(params)) }
}

fn cascade(params: &Params, travel_rad: f32) -> CascadeConfig {
    CascadeConfig {
        angle_gain: params.cas_angle(),
        rate_limit: params.cas_rate(),
        rate: Config {
            limit: -travel_rad..=travel_rad,
            ..rate_loop(params, constant_gains(params))
        },
    }
}

/// The rate loop of the cascade. Its integral is that of the rate's error, which is an angle: its
/// gain is such that an angle's error counts as in a single loop.
fn rate_loop(params: &Params, gains: Gains) -> Config {
    Config {
        gains: Gains { kp: gains.kd, ki: gains.ki / params.cas_angle(), kd: 0.0 },
        anti_windup: AntiWindup::Conditional,
        ..Config::new(period_s(params))
    }
}

/// The gains where there is no schedule.
fn constant_gains(params: &Params) -> Gains {
    Gains { kp: params.pid_kp(), ki: params.pid_ki(), kd: params.pid_kd() }
}

/// The configuration, without limits, to which gains of the schedule belong in the law that the
/// parameters choose; `None` for laws whose gains are not scheduled.
#[cfg(feature = "free-flight")]
pub(crate) fn scheduled(params: &Params, gains: Gains) -> Option<Config> {
    if is_law(params, 0.0) {
        Some(pid_with(params, gains))
    } else {
        is_law(params, 3.0).then(|| rate_loop(params, gains))
    }
}

/// A pulse takes effect when it ends: the time of its sample before the edge, and the pulse at the
/// middle behind it. The rates are read some 3 ms after that time; flights overshoot as the model
/// does with those counted as delay.
fn surface(params: &Params, travel_rad: f32) -> SurfaceConfig {
    let period_s = period_s(params);
    let lead_us = params.timing().sample_lead_us() as f32;
    SurfaceConfig {
        period_s,
        plant_gain: params.pitch_gain(),
        effect_s: (lead_us + params.srv_centre_us()) * 1.0e-6,
        sensor_lag_s: params.sensor_kind().description().gyr_lag_s,
        actuator_rate: params.srv_rad_s(),
        actuator_loop_s: params.srv_loop_s(),
        actuator_lag_s: params.srv_motor_s(),
        actuator_play: params.srv_play_rad(),
        ahead_s: params.sfc_ahead_s(),
        gain_s: params.sfc_gain_s(),
        lead_limit: params.sfc_lead_rad(),
        near_per_s: params.sfc_near(),
        curve: params.sfc_curve(),
        rate_share: params.sfc_rate(),
        value_share: params.sfc_pitch(),
        trim_rad_s: params.pid_trim_rad_s(),
        trim_limit: TRIM_LIMIT_RAD,
        limit: travel_rad,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::params::{Range, TABLE};
    use proptest::prelude::*;

    fn sample(pitch_rad: f32, rate_rad_s: f32) -> Sample {
        Sample {
            angle: pitch_rad.into(),
            rate: rate_rad_s.into(),
            rate_age_us: Some(4_000),
            refresh_us: 10_000,
            is_carried: true,
        }
    }

    struct Running {
        controller: Controller,
        state: LawState,
    }

    fn running(params: &Params) -> Running {
        let controller = Controller::new(params, Axis::Pitch, 1.0);
        let state = LawState::at_rest(params);
        Running { controller, state }
    }

    impl Running {
        /// What it puts out, rad.
        fn updated(&mut self, pitch_rad: f32, rate_rad_s: f32) -> f32 {
            let sample = sample(pitch_rad, rate_rad_s);
            self.controller.update(&mut self.state, &sample, None).into()
        }

        fn configure(&mut self, params: &Params) {
            self.controller.configure(&mut self.state, params, Axis::Pitch, 1.0);
        }

        fn reset(&mut self) {
            self.controller.reset(&mut self.state);
        }
    }

    fn with_law(law: f32) -> Params {
        let mut params = Params::default();
        params.set("PID_LAW", law).unwrap();
        params
    }

    #[test]
    fn nose_up_and_rising_ask_for_positive_crank_angles() {
        for law in [0.0, 2.0, 3.0] {
            let mut controller = running(&with_law(law));
            assert!(controller.updated(0.1, 0.0) > 0.0);
            controller.reset();
            assert!(controller.updated(0.0, 0.5) > 0.0);
            controller.reset();
            assert_eq!(controller.updated(0.0, 0.0), 0.0);
        }
    }

    #[test]
    fn the_setpoint_is_where_the_crank_rests() {
        for law in [0.0, 2.0, 3.0] {
            let mut params = with_law(law);
            params.set("PITCH_SET_DEG", 10.0).unwrap();
            let mut controller = running(&params);
            let crank_rad = controller.updated(10.0_f32.to_radians(), 0.0);
            assert!(crank_rad.abs() < 1e-3, "{law}: {crank_rad}");
        }
    }

    #[test]
    fn microseconds_become_ticks() {
        let mut params = Params::default();
        for khz in [100.0, 400.0] {
            params.set("I2C_KHZ", khz).unwrap();
            let period_us = params.control_period_us() as f32;
            for us in [0, 1_000, 6_667, 10_000, 400_000, u32::MAX] {
                let ticks = f32::from(TicksPerUs::new(&params).times(us));
                let expected = us.min(400_000) as f32 / period_us;
                assert!((ticks - expected).abs() < 2e-4 * (1.0 + expected), "{us}: {ticks}");
            }
        }
    }

    #[test]
    fn another_law_begins_at_rest_and_other_gains_go_on() {
        let mut controller = running(&with_law(2.0));
        let crank_rad = controller.updated(0.3, 0.2);
        let mut params = with_law(2.0);
        params.set("SFC_NEAR", 20.0).unwrap();
        controller.configure(&params);
        assert!(controller.updated(0.3, 0.2) >= crank_rad);
        controller.configure(&with_law(0.0));
        assert_eq!(controller.updated(0.0, 0.0), 0.0);
    }

    proptest! {
        /// Whatever the parameters are within their ranges, they make a law.
        #[test]
        fn every_set_of_parameters_is_possible(
            shares in proptest::collection::vec(prop_oneof![Just(0.0_f32), Just(1.0), 0.0_f32..=1.0], TABLE.len()),
            travel_rad in 0.0_f32..2.0,
        ) {
            let mut params = Params::default();
            for (info, share) in TABLE.iter().zip(shares) {
                let value = match info.range {
                    Range::Between(low, high) => (low + share * (high - low)).min(high),
                    Range::OneOf(allowed) => allowed[0],
                };
                params.set(info.name, value).unwrap();
            }
            prop_assert!(Pid::<Q16>::new(&pid(&params, travel_rad)).is_ok());
            prop_assert!(Cascade::<Q16>::new(&cascade(&params, travel_rad)).is_ok());
            prop_assert!(Surface::<Q16>::new(&surface(&params, travel_rad)).is_ok());
        }
    }
}
