//! Serial ports: finding and opening one, and `tvc ports`.

use std::io::{self, ErrorKind};
use std::path::Path;
use std::time::Duration;

use anyhow::{Context, Result, bail};
use serde::Serialize;
use serialport::{ClearBuffer, SerialPort, SerialPortInfo, SerialPortType};

use crate::out::exit::{BadInput, Verdict};
use crate::out::file::print_json;
use clap::Args;

/// Options of `tvc ports`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  cargo tvc ports                          every serial port, with what is behind it
  cargo tvc ports --json                   for a script

Exit status: 0 done, 1 something failed, 2 unusable input.")]
pub struct Ports {
    /// Print one JSON object on standard output and nothing else there.
    #[arg(long)]
    pub json: bool,
}

/// Where the vehicle is.
#[derive(Debug, Args)]
pub struct PortOptions {
    /// Serial port of the Nano, or the path that `tvc rig --pty` prints [default: the only SAMD21
    /// that is connected].
    #[arg(long, value_name = "PORT")]
    pub port: Option<String>,
}

/// USB vendor of the Nano 33 IoT, in firmware and in bootloader.
const VENDOR: u16 = 0x2341;
/// USB products: the running firmware, the bootloader.
const PRODUCTS: [u16; 2] = [0x8057, 0x0057];

/// USB ignores the rate, but 1200 baud asks for the bootloader.
const BAUD: u32 = 115_200;

/// A port, as `tvc ports` lists it.
#[derive(Debug, Serialize)]
struct Listed {
    port: String,
    nano: bool,
    usb: Option<String>,
    product: Option<String>,
    serial_number: Option<String>,
}

/// Lists the serial ports.
///
/// # Errors
/// The system does not list them.
pub fn list(options: &Ports) -> Result<Verdict> {
    let ports: Vec<Listed> = available()?.iter().map(listed).collect();
    if options.json {
        print_json(&serde_json::json!({ "ports": ports }))?;
        return Ok(Verdict::Met);
    }
    if ports.is_empty() {
        eprintln!("no serial port is connected; `tvc rig --pty` makes a virtual one");
    }
    for port in &ports {
        println!(
            "{:<20} {:<10} {}{}",
            port.port,
            port.usb.as_deref().unwrap_or("-"),
            port.product.as_deref().unwrap_or(""),
            if port.nano { " (SAMD21 Nano)" } else { "" }
        );
    }
    Ok(Verdict::Met)
}

fn listed(port: &SerialPortInfo) -> Listed {
    let usb = match &port.port_type {
        SerialPortType::UsbPort(usb) => Some(usb),
        _ => None,
    };
    Listed {
        port: port.port_name.clone(),
        nano: is_nano(port),
        usb: usb.map(|usb| format!("{:04x}:{:04x}", usb.vid, usb.pid)),
        product: usb.and_then(|usb| usb.product.clone()),
        serial_number: usb.and_then(|usb| usb.serial_number.clone()),
    }
}

/// Every serial port of the machine.
///
/// # Errors
/// The system does not list them.
pub fn available() -> Result<Vec<SerialPortInfo>> {
    serialport::available_ports().context("listing serial ports")
}

/// The port to use: the one named, if it exists, or the only Nano that is connected.
///
/// # Errors
/// [`BadInput`] that says what to do.
pub fn find(wanted: Option<&str>) -> Result<String> {
    let ports = available()?;
    if let Some(name) = wanted {
        // A port may exist without being listed (a link, or a pseudo-terminal).
        let there = ports.iter().any(|port| port.port_name == name) || Path::new(name).exists();
        return if there {
            Ok(name.to_string())
        } else {
            Err(BadInput::new(format!(
                "no port {name}; {}",
                match ports.as_slice() {
                    [] => "no serial port is connected".to_string(),
                    _ => format!("connected: {}", names(&ports)),
                }
            ))
            .into())
        };
    }
    let nanos: Vec<_> = ports.into_iter().filter(is_nano).collect();
    match nanos.as_slice() {
        [nano] => Ok(nano.port_name.clone()),
        [] => Err(BadInput::new(
            "no Nano found; connect it, double-tap its reset button if it runs other firmware, \
             or name the port with --port",
        )
        .into()),
        _ => Err(BadInput::new(format!(
            "more than one Nano is connected ({}); choose with --port",
            names(&nanos)
        ))
        .into()),
    }
}

