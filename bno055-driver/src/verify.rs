//! Verification: chips reset themselves and come back with defaults, so that what was written is read again and again.

use crate::config::Config;
use crate::fault::SensorFault;
use crate::registers as reg;
use crate::status::{SystemError, SystemStatus};
use crate::transfer::Transfer;

/// The registers that must go on holding what was written, looked at in turn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Check {
    Mode,
    Page,
    Units,
    AxisMap,
    AxisSign,
    System,
    Power,
}

impl Check {
    /// The register after this one, in a circle.
    pub(crate) const fn next(self) -> Self {
        match self {
            Self::Mode => Self::Page,
            Self::Page => Self::Units,
            Self::Units => Self::AxisMap,
            Self::AxisMap => Self::AxisSign,
            Self::AxisSign => Self::System,
            Self::System => Self::Power,
            Self::Power => Self::Mode,
        }
    }

    /// The registers are read one by one so that the transfer fits between two bursts; status and error go together.
    pub(crate) const fn transfer(self) -> Transfer {
        match self {
            Self::Mode => Transfer::read(reg::OPR_MODE, 1),
            Self::Page => Transfer::read(reg::PAGE_ID, 1),
            Self::Units => Transfer::read(reg::UNIT_SEL, 1),
            Self::AxisMap => Transfer::read(reg::AXIS_MAP_CONFIG, 1),
            Self::AxisSign => Transfer::read(reg::AXIS_MAP_SIGN, 1),
            Self::System => Transfer::read(reg::SYS_STATUS, 2),
            Self::Power => Transfer::read(reg::PWR_MODE, 1),
        }
    }

    /// What is wrong with the answer, if anything is.
    pub(crate) fn judge(self, bytes: &[u8], config: &Config) -> Result<(), SensorFault> {
        // None of these registers is ever 0xFF.
        if bytes.first() == Some(&0xFF) {
            return Err(SensorFault::AllOnes);
        }
        let [map, sign] = config.axes.registers();
        let (register, mask, expected) = match self {
            Self::Mode => (reg::OPR_MODE, 0x0F, config.mode as u8),
            Self::Page => (reg::PAGE_ID, 0xFF, 0),
            Self::Units => (reg::UNIT_SEL, 0x97, config.units.register()),
            Self::AxisMap => (reg::AXIS_MAP_CONFIG, 0x3F, map),
            Self::AxisSign => (reg::AXIS_MAP_SIGN, 0x07, sign),
            Self::Power => (reg::PWR_MODE, 0x03, config.power as u8),
            Self::System => {
                let &[status, error] = bytes else {
                    return Err(SensorFault::Protocol);
                };
                return match SystemStatus::from_register(status) {
                    SystemStatus::Fusion if config.mode.is_fusion() => Ok(()),
                    SystemStatus::NoFusion if !config.mode.is_fusion() => Ok(()),
                    SystemStatus::Error => Err(SensorFault::System {
                        error: SystemError::from_register(error),
                    }),
                    _ => Err(SensorFault::Reset),
                };
            }
        };
        let &[found] = bytes else {
            return Err(SensorFault::Protocol);
        };
        match found & mask {
            found if found == expected => Ok(()),
            0 if self == Self::Mode => Err(SensorFault::Reset),
            _ => Err(SensorFault::Configuration { register, found }),
        }
    }
}
