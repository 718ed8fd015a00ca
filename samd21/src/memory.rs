//! Main flash and SRAM: 256 KB at 0, 32 KB at 0x2000_0000, as in the ATSAMD21x18A.
//!
//! Flash is shared between clones until one of them programs or erases it, so a snapshot of a chip
//! copies 32 KB. Page buffer, command timing and locks belong to NVMCTRL, not to this file; the
//! auxiliary rows (0x0080_0000 and up) as well. SRAM starts with noise, as after power-on, so
//! that code does not get by with zeros that it never wrote.

pub(crate) mod decode;

use std::ops::Range;
use std::sync::Arc;

use self::decode::Code;

/// Bytes of main flash, from address 0.
pub const FLASH_SIZE: u32 = 0x4_0000;
/// First address of SRAM.
pub const RAM_BASE: u32 = 0x2000_0000;
/// Bytes of SRAM.
pub const RAM_SIZE: u32 = 0x8000;

/// What instructions are executed from and on.
type Parts<'a> = (&'a Code, &'a [u8; FLASH_SIZE as usize], &'a mut [u8; RAM_SIZE as usize]);

/// Flash and SRAM.
#[derive(Clone)]
pub struct Memory {
    flash: Arc<[u8; FLASH_SIZE as usize]>,
    /// The flash, decoded.
    code: Code,
    ram: Box<[u8; RAM_SIZE as usize]>,
}

impl Memory {
    /// Erased flash (0xFF) and SRAM full of noise that only `seed` decides.
    pub fn new(seed: u64) -> Self {
        let mut memory = Self { flash: filled(0xFF).into(), code: Code::erased(), ram: filled(0) };
        let words = memory.ram.chunks_exact_mut(8);
        for (word, noise) in words.zip(noise(seed)) {
            word.copy_from_slice(&noise.to_le_bytes());
        }
        memory
    }

    /// All of main flash.
    pub fn flash(&self) -> &[u8; FLASH_SIZE as usize] {
        &self.flash
    }

    /// Writes main flash as a programmer would: no page buffer, no 1-to-0 rule. `None` if the bytes
    /// do not fit.
    pub fn load(&mut self, address: u32, bytes: &[u8]) -> Option<()> {
        let range = window(address, bytes.len(), 0, FLASH_SIZE)?;
        self.change(range, |cells| cells.copy_from_slice(bytes));
        Some(())
    }

    /// Decoded flash.
    pub(crate) fn code(&self) -> &Code {
        &self.code
    }

    /// Decoded flash, flash, and SRAM to write.
    #[inline]
    pub(crate) fn parts(&mut self) -> Parts<'_> {
        (&self.code, &self.flash, &mut self.ram)
    }

    /// Writes a part of flash and decodes it anew.
    fn change(&mut self, range: Range<usize>, write: impl FnOnce(&mut [u8])) {
        let (start, len) = (range.start, range.len());
        write(&mut Arc::make_mut(&mut self.flash)[range]);
        self.code.update(&self.flash, start, len);
    }

    /// All of SRAM.
    pub fn ram(&self) -> &[u8; RAM_SIZE as usize] {
        &self.ram
    }

    /// All of SRAM.
    pub fn ram_mut(&mut self) -> &mut [u8; RAM_SIZE as usize] {
        &mut self.ram
    }

    /// `len` bytes at `address` where they lie wholly in flash or wholly in SRAM.
    pub fn bytes(&self, address: u32, len: usize) -> Option<&[u8]> {
        if let Some(range) = window(address, len, RAM_BASE, RAM_SIZE) {
            return self.ram.get(range);
        }
        self.flash.get(window(address, len, 0, FLASH_SIZE)?)
    }

    /// `len` bytes of SRAM at `address` to write, where they lie wholly in it.
    pub fn ram_bytes_mut(&mut self, address: u32, len: usize) -> Option<&mut [u8]> {
        self.ram.get_mut(window(address, len, RAM_BASE, RAM_SIZE)?)
    }

    /// The little-endian half-word at `address` of flash or SRAM; need not be aligned.
    pub fn read_u16(&self, address: u32) -> Option<u16> {
        self.bytes(address, 2).map(|bytes| u16::from_le_bytes([bytes[0], bytes[1]]))
    }

    /// The little-endian word at `address` of flash or SRAM; need not be aligned.
    pub fn read_u32(&self, address: u32) -> Option<u32> {
        self.bytes(address, 4)
            .map(|bytes| u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]))
    }

    /// Writes a little-endian word to SRAM; `None`, and nothing is written, outside of it.
    #[must_use]
    pub fn write_u32(&mut self, address: u32, value: u32) -> Option<()> {
        self.ram_bytes_mut(address, 4)?.copy_from_slice(&value.to_le_bytes());
        Some(())
    }

    /// Programs flash as the array does: bits go from 1 to 0 only. `None`, and nothing is
    /// written, outside of flash.
    #[must_use]
    pub fn program(&mut self, address: u32, bytes: &[u8]) -> Option<()> {
        self.change(window(address, bytes.len(), 0, FLASH_SIZE)?, |cells| {
            for (cell, byte) in cells.iter_mut().zip(bytes) {
                *cell &= byte;
            }
        });
        Some(())
    }

    /// Erases `len` bytes of flash to 0xFF. `None`, and nothing is erased, outside of flash.
    #[must_use]
    pub fn erase(&mut self, address: u32, len: usize) -> Option<()> {
        self.change(window(address, len, 0, FLASH_SIZE)?, |cells| cells.fill(0xFF));
        Some(())
    }

    /// An erase or a write that was interrupted, since which flash at `address` differs from
    /// `before`: each changed bit keeps its new value with a probability of `share`, else it gets
    /// its old one. `None`, and nothing is undone, outside of flash.
    #[must_use]
    pub(crate) fn undo_in_part(
        &mut self,
        address: u32,
        before: &[u8],
        share: f64,
        seed: u64,
    ) -> Option<()> {
        let range = window(address, before.len(), 0, FLASH_SIZE)?;
        let threshold = (share * 2.0_f64.powi(64)) as u64;
        let mut noise = noise(seed);
        self.change(range, |cells| {
            for (cell, before) in cells.iter_mut().zip(before) {
                for bit in (0..8).map(|bit| 1 << bit) {
                    let is_done = noise.next().is_some_and(|noise| noise < threshold);
                    if !is_done {
                        *cell = *cell & !bit | before & bit;
                    }
                }
            }
        });
        Some(())
    }
}

