use super::*;
use lsm6ds3_driver::{BusError, Config, Driver, Imu, Micros, Next, SensorFault, Transfer};

/// A bus of 400 kHz without anything else on it.
struct Bus {
    chip: Lsm6ds3,
    now: Ticks,
    truth: Stimulus,
}

const BYTE: Ticks = Ticks::from_us(23);

impl Bus {
    fn new(errors: ImuErrors) -> Self {
        Self { chip: Lsm6ds3::new(1, errors), now: Ticks::ZERO, truth: Stimulus::REST }
    }

    fn wait_until(&mut self, until: Ticks) {
        while self.now < until {
            self.now = until.min(self.now + Ticks::from_us(500));
            self.chip.sense(self.now, &self.truth);
        }
    }

    fn event(&mut self, event: I2cEvent) -> I2cReply {
        let reply = self.chip.i2c(self.now, event);
        self.wait_until(self.now + BYTE);
        reply
    }

    fn perform(&mut self, transfer: &Transfer) -> Result<Vec<u8>, BusError> {
        let ack = |reply: I2cReply| if reply.ack { Ok(()) } else { Err(BusError::Nak) };
        ack(self.event(I2cEvent::Start { address: ADDRESS, read: false }))?;
        let mut answer = Vec::new();
        match transfer {
            Transfer::Write { register, bytes } => {
                ack(self.event(I2cEvent::Write(*register)))?;
                for byte in bytes.as_slice() {
                    ack(self.event(I2cEvent::Write(*byte)))?;
                }
            }
            Transfer::Read { register, len } => {
                ack(self.event(I2cEvent::Write(*register)))?;
                ack(self.event(I2cEvent::Start { address: ADDRESS, read: true }))?;
                for _ in 0..*len {
                    answer.push(self.event(I2cEvent::Read).data);
                }
            }
        }
        self.event(I2cEvent::Stop);
        Ok(answer)
    }

    fn registers(&mut self, first: u8, len: u8) -> Vec<u8> {
        self.perform(&Transfer::read(first, len)).unwrap()
    }

    fn micros(&self) -> Micros {
        Micros((self.now.as_secs_f64() * 1e6) as u64)
    }

    /// Runs a driver at 200 Hz; the samples and faults of its ticks.
    fn run(
        &mut self,
        driver: &mut Driver,
        seconds: f64,
    ) -> Vec<Result<lsm6ds3_driver::Sample, SensorFault>> {
        let until = self.now + Ticks::from_secs_f64(seconds);
        let mut ticks = Vec::new();
        while self.now < until {
            match driver.next(self.micros()) {
                Next::Transfer(transfer) => {
                    let outcome = self.perform(&transfer);
                    let outcome = outcome.as_deref().map_err(|error| *error);
                    driver.complete(self.micros(), outcome);
                }
                Next::Wait(_) => self.wait_until(self.now + Ticks::from_ms(1)),
                Next::Sample => {
                    self.wait_until(self.now + Ticks::from_ms(4));
                    let start = self.micros();
                    let outcome = self.perform(&driver.burst());
                    let outcome = outcome.as_deref().map_err(|error| *error);
                    ticks.push(driver.sample(start, outcome));
                }
            }
        }
        ticks
    }
}

#[test]
fn it_answers_once_it_has_booted_and_is_off_then() {
    let mut bus = Bus::new(ImuErrors::NONE);
    assert_eq!(bus.perform(&Transfer::read(0x0F, 1)), Err(BusError::Nak));
    bus.wait_until(BOOT);
    assert_eq!(bus.registers(0x0F, 1), [0x69]);
    assert_eq!(bus.registers(0x10, 10), [0, 0, 4, 0, 0, 0, 0, 0, 0x38, 0x38]);
    bus.wait_until(bus.now + Ticks::from_ms(100));
    assert_eq!(bus.registers(0x1E, 1), [0]);
    assert_eq!(bus.registers(0x20, 14), [0; 14]);
}

