//! Parameters that outlive the power: two slots of flash that take turns.
//!
//! A save erases the slot that holds the older set and writes the whole set there, so that the
//! newer one is untouched until the new one is complete. Power may fail at any instant: afterwards
//! the old set or the new one is there, whole.
//!
//! ```text
//!  byte   0       4        8            12       14         16
//!         | mark  | CRC-32 | generation | values | board    | id, value | id, value | ...
//!                          '------------- covered by the CRC -------------------------'
//! ```
//!
//! `board` is the [`BoardId`] of the board that saved the set: on another board the polarity counts
//! as unchecked.
//!
//! All numbers are little-endian, values are `f32`. The first page, with the mark, is written last.
//! A value goes by the hash of its parameter's name ([`crate::params::Info::id`]), so that a newer
//! image keeps what it still knows of an older image's set.
//!
//! Until the second slot is written, it may hold two old slots of 512 bytes, which are read, too.

use core::convert::Infallible;
use core::fmt;

use crc::{CRC_32_ISO_HDLC, Crc, NoTable};
use embedded_storage::nor_flash::{ErrorType, NorFlash, ReadNorFlash};

use crate::params::Params;

/// Size of a slot: four rows of the SAMD21's flash.
pub const SLOT_BYTES: usize = 1024;
/// Size of the flash that the store is given: two slots.
pub const STORE_BYTES: usize = 2 * SLOT_BYTES;
/// Where it is on the chip: at the end of its flash.
pub const STORE_ADDRESS: u32 = 0x0004_0000 - STORE_BYTES as u32;

/// First word of a slot that holds a set; its last character is the version of the layout.
const MARK: [u8; 4] = *b"TVC1";
const HEADER_BYTES: usize = 16;
const ENTRY_BYTES: usize = 8;
const CRC_AT: usize = 4;
const COVERED_FROM: usize = 8;
const BOARD_AT: usize = 14;
/// The page that is written last.
const FIRST_PAGE_BYTES: usize = 64;

/// Size of a slot of older images, whose second one was at the end of the store.
const OLD_SLOT_BYTES: usize = 512;

const _: () = assert!(
    HEADER_BYTES + ENTRY_BYTES * Params::count() <= SLOT_BYTES,
    "the parameters fit into a slot"
);

/// CRC-32 of IEEE 802.3, without a table: it runs at start-up and when somebody saves.
const CRC: Crc<u32, NoTable> = Crc::<u32, NoTable>::new(&CRC_32_ISO_HDLC);

/// A hash of a board's serial number; 0 is that of no board, and of sets of older images.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BoardId(u16);

impl BoardId {
    /// Of a board with this serial number.
    pub fn of(serial: &[u8; 16]) -> Self {
        let (halves, _) = serial.as_chunks();
        let sum = halves.iter().fold(0_u32, |sum, half| {
            (sum ^ u32::from(u16::from_le_bytes(*half))).wrapping_mul(0x9E37_79B9)
        });
        Self(((sum >> 16) as u16).max(1))
    }

    /// Whether a set that `saved` bears may be another board's.
    fn differs(self, saved: u16) -> bool {
        self.0 != 0 && saved != 0 && saved != self.0
    }
}

/// What the store had at start-up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Loaded {
    /// Nothing was ever saved; the parameters have their defaults.
    #[default]
    Nothing,
    /// The newest whole set.
    Set {
        /// How many times parameters have been saved.
        generation: u32,
        /// The other slot is damaged, as an interrupted save leaves it.
        interrupted: bool,
        /// Values that this image does not know, or whose range does not allow them: they have
        /// their defaults.
        unusable: u16,
    },
    /// Something was saved and none of it can be read. The parameters have their defaults. A first
    /// save that was cut short before its last page is [`Loaded::Nothing`].
    Corrupt,
}

impl Loaded {
    /// Whether the parameters are what was last saved, or nothing was.
    pub fn is_as_saved(&self) -> bool {
        matches!(self, Loaded::Nothing | Loaded::Set { interrupted: false, unusable: 0, .. })
    }
}

impl fmt::Display for Loaded {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Loaded::Nothing => "no stored parameters",
            Loaded::Corrupt => "stored parameters lost, defaults in use",
            Loaded::Set { interrupted: true, .. } => {
                "a save was interrupted, older parameters in use"
            }
            Loaded::Set { unusable: 0, .. } => "stored parameters in use",
            Loaded::Set { .. } => "some stored parameters are of no use here",
        })
    }
}

/// Why a save failed. The set saved before it is still there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SaveError {
    /// The flash refused.
    Flash,
    /// What was written does not read back.
    ReadBack,
}

impl fmt::Display for SaveError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            SaveError::Flash => "flash refuses to be written",
            SaveError::ReadBack => "flash does not read back",
        })
    }
}

/// The places for a set, in the order in which they lie.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Slot {
    First,
    Second,
    /// The second one of older images, within the second one of now. Nothing is written there.
    Old,
}

