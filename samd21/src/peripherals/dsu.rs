//! DSU: device service unit, of which only the identity is modelled.
//!
//! | offset | register | behaviour |
//! |---|---|---|
//! | 00 | CTRL, STATUSA, STATUSB | no debugger, not protected |
//! | 18 | DID | SAMD21G18A, die revision D |
//!
//! | left out | why |
//! |---|---|
//! | chip erase, CRC, memory test, debug channel, CoreSight ROM | a programmer's tools, not an application's |

use super::access::{RESERVED, Read};

/// Device identification: SAM D21 family, revision 3, G18A.
const DID: u32 = 0x1001_0305;

pub(crate) fn read(offset: u32) -> Read {
    match offset {
        0x00 => Ok(0),
        0x18 => Ok(DID),
        _ => Err(RESERVED),
    }
}
