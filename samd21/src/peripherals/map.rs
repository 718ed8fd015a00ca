//! Where each peripheral is, which interrupt it requests and which generic clock it runs on.

/// The three APB bridges.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Bridge {
    A,
    B,
    C,
}

/// The model that an address belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Block {
    Pac(usize),
    Pm,
    Sysctrl,
    Gclk,
    Dsu,
    Eic,
    Nvmctrl,
    Port,
    Sercom(usize),
    Tc(usize),
    Tcc(usize),
    Usb,
    Wdt,
    Dmac,
    Matrix,
    Adc,
    Unmodelled,
}

/// A peripheral on an APB bridge.
#[derive(Clone, Copy)]
pub(super) struct Entry {
    base: u32,
    /// Its address range in bytes, a power of two.
    size: u32,
    pub(super) bridge: Bridge,
    /// Its bit in the power manager's mask of the bridge and in the access controller's.
    pub(super) index: u32,
    pub(super) name: &'static str,
    pub(super) block: Block,
    /// The NVIC's line as a bit mask, 0 for none.
    pub(super) irq: u32,
    /// CLKCTRL.ID of its generic clock.
    pub(super) clock: Option<usize>,
}

impl Entry {
    const fn irq(self, line: u32) -> Self {
        Self { irq: 1 << line, ..self }
    }

    const fn wired(self, line: u32, clock: usize) -> Self {
        Self { clock: Some(clock), ..self.irq(line) }
    }

    /// `addr`, relative to the peripheral's first address.
    pub(super) fn offset(&self, addr: u32) -> u32 {
        addr & (self.size - 1)
    }
}

const fn at(base: u32, bridge: Bridge, index: u32, name: &'static str, block: Block) -> Entry {
    Entry {
        base,
        size: 0x400 << (3 * matches!(block, Block::Dsu) as u32),
        bridge,
        index,
        name,
        block,
        irq: 0,
        clock: None,
    }
}

use Block::{
    Adc, Dmac, Dsu, Eic, Gclk, Matrix, Nvmctrl, Pac, Pm, Port, Sercom, Sysctrl, Tc, Tcc,
    Unmodelled, Usb, Wdt,
};
use Bridge::{A, B, C};

/// By address (D21: product mapping, NVIC line mapping, GCLK CLKCTRL.ID).
pub(super) static ENTRIES: [Entry; 36] = [
    at(0x4000_0000, A, 0, "PAC0", Pac(0)),
    at(0x4000_0400, A, 1, "PM", Pm).irq(0),
    // The clock is the DFLL's reference.
    at(0x4000_0800, A, 2, "SYSCTRL", Sysctrl).wired(1, 0x00),
    at(0x4000_0C00, A, 3, "GCLK", Gclk),
    at(0x4000_1000, A, 4, "WDT", Wdt).wired(2, 0x03),
    at(0x4000_1400, A, 5, "RTC", Unmodelled),
    at(0x4000_1800, A, 6, "EIC", Eic).wired(4, 0x05),
    at(0x4100_0000, B, 0, "PAC1", Pac(1)),
    at(0x4100_2000, B, 1, "DSU", Dsu),
    at(0x4100_4000, B, 2, "NVMCTRL", Nvmctrl).irq(5),
    at(0x4100_4400, B, 3, "PORT", Port),
    at(0x4100_4800, B, 4, "DMAC", Dmac),
    at(0x4100_5000, B, 5, "USB", Usb).wired(7, 0x06),
    at(0x4100_6000, B, 6, "MTB", Unmodelled),
    at(0x4100_7000, B, 6, "HMATRIX", Matrix),
    at(0x4200_0000, C, 0, "PAC2", Pac(2)),
    at(0x4200_0400, C, 1, "EVSYS", Unmodelled),
    at(0x4200_0800, C, 2, "SERCOM0", Sercom(0)).wired(9, 0x14),
    at(0x4200_0C00, C, 3, "SERCOM1", Sercom(1)).wired(10, 0x15),
    at(0x4200_1000, C, 4, "SERCOM2", Sercom(2)).wired(11, 0x16),
    at(0x4200_1400, C, 5, "SERCOM3", Sercom(3)).wired(12, 0x17),
    at(0x4200_1800, C, 6, "SERCOM4", Sercom(4)).wired(13, 0x18),
    at(0x4200_1C00, C, 7, "SERCOM5", Sercom(5)).wired(14, 0x19),
    at(0x4200_2000, C, 8, "TCC0", Tcc(0)).wired(15, 0x1A),
    at(0x4200_2400, C, 9, "TCC1", Tcc(1)).wired(16, 0x1A),
    at(0x4200_2800, C, 10, "TCC2", Tcc(2)).wired(17, 0x1B),
    at(0x4200_2C00, C, 11, "TC3", Tc(0)).wired(18, 0x1B),
    at(0x4200_3000, C, 12, "TC4", Tc(1)).wired(19, 0x1C),
    at(0x4200_3400, C, 13, "TC5", Tc(2)).wired(20, 0x1C),
    at(0x4200_3800, C, 14, "TC6", Unmodelled),
    at(0x4200_3C00, C, 15, "TC7", Unmodelled),
    at(0x4200_4000, C, 16, "ADC", Adc).wired(23, 0x1E),
    at(0x4200_4400, C, 17, "AC", Unmodelled),
    at(0x4200_4800, C, 18, "DAC", Unmodelled),
    at(0x4200_4C00, C, 19, "PTC", Unmodelled),
    at(0x4200_5000, C, 20, "I2S", Unmodelled),
];

/// PORT on the core's single-cycle I/O bus.
const IOBUS: u32 = 0x6000_0000;
const PORT: u32 = 0x4100_4400;

/// The peripheral at an address.
pub(super) fn find(addr: u32) -> Option<&'static Entry> {
    let addr = if addr & !0x3FF == IOBUS { PORT } else { addr };
    let behind = ENTRIES.partition_point(|entry| entry.base <= addr);
    let entry = &ENTRIES[behind.checked_sub(1)?];
    (addr - entry.base < entry.size).then_some(entry)
}

/// The entry of a modelled block.
pub(super) fn entry(block: Block) -> &'static Entry {
    let found = ENTRIES.iter().find(|entry| entry.block == block);
    found.expect("every model has an entry")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn entries_are_sorted_and_found_at_both_ends() {
        assert!(ENTRIES.is_sorted_by_key(|entry| entry.base));
        for entry in &ENTRIES {
            for addr in [entry.base, entry.base + entry.size - 4] {
                assert_eq!(find(addr).map(|found| found.name), Some(entry.name));
                assert_eq!(entry.offset(addr), addr - entry.base);
            }
        }
        assert_eq!(find(0x6000_0028).map(|found| found.name), Some("PORT"));
        for addr in [0x3FFF_FFFC, 0x4000_1C00, 0x4100_1000, 0x4200_5400, 0x6000_0400] {
            assert!(find(addr).is_none(), "{addr:#010x}");
        }
    }
}
