//! What is analysed: the bytes of flash, the functions in them, and what among them is data.

use std::collections::{BTreeMap, BTreeSet};

use anyhow::{Result, bail};
use object::{Object, ObjectSymbol};
use rig::Image;

use super::value::Origin;

use crate::functions::{Function, Functions};
use report::exit::BadInput;

/// Words of the vector table: the stack's top, 15 exceptions of ARMv6-M, and 28 interrupts
/// (SAM D21 data sheet, 11.2.2).
const VECTORS: u32 = 16 + 28;
/// What fills up code: `mov r8, r8` and NOP.
const FILLERS: [u16; 2] = [0x46C0, 0xBF00];
/// The first three words of a vtable of Rust: what drops the value, its size, its alignment.
const VTABLE_HEAD: u32 = 12;
/// Larger values are not made, and larger alignments not asked for, in 32 KB of RAM.
const LARGEST_SIZE: u32 = 0x8000;
const LARGEST_ALIGNMENT: u32 = 16;

/// An image's flash.
#[derive(Clone, Debug)]
pub struct Program {
    address: u32,
    bytes: Vec<u8>,
    functions: Functions,
    /// Where code (false) and data (true) begin.
    mapping: BTreeMap<u32, bool>,
}

impl Program {
    /// Out of an image and the ELF file that it was read from.
    ///
    /// # Errors
    /// [`BadInput`] for a file whose symbols name no function.
    pub fn read(image: &Image, elf: &[u8]) -> Result<Self> {
        let file = object::File::parse(elf).map_err(BadInput::new)?;
        let functions = Functions::read(&file);
        if functions.is_empty() {
            bail!(BadInput::new("the image names no functions: its symbols were stripped"));
        }
        // Mapping symbols: ELF for the Arm Architecture, 5.5.5.
        let mapping = file.symbols().filter_map(|symbol| {
            let name = symbol.name().ok()?;
            let is = |kind: &str| name == kind || name.starts_with(&format!("{kind}."));
            (is("$d") || is("$t")).then(|| (symbol.address() as u32, is("$d")))
        });
        let mapping = mapping.collect();
        let bytes = image.bytes().to_vec();
        Ok(Self::new(image.address(), bytes, functions, mapping))
    }

    /// Bytes from an address on; `mapping` has where code (false) and data (true) begin, as far as
    /// that is known.
    pub fn new(
        address: u32,
        bytes: Vec<u8>,
        functions: Functions,
        mapping: BTreeMap<u32, bool>,
    ) -> Self {
        Self { address, bytes, functions, mapping }
    }

    /// Whether an address is one of the image's flash.
    pub fn contains(&self, address: u32) -> bool {
        let offset = address.checked_sub(self.address);
        offset.is_some_and(|offset| (offset as usize) < self.bytes.len())
    }

    fn read_bytes<const N: usize>(&self, address: u32) -> Option<[u8; N]> {
        let offset = address.checked_sub(self.address)? as usize;
        self.bytes.get(offset..)?.first_chunk().copied()
    }

    /// The byte at an address.
    pub fn byte(&self, address: u32) -> Option<u8> {
        self.read_bytes::<1>(address).map(|[byte]| byte)
    }

    /// The half-word at an address.
    pub fn half(&self, address: u32) -> Option<u16> {
        self.read_bytes(address).map(u16::from_le_bytes)
    }

    /// The word at an address.
    pub fn word(&self, address: u32) -> Option<u32> {
        self.read_bytes(address).map(u32::from_le_bytes)
    }

    /// Whether the file says that data is there.
    pub fn is_data(&self, address: u32) -> bool {
        let before = self.mapping.range(..=address).next_back();
        before.is_some_and(|(_, is_data)| *is_data)
    }

    /// The function that an address lies in.
    pub fn function(&self, address: u32) -> Option<&Function> {
        self.functions.at(address)
    }

    /// Whether a function begins at an address.
    pub fn is_entry(&self, address: u32) -> bool {
        let function = self.functions.at(address);
        function.is_some_and(|function| function.start == address)
    }

    /// What an address of code is called.
    pub fn name(&self, address: u32) -> String {
        match self.functions.at(address) {
            Some(function) if function.start == address => function.name.clone(),
            Some(function) => format!("{}+0x{:x}", function.name, address - function.start),
            None => format!("0x{address:x}"),
        }
    }

    /// The function that a word is the address of, as a pointer to code is stored: with bit 0 set.
    fn pointed_at(&self, word: u32) -> Option<u32> {
        (word & 1 != 0 && self.contains(word) && self.is_entry(word & !1)).then_some(word & !1)
    }

