//! Proximate time-optimal control: a switching surface for an actuator of limited speed.

mod coefficients;
#[cfg(test)]
mod tests;

use crate::config::ConfigError;
use crate::law::{Law, Reading};
use crate::scalar::Scalar;
use crate::state::state;
use coefficients::Coefficients;

/// Samples that a [`Surface`] looks back: readings and outputs that have not taken effect may be
/// older than two periods.
const HISTORY: usize = 3;

/// Oldest first reading that is carried on to now, sample periods.
const MOST_AGE: f32 = 10.0;

/// Configuration of a [`Surface`]. "Output" is the unit of its output and of the actuator's
/// position, "value" that of what it controls.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceConfig {
    /// Sample period, s, up to 0.1.
    pub period_s: f32,
    /// Acceleration of the value per output, 1/s2, positive.
    pub plant_gain: f32,
    /// Time from a sample until the actuator takes its output for its target, s, up to two periods.
    pub effect_s: f32,
    /// Lag of the rate's sensor, s: its age beyond that of the reading.
    pub sensor_lag_s: f32,
    /// Greatest speed of the actuator, output per s.
    pub actuator_rate: f32,
    /// Time constant of the actuator's position loop, s: the speed that it asks for is the error
    /// over this.
    pub actuator_loop_s: f32,
    /// Lag of the actuator's speed, s.
    pub actuator_lag_s: f32,
    /// Play behind the actuator, either way, output.
    pub actuator_play: f32,
    /// How far beyond the output's effect the surface is looked at, s.
    pub ahead_s: f32,
    /// Output per deviation of the rate from the surface, s.
    pub gain_s: f32,
    /// Largest distance of the output from where the actuator will be, output.
    pub lead_limit: f32,
    /// Slope of the surface near the setpoint, 1/s.
    pub near_per_s: f32,
    /// Share of the time-optimal rate at which the value approaches.
    pub curve: f32,
    /// Share of a rate's innovation that the model takes over with each new reading, 0 to 1.
    pub rate_share: f32,
    /// The same of the value's.
    pub value_share: f32,
    /// Bandwidth of the disturbance's estimate, rad/s; 0 is no trim.
    pub trim_rad_s: f32,
    /// Largest disturbance that is estimated, output.
    pub trim_limit: f32,
    /// Largest output, either side.
    pub limit: f32,
}

/// Control of a plant `value'' = gain (position + disturbance)` by an actuator that is slow, lags,
/// has play, and takes a new target only now and then, with readings that are old by the time they
/// come: as fast as the actuator's speed allows, without overshoot.
///
/// **The surface.** An actuator at zero that may move with the speed `S` takes `t = sqrt(w / (gain
/// S))` to swing out and the same to swing back, which stops a rate `w` over a distance `w t`: from
/// a distance `x` the greatest rate that can still be stopped is `(gain S)^(1/3) x^(2/3)`. (For an
/// actuator without limit of speed it is the well-known square root. M. L. Workman, Adaptive
/// Proximate Time-Optimal Servomechanisms, 1987.) An actuator away from zero must come back first,
/// which moves value and rate by
///
/// ```text
/// time t = |p| / S,  rate: gain p |p| / 2 S,  value: rate0 t + gain p^3 / 3 S^2
/// ```
///
/// with `p` its position and the disturbance. The value after that is the distance, the rate after
/// that is compared with the curve. Near the setpoint the curve is a straight line, since its root
/// has no finite slope there; farther away six tangents stand for it, the lowest of which counts.
///
/// **The model.** Where the actuator is follows from what was sent to it and when that takes
/// effect; value and rate follow from where it was. They are those of now, although readings are
/// old: a reading is compared with what the model had at the reading's time, and the difference
/// moves present and past alike. The model runs ahead to when the next output takes effect, with
/// the outputs that are under way.
///
/// ```text
/// speed    = speed + a (clamp((target - actuator) / loop) - speed)       a = T / (lag + T)
/// actuator = actuator + T speed,  position = position within actuator +- play
/// rate, value: integrals of gain (position + disturbance), shifted by shares of the innovations
/// disturbance = disturbance + rate_share trim / gain * innovation of the rate
///
/// ahead, when the output takes effect and `ahead_s` later:
/// x = value - setpoint + rate |p| / S + gain p^3 / 3 S^2
/// r = min(near |x|, curve (gain S)^(1/3) |x|^(2/3)) sign(x)
/// u = position - clamp(gain_s (rate + gain p |p| / 2 S + r))
/// ```
///
/// The output is the actuator's position plus a distance, so that an actuator at rest on the
/// surface stays: that holds against a disturbance without an integral that could wind up. Limits
/// of the output, a plant that is held, and a tether's stop do not wind up the model either: its
/// rate and value follow the readings.
///
/// The default has no gains: its output is 0.
#[derive(Clone, Debug, Default)]
pub struct Surface<T: Scalar> {
    c: Coefficients<T>,
}

