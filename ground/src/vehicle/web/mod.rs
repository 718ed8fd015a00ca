//! `tvc web`: the vehicle on a page. One thread owns the port ([`vehicle_thread`]); the main thread
//! serves the page ([`server`]) and each page's connection ([`socket`]). Orders come in at the
//! [`desk`]; what is known stands in the [`model`].

pub mod auth;
pub mod desk;
pub mod handle;
mod logs;
mod manoeuvre;
pub mod model;
mod relay;
mod releases;
mod report;
pub mod rig;
pub mod server;
mod set_up;
mod socket;
mod strangers;
pub mod vehicle_thread;
pub mod visitor;

use std::net::{SocketAddr, TcpListener};
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::{Context, Error, Result, anyhow, bail};
use clap::Args;
use tokio::runtime;
use tokio::time::sleep;

use crate::signals;
use crate::vehicle::admission::Admission;
use crate::vehicle::link::Link;
use crate::vehicle::port::PortOptions;
use ::report::arguments::seconds;
use ::report::exit::{BadInput, Verdict};
use ::report::file::print;
use auth::{Once, Token};
use desk::Desk;
use handle::Handle;
use model::Model;
use rig::RigControl;

/// Time between two looks at whether the program is to end.
const LOOK: Duration = Duration::from_millis(50);

/// Options of `tvc web`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  tvc web --open                     the page of the only Nano that is connected
  tvc web --port ./nano              of the rig that `tvc rig --pty --link ./nano` runs
  tvc web --logs flights             recordings and step tests go to the folder flights

Attitude, strip charts, health, messages, parameters, arm, STOP (Esc), tests, recordings and their
reports; for the virtual rig, if it has a --link, all that can be done to it by hand. Everything is
in the program: no network is needed. When the port goes away the page says so and waits for it.

At its end, and a second after the last page was closed, the vehicle is disarmed. Meanwhile its
FS_HOST is 1, so that it gives up 3 s after this program was killed.

Exit status: 0 ended, 1 something failed, 2 unusable input.")]
pub struct Web {
    /// Where the vehicle is.
    #[command(flatten)]
    pub port: PortOptions,

    /// Where the page is served. Anything but the computer itself shows the vehicle to others on
    /// the network who have the address with its token; they can stop it.
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1:8650")]
    pub listen: SocketAddr,

    /// Who else may command.
    #[command(flatten)]
    pub admission: Admission,

    /// Open the page in the browser.
    #[arg(long)]
    pub open: bool,

    /// Folder for recordings, whose logs the page lists; it must exist.
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
        bail!(BadInput::new(format!(
            "no folder {}: make it, or name another with --logs",
            options.logs.display()
        )));
    }
    let stop = signals::on_signal()?;
    let listener = listen(options.listen)?;
    let address = listener.local_addr()?;
    let (link, asker) = Link::open_live(&options.port)?;
    let beside = || RigControl::beside(options.port.port.as_deref());
    let rig = asker.map_or_else(beside, RigControl::Here);
    let token = Token::new()?;
    let once = Once::new()?;
    // Behind # it stays in the browser: no request carries it, and no log.
    let url = |word: &str| format!("http://{address}/#token={word}");
    let (url, opened) = (url(&token.0), url(&once.text()));
    let model = Arc::new(Model::default());
    let (handle, asks) = Handle::new();
    let desk = Desk::new(
        (token, once),
        handle,
        rig.clone(),
        options.logs.clone(),
        std::env::current_exe().context("who makes the reports")?,
        model.clone(),
    );
    let desk = Arc::new(desk);
    let runtime = runtime::Builder::new_current_thread().enable_all().build();
    let runtime = runtime.context("serving the page")?;
    print(format_args!("{url}\n"))?;
    if !address.ip().is_loopback() {
        let words = match options.admission.is_open() {
            true => {
                "warning: whoever may command and has this address can arm the vehicle from the network, \
                 and the address is not encrypted on its way"
            }
            false => {
                "others who have this address see the vehicle and can stop it; \
                 --accept-commands-from lets them command it"
            }
        };
        eprintln!("{words}");
        let ip = address.ip();
        if ip.is_unspecified() {
            eprintln!("on other computers put this one's own address in the place of {ip}");
        }
    }
    eprintln!("the page is served until Ctrl-C");
    if options.open {
        open(&opened, &url);
    }
    listener.set_nonblocking(true)?;
    let begun = Instant::now();
    std::thread::scope(|scope| {
        let _ending = Ending(stop);
        let (port, logs, shown) = (&options.port, &options.logs, &*model);
        let vehicle = scope.spawn(move || vehicle_thread::run(link, port, asks, shown, logs, stop));
        runtime.block_on(async {
            let served = async {
                let listener = tokio::net::TcpListener::from_std(listener)?;
                match server::serve(listener, desk.clone(), &options.admission).await {}
            };
            let over = async {
                while !signals::asked(stop, begun.elapsed(), options.seconds)
                    && !vehicle.is_finished()
                {
                    sleep(LOOK).await;
                }
                Ok::<_, Error>(())
            };
            tokio::select! {
                result = served => result,
                result = over => result,
                () = rig.watch(&model) => Ok(()),
            }
        })?;
        // Now the vehicle's thread disarms what is armed, and whoever moves the rudder puts back
        // what was changed for that.
        desk.close();
        stop.store(true, Ordering::Relaxed);
        vehicle.join().map_err(|_| anyhow!("the vehicle's thread broke"))?
    })?;
    Ok(Verdict::Met)
}

/// However the page's thread ends, the vehicle's thread ends, too, and disarms first.
struct Ending(&'static AtomicBool);

impl Drop for Ending {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

fn listen(address: SocketAddr) -> Result<TcpListener> {
    TcpListener::bind(address).map_err(|error| {
        BadInput::new(format!(
            "cannot listen on {address}: {error}; name another address with --listen, such as 127.0.0.1:{}",
            address.port().wrapping_add(1)
        ))
        .into()
    })
}

/// Asks the system to show the page; where it cannot, the address has been printed.
fn open(url: &str, printed: &str) {
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
        eprintln!("cannot open a browser ({program}: {error}); open {printed}");
    }
}
