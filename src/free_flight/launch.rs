//! Launch, burn and burnout of a vehicle that flies free, as its acceleration shows them.
//!
//! On its pad an accelerometer feels 1 g along the vehicle's axis, under thrust more, after burnout
//! next to nothing. `LAUNCH_ACC` releases an armed vehicle by that, `BURNOUT_ACC` ends its control,
//! and `BURN_S` ends it by time. With `FUSE_ACC` 0 the attitude follows the gyroscope alone from
//! the first sign of thrust to the end of control.

use tvc_imu::Micros;
use tvc_pid::Q16;

use crate::config::{BURNOUT_US, PAD_TILT_SD_DEG};
use crate::failsafe::State;
use crate::params::{Params, whole};
use crate::sensor::{ACC_COUNTS, GYR_NOISE_DEG_RTS, GYR_OFFSET_SD_DEG_S};
use crate::words::words;

/// What the acceleration or the time says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Event {
    /// The vehicle has left its pad: control begins.
    Launch,
    /// The burn is over: control ends.
    End,
}

/// What the parameters say.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Settings {
    /// Acceleration along the axis that is a launch, counts of 0.01 m/s2; 0 for none.
    launch: i32,
    /// How long it must last, us.
    launch_us: u32,
    /// Acceleration below which the engine does not burn, counts; 0 for none.
    burnout: i32,
    /// Longest control, us; 0 for any time.
    burn_us: u32,
    /// The accelerometer shows no vertical in flight.
    is_free: bool,
    /// Something depends on the samples: on most vehicles nothing does.
    is_needed: bool,
}

impl Settings {
    pub(crate) fn new(params: &Params) -> Self {
        let counts = |m_s2: f32| whole(m_s2 * ACC_COUNTS);
        let us = |seconds: f32| whole(seconds * 1.0e6) as u32;
        let settings = Self {
            launch: counts(params.launch_acc()),
            launch_us: us(params.launch_s()),
            burnout: counts(params.burnout_acc()),
            burn_us: us(params.burn_s()),
            is_free: params.fuse_acc() == 0.0,
            is_needed: params.gs_rows() != 0.0,
        };
        let Self { launch, burnout, burn_us, is_free, is_needed, .. } = settings;
        Self {
            is_needed: is_needed || is_free || launch > 0 || burnout > 0 || burn_us > 0,
            ..settings
        }
    }
}

/// The impulse counts units of 2^20 count-microseconds.
const IMPULSE_BITS: u32 = 20;
/// One unit of the impulse, cm/s.
const IMPULSE_CM_S: f32 = (1 << IMPULSE_BITS) as f32 * 1e-6;

words! {
    /// Follows the flight from the pad to the end of control.
    #[derive(Clone, Debug, Default)]
    pub(crate) struct Launch {
        /// Since when the acceleration has been beyond the threshold that is watched.
        since: Option<Micros>,
        /// When the vehicle was released, or its thrust began.
        released: Option<Micros>,
        /// The newest sample of the flight.
        newest: Micros,
        /// The engine has been seen to burn.
        has_burned: bool,
        /// Acceleration along the axis, summed over time, [`IMPULSE_CM_S`] each.
        impulse: i32,
        /// The part of a unit that is left over, count-microseconds.
        impulse_rest: i32,
    }
}

impl Settings {
    /// Whether the samples matter: whether [`Launch::watch`] is to see them.
    pub(crate) fn is_needed(&self) -> bool {
        self.is_needed
    }
}