#[test]
fn words_are_those_of_the_truth_and_status_tells_new_ones() {
    let mut bus = Bus::new(ImuErrors::NONE);
    bus.wait_until(BOOT);
    bus.truth.rate_rad_s = [10.0_f64.to_radians(), 0.0, -20.0_f64.to_radians()];
    bus.perform(&Transfer::write(0x10, [0x4C, 0x48, 0x44])).unwrap();
    bus.wait_until(bus.now + Ticks::from_ms(60));
    assert_eq!(bus.registers(0x1E, 1), [0x05], "no rates yet");
    bus.wait_until(bus.now + Ticks::from_ms(40));
    assert_eq!(bus.registers(0x1E, 1), [0x07]);
    let words: Vec<_> =
        bus.registers(0x20, 14).chunks(2).map(|b| i16::from_le_bytes([b[0], b[1]])).collect();
    // 27 deg C; 10 deg/s are 285 counts of 35 mdeg/s, 9.81 m/s^2 4099 of 0.244 mg.
    assert_eq!(words[0], 32);
    assert!(words[1].abs_diff(285) <= 1 && words[2] == 0 && words[3].abs_diff(-571) <= 1);
    assert!(words[6].abs_diff(4_099) <= 1, "{words:?}");
    assert_eq!(bus.registers(0x1E, 1), [0x00]);
}

#[test]
fn a_reset_takes_its_time_and_turns_everything_off() {
    let mut bus = Bus::new(ImuErrors::NONE);
    bus.wait_until(BOOT);
    bus.perform(&Transfer::write(0x10, [0x7C, 0x78, 0x44])).unwrap();
    bus.perform(&Transfer::write(0x12, [0x45])).unwrap();
    bus.wait_until(bus.now + RESET);
    assert_eq!(bus.registers(0x10, 3), [0, 0, 4]);
}

#[test]
fn the_driver_sets_it_up_and_its_samples_are_the_truth() {
    let mut bus = Bus::new(ImuErrors::LSM6DS3);
    let mut driver = Driver::new(Config::default());
    bus.run(&mut driver, 0.3);
    assert!(driver.is_sampling());
    let scale = driver.config().scale();
    let ticks = bus.run(&mut driver, 20.0);
    let bias = bus.chip.gyro_bias_rad_s();
    let mut mean = [0.0; 3];
    for sample in &ticks {
        let sample = sample.unwrap();
        let [_, _, z] = sample.raw.acc_m_s2(&scale);
        assert!((z - 9.81).abs() < 0.15, "{z}");
        for (mean, rate) in mean.iter_mut().zip(sample.raw.gyr_rad_s(&scale)) {
            *mean += f64::from(rate) / ticks.len() as f64;
        }
    }
    assert!(ticks.len() > 3_000, "{}", ticks.len());
    for (mean, bias) in mean.iter().zip(bias) {
        // A word is cut, not rounded: half a count, 0.0003 rad/s.
        assert!((mean - bias).abs() < 0.000_7, "{mean} {bias}");
    }
    assert!(driver.self_test().is_none());
    driver.begin_self_test();
    bus.run(&mut driver, 2.0);
    assert!(driver.self_test().is_some_and(|result| result.passed()), "{:?}", driver.self_test());
}

#[test]
fn each_fault_is_noticed_and_mended() {
    for (fault, seen) in [
        (Fault::Silent, SensorFault::Nak),
        (Fault::Frozen, SensorFault::Frozen),
        (Fault::Reset, SensorFault::Reset),
    ] {
        let mut bus = Bus::new(ImuErrors::LSM6DS3);
        let mut driver = Driver::new(Config::default());
        bus.run(&mut driver, 1.0);
        bus.chip.inject(bus.now, fault);
        let mut faults = Vec::new();
        for _ in 0..200 {
            bus.run(&mut driver, 0.001);
            faults.extend(driver.fault());
        }
        assert!(faults.contains(&seen), "{fault:?}: {faults:?}");
        bus.chip.clear(bus.now, fault);
        bus.run(&mut driver, 1.0);
        assert!(bus.run(&mut driver, 1.0).iter().all(Result::is_ok), "{fault:?}");
    }
    let mut bus = Bus::new(ImuErrors::LSM6DS3);
    let mut driver = Driver::new(Config::default());
    bus.run(&mut driver, 1.0);
    let bias = bus.chip.gyro_bias_rad_s();
    bus.chip.drift(bus.now, 1.0_f64.to_radians());
    let ticks = bus.run(&mut driver, 10.0);
    let last = ticks.last().unwrap().unwrap().raw.gyr_rad_s(&driver.config().scale());
    assert!((f64::from(last[1]) - bias[1] - 10.0_f64.to_radians()).abs() < 0.01, "{last:?}");
}
