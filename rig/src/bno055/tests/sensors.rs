//! The chip's three sensors without its registers and bus, for tests that need the samples only.

use crate::bno055::registers::Mode;
use crate::bno055::settings::decode;
use crate::bno055::words::words;
use crate::inertial::ImuErrors;
use crate::inertial::{Settings, SignalChain, Stimulus};
use crate::random::{Stream, generator};
use samd21::board::Ticks;

/// ACC_CONFIG, MAG_CONFIG, GYR_CONFIG_0: 4 g at 62.5 Hz and 2000 deg/s at 32 Hz, as after a reset,
/// and 20 Hz of the magnetometer, as in the fusion modes.
const CONFIGURATION: [u8; 3] = [0x0D, 0x0D, 0x38];

/// UNIT_SEL for m/s^2 and deg/s.
const UNITS: u8 = 0;

/// Accelerometer, magnetometer and gyroscope with their errors, noise, bandwidth and resolution.
#[derive(Clone, Debug)]
pub(crate) struct Sensors {
    signals: SignalChain,
    settings: Settings,
}

/// A refresh of the data registers: 16 counts for 1 deg/s, 100 for 1 m/s^2, 16 for 1 uT.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Reading {
    /// Angular rate.
    pub(crate) gyr: [i16; 3],
    /// Specific force.
    pub(crate) acc: [i16; 3],
    /// Magnetic field; `None` between two conversions of the magnetometer.
    pub(crate) mag: Option<[i16; 3]>,
}

impl Sensors {
    /// The sensors of one chip; the chip's offsets and its noise are drawn from `seed`.
    pub(crate) fn new(errors: ImuErrors, seed: u64) -> Self {
        let [acc, mag, gyr] = CONFIGURATION;
        Self {
            signals: SignalChain::new(
                errors,
                &mut generator(seed, Stream::SensorUnit),
                generator(seed, Stream::SensorNoise),
            ),
            settings: decode(Mode::Amg, acc, mag, gyr),
        }
    }

    /// Exposes the sensors to `truth` since the last call, in steps of at most 1 ms.
    pub(crate) fn sense(&mut self, now: Ticks, truth: &Stimulus) {
        self.signals.sense(now, truth, &self.settings);
    }

    /// Refreshes: the counts from now on; `None` before anything was sensed.
    pub(crate) fn refresh(&mut self, now: Ticks) -> Option<Reading> {
        let fresh = self.signals.mag_is_due(now);
        let sample = self.signals.refresh(now, &self.settings)?;
        let [acc, mag, gyr] = words(&sample, UNITS, &self.settings);
        Some(Reading { gyr, acc, mag: fresh.then_some(mag) })
    }
}

#[test]
fn perfect_sensors_show_the_truth_in_counts_and_the_field_at_its_own_rate() {
    let mut sensors = Sensors::new(ImuErrors::NONE, 1);
    assert_eq!(sensors.clone().refresh(Ticks::ZERO), None);
    let mut fields = 0;
    for ms in 1..=1000 {
        sensors.sense(Ticks::from_us(1000 * ms), &Stimulus::REST);
        if ms % 10 == 0 {
            let reading = sensors.refresh(Ticks::from_us(1000 * ms)).unwrap();
            assert_eq!((reading.gyr, reading.acc), ([0; 3], [0, 0, 981]));
            fields += i32::from(reading.mag == Some([0, 274, -752]));
        }
    }
    assert!((19..=21).contains(&fields), "{fields}");
}
