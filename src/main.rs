//! The firmware: wait for the tick, read, step, write, send.
//!
//! On the host it prints its configuration: the parameters with their ranges, the rates and the limits.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
mod board;

#[cfg(target_os = "none")]
mod firmware {
    use bno055_driver::Driver;
    use cortex_m::singleton;
    use cortex_m_rt::entry;
    #[cfg(feature = "probe")]
    use defmt_rtt as _;
    use tvc_nano::flight::Flight;
    use tvc_nano::recorder::Recorder;
    use tvc_nano::telemetry::Telemetry;

    use crate::board::{Board, Event};

    /// All that lives as long as the firmware. In statics, so that the stack holds only what comes and goes.
    struct Firmware {
        board: &'static mut Board,
        driver: &'static mut Driver,
        flight: &'static mut Flight,
        telemetry: &'static mut Telemetry,
        recorder: &'static mut Recorder,
    }

    #[entry]
    fn main() -> ! {
        // In its place from the start: on its way there it would not fit the stack.
        static mut RECORDER: Recorder = Recorder::new();
        let mut firmware = Firmware::start(RECORDER);
        loop {
            firmware.turn();
        }
    }

    impl Firmware {
        // A function of its own: what it builds on the stack is gone when the loop begins.
        #[inline(never)]
        fn start(recorder: &'static mut Recorder) -> Self {
            let config = tvc_nano::config::sensor();
            let (board, params, report) = Board::start(config.address.value());
            let flight = Flight::new(params, report).expect("parameters in range are possible");
            Self {
                board: singleton!(: Board = board).expect("started once"),
                driver: singleton!(: Driver = Driver::new(config)).expect("started once"),
                flight: singleton!(: Flight = flight).expect("started once"),
                telemetry: singleton!(: Telemetry = Telemetry::new()).expect("started once"),
                recorder,
            }
        }

        /// Once round the loop: wait for the tick, read, step, write, send.
        // A function of its own: what `main` holds for ever in registers is then not in its way. 3.4 KB less flash.
        #[inline(never)]
        fn turn(&mut self) {
            let (now, event) = self.board.wait();
            let reading = match event {
                Event::Burst(burst) => Some(self.driver.sample(burst.started(), burst.bytes())),
                Event::Missed => Some(Err(self.driver.missed())),
                Event::Late(burst) => {
                    // Too late to fly by; what it says of the sensor's health counts all the same.
                    let _ = self.driver.sample(burst.started(), burst.bytes());
                    None
                }
                Event::Reply(reply) => {
                    self.driver.complete(now, reply.bytes());
                    None
                }
                Event::Nothing => None,
            };
            // First, so that what the sensor is asked between two bursts goes over the wire during the step.
            self.board.serve_sensor(now, self.driver);
            if let Some(reading) = reading {
                self.board.step_begins();
                let outputs = self.flight.step(now, reading);
                let snapshot = &outputs.snapshot;
                self.board.step_ends(outputs.pulse, self.flight);
                self.telemetry
                    .record(snapshot, self.flight, &self.board.status());
                self.recorder.record(snapshot, self.flight);
                self.telemetry.serve_recorder(self.recorder);
            }
            self.board.exchange(now, self.telemetry, self.flight);
        }
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
            Change::Disarmed | Change::Turning => "disarmed",
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
