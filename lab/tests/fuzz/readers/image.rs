//! Images: ELF files.

use super::{Outcome, usable};
use lab::profile::symbols::Symbols;
use lab::stack;
use rig::Image;

/// An image, its symbols and inlined functions, and the worst case of its stack.
pub fn image(bytes: &[u8], _: u64) -> Outcome {
    if let Some(mut symbols) = usable(Symbols::read(bytes))? {
        for address in (0x2000..0x2400).step_by(2) {
            super::expect(!symbols.path(address).is_empty(), "an address in no function")?;
        }
    }
    let Ok(image) = Image::parse("input", bytes) else {
        return Ok(());
    };
    let end = image.address() as usize + image.bytes().len();
    super::expect(end <= 0x3F800, "larger than the chip's flash")?;
    usable(stack::worst_case(&image, bytes)).map(drop)
}
