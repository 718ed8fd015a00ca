//! Proximate time-optimal control: a switching surface for an actuator of limited speed.

mod coefficients;
#[cfg(test)]
mod tests;

use crate::config::ConfigError;
use crate::law::{Law, Reading};
use crate::scalar::Scalar;
use crate::state::state;
use coefficients::Coefficients;

/// Samples that a [`Surface`] looks back. Readings, and outputs before their effect, may be older
/// than two periods.
const HISTORY: usize = 3;

/// Oldest first reading that is extrapolated, sample periods.
const MOST_AGE: f32 = 10.0;

/// Configuration of a [`Surface`]. "Output" is the unit of its output and of the actuator's
/// position, "value" the controlled quantity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceConfig {
    /// Sample period, s, up to 0.1.
    pub period_s: f32,
    /// Acceleration of the value per output, 1/s2, positive.
    pub plant_gain: f32,
    /// Time from a sample until the actuator takes its output for its target, s, below
    /// three periods.
    pub effect_s: f32,
    /// Lag of the rate's sensor, s: age of the rate beyond the reading's age.
    pub sensor_lag_s: f32,
    /// Greatest speed of the actuator, output per s.
    pub actuator_rate: f32,
    /// Time constant of the actuator's position loop, s: the wanted speed is the error over this.
    pub actuator_loop_s: f32,
    /// Lag of the actuator's speed, s.
    pub actuator_lag_s: f32,
    /// Play behind the actuator, either way, output.
    pub actuator_play: f32,
    /// Time from the output's effect to the evaluation of the surface, s.
    pub ahead_s: f32,
    /// Output per deviation of the rate from the surface, s.
    pub gain_s: f32,
    /// Largest distance of the output from the actuator's position at its effect, output.
    pub lead_limit: f32,
    /// Slope of the surface near the setpoint, 1/s.
    pub near_per_s: f32,
    /// Share of the time-optimal rate at which the value approaches.
    pub curve: f32,
    /// Share of a rate's innovation that the model takes over with each new reading, 0 to 1.
    pub rate_share: f32,
    /// Share of a value's innovation that the model takes over, 0 to 1.
    pub value_share: f32,
    /// Bandwidth of the disturbance's estimate, rad/s; 0 is no trim.
    pub trim_rad_s: f32,
    /// Largest estimate of the disturbance, output.
    pub trim_limit: f32,
    /// Largest output, either side.
    pub limit: f32,
}

/// Control of a plant `value'' = gain (position + disturbance)`, as fast as the actuator's speed
/// allows, without overshoot. The actuator is slow, lags, has play, and takes a new target only now
/// and then. Readings are late.
///
/// **The surface.** An actuator at zero with the speed `S` takes `t = sqrt(w / (gain S))` to swing
/// out and as long to swing back. That stops a rate `w` over a distance `w t`. So from a distance
/// `x`, the greatest rate that can be stopped is `(gain S)^(1/3) x^(2/3)`. (Without a limit of
/// speed it is the well-known square root: M. L. Workman, Adaptive Proximate Time-Optimal
/// Servomechanisms, 1987.) An actuator away from zero must come back first, which moves value and
/// rate by
///
/// ```text
/// time t = |p| / S,  rate: gain p |p| / 2 S,  value: rate0 t + gain p^3 / 3 S^2
/// ```
///
/// with `p` its position and the disturbance. The value after that is the distance, and the rate
/// after that is compared with the curve. Near the setpoint the curve is a straight line, because
/// its root has no finite slope there. Farther away it is the lowest of six tangents.
///
/// **The model.** The actuator's position follows from the outputs and the time of their effect;
/// value and rate follow from the position. The model is of the present, although readings are
/// late: a reading is compared with the model at the reading's time, and the difference moves
/// present and past alike. With the outputs under way, the model runs ahead to the next output's
/// effect.
///
/// ```text
/// speed    = clamp(speed + a (clamp((target - actuator) / loop) - speed))  a = T / (lag + T)
/// actuator = clamp(actuator + T speed),  position = position within actuator +- play
/// rate, value: integrals of gain (position + disturbance), shifted by shares of the innovations
/// disturbance = disturbance + rate_share trim / gain * innovation of the rate
/// excess = excess + learn * innovation of the rate, where the rate changed by much
///
/// ahead, when the output takes effect and `ahead_s` later:
/// x = value - setpoint + rate |p| / S + gain p^3 / 3 S^2
/// r = min(near |x|, curve (gain S)^(1/3) |x|^(2/3)) sign(x)
/// u = position - clamp(gain_s (rate + gain p |p| / 2 S + r))
/// ```
///
/// The output is the actuator's position plus a distance, so an actuator at rest on the surface
/// stays. That holds against a disturbance without an integral that could wind up. The model does
/// not wind up either, at limits of the output or if the plant is held: its rate and value follow
/// the readings.
///
/// **The plant's gain.** A plant quicker than configured answers each output by more than the
/// model, and would swing for ever. Where the model's rate changes by much between two readings,
/// the rate's innovation therefore moves an estimate of the gain. It stays between one and two
/// times the configured gain. The model takes the estimate, and the output's distance is divided by
/// it: the estimate makes the law gentler, never sharper. A plant that is held leaves it alone.
///
/// The default has no gains: its output is 0.
#[derive(Clone, Debug, Default)]
pub struct Surface<T: Scalar> {
    c: Coefficients<T>,
}

