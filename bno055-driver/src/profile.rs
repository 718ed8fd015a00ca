//! The chip's own calibration: offsets, radii and soft iron, for its fusion modes.
//!
//! In the non-fusion modes the outputs are uncompensated (data sheet section 3.11.4). A host with
//! its own filter calibrates them itself and needs no profile.

use core::fmt;

use crc::{CRC_32_ISO_HDLC, Crc, NoTable};

use crate::mode::Mode;
use crate::registers;
use crate::sensors::Sensors;
use crate::words;

/// Calibration profile: the values that fusion has learned or starts with.
///
/// The chip silently drops values out of range and then refuses to run fusion. So the driver calls
/// [`Profile::check`] first and reads every byte back. A chip that calibrates itself overwrites the
/// profile with time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Profile {
    /// Accelerometer offsets, counts: 1 mg, at most the sensor's range.
    pub acc_offset: [i16; 3],
    /// Magnetometer offsets, counts: 1/16 uT, +-6400.
    pub mag_offset: [i16; 3],
    /// Gyroscope offsets, counts: 1/16 deg/s, at most the sensor's range.
    pub gyr_offset: [i16; 3],
    /// Accelerometer radius, +-1000.
    pub acc_radius: i16,
    /// Magnetometer radius, +-960.
    pub mag_radius: i16,
}

/// The reason why stored bytes are no profile, or why the chip cannot take a profile.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ProfileError {
    /// Too short, or not a profile at all.
    Format,
    /// Stored by an unknown version.
    Version(u8),
    /// The checksum does not match.
    Checksum,
    /// A value out of its range.
    Range {
        /// Register of the value's low byte.
        register: u8,
        /// The value.
        value: i16,
    },
}

impl fmt::Display for ProfileError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Format => f.write_str("not a calibration profile"),
            Self::Version(version) => write!(f, "profile of unknown version {version}"),
            Self::Checksum => f.write_str("profile checksum does not match"),
            Self::Range { register, value } => {
                write!(f, "profile register 0x{register:02X}: {value} out of range")
            }
        }
    }
}

impl core::error::Error for ProfileError {}

impl Profile {
    /// Size of the stored form.
    pub const STORED_LEN: usize = 30;
    /// Size of the chip's register block.
    pub const REGISTERS_LEN: usize = 22;
    const MAGIC: [u8; 3] = *b"BNO";
    const VERSION: u8 = 1;

    /// The eleven values in the order of their registers, and a word that fills the array.
    fn words(&self) -> [[i16; 3]; 4] {
        let radii = [self.acc_radius, self.mag_radius, 0];
        [self.acc_offset, self.mag_offset, self.gyr_offset, radii]
    }

    /// The block of registers 0x55 to 0x6A.
    pub fn registers(&self) -> [u8; Self::REGISTERS_LEN] {
        let mut registers = [0; Self::REGISTERS_LEN];
        words::encode(&mut registers, self.words().as_flattened());
        registers
    }

    /// The profile in a block of registers 0x55 to 0x6A.
    pub fn from_registers(bytes: &[u8; Self::REGISTERS_LEN]) -> Self {
        let mut words = [[0; 3]; 4];
        words::decode(words.as_flattened_mut(), bytes);
        let [acc_offset, mag_offset, gyr_offset, [acc_radius, mag_radius, _]] = words;
        Self { acc_offset, mag_offset, gyr_offset, acc_radius, mag_radius }
    }

    /// Whether the chip will take every value (data sheet sections 3.6.4 and 3.6.5, tables 3-16 to
    /// 3-21).
    ///
    /// # Errors
    /// The first value out of range. Fusion modes set the gyroscope's range themselves, to the
    /// widest.
    pub fn check(&self, mode: Mode, sensors: &Sensors) -> Result<(), ProfileError> {
        let acc = 1000 * u16::from(sensors.acc_range.g());
        let gyr = 16 * sensors.gyr_range_in(mode).dps();
        let limits: [u16; 11] = [acc, acc, acc, 6400, 6400, 6400, gyr, gyr, gyr, 1000, 960];
        let registers = (registers::ACC_OFFSET..).step_by(2);
        for ((&value, limit), register) in
            self.words().as_flattened().iter().zip(limits).zip(registers)
        {
            if value.unsigned_abs() > limit {
                return Err(ProfileError::Range { register, value });
            }
        }
        Ok(())
    }

    /// The first register whose value [`check`](Self::check) refuses.
    pub(crate) fn wrong_register(&self, mode: Mode, sensors: &Sensors) -> Option<u8> {
        match self.check(mode, sensors) {
            Err(ProfileError::Range { register, .. }) => Some(register),
            _ => None,
        }
    }

    /// The stored form: a mark, a version, the register block, and a CRC-32 of these.
    pub fn to_bytes(&self) -> [u8; Self::STORED_LEN] {
        let mut bytes = [0; Self::STORED_LEN];
        let [m0, m1, m2, version, block @ .., _, _, _, _] = &mut bytes;
        ([*m0, *m1, *m2], *version, *block) = (Self::MAGIC, Self::VERSION, self.registers());
        if let Some((content, crc)) = bytes.split_last_chunk_mut::<4>() {
            *crc = CRC.checksum(content).to_le_bytes();
        }
        bytes
    }

