//! Resets through each bootloader, with an image that counts its starts.

use super::*;
use crate::rig::tests::{counter, word};
use crate::{Rig, RigConfig};

/// Where the image counts its starts.
const STARTS: usize = 0x7800;

/// A rig whose image has started.
fn started(bootloader: Bootloader) -> Rig {
    let mut config = RigConfig::default();
    config.hardware.bootloader = bootloader;
    let mut rig = Rig::new(&counter(), &config).unwrap();
    rig.run_for(Ticks::from_ms(10)).unwrap();
    assert!(!rig.in_bootloader());
    rig
}

/// The image leaves a word and resets, or the button is pressed, which is the same to a bootloader.
fn reset_with(rig: &mut Rig, left: u32) {
    put_word(rig.chip.memory.ram_mut(), left);
    rig.press_reset();
}

/// Time from now until the image runs, to 0.1 ms; `None` if it does not within three seconds.
fn image_after(rig: &mut Rig) -> Option<Ticks> {
    let begin = rig.now();
    let starts = word(rig, STARTS);
    while rig.now() - begin < Ticks::from_ms(3000) {
        rig.run_for(Ticks::from_us(100)).unwrap();
        if word(rig, STARTS) != starts {
            return Some(rig.now() - begin);
        }
    }
    None
}

fn near(after: Option<Ticks>, us: u64) {
    let after = after.expect("the image starts").as_us();
    assert!((us..us + 250).contains(&after), "{after} us instead of {us}");
}

#[test]
fn each_takes_its_time_after_a_reset_and_clears_its_word() {
    for (bootloader, us) in [
        (Bootloader::Even, 500_000),
        (Bootloader::Arduino, 501_800),
        (Bootloader::Uf2, 600_000),
        (Bootloader::None, 0),
    ] {
        let mut rig = started(bootloader);
        reset_with(&mut rig, 0);
        near(image_after(&mut rig), us);
        assert_eq!(word(&rig, WORD_AT), 0, "{bootloader:?}");
    }
}

#[test]
fn power_starts_the_image_without_waiting() {
    for (bootloader, us) in [
        (Bootloader::Even, 0),
        (Bootloader::Arduino, 1790),
        (Bootloader::Uf2, 1790),
        (Bootloader::None, 0),
    ] {
        let mut config = RigConfig::default();
        config.hardware.bootloader = bootloader;
        let mut rig = Rig::new(&counter(), &config).unwrap();
        near(image_after(&mut rig), us);
        let word_of = bootloader.figures().map_or(0, |figures| figures.word);
        put_word(rig.chip.memory.ram_mut(), word_of);
        rig.power_cycle();
        near(image_after(&mut rig), us);
    }
}

/// A word that is another bootloader's is no tap: the image comes back after the wait.
#[test]
fn each_knows_its_own_word_only() {
    let words = [0x0773_8135, 0xF016_69EF];
    for (bootloader, own, other) in
        [(Bootloader::Even, 0, 1), (Bootloader::Arduino, 0, 1), (Bootloader::Uf2, 1, 0)]
    {
        let mut rig = started(bootloader);
        reset_with(&mut rig, words[own]);
        assert_eq!(image_after(&mut rig), None, "{bootloader:?}");
        assert_eq!(word(&rig, WORD_AT), 0, "cleared, so that the next reset leaves again");
        rig.press_reset();
        assert!(image_after(&mut rig).is_some());
        reset_with(&mut rig, words[other]);
        assert!(image_after(&mut rig).is_some(), "{bootloader:?}");
    }
    let mut rig = started(Bootloader::Uf2);
    reset_with(&mut rig, 0xF026_69EF);
    near(image_after(&mut rig), 1790);
    let mut rig = started(Bootloader::None);
    reset_with(&mut rig, words[0]);
    near(image_after(&mut rig), 0);
}

#[test]
fn two_taps_stay() {
    for bootloader in [Bootloader::Even, Bootloader::Arduino, Bootloader::Uf2] {
        let mut rig = started(bootloader);
        rig.brown_out();
        rig.run_for(Ticks::from_ms(300)).unwrap();
        rig.press_reset();
        assert_eq!(image_after(&mut rig), None, "{bootloader:?}");
        rig.power_cycle();
        assert!(image_after(&mut rig).is_some());
    }
}

/// Flash below the image holds the literal and nothing else.
#[test]
fn the_literal_tells_the_bootloaders_apart() {
    for (bootloader, word) in [
        (Bootloader::Even, Some(0x0773_8135_u32)),
        (Bootloader::Arduino, Some(0x0773_8135)),
        (Bootloader::Uf2, Some(0xF016_69EF)),
        (Bootloader::None, None),
    ] {
        let rig = started(bootloader);
        let words = rig.chip.memory.flash()[..0x2000].chunks_exact(4);
        let written: Vec<u32> = words
            .map(|bytes| u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]))
            .filter(|&word| word != u32::MAX)
            .collect();
        assert_eq!(written, Vec::from_iter(word), "{bootloader:?}");
    }
    let arduino = started(Bootloader::Arduino);
    assert_eq!(arduino.chip.memory.flash()[0x724..0x728], [0x35, 0x81, 0x73, 0x07]);
}