impl Launch {
    /// Take a sample of this time, with an acceleration from tail to nose in counts of 0.01 m/s2.
    pub(crate) fn watch(
        &mut self,
        settings: &Settings,
        at: Micros,
        acceleration: i32,
        state: &State,
    ) -> Option<Event> {
        let elapsed_us = at.since(self.newest).min(100_000) as i32;
        self.newest = at;
        match state {
            State::Armed => {
                let since = self.since;
                self.forget();
                let Settings { launch, launch_us, .. } = *settings;
                if launch == 0 || acceleration < launch {
                    return None;
                }
                let since = since.unwrap_or(at);
                if at.since(since) < launch_us.into() {
                    self.since = Some(since);
                    return None;
                }
                self.released = Some(since);
                Some(Event::Launch)
            }
            State::Active { .. } => {
                self.add_impulse(acceleration, elapsed_us);
                if self.released.is_none() {
                    // An order that comes under thrust is late.
                    self.released = Some(self.since.take().unwrap_or(at));
                }
                let released = self.released.unwrap_or(at);
                let burn_us = settings.burn_us;
                let is_late = burn_us > 0 && at.since(released) >= burn_us.into();
                (self.is_burnt_out(settings.burnout, at, acceleration) || is_late)
                    .then_some(Event::End)
            }
            _ => {
                self.forget();
                None
            }
        }
    }

    /// Whether the gyroscope alone turns the attitude: in control, and while the thrust lasts that
    /// may be a launch.
    pub(crate) fn is_free(&self, settings: &Settings, state: &State) -> bool {
        let flies = match state {
            State::Active { .. } => true,
            State::Armed => self.since.is_some(),
            _ => false,
        };
        settings.is_free && flies
    }

    /// Time from release or first thrust to the newest sample, s; 0 before.
    pub(crate) fn seconds(&self) -> Q16 {
        /// 2^16 / 10^6, times 2^32.
        const PER_US: u64 = (1 << 48) / 1_000_000;
        let since = |released| self.newest.since(released);
        // Up to an hour, which is far beyond a schedule's rows.
        let us = self.released.map_or(0, since).min(3_600_000_000);
        Q16::from_bits(((us * PER_US) >> 32) as i32)
    }

    /// Standard deviation of the tilt about either axis (deg), which grows while the vehicle [flies
    /// free](Self::is_free). It has four parts: the tilt on the pad, the offset learned there, the
    /// gyroscope's noise, and the part of its offset that an acceleration makes, by `GYR_PER_G`.
    // Not inlined: it is asked for once a second.
    #[inline(never)]
    pub(crate) fn tilt_sd_deg(&self, params: &Params) -> f32 {
        let seconds = f32::from(self.seconds());
        let g_seconds = self.impulse as f32 * (IMPULSE_CM_S / 980.665);
        let offset = GYR_OFFSET_SD_DEG_S * seconds;
        let bent = params.gyr_per_g() * g_seconds;
        let noise = GYR_NOISE_DEG_RTS * GYR_NOISE_DEG_RTS * seconds;
        root(PAD_TILT_SD_DEG * PAD_TILT_SD_DEG + offset * offset + bent * bent + noise)
    }

    /// The acceleration has been too small for an engine that burns, for some time.
    fn is_burnt_out(&mut self, burnout: i32, at: Micros, acceleration: i32) -> bool {
        if burnout == 0 || acceleration >= burnout {
            self.has_burned |= burnout > 0;
            self.since = None;
            return false;
        }
        self.has_burned && at.since(*self.since.get_or_insert(at)) >= BURNOUT_US
    }

    fn add_impulse(&mut self, acceleration: i32, elapsed_us: i32) {
        // An i16 of counts over a tenth of a second at most, in parts that fit 32 bits.
        let impulse =
            acceleration.clamp(-20_000, 20_000) * elapsed_us.min(100_000) + self.impulse_rest;
        self.impulse_rest = impulse & ((1 << IMPULSE_BITS) - 1);
        self.impulse = self.impulse.saturating_add(impulse >> IMPULSE_BITS);
    }

    fn forget(&mut self) {
        *self = Self { newest: self.newest, ..Self::default() };
    }
}

/// Square root of a number from 0.01 to 10^6, by Newton's method, to a part in 10^4: a twentieth of
/// the library's code.
fn root(square: f32) -> f32 {
    let mut root = 1.0 + 0.5 * square;
    for _ in 0..16 {
        root = 0.5 * (root + square / root);
    }
    root
}

#[cfg(test)]
mod tests;
