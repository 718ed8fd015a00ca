//! The functions of an image by address, out of its symbols.

use addr2line::demangle_auto;
use addr2line::gimli::DW_LANG_Rust;
use object::{Object, ObjectSymbol, SymbolKind};

/// Longest function, bytes: all of the chip's flash.
const LONGEST: u32 = 0x0004_0000;
/// Bytes of names that are told as people write them. A name of some bytes can stand for a megabyte
/// of them; those of an image of any size take a hundredth of this.
const SPOKEN: usize = 16 << 20;
/// Longest name after that, bytes.
const LONGEST_NAME: usize = 100;

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
        let texts = file.symbols().filter(|symbol| symbol.kind() == SymbolKind::Text);
        let mut spoken = 0;
        Self::new(texts.filter_map(|symbol| {
            let name = symbol.name().ok().filter(|name| !name.starts_with('$'))?;
            let name = match spoken {
                ..SPOKEN => demangle_auto(name.into(), Some(DW_LANG_Rust)),
                _ => name.get(..LONGEST_NAME).unwrap_or(name).into(),
            };
            spoken += name.len();
            Some(Function {
                start: symbol.address() as u32 & !1,
                length: u32::try_from(symbol.size()).ok()?,
                name: name.into_owned(),
            })
        }))
    }

    /// Of several names of one address, the one that tells its length is kept. None reaches into
    /// the next one.
    pub fn new(functions: impl IntoIterator<Item = Function>) -> Self {
        let mut all: Vec<_> = functions.into_iter().collect();
        all.sort_by(|a, b| {
            let by_length = b.length.cmp(&a.length);
            (a.start.cmp(&b.start).then(by_length)).then(a.name.cmp(&b.name))
        });
        all.dedup_by_key(|function| function.start);
        let mut behind = u32::MAX;
        for function in all.iter_mut().rev() {
            let room = (behind - function.start).min(LONGEST);
            function.length = function.length.min(room);
            behind = function.start;
        }
        Self(all)
    }

    /// The function that an address lies in.
    pub fn at(&self, address: u32) -> Option<&Function> {
        let behind = self.0.partition_point(|one| one.start <= address);
        let last = self.0[..behind].last()?;
        (last.length == 0 || address - last.start < last.length).then_some(last)
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}

/// Interrupts of the chip in the order of their lines (data sheet, table 11-3).
const LINES: [&str; 28] = [
    "PM", "SYSCTRL", "WDT", "RTC", "EIC", "NVMCTRL", "DMAC", "USB", "EVSYS", "SERCOM0", "SERCOM1",
    "SERCOM2", "SERCOM3", "SERCOM4", "SERCOM5", "TCC0", "TCC1", "TCC2", "TC3", "TC4", "TC5", "TC6",
    "TC7", "ADC", "AC", "DAC", "PTC", "I2S",
];

/// What the exception of a number is called; without one the core runs the thread.
pub fn exception_name(number: usize) -> String {
    match number {
        0 => "thread".into(),
        2 => "NMI".into(),
        3 => "HardFault".into(),
        11 => "SVCall".into(),
        14 => "PendSV".into(),
        15 => "SysTick".into(),
        _ => match LINES.get(number.wrapping_sub(16)) {
            Some(line) => format!("interrupt {line}"),
            None => format!("exception {number}"),
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What walks through a function would else walk through all addresses.
    #[test]
    fn a_function_ends_before_the_next_one_and_is_no_longer_than_the_flash() {
        let function = |start, length| Function { start, length, name: String::new() };
        let functions = Functions::new([
            function(0xFFFF_FFF0, u32::MAX),
            function(0x2000, u32::MAX),
            function(0x2010, u32::MAX),
        ]);
        let lengths: Vec<_> = functions.0.iter().map(|one| one.length).collect();
        assert_eq!(lengths, [0x10, LONGEST, 0xF]);
        assert_eq!(functions.at(0xFFFF_FFF1).unwrap().start, 0xFFFF_FFF0);
        assert!(functions.at(0x2010 + LONGEST).is_none());
    }
}
