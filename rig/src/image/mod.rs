//! The firmware image: how it is built, and what is in it.

mod build;
mod elf;

pub use build::{Builder, Source, build, build_in, workspace};

use std::collections::BTreeMap;
use std::io::Read;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Address at which the image begins: above the bootloader. One that is built with the feature
/// `no-bootloader` begins at 0.
pub const IMAGE_ADDRESS: u32 = 0x2000;

/// Longest ELF file that is read, bytes.
const LONGEST: u64 = 64 << 20;

/// Why there is no image.
#[derive(Debug, Error)]
pub enum ImageError {
    /// It does not build.
    #[error(transparent)]
    Build(#[from] std::io::Error),
    /// The file cannot be read.
    #[error("cannot read the image {}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The file is not an image for this chip.
    #[error("{name} is not an image for this chip: {reason}")]
    Format {
        /// The file's path, or the name that was given for its bytes.
        name: String,
        /// What is wrong.
        reason: String,
    },
}

/// The image's size in the chip's memories, bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sizes {
    /// Flash: code, constants and the initial values of variables.
    pub flash: u32,
    /// RAM for static variables; the stack has the rest.
    pub static_ram: u32,
}

/// A firmware image for the chip.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    address: u32,
    bytes: Vec<u8>,
    symbols: BTreeMap<String, u32>,
    sizes: Sizes,
    stack_top: u32,
}

impl Image {
    /// Reads an ELF file.
    ///
    /// # Errors
    /// [`ImageError::Read`], [`ImageError::Format`].
    pub fn open(path: &Path) -> Result<Self, ImageError> {
        let mut bytes = Vec::new();
        // What never ends is no image.
        let read =
            std::fs::File::open(path).and_then(|file| file.take(LONGEST).read_to_end(&mut bytes));
        read.map_err(|source| ImageError::Read { path: path.to_path_buf(), source })?;
        Self::parse(&path.display().to_string(), &bytes)
    }

    /// Parses the bytes of an ELF file; `name` stands for it in errors.
    ///
    /// # Errors
    /// [`ImageError::Format`].
    pub fn parse(name: &str, bytes: &[u8]) -> Result<Self, ImageError> {
        elf::parse(bytes).map_err(|reason| ImageError::Format { name: name.to_owned(), reason })
    }

    /// Address of the first byte: [`IMAGE_ADDRESS`], or 0 if it takes the bootloader's place.
    pub fn address(&self) -> u32 {
        self.address
    }

    /// The bytes that go into flash; gaps are 0xFF, as erased flash reads.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// Whether the image can check itself: only a build by `image-build` has its sums.
    pub fn is_sealed(&self) -> bool {
        let seal = self.bytes.get(image_build::SEAL);
        seal.is_some_and(|seal| seal.iter().any(|byte| *byte != 0))
    }

    /// The image's size in the chip's memories.
    pub fn sizes(&self) -> Sizes {
        self.sizes
    }

    /// The address from which the stack grows down.
    pub fn stack_top(&self) -> u32 {
        self.stack_top
    }

    /// Address of a symbol.
    pub fn symbol(&self, name: &str) -> Option<u32> {
        self.symbols.get(name).copied()
    }

    /// All symbols of code and data.
    pub fn symbols(&self) -> impl Iterator<Item = (&str, u32)> {
        self.symbols.iter().map(|(name, address)| (name.as_str(), *address))
    }

    /// The symbol at or before an address of code.
    pub fn symbol_at(&self, address: u32) -> Option<&str> {
        self.symbols
            .iter()
            .filter(|(_, at)| **at & !1 <= address)
            .max_by_key(|(_, at)| **at & !1)
            .map(|(name, _)| name.as_str())
    }
}

#[cfg(test)]
mod tests;
