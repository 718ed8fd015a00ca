//! From counts to orientation.

use nalgebra::Vector3;

use super::field::{self, Compass, size};
use super::filters::{Filter, Gain, View};
use super::orientation::{Angles, Orientation};
use super::over_range::{Ignored, OverRange, Recovered, Step as Seen};
use super::rest::{self, Rest};
use super::rotation::{Rotation, Step};
use crate::config::{Config, GRAVITY};
use crate::error::{ConfigError, in_range};
use crate::estimator::{Attitude, Flags};

/// One sample as the sensors give it, in body axes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Counts {
    /// Rotation rate.
    pub gyr: [i16; 3],
    /// Specific force.
    pub acc: [i16; 3],
    /// Magnetic field, when there is a fresh one.
    pub mag: Option<[i16; 3]>,
}

/// What a count is worth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scale {
    /// Rotation rate of a count, rad/s.
    pub gyr_rad_s: f32,
    /// Specific force of a count, m/s^2.
    pub acc_m_s2: f32,
    /// Magnetic field of a count, uT.
    pub mag_ut: f32,
}

impl Scale {
    /// BNO055 with its default units (data sheet tables 3-17, 3-19, 3-22): 16 counts per deg/s, 100 per
    /// m/s^2, 16 per uT.
    pub const BNO055: Self = Self {
        gyr_rad_s: 0.001_090_830_8,
        acc_m_s2: 0.01,
        mag_ut: 0.0625,
    };
}

/// Longest time step, us: more is a gap.
const MOST_DT_US: u32 = 30_000;

/// Largest half angle of a long step, rad, the sum of three axes.
const MOST_HALF_ANGLE: f32 = 0.38;

/// Bits below those of a half angle per count that the product with a time step has.
const DT_BITS: u32 = 16;

/// Most bits that are given up in a step longer than 1.25 periods, so that one of up to ten periods fits.
const COARSE: u8 = 3;

/// Largest count of a gyroscope, rad/s: 2150 deg/s at full scale.
const MOST_GYR_RAD_S: f32 = 0.001_15;

/// Largest correction of the heading: an eighth of a radian, half angle, Q15; and the largest that fits, with
/// `heading_cut` more bits.
const EIGHTH: i32 = 1 << 13;
const MOST_TURN: i32 = 7 << 13;

/// Largest gain for which a product with any acceleration fits 32 bits.
const MOST_FACTOR: u16 = 2_300;

/// Bits by which a tilt correction is cut at least.
const LEAST_CUT: u8 = 2;

/// Share that a sample has when a running mean begins, as a negative power of two.
const FIRST_SHARE: u8 = 2;

/// Two to this many samples have it: from any attitude to the one that is seen.
const FIRST_SAMPLES: u8 = 6;

/// Sum of the sizes of an acceleration's components beyond which it is passed over in the beginning, g: in whatever
/// direction, gravity has at most 1.73.
const MODERATE_G: f32 = 1.9;

/// An attitude estimator in fixed point. `R` is what it does when rates clip.
///
/// Fields in the order of use: what every step touches lies within reach of the core's short offsets.
#[derive(Clone, Debug)]
#[repr(C)]
pub struct Estimator<F, R = Ignored> {
    rotation: Rotation,
    /// Half angle per count and us, so that the product with a time step is 15 bits and `DT_BITS`; what was cut from
    /// the last; and by how much a product with counts is then cut to Q31.
    per_us: u32,
    fine_dt_us: u32,
    dt_rest: u32,
    turn_cut: u32,
    shares: Shares,
    rest: Rest,
    /// When the last field was taken.
    field_at: u32,
    compass: Compass,
    filter: F,
    settling: Settling,
    most_dt_us: u32,
    /// Largest product of a long step and a sum of rates, us and counts.
    most_turn: u32,
    /// Bits that are given up in a long step.
    coarse: u32,
    gap: bool,
    start_up_blocks: u32,
    /// The last field of the beginning.
    mag: Option<[i32; 3]>,
    /// Cosine and sine of half the declination, Q15, unless it is zero.
    declination: Option<(i32, i32)>,
    gyr_rad_s: f32,
    over_range: R,
}

