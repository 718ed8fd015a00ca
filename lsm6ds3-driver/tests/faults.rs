//! Faults while the chip samples: how they come out, and that the driver mends them.

mod fake;

use fake::{BOOT_US, Rig, TICK_US};
use lsm6ds3_driver::{BusError, Config, Imu, Micros, SensorFault};

/// The first fault of the next bursts.
fn first_fault(rig: &mut Rig, patience: usize) -> SensorFault {
    let outcomes = rig.bursts(patience);
    outcomes.iter().find_map(|outcome| outcome.err()).expect("a fault")
}

fn recovers(rig: &mut Rig) {
    rig.run_until_sampling(2_000_000);
    assert!(rig.bursts(20).iter().all(Result::is_ok));
}

#[test]
fn a_clean_hour_has_no_fault() {
    let mut rig = Rig::flying(Config::default());
    let outcomes = rig.bursts(3_600_000_000 / TICK_US as usize);
    assert!(outcomes.iter().all(Result::is_ok));
    assert_eq!(rig.driver.health().starts, 1);
    assert_eq!(rig.driver.health().mismatched, 0);
}

#[test]
fn a_lost_transfer_costs_one_sample_and_a_long_silence_a_set_up() {
    let mut rig = Rig::flying(Config::default());
    for error in [BusError::Nak, BusError::Timeout, BusError::Stuck, BusError::Arbitration] {
        rig.chip.bus = Some(error);
        assert_eq!(rig.bursts(1), [Err(error.into())]);
        rig.chip.bus = None;
        assert!(rig.bursts(20).iter().all(Result::is_ok));
    }
    assert_eq!(rig.driver.health().starts, 1);
    rig.chip.bus = Some(BusError::Nak);
    rig.run_for(100_000);
    assert!(!rig.driver.is_sampling());
    rig.chip.bus = None;
    recovers(&mut rig);
    assert_eq!(rig.driver.health().starts, 2);
}

#[test]
fn a_reset_chip_is_seen_before_its_next_sample_and_set_up_again() {
    let mut rig = Rig::flying(Config::default());
    rig.chip.power_on(0);
    while rig.driver.is_sampling() {
        assert!(rig.bursts(1).iter().all(Result::is_err));
    }
    assert_eq!(rig.driver.fault(), Some(SensorFault::Reset));
    recovers(&mut rig);
    assert_eq!(rig.driver.health().resets, 1);
}

#[test]
fn a_chip_that_boots_again_is_found() {
    let mut rig = Rig::flying(Config::default());
    rig.chip.power_on(BOOT_US);
    assert_eq!(first_fault(&mut rig, 3), SensorFault::Nak);
    rig.run_for(2 * BOOT_US);
    recovers(&mut rig);
}

#[test]
fn every_flipped_bit_of_a_control_register_ends_trust_before_the_next_burst() {
    for register in 0x10..=0x19_usize {
        for bit in 0..8 {
            let mut rig = Rig::flying(Config::default());
            rig.chip.registers[register] ^= 1 << bit;
            // This burst was made before the verification; it may be judged good.
            rig.bursts(1);
            while rig.driver.is_sampling() && rig.driver.fault().is_none() {
                rig.turn();
            }
            assert!(!rig.driver.is_sampling(), "{register:#x} bit {bit}");
            recovers(&mut rig);
        }
    }
}

#[test]
fn a_wrong_bit_in_a_verification_costs_no_sample() {
    let mut rig = Rig::flying(Config::default());
    let reads = std::cell::Cell::new(0);
    rig.chip.on_wire(move |register, bytes| {
        if register == 0x10 {
            reads.set(reads.get() + 1);
            if reads.get() % 20 == 0 {
                bytes[3] ^= 0x10;
            }
        }
    });
    assert!(rig.bursts(200).iter().all(Result::is_ok));
    assert!(rig.driver.health().mismatched >= 9);
    assert_eq!(rig.driver.health().starts, 1);
}

#[test]
fn frozen_data_are_seen_within_70_ms() {
    let mut rig = Rig::flying(Config::default());
    rig.chip.frozen = true;
    assert_eq!(first_fault(&mut rig, 70_000 / TICK_US as usize), SensorFault::Frozen);
    rig.chip.frozen = false;
    recovers(&mut rig);
}

#[test]
fn all_ones_are_a_gap_and_an_accelerometer_that_vanishes_is_torn() {
    let mut rig = Rig::flying(Config::default());
    rig.chip.on_wire(|register, bytes| {
        if register == 0x22 {
            bytes.fill(0xFF);
        }
    });
    assert_eq!(rig.bursts(1), [Err(SensorFault::AllOnes)]);
    rig.chip.on_wire(|_, _| ());
    assert!(rig.bursts(20).iter().all(Result::is_ok));
    rig.chip.on_wire(|register, bytes| {
        if register == 0x22 {
            bytes[6..].fill(0);
        }
    });
    assert_eq!(first_fault(&mut rig, 1), SensorFault::Torn);
    rig.chip.on_wire(|_, _| ());
    recovers(&mut rig);
}

/// A wrong bit of a rate is worth up to 1147 deg/s.
#[test]
fn a_spike_of_a_rate_is_held() {
    let mut rig = Rig::flying(Config::default());
    for bit in 5..8 {
        rig.chip.on_wire(move |register, bytes| {
            if register == 0x22 {
                bytes[3] ^= 1 << bit;
            }
        });
        let [Ok(sample)] = rig.bursts(1)[..] else { panic!("refused") };
        assert!(sample.gyr[1].abs() < 10, "{sample:?}");
        rig.chip.on_wire(|_, _| ());
        assert!(rig.bursts(20).iter().all(Result::is_ok));
    }
}

/// Read at 200 Hz, an output refreshed at 833 Hz is half a period old, and covers the time since
/// the sample before.
#[test]
fn rates_are_dated() {
    let mut rig = Rig::flying(Config::default());
    rig.bursts(1);
    while !matches!(rig.driver.next(Micros(rig.chip.now)), lsm6ds3_driver::Next::Sample) {
        rig.turn();
    }
    let start = rig.ticks.last().unwrap().0 + TICK_US;
    rig.chip.now = start;
    let outcome = rig.chip.perform(0x6A, &rig.driver.burst()).unwrap();
    let sample = rig.driver.sample(Micros(start), Ok(&outcome)).unwrap();
    let rates = sample.rates.unwrap();
    assert_eq!((rates.age_us, rates.elapsed_us), (600, 5_000));
    assert_eq!(sample.refresh_us, 1_200);
}

#[test]
fn rates_alone_are_completed_by_the_burst_before() {
    let mut rig = Rig::flying(Config::default());
    let whole = rig.bursts(1)[0].unwrap();
    let now = rig.chip.now;
    let outcome = rig.chip.perform(0x6A, &rig.driver.bursts().rates.unwrap()).unwrap();
    let sample = rig.driver.sample(Micros(now), Ok(&outcome)).unwrap();
    assert_eq!(sample.raw.acc, whole.acc);
    assert!(rig.driver.sample(Micros(now), Ok(&[0; 5])).is_err());
}