    /// The profile in its stored form; bytes after it are ignored.
    ///
    /// # Errors
    /// Anything but the untouched result of [`Profile::to_bytes`].
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, ProfileError> {
        let stored = bytes.first_chunk::<{ Self::STORED_LEN }>().ok_or(ProfileError::Format)?;
        let &[m0, m1, m2, version, ref block @ .., c0, c1, c2, c3] = stored;
        let content = stored.first_chunk::<{ Self::STORED_LEN - 4 }>();
        match content.map(|content| CRC.checksum(content)) {
            _ if [m0, m1, m2] != Self::MAGIC => Err(ProfileError::Format),
            _ if version != Self::VERSION => Err(ProfileError::Version(version)),
            Some(crc) if crc == u32::from_le_bytes([c0, c1, c2, c3]) => {
                Ok(Self::from_registers(block))
            }
            _ => Err(ProfileError::Checksum),
        }
    }
}

/// CRC-32 of IEEE 802.3, bit by bit: for 26 bytes a table would not pay.
const CRC: Crc<u32, NoTable> = Crc::<u32, NoTable>::new(&CRC_32_ISO_HDLC);

/// Soft-iron matrix, row by row, as the chip holds it (registers 0x43 to 0x54).
///
/// The data sheet gives no scale. Chips in the field hold 0x4000 on the diagonal, so 2^14 is 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SoftIron(pub [[i16; 3]; 3]);

impl SoftIron {
    /// No correction.
    pub const IDENTITY: Self = Self([[0x4000, 0, 0], [0, 0x4000, 0], [0, 0, 0x4000]]);
    /// Size of the chip's register block.
    pub const REGISTERS_LEN: usize = 18;

    /// The block of registers 0x43 to 0x54.
    pub fn registers(&self) -> [u8; Self::REGISTERS_LEN] {
        let mut registers = [0; Self::REGISTERS_LEN];
        words::encode(&mut registers, self.0.as_flattened());
        registers
    }

    /// The matrix in a block of registers 0x43 to 0x54.
    pub fn from_registers(bytes: &[u8; Self::REGISTERS_LEN]) -> Self {
        let mut matrix = [[0; 3]; 3];
        words::decode(matrix.as_flattened_mut(), bytes);
        Self(matrix)
    }
}

impl Default for SoftIron {
    fn default() -> Self {
        Self::IDENTITY
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensors::{AccRange, GyrRange};

    const PROFILE: Profile = Profile {
        acc_offset: [-24, 13, 5],
        mag_offset: [-301, 6400, 77],
        gyr_offset: [-1, 0, 2],
        acc_radius: 1000,
        mag_radius: 712,
    };

    #[test]
    fn crc_is_the_ieee_one() {
        assert_eq!(CRC.checksum(b"123456789"), 0xCBF4_3926);
    }

    #[test]
    fn register_block_is_little_endian_in_register_order() {
        let block = PROFILE.registers();
        assert_eq!(block[..2], [0xE8, 0xFF]);
        assert_eq!(block[8..10], [0x00, 0x19]);
        assert_eq!(block[20..], [0xC8, 0x02]);
        assert_eq!(Profile::from_registers(&block), PROFILE);
    }

    #[test]
    fn stored_form_survives_and_every_flipped_bit_is_refused() {
        let stored = PROFILE.to_bytes();
        assert_eq!(Profile::from_bytes(&stored), Ok(PROFILE));
        for bit in 0..8 * Profile::STORED_LEN {
            let mut bad = stored;
            bad[bit / 8] ^= 1 << (bit % 8);
            assert!(Profile::from_bytes(&bad).is_err(), "bit {bit}");
        }
        for len in 0..Profile::STORED_LEN {
            assert_eq!(Profile::from_bytes(&stored[..len]), Err(ProfileError::Format));
        }
    }

    #[test]
    fn other_versions_are_named() {
        let mut bytes = PROFILE.to_bytes();
        bytes[3] = 2;
        assert_eq!(Profile::from_bytes(&bytes), Err(ProfileError::Version(2)));
    }

    #[test]
    fn values_out_of_range_are_named_with_their_register() {
        let sensors =
            Sensors { acc_range: AccRange::G2, gyr_range: GyrRange::Dps125, ..Sensors::default() };
        assert_eq!(PROFILE.check(Mode::Ndof, &sensors), Ok(()));
        let range = |register, value| Err(ProfileError::Range { register, value });
        let with = |change: fn(&mut Profile)| {
            let mut profile = PROFILE;
            change(&mut profile);
            profile
        };
        assert_eq!(
            with(|p| p.acc_offset[1] = -2001).check(Mode::Ndof, &sensors),
            range(0x57, -2001)
        );
        assert_eq!(
            with(|p| p.mag_offset[2] = 0x218C).check(Mode::Ndof, &sensors),
            range(0x5F, 0x218C)
        );
        assert_eq!(with(|p| p.gyr_offset[0] = 2001).check(Mode::Ndof, &sensors), Ok(()));
        assert_eq!(with(|p| p.gyr_offset[0] = 2001).check(Mode::Amg, &sensors), range(0x61, 2001));
        assert_eq!(
            with(|p| p.acc_radius = i16::MIN).check(Mode::Ndof, &sensors),
            range(0x67, i16::MIN)
        );
        assert_eq!(with(|p| p.mag_radius = 961).check(Mode::Ndof, &sensors), range(0x69, 961));
    }

    #[test]
    fn soft_iron_block_round_trips() {
        let matrix = SoftIron([[0x4000, -3, 5], [7, 0x3F00, -11], [13, -17, 0x4100]]);
        assert_eq!(matrix.registers()[..4], [0x00, 0x40, 0xFD, 0xFF]);
        assert_eq!(SoftIron::from_registers(&matrix.registers()), matrix);
    }
}
