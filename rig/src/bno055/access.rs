//! What reading and writing a register does.

use super::registers::{Mode, error, page0, page1, status, trigger, unit};
use super::{Bno055, FaultKind, GROUPS, Power};
use samd21::board::Ticks;

// How long it takes to leave CONFIG and to return to it (data sheet page 21), to test itself, and
// to change the clock source.
const TO_RUNNING: Ticks = Ticks::from_ms(7);
const TO_CONFIG: Ticks = Ticks::from_ms(19);
const SELF_TEST: Ticks = Ticks::from_ms(400);
const CLOCK_CHANGE: Ticks = Ticks::from_ms(600);

/// A byte written to a register, and when it acts.
#[derive(Clone, Copy, Debug)]
pub(super) struct LateWrite {
    pub(super) at: Ticks,
    page: usize,
    address: u8,
    value: u8,
}

impl Bno055 {
    pub(super) fn read(&self, now: Ticks, address: u8) -> u8 {
        if let Power::Booting { answers, ready } = self.power {
            // Before it is ready every register reads zero but SYS_STATUS.
            let half = answers + (ready - answers) / 2;
            return match address {
                page0::SYS_STATUS if now < half => status::INIT_PERIPHERALS,
                page0::SYS_STATUS => status::INIT_SYSTEM,
                _ => 0,
            };
        }
        if address == page0::PAGE_ID {
            return self.page as u8;
        }
        if self.page == 1 {
            return self.pages[1][usize::from(address)];
        }
        let stored = self.get(address);
        let gyro_dead = self.faults.has(FaultKind::GyroDead);
        match address {
            page0::GYR_ID if gyro_dead => 0,
            page0::ST_RESULT if gyro_dead => stored & !0x04,
            page0::TEMP => self.temperature(),
            page0::CALIB_STAT if self.mode.is_fusion() => self.calibration.register(self.mode),
            page0::CALIB_STAT => 0,
            page0::SYS_CLK_STATUS => u8::from(now < self.clock_busy_until),
            page0::SYS_STATUS => self.system_status(now),
            page0::SYS_ERR => self.system_error(),
            page0::OPR_MODE => self.mode as u8,
            page0::SYS_TRIGGER => 0,
            _ => stored,
        }
    }

    fn system_status(&self, now: Ticks) -> u8 {
        if self.system_error() != 0 {
            status::ERROR
        } else if now < self.self_test_until {
            status::SELF_TEST
        } else if self.mode == Mode::Config {
            status::IDLE
        } else if self.mode.is_fusion() {
            status::FUSION
        } else {
            status::NO_FUSION
        }
    }

    fn system_error(&self) -> u8 {
        if self.faults.has(FaultKind::AllZero) {
            error::PERIPHERAL_INIT
        } else {
            self.get(page0::SYS_ERR)
        }
    }

    /// TEMP, in steps of 1 C or of 2 F.
    fn temperature(&self) -> u8 {
        let celsius = self.signals.temperature_c();
        let steps = if self.get(page0::UNIT_SEL) & unit::TEMP_F == 0 {
            celsius
        } else {
            (celsius * 1.8 + 32.0) / 2.0
        };
        (steps.round() as i8).cast_unsigned()
    }

    /// Takes a byte for a register of the page in force; it acts at once or late, or it is lost.
    pub(super) fn write(&mut self, now: Ticks, address: u8, value: u8) {
        if self.power != Power::On {
            return;
        }
        let before = self.last_write.replace(now);
        let hasty = before.is_some_and(|before| now < before + self.config.lost_within);
        if *self.transfer.lost.get_or_insert(hasty) {
            return;
        }
        let late = self.config.late_registers;
        let write = LateWrite { at: now + late, page: self.page, address, value };
        if late == Ticks::ZERO || address == page0::PAGE_ID {
            self.carry_out(write);
        } else {
            self.late.push_back(write);
        }
    }

