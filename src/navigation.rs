//! From the sensor's samples to attitude: mount, start-up, missed samples, and the estimator in
//! fixed point.

use core::f32::consts::PI;
use core::mem;

use tvc_fusion::fixed::{self, AnyFilter, Counts, Estimator, Ideal, Orientation, Scale};
use tvc_fusion::{Attitude, BiasState, Config, ConfigError, GRAVITY, Quality};
use tvc_imu::{Micros, RawSample, Sample, SensorFault};
use tvc_pid::{Q16, Scalar, Share16};

use crate::blow::Blow;
use crate::config::{
    ACC_LAG_S, ARM_TILT_SD_DEG, BIAS_REST_US, DATA_AGE_LIMIT_US, ESTIMATOR_GAP_US, FIELD_LOST_US,
    LEVEL_RATE, LEVEL_US,
};
use crate::free_flight::{self, SHIFT_BITS};
use crate::mount::Mount;
use crate::params::{FilterKind, Params};
use crate::sensor::{self, Kind};
use crate::words::{Words, words};

/// What makes an attitude of samples.
#[derive(Clone, Debug)]
pub struct Navigation {
    settings: Settings,
    estimator: Estimator<AnyFilter, Ideal>,
}

/// The attitude, and what is known of the newest sample.
#[derive(Clone, Debug)]
pub struct State {
    /// What no later sample tells.
    kept: Kept,
    /// Time of the newest sample used.
    last: Option<Micros>,
    /// The sample in body axes, with the newest field that the estimator has not had yet.
    counts: Counts,
    /// Time between two refreshes of the rates, us.
    refresh_us: u32,
    /// Age of the newest rates, us, if they are new.
    rate_age_us: Option<u32>,
}

words! {
    #[derive(Clone, Debug)]
    struct Kept {
        estimate: fixed::State,
        /// Time since the field was new, us, up to [`FIELD_LOST_US`].
        field_age_us: u32,
        /// Time for which the newest rates have not been integrated yet, us.
        unintegrated_us: u32,
        blow: Blow,
        bias: Bias,
        /// The part of a count by which acceleration has shifted the rates, and which has not been
        /// taken off them yet.
        shift_rest: [i32; 2],
    }
}

/// How much is known of the gyroscope's offset.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Bias {
    /// Nothing yet, after so much rest without a break, us.
    Unknown(u32),
    /// The offset. The attitude, which has followed it so far, has been levelled anew for so long,
    /// us.
    Levelling(u32),
    /// The offset, and with it the attitude.
    Known,
}

impl Words for Bias {
    const WORDS: usize = 1;

    fn tell(&self, each: &mut dyn FnMut(i32)) {
        each(match *self {
            Self::Unknown(us) => us,
            Self::Levelling(us) => us | Self::LEVELLING,
            Self::Known => Self::KNOWN,
        } as i32);
    }

    fn told(next: &mut dyn FnMut() -> i32) -> Self {
        match next() as u32 {
            Self::KNOWN => Self::Known,
            us if us & Self::LEVELLING != 0 => Self::Levelling(us & !Self::LEVELLING),
            us => Self::Unknown(us),
        }
    }
}

impl Bias {
    const LEVELLING: u32 = 1 << 30;
    const KNOWN: u32 = 1 << 31;
}

impl State {
    /// Words that are [told](Navigation::tell).
    pub(crate) const WORDS: usize = Kept::WORDS + 1;

    /// Shows the words of what no later sample tells.
    pub(crate) fn tell(&self, each: &mut dyn FnMut(i32)) {
        self.kept.tell(each);
        self.counts.mag.is_some().tell(each);
    }

    /// How long before the newest sample the sensor measured its rates, us, but for the lag of its
    /// filter; `None` where they repeat those of the sample before.
    pub fn rate_age_us(&self) -> Option<u32> {
        self.rate_age_us
    }

    /// Time between two refreshes of the rates, us.
    pub fn refresh_us(&self) -> u32 {
        self.refresh_us
    }

    /// The newest sample with calibration and mount applied, at the time of `raw` and with its
    /// field.
    pub fn in_body(&self, raw: &RawSample) -> RawSample {
        RawSample { acc: self.counts.acc, gyr: self.counts.gyr, ..*raw }
    }

