//! The chips of the family, as far as they differ.

/// A chip of the family, by its identification.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum Chip {
    /// LSM6DS3 and LSM6DS33.
    Lsm6ds3 = 0x69,
    /// LSM6DSL, LSM6DSM and LSM6DS3TR-C.
    Lsm6dsl = 0x6A,
    /// LSM6DSO and LSM6DSOX.
    Lsm6dso = 0x6C,
}

impl Chip {
    /// The chip with this WHO_AM_I.
    #[must_use]
    pub const fn from_id(id: u8) -> Option<Self> {
        match id {
            0x69 => Some(Self::Lsm6ds3),
            0x6A => Some(Self::Lsm6dsl),
            0x6C => Some(Self::Lsm6dso),
            _ => None,
        }
    }

    /// CTRL9_XL and CTRL10_C after a reset: all axes of an LSM6DS3 run by these bits.
    pub(crate) const fn last_controls(self) -> [u8; 2] {
        match self {
            Self::Lsm6ds3 => [0x38, 0x38],
            Self::Lsm6dsl | Self::Lsm6dso => [0xE0, 0x00],
        }
    }

    /// Temperature of a count, degrees Celsius. 0 counts are 25 degrees.
    pub(crate) fn celsius(self, count: i16) -> f32 {
        let counts_a_degree = match self {
            Self::Lsm6ds3 => 16.0,
            Self::Lsm6dsl | Self::Lsm6dso => 256.0,
        };
        25.0 + f32::from(count) / counts_a_degree
    }

    /// Smallest change of the acceleration that the self-test of a sound chip makes, mg.
    #[cfg(feature = "self-test")]
    pub(crate) const fn self_test_least_mg(self) -> u16 {
        match self {
            Self::Lsm6ds3 | Self::Lsm6dsl => 90,
            Self::Lsm6dso => 50,
        }
    }
}
