//! The firmware: wait for the tick, read, step, write, send.
//!
//! On the host it prints its configuration: the parameters with their ranges, the rates and the
//! limits.
#![cfg_attr(target_os = "none", no_std, no_main)]
// Nothing of a program is reachable from outside; `pub` marks what a module offers to the others.
#![allow(unreachable_pub)]

#[cfg(target_os = "none")]
mod board;

#[cfg(target_os = "none")]
mod firmware {
    use atsamd_hal::serial_number;
    use bno055_driver::{Driver, Micros};
    use cortex_m::singleton;
    use cortex_m_rt::entry;
    #[cfg(feature = "probe")]
    use defmt_rtt as _;
    use tvc_nano::application::Application;
    use tvc_nano::failsafe::BootReport;
    use tvc_nano::flight::Flight;
    use tvc_nano::params::Params;
    use tvc_nano::recorder::Recorder;
    use tvc_nano::telemetry::{Identity, Telemetry};

    use crate::board::Board;

    #[entry]
    fn main() -> ! {
        // In its place from the start: on its way there it would not fit the stack.
        static mut RECORDER: Recorder = Recorder::new();
        let (board, mut application) = start(RECORDER);
        let mut turn = Micros(0);
        loop {
            let (now, event) = board.wait(turn);
            turn = application.turn(now, event, board);
        }
    }

    /// Puts all that lives as long as the firmware into statics, so that the stack holds only what
    /// comes and goes.
    // A function of its own: what it builds on the stack is gone when the loop begins.
    #[inline(never)]
    fn start(recorder: &'static mut Recorder) -> (&'static mut Board, Application<'static>) {
        let (board, params, report) = board();
        let identity = Identity {
            system: params.mav_sysid() as u8,
            serial: serial_number(),
        };
        let flight = flight(params, report);
        let application = Application::new(driver(), flight, telemetry(identity), recorder);
        (board, application)
    }

    // As `start`: one of the large values at a time is on the stack.
    #[inline(never)]
    fn board() -> (&'static mut Board, Params, BootReport) {
        let (board, params, report) = Board::start();
        let board = singleton!(: Board = board).expect("started once");
        (board, params, report)
    }

    #[inline(never)]
    fn driver() -> &'static mut Driver {
        let config = tvc_nano::config::sensor();
        singleton!(: Driver = Driver::new(config)).expect("started once")
    }

    #[inline(never)]
    fn flight(params: Params, report: BootReport) -> &'static mut Flight {
        let flight = Flight::new(params, report).expect("parameters in range are possible");
        singleton!(: Flight = flight).expect("started once")
    }

    #[inline(never)]
    fn telemetry(identity: Identity) -> &'static mut Telemetry {
        singleton!(: Telemetry = Telemetry::new(identity)).expect("started once")
    }
}

#[cfg(not(target_os = "none"))]
fn main() {
    use tvc_nano::Params;
    use tvc_nano::config;
    use tvc_nano::params::{Change, DESCRIPTIONS, TABLE};

    println!(
        "tvc-nano {}: configuration of the image",
        env!("CARGO_PKG_VERSION")
    );
    println!();
    println!(
        "{:<16} {:>9} {:<8} {:<26} {:<9} meaning",
        "parameter", "default", "unit", "range", "change"
    );
    for (info, description) in TABLE.iter().zip(DESCRIPTIONS) {
        let change = match info.change {
            Change::Live => "live",
            Change::Disarmed | Change::Turning | Change::Measured => "disarmed",
        };
        println!(
            "{:<16} {:>9} {:<8} {:<26} {:<9} {}",
            info.name,
            info.default,
            description.unit,
            info.range.to_string(),
            change,
            description.meaning
        );
    }
    println!();
    let period_us = Params::default().control_period_us();
    for (name, value, unit) in [
        ("control rate", 1.0e6 / period_us as f32, "Hz"),
        ("shortest pulse", config::PULSE_MIN_US, "us"),
        ("longest pulse", config::PULSE_MAX_US, "us"),
        ("tilt to arm", config::ARM_TILT_DEG as f32, "deg"),
        ("tilt to give up", config::FAILSAFE_TILT_DEG as f32, "deg"),
        (
            "age of data to give up",
            config::DATA_AGE_LIMIT_US as f32 / 1_000.0,
            "ms",
        ),
        (
            "host silence to give up",
            config::HOST_SILENCE_US as f32 / 1_000_000.0,
            "s",
        ),
    ] {
        println!("{name:<24} {value:>7.0} {unit}");
    }
}
