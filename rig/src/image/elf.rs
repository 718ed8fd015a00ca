//! Reads an image out of an ELF file.

use std::collections::BTreeMap;

use super::{IMAGE_ADDRESS, Image, Sizes};
use object::elf::{EM_ARM, FileHeader32, PT_LOAD, ProgramHeader32, SHF_ALLOC};
use object::read::elf::{ElfFile32, FileHeader, ProgramHeader, SectionHeader};
use object::{Endianness, Object, ObjectSymbol, SymbolKind};

const FLASH_END: u32 = 0x0003_F800;
/// Most bytes of names, as a multiple of the file's length. Names may end in the same bytes, but
/// those of a file of some bytes must not fill the memory.
const MOST_NAMES: usize = 4;
const RAM: std::ops::Range<u32> = 0x2000_0000..0x2000_8000;

pub(super) fn parse(bytes: &[u8]) -> Result<Image, String> {
    let file = ElfFile32::<Endianness>::parse(bytes).map_err(|e| e.to_string())?;
    let header: &FileHeader32<Endianness> = file.elf_header();
    let endian = file.endian();
    if header.e_machine(endian) != EM_ARM {
        return Err("it is for another processor".to_owned());
    }
    let loads = |segment: &&ProgramHeader32<Endianness>| {
        segment.p_type(endian) == PT_LOAD && segment.p_filesz(endian) != 0
    };
    let segments = || file.elf_program_headers().iter().filter(loads);
    let address = match segments().map(|segment| segment.p_paddr(endian)).min() {
        Some(0) => 0,
        _ => IMAGE_ADDRESS,
    };
    let mut flash = Vec::new();
    for segment in segments() {
        let data = segment
            .data(endian, bytes)
            .map_err(|()| "a segment lies outside of the file".to_owned())?;
        place(&mut flash, address, segment.p_paddr(endian), data)?;
    }
    let stack_top = stack_top(&flash)?;
    let mut static_ram = 0_u32;
    for section in file.elf_section_table().iter() {
        let address = section.sh_addr(endian);
        let allocated = section.sh_flags(endian).0 & SHF_ALLOC.0 != 0;
        if allocated && (RAM.start..stack_top).contains(&address) {
            // A section is no larger than the memory that it lies in.
            let behind = static_ram.checked_add(section.sh_size(endian));
            static_ram = behind
                .filter(|bytes| *bytes <= stack_top - RAM.start)
                .ok_or("its variables need more than the chip's RAM")?;
        }
    }
    let mut names = 0;
    let mut symbols = BTreeMap::new();
    let found = file
        .symbols()
        .filter(|symbol| {
            matches!(symbol.kind(), SymbolKind::Text | SymbolKind::Data | SymbolKind::Unknown)
        })
        .filter_map(|symbol| Some((symbol.name().ok()?, symbol.address() as u32)))
        .filter(|(name, _)| !name.is_empty() && !name.starts_with('$'));
    for (name, symbol_address) in found {
        names += name.len();
        if names > MOST_NAMES * bytes.len() {
            return Err("the names of its symbols are the same bytes again and again".to_owned());
        }
        symbols.insert(name.to_owned(), symbol_address);
    }
    Ok(Image {
        sizes: Sizes { flash: flash.len() as u32, static_ram },
        address,
        bytes: flash,
        symbols,
        stack_top,
    })
}

/// The initial stack pointer: the first word of the vector table at the beginning of `flash`.
pub(super) fn stack_top(flash: &[u8]) -> Result<u32, String> {
    let Some(&[b0, b1, b2, b3, _, _, _, _]) = flash.first_chunk::<8>() else {
        return Err("it holds no vector table".to_owned());
    };
    let top = u32::from_le_bytes([b0, b1, b2, b3]);
    if !(top.is_multiple_of(4) && RAM.start < top && top <= RAM.end) {
        return Err(format!("its stack would begin at 0x{top:08x}"));
    }
    Ok(top)
}

