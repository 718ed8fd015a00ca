//! A Raspberry Pi Pico that keeps itself level: an LSM6DS3 on GP4 and GP5, a servo on GP16.
//!
//! `cargo build --release --example pico --target thumbv6m-none-eabi`, linked with `-Tlink.x`, the
//! board's `memory.x`, and a second-stage boot loader such as that of the crate `rp2040-boot2`.
//!
//! It uses the HAL's blocking bus master, which has no deadline: a bus that is held low stops it.
//! Where that matters, give the driver a master of your own and use [`lsm6ds3_driver::Driver`]
//! directly.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
mod pico {
    use lsm6ds3_driver::{Config, Driver, Micros, blocking::Device};
    use rp2040_hal::clocks::{Clock, init_clocks_and_plls};
    use rp2040_hal::fugit::RateExtU32;
    use rp2040_hal::gpio::{FunctionI2C, Pin, PullUp};
    use rp2040_hal::pac::{CorePeripherals, Peripherals};
    use rp2040_hal::pwm::Slices;
    use rp2040_hal::{I2C, Sio, Timer, Watchdog};
    use tvc_fusion::{Estimator, Mahony, Sample};
    use tvc_pid::{Controller, Gains, Pid, Q16};

    /// Period of the loop, us.
    const TICK_US: u64 = 5_000;
    /// The crystal of the board, Hz.
    const CRYSTAL_HZ: u32 = 12_000_000;
    /// The servo's pulse at neutral, and for a command of 1, us.
    const NEUTRAL_US: f32 = 1_500.0;
    const THROW_US: f32 = 400.0;

    /// Runs for ever; returns only if the board cannot be set up.
    fn run() -> Option<()> {
        let mut board = Peripherals::take()?;
        let core = CorePeripherals::take()?;
        let mut watchdog = Watchdog::new(board.WATCHDOG);
        let clocks = init_clocks_and_plls(
            CRYSTAL_HZ,
            board.XOSC,
            board.CLOCKS,
            board.PLL_SYS,
            board.PLL_USB,
            &mut board.RESETS,
            &mut watchdog,
        )
        .ok()?;
        let timer = Timer::new(board.TIMER, &mut board.RESETS, &clocks);
        let delay = cortex_m::delay::Delay::new(core.SYST, clocks.system_clock.freq().to_Hz());
        let sio = Sio::new(board.SIO);
        let pins = rp2040_hal::gpio::Pins::new(
            board.IO_BANK0,
            board.PADS_BANK0,
            sio.gpio_bank0,
            &mut board.RESETS,
        );
        let sda: Pin<_, FunctionI2C, PullUp> = pins.gpio4.reconfigure();
        let scl: Pin<_, FunctionI2C, PullUp> = pins.gpio5.reconfigure();
        let bus =
            I2C::i2c0(board.I2C0, sda, scl, 400.kHz(), &mut board.RESETS, &clocks.system_clock);

        // One count a microsecond, and a frame of 20 ms.
        let mut servo = Slices::new(board.PWM, &mut board.RESETS).pwm0;
        servo.set_div_int((clocks.system_clock.freq().to_Hz() / 1_000_000) as u8);
        servo.set_top(19_999);
        servo.channel_a.output_to(pins.gpio16);
        servo.enable();

        let clock = || Micros(timer.get_counter().ticks());
        let mut imu = Device::new(bus, delay, clock, Driver::new(Config::default()));
        let scale = imu.driver().config().scale();
        let mut estimator = Estimator::<Mahony>::new(&tvc_fusion::Config::default()).ok()?;
        let config = tvc_pid::Config {
            gains: Gains { kp: 2.0, ki: 0.0, kd: 0.3 },
            limit: -1.0..=1.0,
            ..tvc_pid::Config::new(TICK_US as f32 * 1e-6)
        };
        let mut pid = Controller::<Q16, Pid<Q16>>::new(&config).ok()?;
        let mut tick = clock();
        let mut last = tick;
        loop {
            // A chip that is not yet there, or was lost, is set up from within `sample`; meanwhile
            // the servo is at neutral.
            let command = match imu.sample() {
                Ok(sample) => {
                    // The board lies flat: its z axis points up, the body's down.
                    let [gx, gy, gz] = sample.raw.gyr_rad_s(&scale);
                    let [ax, ay, az] = sample.raw.acc_m_s2(&scale);
                    let (gyr, acc) = ([gx, -gy, -gz], [ax, -ay, -az]);
                    let dt_s = sample.raw.time.since(last) as f32 * 1e-6;
                    last = sample.raw.time;
                    let attitude = estimator.update(dt_s, &Sample { gyr, acc, mag: None });
                    let pitch = attitude.orientation.pitch();
                    f32::from(pid.update(0.0.into(), pitch.into(), gyr[1].into()))
                }
                Err(_) => 0.0,
            };
            let pulse_us = NEUTRAL_US + THROW_US * command;
            let _ = embedded_hal::pwm::SetDutyCycle::set_duty_cycle(
                &mut servo.channel_a,
                pulse_us as u16,
            );
            tick = tick.after(TICK_US);
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
