//! The emulated core's side of `samd21/tools/differential.py`: reads programs from standard input,
//! writes each one's outcome and all of SRAM to standard output. The argument is the seed.

use std::io::{self, Read, Write};

// The stored programs are run by the same code as the new ones.
#[path = "../tests/vectors/case.rs"]
#[allow(dead_code, unreachable_pub)]
mod case;

use case::{Case, OUTCOME_WORDS, chip};

fn main() -> io::Result<()> {
    let seed = std::env::args().nth(1).and_then(|seed| seed.parse().ok());
    let Some(seed) = seed else {
        eprintln!("usage: differential SEED (started by samd21/tools/differential.py)");
        std::process::exit(2);
    };
    let mut chip = chip(seed);
    let (mut input, mut output) = (io::stdin().lock(), io::stdout().lock());
    let mut count = [0; 4];
    while input.read_exact(&mut count).is_ok() {
        let writes = u32::from_le_bytes(count) as usize;
        let mut bytes = count.to_vec();
        bytes.resize(4 + 6 * writes + 4 * OUTCOME_WORDS, 0);
        input.read_exact(&mut bytes[4..])?;
        let case = Case::parse(&mut bytes.as_slice()).ok_or(io::ErrorKind::UnexpectedEof)?;
        for word in case.run(&mut chip) {
            output.write_all(&word.to_le_bytes())?;
        }
        output.write_all(chip.memory.ram())?;
        output.flush()?;
    }
    Ok(())
}
