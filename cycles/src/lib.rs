//! The control laws of `tvc-pid` as they are measured: one configuration and one code for the image
//! and for the host, so that whoever runs the image can hold each of its outputs to the host's.

#![no_std]

use tvc_pid::{
    Config, Controller, Derivative, Gains, Pd, Pid, Q16, Reading, Scalar, Surface, SurfaceConfig,
};

/// Time between two updates, s: three in a frame of the servo, as the firmware has them.
pub const PERIOD_S: f32 = 6_667.0e-6;

// An analog servo of the S3003 class and the gains that the firmware has for it by default.
const KP: f32 = 1.9;
const KD: f32 = 0.435;
/// 60 deg.
const LIMIT: f32 = 1.047;

/// A PID's configuration. The firmware's integral gain is 0; here there is one, so that what it
/// costs is measured.
pub fn pid() -> Config {
    Config {
        gains: Gains { kp: KP, ki: 0.5, kd: KD },
        derivative: Derivative::Rate,
        limit: -LIMIT..=LIMIT,
        ..Config::new(PERIOD_S)
    }
}

/// Configuration of a switching surface, for the same servo.
pub fn surface() -> SurfaceConfig {
    SurfaceConfig {
        period_s: PERIOD_S,
        plant_gain: 31.6,
        // A tick's lead of 5620 us, and a pulse in the middle.
        effect_s: 7_143.6e-6,
        sensor_lag_s: 3.4e-3,
        actuator_rate: 5.5,
        actuator_loop_s: 0.03025,
        actuator_lag_s: 0.01175,
        actuator_play: 0.00256,
        ahead_s: 0.03714,
        gain_s: 0.4751,
        lead_limit: 0.1944,
        near_per_s: 11.0,
        curve: 0.8586,
        rate_share: 0.99,
        value_share: 0.6675,
        trim_rad_s: 1.384,
        trim_limit: 0.25,
        limit: LIMIT,
    }
}

/// What an update is given, as it lies in memory. Numbers are the words of the law's scalar
/// ([`Number`]); any bits are valid.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Input {
    /// Setpoint, rad.
    pub setpoint: u32,
    /// Measured value, rad.
    pub value: u32,
    /// Its rate, rad/s.
    pub rate: u32,
    /// Age of the rate, updates.
    pub age: u32,
    /// By how much the value is younger, updates.
    pub value_lead: u32,
    /// 0 where the rate repeats that of the update before, so that it has no age. No number.
    pub is_new: u32,
    /// 0 where the output is not sent to the actuator. No number.
    pub is_sent: u32,
}

impl Input {
    /// Its words, in the order of memory.
    pub fn words(&self) -> [u32; 7] {
        [self.setpoint, self.value, self.rate, self.age, self.value_lead, self.is_new, self.is_sent]
    }
}

/// A scalar that fills a word.
pub trait Number: Scalar {
    /// From its bits.
    fn from_word(word: u32) -> Self;

    /// Its bits.
    fn to_word(self) -> u32;
}

impl Number for f32 {
    #[inline(always)]
    fn from_word(word: u32) -> Self {
        Self::from_bits(word)
    }

    #[inline(always)]
    fn to_word(self) -> u32 {
        self.to_bits()
    }
}

impl Number for Q16 {
    #[inline(always)]
    fn from_word(word: u32) -> Self {
        Self::from_bits(word as i32)
    }

    #[inline(always)]
    fn to_word(self) -> u32 {
        self.to_bits() as u32
    }
}

/// A control law with an update.
pub trait Law {
    /// The law at rest, with the configuration of this page.
    fn new() -> Self
    where
        Self: Sized;

    /// One update: from a reading in memory to the word of an output.
    fn update(&mut self, input: &Input) -> u32;
}

impl<T: Number> Law for Pd<T> {
    fn new() -> Self {
        Self { kp: KP.into(), kd: KD.into() }
    }

    #[inline(always)]
    fn update(&mut self, input: &Input) -> u32 {
        let [setpoint, value, rate] = numbers(input);
        Pd::update(self, setpoint, value, rate).to_word()
    }
}

impl<T: Number> Law for Controller<T, Pid<T>> {
    fn new() -> Self {
        Self::new(&pid()).expect("the configuration is valid")
    }

    #[inline(always)]
    fn update(&mut self, input: &Input) -> u32 {
        let [setpoint, value, rate] = numbers(input);
        Controller::update(self, setpoint, value, rate).to_word()
    }
}

impl<T: Number> Law for Controller<T, Surface<T>> {
    fn new() -> Self {
        Self::new(&surface()).expect("the configuration is valid")
    }

    #[inline(always)]
    fn update(&mut self, input: &Input) -> u32 {
        let [setpoint, value, rate] = numbers(input);
        let reading = Reading {
            value,
            rate,
            age: (input.is_new != 0).then_some(T::from_word(input.age)),
            value_lead: T::from_word(input.value_lead),
        };
        self.read(setpoint, &reading, input.is_sent != 0).to_word()
    }
}

/// Setpoint, value and rate.
#[inline(always)]
fn numbers<T: Number>(input: &Input) -> [T; 3] {
    [input.setpoint, input.value, input.rate].map(T::from_word)
}
