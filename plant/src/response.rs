//! Step-response figures of a recorded run: overshoot, rise, settling, final error.
//!
//! A run starts at some error and should end at none. It may start on either side; figures refer
//! to the start's side and size, so that a start of -0.4 gives what +0.4 gives mirrored.
//!
//! | figure | definition |
//! |---|---|
//! | overshoot | largest excursion past the target, on the side away from the start, as a percentage of the initial error's size; 0 if the target is never passed |
//! | rise | first time at which the error has fallen to 10 % of the initial error |
//! | settling | time after which the error's size never again exceeds the band; none if the record's last sample lies outside it |
//! | final error | mean error over the last tenth of the record, signed |
//!
//! Crossings are interpolated linearly between samples. Times count from the first sample.

/// Share of the initial error at which the response counts as risen.
const RISEN: f64 = 0.1;
/// Share of the record over which the final error is averaged.
const FINAL_SHARE: f64 = 0.1;

/// A recorded response with its errors, ready for figures.
#[derive(Clone, Debug)]
pub struct StepResponse {
    times_s: Vec<f64>,
    errors: Vec<f64>,
    initial: f64,
}

/// Why a record gives no figures.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ResponseError {
    /// Fewer than two samples.
    #[error("a response needs at least two samples")]
    TooShort,
    /// The first sample lies on the target: there is nothing to respond to.
    #[error("the response starts on its target")]
    NoStep,
    /// A time or value is not finite, or time does not increase.
    #[error("sample {index} is not finite or not later than the one before it")]
    BadSample {
        /// Index of the sample.
        index: usize,
    },
}

impl StepResponse {
    /// Takes `(time_s, value)` samples in order and the value that they should reach.
    ///
    /// # Errors
    /// A record without at least two finite samples in increasing time, or without a step.
    pub fn new(
        samples: impl IntoIterator<Item = (f64, f64)>,
        target: f64,
    ) -> Result<Self, ResponseError> {
        let (times, errors): (Vec<f64>, Vec<f64>) =
            samples.into_iter().map(|(time, value)| (time, value - target)).unzip();
        let samples = times.iter().zip(&errors).map(|(time, error)| [*time, *error]);
        if let Some(index) = first_bad_sample(samples) {
            return Err(ResponseError::BadSample { index });
        }
        if times.len() < 2 {
            return Err(ResponseError::TooShort);
        }
        let initial = errors[0];
        if initial == 0.0 {
            return Err(ResponseError::NoStep);
        }
        let start = times[0];
        Ok(Self {
            times_s: times.iter().map(|time| time - start).collect(),
            errors: errors.iter().map(|e| e * initial.signum()).collect(),
            initial,
        })
    }

    /// The initial error, with its sign.
    pub fn initial_error(&self) -> f64 {
        self.initial
    }

    /// Overshoot past the target, in percent of the initial error.
    pub fn overshoot_pct(&self) -> f64 {
        let farthest = self.errors.iter().map(|error| -error).fold(0.0, f64::max);
        100.0 * farthest / self.initial.abs()
    }

    /// Time until the error has fallen to a tenth of the initial one, in s.
    pub fn rise_s(&self) -> Option<f64> {
        let level = RISEN * self.initial.abs();
        Some(self.crossing(self.errors.iter().position(|error| *error <= level)?, level))
    }

    /// Time after which the error stays within `band` (a share of the initial error, 0.05 for
    /// 5 %), in s.
    pub fn settling_s(&self, band: f64) -> Option<f64> {
        self.settling_within_s(band * self.initial.abs())
    }

    /// Time after which the error stays within a fixed band, in the record's own unit, in s.
    pub fn settling_within_s(&self, band: f64) -> Option<f64> {
        match self.errors.iter().rposition(|error| error.abs() > band) {
            None => Some(0.0),
            Some(last) if last + 1 == self.errors.len() => None,
            Some(last) => Some(self.crossing(last + 1, band.copysign(self.errors[last]))),
        }
    }

    /// Mean error over the last tenth of the record, signed.
    pub fn final_error(&self) -> f64 {
        let end = self.times_s[self.times_s.len() - 1];
        let from = self
            .times_s
            .partition_point(|time| *time < end * (1.0 - FINAL_SHARE))
            .min(self.errors.len() - 1);
        let tail = &self.errors[from..];
        self.initial.signum() * tail.iter().sum::<f64>() / tail.len() as f64
    }

