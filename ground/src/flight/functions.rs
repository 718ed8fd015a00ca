//! The functions of an image by address, out of its symbols.

use addr2line::demangle_auto;
use addr2line::gimli::DW_LANG_Rust;
use object::{Object, ObjectSymbol, SymbolKind};

/// A function of an image.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Function {
    /// Address of its first instruction.
    pub start: u32,
    /// Bytes, literals included; 0 if the file does not tell.
    pub length: u32,
    /// Its name, demangled.
    pub name: String,
}

/// The functions of an image, ascending, one for each address.
#[derive(Clone, Debug, Default)]
pub struct Functions(Vec<Function>);

impl Functions {
    /// The functions that the symbols of a file name.
    pub fn read(file: &object::File<'_>) -> Self {
        let texts = file
            .symbols()
            .filter(|symbol| symbol.kind() == SymbolKind::Text);
        Self::new(texts.filter_map(|symbol| {
            let name = symbol.name().ok().filter(|name| !name.starts_with('$'))?;
            Some(Function {
                start: symbol.address() as u32 & !1,
                length: symbol.size() as u32,
                name: demangle_auto(name.into(), Some(DW_LANG_Rust)).into_owned(),
            })
        }))
    }

    /// Of several names of one address, the one that tells its length is kept.
    pub fn new(functions: impl IntoIterator<Item = Function>) -> Self {
        let mut all: Vec<_> = functions.into_iter().collect();
        all.sort_by(|a, b| {
            let by_length = b.length.cmp(&a.length);
            (a.start.cmp(&b.start).then(by_length)).then(a.name.cmp(&b.name))
        });
        all.dedup_by_key(|function| function.start);
        Self(all)
    }

    /// The function that an address lies in.
    pub fn at(&self, address: u32) -> Option<&Function> {
        let behind = self.0.partition_point(|one| one.start <= address);
        let last = self.0[..behind].last()?;
        (last.length == 0 || address < last.start + last.length).then_some(last)
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}
