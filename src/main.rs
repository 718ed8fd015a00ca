//! The firmware: wait for the tick, read, step, write, send.
//!
//! On the host it says that it is for the chip.
#![cfg_attr(target_os = "none", no_std, no_main)]
// Nothing of a program is reachable from outside; `pub` marks what a module offers to the others.
#![allow(unreachable_pub)]

#[cfg(target_os = "none")]
mod board;
#[cfg(target_os = "none")]
mod boards;
#[cfg(target_os = "none")]
mod samd21;

#[cfg(target_os = "none")]
mod firmware {
    use core::mem::MaybeUninit;

    use atsamd_hal::serial_number;
    use cortex_m_rt::entry;
    #[cfg(feature = "probe")]
    use defmt_rtt as _;
    use tvc_imu::Micros;
    use tvc_nano::SelfCheck;
    use tvc_nano::application::Application;
    use tvc_nano::failsafe::BootReport;
    use tvc_nano::flight::Flight;
    use tvc_nano::navigation::Navigation;
    use tvc_nano::params::Params;
    use tvc_nano::recorder::Recorder;
    use tvc_nano::sensor::Sensor;
    use tvc_nano::telemetry::{Identity, Telemetry};

    use crate::board::Board;
    use crate::samd21::crash;

    #[entry]
    fn main() -> ! {
        // What lives as long as the firmware, in statics, so that the stack holds only what comes
        // and goes.
        static mut BOARD: MaybeUninit<Board> = MaybeUninit::uninit();
        static mut SENSOR: MaybeUninit<Sensor> = MaybeUninit::uninit();
        static mut FLIGHT: MaybeUninit<Flight> = MaybeUninit::uninit();
        static mut TELEMETRY: MaybeUninit<Telemetry> = MaybeUninit::uninit();
        // In its place from the start: on its way there it would not fit the stack.
        static mut RECORDER: Recorder = Recorder::new();
        // By reference: a parameter's copy would stay on the stack.
        let (board, params, report) = &mut board(BOARD);
        let telemetry = telemetry(TELEMETRY, params.mav_sysid() as u8);
        let flight = flight(FLIGHT, params, *report);
        let sensor = sensor(SENSOR, params);
        run(board, sensor, flight, telemetry, RECORDER)
    }

    // Not inlined: its frame, which stays, is not to hold what start-up needed.
    #[inline(never)]
    fn run(
        board: &mut Board,
        sensor: &mut Sensor,
        flight: &mut Flight,
        telemetry: &mut Telemetry,
        recorder: &mut Recorder,
    ) -> ! {
        let mut application = Application::new(sensor, flight, telemetry, recorder);
        let mut turn = Micros(0);
        loop {
            let (now, event) = board.wait(turn);
            turn = application.turn(now, event, board);
        }
    }

    // Functions of their own: what they build on the stack is gone when the loop begins, and one of
    // the large values at a time is there.
    #[inline(never)]
    fn board(place: &mut MaybeUninit<Board>) -> (&mut Board, Params, BootReport) {
        let (board, params, report) = Board::start();
        (place.write(board), params, report)
    }

    #[inline(never)]
    fn sensor<'a>(place: &'a mut MaybeUninit<Sensor>, params: &Params) -> &'a mut Sensor {
        place.write(Sensor::new(params))
    }

    #[inline(never)]
    fn flight<'a>(
        place: &'a mut MaybeUninit<Flight>,
        params: &Params,
        report: BootReport,
    ) -> &'a mut Flight {
        match Navigation::new(params) {
            Ok(navigation) => place.write(Flight::with(navigation, params, report)),
            // No set of parameters within their ranges makes an impossible flight.
            Err(_) => crash::stop(SelfCheck::Configuration),
        }
    }

    #[inline(never)]
    fn telemetry(place: &mut MaybeUninit<Telemetry>, system: u8) -> &mut Telemetry {
        place.write(Telemetry::new(Identity { system, serial: serial_number() }))
    }
}

#[cfg(not(target_os = "none"))]
fn main() {
    eprintln!("this image is for the chip: cargo fly flies it, cargo tvc flash writes it");
}
