//! From the sensor's samples to attitude: mount, start-up, missed samples, and the estimator in
//! fixed point.

use core::f32::consts::PI;
use core::mem;

use tvc_fusion::fixed::{AnyFilter, AnyGains, Counts, Estimator, Ideal, Orientation, Scale, State};
use tvc_fusion::{
    Attitude, BiasState, ComplementaryGains, Config, ConfigError, MadgwickGains, MahonyGains,
    Quality, VqfGains,
};
use tvc_imu::{Micros, RawSample, Sample, SensorFault};
use tvc_pid::{Q16, Scalar, Share16};

use crate::blow::Blow;
use crate::config::{
    ARM_TILT_SD_DEG, BIAS_REST_US, DATA_AGE_LIMIT_US, ESTIMATOR_GAP_US, FIELD_LOST_US, LEVEL_RATE,
    LEVEL_US,
};
use crate::mount::Mount;
use crate::params::{FilterKind, Params};
use crate::sensor::DESCRIPTION;

/// The attitude, and all that it is made from.
#[derive(Clone, Debug)]
pub struct Navigation {
    settings: Settings,
    estimator: Estimator<AnyFilter, Ideal>,
    state: State,
    /// Time of the newest sample used.
    last: Option<Micros>,
    /// The sample in body axes, with the newest field that the estimator has not had yet.
    counts: Counts,
    /// Time since the field was new, us, up to [`FIELD_LOST_US`].
    field_age_us: u32,
    bias: Bias,
    /// Time between two refreshes of the rates, us.
    refresh_us: u32,
    /// Age of the newest rates, us, if they are new.
    rate_age_us: Option<u32>,
    /// Time for which the newest rates have not been integrated yet, us.
    owed_us: u32,
    blow: Blow,
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

impl Navigation {
    /// Nothing seen yet.
    ///
    /// # Errors
    /// The estimator's configuration is impossible; no set of parameters within their ranges makes
    /// it so.
    // Not inlined: who builds it needs the stack for more.
    #[inline(never)]
    pub fn new(params: &Params) -> Result<Self, ConfigError> {
        let settings = Settings::of(params);
        let estimator = settings.estimator()?;
        Ok(Self {
            settings,
            state: estimator.start(),
            estimator,
            last: None,
            counts: Counts {
                gyr: [0; 3],
                acc: [0; 3],
                mag: None,
            },
            field_age_us: FIELD_LOST_US,
            bias: Bias::Unknown(0),
            refresh_us: ESTIMATOR_PERIOD_US,
            rate_age_us: None,
            owed_us: 0,
            blow: Blow::default(),
        })
    }

    /// Take over changed parameters. Another calibration, mount, declination or sampling rate
    /// starts the estimate over: what has been learned belongs to the samples as they were. Says
    /// whether it did.
    #[must_use]
    pub fn configure(&mut self, params: &Params) -> bool {
        let settings = Settings::of(params);
        let changed = self.settings != settings;
        if changed {
            // The settings are within their parameters' ranges.
            if let Ok(estimator) = settings.estimator() {
                self.estimator = estimator;
            }
            self.settings = settings;
            self.restart();
        }
        changed
    }

