//! A pin by port and number, at register level: the sensor bus needs its lines as GPIO and as
//! SERCOM in turn.

use atsamd_hal::pac;

/// Peripheral function of a pin (data sheet section 7, table 7-1).
#[derive(Clone, Copy)]
#[repr(u8)]
pub(super) enum Function {
    /// SERCOM-ALT.
    D = 3,
    /// TCC.
    F = 5,
    /// USB.
    G = 6,
}

#[derive(Clone, Copy)]
enum Group {
    A,
    B,
}

/// One pin of the chip.
#[derive(Clone, Copy)]
pub(super) struct Pin {
    group: Group,
    number: u8,
}

impl Pin {
    /// PA`number`, 0 to 31.
    pub(super) const fn a(number: u8) -> Self {
        let group = Group::A;
        Self { group, number }
    }

    /// PB`number`, 0 to 31.
    pub(super) const fn b(number: u8) -> Self {
        let group = Group::B;
        Self { group, number }
    }

    /// Drive it high.
    #[inline]
    pub(super) fn high(self) {
        // SAFETY: set registers act on the bits written 1 only; every pin has one user.
        unsafe {
            port().outset(self.group()).write(|w| w.bits(self.mask()));
            port().dirset(self.group()).write(|w| w.bits(self.mask()));
        }
    }

    /// Drive it low.
    #[inline]
    pub(super) fn low(self) {
        // SAFETY: as in `high`.
        unsafe {
            port().outclr(self.group()).write(|w| w.bits(self.mask()));
            port().dirset(self.group()).write(|w| w.bits(self.mask()));
        }
    }

    /// Stop driving it: a line with a pull-up goes high.
    #[inline]
    pub(super) fn release(self) {
        // SAFETY: as in `high`.
        unsafe { port().dirclr(self.group()).write(|w| w.bits(self.mask())) };
    }

    /// Its level; needs the input buffer that [`gpio`](Self::gpio) and [`connect`](Self::connect)
    /// turn on.
    #[inline]
    pub(super) fn is_high(self) -> bool {
        port().in_(self.group()).read().bits() & self.mask() != 0
    }

    /// Make it a GPIO with its input buffer on; direction and level stay.
    pub(super) fn gpio(self) {
        self.configure(false);
    }

    /// Give it to a peripheral, its input buffer on.
    pub(super) fn connect(self, function: Function) {
        let (shift, mask) = if self.number.is_multiple_of(2) {
            (0, 0xF0)
        } else {
            (4, 0x0F)
        };
        let chosen = (function as u8) << shift;
        let index = self.index() / 2;
        // SAFETY: read-modify-write of a register that two pins share; only the main loop
        // configures pins.
        unsafe {
            if matches!(self.group, Group::A) {
                port()
                    .pmux0_(index)
                    .modify(|r, w| w.bits(r.bits() & mask | chosen));
            } else {
                port()
                    .pmux1_0(index)
                    .modify(|r, w| w.bits(r.bits() & mask | chosen));
            }
        }
        self.configure(true);
    }

    /// Make it an input that a pull-down holds low, where it has not been driven high before.
    pub(super) fn pull_down(self) {
        if matches!(self.group, Group::A) {
            let config = port().pincfg0_(self.index());
            config.write(|w| w.inen().set_bit().pullen().set_bit());
        } else {
            let config = port().pincfg1_0(self.index());
            config.write(|w| w.inen().set_bit().pullen().set_bit());
        }
    }

    fn configure(self, peripheral: bool) {
        if matches!(self.group, Group::A) {
            port()
                .pincfg0_(self.index())
                .write(|w| w.inen().set_bit().pmuxen().bit(peripheral));
        } else {
            port()
                .pincfg1_0(self.index())
                .write(|w| w.inen().set_bit().pmuxen().bit(peripheral));
        }
    }

    const fn mask(self) -> u32 {
        1 << self.index()
    }

    const fn group(self) -> usize {
        self.group as usize
    }

    /// The number, of which the compiler sees that it is within a group.
    const fn index(self) -> usize {
        self.number as usize % 32
    }
}

fn port() -> &'static pac::port::RegisterBlock {
    // SAFETY: the block is always mapped.
    unsafe { &*pac::Port::ptr() }
}
