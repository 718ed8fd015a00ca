//! The USB serial port, polled from the main loop: the chip's controller moves the packets for
//! [`tvc_nano::usb`].
//!
//! The interrupt masks itself and wakes the main loop, which polls the device once nothing more
//! urgent is left, and then unmasks the interrupt. What comes most often is nothing that the device
//! has to know of: that the host has taken a packet, which the interrupt only notes. Nothing waits
//! for the host: what it does not fetch stays in the caller's queue.

mod controller;

use core::sync::atomic::{AtomicBool, Ordering};

use atsamd_hal::clock::UsbClock;
use atsamd_hal::pac;
use atsamd_hal::pac::{NVIC, interrupt};
use atsamd_hal::serial_number;
use tvc_imu::Micros;
use tvc_nano::application::{self, PACKET_BYTES};
use tvc_nano::bringup::words::{ARDUINO, BOOTLOADER_END};
use tvc_nano::telemetry::Reset;
use tvc_nano::usb::{self, Device, descriptors};

use controller::Usb;

use super::{frame, wake};
use crate::boards::WIRING;

const _: () = assert!(PACKET_BYTES == usb::PACKET_BYTES);

static DEVICE_DESCRIPTOR: [u8; 18] = descriptors::device(WIRING.usb_vendor, WIRING.usb_product);

/// Longest packet that nothing follows: a full one has a continuation for the host, which waits for
/// it. In whole words, by which packets are copied.
const SHORT_PACKET_BYTES: usize = PACKET_BYTES - 4;

/// The device is polled so often at least, whether or not the controller asks for it.
const POLL_PERIOD_US: u64 = 50_000;
/// A port that is not open and has this rate asks for the bootloader.
const TOUCH_BAUD: u32 = 1_200;
/// From the host's request to the reset, so that it is answered first.
const RESET_DELAY_US: u64 = 100_000;

/// The word of RAM in which the bootloader looks for a second tap.
const BOOTLOADER_WORD: *mut u32 = 0x2000_7FFC as *mut u32;

/// The controller has interrupted, and is masked until the device has been polled.
static PENDING: AtomicBool = AtomicBool::new(false);
/// The host has taken the newest packet.
static TAKEN: AtomicBool = AtomicBool::new(false);
/// More waits to be handed over than went into the newest packet.
static MORE: AtomicBool = AtomicBool::new(false);

/// The serial port.
pub(crate) struct Port {
    controller: Usb,
    device: Device,
    polled: Micros,
    /// The host's newest packet.
    packet: [u8; PACKET_BYTES],
    /// The host may have sent a packet since it was last asked for.
    may_read: bool,
    /// The port is closed at the touch's rate.
    touched: bool,
    reset: Option<(Micros, Reset)>,
}

impl Port {
    /// Attach to the bus.
    pub(crate) fn start(clock: &UsbClock, pm: &mut pac::Pm, registers: pac::Usb) -> Self {
        Self {
            controller: Usb::start(clock, pm, registers),
            device: Device::new(&DEVICE_DESCRIPTOR, serial_number()),
            polled: Micros(0),
            packet: [0; PACKET_BYTES],
            may_read: false,
            touched: false,
            reset: None,
        }
    }

    /// Poll the device if the controller has interrupted, or some time has passed. `armed` refuses
    /// a reset.
    pub(crate) fn poll(&mut self, now: Micros, armed: bool) {
        if is_pending() || now.since(self.polled) >= POLL_PERIOD_US {
            self.poll_device(now);
        }
        match self.reset {
            Some(_) if armed => self.reset = None,
            Some((at, Reset::Bootloader)) if now >= at => enter_bootloader(),
            Some((at, Reset::Restart)) if now >= at => frame::reset_in_gap(),
            _ => {}
        }
    }

    fn poll_device(&mut self, now: Micros) {
        PENDING.store(false, Ordering::Relaxed);
        TAKEN.store(true, Ordering::Relaxed);
        self.polled = now;
        self.may_read = true;
        self.controller.poll(&mut self.device);
        self.watch_touch(now);
        // While it was masked, the controller's line was high and made it pending once more; if the
        // line is still high, it becomes pending again.
        NVIC::unpend(pac::Interrupt::USB);
        // SAFETY: the interrupt shares nothing but atomic flags.
        unsafe { NVIC::unmask(pac::Interrupt::USB) };
    }

