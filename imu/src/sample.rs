//! Readings of a sensor.

use crate::time::Micros;

/// One reading of all sensors, in counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RawSample {
    /// Start of its burst.
    pub time: Micros,
    /// Acceleration, counts; zero without an accelerometer.
    pub acc: [i16; 3],
    /// Magnetic field, counts; zero without a magnetometer, and from an optional magnetometer that
    /// measures nothing.
    pub mag: [i16; 3],
    /// Angular rate, counts; zero without a gyroscope.
    pub gyr: [i16; 3],
}

impl RawSample {
    /// Acceleration in m/s^2, in the sensor's axes.
    #[must_use]
    pub fn acc_m_s2(&self, scale: &Scale) -> [f32; 3] {
        self.acc.map(|count| f32::from(count) * scale.acc_m_s2)
    }

    /// Angular rate in rad/s, in the sensor's axes.
    #[must_use]
    pub fn gyr_rad_s(&self, scale: &Scale) -> [f32; 3] {
        self.gyr.map(|count| f32::from(count) * scale.gyr_rad_s)
    }

    /// Magnetic field in uT, in the sensor's axes.
    #[must_use]
    pub fn mag_ut(&self, scale: &Scale) -> [f32; 3] {
        self.mag.map(|count| f32::from(count) * scale.mag_ut)
    }
}

/// A reading, and which parts of it are new.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sample {
    /// The counts.
    pub raw: RawSample,
    /// Angular rate, counts, with all three axes at one refresh: `raw` has an older x where the
    /// sensor refreshed its registers in the midst of the burst.
    pub gyr: [i16; 3],
    /// The rates, if they are new since the reading before.
    pub rates: Option<NewRates>,
    /// Time between two refreshes of the rates, us.
    pub refresh_us: u32,
    /// The field is new since the reading before.
    pub is_field_new: bool,
}

/// Rates that are new.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NewRates {
    /// Age of the rates at the reading, us, without the lag of the sensor's filter.
    pub age_us: u32,
    /// Time that the rates cover: from the refresh of the last new rates to this refresh, us.
    pub elapsed_us: u32,
}

/// Units of a count.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scale {
    /// Of the accelerometer, m/s^2.
    pub acc_m_s2: f32,
    /// Of the gyroscope, rad/s.
    pub gyr_rad_s: f32,
    /// Of the magnetometer, uT.
    pub mag_ut: f32,
}
