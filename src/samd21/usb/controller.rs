//! The chip's USB controller (data sheet chapter 32), as far as a serial port needs it.
//!
//! A bank is one direction of an endpoint: bank 0 takes OUT and SETUP, bank 1 sends IN. What a bank
//! is to do stands in a descriptor in RAM, which the controller reads and writes by itself. It owns
//! a bank's buffer while BK0RDY is clear (OUT) or BK1RDY set (IN), and this code owns it otherwise.
//!
//! Only a SETUP is taken whatever the flags say, into endpoint 0's OUT buffer. So the flag of a
//! SETUP is looked at again after each packet has been copied from there: what was copied while one
//! arrived is dropped, and the SETUP seen to.

use core::cell::UnsafeCell;
use core::sync::atomic::{Ordering, compiler_fence};

use atsamd_hal::calibration::{usb_transn_cal, usb_transp_cal, usb_trim_cal};
use atsamd_hal::clock::UsbClock;
use atsamd_hal::gpio::{DynAlternate, PA24, PA25};
use atsamd_hal::pac;
use tvc_nano::usb::{self, Device, Endpoint, PACKET_BYTES};

use crate::samd21::pin::Pin;
use crate::samd21::time::soon;

/// A bank's descriptor (data sheet 32.8.4). The last two words are for what is not used here.
#[repr(C)]
#[derive(Clone, Copy)]
struct Bank {
    /// Where its buffer begins.
    address: u32,
    /// BYTE_COUNT in bits 13:0, SIZE in 30:28.
    pcksize: u32,
    _rest: [u32; 2],
}

impl Bank {
    const EMPTY: Self = Self { address: 0, pcksize: 0, _rest: [0; 2] };
}

/// In whole words, by which packets are copied.
#[repr(C, align(4))]
struct Buffer([u8; PACKET_BYTES]);

impl Buffer {
    const EMPTY: Self = Self([0; PACKET_BYTES]);
}

/// Endpoint numbers that are used.
const NUMBERS: usize = 3;

/// What the controller reads and writes by itself.
#[repr(C)]
struct Shared {
    banks: [[Bank; 2]; NUMBERS],
    control_out: Buffer,
    control_in: Buffer,
    from_host: Buffer,
    to_host: Buffer,
}

struct SharedCell(UnsafeCell<Shared>);

// SAFETY: reached by the one `Usb` alone, through raw pointers, and by the controller.
unsafe impl Sync for SharedCell {}

static SHARED: SharedCell = SharedCell(UnsafeCell::new(Shared {
    banks: [[Bank::EMPTY; 2]; NUMBERS],
    control_out: Buffer::EMPTY,
    control_in: Buffer::EMPTY,
    from_host: Buffer::EMPTY,
    to_host: Buffer::EMPTY,
}));

/// PCKSIZE.SIZE for packets of 64 bytes. No bank that is used has shorter ones.
const SIZE_64: u32 = 3 << 28;
/// PCKSIZE.BYTE_COUNT.
const BYTE_COUNT: u32 = 0x3FFF;

/// The number of an endpoint that is used.
#[derive(Clone, Copy)]
enum Number {
    Control,
    /// And the notifications.
    FromHost,
    ToHost,
}

impl Number {
    const ALL: [Self; NUMBERS] = [Self::Control, Self::FromHost, Self::ToHost];

    /// EPCFG: the type of OUT in bits 2:0, that of IN in 6:4.
    fn types(self) -> u8 {
        const CONTROL: u8 = 1;
        const BULK: u8 = 3;
        const INTERRUPT: u8 = 4;
        match self {
            Self::Control => CONTROL | CONTROL << 4,
            Self::FromHost => BULK | INTERRUPT << 4,
            Self::ToHost => BULK << 4,
        }
    }
}

/// A direction of it.
#[derive(Clone, Copy)]
enum Direction {
    Out,
    In,
}

/// The controller; there is one.
pub(super) struct Usb(());

impl Usb {
    /// Switch the controller on, and show the host that there is a device.
    pub(super) fn start(_clock: &UsbClock, pm: &mut pac::Pm, _registers: pac::Usb) -> Self {
        pm.apbbmask().modify(|_, w| w.usb_().set_bit());
        for pad in [Pin::of::<PA24>(), Pin::of::<PA25>()] {
            pad.connect(DynAlternate::G);
        }
        let usb = registers();
        usb.ctrla().write(|w| w.swrst().set_bit());
        // In vain only without its clock, and then there is no host to tell.
        let _ = soon(|| usb.syncbusy().read().swrst().bit_is_clear());
        // SAFETY: the factory's calibration, priorities of two bits, and descriptors that stay.
        unsafe {
            usb.padcal().write(|w| {
                w.transn().bits(usb_transn_cal());
                w.transp().bits(usb_transp_cal());
                w.trim().bits(usb_trim_cal())
            });
            usb.qosctrl().write(|w| w.dqos().bits(3).cqos().bits(3));
        }
        point_at_banks();
        usb.ctrla().write(|w| w.mode().device().runstdby().set_bit());
        usb.ctrlb().write(|w| w.spdconf().fs().detach().set_bit());
        usb.ctrla().write(|w| w.mode().device().runstdby().set_bit().enable().set_bit());
        let _ = soon(|| usb.syncbusy().read().enable().bit_is_clear());
        usb.intenset().write(|w| w.eorst().set_bit());
        let mut controller = Self(());
        controller.configure();
        usb.ctrlb().write(|w| w.spdconf().fs().detach().clear_bit());
        controller
    }

