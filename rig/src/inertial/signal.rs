//! The signal path of the sensors from physical quantities to a sample: errors, noise, range,
//! bandwidth.

use super::imperfections::ImuErrors;
use super::magnetometer::{Magnetometer, MagnetometerHealth};
use super::replay::Playback;
use rand::Rng;
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use samd21::board::Ticks;
use std::collections::VecDeque;

/// Temperature at which [`ImuErrors`] gives the offsets, deg C (data sheet table 0-2).
const REFERENCE_C: f64 = 25.0;
/// Correlation time of the gyroscope's bias instability, s (estimate).
const BIAS_CORRELATION_S: f64 = 100.0;
/// Range of the magnetometer in x, y and z, uT (data sheet table 0-2).
const MAG_RANGE_UT: [f64; 3] = [1300.0, 1300.0, 2500.0];

/// Standard gravity, m/s^2: the chip's 1 g.
pub(crate) const STANDARD_GRAVITY_M_S2: f64 = 9.80665;

/// One refresh of the sensors, in SI units along the package axes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Sample {
    pub(crate) acc_m_s2: [f64; 3],
    pub(crate) gyr_rad_s: [f64; 3],
    pub(crate) mag_ut: [f64; 3],
    pub(crate) attitude: [f64; 4],
}

/// The physical quantities at the sensor, along the axes printed on its package.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stimulus {
    /// Specific force, m/s^2: at rest 9.81 along the axis that points up.
    pub specific_force_m_s2: [f64; 3],
    /// Angular rate, rad/s.
    pub rate_rad_s: [f64; 3],
    /// Magnetic field, uT.
    pub field_ut: [f64; 3],
    /// Attitude `[w, x, y, z]`, sensor to east-north-up with magnetic north; only the fusion modes
    /// show it.
    pub attitude: [f64; 4],
}

impl Stimulus {
    /// At rest, level, z up, in a field of 50 uT with 70 degrees of dip, facing east.
    pub const REST: Self = Self {
        specific_force_m_s2: [0.0, 0.0, 9.81],
        rate_rad_s: [0.0; 3],
        field_ut: [0.0, 17.101, -46.985],
        attitude: [1.0, 0.0, 0.0, 0.0],
    };
}

/// Ranges and bandwidths in force, decoded from page 1 or chosen by the chip's fusion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Settings {
    pub(crate) acc_range_g: f64,
    pub(crate) acc_bandwidth_hz: f64,
    pub(crate) gyr_range_dps: f64,
    pub(crate) gyr_bandwidth_hz: f64,
    pub(crate) mag_rate_hz: f64,
}

/// The three sensors up to their analogue-to-digital converters and filters.
#[derive(Clone, Debug)]
pub(crate) struct SignalChain {
    pub(crate) errors: ImuErrors,
    turn_on_bias_rad_s: [f64; 3],
    wandering_rad_s: [f64; 3],
    noise: ChaCha8Rng,
    filtered: Option<Sample>,
    pub(crate) magnetometer: Magnetometer,
    /// Fields of the last while, where the magnetometer gives old ones, uT; the oldest first.
    fields: VecDeque<(Ticks, [f64; 3])>,
    /// The first conversion since power-on, uT.
    first_mag: Option<[f64; 3]>,
    mag_latched: Option<[f64; 3]>,
    next_mag: f64,
    last_sense: Ticks,
    /// From this moment on the gyroscope's bias about y grows, by rad/s a second.
    pub(crate) ramp: Option<(Ticks, f64)>,
    pub(crate) playback: Option<Playback>,
}

impl SignalChain {
    pub(crate) fn new(errors: ImuErrors, unit: &mut ChaCha8Rng, noise: ChaCha8Rng) -> Self {
        let drawn = [(); 3].map(|()| unit.random_range(-1.0..1.0_f64).to_radians());
        Self {
            errors,
            turn_on_bias_rad_s: errors.gyro_bias_rad_s.unwrap_or(drawn),
            wandering_rad_s: [0.0; 3],
            noise,
            filtered: None,
            magnetometer: Magnetometer::default(),
            fields: VecDeque::new(),
            first_mag: None,
            mag_latched: None,
            next_mag: 0.0,
            last_sense: Ticks::ZERO,
            ramp: None,
            playback: None,
        }
    }

