//! The exact transactions of every call of the two front ends, the pauses between them, and bus
//! errors on the way.

use std::cell::Cell;
use std::future::Future;
use std::pin::pin;
use std::rc::Rc;
use std::task::{Context, Poll, Waker};

use bno055_driver::config::{Address, Mode};
use bno055_driver::{
    Config, Imu, Micros, Profile, SensorFault, SoftIron, SystemError, SystemStatus, asynchronous,
    blocking,
};
use embedded_hal::i2c::{ErrorKind, NoAcknowledgeSource};
use embedded_hal_mock::eh1::i2c::{Mock, Transaction};

/// A clock that only its own delays move.
#[derive(Clone, Default)]
struct Time(Rc<Cell<u64>>);

impl Time {
    fn clock(&self) -> impl FnMut() -> Micros + use<> {
        let time = self.clone();
        move || Micros(time.0.get())
    }
}

impl embedded_hal::delay::DelayNs for Time {
    fn delay_ns(&mut self, ns: u32) {
        self.delay_us(ns.div_ceil(1000));
    }
    fn delay_us(&mut self, us: u32) {
        self.0.set(self.0.get() + u64::from(us));
    }
}

impl embedded_hal_async::delay::DelayNs for Time {
    async fn delay_ns(&mut self, ns: u32) {
        embedded_hal::delay::DelayNs::delay_ns(self, ns);
    }
    async fn delay_us(&mut self, us: u32) {
        embedded_hal::delay::DelayNs::delay_us(self, us);
    }
}

/// Runs a future that never waits for anything outside.
fn now<T>(future: impl Future<Output = T>) -> T {
    match pin!(future).poll(&mut Context::from_waker(Waker::noop())) {
        Poll::Ready(value) => value,
        Poll::Pending => panic!("the mock never waits"),
    }
}

/// Runs the same calls over both front ends, each against its own mock with the same transactions.
macro_rules! both {
    ($config:expr, $script:expr, |$imu:ident, $time:ident| [$($call:tt)*]) => {{
        let (config, script): (Config, Vec<Transaction>) = ($config, $script);
        {
            let ($time, mut mock) = (Time::default(), Mock::new(&script));
            let mut $imu = blocking::Bno055::new(mock.clone(), $time.clone(), $time.clock(), config);
            macro_rules! go { ($e:expr) => { $e } }
            $($call)*
            mock.done();
        }
        {
            let ($time, mut mock) = (Time::default(), Mock::new(&script));
            let mut $imu = asynchronous::Bno055::new(mock.clone(), $time.clone(), $time.clock(), config);
            macro_rules! go { ($e:expr) => { now($e) } }
            $($call)*
            mock.done();
        }
    }};
}

const SAMPLE: [u8; 18] = [1, 0, 2, 0, 0xD5, 3, 64, 1, 0xA6, 0xFF, 128, 2, 5, 0, 8, 0, 0xFE, 0xFF];
const OTHER: [u8; 18] = [0, 0, 2, 0, 0xD6, 3, 64, 1, 0xA6, 0xFF, 128, 2, 3, 0, 8, 0, 0xFE, 0xFF];

struct Script(u8, Vec<Transaction>);

impl Script {
    fn new() -> Self {
        Self(0x28, Vec::new())
    }

    fn read(mut self, register: u8, answer: &[u8]) -> Self {
        self.1.push(Transaction::write_read(self.0, vec![register], answer.to_vec()));
        self
    }

    fn write(mut self, register: u8, bytes: &[u8]) -> Self {
        self.1.push(Transaction::write(self.0, [&[register], bytes].concat()));
        self
    }

    fn nak(mut self, register: u8, bytes: &[u8]) -> Self {
        let failed = Transaction::write(self.0, [&[register], bytes].concat());
        self.1.push(failed.with_error(ErrorKind::NoAcknowledge(NoAcknowledgeSource::Address)));
        self
    }

    fn nak_burst(mut self) -> Self {
        let failed = Transaction::write_read(self.0, vec![8], vec![0; 18]);
        self.1.push(failed.with_error(ErrorKind::NoAcknowledge(NoAcknowledgeSource::Address)));
        self
    }

    fn until_config(self) -> Self {
        self.write(7, &[0])
            .read(0, &[0xA0, 0xFB, 0x32, 0x0F, 0x11, 0x03, 0x15, 0])
            .write(0x3D, &[0])
            .read(0x3D, &[0])
    }

    fn after_config(self, mode: u8) -> Self {
        let status = if mode > 7 { 5 } else { 6 };
        self.read(0x36, &[0x0F, 0, 0, 0, 0])
            .write(0x3E, &[0])
            .read(0x3E, &[0])
            .write(0x3B, &[0])
            .read(0x3B, &[0])
            .write(0x41, &[0x24, 0])
            .read(0x41, &[0x24, 0])
            .write(7, &[1])
            .read(7, &[1])
            .write(8, &[0x0E, 0x0F, 0x10, 0])
            .read(8, &[0x0E, 0x0F, 0x10, 0])
            .read(0x50, &[9; 16])
            .write(7, &[0])
            .read(7, &[0])
            .write(0x3D, &[mode])
            .read(0x3D, &[mode])
            .read(0x39, &[status, 0])
            .read(8, &SAMPLE)
            .read(8, &OTHER)
    }