/// Numbers that only `seed` decides: SplitMix64 (Steele, Lea, Flood 2014), full-period for any.
fn noise(seed: u64) -> impl Iterator<Item = u64> {
    let states =
        std::iter::successors(Some(seed), |state| Some(state.wrapping_add(0x9E37_79B9_7F4A_7C15)));
    states.skip(1).map(|state| {
        let z = (state ^ (state >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    })
}

/// An array that is made on the heap: it is too large for a stack.
pub(crate) fn filled<T: Clone, const N: usize>(value: T) -> Box<[T; N]> {
    let Ok(array) = vec![value; N].into_boxed_slice().try_into() else {
        unreachable!("the vector was made N long");
    };
    array
}

/// Where `len` bytes at `address` lie in a memory of `size` bytes at `base`.
fn window(address: u32, len: usize, base: u32, size: u32) -> Option<Range<usize>> {
    let start = address.checked_sub(base)? as usize;
    let end = start.checked_add(len)?;
    (end <= size as usize).then_some(start..end)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn windows_end_where_the_memories_end() {
        let mut memory = Memory::new(1);
        assert!(memory.bytes(FLASH_SIZE - 4, 4).is_some());
        assert!(memory.bytes(FLASH_SIZE - 3, 4).is_none());
        assert!(memory.bytes(RAM_BASE + RAM_SIZE - 4, 4).is_some());
        assert!(memory.bytes(RAM_BASE + RAM_SIZE - 3, 4).is_none());
        assert!(memory.bytes(RAM_BASE - 1, 1).is_none());
        assert!(memory.bytes(u32::MAX, usize::MAX).is_none());
        assert!(memory.ram_bytes_mut(0, 4).is_none(), "flash is not SRAM");
        assert_eq!(memory.write_u32(RAM_BASE - 4, 0), None);
    }

    #[test]
    fn programming_clears_bits_and_erasing_sets_them() {
        let mut memory = Memory::new(1);
        assert_eq!(memory.program(0x2000, &[0xF0, 0x0F]), Some(()));
        assert_eq!(memory.program(0x2000, &[0xAA, 0xFF]), Some(()));
        assert_eq!(memory.read_u16(0x2000), Some(0x0FA0));
        assert_eq!(memory.erase(0x2000, 1), Some(()));
        assert_eq!(memory.read_u16(0x2000), Some(0x0FFF));
        assert_eq!(memory.program(FLASH_SIZE - 1, &[0, 0]), None);
        assert_eq!(memory.bytes(FLASH_SIZE - 1, 1), Some(&[0xFF][..]));
    }

    #[test]
    fn what_is_undone_in_part_has_bits_of_before_and_of_now() {
        let mut memory = Memory::new(1);
        assert_eq!(memory.program(0x2000, &[0; 256]), Some(()));
        let undone = |share| {
            let mut memory = memory.clone();
            assert_eq!(memory.undo_in_part(0x2000, &[0xF0; 256], share, 1), Some(()));
            let cells = memory.bytes(0x2000, 256).unwrap().to_vec();
            assert!(cells.iter().all(|cell| cell & 0x0F == 0), "never changed");
            cells.iter().map(|cell| cell.count_ones()).sum::<u32>()
        };
        assert_eq!((undone(0.0), undone(1.0)), (1024, 0));
        // A quarter of 1,024 bits is as it was, to within four standard deviations.
        assert!(undone(0.75).abs_diff(256) < 56, "{}", undone(0.75));
        assert_eq!(memory.undo_in_part(FLASH_SIZE - 1, &[0; 2], 0.5, 1), None);
    }

    #[test]
    fn a_clone_keeps_its_own_flash_and_ram() {
        let mut first = Memory::new(1);
        let second = first.clone();
        assert_eq!(first.program(0, &[0]), Some(()));
        assert_eq!(first.write_u32(RAM_BASE, 0x1234_5678), Some(()));
        assert_eq!(first.read_u32(RAM_BASE), Some(0x1234_5678));
        assert_eq!(second.bytes(0, 1), Some(&[0xFF][..]));
        assert_ne!(second.read_u32(RAM_BASE), Some(0x1234_5678));
    }

    #[test]
    fn noise_depends_on_the_seed_alone() {
        assert_eq!(Memory::new(7).ram(), Memory::new(7).ram());
        assert_ne!(Memory::new(7).ram(), Memory::new(8).ram());
    }
}