    /// Take the next sample; how long it is after the one before, us. Of a vehicle that `is_free`
    /// the rates alone turn the attitude.
    ///
    /// # Errors
    /// [`SensorFault::Late`] for a sample that is not newer than the last; nothing changes.
    pub fn update(&mut self, sample: &Sample, is_free: bool) -> Result<u32, SensorFault> {
        let raw = &sample.raw;
        let dt_us = match self.last {
            None => self.settings.period_us.into(),
            Some(last) if raw.time <= last => return Err(SensorFault::Late),
            Some(last) => raw.time.since(last),
        };
        if dt_us > ESTIMATOR_GAP_US {
            self.restart();
        }
        let dt_us = dt_us.min(ESTIMATOR_GAP_US) as u32;
        let counts = self.settings.mount.convert(raw);
        let field = if sample.is_field_new {
            self.field_age_us = 0;
            counts.mag.filter(|_| self.settings.sees_field)
        } else {
            self.field_age_us = FIELD_LOST_US.min(self.field_age_us + dt_us);
            self.counts.mag.filter(|_| raw.mag != [0; 3])
        };
        self.blow.feel(raw, dt_us);
        self.last = Some(raw.time);
        self.counts = Counts {
            mag: field,
            ..counts
        };
        self.rate_age_us = sample.rates.map(|rates| rates.age_us);
        self.refresh_us = sample.refresh_us;
        if sample.rates.is_some() || self.owed_us != 0 {
            let elapsed_us = sample.rates.map_or(0, |rates| rates.elapsed_us);
            if is_free {
                self.coast(elapsed_us);
            } else {
                let mut counts = self.counts;
                if self.blow.is_felt() {
                    // No correction: nobody knows the mean of a clipped acceleration.
                    counts.acc = [0; 3];
                }
                self.advance(elapsed_us, dt_us, &counts);
            }
            self.counts.mag = None;
        }
        if !is_free {
            self.watch_rest(dt_us);
        }
        Ok(dt_us)
    }

    /// The newest sample with calibration and mount applied, at the time of `raw` and with its
    /// field.
    pub fn in_body(&self, raw: &RawSample) -> RawSample {
        RawSample {
            acc: self.counts.acc,
            gyr: self.counts.gyr,
            ..*raw
        }
    }

    /// The newest attitude.
    pub fn attitude(&self) -> Attitude {
        self.estimator.attitude(&self.state, &self.counts.gyr)
    }

    /// See [`Flight::memory`](crate::Flight::memory).
    pub(crate) fn memory(&mut self, each: &mut impl FnMut(i32) -> i32) {
        const LEVELLING: u32 = 1 << 30;
        const KNOWN: u32 = 1 << 31;
        for word in self.state.words_mut() {
            *word = each(*word as i32) as u32;
        }
        self.field_age_us = (each(self.field_age_us as i32) as u32).min(FIELD_LOST_US);
        self.owed_us = (each(self.owed_us as i32) as u32).min(ESTIMATOR_GAP_US as u32);
        self.blow.memory(each);
        let is_due = each(self.counts.mag.is_some().into()) != 0;
        // Elsewhere it comes back with the sample: see [`Navigation::resume`].
        self.counts.mag = is_due.then(|| self.counts.mag.unwrap_or_default());
        let bias = match self.bias {
            Bias::Unknown(us) => us,
            Bias::Levelling(us) => us | LEVELLING,
            Bias::Known => KNOWN,
        };
        self.bias = match each(bias as i32) as u32 {
            KNOWN => Bias::Known,
            us if us & LEVELLING != 0 => Bias::Levelling(us & !LEVELLING),
            us => Bias::Unknown(us),
        };
    }

    /// The newest sample used was this one.
    pub(crate) fn resume(&mut self, raw: &RawSample) {
        // Words that were told by no estimator would overflow.
        if !self.estimator.accepts(&self.state) {
            self.state = self.estimator.start();
        }
        self.last = Some(raw.time);
        let counts = self.settings.mount.convert(raw);
        self.counts = Counts {
            mag: self.counts.mag.and(counts.mag),
            ..counts
        };
    }

    /// Pitch, rad, -pi/2 to pi/2, nose up positive.
    pub fn pitch(&self) -> Q16 {
        // Half a turn is 2^31 as a binary angle, 2^18 without its last bits, and pi * 2^16 as a
        // Q16.
        const SCALE: Share16 = Share16::from_bits((PI / 4.0 * 65_536.0 + 0.5) as u16);
        Q16::from_bits(self.estimator.orientation(&self.state).pitch() >> 13).times(SCALE)
    }

