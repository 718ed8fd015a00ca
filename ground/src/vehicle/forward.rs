//! `tvc forward`: a bridge by UDP, MAVLink to a ground station such as QGroundControl and JSON to
//! PlotJuggler.

pub mod gate;

use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::path::PathBuf;

use anyhow::{Context, Result};
use clap::Args;
use client::StatusTracker;
use mavlink::dialects::common::MavMessage;

use crate::signals;
use crate::vehicle::admission::Admission;
use crate::vehicle::link::{Link, Vehicle};
use crate::vehicle::monitor::servo_maps;
use crate::vehicle::port::PortOptions;
use crate::vehicle::signing::Signing;
use gate::Gate;
use report::arguments::seconds;
use report::exit::Verdict;
use report::kind;

/// Options of `tvc forward`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  tvc forward                        QGroundControl and PlotJuggler on this computer find it
  tvc forward --to 192.168.1.20:14550    shown to a ground station elsewhere, which may ask
  tvc forward --to 192.168.1.20:14550 --accept-commands-from 192.168.1.20 --signing-key key
                                     and may command, with that key (docs/guides/tether.md)
  tvc forward --log flight.tlog      and keep every frame, both ways

What comes back from a ground station on this computer goes to the vehicle; what comes from another one, only if it changes
nothing, unless --accept-commands-from names it.
Exit status: 0 ended, 1 the vehicle went away or something failed, 2 unusable input.")]
pub struct Forward {
    /// Where the vehicle is.
    #[command(flatten)]
    pub port: PortOptions,

    /// Where MAVLink goes, by UDP.
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1:14550")]
    pub to: SocketAddr,

    /// Where JSON for PlotJuggler goes, by UDP.
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1:9870")]
    pub plot: SocketAddr,

    /// Who else may command.
    #[command(flatten)]
    pub admission: Admission,

    /// Sign every frame that goes out by MAVLink with the key in this file, 32 random bytes, and
    /// refuse commands that are not signed with it.
    #[arg(long, value_name = "FILE")]
    pub signing_key: Option<PathBuf>,

    /// End by itself after this many seconds.
    #[arg(long, value_name = "S", value_parser = seconds)]
    pub seconds: Option<f64>,

    /// Keep every frame, both ways, in a new telemetry log (.tlog, .mcap).
    #[arg(long, value_name = "FILE", value_parser = kind::new_log)]
    pub log: Option<PathBuf>,
}

/// Largest datagram accepted from a ground station, bytes.
const DATAGRAM: usize = 2048;

/// Bridges until Ctrl-C.
///
/// # Errors
/// The log cannot be written, no socket, no vehicle, or it went away.
pub fn run(options: &Forward) -> Result<Verdict> {
    let signing = options.signing_key.as_deref().map(Signing::read);
    let signing = signing.transpose()?;
    if options.admission.is_open() && signing.is_none() {
        eprintln!(
            "warning: whoever sends from there commands the vehicle, and anybody on the network can \
             seem to; --signing-key accepts only who has the key"
        );
    }
    let mut gate = Gate::new(options.admission.clone(), options.to.ip(), signing);
    let stop = signals::on_signal()?;
    // The ground station sends the heartbeats.
    let mut vehicle = Vehicle::at(Link::open_live(&options.port)?.0.without_heartbeat())?;
    let mut tracker = StatusTracker::new(servo_maps(&mut vehicle)?);
    if let Some(log) = &options.log {
        vehicle.keep_log(log)?;
    }
    let station = socket(options.to)?;
    let plot = socket(options.plot)?;
    eprintln!(
        "{}: MAVLink to udp://{}, JSON to udp://{}; Ctrl-C ends it",
        vehicle.link().name(),
        options.to,
        options.plot
    );
    let begun = vehicle.now();
    let mut datagram = [0; DATAGRAM];
    while !signals::asked(stop, vehicle.now() - begun, options.seconds) {
        for frame in vehicle.receive()? {
            // An error here means that nobody listens yet; somebody may later.
            let _ = station.send_to(&gate.outgoing(frame.bytes.clone()), options.to);
            tracker.take(&frame.message);
            if matches!(frame.message, MavMessage::SERVO_OUTPUT_RAW(_)) {
                let status = tracker.next(vehicle.link().client());
                let _ = plot.send_to(serde_json::to_string(&status)?.as_bytes(), options.plot);
            }
        }
        while let Ok((count, from)) = station.recv_from(&mut datagram) {
            let admitted = gate.incoming(&datagram[..count], from.ip());
            vehicle.link().send_bytes(&admitted)?;
        }
    }
    gate.end();
    vehicle.link().end_log()?;
    Ok(Verdict::Met)
}

/// A non-blocking socket for sending to `to`. Where that is this computer, no other one can reach
/// the socket.
fn socket(to: SocketAddr) -> Result<UdpSocket> {
    let local: SocketAddr = match to {
        SocketAddr::V4(to) if to.ip().is_loopback() => (Ipv4Addr::LOCALHOST, 0).into(),
        SocketAddr::V4(_) => (Ipv4Addr::UNSPECIFIED, 0).into(),
        SocketAddr::V6(to) if to.ip().is_loopback() => (std::net::Ipv6Addr::LOCALHOST, 0).into(),
        SocketAddr::V6(_) => (std::net::Ipv6Addr::UNSPECIFIED, 0).into(),
    };
    let socket = UdpSocket::bind(local).with_context(|| format!("opening a socket for {to}"))?;
    socket.set_nonblocking(true).context("setting up a socket")?;
    Ok(socket)
}