state! {
    /// What a [`Surface`] remembers.
    pub struct SurfaceState {
        /// The output of the last sample has been sent.
        is_sent: bool,
        /// There has been a reading.
        is_known: bool,
        /// The actuator by its model, its speed in output per sample, and the position behind its
        /// play.
        actuator: T,
        speed: T,
        position: T,
        /// What was sent to the actuator last.
        sent: T,
        /// Output of the last sample.
        output: T,
        disturbance: T,
        /// Targets of the actuator over the samples that follow each of the newest by the output's
        /// effect, the newest first.
        targets: [T; HISTORY],
        rate: Track<T>,
        value: Track<T>,
    }
}

state! {
    /// A number and its changes in the newest samples, the newest first; nothing before the first
    /// reading.
    struct Track {
        now: T,
        changes: [T; HISTORY],
    }
}

impl<T: Scalar> SurfaceState<T> {
    /// The estimated disturbance, in units of the output.
    pub fn disturbance(&self) -> T {
        self.disturbance
    }
}

/// Position of the actuator with the disturbance, and what they do to rate and value over some
/// samples: the sum of the positions, and the sum of those sums.
struct Path<T> {
    position: T,
    sum: T,
    sums: T,
}

impl<T: Scalar> Law<T> for Surface<T> {
    type Config = SurfaceConfig;
    type State = SurfaceState<T>;

    fn new(config: &SurfaceConfig) -> Result<Self, ConfigError> {
        Ok(Self {
            c: Coefficients::new(config)?,
        })
    }

    // A function of its own, so that it does not cost the caller its registers.
    #[inline(never)]
    fn update(
        &self,
        state: &mut SurfaceState<T>,
        setpoint: T,
        reading: &Reading<T>,
        is_sent: bool,
    ) -> T {
        self.advance(state);
        let error = reading.value - setpoint;
        if error.is_usable() && reading.rate.is_usable() {
            self.correct(state, reading);
            state.output = self.decide(state, setpoint);
        }
        state.is_sent = is_sent;
        state.output
    }

    fn coast(&self, state: &mut SurfaceState<T>, is_sent: bool) {
        self.advance(state);
        state.is_sent = is_sent;
    }

    /// The model keeps its state.
    fn retune(
        &mut self,
        _state: &mut SurfaceState<T>,
        config: &SurfaceConfig,
    ) -> Result<(), ConfigError> {
        *self = Self::new(config)?;
        Ok(())
    }
}

impl<T: Scalar> Surface<T> {
    /// The model over the sample that has passed.
    fn advance(&self, state: &mut SurfaceState<T>) {
        let before = state.sent;
        if state.is_sent {
            state.sent = state.output;
        }
        let late = (before - state.sent).times(self.c.effect_rest);
        push(&mut state.targets, state.sent + late);
        let target = self.target(state, 0);
        let before = state.position;
        self.c
            .sample
            .turn(target, &mut state.actuator, &mut state.speed);
        state.position = self.c.within_play(state.position, state.actuator);
        let mean = before + (state.position - before).half();
        let change = self.c.rate_step * (mean + state.disturbance);
        let way = (state.rate.now + change.half()).times(self.c.period);
        state.rate.turn(change);
        state.value.turn(way);
    }

    /// The actuator's target over the sample `ahead` of the one that has passed: until the newest
    /// of the outputs takes effect, the one before counts.
    fn target(&self, state: &SurfaceState<T>, ahead: u8) -> T {
        let older = usize::from(self.c.effect).checked_sub(usize::from(ahead));
        let target = older.and_then(|older| state.targets.get(older));
        target.copied().unwrap_or(state.sent)
    }