    /// The acceleration from tail to nose that the newest sample has, counts of 0.01 m/s2: gravity
    /// for a vehicle that stands.
    pub fn upwards(&self) -> i32 {
        let [_, _, down] = self.counts.acc;
        -i32::from(down)
    }

    /// Whether the magnetometer has measured a field lately. Without one the heading follows the
    /// gyroscope alone; pitch needs none.
    pub fn field_is_healthy(&self) -> bool {
        self.last.is_some() && self.kept.field_age_us < FIELD_LOST_US
    }
}

impl Navigation {
    /// What the parameters say, before the first sample.
    ///
    /// # Errors
    /// The estimator's configuration is impossible; no set of parameters within their ranges makes
    /// it so.
    // Not inlined: who builds it needs the stack for more.
    #[inline(never)]
    pub fn new(params: &Params) -> Result<Self, ConfigError> {
        let settings = Settings::of(params);
        Ok(Self { estimator: settings.estimator()?, settings })
    }

    /// The state before the first sample.
    #[inline(never)]
    pub fn at_rest(&self) -> State {
        State {
            kept: self.start(FIELD_LOST_US),
            last: None,
            counts: Counts { gyr: [0; 3], acc: [0; 3], mag: None },
            refresh_us: ESTIMATOR_PERIOD_US,
            rate_age_us: None,
        }
    }

    fn start(&self, field_age_us: u32) -> Kept {
        Kept {
            estimate: self.estimator.start(),
            field_age_us,
            unintegrated_us: 0,
            blow: Blow::default(),
            bias: Bias::Unknown(0),
            shift_rest: [0; 2],
        }
    }

    /// Take over changed parameters. Another calibration, mount, declination or sampling rate
    /// starts the estimate over: what has been learned belongs to the samples as they were. Says
    /// whether it did.
    #[must_use]
    pub fn configure(&mut self, state: &mut State, params: &Params) -> bool {
        let settings = Settings::of(params);
        let changed = self.settings != settings;
        if changed {
            // The settings are within their parameters' ranges.
            if let Ok(estimator) = settings.estimator() {
                self.estimator = estimator;
            }
            self.settings = settings;
            self.restart(state);
        }
        changed
    }

    /// Take the next sample; how long it is after the one before, us. Of a vehicle that `is_free`
    /// the rates alone turn the attitude.
    ///
    /// # Errors
    /// [`SensorFault::Late`] for a sample that is not newer than the last; nothing changes.
    pub fn update(
        &self,
        state: &mut State,
        sample: &Sample,
        is_free: bool,
    ) -> Result<u32, SensorFault> {
        let raw = &sample.raw;
        let dt_us = match state.last {
            None => self.settings.period_us.into(),
            Some(last) if raw.time <= last => return Err(SensorFault::Late),
            Some(last) => raw.time.since(last),
        };
        if dt_us > ESTIMATOR_GAP_US {
            self.restart(state);
        }
        let dt_us = dt_us.min(ESTIMATOR_GAP_US) as u32;
        let counts = self.settings.mount.convert(raw, &sample.gyr);
        let field = if sample.is_field_new {
            state.kept.field_age_us = 0;
            counts.mag.filter(|_| self.settings.sees_field)
        } else {
            state.kept.field_age_us = FIELD_LOST_US.min(state.kept.field_age_us + dt_us);
            state.counts.mag.filter(|_| raw.mag != [0; 3])
        };
        state.kept.blow.feel(raw, dt_us);
        state.last = Some(raw.time);
        let before = state.counts.gyr;
        state.counts = Counts { mag: field, ..counts };
        state.rate_age_us = sample.rates.map(|rates| rates.age_us);
        state.refresh_us = sample.refresh_us;
        if sample.rates.is_some() || state.kept.unintegrated_us != 0 {
            let elapsed_us = sample.rates.map_or(0, |rates| rates.elapsed_us);
            if is_free {
                self.coast(state, elapsed_us);
            } else {
                // No correction in a blow: nobody knows the mean of a clipped acceleration.
                let acc = if state.kept.blow.is_felt() { [0; 3] } else { self.acc_now(state) };
                let counts = Counts { acc, ..state.counts };
                self.advance(state, elapsed_us, dt_us, counts, before);
            }
            state.counts.mag = None;
        }
        if !is_free {
            self.watch_rest(state, dt_us);
        }
        Ok(dt_us)
    }