    fn set_up(self) -> Self {
        self.until_config().after_config(7)
    }
}

#[test]
fn start() {
    both!(Config::default(), Script::new().set_up().1, |imu, time| [
        assert_eq!(go!(imu.start()), Ok(()));
        assert_eq!(imu.driver().identity().unique_id, [9; 16]);
        // To CONFIG, six writes, from CONFIG, and one burst to the next.
        assert_eq!(time.0.get(), 19_000 + 6 * 5_000 + 7_000 + 10_000);
    ]);
}

#[test]
fn start_at_the_other_address_while_the_chip_boots() {
    let config = Config { address: Address::High, ..Config::default() };
    let script = Script(0x29, Vec::new()).nak(7, &[0]).nak(7, &[0]).set_up();
    both!(config, script.1, |imu, time| [
        assert_eq!(go!(imu.start()), Ok(()));
        assert_eq!(time.0.get(), 2 * 20_000 + 66_000);
        assert!(imu.bus_error().is_some());
    ]);
}

#[test]
fn start_reports_what_is_certain_at_once() {
    let script = Script::new().until_config().read(0x36, &[0x0B, 0, 0, 0, 0]);
    both!(Config::default(), script.1, |imu, time| [
        assert_eq!(go!(imu.start()), Err(SensorFault::SelfTest { result: 0x0B }));
        assert_eq!(time.0.get(), 19_000);
    ]);
}

#[test]
fn start_gives_up_on_a_chip_that_is_not_there() {
    let mut script = Script::new();
    for _ in 0..251 {
        script = script.nak(7, &[0]);
    }
    both!(Config::default(), script.1, |imu, time| [
        assert_eq!(go!(imu.start()), Err(SensorFault::Nak));
        assert!((5_000_000..5_050_000).contains(&time.0.get()));
    ]);
}

#[test]
fn samples_each_with_one_verification() {
    let script = Script::new()
        .set_up()
        .read(8, &SAMPLE)
        .read(0x3D, &[7])
        .read(8, &OTHER)
        .read(7, &[0])
        .read(8, &SAMPLE)
        .read(0x3B, &[0])
        .read(8, &OTHER)
        .read(0x41, &[0x24])
        .read(8, &SAMPLE)
        .read(0x42, &[0])
        .read(8, &OTHER)
        .read(0x39, &[6])
        .read(8, &SAMPLE)
        .read(0x3E, &[0])
        .read(8, &OTHER)
        .read(0x3D, &[7]);
    both!(Config::default(), script.1, |imu, time| [go!(imu.start()).unwrap(); for _ in 0..4 {
        let sample = go!(imu.sample()).unwrap();
        assert_eq!(
            (sample.acc, sample.mag, sample.gyr),
            ([1, 2, 981], [320, -90, 640], [5, 8, -2])
        );
        assert_eq!(sample.time, Micros(time.0.get()));
        assert_eq!(go!(imu.sample()).unwrap().gyr, [3, 8, -2]);
    }]);
}

#[test]
fn a_lost_chip_is_set_up_again_from_within_sample() {
    // The verifications between the bursts still succeed. The seventh burst, 60 ms after the first,
    // gives the chip up. That call and the following ones set it up again, and the last of them
    // also takes a sample.
    let script = (0..6)
        .fold(Script::new().set_up(), |script, _| script.nak_burst().read(0x3D, &[7]))
        .nak_burst()
        .set_up()
        .read(8, &SAMPLE)
        .read(0x3D, &[7]);
    both!(Config::default(), script.1, |imu, time| [
        go!(imu.start()).unwrap();
        for _ in 0..7 {
            assert_eq!(go!(imu.sample()), Err(SensorFault::Nak));
            embedded_hal::delay::DelayNs::delay_ms(&mut time.clone(), 10);
        }
        let mut calls = 0;
        let sample = loop {
            embedded_hal::delay::DelayNs::delay_ms(&mut time.clone(), 10);
            calls += 1;
            match go!(imu.sample()) {
                Ok(sample) => break sample,
                Err(fault) => assert_eq!(fault, SensorFault::Nak, "the first cause"),
            }
        };
        // 19 ms to CONFIG, six writes of 5 ms, 7 ms from CONFIG and 10 ms between two bursts, in
        // calls 10 ms apart.
        assert_eq!((calls, sample.acc), (9, [1, 2, 981]));
        assert_eq!(imu.driver().fault(), None);
    ]);
}

#[test]
fn temperature_calibration_and_system_status() {
    let script = Script::new()
        .set_up()
        .read(0x34, &[0xF6])
        .read(0x35, &[0b11_10_01_00])
        .read(0x39, &[6, 0])
        .read(0x39, &[1, 9]);
    both!(Config::default(), script.1, |imu, _time| [
        go!(imu.start()).unwrap();
        assert_eq!(go!(imu.temperature()), Ok(-10.0));
        let status = go!(imu.calibration_status()).unwrap();
        assert_eq!((status.system, status.gyr, status.acc, status.mag), (3, 2, 1, 0));
        let none = (SystemStatus::NoFusion, SystemError::None);
        assert_eq!(go!(imu.system_status()), Ok(none));
        let failed = (SystemStatus::Error, SystemError::Fusion);
        assert_eq!(go!(imu.system_status()), Ok(failed));
    ]);
}

