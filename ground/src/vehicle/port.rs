//! Serial ports: finding and opening one, and the list of `tvc info --ports`.

pub mod machine;
mod nano;

use std::io::{self, ErrorKind};
use std::path::Path;
use std::time::{Duration, Instant};

use anyhow::{Context, Error, Result, anyhow, bail};
use serialport::{ClearBuffer, SerialPort, SerialPortInfo, SerialPortType, UsbPortInfo};

use crate::flight::rig::RigChoice;
use crate::vehicle::on_rig;
use crate::vehicle::way::Way;
use clap::Args;
#[cfg(test)]
pub use nano::test_ports;
use nano::{BOOTLOADER, FIRMWARE, VENDOR, nano, nano_at, one_of_each};
pub use nano::{Life, Nano, nanos};
use report::exit::{BadInput, Verdict};
use report::measure::{Figure, Figures, figure, rows, shown};

/// Where the vehicle is.
#[derive(Debug, Default, Args)]
pub struct PortOptions {
    /// Serial port of the Nano, or the path that `tvc rig --pty` prints [default: the only SAMD21
    /// that is connected].
    #[arg(long, value_name = "PORT", global = true)]
    pub port: Option<String>,

    /// Take the virtual rig instead, in this process, switched on for this command. OPTIONS are
    /// those of `tvc rig`, such as --rig='--servo digital --seed 3'.
    #[arg(long, value_name = "OPTIONS", global = true, conflicts_with = "port", num_args = 0..=1,
        require_equals = true, default_missing_value = "", value_parser = on_rig::choice)]
    pub rig: Option<RigChoice>,
}

/// Where the vehicle is, and the form of the answer.
#[derive(Debug, Default, Args)]
pub struct VehicleOptions {
    /// Where the vehicle is.
    #[command(flatten)]
    pub port: PortOptions,

    /// Print one JSON object on standard output and nothing else there.
    #[arg(long, global = true)]
    pub json: bool,
}

/// USB ignores the rate, but 1200 baud asks for the bootloader.
const BAUD: u32 = 115_200;

/// Lists the serial ports.
///
/// # Errors
/// The system does not list them.
pub fn list(json: bool) -> Result<Verdict> {
    let ports = available()?;
    if ports.is_empty() && !json {
        eprintln!("no serial port is connected; `tvc rig --pty` makes a virtual one");
    }
    Figures::from([rows("ports", one_of_each(&ports).map(listed))]).conclude(json, None)
}

fn listed(port: &SerialPortInfo) -> [Figure; 6] {
    let usb = match &port.port_type {
        SerialPortType::UsbPort(usb) => Some(usb),
        _ => None,
    };
    let life = nano(port).map(|nano| nano.life);
    let text = |key, of: fn(&UsbPortInfo) -> Option<String>| figure(key, usb.and_then(of)).or("-");
    [
        figure("port", &*port.port_name).shown("port", "", 0),
        figure("nano", life.is_some()),
        text("usb", |usb| Some(format!("{:04x}:{:04x}", usb.vid, usb.pid))).shown("USB", "", 0),
        text("product", |usb| usb.product.clone()).shown("product", "", 0),
        shown("board", Life::words(life)),
        text("serial_number", |usb| usb.serial_number.clone()),
    ]
}

/// Every serial port of the machine, as the system lists them: macOS lists each one twice.
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
        if ports.iter().any(|port| port.port_name == name) || Path::new(name).exists() {
            return Ok(name.to_owned());
        }
        let names = joined(one_of_each(&ports).map(|port| &*port.port_name));
        bail!(BadInput::new(match ports.as_slice() {
            [] => format!("no port {name}; no serial port is connected"),
            _ => format!("no port {name}; connected: {names}"),
        }));
    }
    let nanos = nanos(&ports);
    match nanos.as_slice() {
        [nano] => Ok(nano.port.clone()),
        [] => bail!(BadInput::new(
            "no Nano found; connect it, double-tap its reset button if it runs other firmware, \
             or name the port with --port",
        )),
        _ => bail!(BadInput::new(format!(
            "more than one Nano is connected ({}); choose with --port",
            joined(nanos.iter().map(|nano| &*nano.port))
        ))),
    }
}

/// As [`find`], for a command that must know what runs there.
///
/// # Errors
/// [`BadInput`]; also for a port that is not a Nano's.
pub fn find_nano(wanted: Option<&str>) -> Result<Nano> {
    let port = find(wanted)?;
    let Some(nano) = nano_at(&port, &available()?) else {
        bail!(BadInput::new(format!(
            "{port} is not a Nano 33 IoT: its USB ids are neither those of the firmware \
             ({VENDOR:04x}:{FIRMWARE:04x}) nor of the bootloader ({VENDOR:04x}:{BOOTLOADER:04x})"
        )));
    };
    Ok(nano)
}

