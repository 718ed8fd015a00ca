//! The two front ends over the fake chip.

mod fake;

use std::future::Future;
use std::pin::pin;
use std::task::{Context, Poll, Waker};

use fake::Bus;
use lsm6ds3_driver::config::{GyrRange, Rate};
use lsm6ds3_driver::{Chip, Config, Driver, Imu, SensorFault, asynchronous, blocking};

/// Runs a future that never waits for anything outside.
fn now<T>(future: impl Future<Output = T>) -> T {
    match pin!(future).poll(&mut Context::from_waker(Waker::noop())) {
        Poll::Ready(value) => value,
        Poll::Pending => panic!("the fake chip never waits"),
    }
}

/// Runs the same calls over both front ends, each with a chip of its own.
macro_rules! both {
    (|$imu:ident, $bus:ident| [$($call:tt)*]) => {{
        {
            let $bus = Bus::new();
            let driver = Driver::new(Config::default());
            let mut $imu =
                blocking::Device::new($bus.clone(), $bus.clone(), $bus.clock(), driver);
            macro_rules! go { ($e:expr) => { $e } }
            $($call)*
        }
        {
            let $bus = Bus::new();
            let driver = Driver::new(Config::default());
            let mut $imu =
                asynchronous::Device::new($bus.clone(), $bus.clone(), $bus.clock(), driver);
            macro_rules! go { ($e:expr) => { now($e) } }
            $($call)*
        }
    }};
}

#[test]
fn a_chip_starts_samples_and_tests_itself() {
    both!(|imu, bus| [
        assert_eq!(go!(imu.start()), Ok(()));
        assert_eq!(imu.driver().chip(), Some(Chip::Lsm6ds3));
        for _ in 0..10 {
            bus.0.borrow_mut().now += 5_000;
            let sample = go!(imu.sample()).unwrap();
            let [_, _, z] = sample.raw.acc_m_s2(&imu.driver().config().scale());
            assert!((z - 9.81).abs() < 0.02, "{z}");
        }
        imu.driver_mut().begin_self_test();
        assert_eq!(go!(imu.start()), Ok(()));
        assert!(imu.driver().self_test().unwrap().passed());
        let other = Config { gyr_range: GyrRange::Dps245, rate: Rate::Hz104, ..Config::default() };
        imu.driver_mut().reconfigure(other);
        assert_eq!(go!(imu.start()), Ok(()));
        assert_eq!(bus.0.borrow().registers[0x11], 0x40);
    ]);
}

#[test]
fn a_chip_that_is_missing_is_reported_and_found_later() {
    both!(|imu, bus| [
        bus.0.borrow_mut().address = 0x10;
        assert_eq!(go!(imu.start()), Err(SensorFault::Nak));
        assert!(imu.bus_error().is_some());
        assert_eq!(imu.driver().fault(), Some(SensorFault::Nak));
        bus.0.borrow_mut().address = 0x6A;
        assert_eq!(go!(imu.start()), Ok(()));
        let _ = imu.release();
    ]);
}
