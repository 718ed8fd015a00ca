//! Where the peripherals are.

/// The three APB bridges.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Bridge {
    A,
    B,
    C,
}

/// What an address belongs to.
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
    Unmodelled,
}

/// A block on an APB bridge: where, name, and index in the bridge's masks.
pub(super) struct Mapping {
    pub(super) base: u32,
    pub(super) bridge: Bridge,
    pub(super) index: u32,
    pub(super) name: &'static str,
    pub(super) block: Block,
}

/// The block at an address of the APB bridges with its number in the power manager's masks,
/// which is also the access controller's.
pub(super) fn map(addr: u32) -> Option<Mapping> {
    use Block::{
        Dsu, Eic, Gclk, Nvmctrl, Pac, Pm, Port, Sercom, Sysctrl, Tc, Tcc, Unmodelled, Usb, Wdt,
    };
    use Bridge::{A, B, C};
    let (bridge, index, name, block) = match addr & !0x3FF {
        0x4000_0000 => (A, 0, "PAC0", Pac(0)),
        0x4000_0400 => (A, 1, "PM", Pm),
        0x4000_0800 => (A, 2, "SYSCTRL", Sysctrl),
        0x4000_0C00 => (A, 3, "GCLK", Gclk),
        0x4000_1000 => (A, 4, "WDT", Wdt),
        0x4000_1400 => (A, 5, "RTC", Unmodelled),
        0x4000_1800 => (A, 6, "EIC", Eic),
        0x4100_0000 => (B, 0, "PAC1", Pac(1)),
        0x4100_2000..0x4100_4000 => (B, 1, "DSU", Dsu),
        0x4100_4000 => (B, 2, "NVMCTRL", Nvmctrl),
        // The second is the core's single-cycle I/O bus.
        0x4100_4400 | 0x6000_0000 => (B, 3, "PORT", Port),
        0x4100_4800 => (B, 4, "DMAC", Unmodelled),
        0x4100_5000 => (B, 5, "USB", Usb),
        0x4100_6000 => (B, 6, "MTB", Unmodelled),
        0x4100_7000 => (B, 6, "HMATRIX", Unmodelled),
        0x4200_0000 => (C, 0, "PAC2", Pac(2)),
        0x4200_0400 => (C, 1, "EVSYS", Unmodelled),
        0x4200_0800 => (C, 2, "SERCOM0", Sercom(0)),
        0x4200_0C00 => (C, 3, "SERCOM1", Sercom(1)),
        0x4200_1000 => (C, 4, "SERCOM2", Sercom(2)),
        0x4200_1400 => (C, 5, "SERCOM3", Sercom(3)),
        0x4200_1800 => (C, 6, "SERCOM4", Sercom(4)),
        0x4200_1C00 => (C, 7, "SERCOM5", Sercom(5)),
        0x4200_2000 => (C, 8, "TCC0", Tcc(0)),
        0x4200_2400 => (C, 9, "TCC1", Tcc(1)),
        0x4200_2800 => (C, 10, "TCC2", Tcc(2)),
        0x4200_2C00 => (C, 11, "TC3", Tc(0)),
        0x4200_3000 => (C, 12, "TC4", Tc(1)),
        0x4200_3400 => (C, 13, "TC5", Tc(2)),
        0x4200_3800 => (C, 14, "TC6", Unmodelled),
        0x4200_3C00 => (C, 15, "TC7", Unmodelled),
        0x4200_4000 => (C, 16, "ADC", Unmodelled),
        0x4200_4400 => (C, 17, "AC", Unmodelled),
        0x4200_4800 => (C, 18, "DAC", Unmodelled),
        0x4200_4C00 => (C, 19, "PTC", Unmodelled),
        0x4200_5000 => (C, 20, "I2S", Unmodelled),
        _ => return None,
    };
    let base = match block {
        Dsu => 0x4100_2000,
        _ => addr & !0x3FF,
    };
    Some(Mapping {
        base,
        bridge,
        index,
        name,
        block,
    })
}