    /// The newest attitude.
    pub fn attitude(&self, state: &State) -> Attitude {
        self.estimator.attitude(&state.kept.estimate, &state.counts.gyr)
    }

    /// Goes on behind the sample `raw` from the words that another one [told](State::tell).
    pub(crate) fn resume(&self, state: &mut State, raw: &RawSample, next: &mut dyn FnMut() -> i32) {
        let kept = Kept::told(next);
        let field_is_due = bool::told(next);
        // Words that were told by no estimator would overflow.
        let is_possible = self.estimator.accepts(&kept.estimate)
            && kept.field_age_us <= FIELD_LOST_US
            && u64::from(kept.unintegrated_us) <= ESTIMATOR_GAP_US
            && kept.blow.is_possible()
            && kept.shift_rest.iter().all(|rest| (0..1 << SHIFT_BITS).contains(rest));
        state.kept = if is_possible { kept } else { self.start(FIELD_LOST_US) };
        state.last = Some(raw.time);
        let counts = self.settings.mount.convert(raw, &raw.gyr);
        state.counts = Counts { mag: counts.mag.filter(|_| field_is_due), ..counts };
    }

    /// Pitch, rad, -pi/2 to pi/2, nose up positive.
    pub fn pitch(&self, state: &State) -> Q16 {
        // Half a turn is 2^31 as a binary angle, 2^18 without its last bits, and pi * 2^16 as a
        // Q16.
        const SCALE: Share16 = Share16::from_bits((PI / 4.0 * 65_536.0 + 0.5) as u16);
        Q16::from_bits(self.orientation(state).pitch() >> 13).times(SCALE)
    }

    /// The tilt of the body's vertical against the earth's, as a vector in the body's axes: its
    /// parts about y and x, rad, -pi to pi. Of a vehicle that has not rolled they are pitch and 0.
    pub fn tilt(&self, state: &State) -> [Q16; 2] {
        self.orientation(state).tilt_q28().map(|part| Q16::from_bits(part >> 12))
    }

    /// The rates of the newest sample without the gyroscope's offset, rad/s, body axes.
    pub fn rates(&self, state: &State) -> [Q16; 3] {
        // What a 512th of a count is worth in a Q16.
        const SCALE: Share16 = Share16::from_bits(
            (sensor::SCALE.gyr_rad_s * 65_536.0 / 512.0 * 65_536.0 + 0.5) as u16,
        );
        let rate = |counts: i16, bias_q9: i32| {
            Q16::from_bits((i32::from(counts) << 9) - bias_q9).times(SCALE)
        };
        let ([x, y, z], [bias_x, bias_y, bias_z]) =
            (state.counts.gyr, self.estimator.bias_q9(&state.kept.estimate));
        [rate(x, bias_x), rate(y, bias_y), rate(z, bias_z)]
    }

    /// Whether the attitude has settled since start-up.
    pub fn has_settled(&self, state: &State) -> bool {
        self.estimator.flags(&state.kept.estimate).initialised
    }

    /// The newest attitude in fixed point.
    pub fn orientation(&self, state: &State) -> Orientation {
        self.estimator.orientation(&state.kept.estimate)
    }

    /// Standard deviations of tilt and heading, rad.
    pub fn attitude_sd(&self, state: &State) -> [f32; 2] {
        let Quality { tilt_rad, heading_rad, .. } = self.estimator.quality(&state.kept.estimate);
        [tilt_rad, heading_rad]
    }

    /// Whether the tilt is known to [`ARM_TILT_SD_DEG`].
    pub fn tilt_is_certain(&self, state: &State) -> bool {
        const LIMIT: f32 = ARM_TILT_SD_DEG * (PI / 180.0);
        self.estimator.tilt_is_within(&state.kept.estimate, (LIMIT * LIMIT * 268_435_456.0) as i32)
    }

