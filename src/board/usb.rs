//! The USB serial port: the HAL's device controller, `usb-device`, and the packet level of
//! `usbd-serial`, polled from the main loop.
//!
//! The interrupt masks itself and wakes the main loop, which polls the stack once nothing more
//! urgent is left, and then unmasks the interrupt. What comes most often is nothing that the stack
//! has to know of: that the host has taken a packet, which the interrupt only notes. Nothing waits
//! for the host: what it does not fetch stays in the caller's queue.

mod bus;

use core::sync::atomic::{AtomicBool, AtomicU8, Ordering};

use atsamd_hal::clock::UsbClock;
use atsamd_hal::gpio::{AnyPin, PA24, PA25};
use atsamd_hal::pac;
use atsamd_hal::pac::{NVIC, interrupt};
use atsamd_hal::serial_number;
use atsamd_hal::usb;
use bno055_driver::Micros;
use cortex_m::peripheral::SCB;
use cortex_m::singleton;
use tvc_nano::application::{self, PACKET_BYTES};
use tvc_nano::telemetry::Reset;
use usb_device::bus::UsbBusAllocator;
use usb_device::device::{
    StringDescriptors, UsbDevice, UsbDeviceBuilder, UsbDeviceState, UsbVidPid,
};
use usbd_serial::CdcAcmClass;

use bus::UsbBus;

use super::nano33iot::{
    BOOTLOADER_FLASH, BOOTLOADER_MAGIC, BOOTLOADER_WORD, USB_PRODUCT, USB_VENDOR,
};
use super::wake;

/// Longest packet that nothing follows: a full one has a continuation for the host, which waits for
/// it. In whole words, by which packets are copied.
const SHORT_PACKET_BYTES: usize = PACKET_BYTES - 4;

/// The stack is polled so often at least, whether or not the controller asks for it.
const POLL_PERIOD_US: u64 = 50_000;
/// A port that is not open and has this rate asks for the bootloader.
const TOUCH_BAUD: u32 = 1_200;
/// From the host's request to the reset, so that it is answered first.
const RESET_DELAY_US: u64 = 100_000;

/// The controller has interrupted, and is masked until the stack has been polled.
static PENDING: AtomicBool = AtomicBool::new(false);
/// The endpoint of data to the host; 0 until it is known.
static DATA: AtomicU8 = AtomicU8::new(0);
/// The host has taken the newest packet.
static TAKEN: AtomicBool = AtomicBool::new(false);
/// More waits to be handed over than went into the newest packet.
static MORE: AtomicBool = AtomicBool::new(false);