    /// Rate, value and disturbance follow a reading.
    fn correct(&self, state: &mut SurfaceState<T>, reading: &Reading<T>) {
        if !state.is_known {
            return self.begin(state, reading);
        }
        let Some(age) = reading.age else { return };
        let age = age + self.c.sensor_lag;
        let innovation = reading.rate - state.rate.past(age);
        state.rate.now = state.rate.now + innovation.times(self.c.rate_share);
        state.disturbance = (state.disturbance + innovation.times(self.c.trim))
            .clamped(-self.c.trim_limit, self.c.trim_limit);
        let innovation = reading.value - state.value.past(age - reading.value_lead);
        state.value.now = state.value.now + innovation.times(self.c.value_share);
    }

    /// The first reading: the rate has been what it is, and the value has followed it.
    #[cold]
    fn begin(&self, state: &mut SurfaceState<T>, reading: &Reading<T>) {
        state.is_known = true;
        let way = reading.rate.times(self.c.period);
        let age = reading.age.unwrap_or_default() - reading.value_lead + self.c.sensor_lag;
        let age = age.clamped(T::ZERO, MOST_AGE.into());
        state.rate = Track {
            now: reading.rate,
            changes: [T::ZERO; HISTORY],
        };
        state.value = Track {
            now: reading.value + age * way,
            changes: [way; HISTORY],
        };
    }

    /// The actuator's path with what has been sent until the surface is looked at: sample by sample
    /// to the output's effect, and in one step from there, where the target is the same.
    fn path(&self, state: &SurfaceState<T>) -> Path<T> {
        let c = &self.c;
        let (mut actuator, mut speed) = (state.actuator, state.speed);
        let mut position = state.position;
        let mut path = Path {
            position: position + state.disturbance,
            sum: T::ZERO,
            sums: T::ZERO,
        };
        for ahead in 1..=c.effect {
            c.sample
                .turn(self.target(state, ahead), &mut actuator, &mut speed);
            position = c.within_play(position, actuator);
            let mean = path.turn(position + state.disturbance);
            path.sums = path.sums + path.sum + mean.half();
            path.sum = path.sum + mean;
        }
        speed = c.rest * speed;
        c.ahead.turn(state.sent, &mut actuator, &mut speed);
        position = c.within_play(position, actuator);
        let mean = c.rest * path.turn(position + state.disturbance);
        path.sums = path.sums + c.rest * (path.sum + mean.half());
        path.sum = path.sum + mean;
        path
    }

    fn decide(&self, state: &SurfaceState<T>, setpoint: T) -> T {
        let c = &self.c;
        let path = self.path(state);
        let rate = state.rate.now + c.rate_step * path.sum;
        let pushed = (c.rate_step * path.sums).times(c.period);
        let value = state.value.now - setpoint + state.rate.now.times(c.horizon) + pushed;

        let away = path.position;
        let size = if away < T::ZERO { -away } else { away };
        let time_s = c.return_s * size;
        let square = away * size;
        let back = c.return_gain * square;
        let x = value + time_s * (rate + back.times(c.way_share));
        let deviation = rate + back + c.surface(x);
        let lead = (c.gain * deviation).clamped(-c.lead_limit, c.lead_limit);
        (away - state.disturbance - lead).clamped(-c.limit, c.limit)
    }
}

impl<T: Scalar> Track<T> {
    /// It changes in a sample.
    fn turn(&mut self, change: T) {
        self.now = self.now + change;
        push(&mut self.changes, change);
    }

    /// What it was so many samples ago, up to the oldest.
    fn past(&self, samples: T) -> T {
        let (whole, rest) = samples.split();
        let [a, b, c] = self.changes;
        match whole {
            0 => self.now - a.times(rest),
            1 => self.now - a - b.times(rest),
            2 => self.now - a - b - c.times(rest),
            _ => self.now - a - b - c,
        }
    }
}

impl<T: Scalar> Path<T> {
    /// The position becomes another. What it was in the mean.
    #[inline]
    fn turn(&mut self, position: T) -> T {
        let mean = self.position + (position - self.position).half();
        self.position = position;
        mean
    }
}

/// A newer one; the oldest is forgotten.
fn push<T: Scalar>(history: &mut [T; HISTORY], newest: T) {
    let [a, b, _] = *history;
    *history = [newest, a, b];
}