    /// See to what has happened since the last call.
    pub(super) fn poll(&mut self, device: &mut Device) {
        let usb = registers();
        if usb.intflag().read().eorst().bit_is_set() {
            usb.intflag().write(|w| w.eorst().set_bit());
            self.configure();
            device.reset();
            return;
        }
        // Whether there is a packet is asked of the banks, not of these flags.
        usb.epintflag(Number::FromHost as usize).write(|w| w.trcpt0().set_bit());
        usb.epintflag(Number::ToHost as usize).write(|w| w.trcpt1().set_bit());
        self.poll_control(device);
    }

    /// See to endpoint 0. A SETUP may come behind the packet that ends a transfer.
    fn poll_control(&mut self, device: &mut Device) {
        let usb = registers();
        let number = Number::Control as usize;
        let flags = usb.epintflag(number).read();
        usb.epintflag(number).write(|w| w.trcpt0().set_bit().trcpt1().set_bit());
        if flags.rxstp().bit_is_clear() {
            if flags.trcpt1().bit_is_set() {
                device.sent(self);
            }
            if self.is_filled(Number::Control) {
                let mut packet = [0; PACKET_BYTES];
                let count = self.copy_from(Number::Control, &mut packet);
                if usb.epintflag(number).read().rxstp().bit_is_clear() {
                    self.release(Number::Control);
                    device.received(self, packet.get(..count).unwrap_or(&[]));
                }
            }
        }
        if usb.epintflag(number).read().rxstp().bit_is_set() {
            let mut packet = [0; PACKET_BYTES];
            self.copy_from(Number::Control, &mut packet);
            usb.epintflag(number).write(|w| w.rxstp().set_bit());
            self.release(Number::Control);
            let [b0, b1, b2, b3, b4, b5, b6, b7, ..] = packet;
            device.setup(self, [b0, b1, b2, b3, b4, b5, b6, b7]);
        }
    }

    /// The newest packet of data from the host; how many bytes, 0 where there is none.
    pub(super) fn read(&mut self, packet: &mut [u8; PACKET_BYTES]) -> usize {
        if !self.is_filled(Number::FromHost) {
            return 0;
        }
        let count = self.copy_from(Number::FromHost, packet);
        self.release(Number::FromHost);
        count
    }

    /// Hand over a packet of data for the host; `false` while it has not taken the one before.
    pub(super) fn write(&mut self, packet: &[u8]) -> bool {
        let number = Number::ToHost;
        if registers().epstatus(number as usize).read().bk1rdy().bit_is_set() {
            return false;
        }
        self.hand_over(number, packet);
        true
    }

    /// Set all endpoints up, and forget what they hold: at the start, and after a bus reset, which
    /// clears their registers.
    fn configure(&mut self) {
        let usb = registers();
        for number in Number::ALL {
            for direction in [Direction::Out, Direction::In] {
                let bank = bank(number, direction);
                // SAFETY: the endpoint is off, or idle since the bus' reset.
                unsafe {
                    let buffer = buffer(number, direction) as u32;
                    (&raw mut (*bank).address).write_volatile(buffer);
                    (&raw mut (*bank).pcksize).write_volatile(SIZE_64);
                }
            }
            let index = number as usize;
            usb.epstatusclr(index).write(|w| w.bk0rdy().set_bit().bk1rdy().set_bit());
            // SAFETY: types that the controller has. Interrupts can be enabled only afterwards.
            usb.epcfg(index).write(|w| unsafe { w.bits(number.types()) });
            usb.epintenset(index).write(|w| match number {
                Number::Control => w.rxstp().set_bit().trcpt0().set_bit().trcpt1().set_bit(),
                Number::FromHost => w.trcpt0().set_bit(),
                Number::ToHost => w.trcpt1().set_bit(),
            });
        }
    }

    /// Whether the host has sent a packet.
    fn is_filled(&self, number: Number) -> bool {
        let status = registers().epstatus(number as usize).read();
        status.bk0rdy().bit_is_set()
    }

    /// Leave the OUT bank to the host again.
    fn release(&mut self, number: Number) {
        compiler_fence(Ordering::Release);
        let clear = registers().epstatusclr(number as usize);
        clear.write(|w| w.bk0rdy().set_bit());
    }

    /// The bytes of the OUT bank, and how many they are.
    fn copy_from(&self, number: Number, packet: &mut [u8; PACKET_BYTES]) -> usize {
        let bank = bank(number, Direction::Out);
        compiler_fence(Ordering::Acquire);
        // SAFETY: the controller does not write the buffer until it is released, but for a SETUP,
        // which the caller looks for.
        unsafe {
            *packet = (*buffer(number, Direction::Out)).0;
            let count = (&raw const (*bank).pcksize).read_volatile() & BYTE_COUNT;
            (count as usize).min(PACKET_BYTES)
        }
    }

