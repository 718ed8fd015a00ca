//! The imperfections of a healthy sensor: noise, offsets, scale errors, drift, iron.

use super::signal::STANDARD_GRAVITY_M_S2;
use samd21::board::Ticks;

/// A degree, rad.
const RAD: f64 = std::f64::consts::PI / 180.0;

/// The chip's temperature: it approaches its final value exponentially.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WarmUp {
    /// At power-on, deg C.
    pub from_c: f64,
    /// Final, deg C.
    pub to_c: f64,
    /// Time in which the difference to the final value shrinks to 37 %, s; above 0.
    pub time_constant_s: f64,
}

impl WarmUp {
    /// A constant 27 deg C.
    pub const NONE: Self = Self { from_c: 27.0, to_c: 27.0, time_constant_s: 60.0 };

    /// Temperature at a time after power-on, deg C.
    pub fn at(&self, now: Ticks) -> f64 {
        let left = (-now.as_secs_f64() / self.time_constant_s).exp();
        self.to_c + (self.from_c - self.to_c) * left
    }
}

/// Imperfections of one sensor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImuErrors {
    /// Zero-rate offset, rad/s; `None` draws each axis from +-1 deg/s, the chip's typical offset.
    pub gyro_bias_rad_s: Option<[f64; 3]>,
    /// Gyroscope noise, rad/s/sqrt(Hz).
    pub gyro_noise_density: f64,
    /// Standard deviation of the slow wandering of the bias, rad/s.
    pub gyro_instability_rad_s: f64,
    /// Relative scale error of each axis of the gyroscope.
    pub gyro_scale: [f64; 3],
    /// Change of the gyroscope's bias with temperature, rad/s/K from 25 deg C; 0.015 deg/s/K
    /// typically and 0.03 at most by the data sheet.
    pub gyro_drift_rad_s_k: [f64; 3],
    /// Shift of the gyroscope's bias on each axis by a specific force of 1 g along z, rad/s.
    pub gyro_per_g_rad_s: [f64; 3],
    /// Accelerometer noise, m/s^2/sqrt(Hz).
    pub acc_noise_density: f64,
    /// Accelerometer offset, m/s^2.
    pub acc_offset_m_s2: [f64; 3],
    /// Change of the accelerometer's offset with temperature, m/s^2/K from 25 deg C; 1 mg/K
    /// typically.
    pub acc_drift_m_s2_k: [f64; 3],
    /// Relative scale error of each axis of the accelerometer.
    pub acc_scale: [f64; 3],
    /// Magnetometer noise, uT rms a sample.
    pub mag_noise_ut: f64,
    /// Hard iron: a field that turns with the sensor, uT.
    pub hard_iron_ut: [f64; 3],
    /// Soft iron: the matrix that the field goes through, row by row.
    pub soft_iron: [[f64; 3]; 3],
    /// The chip's temperature.
    pub warm_up: WarmUp,
}

const IDENTITY: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

impl ImuErrors {
    /// No imperfections at all.
    pub const NONE: Self = Self {
        gyro_bias_rad_s: Some([0.0; 3]),
        gyro_noise_density: 0.0,
        gyro_instability_rad_s: 0.0,
        gyro_scale: [0.0; 3],
        gyro_drift_rad_s_k: [0.0; 3],
        gyro_per_g_rad_s: [0.0; 3],
        acc_noise_density: 0.0,
        acc_offset_m_s2: [0.0; 3],
        acc_drift_m_s2_k: [0.0; 3],
        acc_scale: [0.0; 3],
        mag_noise_ut: 0.0,
        hard_iron_ut: [0.0; 3],
        soft_iron: IDENTITY,
        warm_up: WarmUp::NONE,
    };

    /// The largest errors of a healthy chip near iron that bends the field: 80 mg, 3 deg/s, 40 uT,
    /// soft iron with 20 % of skew, 2 % of scale; typical noise, but 0.6 uT of the field.
    pub const LARGEST: Self = Self {
        gyro_bias_rad_s: Some([3.0 * RAD, -3.0 * RAD, 3.0 * RAD]),
        acc_offset_m_s2: [
            0.08 * STANDARD_GRAVITY_M_S2,
            -0.08 * STANDARD_GRAVITY_M_S2,
            0.08 * STANDARD_GRAVITY_M_S2,
        ],
        acc_scale: [0.02, -0.02, 0.01],
        mag_noise_ut: 0.6,
        hard_iron_ut: [40.0, -40.0, 40.0],
        soft_iron: [[1.1, 0.2, 0.05], [0.2, 0.9, -0.1], [0.05, -0.1, 1.0]],
        ..Self::TYPICAL
    };

    /// Noise of a typical chip and a bias drawn from the seed: 0.014 deg/s/sqrt(Hz), +-1 deg/s,
    /// 6.5 deg/h instability, 150 ug/sqrt(Hz), 0.5 uT; offsets, scale errors and iron are zero.
    pub const TYPICAL: Self = Self {
        gyro_bias_rad_s: None,
        gyro_noise_density: 0.014 * RAD,
        gyro_instability_rad_s: 6.5 / 3600.0 * RAD,
        acc_noise_density: 150e-6 * STANDARD_GRAVITY_M_S2,
        mag_noise_ut: 0.5,
        ..Self::NONE
    };
}

impl Default for ImuErrors {
    /// [`ImuErrors::TYPICAL`].
    fn default() -> Self {
        Self::TYPICAL
    }
}
