//! `tvc rig`: the virtual rig in real time, for every program that opens a serial port or for
//! another kernel by USB/IP, and a socket beside the port for what is done by hand. [`RigChoice`]
//! says what a rig is like, here and for every command with `--rig`.

pub mod tell;

#[cfg(unix)]
use std::io::{BufRead, BufReader, Read, Write};
#[cfg(unix)]
use std::net::{Ipv4Addr, TcpListener};
#[cfg(unix)]
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::time::Duration;

use ::rig::ServoKind;
use ::rig::attended::Attended;
use ::rig::bench::VehicleConfig;
use ::rig::disturbance::Disturbances;
use ::rig::inertial::ImuErrors;
use ::rig::pilot::{Manner, Pilot};
#[cfg(unix)]
use anyhow::Context;
use anyhow::{Result, bail};
use clap::{Args, Subcommand, ValueEnum};

use crate::flight::fly::{faults, tilt_angle};
use crate::flight::hardware::HardwareChoice;
use crate::flight::sensor::SensorOption;
use crate::image::ImageOption;
use design::vehicle::VehicleChoice;
use report::arguments::{number, seconds};
use report::exit::{BadInput, Verdict};
#[cfg(unix)]
use report::file::print;
use report::file::write_whole;
use report::input;

/// Options of `tvc rig`.
#[derive(Debug, Args)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
#[command(after_help = "\
Examples:
  tvc rig --pty                            prints the path of the port, runs until Ctrl-C
  tvc rig --pty --link ./nano              and makes ./nano a link to it
  tvc monitor --port ./nano                in a second terminal: every command works there
  tvc test step --port ./nano              arms, releases, prints the figures
  tvc rig --pty --vehicle drone2 --roll 0.3    two rudders: it pitches and rolls
  tvc rig --pty --vibration 5,180          with an unbalanced propeller, see --help
  tvc rig --pty --faults scenarios/faults.toml   with faults of the sensor in every flight
  tvc rig tell ./nano fault unplugged      something done by hand to the rig with that link
  mavproxy.py --master ./nano                    any MAVLink client does
  tvc rig --pty --link ./nano --blank --sensor-errors worst   something to calibrate, with
  tvc calibrate --port ./nano                  in a second terminal
  tvc rig --usbip                          the USB device itself, for the kernel of a virtual
  usbip attach -r 10.0.2.2 -b 1-1              machine, where it becomes /dev/ttyACM0
  tvc rig --pty --gdb                      lets a debugger look at the firmware, and step back:
  gdb-multiarch -ex 'target remote :3333' target/chip/thumbv6m-none-eabi/firmware/tvc-nano

The hand at the rig does with sensor and drone what `tvc calibrate` asks for. The clamp opens when the firmware goes to active and closes when it is disarmed. With --link, `tvc rig tell` and the page of `tvc web` can act on the rig while it runs, through the socket LINK.control.
Exit status: 0 ended, 1 something failed, 2 unusable input.")]
pub struct Rig {
    /// What to do with a rig that runs.
    #[command(subcommand)]
    pub command: Option<RigCommand>,

    /// Put the rig's USB port behind a pseudo-terminal, in real time.
    #[arg(long, required_unless_present = "usbip")]
    pub pty: bool,

    /// Serve the rig's USB device by USB/IP at this port of this computer [default: 3240]. A kernel
    /// that attaches it enumerates the firmware's own USB device.
    #[arg(long, value_name = "PORT", num_args = 0..=1, default_missing_value = "3240")]
    #[arg(conflicts_with_all = ["pty", "link"])]
    pub usbip: Option<u16>,

    /// Serve the protocol of GDB at this port of this computer [default: 3333]: registers, memory,
    /// breakpoints, single steps, and reverse-stepi and reverse-continue behind a breakpoint or a
    /// step. The rig stands still meanwhile.
    #[arg(long, value_name = "PORT", num_args = 0..=1, default_missing_value = "3333")]
    pub gdb: Option<u16>,

    /// What the rig is like.
    #[command(flatten)]
    pub choice: RigChoice,

    /// Make this path a symbolic link to the pseudo-terminal, removed at the end.
    #[arg(long, value_name = "PATH")]
    pub link: Option<PathBuf>,