    /// The tilt of the body's vertical against the earth's, as a vector in the body's axes: its
    /// parts about y and x, rad, -pi to pi. Of a vehicle that has not rolled they are pitch and 0.
    pub fn tilt(&self) -> [Q16; 2] {
        self.estimator
            .orientation(&self.state)
            .tilt_q28()
            .map(|part| Q16::from_bits(part >> 12))
    }

    /// The rates of the newest sample without the gyroscope's offset, rad/s, body axes.
    pub fn rates(&self) -> [Q16; 3] {
        // What a 512th of a count is worth in a Q16.
        const SCALE: Share16 = Share16::from_bits(
            (DESCRIPTION.scale.gyr_rad_s * 65_536.0 / 512.0 * 65_536.0 + 0.5) as u16,
        );
        let rate = |counts: i16, bias_q9: i32| {
            Q16::from_bits((i32::from(counts) << 9) - bias_q9).times(SCALE)
        };
        let ([x, y, z], [bias_x, bias_y, bias_z]) =
            (self.counts.gyr, self.estimator.bias_q9(&self.state));
        [rate(x, bias_x), rate(y, bias_y), rate(z, bias_z)]
    }

    /// Whether the attitude has settled since start-up.
    pub fn has_settled(&self) -> bool {
        self.estimator.flags(&self.state).initialised
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

    /// The newest attitude in fixed point.
    pub fn orientation(&self) -> Orientation {
        self.estimator.orientation(&self.state)
    }

    /// Standard deviations of tilt and heading, rad.
    pub fn attitude_sd(&self) -> [f32; 2] {
        let Quality {
            tilt_rad,
            heading_rad,
            ..
        } = self.estimator.quality(&self.state);
        [tilt_rad, heading_rad]
    }

    /// Whether the tilt is known to [`ARM_TILT_SD_DEG`].
    pub fn tilt_is_certain(&self) -> bool {
        const LIMIT: f32 = ARM_TILT_SD_DEG * (PI / 180.0);
        self.estimator
            .tilt_is_within(&self.state, (LIMIT * LIMIT * 268_435_456.0) as i32)
    }

    /// What is known of the gyroscope's offset. It is [`BiasState::Known`] once the attitude has
    /// been levelled with it, too, which takes a rest of some three and a half seconds.
    pub fn bias_state(&self) -> BiasState {
        match (self.bias, self.estimator.bias_state(&self.state)) {
            (Bias::Known, _) => BiasState::Known,
            (_, BiasState::Refused) => BiasState::Refused,
            _ => BiasState::Unknown,
        }
    }

    /// Forget the attitude, the gyroscope's offset and the samples so far: the estimate depends on
    /// later samples only.
    pub fn restart(&mut self) {
        self.last = None;
        self.counts.mag = None;
        self.owed_us = 0;
        self.blow = Blow::default();
        self.state = self.estimator.start();
        self.bias = Bias::Unknown(0);
    }

    /// A step of the estimator for rates that are new after so long, us, in a sample `dt_us` after
    /// the one before. There are more of them where the sensor refreshes its rates more slowly, or
    /// where samples were missed while the attitude is still trusted: the rates of this one stand
    /// for theirs. Beyond that the estimator takes it as a gap.
    fn advance(&mut self, elapsed_us: u32, dt_us: u32, counts: &Counts) {
        // The estimator takes up to a quarter more for a single step.
        const LONGEST_STEP_US: u32 = ESTIMATOR_PERIOD_US * 5 / 4;
        // Two periods without a missed sample are those of a vehicle at rest, whose rates were the
        // same twice. The second has time until a tick without new rates.
        let period_us = self.refresh_us;
        let due_us = elapsed_us + mem::take(&mut self.owed_us);
        if dt_us <= LONGEST_STEP_US && due_us <= 2 * period_us && period_us <= LONGEST_STEP_US {
            let step_us = due_us.min(period_us);
            self.owed_us = due_us - step_us;
            return self.estimator.update(&mut self.state, step_us, counts);
        }
        if elapsed_us <= LONGEST_STEP_US || u64::from(dt_us) > DATA_AGE_LIMIT_US {
            return self.estimator.update(&mut self.state, elapsed_us, counts);
        }
        let steps = elapsed_us.div_ceil(LONGEST_STEP_US);
        let step_us = elapsed_us / steps;
        let unseen = Counts {
            mag: None,
            ..*counts
        };
        for _ in 1..steps {
            self.estimator.update(&mut self.state, step_us, &unseen);
        }
        let last_us = elapsed_us - step_us * (steps - 1);
        self.estimator.update(&mut self.state, last_us, counts);
    }

    /// The estimator's step in free flight, for rates that are new after so long, us: in parts that
    /// it takes whole.
    #[inline(never)]
    fn coast(&mut self, elapsed_us: u32) {
        let mut due_us = elapsed_us + mem::take(&mut self.owed_us);
        while due_us > 0 {
            let step_us = due_us.min(ESTIMATOR_PERIOD_US);
            self.estimator
                .coast(&mut self.state, step_us, &self.counts.gyr);
            due_us -= step_us;
        }
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
        self.last.is_some() && self.field_age_us < FIELD_LOST_US
    }

    /// The estimator learns the offset in blocks of rest, the first of which ends in
    /// [`BIAS_REST_US`]. Then the attitude is levelled anew, for [`LEVEL_US`] without a motion.
    fn watch_rest(&mut self, dt_us: u32) {
        self.bias = match self.bias {
            Bias::Unknown(_) if !self.estimator.flags(&self.state).at_rest => Bias::Unknown(0),
            Bias::Unknown(us) if us + dt_us < BIAS_REST_US => Bias::Unknown(us + dt_us),
            Bias::Unknown(_) => {
                self.estimator.level(&mut self.state);
                Bias::Levelling(0)
            }
            Bias::Levelling(_) if self.is_turning() => Bias::Unknown(0),
            Bias::Levelling(us) if us + dt_us < LEVEL_US => Bias::Levelling(us + dt_us),
            Bias::Levelling(_) | Bias::Known => Bias::Known,
        };
    }

    /// Whether a rate is further from the offset than [`LEVEL_RATE`].
    fn is_turning(&self) -> bool {
        let rates = self
            .counts
            .gyr
            .into_iter()
            .zip(self.estimator.bias_q9(&self.state));
        rates
            .into_iter()
            .any(|(rate, bias_q9)| (i32::from(rate) - (bias_q9 >> 9)).abs() > LEVEL_RATE)
    }
}

/// What a count of the sensor is worth.
const SCALE: Scale = Scale {
    acc_m_s2: DESCRIPTION.scale.acc_m_s2,
    gyr_rad_s: DESCRIPTION.scale.gyr_rad_s,
    mag_ut: DESCRIPTION.scale.mag_ut,
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
}

impl Settings {
    fn of(params: &Params) -> Self {
        Self {
            mount: Mount::new(params),
            declination_deg: params.declination_deg(),
            period_us: params.control_period_us(),
            filter: params.filter(),
            sees_field: params.fuse_mag() != 0.0,
        }
    }

    fn estimator(&self) -> Result<Estimator<AnyFilter, Ideal>, ConfigError> {
        let build = |gains| {
            let config = Config {
                declination_rad: self.declination_deg * (PI / 180.0),
                // The controller knows how old the rates are, and pitch and tilt need no heading.
                ..Config::with_gains(gains).without_lags()
            };
            Estimator::new(&config, &SCALE, ESTIMATOR_PERIOD_US)
        };
        match self.filter {
            FilterKind::Vqf => build(AnyGains::Vqf(VqfGains::default())),
            FilterKind::Mahony => build(AnyGains::Mahony(MahonyGains::default())),
            FilterKind::Madgwick => build(AnyGains::Madgwick(MadgwickGains::default())),
            FilterKind::Complementary => {
                build(AnyGains::Complementary(ComplementaryGains::default()))
            }
        }
    }
}
