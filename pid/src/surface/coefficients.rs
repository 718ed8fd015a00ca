//! The configuration of a surface as factors of a sample.

use super::{HISTORY, SurfaceConfig};
use crate::config::{ConfigError, LARGEST, PERIOD_S, in_range};
use crate::scalar::Scalar;

/// Points where straight lines touch `x^(2/3)`, each twice as far as the last, and the power there.
/// A table, because the chip has no time for powers between two samples.
const TOUCHES: [(f32, f32); 6] = [
    (0.02, 0.073_680_63),
    (0.04, 0.116_960_704),
    (0.08, 0.185_663_55),
    (0.16, 0.294_722_52),
    (0.32, 0.467_842_82),
    (0.64, 0.742_654_2),
];

/// Longest sample period, s.
const MOST_PERIOD_S: f32 = 0.1;

/// Longest time ahead of an output's effect, s: with three sample periods below a second.
const MOST_AHEAD_S: f32 = 0.6;

/// Largest change of the disturbance per innovation of the rate.
const MOST_TRIM: f32 = 0.999;

/// Change of the gain's excess by an innovation as large as what the largest output changes the
/// rate by in a sample, and the share of that change from which on it counts.
const LEARN: f32 = 0.09;
const LEARN_FROM: f32 = 0.045;

/// The factors of a sample.
#[derive(Clone, Debug, Default)]
pub(super) struct Coefficients<T: Scalar> {
    /// s; below 1.
    pub(super) period: T::Share,
    /// Change of the rate in a sample per output.
    pub(super) rate_step: T,
    /// Samples to an output's effect: whole samples, and the rest.
    pub(super) effect: u8,
    pub(super) effect_rest: T::Share,
    /// Samples from the whole samples' end to the evaluation of the surface.
    pub(super) rest: T,
    /// From a sample to the evaluation of the surface, s; below 1.
    pub(super) horizon: T::Share,
    /// In samples.
    pub(super) sensor_lag: T,
    /// The actuator over a sample, and over the rest.
    pub(super) sample: Steps<T>,
    pub(super) ahead: Steps<T>,
    pub(super) play: T,
    pub(super) gain: T,
    pub(super) lead_limit: T,
    pub(super) near: T,
    /// Where the line near the setpoint meets the tangents.
    pub(super) near_until: T,
    /// The tangents of the braking curve.
    pub(super) tangents: [Tangent<T>; TOUCHES.len()],
    /// Return time per position, and `gain / 2 S`, and the share of it that is `gain / 3 S`.
    pub(super) return_s: T,
    pub(super) return_gain: T,
    pub(super) way_share: T::Share,
    pub(super) rate_share: T::Share,
    pub(super) value_share: T::Share,
    pub(super) trim: T::Share,
    pub(super) trim_limit: T,
    pub(super) limit: T,
    /// Change of the gain's excess per innovation of the rate, and the change of the rate between
    /// two readings from which on it counts.
    pub(super) learn: T,
    pub(super) learn_from: T,
}

/// The actuator's coefficients for steps of one length.
#[derive(Clone, Debug, Default)]
pub(super) struct Steps<T: Scalar> {
    /// Share of the error for a step's wanted speed, and the largest movement.
    pub(super) loop_gain: T::Share,
    pub(super) most: T,
    /// Share of the way to the asked speed that it goes in a step.
    pub(super) lag_gain: T::Share,
}

/// A tangent of the braking curve.
#[derive(Clone, Debug, Default)]
pub(super) struct Tangent<T> {
    /// End of the range in which it is lower than the next tangents.
    pub(super) until: T,
    /// Its value at 0, and its slope.
    pub(super) at_zero: T,
    pub(super) slope: T,
}

