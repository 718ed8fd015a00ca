//! A recording in place of the sensors: each refresh shows the mean of the recorded samples since
//! the refresh before.

use super::signal::Sample;
use recordings::{RecordedSample, Recording};
use samd21::board::Ticks;
use std::sync::Arc;

/// The longest interval that is averaged for the accelerometer and the gyroscope, s: the chip
/// integrates over one refresh, also after a pause.
const LONGEST: f64 = 0.0125;

/// A recording and how far it has been played.
#[derive(Clone, Debug)]
pub(crate) struct Playback {
    recording: Arc<Recording>,
    start: Ticks,
    /// First sample that no refresh has shown.
    next: usize,
    /// First sample that no magnetometer conversion has seen.
    next_mag: usize,
    attitude: [f64; 4],
}

impl Playback {
    pub(crate) fn new(recording: Arc<Recording>, start: Ticks) -> Self {
        Self { recording, start, next: 0, next_mag: 0, attitude: [1.0, 0.0, 0.0, 0.0] }
    }

    /// Index of the newest recorded sample that the registers show.
    pub(crate) fn shown(&self) -> usize {
        self.next.saturating_sub(1)
    }

    /// The mean of the samples since the last refresh; after the end the last sample stays.
    pub(crate) fn refresh(&mut self, at: Ticks, mag_due: bool) -> Sample {
        let samples = self.recording.samples();
        let position = at.saturating_sub(self.start).as_secs_f64() * self.recording.rate_hz();
        let end = (position as usize + 1).min(samples.len());
        let longest = (LONGEST * self.recording.rate_hz()).ceil() as usize;
        let from = self.next.max(end.saturating_sub(longest)).min(end - 1);
        self.next = end;
        let span = &samples[from..end];
        if let Some(reference) = samples[end - 1].reference {
            self.attitude = reference;
        }
        let mut sample = Sample {
            acc_m_s2: mean(span, |s| s.acc_m_s2),
            gyr_rad_s: mean(span, |s| s.gyr_rad_s),
            mag_ut: [0.0; 3],
            attitude: self.attitude,
        };
        if mag_due {
            let from = self.next_mag.min(end - 1);
            self.next_mag = end;
            sample.mag_ut = mean(&samples[from..end], |s| s.mag_ut.unwrap_or_default());
        }
        sample
    }
}

fn mean(span: &[RecordedSample], of: impl Fn(&RecordedSample) -> [f64; 3]) -> [f64; 3] {
    let mut sum = [0.0; 3];
    for sample in span {
        for (total, value) in sum.iter_mut().zip(of(sample)) {
            *total += value;
        }
    }
    sum.map(|total| total / span.len() as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 400 samples a second, x rate counting up.
    fn ramp() -> Arc<Recording> {
        let mut bytes = b"IMUQ16v1".to_vec();
        bytes.extend(40u32.to_le_bytes());
        for value in [400.0_f32, 1.0, 1.0, 1.0, 1.0] {
            bytes.extend(value.to_le_bytes());
        }
        bytes.extend(28u32.to_le_bytes());
        bytes.resize(64, 0);
        for i in 0..40i16 {
            let mut record = [0i16; 14];
            (record[0], record[6]) = (i, i);
            bytes.extend(record.iter().flat_map(|v| v.to_le_bytes()));
        }
        Arc::new(Recording::parse("ramp", &bytes).unwrap())
    }

    #[test]
    fn refreshes_average_over_their_interval() {
        let start = Ticks::from_ms(100);
        let mut playback = Playback::new(ramp(), start);
        // Samples 0 to 4 lie at 0, 2.5, 5, 7.5 and 10 ms.
        let first = playback.refresh(start + Ticks::from_ms(10), true);
        assert_eq!(first.gyr_rad_s[0], 2.0);
        assert_eq!(playback.shown(), 4);
        let second = playback.refresh(start + Ticks::from_ms(20), false);
        assert_eq!(second.gyr_rad_s[0], 6.5);
        let third = playback.refresh(start + Ticks::from_ms(30), true);
        assert_eq!(third.gyr_rad_s[0], 10.5);
        // The magnetometer averages over its own interval, 5 to 12.
        assert_eq!(third.mag_ut[0], 8.5);
    }

    #[test]
    fn the_end_holds() {
        let mut playback = Playback::new(ramp(), Ticks::ZERO);
        let end = playback.refresh(Ticks::from_ms(1000), true);
        assert_eq!(playback.shown(), 39);
        assert_eq!(end.gyr_rad_s[0], 37.0);
        let after = playback.refresh(Ticks::from_ms(1010), true);
        assert_eq!(after.gyr_rad_s[0], 39.0);
    }
}
