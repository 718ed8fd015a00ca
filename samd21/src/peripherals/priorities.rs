//! Priorities on the bus matrix: QOSCTRL of the DMAC, and the SFR registers of HMATRIX, which the
//! start-up code of many projects writes. They are stored and have no effect: the core is the only
//! master.

use super::access::{DONE, Lanes, Read, Refusal, Write};

/// SFR0 to SFR15 of HMATRIX.
const SFR: core::ops::Range<u32> = 0x110..0x150;
/// The word of the DMAC in which QOSCTRL is the third byte.
const QOSCTRL: u32 = 0x0C;
const OTHERS: Refusal = Refusal::Unmodelled("a register without priorities");

#[derive(Clone, Debug)]
pub(crate) struct Priorities {
    dmac: u8,
    matrix: [u32; 16],
}

impl Priorities {
    /// The reset value of QOSCTRL is medium quality for all (D21, DMAC register summary).
    pub(crate) fn new() -> Self {
        Self { dmac: 0x15, matrix: [0; 16] }
    }

    pub(crate) fn read_dmac(&self, offset: u32) -> Read {
        if offset == QOSCTRL { Ok(u32::from(self.dmac) << 16) } else { Err(OTHERS) }
    }

    pub(crate) fn write_dmac(&mut self, offset: u32, lanes: Lanes) -> Write {
        let value = lanes.byte(2).filter(|_| offset == QOSCTRL).ok_or(OTHERS)?;
        self.dmac = value & 0x3F;
        DONE
    }

    pub(crate) fn read_matrix(&self, offset: u32) -> Read {
        if SFR.contains(&offset) { Ok(self.matrix[Self::index(offset)]) } else { Err(OTHERS) }
    }

    pub(crate) fn write_matrix(&mut self, offset: u32, lanes: Lanes) -> Write {
        if !SFR.contains(&offset) {
            return Err(OTHERS);
        }
        let word = &mut self.matrix[Self::index(offset)];
        *word = lanes.merge(*word);
        DONE
    }

    fn index(offset: u32) -> usize {
        (offset - SFR.start) as usize / 4
    }
}