/// Shares of the errors that a sample takes away.
#[derive(Clone, Debug)]
#[repr(C)]
struct Shares {
    tilt: Gain,
    /// Of the heading error, Q15 with `heading_cut` more bits.
    heading: i32,
    heading_cut: u32,
    /// While the share of the tilt is so large that a product might not fit, the largest acceleration that is taken,
    /// sum of the sizes of its components, counts; else 0.
    moderate: i32,
    /// The shares are the filter's own.
    settled: bool,
}

/// The running mean with which an estimate begins, or begins anew: at least 64 samples have shares of
/// 1/4, then all have one over the number of samples so far, halved as that doubles, down to the filter's own.
#[derive(Clone, Debug)]
#[repr(C)]
struct Settling {
    /// Blocks of samples so far, and those of the first shares.
    blocks: u32,
    first_blocks: u32,
    /// After how many the shares fall next, and how many later again.
    fall_at: u32,
    span: u32,
    /// How much larger the shares are now, as a power of two, for the one of tilt and heading that has the
    /// smaller share of its own; and by how much less that of the other is larger.
    boost: i32,
    tilt_less: i32,
    heading_less: i32,
    /// By how much the boost falls next.
    fall: i32,
    /// The filter's own gains, and by how much the tilt's cut may become less.
    tilt_factor: i32,
    tilt_cut: u32,
    tilt_most: i32,
    heading_cut: u32,
    /// The largest acceleration while it does not suffice.
    moderate: i32,
    /// Where it all begins.
    most: i32,
    first_fall: i32,
}

impl<F: Filter> Estimator<F> {
    /// An estimator for samples of about every `period_us` microseconds, 500 to 10,500. The gains of the
    /// correction are per sample, the rates are integrated over the time steps as they are.
    ///
    /// The accelerometer's gate and an integral gain are not there in fixed point and refused.
    // Inlined with all that it calls, a configuration that is constant leaves constants: 2 KB of soft float less.
    #[inline(always)]
    pub fn new(
        config: &Config<F::Gains>,
        scale: &Scale,
        period_us: u32,
    ) -> Result<Self, ConfigError> {
        Self::build(config, scale, period_us, Ignored)
    }
}

impl<F: Filter> Estimator<F, Recovered> {
    /// The same with what the float filters do about clipped rates: more code, and in a step that is over range
    /// several times the cycles of another.
    pub fn with_recovery(
        config: &Config<F::Gains>,
        scale: &Scale,
        period_us: u32,
    ) -> Result<Self, ConfigError> {
        if !(500..=10_500).contains(&period_us) {
            return Err(ConfigError::OutOfRange("period_us"));
        }
        in_range(config.gyro_range_rad_s, 0.1, 200.0, "gyro_range_rad_s")?;
        in_range(config.recovery_rad2_s, 1e-4, 10.0, "recovery_rad2_s")?;
        let (acc_rate, mag_rate) = F::rates(&config.gains);
        let period_s = period_us as f32 * 1e-6;
        let block_s = period_s * f32::from(1u16 << rest::log2_block(period_s));
        let recovered = Recovered::new(
            scale,
            config.gyro_range_rad_s,
            config.recovery_rad2_s,
            acc_rate.min(mag_rate),
            block_s,
        );
        Self::build(config, scale, period_us, recovered)
    }
}

