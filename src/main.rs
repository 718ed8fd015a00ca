//! The firmware: wait for the tick, read, step, write, send.
//!
//! On the host it prints its configuration: the parameters with their ranges, the rates and the limits.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
mod board;

#[cfg(target_os = "none")]
mod firmware {
    use bno055_driver::{Config, Driver};
    use cortex_m_rt::entry;
    #[cfg(feature = "probe")]
    use defmt_rtt as _;
    use tvc_nano::flight::Flight;
    use tvc_nano::params::Params;
    use tvc_nano::telemetry::Telemetry;

    use crate::board::{Board, Event};

    /// Keep a value in a static for good: counted as static RAM, and reached by a short address, which a stack frame
    /// of kilobytes is not on this core.
    macro_rules! keep {
        ($type:ty, $value:expr) => {
            cortex_m::singleton!(: $type = $value).expect("main runs once")
        };
    }

    #[entry]
    fn main() -> ! {
        let params = Params::default();
        let driver = keep!(Driver, Driver::new(Config::default()));
        let (board, report) = Board::start(driver.config().address.value(), &params);
        let board = keep!(Board, board);
        let flight = Flight::new(params, report).expect("the default parameters are possible");
        let flight = keep!(Flight, flight);
        let telemetry = keep!(Telemetry, Telemetry::new());
        loop {
            let (now, event) = board.wait();
            let reading = match event {
                Event::Burst(outcome) => Some(driver.sample(outcome.started(), outcome.bytes())),
                Event::Missed => Some(Err(driver.missed())),
                Event::Late(outcome) => {
                    // Too late to fly by; what it says of the sensor's health counts all the same.
                    let _ = driver.sample(outcome.started(), outcome.bytes());
                    None
                }
                Event::Reply(outcome) => {
                    driver.complete(now, outcome.bytes());
                    None
                }
                Event::Nothing => None,
            };
            if let Some(reading) = reading {
                board.step_begins();
                let outputs = flight.step(now, reading);
                board.step_ends(outputs.pulse, flight.params(), &outputs.snapshot.state);
                telemetry.record(&outputs.snapshot, flight, &board.status());
            }
            board.serve_sensor(now, driver);
            board.exchange(now, telemetry, flight);
        }
    }
}

#[cfg(not(target_os = "none"))]
fn main() {
    use tvc_nano::config;
    use tvc_nano::params::{Change, TABLE};

    println!(
        "tvc-nano {}: configuration of the image",
        env!("CARGO_PKG_VERSION")
    );
    println!();
    println!(
        "{:<16} {:>9} {:<8} {:<26} {:<9} meaning",
        "parameter", "default", "unit", "range", "change"
    );
    for info in TABLE {
        let change = match info.change {
            Change::Live => "live",
            Change::Disarmed => "disarmed",
        };
        println!(
            "{:<16} {:>9} {:<8} {:<26} {:<9} {}",
            info.name,
            info.default,
            info.unit,
            info.range.to_string(),
            change,
            info.meaning
        );
    }
    println!();
    for (name, value, unit) in [
        (
            "control period",
            config::CONTROL_PERIOD_US as f32 / 1_000.0,
            "ms",
        ),
        ("shortest pulse", config::PULSE_MIN_US, "us"),
        ("longest pulse", config::PULSE_MAX_US, "us"),
        (
            "tilt to arm",
            config::COS_ARM_TILT.acos().to_degrees(),
            "deg",
        ),
        (
            "tilt to give up",
            config::COS_FAILSAFE_TILT.acos().to_degrees(),
            "deg",
        ),
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