    /// Does what a write is for.
    pub(super) fn carry_out(&mut self, write: LateWrite) {
        let LateWrite { at: now, page, address, value } = write;
        if self.power != Power::On {
            return;
        }
        if address == page0::PAGE_ID {
            if value <= 1 {
                self.page = usize::from(value);
            }
            return;
        }
        let config =
            self.mode == Mode::Config && self.switching.is_none() && now >= self.self_test_until;
        if page == 1 {
            self.write_page1(address, value, config);
            return;
        }
        match address {
            page0::OPR_MODE => self.switch_mode(now, value),
            page0::SYS_TRIGGER => self.trigger(now, value, config),
            _ if !config => {}
            page0::UNIT_SEL => self.set(address, value & unit::MASK),
            page0::PWR_MODE if value & 3 < 3 => self.set(address, value & 3),
            page0::TEMP_SOURCE if value & 3 < 2 => self.set(address, value & 3),
            page0::AXIS_MAP_CONFIG if is_axis_map(value) => self.set(address, value & 0x3F),
            page0::AXIS_MAP_SIGN => self.set(address, value & 0x07),
            page0::SIC_MATRIX..page0::ACC_OFFSET => self.set(address, value),
            page0::ACC_OFFSET..=page0::MAG_RADIUS_MSB => self.stage(address, value),
            _ => {}
        }
    }

    fn write_page1(&mut self, address: u8, value: u8, config: bool) {
        let allowed = match address {
            page1::INT_MSK | page1::INT_EN => true,
            page1::GYR_CONFIG_0 => config && value & 7 <= 4 && value < 0x40,
            page1::MAG_CONFIG => config && value < 0x80,
            page1::ACC_CONFIG
            | page1::GYR_CONFIG_1
            | page1::ACC_SLEEP_CONFIG
            | page1::GYR_SLEEP_CONFIG => config,
            _ => config && (page1::INT_EN..=page1::GYR_AM_SET).contains(&address),
        };
        if allowed {
            self.pages[1][usize::from(address)] = value;
        }
    }

    fn switch_mode(&mut self, now: Ticks, value: u8) {
        let Some(mode) = Mode::from_code(value & 0x0F) else {
            return;
        };
        let takes = match (self.mode, mode) {
            (from, to) if from == to => {
                self.switching = None;
                return;
            }
            (Mode::Config, _) => TO_RUNNING,
            (_, Mode::Config) => TO_CONFIG,
            _ => return,
        };
        // A repeated request does not start the wait again.
        if self.switching.is_none_or(|(target, _)| target != mode) {
            self.switching = Some((mode, now + takes));
        }
    }

    fn trigger(&mut self, now: Ticks, value: u8, config: bool) {
        if value & trigger::RST_SYS != 0 {
            return self.boot(now);
        }
        if value & trigger::RST_INT != 0 {
            self.set(page0::INT_STA, 0);
        }
        if config {
            let before = self.get(page0::SYS_TRIGGER);
            if (before ^ value) & trigger::CLK_SEL != 0 {
                self.clock_busy_until = now + CLOCK_CHANGE;
            }
            self.set(page0::SYS_TRIGGER, value & trigger::CLK_SEL);
            if value & trigger::SELF_TEST != 0 {
                self.self_test_until = now + SELF_TEST;
            }
        }
    }

    /// Takes a byte of the calibration profile; a group takes effect when its last byte is written.
    fn stage(&mut self, address: u8, value: u8) {
        let byte = usize::from(address - page0::ACC_OFFSET);
        self.staged[byte] = value;
        let Some(group) = GROUPS.iter().position(|&(first, words)| byte == first + 2 * words - 1)
        else {
            return;
        };
        let (first, words) = GROUPS[group];
        let limit = self.profile_limit(group);
        let within = (0..words).all(|i| {
            let at = first + 2 * i;
            let word = i16::from_le_bytes([self.staged[at], self.staged[at + 1]]);
            i32::from(word).abs() <= limit
        });
        self.refused[group] = !within;
        for at in first..first + 2 * words {
            self.set(page0::ACC_OFFSET + at as u8, if within { self.staged[at] } else { 0 });
        }
    }

    /// Largest magnitude that a word of the group may have, counts.
    fn profile_limit(&self, group: usize) -> i32 {
        let settings = self.settings();
        match group {
            0 => {
                let mg = settings.acc_range_g * 1000.0;
                let lsb_per_mg =
                    if self.get(page0::UNIT_SEL) & unit::ACC_MG == 0 { 0.980_665 } else { 1.0 };
                (mg * lsb_per_mg) as i32
            }
            1 => 6400,
            2 => (settings.gyr_range_dps * 16.0) as i32,
            // The data sheet allows 1000; a user reports that 1000 was refused.
            3 => 999,
            _ => 960,
        }
    }
}

/// True if each sensor axis appears once.
fn is_axis_map(value: u8) -> bool {
    let axes = [value & 3, value >> 2 & 3, value >> 4 & 3];
    (0..3).all(|axis| axes.contains(&axis))
}
