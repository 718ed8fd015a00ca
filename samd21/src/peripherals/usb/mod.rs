//! USB: full-speed device controller.
//!
//! | offset | register | behaviour |
//! |---|---|---|
//! | 00 | CTRLA | SWRST, ENABLE, RUNSTDBY; MODE device only |
//! | 02 | SYNCBUSY | SWRST, ENABLE |
//! | 03, 28 | QOSCTRL, PADCAL | stored |
//! | 08 | CTRLB | DETACH; the host sees the pull-up |
//! | 0A | DADD | address, valid with ADDEN, else 0 |
//! | 0C, 0D | STATUS, FSMSTATUS | line state and bus state |
//! | 10 | FNUM | frame number |
//! | 14, 18, 1C | INTENCLR, INTENSET, INTFLAG | SUSPEND, SOF, EORST, WAKEUP, RAMACER |
//! | 20 | EPINTSMRY | endpoints with an enabled flag |
//! | 24 | DESCADD | descriptors in SRAM: 8 x 2 banks of 16 bytes |
//! | 100+20n | EPCFG | EPTYPE0 (OUT), EPTYPE1 (IN) |
//! | 104-106+20n | EPSTATUSCLR, EPSTATUSSET, EPSTATUS | toggles, STALLRQ, BKxRDY |
//! | 107-109+20n | EPINTFLAG, EPINTENCLR, EPINTENSET | TRCPT, TRFAIL, RXSTP, STALL |
//!
//! What tokens do to banks and descriptors is in `endpoint`. The end of a bus reset clears
//! EPCFG1-7, DADD, FNUM, all EPINTFLAG and EPINTEN, STALLRQ and UPRSM, but not BKxRDY. An endpoint
//! without a type has no interrupts enabled and its toggles are clear.
//!
//! | left out | why |
//! |---|---|
//! | host mode, isochronous and dual-bank endpoints | not used: setting one faults |
//! | low speed, LPM, remote wake-up, test modes | not used: setting one faults |
//! | CRC errors and lost packets on the wire | the cable is good |
//! | memory access time of the DMA | far below a byte on the wire |

mod endpoint;
#[cfg(test)]
mod tests;

pub(crate) use endpoint::Refused;

use super::access::{Bus, DONE, Lanes, RESERVED, Read, Refusal, Write};
use super::clock::{Rate, SyncFlags};
use super::interrupts::Interrupts;
use super::map::Block;
use crate::board::Ticks;
use endpoint::Endpoint;

const SWRST: u8 = 1 << 0;
const ENABLE: u8 = 1 << 1;
const DETACH: u16 = 1 << 0;

const SUSPEND: u32 = 1 << 0;
const SOF: u32 = 1 << 2;
const EORST: u32 = 1 << 3;
const WAKEUP: u32 = 1 << 4;
const RAMACER: u32 = 1 << 7;

/// Idle time of the bus after which a device has to suspend (USB 2.0, 7.1.7.6).
const IDLE_LIMIT: Ticks = Ticks::from_ms(3);
/// GCLK_USB at which hosts have been seen to enumerate the device, Hz: it locks to their frames
/// from 3 % below (atsamd-rs pull request 625).
const CLOCK_HZ: std::ops::RangeInclusive<f64> = 45.6e6..=50.4e6;
/// Endpoint numbers that the controller has.
const ENDPOINTS: usize = 8;

#[derive(Clone, Debug, Default)]
pub(crate) struct Usb {
    /// Clocked: GCLK_USB is there at about 48 MHz.
    sync: SyncFlags<2>,
    /// PA24 and PA25 are USB's.
    pub(crate) pads: bool,
    ctrla: u8,
    qos: u8,
    ctrlb: u16,
    address: u8,
    frame: u16,
    interrupts: Interrupts<0x03FF>,
    descriptors: u32,
    padcal: u16,
    endpoints: [Endpoint; ENDPOINTS],
    suspended: bool,
    last_activity: Ticks,
}

/// The endpoint that has a register.
fn index(offset: u32) -> usize {
    ((offset - 0x100) / 0x20) as usize
}

impl Usb {
    pub(crate) fn new(hold: Ticks) -> Self {
        Self {
            sync: SyncFlags::new(hold),
            qos: 5,
            ctrlb: DETACH,
            interrupts: Interrupts::of(Block::Usb),
            ..Self::default()
        }
    }

    pub(crate) fn set_clock(&mut self, now: Ticks, clock: Option<Rate>) {
        let clocked = clock.is_some_and(|clock| CLOCK_HZ.contains(&clock.hz()));
        self.sync.set_clocked(now, clocked);
    }

    /// Whether the pull-up on D+ shows a device, and one that can answer.
    pub(crate) fn is_attached(&self) -> bool {
        self.ctrla & ENABLE != 0 && self.ctrlb & DETACH == 0 && self.pads && self.sync.clocked
    }

    pub(crate) fn irq(&self) -> u32 {
        let requested = self.interrupts.is_requested() || self.summary() != 0;
        self.interrupts.irq_if(self.ctrla & ENABLE != 0 && requested)
    }

    /// When the bus will have been idle for too long.
    pub(crate) fn next(&self) -> Ticks {
        if self.is_attached() && !self.suspended {
            self.last_activity + IDLE_LIMIT
        } else {
            Ticks::NEVER
        }
    }