state! {
    /// The memory of a [`Surface`].
    pub struct SurfaceState {
        /// The output of the last sample has been sent.
        is_sent: bool,
        /// A reading has come.
        is_known: bool,
        /// The actuator's model: position, speed in output per sample, and position behind the
        /// play.
        actuator: T,
        speed: T,
        position: T,
        /// Last output sent to the actuator.
        sent: T,
        /// Output of the last sample.
        output: T,
        disturbance: T,
        /// What the plant's gain is more than the configured one, as a share of it.
        excess: T,
        /// Rate at the time of the last reading.
        read: T,
        /// Targets of the actuator in the newest samples, each delayed by the output's effect, the
        /// newest first.
        targets: [T; HISTORY],
        rate: Track<T>,
        value: Track<T>,
    }
}

state! {
    /// A number and its changes in the newest samples, the newest first; zeros before the first
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

    /// The estimate of the plant's gain, in configured gains: 1 to 2.
    pub fn plant_gain(&self) -> T {
        T::ONE + self.excess
    }

    /// A factor of the configured gain with the estimated one.
    fn with_gain(&self, factor: T) -> T {
        let (_, excess) = self.excess.split();
        factor + factor.times(excess)
    }

    /// A factor of the inverse of the configured gain with the estimated one, within 8 %.
    fn without_gain(&self, factor: T) -> T {
        let (_, excess) = self.excess.split();
        let (_, less) = (self.excess - self.excess.times(excess).half()).split();
        factor - factor.times(less)
    }
}

/// Position of the actuator with the disturbance. Its sum over samples moves the rate, and the sum
/// of the sums moves the value.
struct Path<T> {
    position: T,
    sum: T,
    sums: T,
}

impl<T: Scalar> Law<T> for Surface<T> {
    type Config = SurfaceConfig;
    type State = SurfaceState<T>;

    #[inline]
    fn new(config: &SurfaceConfig) -> Result<Self, ConfigError> {
        Ok(Self { c: Coefficients::new(config)? })
    }

    // A function of its own, which spares the caller's registers.
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
    fn retune(&mut self, _: &mut Self::State, config: &SurfaceConfig) -> Result<(), ConfigError> {
        *self = Self::new(config)?;
        Ok(())
    }
}

impl<T: Scalar> Surface<T> {
    /// The model over the last sample.
    fn advance(&self, state: &mut SurfaceState<T>) {
        let before = state.sent;
        if state.is_sent {
            state.sent = state.output;
        }
        let late = (before - state.sent).times(self.c.effect_rest);
        push(&mut state.targets, state.sent + late);
        let target = self.target(state, 0);
        let before = state.position;
        self.c.sample.turn(target, &mut state.actuator, &mut state.speed);
        // What an actuator can do: from a wrong position far off, the model would take minutes.
        let (most, limit) = (self.c.sample.most, self.c.limit);
        state.speed = state.speed.clamped(-most, most);
        state.actuator = state.actuator.clamped(-limit, limit);
        state.position = self.c.within_play(state.position, state.actuator);
        let mean = before + (state.position - before).half();
        let change = state.with_gain(self.c.rate_step) * (mean + state.disturbance);
        let way = (state.rate.now + change.half()).times(self.c.period);
        state.rate.turn(change);
        state.value.turn(way);
    }

