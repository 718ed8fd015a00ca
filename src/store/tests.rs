use super::*;
use embedded_storage::nor_flash::{ErrorType, NorFlashErrorKind};
use proptest::prelude::*;
use std::vec::Vec;

const ROW: usize = 256;
const PAGE: usize = 64;

/// Flash that loses its power in the middle of an operation.
#[derive(Clone)]
pub(crate) struct Mock {
    bytes: [u8; STORE_BYTES],
    /// Operations (rows erased, pages written) until the power fails, and how the last one ends.
    power: Option<(usize, Tear)>,
    operations: usize,
}

/// What an operation that was cut leaves behind.
#[derive(Clone, Copy, Debug)]
enum Tear {
    /// Nothing changed.
    Before,
    /// This number of bytes is done, the rest is as it was.
    Part(usize),
    /// Bits half way: some have changed and some have not.
    Bits(u64),
}

impl Mock {
    pub(crate) fn new() -> Self {
        Self { bytes: [0xFF; STORE_BYTES], power: None, operations: 0 }
    }

    /// Nothing that was saved can be read any more.
    pub(crate) fn spoil(&mut self) {
        self.bytes[COVERED_FROM] ^= 1;
        self.bytes[SLOT_BYTES + COVERED_FROM] ^= 1;
    }

    pub(crate) fn bytes(&self) -> &[u8; STORE_BYTES] {
        &self.bytes
    }

    /// Rows erased and pages written so far.
    pub(crate) fn operations(&self) -> usize {
        self.operations
    }

    /// Brings `range` from what it is to `target`, or loses power on the way.
    fn operate(&mut self, start: usize, target: &[u8]) -> Result<(), NorFlashErrorKind> {
        let place = &mut self.bytes[start..start + target.len()];
        self.operations += 1;
        match self.power {
            Some((last, _)) if self.operations > last => return Err(NorFlashErrorKind::Other),
            Some((last, tear)) if self.operations == last => {
                match tear {
                    Tear::Before => {}
                    Tear::Part(count) => {
                        let count = count.min(target.len());
                        place[..count].copy_from_slice(&target[..count]);
                    }
                    Tear::Bits(seed) => {
                        let mut mask = seed | 1;
                        for (byte, wanted) in place.iter_mut().zip(target) {
                            mask ^= mask << 13;
                            mask ^= mask >> 7;
                            mask ^= mask << 17;
                            let mask = mask as u8;
                            *byte = (*byte & !mask) | (wanted & mask);
                        }
                    }
                }
                return Err(NorFlashErrorKind::Other);
            }
            _ => place.copy_from_slice(target),
        }
        Ok(())
    }
}

impl ErrorType for Mock {
    type Error = NorFlashErrorKind;
}

impl ReadNorFlash for Mock {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Self::Error> {
        bytes.copy_from_slice(&self.bytes[offset as usize..][..bytes.len()]);
        Ok(())
    }

    fn capacity(&self) -> usize {
        STORE_BYTES
    }
}

impl NorFlash for Mock {
    const WRITE_SIZE: usize = PAGE;
    const ERASE_SIZE: usize = ROW;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), Self::Error> {
        assert!(from.is_multiple_of(ROW as u32) && to.is_multiple_of(ROW as u32));
        (from..to).step_by(ROW).try_for_each(|row| self.operate(row as usize, &[0xFF; ROW]))
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Self::Error> {
        assert!(offset.is_multiple_of(PAGE as u32) && bytes.len() == PAGE);
        let old = &self.bytes[offset as usize..][..PAGE];
        assert!(old.iter().all(|byte| *byte == 0xFF), "a page is written once between erasures");
        self.operate(offset as usize, bytes)
    }
}

fn params(kp: f32) -> Params {
    let mut params = Params::default();
    params.set("PID_KP", kp).unwrap();
    // In the first page as well, but at its end.
    params.set("PID_TRIM_RAD_S", kp).unwrap();
    params.set("SRV_CENTRE_US", 1500.0 + kp).unwrap();
    params
}

fn set(generation: u32) -> Loaded {
    Loaded::Set { generation, interrupted: false, unusable: 0 }
}

/// Of no board.
fn load(flash: &mut impl ReadNorFlash) -> (Params, Loaded) {
    super::load(flash, BoardId::default())
}

fn save<F: NorFlash>(flash: &mut F, params: &Params) -> Result<u32, SaveError> {
    super::save(flash, params, BoardId::default())
}