    /// The handler of each exception from 1 (the reset) on that has one.
    pub fn handlers(&self) -> BTreeMap<usize, u32> {
        let vectors = (1..VECTORS).filter_map(|number| {
            let word = self.word(self.address + 4 * number)?;
            let handler = word & !1;
            (word & 1 != 0 && self.contains(handler)).then_some((number as usize, handler))
        });
        vectors.collect()
    }

    /// Bytes of instructions in these functions that are not in `code`, as far as the file says
    /// what is one. What only fills up does not count.
    pub fn unreached_bytes(
        &self,
        functions: impl Iterator<Item = u32>,
        code: &BTreeSet<u32>,
    ) -> u32 {
        let functions = functions.filter_map(|start| self.function(start));
        let halves =
            functions.flat_map(|one| (one.start..one.start.saturating_add(one.length)).step_by(2));
        let is_filler = |at| self.half(at).is_some_and(|half| FILLERS.contains(&half));
        let missed =
            halves.filter(|at| !self.is_data(*at) && !code.contains(at) && !is_filler(*at));
        2 * missed.count() as u32
    }

    /// The functions whose address stands somewhere behind the vector table.
    pub fn pointers(&self) -> Pointers {
        let mut pointers = Pointers::default();
        let mut in_vtable = BTreeSet::new();
        let end = self.address + self.bytes.len() as u32;
        let words = (self.address + 4 * VECTORS..end).step_by(4);
        // Where an object begins: what some word is the address of.
        let begins: BTreeSet<_> = words.clone().filter_map(|at| self.word(at)).collect();
        for &table in begins.iter().filter(|at| at.is_multiple_of(4)) {
            for (offset, function) in self.vtable(table, &begins) {
                in_vtable.insert(table + offset);
                pointers.by_offset.entry(offset).or_default().insert(function);
            }
        }
        let elsewhere = words.filter(|at| !in_vtable.contains(at));
        let words = elsewhere.filter_map(|at| self.word(at));
        pointers.anywhere = words.filter_map(|word| self.pointed_at(word)).collect();
        pointers
    }

    /// The functions of the vtable at an address, by their offset; none if that is not one. It ends
    /// where the next object begins, if not before.
    fn vtable(&self, at: u32, begins: &BTreeSet<u32>) -> Vec<(u32, u32)> {
        // A table at the end of the addresses is none.
        let word = |offset| self.word(at.checked_add(offset)?);
        let (Some(drop), Some(size), Some(alignment)) = (word(0), word(4), word(8)) else {
            return Vec::new();
        };
        let is_head = (drop == 0 || self.pointed_at(drop).is_some())
            && size <= LARGEST_SIZE
            && alignment.is_power_of_two()
            && alignment <= LARGEST_ALIGNMENT
            && size.is_multiple_of(alignment);
        if !is_head {
            return Vec::new();
        }
        let slots = (VTABLE_HEAD..).step_by(4);
        let ends = |offset: u32| at.checked_add(offset).is_none_or(|at| begins.contains(&at));
        let own = slots.take_while(|offset| !ends(*offset));
        let methods = own.map_while(|offset| Some((offset, self.pointed_at(word(offset)?)?)));
        methods.collect()
    }
}

/// The functions that a pointer may lead to: those whose address stands somewhere.
///
/// | the pointer was loaded from | it may lead to |
/// |---|---|
/// | offset 12 or more of what a pointer leads to | the methods that stand there in vtables; if there are none, as the next |
/// | any other offset, an array | every function but those that stand among the methods of vtables alone |
/// | what is not known | every function |
///
/// The first row takes the call for one of a method. It would be wrong for a structure of function
/// pointers with four words or more, of which this firmware has none.
#[derive(Clone, Debug, Default)]
pub struct Pointers {
    /// Those whose address stands anywhere but among the methods of a vtable.
    anywhere: BTreeSet<u32>,
    /// Those among the methods of a vtable, by their offset in it.
    by_offset: BTreeMap<u32, BTreeSet<u32>>,
}

impl Pointers {
    /// The functions that a pointer may lead to that was loaded from there.
    pub fn candidates(&self, from: Origin) -> BTreeSet<u32> {
        match from {
            Origin::Offset(offset) if self.by_offset.contains_key(&offset) => {
                self.by_offset[&offset].clone()
            }
            Origin::Offset(_) | Origin::Indexed => self.anywhere.clone(),
            Origin::Unknown => {
                let methods = self.by_offset.values().flatten();
                methods.chain(&self.anywhere).copied().collect()
            }
        }
    }
}
