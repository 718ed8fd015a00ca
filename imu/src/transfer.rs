//! The exchange between a driver and the owner of the bus: transfers and their outcomes.

/// Longest time of a transfer before the owner of the bus reports [`BusError::Timeout`], us.
///
/// The longest transfer, 29 bytes at 100 kHz with 0.2 ms of clock stretching a byte, takes about
/// 8.4 ms.
pub const TRANSFER_DEADLINE_US: u64 = 15_000;

/// Longest payload of a write.
pub const WRITE_MAX: usize = 22;

/// Longest answer to a read.
pub const READ_MAX: usize = 26;

/// Bytes of a write, held inline, in whole machine words: small cores copy words faster.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(align(4))]
pub struct Bytes {
    bytes: [u8; WRITE_MAX],
    len: u8,
}

impl Bytes {
    /// The payload `bytes`.
    #[must_use]
    pub fn new<const N: usize>(bytes: [u8; N]) -> Self {
        const { assert!(N <= WRITE_MAX) };
        let mut inline = [0; WRITE_MAX];
        for (to, from) in inline.iter_mut().zip(bytes) {
            *to = from;
        }
        Self { bytes: inline, len: N as u8 }
    }

    /// The payload `bytes`; `None` for more than [`WRITE_MAX`].
    #[must_use]
    pub fn from_slice(bytes: &[u8]) -> Option<Self> {
        let mut inline = [0; WRITE_MAX];
        inline.get_mut(..bytes.len())?.copy_from_slice(bytes);
        Some(Self { bytes: inline, len: bytes.len() as u8 })
    }

    /// The payload.
    #[must_use]
    pub fn as_slice(&self) -> &[u8] {
        self.bytes.get(..usize::from(self.len)).unwrap_or(&self.bytes)
    }
}

impl core::ops::Deref for Bytes {
    type Target = [u8];
    fn deref(&self) -> &[u8] {
        self.as_slice()
    }
}

/// One I2C transaction with a chip.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Transfer {
    /// Write the register's address, repeated start, read `len` bytes.
    Read {
        /// First register.
        register: u8,
        /// Number of bytes, 1 to [`READ_MAX`].
        len: u8,
    },
    /// Write the register's address and then the bytes.
    Write {
        /// First register.
        register: u8,
        /// The bytes to write.
        bytes: Bytes,
    },
}

impl Transfer {
    /// A read of `len` bytes from `register` on.
    #[must_use]
    pub const fn read(register: u8, len: u8) -> Self {
        Self::Read { register, len }
    }

    /// A write of `bytes` from `register` on.
    #[must_use]
    pub fn write<const N: usize>(register: u8, bytes: [u8; N]) -> Self {
        Self::Write { register, bytes: Bytes::new(bytes) }
    }

    /// How many bytes a successful outcome holds: 0 for a write.
    #[must_use]
    pub const fn answer_len(&self) -> usize {
        match self {
            Self::Read { len, .. } => *len as usize,
            Self::Write { .. } => 0,
        }
    }
}

/// The outcome of a transfer: the bytes read, none for a write, or how it failed.
pub type Transferred<'a> = Result<&'a [u8], BusError>;

/// How a transfer failed, as a bus master sees it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum BusError {
    /// Address or data byte not acknowledged.
    Nak,
    /// Not finished at the deadline (see [`TRANSFER_DEADLINE_US`]).
    Timeout,
    /// SDA or SCL held low, or the bus never idle.
    Stuck,
    /// Another master, or noise, won the bus.
    Arbitration,
    /// Misplaced start or stop, wrong length, or anything else that should not happen.
    Protocol,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inline_bytes_keep_their_length() {
        assert_eq!(Bytes::new([1, 2, 3]).as_slice(), [1, 2, 3]);
        assert_eq!(Bytes::new([9; WRITE_MAX]).len(), WRITE_MAX);
        assert_eq!(Bytes::from_slice(&[1, 2]), Some(Bytes::new([1, 2])));
        assert_eq!(Bytes::from_slice(&[0; WRITE_MAX + 1]), None);
    }
}