fn is_nano(port: &SerialPortInfo) -> bool {
    matches!(&port.port_type, SerialPortType::UsbPort(usb)
        if usb.vid == VENDOR && PRODUCTS.contains(&usb.pid))
}

fn names(ports: &[SerialPortInfo]) -> String {
    ports
        .iter()
        .map(|port| port.port_name.as_str())
        .collect::<Vec<_>>()
        .join(", ")
}

/// An open port, with DTR set.
pub struct Port {
    port: Box<dyn SerialPort>,
    name: String,
}

impl Port {
    /// Opens the port that [`find`] finds.
    ///
    /// # Errors
    /// [`BadInput`] for a port that is not there, is in use or is no port.
    pub fn open(wanted: Option<&str>) -> Result<Self> {
        let name = find(wanted)?;
        let opened = serialport::new(&name, BAUD)
            .timeout(Duration::from_secs(1))
            .dtr_on_open(true)
            .open();
        let port = opened.map_err(|error| {
            BadInput::new(format!(
                "cannot open {name}: {error}; is it a serial port that no other program uses?"
            ))
        })?;
        // Drops what an earlier program left unread.
        let _ = port.clear(ClearBuffer::Input);
        Ok(Self::at(port, name))
    }

    /// A port that is open already.
    pub fn at(port: Box<dyn SerialPort>, name: String) -> Self {
        Self { port, name }
    }

    /// Its name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The bytes that have come, waiting at most `patience` for the first one; none if nothing has
    /// come.
    ///
    /// # Errors
    /// The port went away.
    pub fn read(&mut self, patience: Duration) -> Result<Vec<u8>> {
        let mut bytes = vec![0; 4096];
        let read = self
            .port
            .set_timeout(patience.max(Duration::from_millis(1)))
            .map_err(io::Error::from)
            .and_then(|()| self.port.read(&mut bytes));
        match read {
            Ok(0) => bail!("{} went away: unplugged, or the rig has ended", self.name),
            Ok(count) => {
                bytes.truncate(count);
                Ok(bytes)
            }
            Err(error) if is_nothing(&error) => Ok(Vec::new()),
            Err(error) => Err(self.gone(&error)),
        }
    }

    /// Sends all of `bytes`.
    ///
    /// # Errors
    /// The port went away, or takes nothing any more.
    pub fn write(&mut self, bytes: &[u8]) -> Result<()> {
        let timeout = self.port.set_timeout(Duration::from_secs(1));
        timeout
            .map_err(io::Error::from)
            .and_then(|()| self.port.write_all(bytes))
            .map_err(|error| match error.kind() {
                ErrorKind::TimedOut => {
                    anyhow::anyhow!(
                        "{} takes no more data: does the firmware still run?",
                        self.name
                    )
                }
                _ => self.gone(&error),
            })
    }

    fn gone(&self, error: &io::Error) -> anyhow::Error {
        anyhow::anyhow!(
            "{} went away: unplugged, or the rig has ended ({error})",
            self.name
        )
    }
}

fn is_nothing(error: &io::Error) -> bool {
    matches!(
        error.kind(),
        ErrorKind::TimedOut | ErrorKind::Interrupted | ErrorKind::WouldBlock
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use serialport::UsbPortInfo;

    fn usb(vid: u16, pid: u16) -> SerialPortInfo {
        SerialPortInfo {
            port_name: "ttyACM0".into(),
            port_type: SerialPortType::UsbPort(UsbPortInfo {
                vid,
                pid,
                serial_number: None,
                manufacturer: None,
                product: None,
            }),
        }
    }

    #[test]
    fn a_nano_is_known_by_its_ids_in_both_lives() {
        assert!(is_nano(&usb(0x2341, 0x8057)));
        assert!(is_nano(&usb(0x2341, 0x0057)));
        assert!(!is_nano(&usb(0x2341, 0x0043)));
        assert!(!is_nano(&usb(0x1209, 0x8057)));
    }

    #[test]
    fn a_port_that_is_not_there_is_bad_input() {
        let error = find(Some("/dev/no-such-port")).unwrap_err();
        assert!(error.is::<BadInput>());
        assert!(error.to_string().starts_with("no port /dev/no-such-port"));
    }
}
