//! Prints samples of an LSM6DS3 on a Linux I2C bus: `cargo run --example linux -- /dev/i2c-1`.

#[cfg(target_os = "linux")]
fn main() {
    use std::time::{Duration, Instant};

    use linux_embedded_hal::{Delay, I2cdev};
    use lsm6ds3_driver::{Config, Driver, Micros, blocking::Device};

    let path = std::env::args().nth(1).unwrap_or_else(|| "/dev/i2c-1".into());
    let i2c = match I2cdev::new(&path) {
        Ok(i2c) => i2c,
        Err(error) => {
            eprintln!("{path}: {error}");
            std::process::exit(2);
        }
    };
    let epoch = Instant::now();
    let clock = move || Micros(epoch.elapsed().as_micros() as u64);
    let config = Config { either_address: true, ..Config::default() };
    let mut imu = Device::new(i2c, Delay, clock, Driver::new(config));
    if let Err(fault) = imu.start() {
        eprintln!("{path}: {fault}");
        std::process::exit(1);
    }
    let scale = config.scale();
    println!("{:?} at {:?}", imu.driver().chip(), imu.driver().config().address);
    loop {
        match imu.sample() {
            Ok(sample) => println!(
                "{:>10} us  acc {:6.2?} m/s^2  rate {:6.3?} rad/s",
                sample.raw.time.0,
                sample.raw.acc_m_s2(&scale),
                sample.raw.gyr_rad_s(&scale)
            ),
            Err(fault) => println!("{fault}"),
        }
        std::thread::sleep(Duration::from_millis(10));
    }
}

#[cfg(not(target_os = "linux"))]
fn main() {
    eprintln!("this example needs Linux");
}