    /// The chip's temperature, deg C.
    pub(crate) fn temperature_c(&self) -> f64 {
        self.errors.warm_up.at(self.last_sense)
    }

    /// The gyroscope's bias now, rad/s.
    pub(crate) fn gyro_bias_rad_s(&self) -> [f64; 3] {
        let mut drift = self.drift(self.errors.gyro_drift_rad_s_k);
        if let Some((from, rad_s2)) = self.ramp {
            drift[1] += rad_s2 * self.last_sense.saturating_sub(from).as_secs_f64();
        }
        add(add(self.turn_on_bias_rad_s, self.wandering_rad_s), drift)
    }

    /// The accelerometer's offset now, m/s^2.
    pub(crate) fn acc_offset_m_s2(&self) -> [f64; 3] {
        add(self.errors.acc_offset_m_s2, self.drift(self.errors.acc_drift_m_s2_k))
    }

    /// The change at the present temperature of a quantity that changes by `per_k` for each K.
    fn drift(&self, per_k: [f64; 3]) -> [f64; 3] {
        let above = self.temperature_c() - REFERENCE_C;
        per_k.map(|change| change * above)
    }

    /// Forgets the filters' state, as a change of mode does; the bias stays.
    pub(crate) fn restart(&mut self) {
        self.filtered = None;
        self.mag_latched = None;
    }

    /// Feeds the converters with the truth since the last call.
    pub(crate) fn sense(&mut self, now: Ticks, truth: &Stimulus, settings: &Settings) {
        let dt = now.saturating_sub(self.last_sense).as_secs_f64();
        self.last_sense = now;
        if dt <= 0.0 || self.playback.is_some() {
            return;
        }
        self.wander(dt);
        let e = self.errors;
        let root = (0.5 / dt).sqrt();
        let gyr_range = settings.gyr_range_dps.to_radians();
        let acc_range = settings.acc_range_g * STANDARD_GRAVITY_M_S2;
        let (bias, offset) = (self.gyro_bias_rad_s(), self.acc_offset_m_s2());
        let pressed_g = truth.specific_force_m_s2[2] / STANDARD_GRAVITY_M_S2;
        let gyr_rad_s = [0, 1, 2].map(|axis| {
            let noise = root * e.gyro_noise_density * self.normal(e.gyro_noise_density);
            let rate = truth.rate_rad_s[axis] * (1.0 + e.gyro_scale[axis]);
            let bias = bias[axis] + e.gyro_per_g_rad_s[axis] * pressed_g;
            let rate = rate + bias + noise;
            rate.clamp(-gyr_range, gyr_range)
        });
        let acc_m_s2 = [0, 1, 2].map(|axis| {
            let noise = root * e.acc_noise_density * self.normal(e.acc_noise_density);
            let force = truth.specific_force_m_s2[axis] * (1.0 + e.acc_scale[axis]);
            (force + offset[axis] + noise).clamp(-acc_range, acc_range)
        });
        let input = Sample {
            acc_m_s2,
            gyr_rad_s,
            mag_ut: add(apply(&e.soft_iron, truth.field_ut), e.hard_iron_ut),
            attitude: truth.attitude,
        };
        self.remember(now, input.mag_ut);
        let Some(filtered) = &mut self.filtered else {
            self.filtered = Some(input);
            return;
        };
        // The exact response of a first-order low-pass to an input that is constant over dt.
        let gain = |hz: f64| 1.0 - (-core::f64::consts::TAU * hz * dt).exp();
        let (gyr, acc) = (gain(settings.gyr_bandwidth_hz), gain(settings.acc_bandwidth_hz));
        for axis in 0..3 {
            let f = &mut filtered.gyr_rad_s[axis];
            *f += gyr * (input.gyr_rad_s[axis] - *f);
            let f = &mut filtered.acc_m_s2[axis];
            *f += acc * (input.acc_m_s2[axis] - *f);
        }
        filtered.mag_ut = input.mag_ut;
        filtered.attitude = input.attitude;
    }