    /// End by itself after this many seconds.
    #[arg(long, value_name = "S", value_parser = seconds)]
    pub seconds: Option<f64>,
}

/// What a rig is like.
#[derive(Clone, Debug, Args)]
pub struct RigChoice {
    /// The servo on the rig; the firmware's SRV_RATE_HZ stays at 50 until it is set.
    #[arg(long, value_enum, default_value_t = ServoKind::S3003)]
    pub servo: ServoKind,

    /// What hangs on the rig: drone (one rudder), drone2 (two), rocket or a FILE.toml
    /// (docs/guides/vehicles.md).
    #[arg(long, default_value = "drone")]
    pub vehicle: VehicleChoice,

    /// Seed of all that is random: sensor noise and bias, clock phases.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,

    /// Tilt at which the clamp holds the drone, in rad (-0.87 to 0.87).
    #[arg(long, value_name = "RAD", default_value_t = 0.4, allow_negative_numbers = true, value_parser = tilt_angle)]
    pub tilt: f64,

    /// The same to the side, right side down positive, with two axes or a rocket.
    #[arg(long, value_name = "RAD", default_value_t = 0.0, allow_negative_numbers = true, value_parser = tilt_angle)]
    pub roll: f64,

    /// A Nano fresh from its box: nothing in its flash, polarity unchecked, so that it cannot be
    /// armed yet.
    #[arg(long)]
    pub blank: bool,

    /// The sensor.
    #[command(flatten)]
    pub sensor: SensorOption,

    /// Errors of the sensor.
    #[arg(long, value_enum, default_value_t = SensorErrors::Typical)]
    pub sensor_errors: SensorErrors,

    /// How well the hand does what `tvc calibrate` asks for.
    #[arg(long, value_enum, default_value_t = Manner::Steady)]
    pub hand: Manner,

    /// How many times as fast as real time (0.1 to 20) [default: 1, and with --rig as fast as it
    /// can where nobody watches].
    #[arg(long, value_name = "TIMES", value_parser = speed)]
    pub speed: Option<f64>,

    /// Keep here what the vehicle stores, from one run to the next.
    #[arg(long, value_name = "FILE.bin")]
    pub memory: Option<PathBuf>,

    /// Lateral offset of the drone's mass, forward, in mm (-30 to 30).
    #[arg(long, value_name = "MM", default_value_t = 0.0, allow_negative_numbers = true, value_parser = offset)]
    pub cm_offset: f64,

    /// A scenario, as for `tvc fly --faults` (docs/reference/faults.md), that begins with every
    /// release, its faults of `since = "power-on"` with every power-on.
    #[arg(long, value_name = "FILE.toml")]
    pub faults: Option<PathBuf>,

    /// Which image.
    #[command(flatten)]
    pub image: ImageOption,

    /// What disturbs a flight.
    #[command(flatten)]
    pub disturb: Disturbances,

    /// What the emulated parts are like.
    #[command(flatten)]
    pub hardware: HardwareChoice,
}

/// What to do with a rig that runs.
#[derive(Debug, Subcommand)]
pub enum RigCommand {
    /// Act on a rig that runs: tilt, clamp, faults, disturbances, reset, cable.
    Tell(tell::Tell),
}

/// Errors of a sensor.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum SensorErrors {
    /// Noise and a gyroscope's bias of up to 1 deg/s.
    Typical,
    /// The largest errors of a healthy one: 80 mg, 3 deg/s, 40 uT, soft iron with 20 % of skew.
    Worst,
}

impl SensorErrors {
    /// Those of the LSM6DS3.
    fn onboard(self) -> ImuErrors {
        match self {
            Self::Typical => ImuErrors::LSM6DS3,
            Self::Worst => ImuErrors::LARGEST,
        }
    }

    /// Those of the BNO055.
    pub fn errors(self) -> ImuErrors {
        match self {
            Self::Typical => ImuErrors::TYPICAL,
            Self::Worst => ImuErrors::LARGEST,
        }
    }
}

fn speed(text: &str) -> Result<f64, String> {
    number(text, 0.1..=20.0, "a speed is 0.1 to 20 times real time")
}