    /// What is known of the gyroscope's offset. It is [`BiasState::Known`] once the attitude has
    /// been levelled with it, too, which takes a rest of some three and a half seconds.
    pub fn bias_state(&self, state: &State) -> BiasState {
        match (state.kept.bias, self.estimator.bias_state(&state.kept.estimate)) {
            (Bias::Known, _) => BiasState::Known,
            (_, BiasState::Refused) => BiasState::Refused,
            _ => BiasState::Unknown,
        }
    }

    /// Forget the attitude, the gyroscope's offset and the samples so far: the estimate depends on
    /// later samples only.
    pub fn restart(&self, state: &mut State) {
        state.last = None;
        state.counts.mag = None;
        state.kept = self.start(state.kept.field_age_us);
    }

    /// A step of the estimator for rates that are new after so long, us, in a sample `dt_us` after
    /// the one before. There are more of them where the sensor refreshes its rates more slowly, or
    /// where samples were missed while the attitude is still trusted: the rates of this one stand
    /// for theirs. Beyond that the estimator takes it as a gap. Without a missed sample it is the
    /// rates `before` that were refreshed again: a vehicle at rest may be released in between.
    fn advance(
        &self,
        state: &mut State,
        elapsed_us: u32,
        dt_us: u32,
        mut counts: Counts,
        before: [i16; 3],
    ) {
        // The estimator takes up to a quarter more for a single step.
        const LONGEST_STEP_US: u32 = ESTIMATOR_PERIOD_US * 5 / 4;
        // Two periods without a missed sample are those of a vehicle at rest, whose rates were the
        // same twice. The second, of the new rates, has time until a tick without new ones.
        let period_us = state.refresh_us;
        let due_us = elapsed_us + mem::take(&mut state.kept.unintegrated_us);
        if dt_us <= LONGEST_STEP_US && due_us <= 2 * period_us && period_us <= LONGEST_STEP_US {
            let step_us = due_us.min(period_us);
            state.kept.unintegrated_us = due_us - step_us;
            // Less than half a period is what a better estimate of the period leaves.
            if due_us - step_us > step_us / 2 {
                counts.gyr = before;
            }
            return self.estimator.update(&mut state.kept.estimate, step_us, &counts);
        }
        if elapsed_us <= LONGEST_STEP_US || u64::from(dt_us) > DATA_AGE_LIMIT_US {
            return self.estimator.update(&mut state.kept.estimate, elapsed_us, &counts);
        }
        let steps = elapsed_us.div_ceil(LONGEST_STEP_US);
        let step_us = elapsed_us / steps;
        let unseen = Counts { mag: None, ..counts };
        for _ in 1..steps {
            self.estimator.update(&mut state.kept.estimate, step_us, &unseen);
        }
        let last_us = elapsed_us - step_us * (steps - 1);
        self.estimator.update(&mut state.kept.estimate, last_us, &counts);
    }

    /// The acceleration of the newest sample, counts, in the axes that the body has at the time of
    /// its attitude, [`ACC_LAG_S`] later: `a + a x u` after a turn `u`.
    fn acc_now(&self, state: &State) -> [i16; 3] {
        /// A count's turn, Q15 rad, times 2^16.
        const TURN: i32 = (ACC_LAG_S * sensor::SCALE.gyr_rad_s * 2_147_483_648.0 + 0.5) as i32;
        let Counts { acc, gyr, .. } = state.counts;
        let bias_q9 = self.estimator.bias_q9(&state.kept.estimate);
        let turn = |rate: i16, bias_q9: i32| ((i32::from(rate) - (bias_q9 >> 9)) * TURN) >> 16;
        let ([wx, wy, wz], [bx, by, bz]) = (gyr, bias_q9);
        let [ux, uy, uz] = [turn(wx, bx), turn(wy, by), turn(wz, bz)];
        let [x, y, z] = acc.map(i32::from);
        let [ax, ay, az] = acc;
        let moved = |a: i16, cross: i32| a.saturating_add((cross >> 15) as i16);
        [moved(ax, y * uz - z * uy), moved(ay, z * ux - x * uz), moved(az, x * uy - y * ux)]
    }