impl<F: Filter, R: OverRange> Estimator<F, R> {
    #[inline(always)]
    fn build(
        config: &Config<F::Gains>,
        scale: &Scale,
        period_us: u32,
        over_range: R,
    ) -> Result<Self, ConfigError> {
        if !(500..=10_500).contains(&period_us) {
            return Err(ConfigError::OutOfRange("period_us"));
        }
        if config.acc_gate.is_finite() {
            return Err(ConfigError::OutOfRange("acc_gate"));
        }
        let period_s = period_us as f32 * 1e-6;
        in_range(scale.gyr_rad_s, 1e-5, MOST_GYR_RAD_S, "gyr_rad_s")?;
        in_range(scale.acc_m_s2, 5e-4, 0.05, "acc_m_s2")?;
        in_range(scale.mag_ut, 1e-3, 1.0, "mag_ut")?;
        let (acc_rate, mag_rate) = F::rates(&config.gains);
        let (acc_share, mag_share) = (acc_rate * period_s, mag_rate * period_s);
        let per_g = GRAVITY / scale.acc_m_s2;
        let acc_gain = acc_share * 32_768.0 * 2_048.0 / per_g;
        in_range(
            acc_gain,
            0.01,
            f32::from(MOST_FACTOR) / f32::from(1u8 << LEAST_CUT),
            "tilt gain",
        )?;
        let (acc_factor, acc_cut) = scaled(acc_gain, f32::from(MOST_FACTOR));
        in_range(mag_share, 1e-5, 0.1, "heading gain")?;
        let (mag_gain, mag_cut) = scaled(mag_share * 32_768.0, 8_192.0);
        let fine_dt_us = period_us + period_us / 4;
        // Q31 of the half angle.
        let per_us = scale.gyr_rad_s * 0.5e-6 * 2_147_483_648.0;
        let (_, turn_cut) = scaled(per_us * fine_dt_us as f32, 32_768.0);
        let per_us = per_us * f32::from(1u16 << turn_cut) * (1u32 << DT_BITS) as f32;
        let coarse = COARSE.min(turn_cut);
        let rest = Rest::new(&rest::Limits::new(&config.rest, scale, period_s)?);
        let field = field::Limits::new(&config.field, scale, period_s)?;
        let (tilt_boost, heading_boost) = (boost(acc_share), boost(mag_share));
        let most = tilt_boost.max(heading_boost);
        let first = FIRST_SAMPLES.max(rest.log2_block());
        let first_blocks = 1 << (first - rest.log2_block());
        let moderate = (MODERATE_G * per_g) as i32;
        let block_s = period_s * f32::from(1u16 << rest.log2_block());
        Ok(Self {
            rotation: Rotation::new(),
            per_us: per_us as u32,
            fine_dt_us,
            dt_rest: 0,
            turn_cut: turn_cut.into(),
            shares: Shares {
                tilt: Gain { factor: 0, cut: 2 },
                heading: mag_gain,
                heading_cut: mag_cut.into(),
                moderate,
                settled: false,
            },
            field_at: 0,
            rest,
            compass: Compass::new(&field, period_s),
            filter: F::new(&config.gains, period_s)?,
            settling: Settling {
                blocks: 0,
                first_blocks,
                fall_at: first_blocks + 1,
                span: first_blocks,
                boost: most.into(),
                tilt_less: (most - tilt_boost).into(),
                heading_less: (most - heading_boost).into(),
                fall: (first - FIRST_SHARE).into(),
                tilt_factor: acc_factor,
                tilt_cut: acc_cut.into(),
                tilt_most: (acc_cut - LEAST_CUT).into(),
                heading_cut: mag_cut.into(),
                moderate,
                most: most.into(),
                first_fall: (first - FIRST_SHARE).into(),
            },
            mag: None,
            start_up_blocks: ((config.start_up_s / block_s + 0.5) as u32).max(first_blocks),
            gap: false,
            most_dt_us: MOST_DT_US.min(fine_dt_us << coarse),
            most_turn: (MOST_HALF_ANGLE * 2e6 / scale.gyr_rad_s) as u32,
            coarse: coarse.into(),
            declination: half_declination(config.declination_rad)?,
            gyr_rad_s: scale.gyr_rad_s,
            over_range,
        })
    }

    /// The orientation, with geographic north if a declination was configured.
    pub fn orientation(&self) -> Orientation {
        let magnetic = Orientation {
            wxyz_q30: self.rotation.q30(),
        };
        match self.declination {
            Some(half) => magnetic.turned(half),
            None => magnetic,
        }
    }

    /// Gyroscope offset, counts in Q9.
    pub fn bias_q9(&self) -> [i32; 3] {
        self.rotation.bias
    }