    /// True if a refresh at this time collects a new conversion of the magnetometer, which has the
    /// chip's clock and a phase of its own.
    pub(crate) fn mag_is_due(&self, at: Ticks) -> bool {
        at.as_secs_f64() >= self.next_mag || self.mag_latched.is_none()
    }

    /// The sample that the chip's processor collects at a refresh of all sensors; `None` before
    /// anything was sensed.
    pub(crate) fn refresh(&mut self, at: Ticks, settings: &Settings) -> Option<Sample> {
        let seconds = at.as_secs_f64();
        let mag_due = self.mag_is_due(at);
        if mag_due {
            let period = 1.0 / settings.mag_rate_hz;
            self.next_mag = if seconds < self.next_mag + period {
                self.next_mag + period
            } else {
                seconds + period
            };
        }
        self.sample(at, mag_due)
    }

    /// As [`SignalChain::refresh`], with a new conversion of the magnetometer only if it is due.
    pub(crate) fn sample(&mut self, at: Ticks, mag_due: bool) -> Option<Sample> {
        let mut sample = match &mut self.playback {
            Some(playback) => playback.refresh(at, mag_due),
            None => self.filtered?,
        };
        if mag_due {
            if self.playback.is_none() {
                sample.mag_ut = self.old_field(at).unwrap_or(sample.mag_ut);
                for (axis, range) in MAG_RANGE_UT.iter().enumerate() {
                    let noise = self.errors.mag_noise_ut * self.normal(self.errors.mag_noise_ut);
                    sample.mag_ut[axis] = (sample.mag_ut[axis] + noise).clamp(-range, *range);
                }
            }
            let first = *self.first_mag.get_or_insert(sample.mag_ut);
            self.mag_latched = Some(match self.magnetometer.health {
                MagnetometerHealth::Ok => sample.mag_ut,
                MagnetometerHealth::Dead => [0.0; 3],
                MagnetometerHealth::Stuck => first,
            });
        }
        sample.mag_ut = self.mag_latched.unwrap_or_default();
        Some(sample)
    }

    /// Keeps a field, uT, for as long as conversions can ask for it.
    fn remember(&mut self, now: Ticks, field_ut: [f64; 3]) {
        let age = self.magnetometer.age;
        if age == Ticks::ZERO {
            return;
        }
        while self.fields.get(1).is_some_and(|(at, _)| *at + age <= now) {
            self.fields.pop_front();
        }
        self.fields.push_back((now, field_ut));
    }

    /// The field that a conversion at this time gives, uT, where the magnetometer gives old ones.
    fn old_field(&self, at: Ticks) -> Option<[f64; 3]> {
        let age = self.magnetometer.age;
        let old = self.fields.iter().rev().find(|(then, _)| *then + age <= at);
        old.or(self.fields.front()).map(|(_, field_ut)| *field_ut)
    }

    /// Lets the gyroscope's bias wander: a first-order Gauss-Markov process.
    fn wander(&mut self, dt: f64) {
        let sigma = self.errors.gyro_instability_rad_s;
        if sigma == 0.0 {
            return;
        }
        let keep = (-dt / BIAS_CORRELATION_S).exp();
        let kick = sigma * (1.0 - keep * keep).sqrt();
        self.wandering_rad_s =
            self.wandering_rad_s.map(|old| keep * old + kick * self.normal(sigma));
    }

    /// A standard normal number; zero, and none drawn, where the factor it is for is zero.
    fn normal(&mut self, factor: f64) -> f64 {
        if factor == 0.0 { 0.0 } else { self.noise.sample(StandardNormal) }
    }
}

