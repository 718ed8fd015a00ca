//! Images: ELF files.

use super::{Outcome, usable};
use crate::flight::{profile, stack};
use rig::Image;

/// An image, its symbols and inlined functions, and the worst case of its stack.
pub fn image(bytes: &[u8], _: u64) -> Outcome {
    usable(profile::fuzzed(bytes))?;
    let Ok(image) = Image::parse("input", bytes) else {
        return Ok(());
    };
    let end = image.address() as usize + image.bytes().len();
    super::expect(end <= 0x3F800, "larger than the chip's flash")?;
    usable(stack::fuzzed(&image, bytes)).map(drop)
}
