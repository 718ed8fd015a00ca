//! The estimators that are compared, and what each estimates in an experiment.

use anyhow::{Context, Result};
use recordings::{Choice, Estimate, Facts, FilterName, Mode, RecordedSample, Scalar, Setting};
use tvc_fusion::{Quaternion, fixed};

use super::truth::{Angles, Kind, TimedSample};

/// Time between two samples, s.
const PERIOD_S: f64 = 0.01;
/// Time at the start in which an estimator whose heading is the gyroscope's sees the compass, s.
const ALIGNMENT_S: f64 = 1.0;

/// Where an estimator comes from, and so what it is compared with or held to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Origin {
    /// As set in the thesis.
    Thesis,
    /// Ours, for comparison.
    Ours,
    /// Ours, and it has to meet the requirements.
    Required,
}

/// An estimator in an experiment.
#[derive(Debug)]
pub struct Candidate {
    /// Its name in tables and plots.
    pub name: &'static str,
    /// Where it comes from.
    pub origin: Origin,
    filter: FilterName,
    scalar: Scalar,
    settings: &'static [(&'static str, &'static str)],
    /// The heading is the gyroscope's alone: the estimator starts with the experiment's first
    /// field, and sees the compass for a second.
    gyro_heading: bool,
}

/// As in the libraries of the thesis: no offset is learned at rest, no field is rejected, and all
/// sensors are of one instant.
const PLAIN: &[(&str, &str)] = &[
    ("preset", "thesis"),
    ("rest.rate_rad_s", "0"),
    ("field.gate", "inf"),
    ("gyr_lag_s", "0"),
    ("acc_lag_s", "0"),
    ("mag_lag_s", "0"),
    ("mag_lag_prior_rad2_s", "inf"),
];

const fn thesis(name: &'static str, filter: FilterName) -> Candidate {
    Candidate {
        name,
        origin: Origin::Thesis,
        filter,
        scalar: Scalar::F32,
        settings: PLAIN,
        gyro_heading: matches!(filter, FilterName::Gyro | FilterName::Complementary),
    }
}

const fn ours(name: &'static str, origin: Origin, filter: FilterName, scalar: Scalar) -> Candidate {
    Candidate { name, origin, filter, scalar, settings: &[], gyro_heading: false }
}

/// All candidates. The thesis' four come first, in the order of its tables.
pub const CANDIDATES: [Candidate; 10] = [
    thesis("integrated gyro", FilterName::Gyro),
    thesis("complementary, thesis", FilterName::Complementary),
    thesis("Mahony, thesis", FilterName::Mahony),
    thesis("Madgwick, thesis", FilterName::Madgwick),
    ours("Mahony", Origin::Required, FilterName::Mahony, Scalar::F32),
    ours("Mahony, fixed point", Origin::Required, FilterName::Mahony, Scalar::Fixed),
    ours("VQF class", Origin::Required, FilterName::Vqf, Scalar::F32),
    ours("VQF class, fixed point", Origin::Required, FilterName::Vqf, Scalar::Fixed),
    ours("Madgwick", Origin::Ours, FilterName::Madgwick, Scalar::F32),
    ours("complementary", Origin::Ours, FilterName::Complementary, Scalar::F32),
];

impl Candidate {
    /// Roll, pitch and yaw at each sample, NaN before the estimator has started; yaw within half a
    /// turn of the true heading.
    pub fn estimate(&self, kind: Kind, samples: &[TimedSample]) -> Result<Vec<Angles>> {
        let settings = self
            .settings
            .iter()
            .map(|(key, value)| Setting { key: (*key).into(), value: (*value).into() });
        let choice = Choice {
            filter: self.filter,
            scalar: self.scalar,
            mode: Mode::NineD,
            settings: settings.collect(),
        };
        let facts =
            Facts { period_s: PERIOD_S, scale: fixed::Scale::BNO055, gyro_range_rad_s: None };
        let mut estimate = Estimate::new(&choice, &facts).context(self.name)?;
        let mut started = !self.gyro_heading;
        Ok(samples
            .iter()
            .map(|sample| {
                started |= sample.time_s >= 0.0 && sample.reading.mag.is_some();
                if started {
                    angles_deg(estimate.update(&self.sample(sample)), kind.heading_deg())
                } else {
                    [f64::NAN; 3]
                }
            })
            .collect())
    }

    fn sample(&self, sample: &TimedSample) -> RecordedSample {
        let unit = fixed::Scale::BNO055;
        let si = |counts: [i16; 3], unit: f32| counts.map(|c| f64::from(c) * f64::from(unit));
        let reading = &sample.reading;
        let compass = !self.gyro_heading || sample.time_s <= ALIGNMENT_S;
        RecordedSample {
            time_s: sample.time_s,
            gyr_rad_s: si(reading.gyr, unit.gyr_rad_s),
            acc_m_s2: si(reading.acc, unit.acc_m_s2),
            mag_ut: reading.mag.filter(|_| compass).map(|mag| si(mag, unit.mag_ut)),
            reference: None,
            movement: true,
        }
    }
}

fn angles_deg([w, x, y, z]: [f64; 4], heading_deg: f64) -> Angles {
    let euler = Quaternion { w, x, y, z }.euler();
    let yaw_deg = euler.yaw_rad.to_degrees();
    let turn = ((yaw_deg - heading_deg + 180.0).rem_euclid(360.0)) - 180.0;
    [euler.roll_rad.to_degrees(), euler.pitch_rad.to_degrees(), heading_deg + turn]
}

#[cfg(test)]
mod tests {
    use super::*;
    use tvc_fusion::Euler;

    #[test]
    fn yaw_is_given_on_the_headings_own_turn() {
        for (yaw_deg, heading_deg) in [(-160.0, 200.0), (179.0, 180.0), (-179.0, 180.0)] {
            let q = Quaternion::<f64>::from_euler(&Euler {
                roll_rad: 0.0,
                pitch_rad: 0.1,
                yaw_rad: f64::to_radians(yaw_deg),
            });
            let [_, pitch, yaw] = angles_deg([q.w, q.x, q.y, q.z], heading_deg);
            assert!((yaw - heading_deg).abs() <= 1.0 + 1e-9, "{yaw}");
            assert!((pitch - 0.1f64.to_degrees()).abs() < 1e-9);
        }
    }
}