    /// The whole estimate in float, with the rate of the sample given: for whoever does not count cycles.
    pub fn attitude(&self, counts: &Counts) -> Attitude {
        let bias =
            Vector3::from(self.rotation.bias).map(|bias| bias as f32 / 512.0 * self.gyr_rad_s);
        let rate = Vector3::from(counts.gyr).map(|rate| f32::from(rate) * self.gyr_rad_s) - bias;
        Attitude {
            orientation: self.orientation().quaternion(),
            rate,
            bias,
            flags: self.flags(),
        }
    }

    /// Health of the estimate. A gap is a step of more than 1.25 periods in the last quarter of a second; the
    /// accelerometer is never passed over.
    pub fn flags(&self) -> Flags {
        Flags {
            initialised: self.settling.blocks > self.start_up_blocks,
            at_rest: self.rest.is_at_rest(),
            mag_disturbed: self.compass.is_disturbed(),
            gap: self.gap,
            over_range: self.over_range.is_active(),
            ..Flags::default()
        }
    }

    /// Take one sample, `dt_us` microseconds after the one before (at most ten periods or 30,000: more is a gap, and
    /// nothing happens at 0).
    #[inline]
    pub fn update(&mut self, dt_us: u32, counts: &Counts) {
        let gyr = counts.gyr;
        let mut acc = counts.acc.map(i32::from);
        let mut mag = counts.mag.map(|mag| mag.map(i32::from));
        let long = dt_us > self.fine_dt_us;
        let beginning = self.shares.moderate != 0;
        if beginning {
            // All bits or none, as the core has no conditional move.
            let size = acc[0].abs() + acc[1].abs() + acc[2].abs();
            let moderate = (size - self.shares.moderate) >> 31;
            acc = acc.map(|acc| acc & moderate);
            // The heading may be off by any angle: the last field stands for those that a slow magnetometer leaves out.
            match mag {
                Some(_) => self.mag = mag,
                None => mag = self.mag,
            }
        }
        let due = if long {
            rest::NOTHING
        } else if beginning {
            self.rest.pass()
        } else {
            self.rest.add(&gyr, &acc)
        };
        let (mut step_us, mut cut) = (dt_us, self.turn_cut);
        if long {
            (step_us, cut) = self.long_step(dt_us, &gyr);
        }
        // What is cut is made good by the next step.
        let product = step_us * self.per_us + self.dt_rest;
        self.dt_rest = product & ((1 << DT_BITS) - 1);
        let per_count = (product >> DT_BITS) as i32;
        self.rotation.turn(&gyr, Step { per_count, cut });

        // A step that keeps house, or is long, leaves the compass alone: no step pays for both.
        let busy = long || due <= rest::SETTLE || self.compass.is_due();
        if busy {
            self.keep_house(due, &gyr, acc[2]);
        }
        let products = self.rotation.products();
        let down = products.down();
        let cut = self.shares.heading_cut & 31;
        let mut turn = 0;
        if let Some(mag) = &mag
            && !busy
        {
            let tick = self.rest.tick();
            // At most those whose shares make the whole error.
            let samples = tick.wrapping_sub(self.field_at).min(4 << cut) as i32;
            self.field_at = tick;
            let sine = self.compass.heading(&products, &down, mag, tick);
            let most = (EIGHTH << cut).min(MOST_TURN);
            turn = ((sine * self.shares.heading) >> 15) * samples;
            // Not `clamp`, which would panic were the limit negative.
            turn = turn.min(most).max(-most);
        }
        let tilt = self.filter.tilt(
            &View {
                products: &products,
                down: &down,
                acc: &acc,
                settling: !self.shares.settled,
            },
            self.shares.tilt,
        );
        let found = self.over_range.step(&Seen {
            dt_us,
            counts,
            products: &products,
            bias: &self.rotation.bias,
            field: self.compass.reference(),
            boost: self.settling.boost,
        });
        if let Some((boost, blocks)) = found.settle {
            self.settling.resume(boost, blocks);
            self.expect_boost();
        }
        let [rx, ry, rz] = found.correction;
        let pending = &mut self.rotation.pending;
        pending[0] += tilt[0] + ((turn * down[0]) >> cut) + rx;
        pending[1] += tilt[1] + ((turn * down[1]) >> cut) + ry;
        pending[2] += tilt[2] + ((turn * down[2]) >> cut) + rz;
    }