    /// Fill the IN bank and leave it to the host.
    fn hand_over(&mut self, number: Number, packet: &[u8]) {
        let bank = bank(number, Direction::In);
        let count = packet.len().min(PACKET_BYTES);
        let index = number as usize;
        // SAFETY: the buffer is as long as the longest packet; the controller does not read it
        // before it is told to.
        unsafe {
            let buffer = buffer(number, Direction::In).cast::<u8>();
            packet.as_ptr().copy_to_nonoverlapping(buffer, count);
            (&raw mut (*bank).pcksize).write_volatile(SIZE_64 | count as u32);
        }
        compiler_fence(Ordering::Release);
        let usb = registers();
        usb.epintflag(index).write(|w| w.trcpt1().set_bit());
        point_at_banks();
        usb.epstatusset(index).write(|w| w.bk1rdy().set_bit());
    }
}

/// Tell the controller where the banks' descriptors are, should a register have lost that: it would
/// take other memory for them, and write there.
fn point_at_banks() {
    let place = registers().descadd();
    let banks = SHARED.0.get() as u32;
    if place.read().bits() != banks {
        // SAFETY: the descriptors are there for ever, aligned.
        place.write(|w| unsafe { w.descadd().bits(banks) });
    }
}

/// A bank's descriptor.
fn bank(number: Number, direction: Direction) -> *mut Bank {
    // SAFETY: the address of a part of a static.
    unsafe { &raw mut (*SHARED.0.get()).banks[number as usize][direction as usize] }
}

/// A bank's buffer. The directions in which nothing is sent have that of the other one.
fn buffer(number: Number, direction: Direction) -> *mut Buffer {
    let shared = SHARED.0.get();
    // SAFETY: addresses of parts of a static.
    unsafe {
        match (number, direction) {
            (Number::Control, Direction::Out) => &raw mut (*shared).control_out,
            (Number::Control, Direction::In) => &raw mut (*shared).control_in,
            (Number::FromHost, _) => &raw mut (*shared).from_host,
            (Number::ToHost, _) => &raw mut (*shared).to_host,
        }
    }
}

impl usb::Controller for Usb {
    fn send(&mut self, packet: &[u8]) {
        self.hand_over(Number::Control, packet);
    }

    fn stall(&mut self) {
        let set = registers().epstatusset(Number::Control as usize);
        set.write(|w| w.stallrq0().set_bit().stallrq1().set_bit());
    }

    fn set_address(&mut self, address: u8) {
        // SAFETY: seven bits.
        registers().dadd().write(|w| unsafe { w.dadd().bits(address & 0x7F).adden().set_bit() });
    }

    fn halt(&mut self, endpoint: Endpoint, halted: bool) {
        let (number, direction) = place(endpoint);
        let (set, clear) =
            (registers().epstatusset(number as usize), registers().epstatusclr(number as usize));
        match (direction, halted) {
            (Direction::Out, true) => set.write(|w| w.stallrq0().set_bit()),
            (Direction::In, true) => set.write(|w| w.stallrq1().set_bit()),
            (Direction::Out, false) => clear.write(|w| w.stallrq0().set_bit().dtglout().set_bit()),
            (Direction::In, false) => clear.write(|w| w.stallrq1().set_bit().dtglin().set_bit()),
        };
    }

    fn is_halted(&self, endpoint: Endpoint) -> bool {
        let (number, direction) = place(endpoint);
        let status = registers().epstatus(number as usize).read();
        match direction {
            Direction::Out => status.stallrq0().bit_is_set(),
            Direction::In => status.stallrq1().bit_is_set(),
        }
    }
}

fn place(endpoint: Endpoint) -> (Number, Direction) {
    match endpoint {
        Endpoint::Notifications => (Number::FromHost, Direction::In),
        Endpoint::FromHost => (Number::FromHost, Direction::Out),
        Endpoint::ToHost => (Number::ToHost, Direction::In),
    }
}

/// Whether all that has happened is that the host has taken the packet of data for it; that is then
/// acknowledged.
pub(super) fn take_sent() -> bool {
    let usb = registers();
    let index = Number::ToHost as usize;
    let flags = usb.epintflag(index).read();
    let is_all = usb.epintsmry().read().bits() == 1 << index
        && usb.intflag().read().eorst().bit_is_clear()
        && flags.trcpt1().bit_is_set()
        && flags.trcpt0().bit_is_clear();
    if is_all {
        usb.epintflag(index).write(|w| w.trcpt1().set_bit());
    }
    is_all
}

fn registers() -> &'static pac::usb::Device {
    // SAFETY: the block is always mapped; the main loop and the USB interrupt alone use it, and the
    // interrupt writes one flag that says no more than the main loop learns from it.
    unsafe { (*pac::Usb::ptr()).device() }
}