/// Nobody has seen yet which way the rudder of the other board answers.
#[test]
fn a_set_of_another_board_has_no_polarity() {
    let [own, other] = [7, 8].map(|byte| BoardId::of(&[byte; 16]));
    let mut saved = params(2.0);
    saved.set("SRV_POLARITY", 1.0).unwrap();
    let mut unseen = saved.clone();
    unseen.set("SRV_POLARITY", 0.0).unwrap();
    for (saver, reader, expected) in [
        (own, own, &saved),
        (own, other, &unseen),
        (BoardId::default(), own, &saved),
        (own, BoardId::default(), &saved),
    ] {
        let mut flash = Mock::new();
        super::save(&mut flash, &saved, saver).unwrap();
        let (found, loaded) = super::load(&mut flash, reader);
        assert_eq!(&found, expected);
        assert!(loaded.is_as_saved());
    }
}

#[test]
fn new_flash_has_nothing_and_gives_the_defaults() {
    let (loaded, what) = load(&mut Mock::new());
    assert_eq!((loaded, what), (Params::default(), Loaded::Nothing));
}

#[test]
fn saved_sets_come_back_and_take_turns_in_the_slots() {
    let mut flash = Mock::new();
    for generation in 1..6 {
        let saved = params(generation as f32);
        assert_eq!(save(&mut flash, &saved), Ok(generation));
        let found = load(&mut flash);
        assert_eq!(load_bytes(&flash.bytes), found);
        assert_eq!(found, (saved, set(generation)));
        let slot = if generation % 2 == 1 { 0 } else { SLOT_BYTES };
        assert_eq!(&flash.bytes[slot..slot + 4], b"TVC1");
        assert_eq!(word(&flash.bytes, slot + 8), generation);
    }
}

#[test]
fn the_layout_is_as_documented() {
    let mut flash = Mock::new();
    save(&mut flash, &Params::default()).unwrap();
    assert_eq!(half(&flash.bytes, 12), Params::count() as u16);
    // FNV-1a of "PID_KP", and its default.
    assert_eq!(word(&flash.bytes, 16), hash_of("PID_KP"));
    assert_eq!(word(&flash.bytes, 20), Params::default().pid_kp().to_bits());
    let end = 16 + 8 * Params::count();
    // CRC-32 of IEEE 802.3, bit by bit.
    let mut crc = u32::MAX;
    for byte in &flash.bytes[8..end] {
        crc ^= u32::from(*byte);
        for _ in 0..8 {
            crc = (crc >> 1) ^ (0xEDB8_8320 & (crc & 1).wrapping_neg());
        }
    }
    assert_eq!(word(&flash.bytes, 4), !crc);
}

fn hash_of(name: &str) -> u32 {
    name.bytes()
        .fold(2_166_136_261, |hash: u32, byte| (hash ^ u32::from(byte)).wrapping_mul(16_777_619))
}

/// Power cut in every operation of a save, in every way: the old set or the new one, whole, and the
/// store goes on.
#[test]
fn a_cut_in_any_operation_leaves_the_old_set_or_the_new_one() {
    let old = params(2.0);
    let new = params(3.0);
    let mut before = Mock::new();
    save(&mut before, &params(1.0)).unwrap();
    save(&mut before, &old).unwrap();
    before.operations = 0;
    let mut whole = before.clone();
    save(&mut whole, &new).unwrap();
    assert!(whole.operations >= 3, "erases and writes are counted");
    let mut tears: Vec<Tear> = (0..=ROW).map(Tear::Part).collect();
    tears.push(Tear::Before);
    tears.extend((1..200).map(|seed| Tear::Bits(0x9E37_79B9_7F4A_7C15_u64.wrapping_mul(seed))));
    let mut survived = [0, 0];
    for operation in 1..=whole.operations {
        for tear in &tears {
            let mut flash = before.clone();
            flash.power = Some((operation, *tear));
            let saved = save(&mut flash, &new);
            assert_eq!(saved, Err(SaveError::Flash), "{operation} {tear:?}");
            flash.power = None;
            let (loaded, what) = load(&mut flash);
            match what {
                Loaded::Set { generation: 2, .. } => {
                    assert_eq!(loaded, old, "{operation} {tear:?}")
                }
                Loaded::Set { generation: 3, .. } => {
                    assert_eq!(loaded, new, "{operation} {tear:?}")
                }
                other => panic!("{operation} {tear:?}: {other:?}"),
            }
            survived[usize::from(loaded == new)] += 1;
            assert!(save(&mut flash, &params(4.0)).is_ok());
            assert_eq!(load(&mut flash).0, params(4.0));
        }
    }
    assert!(survived[0] > survived[1] && survived[1] > 0, "{survived:?}");
}