    /// Reset once the host has been answered, unless it is armed by then.
    pub(crate) fn reset_soon(&mut self, now: Micros, reset: Reset) {
        self.reset = Some((now.after(RESET_DELAY_US), reset));
    }

    /// What the host says of the port.
    pub(crate) fn port(&self) -> application::Port {
        if !self.device.is_configured() {
            application::Port::Absent
        } else if self.device.is_open() {
            application::Port::Open
        } else {
            application::Port::Silent
        }
    }

    /// The host's next packet, empty if there is none.
    pub(crate) fn read(&mut self) -> &[u8] {
        if !core::mem::take(&mut self.may_read) {
            return &[];
        }
        let count = self.controller.read(&mut self.packet);
        self.packet.get(..count).unwrap_or(&[])
    }

    /// Hand over as much of `bytes` as there is room for; says how many.
    pub(crate) fn write(&mut self, bytes: &[u8]) -> usize {
        // A packet without data would go out as one.
        if bytes.is_empty() || !TAKEN.load(Ordering::Relaxed) {
            MORE.store(!bytes.is_empty(), Ordering::Relaxed);
            return 0;
        }
        TAKEN.store(false, Ordering::Relaxed);
        let most = if bytes.len() == PACKET_BYTES { SHORT_PACKET_BYTES } else { PACKET_BYTES };
        let packet = bytes.get(..most).unwrap_or(bytes);
        MORE.store(packet.len() < bytes.len(), Ordering::Relaxed);
        if self.controller.write(packet) { packet.len() } else { 0 }
    }

    /// Boards are asked into their bootloader by a port that is at 1,200 baud and not open, however
    /// it got there; a program that opens it before the reset takes that back.
    fn watch_touch(&mut self, now: Micros) {
        let touched = self.device.baud() == TOUCH_BAUD && !self.device.is_open();
        if core::mem::replace(&mut self.touched, touched) != touched {
            if touched {
                self.reset_soon(now, Reset::Bootloader);
            } else if let Some((_, Reset::Bootloader)) = self.reset {
                self.reset = None;
            }
        }
    }
}

/// Leave a word for the bootloader and reset into it.
pub(crate) fn enter_bootloader() -> ! {
    ask_for_bootloader();
    frame::reset_in_gap()
}

/// Leave a word for the bootloader: it stays behind the next reset.
pub(crate) fn ask_for_bootloader() {
    cortex_m::interrupt::disable();
    // SAFETY: RAM above this program's stack (see memory.x), aligned.
    unsafe { BOOTLOADER_WORD.write_volatile(bootloader_magic()) };
}

/// The word that the bootloader of this board looks for: it has it somewhere in its own code. The
/// first of the list where there is no bootloader.
fn bootloader_magic() -> u32 {
    let has = |magic: &&u32| {
        (0..BOOTLOADER_END as usize).step_by(4).any(|at| {
            // SAFETY: flash, aligned; volatile because the compiler knows nothing of it.
            unsafe { (at as *const u32).read_volatile() == **magic }
        })
    };
    let magic = WIRING.bootloader_magic;
    let found = magic.iter().find(has).or(magic.first());
    found.copied().unwrap_or(ARDUINO)
}

/// Whether the controller has interrupted since the device was polled.
fn is_pending() -> bool {
    PENDING.load(Ordering::Relaxed)
}

/// Whether the port has something to do: the device is to be polled, or the next packet may be
/// written.
pub(crate) fn needs_care() -> bool {
    is_pending() || MORE.load(Ordering::Relaxed) && TAKEN.load(Ordering::Relaxed)
}

#[interrupt]
fn USB() {
    if controller::take_sent() {
        TAKEN.store(true, Ordering::Relaxed);
        if MORE.load(Ordering::Relaxed) {
            wake::request();
        }
        return;
    }
    NVIC::mask(pac::Interrupt::USB);
    PENDING.store(true, Ordering::Relaxed);
    wake::request();
}
