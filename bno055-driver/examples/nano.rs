//! An Arduino Nano 33 IoT that lights its LED while a BNO055 on A4 and A5 gives good samples.
//!
//! `cargo build --example nano --target thumbv6m-none-eabi`, linked with `-Tlink.x` and the board's
//! `memory.x`.
//!
//! It uses the HAL's blocking bus master, which has no deadline: a bus that is held low stops it.
//! Where that matters, give the driver a master of your own and use [`bno055_driver::Driver`]
//! directly.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
mod nano {
    use core::cell::Cell;

    use atsamd_hal::clock::{ClockGenId, ClockSource, GenericClockController};
    use atsamd_hal::delay::Delay;
    use atsamd_hal::ehal::digital::OutputPin;
    use atsamd_hal::fugit::RateExtU32;
    use atsamd_hal::gpio::{AlternateD, PA17, PB08, PB09, Pin, Pins, PushPullOutput};
    use atsamd_hal::pac::{CorePeripherals, Peripherals};
    use atsamd_hal::rtc::{Count32Mode, Rtc};
    use atsamd_hal::sercom::{Sercom4, i2c};
    use bno055_driver::{Config, Micros, blocking::Bno055};

    /// Runs for ever; returns only if the board cannot be set up.
    fn run() -> Option<()> {
        let mut board = Peripherals::take()?;
        let core = CorePeripherals::take()?;
        let mut clocks = GenericClockController::with_internal_32kosc(
            board.gclk,
            &mut board.pm,
            &mut board.sysctrl,
            &mut board.nvmctrl,
        );
        let main = clocks.gclk0();
        let slow = clocks.configure_gclk_divider_and_source(
            ClockGenId::Gclk3,
            1,
            ClockSource::Osc32k,
            false,
        )?;
        let rtc_clock = clocks.rtc(&slow)?;
        let sercom_clock = clocks.sercom4_core(&main)?;

        let pins = Pins::new(board.port);
        let mut led: Pin<PA17, PushPullOutput> = pins.pa17.into();
        let sda: Pin<PB08, AlternateD> = pins.pb08.into();
        let scl: Pin<PB09, AlternateD> = pins.pb09.into();
        let pads = i2c::Pads::<Sercom4, _, _>::new(sda, scl);
        let bus = i2c::Config::new(&board.pm, board.sercom4, pads, sercom_clock.freq())
            .baud(100.kHz::<1, 1>())
            .enable();

        // 32,768 counts a second, which wrap after a day and a half: the time goes on.
        let rtc = Rtc::<Count32Mode>::count32_mode(board.rtc, rtc_clock.freq(), &mut board.pm);
        let counts = Cell::new(0_u64);
        let clock = || {
            let passed = rtc.count32().wrapping_sub(counts.get() as u32);
            counts.set(counts.get() + u64::from(passed));
            Micros(counts.get() * 1_000_000 / 32_768)
        };
        let delay = Delay::new(core.SYST, &mut clocks);

        let mut imu = Bno055::new(bus, delay, clock, Config::default());
        let mut tick = clock();
        loop {
            // A chip that is not yet there, or was lost, is set up from within `sample`.
            let good = imu.sample().is_ok();
            led.set_state(good.into()).ok()?;
            tick = tick.after(10_000);
            while clock() < tick {}
        }
    }

    #[cortex_m_rt::entry]
    fn main() -> ! {
        let _ = run();
        loop {
            core::hint::spin_loop();
        }
    }

    #[panic_handler]
    fn panic(_: &core::panic::PanicInfo) -> ! {
        loop {
            core::hint::spin_loop();
        }
    }
}

#[cfg(not(target_os = "none"))]
fn main() {
    eprintln!("this example is for the board: see its first lines");
}