/// An order that came between the write by which a set counts and its answer would be judged by
/// what is not told yet.
#[test]
fn a_set_counts_from_the_very_operation_that_tells_it() {
    let mut flash = Mock::new();
    for generation in 1..4 {
        let wanted = params(generation as f32);
        let mut saving = Saving::begin(&mut flash, &wanted, BoardId::default());
        loop {
            let told = saving.go_on(&mut flash, &wanted).unwrap();
            assert_eq!(load(&mut flash).0 == wanted, told == Some(generation));
            if told.is_some() {
                break;
            }
        }
    }
}

/// The values change in the midst of a save, and the power is cut: each set is whole, and what a
/// first save was told to be is not lost. The next save is cut as well.
#[test]
fn cuts_in_a_save_that_begins_again_and_in_the_one_after_it_mix_nothing() {
    // With digests that differ.
    let sets = [1.0, 2.0, 5.0, 4.0].map(params);
    assert_ne!(sets[1].digest(), sets[2].digest());
    let mut before = Mock::new();
    save(&mut before, &sets[0]).unwrap();
    let mut whole = before.clone();
    save(&mut whole, &sets[1]).unwrap();
    let operations = whole.operations - before.operations;
    let cut_at = |flash: &mut Mock, operation, tear| {
        flash.power = Some((flash.operations + operation, tear));
    };
    let found = |flash: &mut Mock, among: &[usize]| {
        flash.power = None;
        let (loaded, _) = load(flash);
        let set = among.iter().find(|set| sets[**set] == loaded);
        *set.expect("one of the sets, whole")
    };
    let mut seen = [0; 4];
    for changed in 0..operations {
        // The last of them comes too late.
        for cut in 1..=changed + operations + 1 {
            for tear in
                [Tear::Before, Tear::Part(9), Tear::Part(40), Tear::Part(PAGE), Tear::Bits(77)]
            {
                let mut flash = before.clone();
                cut_at(&mut flash, cut, tear);
                let mut saving = Saving::begin(&mut flash, &sets[1], BoardId::default());
                let mut done = 0;
                // Until the power is gone.
                while done < changed && saving.go_on(&mut flash, &sets[1]).is_ok() {
                    done += 1;
                }
                let told = loop {
                    match saving.go_on(&mut flash, &sets[2]) {
                        Ok(None) => {}
                        end => break end,
                    }
                };
                assert_eq!(told.is_ok(), cut > changed + operations);
                let first = found(&mut flash, &[0, 1, 2]);
                cut_at(&mut flash, 1 + (cut * 7 + changed) % operations, tear);
                assert!(save(&mut flash, &sets[3]).is_err());
                let second = found(&mut flash, &[first, 3]);
                seen[first] += 1;
                seen[second] += 1;
                assert!(save(&mut flash, &sets[1]).is_ok());
                assert_eq!(found(&mut flash, &[1]), 1);
            }
        }
    }
    assert!(seen[0] > 0 && seen[2] > 0 && seen[3] > 0, "{seen:?}");
}

#[test]
fn after_a_cut_in_the_first_save_the_defaults_hold() {
    let mut flash = Mock::new();
    // Behind the erasing, in the first page that is written.
    let first_write = SLOT_BYTES / ROW + 1;
    flash.power = Some((first_write, Tear::Part(8)));
    assert!(save(&mut flash, &params(2.0)).is_err());
    flash.power = None;
    assert_eq!(load(&mut flash), (Params::default(), Loaded::Nothing));
    // A set that was whole, and of which a bit has changed, is lost.
    save(&mut flash, &params(2.0)).unwrap();
    for at in [0, 100] {
        let mut spoilt = flash.clone();
        spoilt.bytes[at] ^= 1;
        assert_eq!(load(&mut spoilt), (Params::default(), Loaded::Corrupt));
    }
}

#[test]
fn a_damaged_slot_is_reported_and_the_other_one_used() {
    let mut flash = Mock::new();
    save(&mut flash, &params(1.0)).unwrap();
    save(&mut flash, &params(2.0)).unwrap();
    flash.bytes[SLOT_BYTES + 20] ^= 4;
    let (loaded, what) = load(&mut flash);
    assert_eq!(loaded, params(1.0));
    assert!(matches!(what, Loaded::Set { generation: 1, interrupted: true, .. }));
    flash.bytes[20] ^= 4;
    assert_eq!(load(&mut flash), (Params::default(), Loaded::Corrupt));
}

