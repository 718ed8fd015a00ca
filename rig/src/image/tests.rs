//! An image for tests that need no ELF file.

use super::*;

impl Image {
    /// An image of the bare bytes that belong at [`IMAGE_ADDRESS`], without symbols.
    pub(crate) fn from_raw(name: &str, bytes: Vec<u8>) -> Result<Self, ImageError> {
        Ok(Self {
            address: IMAGE_ADDRESS,
            stack_top: elf::stack_top(&bytes)
                .map_err(|reason| ImageError::Format { name: name.to_owned(), reason })?,
            symbols: BTreeMap::new(),
            sizes: Sizes { flash: bytes.len() as u32, static_ram: 0 },
            bytes,
        })
    }
}
