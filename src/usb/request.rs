//! Requests of the host (USB 2.0, 9.3).

/// The eight bytes of a SETUP packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Request {
    /// bmRequestType: direction, type and recipient.
    pub kind: u8,
    /// bRequest.
    pub number: u8,
    /// wValue.
    pub value: u16,
    /// wIndex.
    pub index: u16,
    /// wLength: bytes of data that follow, or that the host takes at most.
    pub length: u16,
}

impl From<[u8; 8]> for Request {
    fn from([kind, number, v0, v1, i0, i1, l0, l1]: [u8; 8]) -> Self {
        Self {
            kind,
            number,
            value: u16::from_le_bytes([v0, v1]),
            index: u16::from_le_bytes([i0, i1]),
            length: u16::from_le_bytes([l0, l1]),
        }
    }
}

/// Values of [`Request::kind`].
pub(super) mod kind {
    pub(in crate::usb) const TO_DEVICE: u8 = 0x00;
    pub(in crate::usb) const TO_INTERFACE: u8 = 0x01;
    pub(in crate::usb) const TO_ENDPOINT: u8 = 0x02;
    pub(in crate::usb) const FROM_DEVICE: u8 = 0x80;
    pub(in crate::usb) const FROM_INTERFACE: u8 = 0x81;
    pub(in crate::usb) const FROM_ENDPOINT: u8 = 0x82;
    /// Of the class.
    pub(in crate::usb) const TO_PORT: u8 = 0x21;
    /// Of the class.
    pub(in crate::usb) const FROM_PORT: u8 = 0xA1;
}

/// Values of [`Request::number`]: USB 2.0, table 9-4, and PSTN 1.2, table 13.
pub(super) mod number {
    pub(in crate::usb) const GET_STATUS: u8 = 0;
    pub(in crate::usb) const CLEAR_FEATURE: u8 = 1;
    pub(in crate::usb) const SET_FEATURE: u8 = 3;
    pub(in crate::usb) const SET_ADDRESS: u8 = 5;
    pub(in crate::usb) const GET_DESCRIPTOR: u8 = 6;
    pub(in crate::usb) const GET_CONFIGURATION: u8 = 8;
    pub(in crate::usb) const SET_CONFIGURATION: u8 = 9;
    pub(in crate::usb) const GET_INTERFACE: u8 = 10;
    pub(in crate::usb) const SET_INTERFACE: u8 = 11;
    pub(in crate::usb) const SEND_ENCAPSULATED_COMMAND: u8 = 0x00;
    pub(in crate::usb) const SET_LINE_CODING: u8 = 0x20;
    pub(in crate::usb) const GET_LINE_CODING: u8 = 0x21;
    pub(in crate::usb) const SET_CONTROL_LINE_STATE: u8 = 0x22;
}
