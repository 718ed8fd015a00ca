//! The user row: what the chip loads at every reset (data sheet, NVM user row mapping).
//!
//! | bits | setting |
//! |---|---|
//! | 2:0 | BOOTPROT: 7 protects nothing, each one less twice as much, 6 the first 512 bytes |
//! | 13:8, 14, 16:15, 40 | BOD33: level, enable, action, hysteresis |
//! | 25, 26 | WDT: ENABLE, ALWAYSON |
//! | 30:27, 34:31, 38:35, 39 | WDT: PER, WINDOW, EWOFFSET, WEN |
//! | 63:48 | LOCK, a bit for each region |

/// The 64 bits at 0x0080_4000.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct UserRow(pub u64);

impl UserRow {
    /// As the chip is shipped: watchdog off, BOD33 on, no protection.
    pub const SHIPPED: Self = Self(0xFFFF_FC5D_D8E0_C7FF);
    /// Erased, as some tools leave it: the watchdog is always on, with windows, and resets the chip
    /// every second (uf2-samdx1 issue 107).
    pub const ERASED: Self = Self(u64::MAX);
    /// As UF2 boards have it: the bootloader's first 8 KB are protected.
    pub const PROTECTED: Self = Self(0xFFFF_FC5D_D8E0_C7FA);

    /// The word at 0x0080_4000 or the one after it.
    pub(super) fn word(self, index: u32) -> u32 {
        (self.0 >> (32 * index)) as u32
    }

    /// How much from address 0 can neither be erased nor programmed, bytes.
    pub(super) fn protected_bytes(self) -> u32 {
        match self.0 & 7 {
            7 => 0,
            code => 0x8000 >> code,
        }
    }

    /// SYSCTRL.BOD33.
    pub(super) fn bod33(self) -> u32 {
        let row = self.0;
        let (level, enable, action) = (row >> 8 & 0x3F, row >> 14 & 1, row >> 15 & 3);
        (level << 16 | action << 3 | (row >> 40 & 1) << 2 | enable << 1) as u32
    }

    /// WDT.CTRL: ALWAYSON, WEN, ENABLE.
    pub(super) fn wdt_ctrl(self) -> u8 {
        let row = self.0;
        ((row >> 26 & 1) << 7 | (row >> 39 & 1) << 2 | (row >> 25 & 1) << 1) as u8
    }

    /// WDT.CONFIG: WINDOW, PER.
    pub(super) fn wdt_config(self) -> u8 {
        (self.0 >> 27) as u8
    }

    /// WDT.EWCTRL.
    pub(super) fn wdt_early_warning(self) -> u8 {
        (self.0 >> 35 & 0xF) as u8
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shipped_row_gives_the_reset_values_of_the_data_sheet() {
        let row = UserRow::SHIPPED;
        assert_eq!([row.word(0), row.word(1)], [0xD8E0_C7FF, 0xFFFF_FC5D]);
        assert_eq!((row.wdt_ctrl(), row.wdt_config(), row.wdt_early_warning()), (0, 0xBB, 0xB));
        // Level 7, reset, enabled.
        assert_eq!(row.bod33(), 7 << 16 | 1 << 3 | 1 << 1);
        assert_eq!(row.protected_bytes(), 0);
    }

    #[test]
    fn an_erased_row_has_everything_on_but_protection() {
        let row = UserRow::ERASED;
        assert_eq!((row.wdt_ctrl(), row.wdt_config()), (0x86, 0xFF));
        assert_eq!(row.protected_bytes(), 0);
    }

    #[test]
    fn uf2_boards_protect_8_kb() {
        assert_eq!(UserRow::PROTECTED.protected_bytes(), 8192);
        assert_eq!(UserRow(6).protected_bytes(), 512);
        assert_eq!(UserRow(0).protected_bytes(), 32_768);
    }
}
