//! The closed loop's frequency response from a set point that was swung through a range of
//! frequencies.
//!
//! At every frequency, set point and pitch (or roll) are compared over the stretch of the record in
//! which the sweep passes it: the ratio of their Fourier integrals there, weighted by a Hann
//! window, is gain and phase. The bandwidth is where the gain first falls below -3 dB, the delay
//! the phase at it over its frequency.

use std::f64::consts::{PI, TAU};

use anyhow::Result;
use maud::{Markup, html};
use serde::Serialize;
use tvc_nano::Axis;

use flights::log::Release;
use report::page::figure;
use report::plot::{Line, Plot};

/// First and last frequency of a sweep, Hz.
pub const FROM_HZ: f64 = 0.2;
/// See [`FROM_HZ`].
pub const TO_HZ: f64 = 4.0;
/// Frequencies at which the response is taken.
const POINTS: usize = 16;
/// Periods of a frequency over which it is taken.
const PERIODS: f64 = 4.0;
/// Gain at the bandwidth, dB.
const BANDWIDTH_DB: f64 = -3.0;
/// Set points that a record must have to be a sweep.
const LEAST_SETTINGS: usize = 50;

/// Phase of an exponential sweep of length `length_s` at `time_s`, rad.
pub fn phase(time_s: f64, length_s: f64) -> f64 {
    let rate = (TO_HZ / FROM_HZ).ln() / length_s;
    TAU * FROM_HZ * ((rate * time_s).exp() - 1.0) / rate
}

/// When it passes `frequency_hz`, s.
fn passes_at(frequency_hz: f64, length_s: f64) -> f64 {
    length_s * (frequency_hz / FROM_HZ).ln() / (TO_HZ / FROM_HZ).ln()
}

/// Response at one frequency.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Point {
    /// Frequency, Hz.
    pub frequency_hz: f64,
    /// Gain from set point to pitch, dB.
    pub gain_db: f64,
    /// Phase, deg, negative for a lag; continuous.
    pub phase_deg: f64,
}

/// A frequency response.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Sweep {
    /// Frequency at which the gain falls below -3 dB; none if it does not within the sweep.
    pub bandwidth_hz: Option<f64>,
    /// Time by which pitch lags the set point at the bandwidth, or at the last frequency, s.
    pub delay_s: f64,
    /// The response.
    pub points: Vec<Point>,
}

impl Sweep {
    /// The response of an axis in a release in which its set point swings; none in another.
    pub fn of(release: &Release, axis: Axis) -> Option<Self> {
        let set_rad = release.set_rad(axis);
        let changes: Vec<usize> =
            (1..set_rad.len()).filter(|&i| set_rad[i] != set_rad[i - 1]).collect();
        if changes.len() < LEAST_SETTINGS {
            return None;
        }
        let pitch = release.motion(axis);
        let begin = pitch[changes[0]].0;
        let end = pitch[changes[changes.len() - 1]].0;
        let samples: Vec<(f64, f64, f64)> = pitch
            .iter()
            .zip(set_rad)
            .map(|((time, pitch), set)| (time - begin, *set, *pitch))
            .collect();
        Some(Self::measure(&samples, end - begin))
    }

    /// Of samples `(time from the sweep's begin, set point, pitch)`.
    fn measure(samples: &[(f64, f64, f64)], length_s: f64) -> Self {
        let mut points: Vec<Point> = Vec::new();
        for index in 0..POINTS {
            let share = index as f64 / (POINTS - 1) as f64;
            // A little inside the sweep, where a whole window has its frequency.
            let frequency_hz = 1.3 * FROM_HZ * (0.85 * TO_HZ / (1.3 * FROM_HZ)).powf(share);
            let middle = passes_at(frequency_hz, length_s);
            let half = 0.5 * PERIODS / frequency_hz;
            let at = |value: fn(&(f64, f64, f64)) -> f64| {
                transform(samples, frequency_hz, middle, half, value)
            };
            let (set, pitch) = (at(|s| s.1), at(|s| s.2));
            let gain = (pitch.0.hypot(pitch.1)) / (set.0.hypot(set.1));
            let mut phase_deg = (pitch.1.atan2(pitch.0) - set.1.atan2(set.0)).to_degrees();
            let before = points.last().map_or(0.0, |point| point.phase_deg);
            phase_deg -= 360.0 * ((phase_deg - before) / 360.0).round();
            if gain.is_finite() {
                points.push(Point { frequency_hz, gain_db: 20.0 * gain.log10(), phase_deg });
            }
        }
        let crossing = points
            .windows(2)
            .find(|pair| pair[0].gain_db >= BANDWIDTH_DB && pair[1].gain_db < BANDWIDTH_DB)
            .map(|pair| between(&pair[0], &pair[1]));
        let lag = crossing.or(points.last().copied());
        Self {
            bandwidth_hz: crossing.map(|point| point.frequency_hz),
            delay_s: lag.map_or(0.0, |point| -point.phase_deg / 360.0 / point.frequency_hz),
            points,
        }
    }

