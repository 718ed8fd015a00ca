//! What is around the application: a sensor, a port with a host behind it, flash.

use std::vec::Vec;

use super::*;
use crate::flight::tests::reading;
use crate::sensor::Kind;
use crate::store::tests::Mock;

/// From the host's request to the reset, as `src/samd21/usb.rs` has it.
const RESET_DELAY_US: u64 = 100_000;

/// What is wrong with the sensor or its bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Trouble {
    None,
    /// It does not acknowledge its address.
    Silent,
    /// Ticks come without their bursts.
    Late,
    /// Nobody drives the data line.
    Ones,
    /// Its outputs stand still.
    Frozen,
    /// Words that no motion explains.
    Wild,
}

/// A BNO055 that is quick: registers are what was written, modes change at once.
#[derive(Clone)]
pub(super) struct Chip {
    pages: [[u8; 128]; 2],
    page: usize,
    pub(super) trouble: Trouble,
    pub(super) pitch_rad: f64,
    pub(super) rate_rad_s: f64,
    /// Acceleration that is felt besides gravity from tail to nose, counts.
    pub(super) thrust: i16,
    bursts: u64,
}

impl Chip {
    fn new() -> Self {
        let mut chip = Self {
            pages: [[0; 128]; 2],
            page: 0,
            trouble: Trouble::None,
            pitch_rad: 0.0,
            rate_rad_s: 0.0,
            thrust: 0,
            bursts: 0,
        };
        chip.power_on();
        chip
    }

    /// Registers at their defaults (data sheet section 4.2).
    pub(super) fn power_on(&mut self) {
        self.page = 0;
        self.pages = [[0; 128]; 2];
        let [zero, one] = &mut self.pages;
        zero[..8].copy_from_slice(&[0xA0, 0xFB, 0x32, 0x0F, 0x11, 0x03, 0x15, 0x00]);
        zero[0x36] = 0x0F;
        zero[0x3B] = 0x80;
        zero[0x41] = 0x24;
        one[8..12].copy_from_slice(&[0x0D, 0x6D, 0x38, 0x00]);
    }

    fn measure(&mut self) {
        let mode = self.pages[0][0x3D] & 0x0F;
        self.pages[0][0x39] = if mode == 0 { 0 } else { 6 };
        if mode == 0 {
            self.pages[0][8..0x1A].fill(0);
        } else if self.trouble != Trouble::Frozen {
            self.bursts += 1;
            let mut sample = reading(0, self.pitch_rad, self.rate_rad_s);
            // Noise, without which it would count as frozen.
            sample.gyr[0] += (self.bursts % 3) as i16 - 1;
            sample.acc[2] -= self.thrust;
            if self.trouble == Trouble::Wild {
                sample.acc[1] = if self.bursts.is_multiple_of(2) { 15_000 } else { -15_000 };
            }
            let words = [sample.acc, sample.mag, sample.gyr];
            let bytes = words.as_flattened().iter().flat_map(|word| word.to_le_bytes());
            for (place, byte) in self.pages[0][8..].iter_mut().zip(bytes) {
                *place = byte;
            }
        }
    }

    pub(super) fn perform(&mut self, transfer: &Transfer) -> Result<Vec<u8>, BusError> {
        match (transfer, self.trouble) {
            (_, Trouble::Silent) => Err(BusError::Nak),
            (Transfer::Write { register, bytes }, _) => {
                for (at, byte) in (usize::from(*register)..).zip(bytes.as_slice()) {
                    if at == 7 {
                        self.page = usize::from(byte & 1);
                        (self.pages[0][7], self.pages[1][7]) = (byte & 1, byte & 1);
                    } else {
                        self.pages[self.page][at] = *byte;
                    }
                }
                Ok(Vec::new())
            }
            (Transfer::Read { len, .. }, Trouble::Ones) => Ok(std::vec![0xFF; usize::from(*len)]),
            (Transfer::Read { register, len }, _) => {
                self.measure();
                let from = usize::from(*register);
                Ok(self.pages[self.page][from..from + usize::from(*len)].to_vec())
            }
        }
    }
}

/// The board of the search.
#[derive(Clone)]
pub(super) struct World {
    pub(super) chip: Chip,
    pub(super) flash: Mock,
    pub(super) port: Port,
    pub(super) packet: Vec<u8>,
    /// What the host has received and not looked at.
    pub(super) sent: Vec<u8>,
    /// What the transfer has read that was told last.
    pub(super) answer: Vec<u8>,
    /// A transfer under way.
    pub(super) transfer: Option<Transfer>,
    pub(super) tick: Micros,
    /// What the newest step has asked for.
    pub(super) end: Option<StepEnd>,
    pub(super) reset_at: Option<Micros>,
    /// The time for the reset has come.
    pub(super) is_reset: bool,
    /// Orders to the board itself that were obeyed.
    pub(super) shown: u32,
}

impl World {
    pub(super) fn new(flash: Mock) -> Self {
        Self {
            chip: Chip::new(),
            flash,
            port: Port::Open,
            packet: Vec::new(),
            sent: Vec::new(),
            answer: Vec::new(),
            transfer: None,
            tick: Micros(0),
            end: None,
            reset_at: None,
            is_reset: false,
            shown: 0,
        }
    }
}

impl Sum for World {
    fn sum<T>(&self, _value: &T) -> u32 {
        0
    }
}

impl Board for World {
    type Flash = Mock;

    fn answer(&self) -> &[u8] {
        &self.answer
    }
    fn arm(&mut self, _bursts: &Bursts) {}
    fn bus(&self) -> Bus {
        match self.transfer {
            Some(_) => Bus::Busy,
            None => Bus::Free,
        }
    }
    fn has_time_for(&self, _transfer: &Transfer, _sensor: Kind) -> bool {
        true
    }
    fn begin(&mut self, _address: u8, transfer: Transfer) {
        self.transfer = Some(transfer);
    }
    fn step_begins(&mut self) {}
    fn carried_tick(&self) -> Micros {
        self.tick
    }
    fn step_ends(&mut self, end: &StepEnd) {
        self.end = Some(*end);
    }
    fn status(&self) -> BoardStatus {
        BoardStatus::default()
    }
    fn poll_port(&mut self, now: Micros, armed: bool) -> Port {
        match self.reset_at {
            Some(_) if armed => self.reset_at = None,
            Some(at) => self.is_reset |= now >= at,
            None => {}
        }
        self.port
    }
    fn read(&mut self) -> &[u8] {
        self.answer = core::mem::take(&mut self.packet);
        &self.answer
    }
    fn write(&mut self, bytes: &[u8]) -> usize {
        self.sent.extend_from_slice(bytes);
        bytes.len()
    }
    fn flash(&mut self) -> &mut Mock {
        &mut self.flash
    }
    fn stop(&mut self, check: SelfCheck) {
        panic!("no memory has flipped, and yet: {check}");
    }

    fn reset_soon(&mut self, now: Micros, _reset: Reset) {
        self.reset_at = Some(now.after(RESET_DELAY_US));
    }
    fn bringup(&mut self, _order: Order) -> Option<u32> {
        self.shown += 1;
        Some(7)
    }
}
