//! What the core reaches beyond its own registers, and the order in which all of it acts.

use crate::board::{Board, Ticks};
use crate::memory::Memory;
use crate::peripherals::{BusError, Peripherals, Width};
use crate::usb_host::Host;

/// The memories, the peripherals, the USB host at the other end of the cable, and the board.
pub(crate) struct Bus<'a> {
    pub(crate) memory: &'a mut Memory,
    pub(crate) peripherals: &'a mut Peripherals,
    pub(crate) usb_host: &'a mut Host,
    pub(crate) board: &'a mut dyn Board,
}

impl Bus<'_> {
    /// The earliest time at which a peripheral or the USB host acts by itself.
    pub(crate) fn next_event(&self) -> Ticks {
        self.peripherals.next.min(self.usb_host.next())
    }

    /// Runs everything that is due up to `now`, in the order of time. Of what is due at the same
    /// time the USB host comes last.
    pub(crate) fn advance(&mut self, now: Ticks) {
        while self.next_event() <= now {
            let due = self.next_event();
            let at = self.peripherals.run(due, self.board);
            if self.usb_host.next() <= at {
                self.settle(at);
                let usb = &mut self.peripherals.usb;
                if self.usb_host.advance(at, usb, self.memory) {
                    self.peripherals.start_of_frame(at);
                }
            }
            self.peripherals.refresh(at);
            self.usb_host.observe(at, &self.peripherals.usb);
        }
        self.peripherals.last = now;
    }

    /// Has the USB host do what it has left out up to `now`.
    pub(crate) fn settle(&mut self, now: Ticks) {
        self.usb_host.settle(now, &mut self.peripherals.usb, self.memory);
    }

    /// Reads from a peripheral, or a word of the auxiliary flash rows; and how long the bus stalls
    /// the CPU beyond the access itself.
    ///
    /// # Errors
    /// Nothing answers there, or the access is one that no model covers.
    pub(crate) fn read(
        &mut self,
        now: Ticks,
        addr: u32,
        width: Width,
    ) -> Result<(u32, Ticks), BusError> {
        self.settle(now);
        let value = self.peripherals.read(now, addr, width, self.board)?;
        Ok((value, self.peripherals.read_stall(addr)))
    }

    /// Writes to a peripheral, or to the page buffer where `addr` lies in flash. Returns how long
    /// the bus stalls the CPU beyond the access itself.
    ///
    /// # Errors
    /// Nothing answers there, or the access is one that no model covers.
    pub(crate) fn write(
        &mut self,
        now: Ticks,
        addr: u32,
        width: Width,
        value: u32,
    ) -> Result<Ticks, BusError> {
        self.advance(now);
        self.settle(now);
        let stall = self.peripherals.write(now, addr, width, value, self.memory, self.board)?;
        self.usb_host.observe(now, &self.peripherals.usb);
        Ok(stall + self.peripherals.bridge_stall(addr))
    }
}