/// The serial port.
pub(super) struct Port {
    device: UsbDevice<'static, UsbBus>,
    serial: CdcAcmClass<'static, UsbBus>,
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
    #[inline(never)]
    pub(super) fn start(
        clock: &UsbClock,
        pm: &mut pac::Pm,
        minus: impl AnyPin<Id = PA24>,
        plus: impl AnyPin<Id = PA25>,
        controller: pac::Usb,
    ) -> Self {
        let allocator: &'static UsbBusAllocator<UsbBus> = singleton!(
            : UsbBusAllocator<UsbBus> = UsbBusAllocator::new(UsbBus(usb::UsbBus::new(clock, pm, minus, plus, controller)))
        )
        .expect("started once");
        let serial = CdcAcmClass::new(allocator, PACKET_BYTES as u16);
        let strings = StringDescriptors::default()
            .manufacturer("tvc-nano")
            .product("tvc-nano thrust-vector control")
            .serial_number(serial_number_text());
        let device = UsbDeviceBuilder::new(allocator, UsbVidPid(USB_VENDOR, USB_PRODUCT))
            .strings(&[strings])
            .expect("one language")
            .composite_with_iads()
            .max_packet_size_0(64)
            .expect("a size of full speed")
            .build();
        DATA.store(serial.write_ep().address().index() as u8, Ordering::Relaxed);
        Self {
            device,
            serial,
            polled: Micros(0),
            packet: [0; PACKET_BYTES],
            may_read: false,
            touched: false,
            reset: None,
        }
    }

    /// Poll the stack if the controller has interrupted, or some time has passed. `armed` refuses a
    /// reset.
    pub(super) fn poll(&mut self, now: Micros, armed: bool) {
        if is_pending() || now.since(self.polled) >= POLL_PERIOD_US {
            self.poll_stack(now);
        }
        match self.reset {
            Some(_) if armed => self.reset = None,
            Some((at, Reset::Bootloader)) if now >= at => enter_bootloader(),
            Some((at, Reset::Restart)) if now >= at => SCB::sys_reset(),
            _ => {}
        }
    }

    #[inline(never)]
    fn poll_stack(&mut self, now: Micros) {
        PENDING.store(false, Ordering::Relaxed);
        TAKEN.store(true, Ordering::Relaxed);
        self.polled = now;
        self.may_read = true;
        self.device.poll(&mut [&mut self.serial]);
        self.watch_touch(now);
        // While it was masked, the controller's line was high and made it pending once more; if the
        // line is still high, it becomes pending again.
        NVIC::unpend(pac::Interrupt::USB);
        // SAFETY: the interrupt shares nothing but atomic flags.
        unsafe { NVIC::unmask(pac::Interrupt::USB) };
    }

    /// Reset once the host has been answered, unless it is armed by then.
    pub(super) fn reset_soon(&mut self, now: Micros, reset: Reset) {
        self.reset = Some((now.after(RESET_DELAY_US), reset));
    }

    /// What the host says of the port.
    pub(super) fn port(&self) -> application::Port {
        if self.device.state() != UsbDeviceState::Configured {
            application::Port::Absent
        } else if self.serial.dtr() {
            application::Port::Open
        } else {
            application::Port::Silent
        }
    }

    /// The host's next packet, empty if there is none.
    pub(super) fn read(&mut self) -> &[u8] {
        if !core::mem::take(&mut self.may_read) {
            return &[];
        }
        let count = self.serial.read_packet(&mut self.packet).unwrap_or(0);
        self.packet.get(..count).unwrap_or(&[])
    }

    /// Hand over as much of `bytes` as there is room for; says how many.
    pub(super) fn write(&mut self, bytes: &[u8]) -> usize {
        // A packet without data would go out as one.
        if bytes.is_empty() || !TAKEN.load(Ordering::Relaxed) {
            MORE.store(!bytes.is_empty(), Ordering::Relaxed);
            return 0;
        }
        TAKEN.store(false, Ordering::Relaxed);
        let most = if bytes.len() == PACKET_BYTES {
            SHORT_PACKET_BYTES
        } else {
            PACKET_BYTES
        };
        let packet = bytes.get(..most).unwrap_or(bytes);
        MORE.store(packet.len() < bytes.len(), Ordering::Relaxed);
        self.serial.write_packet(packet).unwrap_or(0)
    }

    /// Boards are asked into their bootloader by a port that is at 1,200 baud and not open, however
    /// it got there; a program that opens it before the reset takes that back.
    fn watch_touch(&mut self, now: Micros) {
        let touched = self.serial.line_coding().data_rate() == TOUCH_BAUD && !self.serial.dtr();
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
pub(super) fn enter_bootloader() -> ! {
    cortex_m::interrupt::disable();
    // SAFETY: RAM above this program's stack (see memory.x), aligned.
    unsafe { BOOTLOADER_WORD.write_volatile(bootloader_magic()) };
    SCB::sys_reset()
}

/// The word that the bootloader of this board looks for: it has it somewhere in its own code. The
/// first of the list where there is no bootloader.
fn bootloader_magic() -> u32 {
    let [usual, other] = BOOTLOADER_MAGIC;
    let has = |magic| {
        BOOTLOADER_FLASH.step_by(4).any(|at| {
            // SAFETY: flash, aligned; volatile because the compiler knows nothing of it.
            unsafe { (at as *const u32).read_volatile() == magic }
        })
    };
    if !has(usual) && has(other) {
        other
    } else {
        usual
    }
}

/// The chip's 128-bit serial number in hexadecimal.
fn serial_number_text() -> &'static str {
    const DIGITS: &[u8; 16] = b"0123456789ABCDEF";
    let text = singleton!(: [u8; 32] = [b'0'; 32]).expect("asked once");
    for (pair, byte) in text.chunks_exact_mut(2).zip(serial_number()) {
        pair.copy_from_slice(&[
            DIGITS[usize::from(byte >> 4)],
            DIGITS[usize::from(byte & 15)],
        ]);
    }
    core::str::from_utf8(text).unwrap_or("")
}

/// Whether the controller has interrupted since the stack was polled.
fn is_pending() -> bool {
    PENDING.load(Ordering::Relaxed)
}

/// Whether the port has something to do: the stack is to be polled, or the next packet may be
/// written.
pub(super) fn needs_care() -> bool {
    is_pending() || MORE.load(Ordering::Relaxed) && TAKEN.load(Ordering::Relaxed)
}

#[interrupt]
fn USB() {
    if bus::take_sent(DATA.load(Ordering::Relaxed)) {
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