impl Slot {
    const ALL: [Slot; 3] = [Slot::First, Slot::Second, Slot::Old];

    fn offset(self) -> usize {
        match self {
            Slot::First => 0,
            Slot::Second => SLOT_BYTES,
            Slot::Old => STORE_BYTES - OLD_SLOT_BYTES,
        }
    }

    fn len(self) -> usize {
        match self {
            Slot::First | Slot::Second => SLOT_BYTES,
            Slot::Old => OLD_SLOT_BYTES,
        }
    }

    /// Where to write while the newest set is in this one.
    fn other(self) -> Slot {
        match self {
            Slot::First => Slot::Second,
            Slot::Second | Slot::Old => Slot::First,
        }
    }
}

/// What is in a slot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Content {
    Blank,
    /// Written but for its first page: a save that was cut short.
    Unfinished,
    Set {
        generation: u32,
    },
    Damaged,
}

/// The newest whole set of `flash` (its first [`STORE_BYTES`]) for the board, or the defaults.
pub fn load(flash: &mut impl ReadNorFlash, board: BoardId) -> (Params, Loaded) {
    let mut params = Params::default();
    let mut bytes = [0; SLOT_BYTES];
    let contents = Slot::ALL.map(|slot| examine(flash, slot, &mut bytes));
    let [first, second, _] = contents;
    let loaded = match newest(contents) {
        Some((slot, generation)) => {
            // Read again: the buffer holds the slot examined last.
            examine(flash, slot, &mut bytes);
            let unusable = apply(&bytes, &mut params);
            if board.differs(half(&bytes, BOARD_AT)) {
                params.forget_polarity();
            }
            Loaded::Set {
                generation,
                interrupted: [first, second]
                    .iter()
                    .any(|slot| matches!(slot, Content::Damaged | Content::Unfinished)),
                unusable,
            }
        }
        None if [first, second].contains(&Content::Damaged) => Loaded::Corrupt,
        None => Loaded::Nothing,
    };
    (params, loaded)
}

/// The same of a store whose bytes a host has read.
pub fn load_bytes(bytes: &[u8; STORE_BYTES]) -> (Params, Loaded) {
    load(&mut Bytes(bytes), BoardId::default())
}

/// Saves `params` in the slot that does not hold the newest set, in one go; their new generation.
///
/// # Errors
/// [`SaveError`]; the newest set is as it was.
pub fn save<F: NorFlash>(flash: &mut F, params: &Params, board: BoardId) -> Result<u32, SaveError> {
    let mut saving = Saving::begin(flash, params, board);
    loop {
        if let Some(generation) = saving.go_on(flash, params)? {
            return Ok(generation);
        }
    }
}

/// A save under way, a row or a page at a time: the processor stands still meanwhile, for up to 6
/// ms each, and is to read its sensor in between.
#[derive(Clone, Copy, Debug)]
pub struct Saving {
    slot: Slot,
    generation: u32,
    board: BoardId,
    /// Of the parameters as they were at the begin.
    digest: i32,
    /// Rows erased and pages written.
    done: usize,
}

impl Saving {
    /// Chooses the slot; nothing is written yet.
    pub fn begin(flash: &mut impl ReadNorFlash, params: &Params, board: BoardId) -> Self {
        let mut bytes = [0; SLOT_BYTES];
        let newest = newest(Slot::ALL.map(|slot| examine(flash, slot, &mut bytes)));
        let (slot, generation) = match newest {
            Some((slot, generation)) => (slot.other(), generation.wrapping_add(1)),
            None => (Slot::First, 1),
        };
        Self { slot, generation, board, digest: params.digest(), done: 0 }
    }

    /// Erases the next row or writes the next page, that with the mark last; the new generation
    /// when the set reads back. Parameters that have changed meanwhile are saved from the begin.
    ///
    /// # Errors
    /// [`SaveError`]; the newest set is as it was.
    pub fn go_on<F: NorFlash>(
        &mut self,
        flash: &mut F,
        params: &Params,
    ) -> Result<Option<u32>, SaveError> {
        let digest = params.digest();
        if digest != self.digest {
            (self.digest, self.done) = (digest, 0);
        }
        let start = self.slot.offset();
        let rows = SLOT_BYTES / F::ERASE_SIZE;
        let pages = SLOT_BYTES / F::WRITE_SIZE;
        let mut bytes = [0; SLOT_BYTES];
        if self.done < rows {
            let row = start + self.done * F::ERASE_SIZE;
            let erased = flash.erase(row as u32, (row + F::ERASE_SIZE) as u32);
            erased.map_err(|_| SaveError::Flash)?;
            self.done += 1;
            return Ok(None);
        }
        compose(params, self.generation, self.board, &mut bytes);
        while let Some(page) = (rows + pages).checked_sub(self.done + 1) {
            self.done += 1;
            let at = page * F::WRITE_SIZE;
            let page = bytes.get(at..at + F::WRITE_SIZE).unwrap_or_default();
            if page.iter().any(|byte| *byte != 0xFF) {
                let written = flash.write((start + at) as u32, page);
                written.map_err(|_| SaveError::Flash)?;
                // Behind the first page the set counts, and is told at once: an order that came
                // between would be refused what is done.
                if at > 0 {
                    return Ok(None);
                }
            }
        }
        match examine(flash, self.slot, &mut bytes) {
            Content::Set { generation } if generation == self.generation => Ok(Some(generation)),
            _ => Err(SaveError::ReadBack),
        }
    }
}