    /// When the line from sample `after - 1` to `after` meets `level`.
    fn crossing(&self, after: usize, level: f64) -> f64 {
        let Some(before) = after.checked_sub(1) else {
            return self.times_s[0];
        };
        let (e0, e1) = (self.errors[before], self.errors[after]);
        let (t0, t1) = (self.times_s[before], self.times_s[after]);
        t0 + (t1 - t0) * ((e0 - level) / (e0 - e1)).clamp(0.0, 1.0)
    }
}

/// Index of the first sample that is not finite or not later than the one before it. A sample is a
/// time and its values.
pub(crate) fn first_bad_sample<const N: usize>(
    samples: impl IntoIterator<Item = [f64; N]>,
) -> Option<usize> {
    let mut last = f64::NEG_INFINITY;
    samples.into_iter().position(|sample| {
        let before = std::mem::replace(&mut last, sample[0]);
        !(sample.iter().all(|value| value.is_finite()) && sample[0] > before)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Second order, damping 0.5, 10 rad/s: overshoot exp(-pi z / sqrt(1 - z^2)) = 16.30 %.
    fn second_order(sign: f64) -> StepResponse {
        let (z, wn) = (0.5_f64, 10.0);
        let wd = wn * (1.0 - z * z).sqrt();
        let value = move |t: f64| {
            sign * 0.4 * (-z * wn * t).exp() * ((wd * t).cos() + z * wn / wd * (wd * t).sin())
        };
        StepResponse::new((0..3000).map(|i| f64::from(i) * 1e-3).map(|t| (t, value(t))), 0.0)
            .unwrap()
    }

    #[test]
    fn figures_of_a_known_system_from_either_side() {
        for sign in [1.0, -1.0] {
            let response = second_order(sign);
            assert!((response.overshoot_pct() - 16.303).abs() < 1e-3);
            // 0.9 of the step at wn t = 2.12 (damping 0.5); 5 % band left for the last time at
            // 5.29.
            assert!((response.rise_s().unwrap() - 0.2124).abs() < 2e-3);
            assert!((response.settling_s(0.05).unwrap() - 0.5288).abs() < 2e-3);
            assert!(response.final_error().abs() < 1e-6);
        }
    }

    #[test]
    fn straight_line_by_hand() {
        let line = [(1.0, 3.0), (2.0, 2.0), (3.0, 1.0), (4.0, 1.0)];
        let response = StepResponse::new(line, 1.0).unwrap();
        assert_eq!(response.overshoot_pct(), 0.0);
        assert!((response.rise_s().unwrap() - 1.8).abs() < 1e-12);
        assert!((response.settling_s(0.05).unwrap() - 1.9).abs() < 1e-12);
        assert!((response.settling_within_s(0.5).unwrap() - 1.5).abs() < 1e-12);
        assert_eq!(response.settling_within_s(2.0), Some(0.0));
    }

    #[test]
    fn a_response_that_never_arrives_has_no_settling_time() {
        let away = [(0.0, -0.2), (1.0, -0.3), (2.0, -0.4)];
        let response = StepResponse::new(away, 0.0).unwrap();
        assert_eq!(response.settling_s(0.05), None);
        assert_eq!(response.rise_s(), None);
        assert_eq!(response.overshoot_pct(), 0.0);
        assert!((response.final_error() + 0.4).abs() < 1e-12);
    }

    #[test]
    fn records_without_a_step_are_refused() {
        let refuse = |samples: &[(f64, f64)]| StepResponse::new(samples.to_vec(), 0.0).unwrap_err();
        assert_eq!(refuse(&[(0.0, 1.0)]), ResponseError::TooShort);
        assert_eq!(refuse(&[(0.0, 0.0), (1.0, 1.0)]), ResponseError::NoStep);
        assert_eq!(refuse(&[(0.0, 1.0), (0.0, 1.0)]), ResponseError::BadSample { index: 1 });
        assert_eq!(refuse(&[(0.0, f64::NAN), (1.0, 1.0)]), ResponseError::BadSample { index: 0 });
    }
}