    /// The actuator's target over the sample `ahead` of the last one. Until the newest output takes
    /// effect, the output before counts.
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
        let read = state.rate.past(age);
        let innovation = reading.rate - read;
        self.learn(state, read - state.read, innovation);
        let correction = innovation.times(self.c.rate_share);
        state.read = read + correction;
        state.rate.now = state.rate.now + correction;
        state.disturbance = (state.disturbance + innovation.times(self.c.trim))
            .clamped(-self.c.trim_limit, self.c.trim_limit);
        let innovation = reading.value - state.value.past(age - reading.value_lead);
        state.value.now = state.value.now + innovation.times(self.c.value_share);
    }

    /// The gain follows the innovation of a rate that the model changed by `change` since the last
    /// reading. The innovation counts for as much as the change at most.
    fn learn(&self, state: &mut SurfaceState<T>, change: T, innovation: T) {
        let (change, innovation) =
            if change < T::ZERO { (-change, -innovation) } else { (change, innovation) };
        if change > self.c.learn_from {
            let more = self.c.learn * innovation.clamped(-change, change);
            state.excess = (state.excess + more).clamped(T::ZERO, T::BELOW_ONE);
        }
    }

    /// The first reading: the rate counts as constant up to now, and the value has followed it.
    #[cold]
    fn begin(&self, state: &mut SurfaceState<T>, reading: &Reading<T>) {
        state.is_known = true;
        let way = reading.rate.times(self.c.period);
        let age = reading.age.unwrap_or_default() - reading.value_lead + self.c.sensor_lag;
        let age = age.clamped(T::ZERO, MOST_AGE.into());
        state.rate = Track { now: reading.rate, changes: [T::ZERO; HISTORY] };
        state.read = reading.rate;
        state.value = Track { now: reading.value + age * way, changes: [way; HISTORY] };
    }

    /// The actuator's path with the outputs sent, up to the evaluation of the surface: sample by
    /// sample to the output's effect, and from there in one step, with a constant target.
    fn path(&self, state: &SurfaceState<T>) -> Path<T> {
        let c = &self.c;
        let (mut actuator, mut speed) = (state.actuator, state.speed);
        let mut position = state.position;
        let mut path = Path { position: position + state.disturbance, sum: T::ZERO, sums: T::ZERO };
        for ahead in 1..=c.effect {
            c.sample.turn(self.target(state, ahead), &mut actuator, &mut speed);
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
        let rate_step = state.with_gain(c.rate_step);
        let rate = state.rate.now + rate_step * path.sum;
        let pushed = (rate_step * path.sums).times(c.period);
        let value = state.value.now - setpoint + state.rate.now.times(c.horizon) + pushed;

        let away = path.position;
        let size = if away < T::ZERO { -away } else { away };
        let time_s = c.return_s * size;
        let square = away * size;
        let back = state.with_gain(c.return_gain) * square;
        let x = value + time_s * (rate + back.times(c.way_share));
        let deviation = rate + back + c.surface(x);
        let lead = state.without_gain(c.gain) * deviation;
        let lead = lead.clamped(-c.lead_limit, c.lead_limit);
        (away - state.disturbance - lead).clamped(-c.limit, c.limit)
    }
}

impl<T: Scalar> Track<T> {
    /// It changes in a sample.
    fn turn(&mut self, change: T) {
        self.now = self.now + change;
        push(&mut self.changes, change);
    }

    /// The value some samples ago, up to the oldest.
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
    /// Changes the position and returns its mean.
    #[inline]
    fn turn(&mut self, position: T) -> T {
        let mean = self.position + (position - self.position).half();
        self.position = position;
        mean
    }
}

/// Adds a newest value and drops the oldest.
fn push<T: Scalar>(history: &mut [T; HISTORY], newest: T) {
    let [a, b, _] = *history;
    *history = [newest, a, b];
}