    /// The estimator's step in free flight, for rates that are new after so long, us: in parts that
    /// it takes whole. The offset was learned under 1 g; what the rest of the acceleration makes of
    /// it is taken off the rates.
    #[inline(never)]
    fn coast(&self, state: &mut State, elapsed_us: u32) {
        let thrust = state.upwards() - (GRAVITY * sensor::ACC_COUNTS) as i32;
        let mut rates = state.counts.gyr;
        let shifts = self.settings.shift.iter().zip(&mut state.kept.shift_rest);
        for (rate, (per_count, rest)) in rates.iter_mut().zip(shifts) {
            *rest += i32::from(*per_count) * thrust;
            *rate = rate.saturating_sub((*rest >> SHIFT_BITS) as i16);
            *rest &= (1 << SHIFT_BITS) - 1;
        }
        let mut due_us = elapsed_us + mem::take(&mut state.kept.unintegrated_us);
        while due_us > 0 {
            let step_us = due_us.min(ESTIMATOR_PERIOD_US);
            self.estimator.coast(&mut state.kept.estimate, step_us, &rates);
            due_us -= step_us;
        }
    }

    /// The estimator learns the offset in blocks of rest, the first of which ends in
    /// [`BIAS_REST_US`]. Then the attitude is levelled anew, for [`LEVEL_US`] without a motion.
    fn watch_rest(&self, state: &mut State, dt_us: u32) {
        state.kept.bias = match state.kept.bias {
            Bias::Unknown(_) if !self.estimator.flags(&state.kept.estimate).at_rest => {
                Bias::Unknown(0)
            }
            Bias::Unknown(us) if us + dt_us < BIAS_REST_US => Bias::Unknown(us + dt_us),
            Bias::Unknown(_) => {
                self.estimator.level(&mut state.kept.estimate);
                Bias::Levelling(0)
            }
            Bias::Levelling(_) if self.is_turning(state) => Bias::Unknown(0),
            Bias::Levelling(us) if us + dt_us < LEVEL_US => Bias::Levelling(us + dt_us),
            Bias::Levelling(_) | Bias::Known => Bias::Known,
        };
    }

    /// Whether a rate is further from the offset than [`LEVEL_RATE`].
    fn is_turning(&self, state: &State) -> bool {
        let rates = state.counts.gyr.into_iter().zip(self.estimator.bias_q9(&state.kept.estimate));
        rates
            .into_iter()
            .any(|(rate, bias_q9)| (i32::from(rate) - (bias_q9 >> 9)).abs() > LEVEL_RATE)
    }
}

/// What a count of the sensor is worth.
const SCALE: Scale = Scale {
    acc_m_s2: sensor::SCALE.acc_m_s2,
    gyr_rad_s: sensor::SCALE.gyr_rad_s,
    mag_ut: sensor::SCALE.mag_ut,
};

/// The estimator's own time step, us: the sensor's refresh. A constant, so that all of its
/// configuration but filter and declination is worked out by the compiler.
const ESTIMATOR_PERIOD_US: u32 = 10_000;

/// What the estimate depends on besides the samples.
#[derive(Clone, Debug, PartialEq)]
struct Settings {
    mount: Mount,
    declination_deg: f32,
    period_us: u32,
    filter: FilterKind,
    sees_field: bool,
    sensor: Kind,
    /// Shift of the body's rates for a count of acceleration from tail to nose, 2^-[`SHIFT_BITS`]
    /// counts.
    shift: [i16; 2],
}

impl Settings {
    fn of(params: &Params) -> Self {
        Self {
            mount: Mount::new(params),
            declination_deg: params.declination_deg(),
            period_us: params.control_period_us(),
            filter: params.filter(),
            sees_field: params.fuse_mag() != 0.0,
            sensor: params.sensor_kind(),
            shift: free_flight::shift(params),
        }
    }

    fn estimator(&self) -> Result<Estimator<AnyFilter, Ideal>, ConfigError> {
        let config = Config {
            declination_rad: self.declination_deg * (PI / 180.0),
            // The controller knows how old the rates are, and pitch and tilt need no heading.
            ..Config::with_gains(self.filter.gains()).without_lags()
        };
        Estimator::new(&config, &SCALE, ESTIMATOR_PERIOD_US)
    }
}
