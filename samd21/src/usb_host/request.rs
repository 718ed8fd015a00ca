//! The requests that the host makes on endpoint 0 (USB 2.0, 9.4; CDC PSTN 1.2, 6.3).

/// A request on endpoint 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Request {
    /// The device descriptor's first 8 bytes.
    DeviceHead,
    /// The device descriptor in 64 bytes, before the second bus reset.
    DeviceFirst,
    SetAddress,
    Device,
    ConfigurationHead,
    Configuration,
    Bos,
    Qualifier,
    MicrosoftString,
    Languages,
    Text(Text),
    SetConfiguration,
    ReadLineCoding,
    LineCoding {
        baud: u32,
    },
    ControlLines {
        dtr: bool,
    },
    ClearHalt(u8),
    /// That of a driver elsewhere.
    Remote,
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
            Self::DeviceHead | Self::DeviceFirst | Self::Device => "GET_DESCRIPTOR device",
            Self::SetAddress => "SET_ADDRESS",
            Self::ConfigurationHead | Self::Configuration => "GET_DESCRIPTOR configuration",
            Self::Bos => "GET_DESCRIPTOR BOS",
            Self::Qualifier => "GET_DESCRIPTOR device qualifier",
            Self::Languages | Self::Text(_) | Self::MicrosoftString => "GET_DESCRIPTOR string",
            Self::SetConfiguration => "SET_CONFIGURATION",
            Self::ReadLineCoding => "GET_LINE_CODING",
            Self::LineCoding { .. } => "SET_LINE_CODING",
            Self::ControlLines { .. } => "SET_CONTROL_LINE_STATE",
            Self::ClearHalt(_) => "CLEAR_FEATURE ENDPOINT_HALT",
            Self::Remote => "a request from elsewhere",
        }
    }
}
