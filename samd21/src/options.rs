//! What may be chosen when a chip is made.

use crate::board::Ticks;
use crate::peripherals::UserRow;
use crate::usb_host::System;

/// How a chip is made.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// Flash wait states, whatever the firmware writes to NVMCTRL.CTRLB.RWS: to measure what they
    /// cost. None leaves them to the firmware.
    pub wait_states: Option<u8>,
    /// How long a SYNCBUSY flag stays set after a write to a synchronised register: at most six
    /// cycles of the peripheral's clock and three of the bus (data sheet 14.3), here of 48 MHz.
    pub syncbusy_hold: Ticks,
    /// How long an access over the APB bridges stalls the core: an assumption.
    pub bridge_stall: Ticks,
    /// Error of the DFLL's frequency with the factory's COARSE and FINE 0x1FF, ppm. Without a
    /// reference such chips run at 46.5 to 48 MHz.
    pub dfll_error_ppm: i32,
    /// How fast that error grows, ppm/s: the chip warms up.
    pub dfll_drift_ppm_s: i32,
    /// Frequency of OSCULP32K, Hz: nominally 32,768.
    pub osculp32k_hz: u32,
    /// How far the watchdog's clock, which comes from there, is into a cycle of it at power-on.
    pub osculp32k_phase: Ticks,
    /// How long the core takes to wake from sleep.
    pub wake_up: Ticks,
    /// SysTick stands still while the core sleeps. In IDLE 0 the CPU's clock stops (data sheet,
    /// table 16-4); programs that count by SysTick show that it goes on.
    pub systick_stops: bool,
    /// The user row, which sets watchdog, brown-out detector and protection at every reset.
    pub user_row: UserRow,
    /// How long erasing and writing flash take, relative to the data sheet's longest times; whole
    /// percent count.
    pub flash_time: f64,
    /// How many cycles of the core the DSU's engine takes for a word of flash, whole ones: an
    /// assumption.
    pub crc_word_cycles: f64,
    /// Whether the watchdog resets the chip at its time-out.
    pub watchdog_bites: bool,
    /// The operating system of the USB host.
    pub host: System,
    /// Decides what is random in a chip: the noise in SRAM at power-on, and which bits a flash
    /// command has changed that a reset cuts short.
    pub seed: u64,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            wait_states: None,
            syncbusy_hold: Ticks(9),
            bridge_stall: Ticks::ZERO,
            dfll_error_ppm: 0,
            dfll_drift_ppm_s: 0,
            osculp32k_hz: 32_768,
            osculp32k_phase: Ticks::ZERO,
            wake_up: Ticks::ZERO,
            systick_stops: false,
            user_row: UserRow::SHIPPED,
            flash_time: 1.0,
            crc_word_cycles: 4.0,
            watchdog_bites: true,
            host: System::Bare,
            seed: 0,
        }
    }
}