    /// Bandwidth and delay in words.
    pub fn words(&self) -> String {
        match self.bandwidth_hz {
            Some(hz) => format!("{hz:.2} Hz, delay there {:.3} s", self.delay_s),
            None => format!(
                "above {:.1} Hz, delay there {:.3} s",
                self.points.last().map_or(TO_HZ, |point| point.frequency_hz),
                self.delay_s
            ),
        }
    }

    /// Gain and phase drawn.
    pub fn markup(&self) -> Result<Markup> {
        let plot = |y, of: fn(&Point) -> f64, band| {
            let points = self.points.iter().map(|p| (p.frequency_hz, of(p)));
            let line = Line::new(y, 0, points.collect());
            let plot = Plot::new("frequency, Hz", y, vec![line]);
            plot.with_band(band).svg()
        };
        let gain = plot("gain, dB", |point| point.gain_db, Some((BANDWIDTH_DB, 0.0)))?;
        let phase = plot("phase, deg", |point| point.phase_deg, None)?;
        Ok(html! {
            (figure("Gain from set point to angle, with the 3 dB that end the bandwidth.", gain))
            (figure("Phase from set point to angle.", phase))
        })
    }
}

/// The point between two at which the gain is that of the bandwidth.
fn between(a: &Point, b: &Point) -> Point {
    let share = (a.gain_db - BANDWIDTH_DB) / (a.gain_db - b.gain_db);
    let mix = |a: f64, b: f64| a + share * (b - a);
    Point {
        frequency_hz: mix(a.frequency_hz, b.frequency_hz),
        gain_db: BANDWIDTH_DB,
        phase_deg: mix(a.phase_deg, b.phase_deg),
    }
}

/// Real and imaginary part of a windowed Fourier integral.
fn transform(
    samples: &[(f64, f64, f64)],
    frequency_hz: f64,
    middle_s: f64,
    half_s: f64,
    value: fn(&(f64, f64, f64)) -> f64,
) -> (f64, f64) {
    let mut sum = (0.0, 0.0);
    for sample in samples {
        let time = sample.0 - middle_s;
        if time.abs() < half_s {
            let weight = 0.5 * (1.0 + (PI * time / half_s).cos());
            let angle = TAU * frequency_hz * time;
            sum.0 += weight * value(sample) * angle.cos();
            sum.1 -= weight * value(sample) * angle.sin();
        }
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A second-order loop with 1.5 Hz and critical damping, whose -3 dB lie at 1.5 * sqrt(sqrt(2)
    /// - 1) Hz.
    #[test]
    fn the_bandwidth_of_a_known_loop_comes_out() {
        let (length, dt) = (40.0, 0.002);
        let omega = TAU * 1.5;
        let (mut x, mut v) = (0.0, 0.0);
        let mut samples = Vec::new();
        for step in 0..(length / dt) as usize {
            let time = step as f64 * dt;
            let set = 0.05 * phase(time, length).sin();
            if step % 5 == 0 {
                samples.push((time, set, x));
            }
            v += dt * (omega * omega * (set - x) - 2.0 * omega * v);
            x += dt * v;
        }
        let sweep = Sweep::measure(&samples, length);
        let bandwidth = sweep.bandwidth_hz.unwrap();
        assert!((bandwidth - 1.5 * 0.6436).abs() < 0.05, "{bandwidth}");
        // Phase -2 atan(0.6436) = -65.5 deg there.
        let delay = 65.5 / 360.0 / bandwidth;
        assert!((sweep.delay_s - delay).abs() < 0.02, "{}", sweep.delay_s);
    }

    #[test]
    fn the_sweep_passes_its_frequencies() {
        let rate = |time: f64| (phase(time + 1e-4, 30.0) - phase(time, 30.0)) / 1e-4 / TAU;
        assert!((rate(0.0) - FROM_HZ).abs() < 1e-3);
        assert!((rate(passes_at(1.0, 30.0)) - 1.0).abs() < 1e-3);
        assert!((rate(30.0) - TO_HZ).abs() < 1e-2);
    }
}
