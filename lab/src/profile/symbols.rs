//! Functions by address: the symbols of an image, and what was inlined into them.

use std::collections::HashMap;

use addr2line::Context;
use addr2line::gimli::{self, EndianSlice, LittleEndian};
use anyhow::Result;
use object::{Object, ObjectSection};

use crate::functions::Functions;
use report::exit::BadInput;

/// What is said of an address that no symbol covers.
const UNKNOWN: &str = "(no symbol)";

type Bytes<'a> = EndianSlice<'a, LittleEndian>;

/// The functions of an image.
pub struct Symbols<'a> {
    functions: Functions,
    inlined: Context<Bytes<'a>>,
    /// Whether the file tells what was inlined: whether it has debug information.
    pub has_inlined: bool,
    known: HashMap<u32, Vec<String>>,
}

impl<'a> Symbols<'a> {
    /// Reads an ELF file.
    ///
    /// # Errors
    /// [`BadInput`] for a file that is no ELF file, or whose debug information is broken.
    pub fn read(elf: &'a [u8]) -> Result<Self> {
        let file = object::File::parse(elf).map_err(BadInput::new)?;
        let section = |id: gimli::SectionId| -> Result<Bytes<'a>, gimli::Error> {
            let section = file.section_by_name(id.name());
            let data = section.and_then(|section| section.data().ok());
            Ok(EndianSlice::new(data.unwrap_or_default(), LittleEndian))
        };
        let dwarf = gimli::Dwarf::load(section).map_err(BadInput::new)?;
        Ok(Self {
            functions: Functions::read(&file),
            has_inlined: file.section_by_name(".debug_info").is_some(),
            inlined: Context::from_dwarf(dwarf).map_err(BadInput::new)?,
            known: HashMap::new(),
        })
    }

    /// The function at an address, then what was inlined there, outermost first; never empty.
    pub fn path(&mut self, address: u32) -> &[String] {
        let Self { functions, inlined, known, .. } = self;
        known.entry(address).or_insert_with(|| {
            let mut path = vec![symbol(functions, address)];
            let mut names = frames(inlined, address);
            // The outermost frame is the function of the symbol itself.
            names.pop();
            path.extend(names.into_iter().rev());
            path
        })
    }
}

fn symbol(functions: &Functions, address: u32) -> String {
    let function = functions.at(address);
    function.map_or_else(|| UNKNOWN.to_owned(), |function| function.name.clone())
}

/// Names of the functions at an address, innermost first; empty without debug information.
fn frames(context: &Context<Bytes<'_>>, address: u32) -> Vec<String> {
    let mut names = Vec::new();
    let Ok(mut frames) = context.find_frames(u64::from(address)).skip_all_loads() else {
        return names;
    };
    while let Ok(Some(frame)) = frames.next() {
        let name = frame.function.and_then(|function| Some(function.demangle().ok()?.into_owned()));
        names.push(name.unwrap_or_else(|| UNKNOWN.to_owned()));
    }
    names
}
