//! The last rows of flash, where parameters are stored.
//!
//! Erasing a row (256 bytes) takes up to 6 ms, writing a page (64 bytes) up to 2.5 ms (data sheet,
//! table 37-41). The processor runs from the same flash and stands still meanwhile, and so do its
//! interrupts; the timers and the servo's pulses go on. So nothing is written while the drone is
//! armed. A save costs a few steps their samples, and [`super::time`], which counts SysTick's
//! interrupts, falls behind by the time of the standstill.

use core::sync::atomic::{AtomicBool, Ordering};

use atsamd_hal::pac;
use embedded_storage::nor_flash::{
    ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash, check_erase, check_read,
    check_write,
};
use tvc_nano::store::{STORE_ADDRESS, STORE_BYTES};

use super::time::within;

const ROW_BYTES: usize = 256;
const PAGE_BYTES: usize = 64;

/// Where they start (memory.x keeps the image out of them).
const START: usize = STORE_ADDRESS as usize;

/// Longer than any operation takes.
const LIMIT_US: u64 = 20_000;

/// Whether the vehicle is armed. Nothing is written then, whatever a damaged program asks for.
static IS_HELD: AtomicBool = AtomicBool::new(false);

/// Refuses to write while the vehicle is armed.
pub(crate) fn hold(is_armed: bool) {
    IS_HELD.store(is_armed, Ordering::Relaxed);
}

/// The flash controller refused, or did not end.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Refused(NorFlashErrorKind);

impl NorFlashError for Refused {
    fn kind(&self) -> NorFlashErrorKind {
        self.0
    }
}

impl From<NorFlashErrorKind> for Refused {
    fn from(kind: NorFlashErrorKind) -> Self {
        Self(kind)
    }
}

/// The rows of the store, addressed from 0 to [`STORE_BYTES`].
pub(crate) struct Flash {
    controller: pac::Nvmctrl,
}

#[derive(Clone, Copy)]
enum Operation {
    EraseRow,
    ClearPageBuffer,
    WritePage,
}

impl Flash {
    /// Take the controller over. From here on it writes only on command: as it comes out of reset,
    /// filling the page buffer's last word would write it, and a stray pointer would write flash
    /// (errata, 1.14.1).
    pub(crate) fn new(controller: pac::Nvmctrl) -> Self {
        controller.ctrlb().modify(|_, w| w.manw().set_bit());
        Self { controller }
    }

    fn operate(&mut self, operation: Operation) -> Result<(), Refused> {
        if IS_HELD.load(Ordering::Relaxed) {
            return Err(Refused(NorFlashErrorKind::Other));
        }
        let status = self.controller.status();
        status.modify(|_, w| w.proge().set_bit().locke().set_bit().nvme().set_bit());
        self.controller.ctrla().write(|w| {
            let w = w.cmdex().key();
            match operation {
                Operation::EraseRow => w.cmd().er(),
                Operation::ClearPageBuffer => w.cmd().pbc(),
                Operation::WritePage => w.cmd().wp(),
            }
        });
        let ready = within(LIMIT_US, || self.controller.intflag().read().ready().bit_is_set());
        let status = self.controller.status().read();
        if ready && !(status.proge().bit() || status.locke().bit() || status.nvme().bit()) {
            Ok(())
        } else {
            Err(Refused(NorFlashErrorKind::Other))
        }
    }

    fn point_at(&mut self, offset: usize) {
        // The register counts 16-bit words.
        let address = ((START + offset) / 2) as u32;
        // SAFETY: an address within flash.
        self.controller.addr().write(|w| unsafe { w.addr().bits(address) });
    }
}

impl ErrorType for Flash {
    type Error = Refused;
}

impl ReadNorFlash for Flash {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Refused> {
        check_read(self, offset, bytes.len())?;
        let from = (START + offset as usize) as *const u8;
        for (index, byte) in bytes.iter_mut().enumerate() {
            // SAFETY: within flash, as checked; volatile because it changes under the compiler's
            // hands.
            *byte = unsafe { from.add(index).read_volatile() };
        }
        Ok(())
    }

    fn capacity(&self) -> usize {
        STORE_BYTES
    }
}

impl NorFlash for Flash {
    const WRITE_SIZE: usize = PAGE_BYTES;
    const ERASE_SIZE: usize = ROW_BYTES;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), Refused> {
        check_erase(self, from, to)?;
        (from as usize..to as usize).step_by(ROW_BYTES).try_for_each(|row| {
            self.point_at(row);
            self.operate(Operation::EraseRow)
        })
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Refused> {
        check_write(self, offset, bytes.len())?;
        for (index, page) in bytes.chunks_exact(PAGE_BYTES).enumerate() {
            let start = START + offset as usize + index * PAGE_BYTES;
            self.operate(Operation::ClearPageBuffer)?;
            for (at, word) in page.as_chunks::<4>().0.iter().enumerate() {
                let place = (start as *mut u32).wrapping_add(at);
                // SAFETY: a write to flash only fills the page buffer; aligned, and within flash,
                // as checked.
                unsafe { place.write_volatile(u32::from_le_bytes(*word)) };
            }
            self.point_at(start - START);
            self.operate(Operation::WritePage)?;
        }
        Ok(())
    }
}