fn offset(text: &str) -> Result<f64, String> {
    number(text, -30.0..=30.0, "an offset of the mass is -30 to 30 mm")
}

/// Pitch rate at which the drone leaves the clamp, rad/s, as in `tvc fly`.
const RELEASE_RATE_RAD_S: f64 = 0.2;

/// Latest start of a fault after a release, s.
const LONGEST_S: f64 = 3600.0;

/// The socket of the rig behind a port's name.
pub fn control_path(port: &Path) -> PathBuf {
    let mut name = port.as_os_str().to_owned();
    name.push(".control");
    name.into()
}

/// Time for an answer of a rig.
pub const PATIENCE: Duration = Duration::from_secs(2);

/// Acts on the rig with this socket, in the words of an action; how it is then.
///
/// # Errors
/// No rig that answers there, and those of [`answer`].
#[cfg(unix)]
pub fn ask(socket: &Path, action: &str) -> Result<serde_json::Value> {
    let mut stream = UnixStream::connect(socket)
        .with_context(|| format!("no virtual rig listens at {}", socket.display()))?;
    stream.set_read_timeout(Some(PATIENCE))?;
    writeln!(stream, "{action}")?;
    let mut line = String::new();
    let asked = BufReader::new(stream.take(input::ANSWER)).read_line(&mut line);
    asked.context("the rig does not answer")?;
    answer(&line)
}

/// Only Unix has a rig that runs.
#[cfg(not(unix))]
pub fn ask(_: &Path, _: &str) -> Result<serde_json::Value> {
    Err(BadInput::new("`tvc rig --pty` needs Linux or macOS").into())
}

/// What a rig has answered to an action: how it is.
///
/// # Errors
/// [`BadInput`] with why it refuses; no answer of a rig.
pub fn answer(line: &str) -> Result<serde_json::Value> {
    let answer: serde_json::Value =
        serde_json::from_str(line).map_err(|_| anyhow::anyhow!("the rig does not answer"))?;
    match answer["error"].as_str() {
        Some(error) => Err(BadInput::new(error).into()),
        None => Ok(answer),
    }
}

/// Runs the rig until a signal or `--seconds` ends it, or acts on one that runs.
///
/// # Errors
/// A scenario, an image, a pseudo-terminal or a link that cannot be had; those of [`tell::run`].
pub fn run(options: &Rig) -> Result<Verdict> {
    match &options.command {
        Some(RigCommand::Tell(options)) => tell::run(options),
        None => run_rig(options),
    }
}

impl RigChoice {
    /// The rig, switched on, and the person at it.
    ///
    /// # Errors
    /// A scenario, an image or a memory that cannot be had; a choice that does not fit.
    pub fn attended(&self) -> Result<Attended> {
        let scenario = faults::read(self.faults.as_deref(), self.seed, LONGEST_S)?;
        let mut config = ::rig::RigConfig {
            seed: self.seed,
            stored: (!self.blank).then(::rig::RigConfig::polarity_set),
            hardware: self.hardware.hardware()?,
            ..::rig::RigConfig::default()
        };
        config.bench.sensor.errors = self.sensor_errors.errors();
        config.bench.onboard = self.sensor_errors.onboard();
        config.bench.start_rad = self.tilt;
        self.vehicle.read(self.servo)?.hang(&mut config)?;
        match &mut config.bench.vehicle {
            VehicleConfig::TwoAxes(two_axes) => two_axes.start_roll_rad = self.roll,
            VehicleConfig::Rocket(rocket) => rocket.start_rad = [self.tilt, self.roll],
            VehicleConfig::OneAxis if self.roll != 0.0 => {
                bail!(BadInput::new("--roll needs --vehicle drone2 or rocket"));
            }
            VehicleConfig::OneAxis => {}
        }
        let parameters = config.bench.parameters;
        config.bench.parameters = parameters.with_lateral_offset(self.cm_offset * 1e-3);
        config.bench.disturbances = self.disturb.over(scenario.disturbances);
        config.bench.faults = scenario.faults;
        self.sensor.fit(&mut config)?;
        let mut rig = ::rig::Rig::new(&self.image.image()?, &config)?;
        if let Some(path) = self.memory.as_deref().filter(|path| path.exists()) {
            let refuse = |why: &str| BadInput::new(format!("--memory {} {why}", path.display()));
            let bytes = input::bytes(path, rig.stored().len() as u64)
                .map_err(|error| refuse(&format!("cannot be read: {error}")))?;
            let whole = bytes.as_slice().try_into();
            let whole = whole.map_err(|_| refuse("is not the memory of a rig"))?;
            rig.load_stored(whole);
        }
        let start_rad = [self.tilt, self.roll];
        let pilot = Pilot::new(start_rad, RELEASE_RATE_RAD_S, self.hand);
        Ok(Attended::new(rig, pilot))
    }