/// What a first save of `params` leaves at the start of an empty store.
pub fn first_slot(params: &Params) -> [u8; SLOT_BYTES] {
    let mut bytes = [0; SLOT_BYTES];
    compose(params, 1, BoardId::default(), &mut bytes);
    bytes
}

/// A store in memory, to be read.
struct Bytes<'a>(&'a [u8; STORE_BYTES]);

impl ErrorType for Bytes<'_> {
    type Error = Infallible;
}

impl ReadNorFlash for Bytes<'_> {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Infallible> {
        let from = offset as usize;
        if let Some(there) = self.0.get(from..from + bytes.len()) {
            bytes.copy_from_slice(there);
        }
        Ok(())
    }

    fn capacity(&self) -> usize {
        STORE_BYTES
    }
}

/// Reads a slot into `bytes` and says what it is.
fn examine(flash: &mut impl ReadNorFlash, slot: Slot, bytes: &mut [u8; SLOT_BYTES]) -> Content {
    bytes.fill(0xFF);
    let place = bytes.get_mut(..slot.len()).unwrap_or_default();
    if flash.read(slot.offset() as u32, place).is_err() {
        return Content::Damaged;
    }
    let mut pages = bytes.chunks(FIRST_PAGE_BYTES);
    let is_blank = |page: &[u8]| page.iter().all(|byte| *byte == 0xFF);
    if pages.next().is_some_and(is_blank) {
        return if pages.all(is_blank) { Content::Blank } else { Content::Unfinished };
    }
    let end = HEADER_BYTES + ENTRY_BYTES * usize::from(half(bytes, 12));
    match bytes.get(COVERED_FROM..end) {
        Some(covered)
            if bytes.starts_with(&MARK) && CRC.checksum(covered) == word(bytes, CRC_AT) =>
        {
            Content::Set { generation: word(bytes, 8) }
        }
        _ => Content::Damaged,
    }
}

/// The slot with the highest generation. Generations are compared as they wrap.
fn newest(contents: [Content; 3]) -> Option<(Slot, u32)> {
    let mut newest: Option<(Slot, u32)> = None;
    for (slot, content) in Slot::ALL.into_iter().zip(contents) {
        let Content::Set { generation } = content else {
            continue;
        };
        let is_newer = |(_, other): (Slot, u32)| (generation.wrapping_sub(other) as i32) > 0;
        if newest.is_none_or(is_newer) {
            newest = Some((slot, generation));
        }
    }
    newest
}

fn compose(params: &Params, generation: u32, board: BoardId, bytes: &mut [u8; SLOT_BYTES]) {
    bytes.fill(0xFF);
    let count = Params::count() as u16;
    put(bytes, 0, &MARK);
    put(bytes, 8, &generation.to_le_bytes());
    put(bytes, 12, &count.to_le_bytes());
    put(bytes, BOARD_AT, &board.0.to_le_bytes());
    let mut end = HEADER_BYTES;
    for (info, value) in params.iter() {
        put(bytes, end, &info.id.to_le_bytes());
        put(bytes, end + 4, &value.to_le_bytes());
        end += ENTRY_BYTES;
    }
    if let Some(covered) = bytes.get(COVERED_FROM..end) {
        let crc = CRC.checksum(covered);
        put(bytes, CRC_AT, &crc.to_le_bytes());
    }
}

/// Takes over the values of a whole set; how many of them are of no use.
fn apply(bytes: &[u8; SLOT_BYTES], params: &mut Params) -> u16 {
    let (entries, _) = bytes.as_chunks::<ENTRY_BYTES>();
    let first = HEADER_BYTES / ENTRY_BYTES;
    let count = usize::from(half(bytes, 12));
    let mut unusable = 0;
    for entry in entries.iter().skip(first).take(count) {
        if params.set_by_id(word(entry, 0), f32::from_bits(word(entry, 4))).is_err() {
            unusable += 1;
        }
    }
    unusable
}

fn put(bytes: &mut [u8], at: usize, value: &[u8]) {
    if let Some(place) = bytes.get_mut(at..at + value.len()) {
        place.copy_from_slice(value);
    }
}

#[inline(never)]
fn word(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes([at, at + 1, at + 2, at + 3].map(|at| bytes.get(at).copied().unwrap_or(0)))
}

fn half(bytes: &[u8], at: usize) -> u16 {
    u16::from_le_bytes([at, at + 1].map(|at| bytes.get(at).copied().unwrap_or(0)))
}

#[cfg(test)]
pub(crate) mod tests;