#[test]
fn values_that_this_image_does_not_know_or_allow_keep_their_defaults() {
    let mut flash = Mock::new();
    save(&mut flash, &params(2.0)).unwrap();
    let rewrite = |flash: &mut Mock, at: usize, value: u32| {
        put(&mut flash.bytes, at, &value.to_le_bytes());
        let end = 16 + 8 * Params::count();
        let crc = CRC.checksum(&flash.bytes[8..end]);
        put(&mut flash.bytes, 4, &crc.to_le_bytes());
    };
    rewrite(&mut flash, 16, hash_of("GONE"));
    let (loaded, what) = load(&mut flash);
    assert_eq!(loaded.pid_kp(), Params::default().pid_kp());
    assert_eq!(loaded.srv_centre_us(), 1502.0);
    assert!(matches!(what, Loaded::Set { unusable: 1, .. }));
    rewrite(&mut flash, 28, f32::NAN.to_bits());
    assert!(matches!(load(&mut flash).1, Loaded::Set { unusable: 2, .. }));
}

/// An older image has saved twice; this one finds the newer set, and its own saves take turns from
/// then on, none of them in the way of the newest.
#[test]
fn what_an_older_image_saved_is_found() {
    let mut flash = Mock::new();
    for (generation, at) in [(1, SLOT_BYTES), (2, STORE_BYTES - OLD_SLOT_BYTES)] {
        let mut slot = [0xFF; SLOT_BYTES];
        compose(&params(generation as f32), generation, BoardId::default(), &mut slot);
        // It had fewer parameters.
        let count = 40;
        put(&mut slot, 12, &40_u16.to_le_bytes());
        let end = HEADER_BYTES + ENTRY_BYTES * count;
        slot[end..].fill(0xFF);
        let crc = CRC.checksum(&slot[COVERED_FROM..end]);
        put(&mut slot, CRC_AT, &crc.to_le_bytes());
        flash.bytes[at..at + OLD_SLOT_BYTES].copy_from_slice(&slot[..OLD_SLOT_BYTES]);
        let (loaded, what) = load(&mut flash);
        assert_eq!(loaded.pid_kp(), generation as f32);
        assert_eq!(what, set(generation));
    }
    for generation in 3..7 {
        let saved = params(generation as f32);
        assert_eq!(save(&mut flash, &saved), Ok(generation));
        assert_eq!(load(&mut flash), (saved, set(generation)));
    }
}

#[test]
fn generations_are_compared_as_they_wrap() {
    let contents =
        |a, b| [Content::Set { generation: a }, Content::Set { generation: b }, Content::Damaged];
    assert_eq!(newest(contents(u32::MAX, 0)), Some((Slot::Second, 0)));
    assert_eq!(newest(contents(0, u32::MAX)), Some((Slot::First, 0)));
    assert_eq!(newest(contents(7, 6)), Some((Slot::First, 7)));
}

#[test]
fn flash_that_does_not_hold_is_an_error() {
    /// Forgets every write.
    struct Forgetful(Mock);
    impl ErrorType for Forgetful {
        type Error = NorFlashErrorKind;
    }
    impl ReadNorFlash for Forgetful {
        const READ_SIZE: usize = 1;
        fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Self::Error> {
            self.0.read(offset, bytes)
        }
        fn capacity(&self) -> usize {
            STORE_BYTES
        }
    }
    impl NorFlash for Forgetful {
        const WRITE_SIZE: usize = PAGE;
        const ERASE_SIZE: usize = ROW;
        fn erase(&mut self, _: u32, _: u32) -> Result<(), Self::Error> {
            Ok(())
        }
        fn write(&mut self, _: u32, _: &[u8]) -> Result<(), Self::Error> {
            Ok(())
        }
    }
    let mut flash = Forgetful(Mock::new());
    assert_eq!(save(&mut flash, &params(2.0)), Err(SaveError::ReadBack));
}

proptest! {
    /// Whatever is in the flash, loading gives parameters within their ranges.
    #[test]
    fn any_content_gives_usable_parameters(content in prop::collection::vec(any::<u8>(), STORE_BYTES), marked: bool) {
        let mut flash = Mock::new();
        flash.bytes.copy_from_slice(&content);
        if marked {
            put(&mut flash.bytes, 0, &MARK);
        }
        let (loaded, _) = load(&mut flash);
        for (info, value) in loaded.iter() {
            prop_assert!(info.range.contains(value));
        }
    }
}