    /// Keeps what the vehicle has stored, where a file was named for it.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn keep(&self, rig: &::rig::Rig) -> Result<()> {
        let memory = self.memory.as_deref();
        memory.map_or(Ok(()), |path| write_whole(path, rig.stored()))
    }
}

/// Runs the rig until a signal or `--seconds` ends it.
#[cfg(unix)]
fn run_rig(options: &Rig) -> Result<Verdict> {
    use std::time::Duration;

    use anyhow::Context;
    use rig::pty::Pty;
    use rig::real_time::{Cable, RealTime};
    use rig::usbip::{BUS_ID, Server};

    let choice = &options.choice;
    let stop = crate::signals::on_signal()?;
    let mut link = options.link.as_deref().map(Link::claim).transpose()?;
    let attended = choice.attended()?;
    let cable = if let Some(port) = options.usbip {
        let listener = listener(port)?;
        let address = listener.local_addr()?;
        print(format_args!("{address}\n"))?;
        eprintln!(
            "attach it as root: usbip --tcp-port {} attach -r HOST -b {BUS_ID}",
            address.port()
        );
        Cable::Network(Server::new(listener)?)
    } else {
        let pty = Pty::open().context("making a pseudo-terminal")?;
        if let Some(link) = &mut link {
            link.point_to(pty.path())?;
        }
        print(format_args!("{}\n", pty.path().display()))?;
        Cable::Terminal(pty)
    };
    eprintln!(
        "the rig runs in real time: servo {}, seed {}, tilt {} rad; Ctrl-C ends it",
        choice.servo.name(),
        choice.seed,
        choice.tilt
    );
    let control = link.as_mut().and_then(|link| link.control.take());
    let speed = choice.speed.unwrap_or(1.0);
    let debugger = options.gdb.map(debugger).transpose()?;
    let mut running = RealTime::new(attended, cable, control, debugger, speed);
    let longest = options.seconds.map(Duration::from_secs_f64);
    let mut report = |at_s: f64, line: &str| eprintln!("{at_s:9.3} s  {line}");
    let mut plugged = |path: &Path| {
        eprintln!("the cable is in again: {}", path.display());
        let pointed = link.as_mut().map_or(Ok(()), |link| link.point_to(path));
        pointed.map_err(std::io::Error::other)
    };
    let summary = running.run(longest, stop, &mut report, &mut plugged).context("the rig")?;
    choice.keep(running.rig())?;
    eprintln!("ran for {:.1} s: {} control steps", summary.seconds, summary.steps);
    if summary.lost_s > 0.0 {
        eprintln!(
            "this machine was too slow for real time: the rig's clock lost {:.1} s",
            summary.lost_s
        );
    }
    Ok(Verdict::Met)
}

/// The server for a debugger at a port.
#[cfg(unix)]
fn debugger(port: u16) -> Result<::rig::gdb::Server> {
    let listener = listener(port)?;
    eprintln!("a debugger may connect: target remote {}", listener.local_addr()?);
    Ok(::rig::gdb::Server::new(listener)?)
}

/// Listens at a port of this computer; 0 is any that is free.
#[cfg(unix)]
fn listener(port: u16) -> Result<TcpListener> {
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, port));
    Ok(listener.map_err(|error| BadInput::new(format!("cannot listen at port {port}: {error}")))?)
}

