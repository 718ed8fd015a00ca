//! Settings of the chip: address, ranges, rate.

use tvc_imu::judge::Rules;
use tvc_imu::{Description, RawSample, Scale};

use crate::chip::Chip;
use crate::registers as reg;
use crate::sample;

/// Standard gravity, m/s^2.
const G: f32 = 9.806_65;

/// Accelerations beyond this clip, counts: every range ends just beyond the largest word.
const ACC_RANGE: u16 = 32_700;

/// Rates beyond this may clip, counts: the smallest count at which a range ends (245 deg/s).
const GYR_RANGE: u16 = 28_000;

/// Shortest standstill of a dead sensor's words, us.
const STILL_US: u32 = 65_000;

/// The chip's I2C address, chosen by its SA0 pin.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum Address {
    /// 0x6A: SA0 low, as on the Arduino Nano 33 IoT.
    #[default]
    Low = 0x6A,
    /// 0x6B: SA0 high, as on many breakouts.
    High = 0x6B,
}

impl Address {
    /// The 7-bit address.
    #[must_use]
    pub const fn value(self) -> u8 {
        self as u8
    }

    pub(crate) const fn other(self) -> Self {
        match self {
            Self::Low => Self::High,
            Self::High => Self::Low,
        }
    }
}

/// Range of the accelerometer; its value is that of FS_XL.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum AccRange {
    /// +-2 g.
    G2 = 0,
    /// +-4 g.
    G4 = 2,
    /// +-8 g.
    #[default]
    G8 = 3,
    /// +-16 g.
    G16 = 1,
}

impl AccRange {
    /// A count, mg (data sheet table 3).
    #[must_use]
    pub const fn mg(self) -> f32 {
        match self {
            Self::G2 => 0.061,
            Self::G4 => 0.122,
            Self::G8 => 0.244,
            Self::G16 => 0.488,
        }
    }
}

/// Range of the gyroscope; its value is that of FS_G and FS_125.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum GyrRange {
    /// +-125 deg/s.
    Dps125 = 1,
    /// +-245 deg/s; 250 in the data sheets of later chips.
    Dps245 = 0,
    /// +-500 deg/s.
    Dps500 = 2,
    /// +-1000 deg/s.
    #[default]
    Dps1000 = 4,
    /// +-2000 deg/s.
    Dps2000 = 6,
}

impl GyrRange {
    /// A count, mdeg/s (data sheet table 3).
    #[must_use]
    pub const fn mdps(self) -> f32 {
        match self {
            Self::Dps125 => 4.375,
            Self::Dps245 => 8.75,
            Self::Dps500 => 17.5,
            Self::Dps1000 => 35.0,
            Self::Dps2000 => 70.0,
        }
    }
}

/// Refresh rate of both sensors, in high-performance mode; its value is that of ODR.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum Rate {
    /// 104 Hz.
    Hz104 = 4,
    /// 208 Hz.
    Hz208 = 5,
    /// 416 Hz.
    Hz416 = 6,
    /// 833 Hz.
    #[default]
    Hz833 = 7,
    /// 1660 Hz.
    Hz1660 = 8,
}

impl Rate {
    /// Time between two refreshes, us.
    #[must_use]
    pub const fn period_us(self) -> u32 {
        match self {
            Self::Hz104 => 9_615,
            Self::Hz208 => 4_808,
            Self::Hz416 => 2_404,
            Self::Hz833 => 1_200,
            Self::Hz1660 => 602,
        }
    }

    /// Bandwidth of the gyroscope, Hz, as the second filter of an LSM6DSL gives it (application
    /// note AN5040).
    #[must_use]
    pub const fn gyr_bandwidth_hz(self) -> f32 {
        match self {
            Self::Hz104 => 33.0,
            Self::Hz208 => 66.8,
            Self::Hz416 => 135.9,
            Self::Hz833 => 295.5,
            Self::Hz1660 => 1108.1,
        }
    }
}

/// Units of the samples' counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Units {
    /// Those of the chip, which follow from its ranges.
    #[default]
    Chip,
    /// 0.01 m/s^2 and 1/16 deg/s, the defaults of a BNO055: one loop can read either. The ranges
    /// that fit are up to 16 g and 2000 deg/s.
    Bno055,
}

/// Counts of a BNO055 in 1 m/s^2 and in 1 deg/s.
const BNO055_ACC: f32 = 100.0;
/// See [`BNO055_ACC`].
const BNO055_GYR: f32 = 16.0;

/// The settings.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Config {
    /// The address.
    pub address: Address,
    /// Tries the other address when no chip of the family answers at this one.
    pub either_address: bool,
    /// Range of the accelerometer.
    pub acc_range: AccRange,
    /// Range of the gyroscope.
    pub gyr_range: GyrRange,
    /// Refresh rate of both.
    pub rate: Rate,
    /// Units of the samples.
    pub units: Units,
}

impl Config {
    /// The default settings: address 0x6A, +-8 g, +-1000 deg/s, 833 Hz.
    pub const DEFAULT: Self = Self {
        address: Address::Low,
        either_address: false,
        acc_range: AccRange::G8,
        gyr_range: GyrRange::Dps1000,
        rate: Rate::Hz833,
        units: Units::Chip,
    };