    /// One of the small jobs that come now and then.
    #[inline(never)]
    fn keep_house(&mut self, due: u32, gyr: &[i16; 3], acc_z: i32) {
        if due < rest::SETTLE {
            self.rest.close(due, &mut self.rotation.bias);
        } else if due == rest::SETTLE {
            if self.settling.blocks == 0 && acc_z > 0 {
                self.rotation.turn_over();
            }
            self.gap = false;
            self.settling.settle(&mut self.shares);
            if self.shares.moderate != 0 {
                // Nothing is added up yet.
                self.rest.moved = true;
            }
        } else if due != rest::NOTHING {
            self.compass.judge(gyr);
        }
    }

    /// The next shares may be so large that accelerations must be moderate when they come; until then nothing is added
    /// up either.
    #[inline(always)]
    fn expect_boost(&mut self) {
        self.shares.moderate = self.settling.moderate;
        self.rest.moved = true;
    }

    /// A step of more than 1.25 periods, of many more samples are missing: time and bits that stand for it.
    #[cold]
    #[inline(never)]
    fn long_step(&mut self, dt_us: u32, gyr: &[i16; 3]) -> (u32, u32) {
        self.gap = true;
        let mut dt_us = dt_us;
        if dt_us > self.most_dt_us {
            dt_us = self.most_dt_us;
            self.settling.restart();
            self.expect_boost();
        }
        if dt_us * size(gyr) > self.most_turn {
            dt_us = self.fine_dt_us;
        }
        (dt_us >> (self.coarse & 31), self.turn_cut - self.coarse)
    }
}

impl Settling {
    /// Begin anew with the next block.
    fn restart(&mut self) {
        self.boost = self.most;
        self.fall = self.first_fall;
        self.span = self.first_blocks;
        self.fall_at = self.blocks + self.span + 1;
    }

    /// The attitude has become uncertain: a boost for so many blocks, and half of it for twice as many.
    #[cold]
    fn resume(&mut self, boost: i32, blocks: u32) {
        self.boost = boost.min(self.most);
        self.fall = 1;
        self.span = 2 * blocks;
        self.fall_at = self.blocks + blocks + 1;
    }

    /// Once a block: the next shares of the running mean.
    #[inline(never)]
    fn settle(&mut self, shares: &mut Shares) {
        let positive = |value: i32| value & !(value >> 31);
        self.blocks += 1;
        if self.blocks == self.fall_at {
            self.boost = positive(self.boost - self.fall);
            self.fall = 1;
            self.fall_at += self.span;
            self.span <<= 1;
        }
        shares.settled = self.boost == 0;
        let boost = positive(self.boost - self.tilt_less);
        // What the cut has no bits for goes into the factor.
        let more = positive(boost - self.tilt_most);
        // All bits or none.
        shares.moderate = self.moderate & (-more >> 31);
        shares.tilt.factor = self.tilt_factor << (more & 31);
        shares.tilt.cut = self.tilt_cut - (boost - more) as u32;
        let cut = self.heading_cut - positive(self.boost - self.heading_less) as u32;
        shares.heading_cut = cut;
    }
}

fn half_declination(declination_rad: f32) -> Result<Option<(i32, i32)>, ConfigError> {
    use core::f32::consts::PI;
    in_range(declination_rad, -PI, PI, "declination_rad")?;
    let (sin, cos) = Angles::sin_cos_q30(Angles::from_rad(0.5 * declination_rad));
    Ok((declination_rad != 0.0).then_some((cos >> 15, sin >> 15)))
}

/// By which power of two the first share is larger than a filter's own.
fn boost(share: f32) -> u8 {
    let mut bits = 0;
    let mut share = share;
    while share < 1.0 / f32::from(1u8 << (FIRST_SHARE + 1)) {
        share *= 2.0;
        bits += 1;
    }
    bits
}

/// A factor in the upper half below `below`, and the bits by which it is too large.
fn scaled(value: f32, below: f32) -> (i32, u8) {
    let (mut value, mut bits) = (value, 0);
    while value < below / 2.0 {
        value *= 2.0;
        bits += 1;
    }
    ((value + 0.5) as i32, bits)
}
