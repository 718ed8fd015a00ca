//! The registers of a set-up: values, order, and the bits that must read as written.

use crate::config::Config;
use crate::registers as reg;
use tvc_imu::Transfer;

/// A read without effect.
const NOTHING: Transfer = Transfer::read(reg::PAGE_ID, 1);

/// Registers to write and read back, in this order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Setting {
    Power,
    Units,
    Axes,
    SoftIron,
    Profile,
    PageOne,
    Sensors,
    /// Read only.
    UniqueId,
    PageZero,
}

impl Setting {
    /// The next setting that `config` needs.
    pub(crate) fn next(self, config: &Config) -> Option<Self> {
        let next = match self {
            Self::Power => Self::Units,
            Self::Units => Self::Axes,
            Self::Axes => Self::SoftIron,
            Self::SoftIron => Self::Profile,
            Self::Profile => Self::PageOne,
            Self::PageOne => Self::Sensors,
            Self::Sensors => Self::UniqueId,
            Self::UniqueId => Self::PageZero,
            Self::PageZero => return None,
        };
        match next {
            Self::SoftIron if config.soft_iron.is_none() => Self::SoftIron.next(config),
            Self::Profile if config.profile.is_none() => Self::Profile.next(config),
            _ => Some(next),
        }
    }

    /// The transfer that writes the setting, or reads a setting that is only read.
    pub(crate) fn write(self, config: &Config) -> Transfer {
        match self {
            Self::Power => Transfer::write(reg::PWR_MODE, [config.power as u8]),
            Self::Units => Transfer::write(reg::UNIT_SEL, [config.units.register()]),
            Self::Axes => Transfer::write(reg::AXIS_MAP_CONFIG, config.axes.registers()),
            // Without a matrix or profile, `next` leaves the setting out.
            Self::SoftIron => config
                .soft_iron
                .map_or(NOTHING, |it| Transfer::write(reg::SIC_MATRIX, it.registers())),
            Self::Profile => config
                .profile
                .map_or(NOTHING, |it| Transfer::write(reg::ACC_OFFSET, it.registers())),
            Self::PageOne => Transfer::write(reg::PAGE_ID, [1]),
            Self::Sensors => Transfer::write(reg::ACC_CONFIG, config.sensors.registers()),
            Self::UniqueId => Transfer::read(reg::UNIQUE_ID, 16),
            Self::PageZero => Transfer::write(reg::PAGE_ID, [0]),
        }
    }

    /// The transfer that reads the setting back.
    pub(crate) fn read(self, config: &Config) -> Transfer {
        match self.write(config) {
            Transfer::Write { register, bytes } => Transfer::read(register, bytes.len() as u8),
            read @ Transfer::Read { .. } => read,
        }
    }

    /// Bits of a byte that must read as written; the others are reserved or set by the chip itself.
    pub(crate) fn mask(self, config: &Config, offset: usize) -> u8 {
        match (self, offset) {
            (Self::Power, _) => 0x03,
            (Self::Units, _) => 0x97,
            (Self::Axes, 0) => 0x3F,
            (Self::Axes, _) => 0x07,
            // In fusion modes the chip sets everything except the accelerometer's range.
            (Self::Sensors, 0) if config.mode.is_fusion() => 0x03,
            (Self::Sensors, _) if config.mode.is_fusion() => 0x00,
            (Self::Sensors, 1) => 0x7F,
            (Self::Sensors, 2) => 0x3F,
            (Self::Sensors, 3) => 0x07,
            _ => 0xFF,
        }
    }
}