    /// Units of a count.
    #[must_use]
    pub const fn scale(&self) -> Scale {
        const RAD: f32 = core::f32::consts::PI / 180.0;
        let (acc_m_s2, gyr_rad_s) = match self.units {
            Units::Chip => (self.acc_range.mg() / 1000.0 * G, self.gyr_range.mdps() / 1000.0 * RAD),
            Units::Bno055 => (1.0 / BNO055_ACC, RAD / BNO055_GYR),
        };
        Scale { acc_m_s2, gyr_rad_s, mag_ut: 1.0 }
    }

    /// A sample of the chip's counts in the settings' units, rounded.
    #[must_use]
    pub fn convert(&self, mut raw: RawSample) -> RawSample {
        if self.units == Units::Bno055 {
            convert(&mut raw.acc, self.acc_share());
            convert(&mut raw.gyr, self.gyr_share());
        }
        raw
    }

    /// What a count of the chip is in the settings' units, times 65,536.
    const fn acc_share(&self) -> i32 {
        match self.units {
            Units::Chip => 1 << 16,
            Units::Bno055 => {
                (self.acc_range.mg() / 1000.0 * G * BNO055_ACC * 65_536.0 + 0.5) as i32
            }
        }
    }

    /// See [`Self::acc_share`].
    const fn gyr_share(&self) -> i32 {
        match self.units {
            Units::Chip => 1 << 16,
            Units::Bno055 => (self.gyr_range.mdps() / 1000.0 * BNO055_GYR * 65_536.0 + 0.5) as i32,
        }
    }

    /// Properties that a control loop needs in advance.
    #[must_use]
    pub const fn description(&self) -> Description {
        Description {
            scale: self.scale(),
            has_mag: false,
            gyr_lag_s: 1.0 / (2.0 * core::f32::consts::PI * self.rate.gyr_bandwidth_hz()),
            acc_range: ((ACC_RANGE as i64 * self.acc_share() as i64) >> 16) as u16,
            gyr_range: ((GYR_RANGE as i64 * self.gyr_share() as i64) >> 16) as u16,
            refresh_us: self.rate.period_us(),
            burst_bytes: sample::BURST.answer_len() as u32,
            rates_at: 0,
            stretch_us: 0,
            reserve_us: 300,
        }
    }

    /// What is sound in a burst.
    pub(crate) fn rules(&self) -> Rules {
        let rate = |deg_s: f32| (deg_s * 1000.0 / self.gyr_range.mdps()) as u16;
        Rules {
            // No word lies beyond the range of its sensor.
            acc_range: u16::MAX,
            gyr_range: u16::MAX,
            near: [(200.0 / self.acc_range.mg()) as u16, 0, rate(4.0)],
            jump: rate(250.0),
            disturbed_jump: rate(16.0),
            blow: (500.0 / self.acc_range.mg()) as u16,
            rattle: rate(330.0),
            still_us: STILL_US,
            has_acc_and_gyr: true,
            has_noisy_gyr: true,
            may_rest: false,
            needs_mag: false,
        }
    }

    /// The control registers from CTRL1_XL on.
    pub(crate) fn controls(&self, chip: Chip) -> [u8; reg::CONTROLS] {
        let rate = (self.rate as u8) << 4;
        let acc = rate | (self.acc_range as u8) << 2;
        let gyr = rate | (self.gyr_range as u8) << 1;
        let [ninth, tenth] = chip.last_controls();
        [acc, gyr, reg::BDU | reg::IF_INC, 0, 0, 0, 0, 0, ninth, tenth]
    }
}

/// Multiplies words by a share of 65,536; the largest share is below 1.2, and saturates.
fn convert(words: &mut [i16; 3], share: i32) {
    for word in words {
        let product = i32::from(*word).saturating_mul(share).saturating_add(0x8000) >> 16;
        *word = product.clamp(i16::MIN.into(), i16::MAX.into()) as i16;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 1 g are 4098 counts of 0.244 mg, and 981 of 0.01 m/s^2; 100 deg/s are 2857 of 35 mdeg/s,
    /// and 1600 of 1/16 deg/s.
    #[test]
    fn units_by_hand() {
        let raw = RawSample {
            acc: [4_098, -4_098, 32_767],
            gyr: [2_857, -2_857, 0],
            ..RawSample::default()
        };
        assert_eq!(Config::DEFAULT.convert(raw), raw);
        let config = Config { units: Units::Bno055, ..Config::DEFAULT };
        let RawSample { acc, gyr, .. } = config.convert(raw);
        assert_eq!((acc, gyr), ([981, -981, 7_841], [1_600, -1_600, 0]));
        let description = config.description();
        assert_eq!((description.acc_range, description.gyr_range), (7_824, 15_679));
        let widest = Config { acc_range: AccRange::G16, gyr_range: GyrRange::Dps2000, ..config };
        let ends = RawSample { acc: [i16::MAX; 3], gyr: [i16::MIN; 3], ..raw };
        let RawSample { acc, gyr, .. } = widest.convert(ends);
        assert_eq!((acc, gyr), ([15_681; 3], [i16::MIN; 3]));
    }
}
