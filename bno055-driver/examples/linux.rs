//! Prints samples of a BNO055 on a Linux I2C bus: `cargo run --example linux -- /dev/i2c-1`.

#[cfg(target_os = "linux")]
fn main() {
    use std::time::{Duration, Instant};

    use bno055_driver::{Config, Micros, blocking::Bno055};
    use linux_embedded_hal::{Delay, I2cdev};

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
    let config = Config::default();
    let mut imu = Bno055::new(i2c, Delay, clock, config);
    if let Err(fault) = imu.start() {
        eprintln!("{path}: {fault}");
        std::process::exit(1);
    }
    let scale = config.units.scale();
    let identity = imu.driver().identity();
    println!("firmware {:x}, id {:02x?}", identity.software, identity.unique_id);
    loop {
        match imu.sample() {
            Ok(sample) => println!(
                "{:>10} us  acc {:6.2?} m/s^2  rate {:6.3?} rad/s  field {:6.1?} uT",
                sample.time.0,
                sample.acc_m_s2(&scale),
                sample.gyr_rad_s(&scale),
                sample.mag_ut(&scale)
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