/// Only Unix has pseudo-terminals.
#[cfg(not(unix))]
fn run_rig(_options: &Rig) -> Result<Verdict> {
    bail!(BadInput::new("pseudo-terminals need Linux or macOS; `tvc fly` runs the rig everywhere"))
}

/// A symbolic link to the rig's port, removed when the rig ends, and the socket beside it.
#[cfg(unix)]
struct Link {
    path: PathBuf,
    /// Where it leads, once it is made.
    target: Option<PathBuf>,
    /// Until the rig has it.
    control: Option<::rig::control::Control>,
}

#[cfg(unix)]
impl Link {
    /// Takes the path for the link, and the socket beside it. Only a link to a pseudo-terminal,
    /// which a rig has left, may be in its place.
    ///
    /// # Errors
    /// [`BadInput`] if something else is there, or another rig has it.
    fn claim(path: &Path) -> Result<Self> {
        let refuse = |why: &str| {
            BadInput::new(format!("{} {why}; give --link another path", path.display()))
        };
        match std::fs::symlink_metadata(path) {
            Ok(there) if !there.is_symlink() => {
                bail!(refuse("is there already and is no link"));
            }
            Ok(_) if !std::fs::read_link(path).is_ok_and(|target| is_terminal(&target)) => {
                bail!(refuse("is there already and leads to no pseudo-terminal"));
            }
            _ => {}
        }
        let socket = control_path(path);
        let control = match ::rig::control::Control::open(&socket) {
            Ok(control) => Some(control),
            Err(error) if error.kind() == std::io::ErrorKind::AddrInUse => {
                bail!(refuse("is the link of another rig that runs"));
            }
            Err(error) => {
                eprintln!("nothing can be done by hand: {}: {error}", socket.display());
                None
            }
        };
        Ok(Self { path: path.to_owned(), target: None, control })
    }

    fn point_to(&mut self, target: &Path) -> Result<()> {
        let _ = std::fs::remove_file(&self.path);
        std::os::unix::fs::symlink(target, &self.path).map_err(|error| {
            BadInput::new(format!("cannot make the link {}: {error}", self.path.display()))
        })?;
        self.target = Some(target.to_owned());
        Ok(())
    }
}

/// Whether a path is that of a pseudo-terminal, by its name on Linux and macOS: one that has ended
/// is no file any more.
#[cfg(unix)]
fn is_terminal(path: &Path) -> bool {
    path.starts_with("/dev/pts") || path.to_str().is_some_and(|path| path.starts_with("/dev/ttys"))
}

#[cfg(unix)]
impl Drop for Link {
    fn drop(&mut self) {
        // Somebody may have put another one in its place.
        if self.target.is_some() && std::fs::read_link(&self.path).ok() == self.target {
            let _ = std::fs::remove_file(&self.path);
        }
    }
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use std::os::unix::fs::symlink;

    #[test]
    fn a_link_of_somebody_else_is_kept_and_one_that_a_rig_has_left_is_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("nano");
        let claimed = |path: &Path| match Link::claim(path) {
            Ok(link) => Ok(link),
            Err(refused) => Err(refused.to_string()),
        };
        for (target, why) in [("notes.txt", "no pseudo-terminal"), ("/dev/null", "no pseudo")] {
            symlink(target, &path).unwrap();
            let refused = claimed(&path).err().unwrap();
            assert!(refused.contains(why), "{refused}");
            assert_eq!(std::fs::read_link(&path).unwrap(), Path::new(target));
            std::fs::remove_file(&path).unwrap();
        }
        symlink("/dev/pts/999999", &path).unwrap();
        let mut first = claimed(&path).unwrap();
        first.point_to(Path::new("/dev/pts/999998")).unwrap();
        let refused = claimed(&path).err().unwrap();
        assert!(refused.contains("another rig that runs"), "{refused}");
        drop(first);
        assert!(!path.is_symlink() && !control_path(&path).exists());
        // A link that is not its own stays.
        let mut other = claimed(&path).unwrap();
        other.point_to(Path::new("/dev/pts/999998")).unwrap();
        std::fs::remove_file(&path).unwrap();
        symlink("mine", &path).unwrap();
        drop(other);
        assert_eq!(std::fs::read_link(&path).unwrap(), Path::new("mine"));
    }
}
