//! `tvc web`: the vehicle on a page. One thread owns the port ([`vehicle_thread`]), one a request
//! serves the page ([`server`]); between them stands what is known ([`model`]).

mod auth;
mod logs;
mod model;
mod server;
mod step_test;
mod vehicle_thread;

use std::net::{SocketAddr, TcpListener};
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::{Result, anyhow};
use clap::Args;

use crate::arguments::seconds;
use crate::out::exit::{BadInput, Verdict};
use crate::signals;
use crate::vehicle::link::Link;
use crate::vehicle::port::PortOptions;
use auth::Token;
use model::Model;
use server::Server;
use vehicle_thread::Handle;

/// Options of `tvc web`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  cargo tvc web --open                     the page of the only Nano that is connected
  cargo tvc web --port ./nano              of the rig that `tvc rig --pty --link ./nano` runs
  cargo tvc web --logs flights             recordings and step tests go to the folder flights

Attitude, strip charts, health, messages, parameters, arm, STOP (Esc), step tests and recordings.
Everything is in the program: no network is needed. When the port goes away the page says so and
waits for it. Exit status: 0 ended, 1 something failed, 2 unusable input.")]
pub struct Web {
    /// Where the vehicle is.
    #[command(flatten)]
    pub port: PortOptions,

    /// Where the page is served. Anything but the computer itself lets others on the network in who
    /// have the address with its token.
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1:8650")]
    pub listen: SocketAddr,

    /// Open the page in the browser.
    #[arg(long)]
    pub open: bool,

    /// Folder for recordings; it must exist.
    #[arg(long, value_name = "DIR", default_value = ".")]
    pub logs: PathBuf,

    /// End by itself after this many seconds.
    #[arg(long, value_name = "S", value_parser = seconds)]
    pub seconds: Option<f64>,
}

/// Serves the page until Ctrl-C.
///
/// # Errors
/// No port, no folder for logs, an address that is taken, or a log that cannot be ended.
pub fn run(options: &Web) -> Result<Verdict> {
    if !options.logs.is_dir() {
        return Err(BadInput::new(format!(
            "no folder {}: make it, or name another with --logs",
            options.logs.display()
        ))
        .into());
    }
    let stop = signals::on_signal()?;
    let listener = listen(options.listen)?;
    let address = listener.local_addr()?;
    let link = Link::open(&options.port)?;
    let token = Token::new()?;
    let url = url(address, &token);
    let model = Arc::new(Model::default());
    let (handle, asks) = Handle::new();
    let server = Arc::new(Server {
        token,
        open: address.ip().is_loopback(),
        vehicle: handle,
        model: model.clone(),
        test_stop: Arc::default(),
        pages: Arc::default(),
    });
    println!("{url}");
    if !address.ip().is_loopback() {
        eprintln!(
            "warning: whoever has this address can arm the vehicle from the network; leave --listen out to keep it on this computer"
        );
        if address.ip().is_unspecified() {
            eprintln!(
                "on other computers put this one's own address in the place of {}",
                address.ip()
            );
        }
    }
    eprintln!("the page is served until Ctrl-C");
    if options.open {
        open(&url);
    }
    let begun = Instant::now();
    let longest = options.seconds.map(Duration::from_secs_f64);
    std::thread::scope(|scope| {
        let (port, logs, shown) = (&options.port, &options.logs, &*model);
        let vehicle = scope.spawn(move || vehicle_thread::run(link, port, asks, shown, logs, stop));
        let served = server::serve(listener, &server, &mut || {
            signals::asked(stop, begun, longest)
        });
        // The vehicle's thread ends when --seconds are over, too.
        stop.store(true, std::sync::atomic::Ordering::Relaxed);
        let ended = vehicle.join();
        served?;
        ended.map_err(|_| anyhow!("the vehicle's thread broke"))?
    })?;
    Ok(Verdict::Met)
}

fn listen(address: SocketAddr) -> Result<TcpListener> {
    let listener = TcpListener::bind(address).map_err(|error| {
        BadInput::new(format!(
            "cannot listen on {address}: {error}; name another address with --listen, such as 127.0.0.1:{}",
            address.port().wrapping_add(1)
        ))
    })?;
    // Connections inherit this option; without it the system delays small events.
    socket2::SockRef::from(&listener).set_tcp_nodelay(true)?;
    Ok(listener)
}

/// The page's address. On this computer alone the page itself carries the token.
fn url(address: SocketAddr, token: &Token) -> String {
    if address.ip().is_loopback() {
        format!("http://{address}/")
    } else {
        format!("http://{address}/?token={}", token.text())
    }
}

/// Asks the system to show the page; where it cannot, the address has been printed.
fn open(url: &str) {
    let (program, arguments): (&str, &[&str]) = if cfg!(target_os = "macos") {
        ("open", &[])
    } else if cfg!(windows) {
        ("cmd", &["/C", "start", ""])
    } else {
        ("xdg-open", &[])
    };
    let started = Command::new(program)
        .args(arguments)
        .arg(url)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn();
    if let Err(error) = started {
        eprintln!("cannot open a browser ({program}: {error}); open {url}");
    }
}
