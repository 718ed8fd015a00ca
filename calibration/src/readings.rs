//! What the fits are given: samples, whichever format or link they came from.

use std::collections::BTreeMap;

use nalgebra::Vector3;

use crate::spread;

/// What the sensors read at one time, as it comes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading {
    /// Time by any clock, s.
    pub time_s: f64,
    /// Rotation rate, rad/s.
    pub gyr: Vector3<f64>,
    /// Specific force, m/s2.
    pub acc: Vector3<f64>,
    /// Magnetic field, uT; `None` where the magnetometer has not measured.
    pub mag: Option<Vector3<f64>>,
}

/// What the sensors read at one time, in its place among [`Readings`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sample {
    /// Time since the first sample, s.
    pub time_s: f64,
    /// Rotation rate, rad/s.
    pub gyr: Vector3<f64>,
    /// Specific force, m/s2.
    pub acc: Vector3<f64>,
    /// Latest magnetic field, uT.
    pub mag: Vector3<f64>,
}

/// All samples of a recording, or all so far.
#[derive(Clone, Debug, Default)]
pub struct Readings {
    /// Its samples; where there was no new field the last one is repeated.
    pub samples: Vec<Sample>,
    /// Which of them have a new field.
    pub fresh: Vec<usize>,
    /// When a person was asked to stand the body level, s since the first sample.
    pub level_from_s: Option<f64>,
    /// The vehicle's parameters, by name, where it has told them.
    pub parameters: BTreeMap<String, f32>,
    /// Time of the first sample, as it came.
    begun_s: f64,
}

impl Readings {
    /// Takes one more; one with something that is not a number is left out.
    pub fn push(&mut self, reading: Reading) {
        let Reading { time_s, gyr, acc, mag } = reading;
        if !(time_s.is_finite() && gyr.norm().is_finite() && acc.norm().is_finite()) {
            return;
        }
        if self.samples.is_empty() {
            self.begun_s = time_s;
        }
        let known = self.fresh.last().map(|i| self.samples[*i].mag);
        let new = mag.filter(|mag| mag.norm().is_finite() && Some(*mag) != known);
        if let Some(mag) = new {
            if self.fresh.is_empty() {
                // Before the first field the sensor lay as it did when that was measured.
                self.samples.iter_mut().for_each(|sample| sample.mag = mag);
            }
            self.fresh.push(self.samples.len());
        }
        self.samples.push(Sample {
            time_s: time_s - self.begun_s,
            gyr,
            acc,
            mag: new.or(known).unwrap_or_default(),
        });
    }

    /// From the first sample to the last, s.
    pub fn length_s(&self) -> f64 {
        self.samples.last().map_or(0.0, |sample| sample.time_s)
    }

    /// Every new field, uT.
    pub fn fields(&self) -> Vec<Vector3<f64>> {
        self.fresh.iter().map(|i| self.samples[*i].mag).collect()
    }

    /// Standard deviation of the field's strength as it was read, uT.
    pub fn field_spread_ut(&self) -> f64 {
        let strengths: Vec<Vector3<f64>> =
            self.fields().iter().map(|field| Vector3::new(field.norm(), 0.0, 0.0)).collect();
        spread(strengths.iter()).map_or(0.0, |(_, deviation)| deviation.x)
    }
}
