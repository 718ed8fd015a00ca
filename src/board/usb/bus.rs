//! The HAL's device controller, with one race of it closed and one byte of a descriptor put right.
//!
//! # The race
//! The control pipe takes the empty packet that ends a request out of endpoint 0's buffer. A host
//! may have sent its next SETUP by then, which the controller always takes, and into the same
//! buffer. The HAL's `read` then finds eight bytes where none were expected, drops them and tells
//! the controller that they have been heard: the host waits five seconds for an answer, at about
//! one request in a hundred. So an empty packet is taken without a look at the buffer, and a SETUP
//! that is there already is left to the next poll, which sees to it.
//!
//! # The byte
//! `usbd-serial` announces no capabilities of the serial port (its `bmCapabilities` is 0), although
//! it obeys SET_LINE_CODING and SET_CONTROL_LINE_STATE. A host that goes by that never says that
//! the port is open, nor at which rate: so the announcement is put right on its way out.

use atsamd_hal::pac;
use atsamd_hal::usb;
use usb_device::bus::{self, PollResult};
use usb_device::endpoint::{EndpointAddress, EndpointType};
use usb_device::{Result, UsbDirection, UsbError};

/// Longest packet of the control pipe.
const CONTROL_BYTES: usize = 64;
/// The descriptor of the port's abstract control management (USB CDC, PSTN 1.2, table 4) as
/// `usbd-serial` has it.
const MUTE_PORT: [u8; 4] = [4, 0x24, 2, 0];
/// Its last byte for a port that obeys SET_LINE_CODING and SET_CONTROL_LINE_STATE.
const OBEYS_LINES: u8 = 2;

/// The controller.
pub(super) struct UsbBus(pub(super) usb::UsbBus);

impl bus::UsbBus for UsbBus {
    fn alloc_ep(
        &mut self,
        direction: UsbDirection,
        address: Option<EndpointAddress>,
        kind: EndpointType,
        max_packet_size: u16,
        interval: u8,
    ) -> Result<EndpointAddress> {
        self.0
            .alloc_ep(direction, address, kind, max_packet_size, interval)
    }

    fn enable(&mut self) {
        self.0.enable();
    }

    fn reset(&self) {
        self.0.reset();
    }

    fn set_device_address(&self, address: u8) {
        self.0.set_device_address(address);
    }

    fn write(&self, endpoint: EndpointAddress, bytes: &[u8]) -> Result<usize> {
        if endpoint.index() == 0
            && let Some(at) = bytes.windows(4).position(|four| *four == MUTE_PORT)
            && let Some(copy) = [0; CONTROL_BYTES].get_mut(..bytes.len())
        {
            copy.copy_from_slice(bytes);
            if let Some(capabilities) = copy.get_mut(at + 3) {
                *capabilities = OBEYS_LINES;
            }
            return self.0.write(endpoint, copy);
        }
        self.0.write(endpoint, bytes)
    }

    fn read(&self, endpoint: EndpointAddress, buffer: &mut [u8]) -> Result<usize> {
        if buffer.is_empty() && endpoint.index() == 0 {
            return take_status();
        }
        self.0.read(endpoint, buffer)
    }

    fn set_stalled(&self, endpoint: EndpointAddress, stalled: bool) {
        self.0.set_stalled(endpoint, stalled);
    }

    fn is_stalled(&self, endpoint: EndpointAddress) -> bool {
        self.0.is_stalled(endpoint)
    }

    fn suspend(&self) {
        self.0.suspend();
    }

    fn resume(&self) {
        self.0.resume();
    }

    fn poll(&self) -> PollResult {
        self.0.poll()
    }
}

/// Takes the empty packet that ends a request, unless a SETUP has come behind it.
fn take_status() -> Result<usize> {
    // SAFETY: the stack is polled from the main loop alone; the flags written belong to endpoint 0.
    let usb = unsafe { &*pac::Usb::ptr() };
    if usb.device().epintflag(0).read().rxstp().bit_is_set() {
        return Err(UsbError::WouldBlock);
    }
    usb.device().epstatusclr(0).write(|w| w.bk0rdy().set_bit());
    Ok(0)
}

/// Whether all that has happened is that the host has taken the packet of `endpoint`, which carries
/// data to it; that is then acknowledged.
pub(super) fn take_sent(endpoint: u8) -> bool {
    // SAFETY: the flag written belongs to `endpoint`, and says no more than the caller learns.
    let usb = unsafe { &*pac::Usb::ptr() }.device();
    let index = usize::from(endpoint % 8);
    let flags = usb.epintflag(index).read();
    let is_all = usb.epintsmry().read().bits() == 1 << index
        && usb.intflag().read().eorst().bit_is_clear()
        && flags.trcpt1().bit_is_set()
        && flags.trcpt0().bit_is_clear()
        && flags.rxstp().bit_is_clear();
    if is_all {
        usb.epintflag(index).write(|w| w.trcpt1().set_bit());
    }
    is_all
}
