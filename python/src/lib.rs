//! The attitude filters of `tvc-fusion` for Python, with the recordings that `tvc fuse` reads: the
//! same code, and so the same values to the bit.

use std::fmt::Display;
use std::path::PathBuf;

use pyo3::exceptions::{PyOSError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use recordings::{
    Choice, Estimate, Facts, FilterName, Mode, RecordedSample, RecordingError, Scalar, Scorer,
    Setting, Source, enu_from_ned, smooth,
};
use tvc_fusion::fixed;

/// A quaternion `(w, x, y, z)`.
type Wxyz = (f64, f64, f64, f64);
/// A vector along the axes of the sensor.
type Xyz = (f64, f64, f64);

/// The one of `all` that is called `name`.
fn named<T: Copy + Display>(what: &str, name: &str, all: &[T]) -> PyResult<T> {
    let found = all.iter().find(|one| one.to_string() == name);
    found.copied().ok_or_else(|| {
        let names: Vec<_> = all.iter().map(T::to_string).collect();
        PyValueError::new_err(format!("no {what} {name}; there are {}", names.join(", ")))
    })
}

fn settings(given: Option<&Bound<'_, PyDict>>) -> PyResult<Vec<Setting>> {
    let mut settings = Vec::new();
    for (key, value) in given.into_iter().flatten() {
        settings.push(Setting { key: key.extract()?, value: value.str()?.extract()? });
    }
    Ok(settings)
}

fn invalid(error: impl Display) -> PyErr {
    PyValueError::new_err(error.to_string())
}

fn unread(error: RecordingError) -> PyErr {
    match error {
        RecordingError::Read(..) => PyOSError::new_err(error.to_string()),
        _ => invalid(error),
    }
}

/// A filter that takes sample after sample.
///
/// `filter` is gyro, complementary, mahony, madgwick, vqf or kalman; `scalar` f32, f64 or fixed;
/// `settings` has the keys of `tvc fuse --set`, such as `{"mag_tau_s": 12}`, in SI units.
#[pyclass(unsendable)]
struct Estimator {
    estimate: Estimate,
}

#[pymethods]
impl Estimator {
    #[new]
    #[pyo3(signature = (filter="vqf", *, scalar="f32", period_s=0.01, settings=None))]
    fn new(
        filter: &str,
        scalar: &str,
        period_s: f64,
        settings: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        let choice = Choice {
            filter: named("filter", filter, FilterName::ALL)?,
            scalar: named("scalar", scalar, Scalar::ALL)?,
            mode: Mode::NineD,
            settings: self::settings(settings)?,
        };
        let facts = Facts { period_s, scale: fixed::Scale::BNO055, gyro_range_rad_s: None };
        let estimate = Estimate::new(&choice, &facts).map_err(invalid)?;
        Ok(Self { estimate })
    }

    /// Takes a sample: time in s, rates in rad/s, specific force in m/s^2 (+9.81 upwards at rest),
    /// and the field in uT where there is a fresh one. Returns (w, x, y, z), sensor axes to
    /// east-north-up.
    #[pyo3(signature = (time_s, gyr_rad_s, acc_m_s2, mag_ut=None))]
    fn update(&mut self, time_s: f64, gyr_rad_s: Xyz, acc_m_s2: Xyz, mag_ut: Option<Xyz>) -> Wxyz {
        let ned = self.estimate.update(&RecordedSample {
            time_s,
            gyr_rad_s: gyr_rad_s.into(),
            acc_m_s2: acc_m_s2.into(),
            mag_ut: mag_ut.map(Into::into),
            reference: None,
            movement: true,
        });
        Wxyz::from(enu_from_ned(ned))
    }
}

/// A recording of an IMU: IMUQ16v1, or CSV with named columns.
#[pyclass(frozen)]
struct Recording {
    facts: Facts,
    samples: Vec<RecordedSample>,
}

impl Recording {
    fn all<T>(&self, of: impl Fn(&RecordedSample) -> T) -> Vec<T> {
        self.samples.iter().map(of).collect()
    }
}

#[pymethods]
impl Recording {
    /// Reads a file.
    #[new]
    fn new(path: PathBuf) -> PyResult<Self> {
        let mut source = Source::open(&path).map_err(unread)?;
        let mut samples = Vec::new();
        while let Some(sample) = source.next_sample().map_err(unread)? {
            samples.push(sample);
        }
        Ok(Self { facts: *source.facts(), samples })
    }

    fn __len__(&self) -> usize {
        self.samples.len()
    }

    /// Usual time between two samples, s.
    #[getter]
    fn period_s(&self) -> f64 {
        self.facts.period_s
    }

    /// Times as recorded, s.
    #[getter]
    fn time_s(&self) -> Vec<f64> {
        self.all(|sample| sample.time_s)
    }

    /// Rotation rates, rad/s.
    #[getter]
    fn gyr_rad_s(&self) -> Vec<Xyz> {
        self.all(|sample| Xyz::from(sample.gyr_rad_s))
    }

    /// Specific forces, m/s^2.
    #[getter]
    fn acc_m_s2(&self) -> Vec<Xyz> {
        self.all(|sample| Xyz::from(sample.acc_m_s2))
    }

    /// Fields, uT; None where there is no fresh one.
    #[getter]
    fn mag_ut(&self) -> Vec<Option<Xyz>> {
        self.all(|sample| sample.mag_ut.map(Xyz::from))
    }

    /// References (w, x, y, z), sensor axes to east-north-up; None where there is none.
    #[getter]
    fn reference(&self) -> Vec<Option<Wxyz>> {
        self.all(|sample| sample.reference.map(Wxyz::from))
    }

    /// Where errors count.
    #[getter]
    fn movement(&self) -> Vec<bool> {
        self.all(|sample| sample.movement)
    }

    /// Runs a filter: (w, x, y, z) for every sample, sensor axes to east-north-up, as `tvc fuse`
    /// writes them. `offline` runs it in both directions of time.
    #[pyo3(signature = (filter="vqf", *, mode="9d", scalar="f32", offline=false, settings=None))]
    fn estimate(
        &self,
        filter: &str,
        mode: &str,
        scalar: &str,
        offline: bool,
        settings: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Vec<Wxyz>> {
        let choice = Choice {
            filter: named("filter", filter, FilterName::ALL)?,
            scalar: named("scalar", scalar, Scalar::ALL)?,
            mode: named("mode", mode, Mode::ALL)?,
            settings: self::settings(settings)?,
        };
        let enu = |ned| Wxyz::from(enu_from_ned(ned));
        if offline {
            let estimates = smooth(&choice, &self.facts, &self.samples).map_err(invalid)?;
            return Ok(estimates.into_iter().map(enu).collect());
        }
        let mut estimate = Estimate::new(&choice, &self.facts).map_err(invalid)?;
        let estimates = self.samples.iter().map(|sample| enu(estimate.update(sample)));
        Ok(estimates.collect())
    }

    /// Errors of estimates against the reference, deg RMSE over the movement, by the definition of
    /// BROAD: (total, heading, inclination); None without a reference.
    fn score(&self, estimates: Vec<Wxyz>) -> PyResult<Option<(f64, f64, f64)>> {
        if estimates.len() != self.samples.len() {
            return Err(PyValueError::new_err(format!(
                "{} estimates for {} samples",
                estimates.len(),
                self.samples.len()
            )));
        }
        let mut scorer = Scorer::default();
        for (sample, (w, x, y, z)) in self.samples.iter().zip(estimates) {
            if let Some(reference) = sample.reference
                && sample.movement
            {
                // Half a turn twice is none.
                scorer.add(enu_from_ned([w, x, y, z]), reference);
            }
        }
        let score = scorer.score();
        Ok(score.map(|score| (score.total_deg, score.heading_deg, score.inclination_deg)))
    }
}

/// Attitude filters on unit quaternions, and recordings of IMUs.
#[pymodule(name = "tvc_fusion")]
fn contents(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<Estimator>()?;
    module.add_class::<Recording>()?;
    module.add("__version__", env!("CARGO_PKG_VERSION"))
}
