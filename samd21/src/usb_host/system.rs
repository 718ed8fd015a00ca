//! What operating systems do differently with a device.
//!
//! | | bare | Linux | Windows | macOS |
//! |---|---|---|---|---|
//! | first GET_DESCRIPTOR | 8 bytes | 64 bytes | 64 bytes, no status stage | 8 bytes |
//! | second bus reset after it | no | yes | yes | no |
//! | BOS, if bcdUSB is 2.01 or more | no | yes | yes | yes |
//! | device qualifier | no | yes | yes | no |
//! | Microsoft's string 0xEE | no | no | yes | no |
//! | configuration at first | 9 bytes | 9 bytes | 255 bytes | 9 bytes |
//! | line coding and lines when the driver starts | no | lines low, 9600 baud | coding read | no |
//! | lines when a program opens the port | high | high | low, unless the program asks | high |
//! | sends either if the device does not announce them | yes | yes | yes | no |
//!
//! Sources: Linux, `drivers/usb/core/hub.c` and `drivers/usb/class/cdc-acm.c`; Microsoft, "How does
//! USB stack enumerate a device"; Apple's published `AppleUSBCDCACM`, whose
//! `USBSendSetControlLineState` returns unless the capability is there. Windows leaves DTR to the
//! program's DCB, and serial libraries have it off there unless they are asked.

/// The host's operating system.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum System {
    /// None in particular: the fewest requests that USB needs; the port is opened with DTR set.
    #[default]
    Bare,
    /// Linux, with its driver `cdc-acm`.
    Linux,
    /// Windows, with `usbser.sys`.
    Windows,
    /// macOS, with the driver that Apple has published.
    MacOs,
}

impl System {
    /// The first request is for 64 bytes, and a second bus reset follows it.
    pub(super) fn resets_twice(self) -> bool {
        matches!(self, Self::Linux | Self::Windows)
    }

    /// The second bus reset comes before the status stage of the first request.
    pub(super) fn cuts_status_short(self) -> bool {
        self == Self::Windows
    }

    /// Bytes of the first request for the configuration.
    pub(super) fn configuration_head(self) -> u16 {
        if self == Self::Windows { 255 } else { 9 }
    }

    pub(super) fn asks_bos(self) -> bool {
        self != Self::Bare
    }

    pub(super) fn asks_qualifier(self) -> bool {
        matches!(self, Self::Linux | Self::Windows)
    }

    pub(super) fn asks_microsoft_string(self) -> bool {
        self == Self::Windows
    }

    /// DTR rises when a program opens the port and does nothing else.
    pub(super) fn raises_dtr(self) -> bool {
        self != Self::Windows
    }

    /// Line coding and lines go only to a device that announces them.
    pub(super) fn heeds_capabilities(self) -> bool {
        self == Self::MacOs
    }
}