fn add(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

fn apply(m: &[[f64; 3]; 3], v: [f64; 3]) -> [f64; 3] {
    m.map(|row| row[0] * v[0] + row[1] * v[1] + row[2] * v[2])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inertial::WarmUp;
    use crate::random::{Stream, generator};

    fn chain(errors: ImuErrors) -> SignalChain {
        SignalChain::new(
            errors,
            &mut generator(1, Stream::SensorUnit),
            generator(1, Stream::SensorNoise),
        )
    }

    fn reset_settings() -> Settings {
        Settings {
            acc_range_g: 4.0,
            acc_bandwidth_hz: 62.5,
            gyr_range_dps: 2000.0,
            gyr_bandwidth_hz: 32.0,
            mag_rate_hz: 10.0,
        }
    }

    #[test]
    fn low_pass_reaches_63_percent_after_one_time_constant() {
        let mut chain = chain(ImuErrors::NONE);
        let settings = reset_settings();
        chain.sense(Ticks::from_us(500), &Stimulus::REST, &settings);
        let mut turning = Stimulus::REST;
        turning.rate_rad_s[1] = 1.0;
        // 32 Hz: 4.9736 ms. 10 steps of 500 us are 5 ms: 1 - exp(-5 / 4.9736) = 0.634.
        for i in 2..=11 {
            chain.sense(Ticks::from_us(500 * i), &turning, &settings);
        }
        let sample = chain.refresh(Ticks::from_us(5500), &settings).unwrap();
        assert!((sample.gyr_rad_s[1] - 0.634_05).abs() < 1e-4, "{sample:?}");
    }

    /// 20 K in the end at 0.015 deg/s/K: 0.3 deg/s, of which 63 % come within the time constant.
    #[test]
    fn a_chip_that_warms_up_drifts() {
        let mut chain = chain(ImuErrors {
            gyro_drift_rad_s_k: [0.015_f64.to_radians(), 0.0, 0.0],
            acc_drift_m_s2_k: [0.0, 0.0, -0.01],
            warm_up: WarmUp { from_c: 25.0, to_c: 45.0, time_constant_s: 10.0 },
            ..ImuErrors::NONE
        });
        let settings = reset_settings();
        let mut shown = |seconds: u64| {
            for ms in 0..1000 {
                let now = Ticks::from_ms(1000 * seconds + ms);
                chain.sense(now, &Stimulus::REST, &settings);
            }
            let sample = chain.refresh(Ticks::from_ms(1000 * seconds + 999), &settings);
            let sample = sample.unwrap();
            let rate_dps = sample.gyr_rad_s[0].to_degrees();
            (rate_dps, sample.acc_m_s2[2] - 9.81, chain.temperature_c())
        };
        let close = |a: f64, b: f64| assert!((a - b).abs() < 2e-3, "{a} {b}");
        let (rate, force, celsius) = shown(9);
        close(rate, 0.3 * 0.632);
        close(force, -0.2 * 0.632);
        assert!((celsius - 37.64).abs() < 0.01, "{celsius}");
        let (rate, _, celsius) = shown(100);
        close(rate, 0.3);
        assert!((celsius - 45.0).abs() < 0.01, "{celsius}");
    }

    #[test]
    fn noise_has_the_density_asked_for() {
        let mut chain = chain(ImuErrors {
            gyro_bias_rad_s: Some([0.0; 3]),
            gyro_instability_rad_s: 0.0,
            ..ImuErrors::default()
        });
        let settings = reset_settings();
        let (mut n, mut sum, mut squares) = (0.0, 0.0, 0.0);
        for i in 1..40_000 {
            let now = Ticks::from_us(500 * i);
            chain.sense(now, &Stimulus::REST, &settings);
            if i % 20 == 0 {
                let sample = chain.refresh(now, &settings).unwrap();
                let x = sample.gyr_rad_s[0].to_degrees();
                (n, sum, squares) = (n + 1.0, sum + x, squares + x * x);
            }
        }
        // The noise bandwidth of a first-order low-pass is pi/2 times its corner.
        let expected = 0.014 * (32.0 * core::f64::consts::FRAC_PI_2).sqrt();
        let mean: f64 = sum / n;
        let sigma = (squares / n - mean * mean).sqrt();
        assert!((sigma / expected - 1.0).abs() < 0.1, "{sigma} against {expected}");
        assert!(mean.abs() < 0.02, "{mean}");
    }
}