/// What runs on the Nano behind a port's name; `None` if it is none.
pub fn life(name: &str) -> Option<Life> {
    nano_at(name, &available().unwrap_or_default()).map(|nano| nano.life)
}

fn joined<'a>(names: impl Iterator<Item = &'a str>) -> String {
    names.collect::<Vec<_>>().join(", ")
}

/// What to say of a port that does not open.
pub fn refused(name: &str, error: &io::Error) -> BadInput {
    let holders = machine::holders(Path::new(name)).unwrap_or_default();
    if let Some(words) = machine::in_use(name, &holders) {
        return BadInput::new(words);
    }
    let advice = match machine::access(Path::new(name)) {
        Some(access) if error.kind() == ErrorKind::PermissionDenied => access.remedy(),
        _ => "is it a serial port that no other program uses?".to_owned(),
    };
    BadInput::new(format!("cannot open {name}: {error}; {advice}"))
}

/// An open port, with DTR set.
pub struct Port {
    port: Box<dyn SerialPort>,
    name: String,
    begun: Instant,
}

impl Port {
    /// Opens the port that [`find`] finds.
    ///
    /// # Errors
    /// [`BadInput`] for a port that is not there, is in use or is no port.
    pub fn open(wanted: Option<&str>) -> Result<Self> {
        let name = find(wanted)?;
        let opened =
            serialport::new(&name, BAUD).timeout(Duration::from_secs(1)).dtr_on_open(true).open();
        let port = opened.map_err(|error| refused(&name, &error.into()))?;
        // Drops what an earlier program left unread.
        let _ = port.clear(ClearBuffer::Input);
        Ok(Self::at(port, name))
    }

    /// A port that is open already.
    pub fn at(port: Box<dyn SerialPort>, name: String) -> Self {
        let begun = Instant::now();
        Self { port, name, begun }
    }

    fn gone(&self, error: &io::Error) -> Error {
        anyhow!("{} went away: unplugged, or the rig has ended ({error})", self.name)
    }
}

impl Way for Port {
    fn name(&self) -> &str {
        &self.name
    }

    fn now(&self) -> Duration {
        self.begun.elapsed()
    }

    fn read(&mut self, patience: Duration) -> Result<Vec<u8>> {
        let mut bytes = vec![0; 4096];
        let timeout = self.port.set_timeout(patience.max(Duration::from_millis(1)));
        let read = timeout.map_err(io::Error::from).and_then(|()| self.port.read(&mut bytes));
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

    fn write(&mut self, bytes: &[u8]) -> Result<()> {
        let timeout = self.port.set_timeout(Duration::from_secs(1));
        let written = timeout.map_err(io::Error::from).and_then(|()| self.port.write_all(bytes));
        written.map_err(|error| match error.kind() {
            ErrorKind::TimedOut => {
                anyhow!("{} takes no more data: does the firmware still run?", self.name)
            }
            _ => self.gone(&error),
        })
    }

    fn reopen(&mut self) -> Result<()> {
        /// The port of a chip that was reset is gone within this time, and back later.
        const GONE: Duration = Duration::from_millis(400);
        const PATIENCE: Duration = Duration::from_secs(10);
        std::thread::sleep(GONE);
        let until = self.now() + PATIENCE;
        while self.now() < until {
            // The same board again, whatever else is connected meanwhile.
            if let Ok(Self { port, .. }) = Self::open(Some(&self.name)) {
                self.port = port;
                return Ok(());
            }
            std::thread::sleep(Duration::from_millis(100));
        }
        Ok(())
    }
}

fn is_nothing(error: &io::Error) -> bool {
    matches!(error.kind(), ErrorKind::TimedOut | ErrorKind::Interrupted | ErrorKind::WouldBlock)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(unix)]
    #[test]
    fn a_port_that_may_not_be_opened_names_its_group() {
        let denied = io::Error::from(ErrorKind::PermissionDenied);
        let file = tempfile::NamedTempFile::new().unwrap().into_temp_path();
        let name = file.to_str().unwrap();
        let said = refused(name, &denied).to_string();
        let remedy = machine::access(&file).unwrap().remedy();
        assert!(said.ends_with(&remedy), "{said}");
        let busy = io::Error::from(ErrorKind::ResourceBusy);
        let said = refused(name, &busy).to_string();
        assert!(said.contains("no other program"), "{said}");
    }

    #[test]
    fn a_port_that_is_not_there_is_bad_input() {
        let error = find(Some("/dev/no-such-port")).unwrap_err();
        assert!(error.is::<BadInput>());
        assert!(error.to_string().starts_with("no port /dev/no-such-port"));
    }
}
