//! Verification while sampling. A chip that resets itself has its defaults again, so the driver
//! reads the settings back over and over.

use crate::config::Config;
use crate::registers as reg;
use crate::status::SystemStatus;
use tvc_imu::{SensorFault, Transfer};

/// The registers that must keep the written values; each check's value is its register.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u8)]
pub(crate) enum Check {
    #[default]
    Mode = reg::OPR_MODE,
    Page = reg::PAGE_ID,
    Units = reg::UNIT_SEL,
    AxisMap = reg::AXIS_MAP_CONFIG,
    AxisSign = reg::AXIS_MAP_SIGN,
    System = reg::SYS_STATUS,
    Power = reg::PWR_MODE,
    /// The four identifications, which never change: they show whether the bus can be trusted. Not
    /// one of the round.
    Identity = reg::CHIP_ID,
}

impl Check {
    /// The check after this one, round and round.
    pub(crate) const fn next(self) -> Self {
        match self {
            Self::Mode => Self::Page,
            Self::Page => Self::Units,
            Self::Units => Self::AxisMap,
            Self::AxisMap => Self::AxisSign,
            Self::AxisSign => Self::System,
            Self::System => Self::Power,
            Self::Power | Self::Identity => Self::Mode,
        }
    }

    /// The read between two bursts: one register, or the four of the identity. With `again`, a read
    /// of the status includes the error in the next register.
    pub(crate) const fn transfer(self, again: bool) -> Transfer {
        let len = match self {
            Self::Identity => reg::IDS.len() as u8,
            Self::System if again => 2,
            _ => 1,
        };
        Transfer::read(self as u8, len)
    }

    /// The fault in the answer, if any. A chip that has reset itself has the data sheet's reset
    /// values (its table 4-2).
    pub(crate) fn judge(self, bytes: &[u8], config: &Config) -> Result<(), SensorFault> {
        // None of these registers is ever 0xFF.
        if bytes.contains(&0xFF) {
            return Err(SensorFault::AllOnes);
        }
        let [map, sign] = config.axes.registers();
        let (mask, expected, reset) = match self {
            Self::Mode => (0x0F, config.mode as u8, 0),
            Self::Page => (0xFF, 0, 0),
            Self::Units => (0x97, config.units.register(), 0x80),
            Self::AxisMap => (0x3F, map, 0x24),
            Self::AxisSign => (0x07, sign, 0),
            Self::Power => (0x03, config.power as u8, 0),
            Self::Identity => {
                let ids = bytes.try_into().map_err(|_| SensorFault::Protocol)?;
                return identify(ids, config);
            }
            Self::System => {
                let (status, error) = match *bytes {
                    [status] => (status, 0),
                    [status, error] => (status, error),
                    _ => return Err(SensorFault::Protocol),
                };
                return match SystemStatus::from_register(status) {
                    status if status == config.mode.status() => Ok(()),
                    SystemStatus::Error => Err(SensorFault::System { error }),
                    _ => Err(SensorFault::Reset),
                };
            }
        };
        let &[found] = bytes else {
            return Err(SensorFault::Protocol);
        };
        match found & mask {
            found if found == expected => Ok(()),
            found if found == reset => Err(SensorFault::Reset),
            _ => Err(SensorFault::Configuration { register: self as u8, found }),
        }
    }
}

/// The fault that identifications show, if any: CHIP_ID, ACC_ID, MAG_ID and GYR_ID.
pub(crate) fn identify(ids: [u8; 4], config: &Config) -> Result<(), SensorFault> {
    for (sensor, (found, right)) in (reg::CHIP_ID..).zip(ids.into_iter().zip(reg::IDS)) {
        if found == right || sensor == reg::MAG_ID && !config.needs_mag {
            continue;
        }
        return Err(match sensor {
            reg::CHIP_ID if found == 0xFF => SensorFault::AllOnes,
            reg::CHIP_ID => SensorFault::WrongChip { found },
            _ => SensorFault::DeadSensor { sensor, found },
        });
    }
    Ok(())
}
