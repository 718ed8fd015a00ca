//! How fast the core runs: instructions a second over a loop of loads, stores, arithmetic,
//! branches, calls and stack traffic, without and with a flash wait state.
//!
//! `cargo run --release -p samd21 --example speed`

use std::time::Instant;

use samd21::board::{Ticks, Unconnected};
use samd21::{Chip, Options};

/// Stack at the top of SRAM, entry at 0x10, then the loop; R1 points into SRAM.
const IMAGE: [u16; 27] = [
    0x8000, 0x2000, 0x0011, 0x0000, 0, 0, 0, 0,      // vectors
    0x2120, // movs r1, #0x20
    0x0609, // lsls r1, r1, #24
    0x2000, // movs r0, #0
    // 0x16: again
    0x684A, // ldr r2, [r1, #4]
    0x1812, // adds r2, r2, r0
    0x4353, // muls r3, r2
    0x09DC, // lsrs r4, r3, #7
    0x604C, // str r4, [r1, #4]
    0x2A05, // cmp r2, #5
    0xD3FF, // blo to the next
    0xB510, // push {r4, lr}
    0xF000, 0xF802, // bl 0x2e
    0xBC30, // pop {r4, r5}
    0xE7F3, // b again
    // 0x2e: function
    0x4054, // eors r4, r2
    0x720C, // strb r4, [r1, #8]
    0x1C40, // adds r0, r0, #1
    0x4770, // bx lr
];

fn main() {
    let image: Vec<u8> = IMAGE.iter().flat_map(|half| half.to_le_bytes()).collect();
    for wait_states in [0, 1] {
        let mut chip = Chip::new(Options { wait_states: Some(wait_states), ..Options::default() });
        chip.load_flash(0, &image);
        chip.boot(0);
        let start = Instant::now();
        let stop = chip.run_until(Ticks::from_ms(300_000), &mut Unconnected);
        let seconds = start.elapsed().as_secs_f64();
        let counters = chip.counters();
        println!(
            "{wait_states} wait states: {stop}: {:.0} million instructions and {:.0} million cycles a second",
            counters.instructions as f64 / seconds / 1e6,
            counters.cycles as f64 / seconds / 1e6,
        );
    }
}
