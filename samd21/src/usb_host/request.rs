//! The requests that the host makes on endpoint 0 (USB 2.0, 9.4; CDC PSTN 1.2, 6.3).

/// A request on endpoint 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Request {
    DeviceHead,
    SetAddress,
    Device,
    ConfigurationHead,
    Configuration,
    Languages,
    Text(Text),
    SetConfiguration,
    LineCoding,
    ControlLines { dtr: bool },
    ClearHalt(u8),
}

/// A string of the device descriptor; the value is the offset of its index there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Text {
    Manufacturer = 14,
    Product = 15,
    SerialNumber = 16,
}

impl Request {
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::DeviceHead | Self::Device => "GET_DESCRIPTOR device",
            Self::SetAddress => "SET_ADDRESS",
            Self::ConfigurationHead | Self::Configuration => "GET_DESCRIPTOR configuration",
            Self::Languages | Self::Text(_) => "GET_DESCRIPTOR string",
            Self::SetConfiguration => "SET_CONFIGURATION",
            Self::LineCoding => "SET_LINE_CODING",
            Self::ControlLines { .. } => "SET_CONTROL_LINE_STATE",
            Self::ClearHalt(_) => "CLEAR_FEATURE ENDPOINT_HALT",
        }
    }
}
