//! The input of the filters: a recording of real sensors, and samples that are hard on them.
//!
//! Every library gets the same samples, in its own units: those that a BNO055 would give, as
//! counts.

use std::iter;

use anyhow::{Result, ensure};
use rand::Rng;
use rand::rngs::StdRng;
use recordings::{Recording, Scalar};
use tvc_fusion::GRAVITY;
use tvc_fusion::fixed::Scale;

use super::candidates::Input;
use super::hard::{self, Sort};

/// Time between two samples, us, for which the images set their filters up.
const PERIOD_US: u32 = 10_500;

/// Samples of the recording of which the mean is taken: 286 Hz become 95 Hz.
const TOGETHER: usize = 3;

/// How much of the recording is played: 12 s of rest and 10 s of movement.
const PLAYED_S: f64 = 22.0;

/// One sample as a BNO055 gives it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// Time since the sample before, us.
    pub dt_us: u32,
    gyr: [i16; 3],
    acc: [i16; 3],
    mag: [i16; 3],
    /// The true orientation, w, x, y, z, sensor to east-north-up, during movement.
    reference: Option<[f64; 4]>,
}

impl Sample {
    /// Up in the sensor's axes, where there is a reference.
    pub fn up(&self) -> Option<[f64; 3]> {
        self.reference.map(|[w, x, y, z]| {
            [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), w * w - x * x - y * y + z * z]
        })
    }

    /// The words that an image takes for it.
    pub fn words(&self, input: Input) -> Vec<u32> {
        let scale = Scale::BNO055;
        match input {
            Input::Si => self.float(scale.gyr_rad_s, scale.acc_m_s2),
            Input::Degrees => self.float(scale.gyr_rad_s.to_degrees(), scale.acc_m_s2 / GRAVITY),
            Input::Counts => self.counts(),
            Input::Quaternion(scalar) => self.quaternion(scalar),
        }
    }

    fn float(&self, gyr: f32, acc: f32) -> Vec<u32> {
        let axes = |counts: [i16; 3], unit: f32| counts.map(|c| f32::from(c) * unit);
        let mag = axes(self.mag, Scale::BNO055.mag_ut);
        let vectors = [axes(self.gyr, gyr), axes(self.acc, acc), mag].concat();
        iter::once(self.dt_us as f32 * 1e-6).chain(vectors).map(f32::to_bits).collect()
    }

    fn counts(&self) -> Vec<u32> {
        let counts = [self.gyr, self.acc, self.mag].concat();
        let pairs = counts.chunks(2).map(|pair| {
            let half = |i: usize| u32::from(pair.get(i).copied().unwrap_or(0) as u16);
            half(0) | half(1) << 16
        });
        iter::once(self.dt_us).chain(pairs).collect()
    }

    /// The true orientation, or else one that the counts make.
    fn quaternion(&self, scalar: Scalar) -> Vec<u32> {
        let made = [self.gyr[0], self.gyr[1], self.gyr[2], self.acc[0]].map(f64::from);
        let q = self.reference.unwrap_or(made);
        let norm = q.iter().map(|c| c * c).sum::<f64>().sqrt();
        let q = if norm > 0.0 { q.map(|c| c / norm) } else { [1.0, 0.0, 0.0, 0.0] };
        let words = q.map(|c| match scalar {
            Scalar::Fixed => (c * f64::from(1 << 30)).round() as i32 as u32,
            _ => (c as f32).to_bits(),
        });
        words.to_vec()
    }
}

/// The beginning of a recording, thinned out to the period of the images.
pub fn recorded(recording: &Recording) -> Result<Vec<Sample>> {
    let period_us = TOGETHER as f64 * 1e6 / recording.rate_hz();
    ensure!(
        (period_us - f64::from(PERIOD_US)).abs() < 1.0,
        "the recording {} has other than {PERIOD_US} us for {TOGETHER} samples",
        recording.name()
    );
    let mean = |values: [f64; TOGETHER], unit: f32| {
        let mean = values.iter().sum::<f64>() / TOGETHER as f64;
        (mean / f64::from(unit)).round() as i16
    };
    let scale = Scale::BNO055;
    let played = (PLAYED_S * 1e6 / f64::from(PERIOD_US)) as usize;
    Ok(recording
        .samples()
        .as_chunks::<TOGETHER>()
        .0
        .iter()
        .take(played)
        .map(|samples| {
            let axes = [0, 1, 2];
            let newest = &samples[TOGETHER - 1];
            Sample {
                dt_us: PERIOD_US,
                gyr: axes.map(|i| mean(samples.map(|s| s.gyr_rad_s[i]), scale.gyr_rad_s)),
                acc: axes.map(|i| mean(samples.map(|s| s.acc_m_s2[i]), scale.acc_m_s2)),
                mag: axes
                    .map(|i| mean(samples.map(|s| s.mag_ut.unwrap_or_default()[i]), scale.mag_ut)),
                reference: newest.reference.filter(|_| newest.movement),
            }
        })
        .collect())
}

/// What changes a plain sample into a hard one.
type Change = fn(&mut Sample, &mut StdRng);

/// The sorts of hard input.
const HARD: [(&str, Change); 15] = [
    ("2000 deg/s", |m, rng| {
        m.gyr = [0; 3].map(|_| sign(rng) * 32_000);
    }),
    ("clipped gyroscope", |m, rng| m.gyr = extremes(rng)),
    ("free fall", |m, rng| {
        m.acc = [0; 3].map(|_| rng.random_range(-3..=3));
    }),
    ("all zero", |m, _| {
        (m.gyr, m.acc, m.mag) = ([0; 3], [0; 3], [0; 3]);
    }),
    ("all saturated", |m, rng| {
        (m.gyr, m.acc, m.mag) = (extremes(rng), extremes(rng), extremes(rng));
    }),
    ("shaken by 4 g", |m, rng| {
        m.acc = [0; 3].map(|_| rng.random_range(-4_000..=4_000));
    }),
    ("upside down", |m, _| m.acc = m.acc.map(i16::saturating_neg)),
    ("vertical field", |m, _| m.mag = m.acc),
    ("no field", |m, _| m.mag = [0; 3]),
    ("saturated field", |m, rng| m.mag = extremes(rng)),
    ("random field", |m, rng| m.mag = any(rng)),
    ("random", |m, rng| {
        (m.gyr, m.acc, m.mag) = (any(rng), any(rng), any(rng));
    }),
    ("random with jitter", |m, rng| {
        (m.gyr, m.acc, m.mag) = (any(rng), any(rng), any(rng));
        m.dt_us = rng.random_range(1..=2 * PERIOD_US);
    }),
    ("gaps in time", |m, rng| {
        m.dt_us = PERIOD_US << rng.random_range(0..=8);
    }),
    ("time standing still or far ahead", |m, rng| {
        m.dt_us = if rng.random() { 0 } else { u32::MAX };
    }),
];

/// All sorts of hard input, `length` samples of each, and eight times as many of random sorts. They
/// are made of the `plain` samples, of which there must be at least one.
pub fn hard(plain: &[Sample], length: usize) -> Vec<Sort<Sample>> {
    hard::sorts(plain, &HARD, [length, 8 * length], |change, sample, rng| {
        sample.reference = None;
        change(sample, rng);
    })
}

fn sign(rng: &mut StdRng) -> i16 {
    if rng.random() { 1 } else { -1 }
}

fn extremes(rng: &mut StdRng) -> [i16; 3] {
    [0; 3].map(|_| if rng.random() { i16::MAX } else { i16::MIN })
}

fn any(rng: &mut StdRng) -> [i16; 3] {
    [0; 3].map(|_| rng.random())
}
