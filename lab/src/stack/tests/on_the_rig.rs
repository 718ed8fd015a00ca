//! The firmware's own image: what runs on the rig is what the analysis has followed.

use std::collections::{BTreeMap, BTreeSet};

use rig::ground_station::GroundStation;
use rig::image::{build_in, workspace};
use rig::{Image, Rig, ServoKind, Setup};
use samd21::board::Ticks;

use super::super::depth::Calls;
use super::super::program::Program;
use super::super::walk::explore;

/// The chip remembers its last 32 branches: seldom more than it takes in this time.
const SLICE: Ticks = Ticks::from_us(3);

/// Branches by where they come from.
type Branches = BTreeMap<u32, BTreeSet<u32>>;

/// The taken branches from power-on to standby, with a station at the port.
fn branches(image: &Image) -> Branches {
    let setup = Setup::with_polarity(ServoKind::S3003, 1);
    let mut rig = Rig::new(image, &setup.rig).unwrap();
    let mut station = GroundStation::default();
    let mut seen = Branches::new();
    let mut note = |rig: &Rig| {
        for (from, to) in rig.chip.trail() {
            seen.entry(from).or_default().insert(to);
        }
    };
    while rig.now() < Ticks::from_ms(700) {
        rig.run_for(SLICE).unwrap();
        note(&rig);
    }
    station.connect(&mut rig).unwrap();
    let end = rig.now() + Ticks::from_ms(2_500);
    while rig.now() < end {
        station.run(&mut rig, SLICE).unwrap();
        note(&rig);
    }
    seen
}

#[test]
fn every_branch_of_a_run_was_followed() {
    let path = build_in(&workspace(), &mut |line| eprintln!("{line}")).unwrap();
    let elf = std::fs::read(&path).unwrap();
    let image = Image::parse("the image", &elf).unwrap();
    let program = Program::read(&image, &elf).unwrap();
    let (handlers, pointers) = (program.handlers(), program.pointers());
    let found = explore(&program, handlers.values().copied(), &pointers);
    assert!(found.problems.is_empty(), "{:?}", found.problems);
    let code = found.code;
    let calls = Calls::new(&program, found.frames, pointers, &[]);
    let known: BTreeMap<_, _> = calls
        .frames
        .values()
        .flat_map(|frame| &frame.calls)
        .map(|(at, call)| (*at, calls.reached_by(call)))
        .collect();
    let entries: BTreeSet<_> = handlers.values().copied().collect();

    let (mut sites, mut by_pointer) = (0, 0);
    for (from, targets) in branches(&image) {
        // An exception is no branch: it comes from any instruction, and goes back to any.
        for to in targets.difference(&entries) {
            assert!(code.contains(to), "0x{from:x} to 0x{to:x} in {}", program.name(*to));
            if let Some(known) = known.get(&from).filter(|_| program.is_entry(*to)) {
                assert!(known.contains(to), "0x{from:x} to {}", program.name(*to));
                sites += 1;
                by_pointer += usize::from(known.len() > 1);
            }
        }
    }
    assert!(sites > 500 && by_pointer > 1, "{sites} {by_pointer}");
}