#[test]
fn profile_soft_iron_and_self_test() {
    let profile = Profile { acc_offset: [-1, 2, 3], mag_radius: 480, ..Profile::default() };
    let script = Script::new()
        .set_up()
        .until_config()
        .read(0x55, &profile.registers())
        .after_config(7)
        .until_config()
        .read(0x43, &SoftIron::IDENTITY.registers())
        .after_config(7)
        .until_config()
        .write(0x3F, &[1])
        .read(0x36, &[0x0F, 0, 0, 4, 0])
        .read(0x36, &[0x0E, 0, 0, 0, 3])
        .after_config(7);
    both!(Config::default(), script.1, |imu, time| [
        go!(imu.start()).unwrap();
        assert_eq!(go!(imu.profile()), Ok(profile));
        assert_eq!(go!(imu.soft_iron()), Ok(SoftIron::IDENTITY));
        let before = time.0.get();
        let result = go!(imu.self_test()).unwrap();
        assert!(!result.passed() && !result.acc() && result.gyr());
        assert_eq!(result.error, SystemError::SelfTest);
        let writes = 6 * 5_000;
        let set_up = 19_000 + 400_000 + 10_000 + writes + 7_000 + 10_000;
        assert_eq!(time.0.get() - before, set_up);
    ]);
}

#[test]
fn another_mode_and_its_fusion_outputs() {
    let config = Config { mode: Mode::Ndof, ..Config::default() };
    let mut outputs = [0; 26];
    outputs[7] = 0x40;
    outputs[24] = 0xD5;
    outputs[25] = 0x03;
    let script = Script::new()
        .set_up()
        .until_config()
        .after_config(0x0C)
        .read(0x1A, &outputs)
        .read(0x3D, &[0x0C]);
    both!(Config::default(), script.1, |imu, _time| [
        go!(imu.start()).unwrap();
        assert_eq!(go!(imu.reconfigure(config)), Ok(()));
        let fusion = go!(imu.fusion()).unwrap();
        assert_eq!(fusion.quaternion(), [1.0, 0.0, 0.0, 0.0]);
        assert_eq!(fusion.gravity, [0, 0, 981]);
    ]);
}

#[test]
fn suspend_and_resume() {
    let script = Script::new().set_up().until_config().write(0x3E, &[2]).set_up();
    both!(Config::default(), script.1, |imu, _time| [
        go!(imu.start()).unwrap();
        assert_eq!(go!(imu.suspend()), Ok(()));
        assert_eq!(go!(imu.sample()), Err(SensorFault::Suspended));
        assert_eq!(go!(imu.resume()), Ok(()));
    ]);
}

/// Each kind of bus error under its own name, from a burst. The bus' own words are kept.
#[test]
fn kinds_of_bus_errors() {
    for (kind, fault) in [
        (ErrorKind::NoAcknowledge(NoAcknowledgeSource::Data), SensorFault::Nak),
        (ErrorKind::ArbitrationLoss, SensorFault::Arbitration),
        (ErrorKind::Bus, SensorFault::Stuck),
        (ErrorKind::Overrun, SensorFault::Protocol),
        (ErrorKind::Other, SensorFault::Timeout),
    ] {
        let mut script = Script::new().set_up();
        script.1.push(Transaction::write_read(0x28, vec![8], vec![0; 18]).with_error(kind));
        let script = script.read(0x3D, &[7]);
        both!(Config::default(), script.1, |imu, _time| [
            go!(imu.start()).unwrap();
            assert_eq!(go!(imu.sample()), Err(fault));
            assert_eq!(imu.bus_error(), Some(kind));
            assert_eq!(imu.bus_error(), None);
        ]);
    }
}

/// A clock that stands still must not make any call wait for ever.
#[test]
fn a_dead_clock_ends_in_an_error() {
    struct NoDelay;
    impl embedded_hal::delay::DelayNs for NoDelay {
        fn delay_ns(&mut self, _: u32) {}
    }
    struct Absent;
    #[derive(Debug)]
    struct Nak;
    impl embedded_hal::i2c::Error for Nak {
        fn kind(&self) -> ErrorKind {
            ErrorKind::NoAcknowledge(NoAcknowledgeSource::Unknown)
        }
    }
    impl embedded_hal::i2c::ErrorType for Absent {
        type Error = Nak;
    }
    impl embedded_hal::i2c::I2c for Absent {
        fn transaction(
            &mut self,
            _: u8,
            _: &mut [embedded_hal::i2c::Operation<'_>],
        ) -> Result<(), Nak> {
            Err(Nak)
        }
    }
    let mut imu = blocking::Bno055::new(Absent, NoDelay, || Micros(0), Config::default());
    assert_eq!(imu.start(), Err(SensorFault::Booting));
}