impl<T: Scalar> Coefficients<T> {
    // Not inlined: who builds the law needs the stack for more.
    #[inline(never)]
    pub(super) fn new(config: &SurfaceConfig) -> Result<Self, ConfigError> {
        let period = config.period_s;
        in_range(period, *PERIOD_S.start(), MOST_PERIOD_S, "period_s")?;
        in_range(config.plant_gain, 1e-3, LARGEST, "plant_gain")?;
        in_range(config.actuator_rate, 1e-3, LARGEST, "actuator_rate")?;
        let most_effect = HISTORY as f32 * period * 0.999;
        // A table, because calls would take ten times the flash.
        for (value, most, name) in [
            (config.effect_s, most_effect, "effect_s"),
            (config.sensor_lag_s, 1.0, "sensor_lag_s"),
            (config.actuator_loop_s, 1000.0, "actuator_loop_s"),
            (config.actuator_lag_s, 1000.0, "actuator_lag_s"),
            (config.actuator_play, LARGEST, "actuator_play"),
            (config.ahead_s, (20.0 * period).min(MOST_AHEAD_S), "ahead_s"),
            (config.gain_s, LARGEST, "gain_s"),
            (config.lead_limit, LARGEST, "lead_limit"),
            (config.near_per_s, LARGEST, "near_per_s"),
            (config.curve, 100.0, "curve"),
            (config.rate_share, 1.0, "rate_share"),
            (config.value_share, 1.0, "value_share"),
            (config.trim_rad_s, 1000.0, "trim_rad_s"),
            (config.trim_limit, LARGEST, "trim_limit"),
            (config.limit, LARGEST, "limit"),
        ] {
            in_range(value, 0.0, most, name)?;
        }
        let (effect, effect_rest) = T::from(config.effect_s / period).split();
        let horizon_s = config.effect_s + config.ahead_s;
        let rest = (horizon_s / period - effect as f32).max(0.0);
        let full = (period * config.plant_gain * config.limit).max(1.0 / LARGEST);
        let steepness = config.curve * cube_root(config.plant_gain * config.actuator_rate);
        let tangents = TOUCHES.map(|(touch, power)| Tangent::new(touch, steepness * power));
        Ok(Self {
            period: period.into(),
            rate_step: (period * config.plant_gain).into(),
            effect: effect as u8,
            effect_rest,
            rest: rest.into(),
            horizon: horizon_s.into(),
            sensor_lag: (config.sensor_lag_s / period).into(),
            sample: Steps::new(config, period),
            ahead: Steps::new(config, rest * period),
            play: config.actuator_play.into(),
            gain: config.gain_s.into(),
            lead_limit: config.lead_limit.into(),
            near: config.near_per_s.into(),
            near_until: meeting(&tangents, config.near_per_s).into(),
            tangents: tangents.map(|tangent| Tangent {
                until: tangent.until.into(),
                at_zero: tangent.at_zero.into(),
                slope: tangent.slope.into(),
            }),
            return_s: (1.0 / config.actuator_rate).into(),
            return_gain: (config.plant_gain / (2.0 * config.actuator_rate)).into(),
            way_share: (2.0 / 3.0).into(),
            rate_share: config.rate_share.into(),
            value_share: config.value_share.into(),
            trim: (config.rate_share * config.trim_rad_s / config.plant_gain).min(MOST_TRIM).into(),
            trim_limit: config.trim_limit.into(),
            limit: config.limit.into(),
            learn: (LEARN / full).min(LARGEST).into(),
            learn_from: (LEARN_FROM * full).into(),
        })
    }

    pub(super) fn within_play(&self, position: T, actuator: T) -> T {
        position.clamped(actuator - self.play, actuator + self.play)
    }

    /// The wanted rate of approach from `x`, with its sign turned.
    pub(super) fn surface(&self, x: T) -> T {
        let size = if x < T::ZERO { -x } else { x };
        let rate = if size < self.near_until {
            self.near * size
        } else {
            let [near_ones @ .., farthest] = &self.tangents;
            let nearest = near_ones.iter().find(|tangent| size < tangent.until);
            let tangent = nearest.unwrap_or(farthest);
            tangent.at_zero + tangent.slope * size
        };
        if x < T::ZERO { -rate } else { rate }
    }
}

impl<T: Scalar> Steps<T> {
    /// The actuator's coefficients from the length of a step and the period of its speed, s.
    pub(super) fn new(config: &SurfaceConfig, step_s: f32) -> Self {
        Self {
            loop_gain: (step_s / config.actuator_loop_s.max(step_s).max(1e-6)).into(),
            most: (step_s * config.actuator_rate).into(),
            lag_gain: (step_s / (step_s + config.actuator_lag_s).max(1e-6)).into(),
        }
    }

    /// The actuator over a step; its speed is in output per step.
    #[inline]
    pub(super) fn turn(&self, target: T, actuator: &mut T, speed: &mut T) {
        let asked = (target - *actuator).times(self.loop_gain).clamped(-self.most, self.most);
        *speed = *speed + (asked - *speed).times(self.lag_gain);
        *actuator = *actuator + *speed;
    }
}

impl Tangent<f32> {
    /// The tangent of a curve along `x^(2/3)` at `touch`, where the curve is `rate`:
    /// `rate (1/3 + 2/3 x / touch)`. It meets the tangent at twice the distance at
    /// `x / touch = (c - 1) / (2 - c)` with `c = 2^(2/3)`.
    fn new(touch: f32, rate: f32) -> Self {
        const MEETING: f32 = 1.423_661;
        let at_zero = rate / 3.0;
        Self { until: MEETING * touch, at_zero, slope: 2.0 * at_zero / touch }
    }
}

/// The point where a line of this slope through zero meets the lowest tangent: its nearest
/// intersection with a tangent.
fn meeting(tangents: &[Tangent<f32>], slope: f32) -> f32 {
    let steeper = tangents.iter().filter(|tangent| slope > tangent.slope);
    steeper.map(|tangent| tangent.at_zero / (slope - tangent.slope)).fold(LARGEST, f32::min)
}

/// The cube root of a positive number, by Newton's method. A third of the bits, with the exponent's
/// offset restored, is at most 4 % off. Two steps reach 1e-5, and a third the scalar's resolution.
fn cube_root(number: f32) -> f32 {
    const OFFSET: u32 = 0x2a51_37a0;
    let mut root = f32::from_bits(number.to_bits() / 3 + OFFSET);
    for _ in 0..3 {
        root -= (root - number / (root * root)) / 3.0;
    }
    root
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn powers_and_roots_are_those_of_the_host() {
        for (touch, power) in TOUCHES {
            assert_eq!(power, f64::from(touch).powf(2.0 / 3.0) as f32, "{touch}");
        }
        for number in [1e-6, 1e-3, 0.7, 1.0, 173.8, 2e4, LARGEST * LARGEST] {
            let exact = f64::from(number).cbrt();
            let relative = (f64::from(cube_root(number)) / exact - 1.0).abs();
            assert!(relative < 3e-7, "{number}: {relative}");
        }
    }
}