    pub(crate) fn advance(&mut self, now: Ticks) {
        if self.next() <= now {
            self.suspended = true;
            self.interrupts.flags |= SUSPEND;
        }
    }

    /// The host has ended a bus reset.
    pub(crate) fn bus_reset(&mut self, now: Ticks) {
        self.wake(now);
        self.address = 0;
        self.frame = 0;
        self.ctrlb &= DETACH;
        for (number, endpoint) in self.endpoints.iter_mut().enumerate() {
            endpoint.bus_reset(number == 0);
        }
        self.interrupts.flags |= EORST;
    }

    /// The host has sent a start-of-frame packet.
    pub(crate) fn start_of_frame(&mut self, now: Ticks, frame: u16) {
        self.wake(now);
        self.frame = frame & 0x7FF;
        self.interrupts.flags |= SOF;
    }

    pub(crate) fn wake(&mut self, now: Ticks) {
        self.last_activity = now;
        if self.suspended {
            self.suspended = false;
            self.interrupts.flags |= WAKEUP;
        }
    }

    fn summary(&self) -> u8 {
        (0..ENDPOINTS)
            .fold(0, |summary, number| summary | u8::from(self.endpoints[number].irq()) << number)
    }

    /// A bit of a register flips: see [`upset`](crate::upset).
    pub(crate) fn flip(&mut self, offset: u32, bit: u32) -> bool {
        let mask = 1_u32 << bit;
        match offset {
            0x00 if mask == u32::from(ENABLE) => self.ctrla ^= ENABLE,
            0x08 if mask == u32::from(DETACH) => self.ctrlb ^= DETACH,
            0x08 if (16..24).contains(&bit) => self.address ^= (mask >> 16) as u8,
            0x18 => return self.interrupts.flip(mask),
            0x24 if bit >= 2 => self.descriptors ^= mask,
            0x100..0x200 => return self.endpoints[index(offset)].flip(offset % 0x20, bit),
            _ => return false,
        }
        true
    }

    pub(crate) fn read(&self, now: Ticks, offset: u32) -> Read {
        Ok(match offset {
            0x00 => {
                let ctrla = self.ctrla | u8::from(self.sync.is_busy(now, 0));
                u32::from(ctrla) | self.sync.bits(now) << 16 | u32::from(self.qos) << 24
            }
            0x08 => u32::from(self.ctrlb) | u32::from(self.address) << 16,
            // SPEED: full; LINESTATE: J. FSMSTATUS: OFF, ON, SUSPEND.
            0x0C => {
                let fsm = match (self.is_attached(), self.suspended) {
                    (false, _) => 0x01,
                    (true, false) => 0x02,
                    (true, true) => 0x04,
                };
                0x40 | fsm << 8
            }
            0x10 => u32::from(self.frame) << 3,
            0x14 | 0x18 | 0x1C => self.interrupts.read_words(offset - 0x14),
            0x20 => u32::from(self.summary()),
            0x24 => self.descriptors,
            0x28 => u32::from(self.padcal),
            0x100..0x200 => return self.endpoints[index(offset)].read(offset % 0x20),
            _ => return Err(RESERVED),
        })
    }

    pub(crate) fn write(&mut self, bus: &mut Bus<'_>, offset: u32, lanes: Lanes) -> Write {
        match offset {
            0x00 => {
                if let Some(ctrla) = lanes.byte(0) {
                    self.write_ctrla(bus, ctrla)?;
                }
                if let Some(qos) = lanes.byte(3) {
                    self.qos = qos & 0xF;
                }
            }
            0x08 => {
                if let Some(ctrlb) = lanes.half(0, self.ctrlb) {
                    if ctrlb & !DETACH != 0 {
                        return Err(Refusal::Unmodelled("CTRLB beyond DETACH"));
                    }
                    self.ctrlb = ctrlb;
                    self.last_activity = bus.now;
                    if ctrlb & DETACH == 0 && !self.is_attached() {
                        let what = "attached without being enabled, clocked at about 48 MHz and on its pads";
                        bus.note("USB", what);
                    }
                }
                if let Some(address) = lanes.byte(2) {
                    self.address = address;
                }
            }
            0x0C | 0x10 | 0x20 => {}
            0x14 | 0x18 | 0x1C => self.interrupts.write_words(offset - 0x14, lanes),
            0x24 => self.descriptors = lanes.merge(self.descriptors),
            0x28 => self.padcal = lanes.merge(u32::from(self.padcal)) as u16,
            0x100..0x200 => return self.endpoints[index(offset)].write(offset % 0x20, lanes),
            _ => return Err(RESERVED),
        }
        DONE
    }

    fn write_ctrla(&mut self, bus: &mut Bus<'_>, value: u8) -> Result<(), Refusal> {
        if value & 0x80 != 0 {
            return Err(Refusal::Unmodelled("host mode"));
        }
        if self.sync.bits(bus.now) != 0 {
            bus.note("USB", "CTRLA written while it synchronises: discarded");
            return Ok(());
        }
        if value & SWRST != 0 {
            *self = Self { sync: self.sync.clone(), pads: self.pads, ..Self::new(Ticks::ZERO) };
            self.sync.begin(bus.now, 0);
            return Ok(());
        }
        if (self.ctrla ^ value) & ENABLE != 0 {
            self.sync.begin(bus.now, 1);
            self.last_activity = bus.now;
        }
        self.ctrla = value & 0x06;
        Ok(())
    }
}