/// Copies a segment to its place in `flash`, which begins at `image`; a gap before it is filled as
/// erased flash reads.
fn place(flash: &mut Vec<u8>, image: u32, address: u32, data: &[u8]) -> Result<(), String> {
    let end = u64::from(address) + data.len() as u64;
    if address < image || end > u64::from(FLASH_END) {
        return Err(format!(
            "a segment of {} bytes at 0x{address:x} lies outside of the image's flash \
             (0x{image:x} to 0x{FLASH_END:x})",
            data.len()
        ));
    }
    let start = (address - image) as usize;
    let end = start + data.len();
    if flash.len() < end {
        flash.resize(end, 0xFF);
    }
    flash[start..end].copy_from_slice(data);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An ELF file by hand: one segment in flash, one section of RAM, no symbols.
    fn elf(machine: u16, address: u32, code: &[u8]) -> Vec<u8> {
        let mut file = vec![0x7F, b'E', b'L', b'F', 1, 1, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0];
        let half = |file: &mut Vec<u8>, v: u16| file.extend(v.to_le_bytes());
        let words = |file: &mut Vec<u8>, v: &[u32]| {
            file.extend(v.iter().flat_map(|w| w.to_le_bytes()));
        };
        let sections = 84 + code.len() as u32;
        half(&mut file, 2);
        half(&mut file, machine);
        words(&mut file, &[1, address + 9, 52, sections, 0]);
        for v in [52, 32, 1, 40, 3, 2] {
            half(&mut file, v);
        }
        let size = code.len() as u32;
        words(&mut file, &[PT_LOAD.0, 84, address, address, size, size, 5, 4]);
        file.extend(code);
        words(&mut file, &[0; 10]);
        // A section of 100 bytes of zeroed RAM, then the table of names.
        words(&mut file, &[1, 8, 3, 0x2000_0010, 84, 100, 0, 0, 4, 0]);
        words(&mut file, &[1, 3, 0, 0, sections + 120, 6, 0, 0, 1, 0]);
        file.extend(b"\0.bss\0");
        file
    }

    fn code(stack: u32) -> Vec<u8> {
        [stack, 0x2009, 0xE7FE_E7FE].iter().flat_map(|w: &u32| w.to_le_bytes()).collect()
    }

    #[test]
    fn finds_flash_ram_and_stack() {
        let image = Image::parse("x", &elf(40, 0x2000, &code(0x2000_7800))).unwrap();
        assert_eq!(image.bytes(), code(0x2000_7800));
        assert_eq!(image.sizes(), Sizes { flash: 12, static_ram: 100 });
        assert_eq!(image.stack_top(), 0x2000_7800);
    }

    #[test]
    fn an_image_may_take_the_bootloaders_place() {
        let image = Image::parse("x", &elf(40, 0x0, &code(0x2000_7800))).unwrap();
        assert_eq!(image.address(), 0);
        assert_eq!(image.bytes(), code(0x2000_7800));
        let image = Image::parse("x", &elf(40, 0x2000, &code(0x2000_7800))).unwrap();
        assert_eq!(image.address(), IMAGE_ADDRESS);
    }

    #[test]
    fn refuses_what_is_not_for_this_chip() {
        let refusal = |file: &[u8]| Image::parse("x.elf", file).unwrap_err().to_string();
        assert!(refusal(b"hello").contains("x.elf is not an image for this chip"));
        assert!(refusal(&elf(62, 0x2000, &code(0x2000_7800))).contains("another processor"));
        assert!(
            refusal(&elf(40, 0x1000, &code(0x2000_7800))).contains("outside of the image's flash")
        );
        assert!(refusal(&elf(40, 0x2000, &code(0x1000))).contains("stack would begin"));
        assert!(refusal(&elf(40, 0x2000, &[1, 2])).contains("no vector table"));
        let mut large = elf(40, 0x2000, &code(0x2000_7800));
        let at = large.windows(4).position(|word| word == 100u32.to_le_bytes());
        large[at.unwrap()..][..4].fill(0xFF);
        assert!(refusal(&large).contains("more than the chip's RAM"));
    }
}
