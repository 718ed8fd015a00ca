//! A bus error at every byte of every transfer: driver and chip agree again afterwards, and nothing
//! false came out.

mod fake;

use fake::{Chip, Rig, Spoiler};
use lsm6ds3_driver::config::{AccRange, GyrRange, Rate};
use lsm6ds3_driver::{BusError, Config, Imu};

const ERRORS: [BusError; 5] =
    [BusError::Nak, BusError::Timeout, BusError::Stuck, BusError::Arbitration, BusError::Protocol];

/// Runs `act` once clean, to learn its transfers, and then once for every byte of them and every
/// error.
fn spoil_every_byte(start: fn() -> Rig, act: fn(&mut Rig)) {
    let mut clean = start();
    let first = clean.chip.transfers;
    act(&mut clean);
    let transfers: Vec<_> = clean.chip.log[first as usize..].to_vec();
    let mut runs = 0;
    for (transfer, number) in transfers.iter().zip(first..) {
        for byte in 0..Chip::wire_len(transfer) {
            for error in ERRORS {
                let mut rig = start();
                assert_eq!(rig.chip.transfers, first, "the clean run is repeatable");
                rig.chip.spoiler = Some(Spoiler { transfer: number, byte, error });
                act(&mut rig);
                let what = format!("{transfer:?} byte {byte} {error:?}");
                assert!(rig.driver.is_sampling(), "{what}");
                assert_eq!(rig.chip.registers[0x10..0x20], clean.chip.registers[0x10..0x20]);
                let health = rig.driver.health();
                assert_eq!(
                    health.nak + health.timeout + health.stuck + health.protocol,
                    1,
                    "counted: {what}"
                );
                for (_, outcome) in &rig.ticks {
                    if let Ok(sample) = outcome {
                        assert!((4_094..4_103).contains(&sample.acc[2]), "{what}: {sample:?}");
                    }
                }
                runs += 1;
            }
        }
    }
    assert!(runs > 0);
}

/// A rig whose chip has booted, so that the transfers are the set-up's alone.
fn booted() -> Rig {
    let mut rig = Rig::new(Config::default());
    rig.chip.now = fake::BOOT_US;
    rig
}

fn sampling() -> Rig {
    let mut rig = booted();
    rig.run_until_sampling(1_000_000);
    rig
}

#[test]
fn of_the_set_up() {
    spoil_every_byte(booted, |rig| {
        rig.run_until_sampling(1_000_000);
        assert!(rig.bursts(3).iter().any(Result::is_ok));
    });
}

#[test]
fn of_bursts_and_verifications() {
    spoil_every_byte(sampling, |rig| {
        rig.bursts(10);
        rig.run_until_sampling(1_000_000);
        // One of these may be the spoilt one.
        assert!(rig.bursts(3).iter().filter(|outcome| outcome.is_ok()).count() >= 2);
    });
}

#[test]
fn of_a_self_test() {
    spoil_every_byte(sampling, |rig| {
        rig.driver.begin_self_test();
        rig.run_until_sampling(5_000_000);
        assert!(rig.driver.self_test().is_some_and(|result| result.passed()));
    });
}

#[test]
fn of_a_reconfiguration() {
    spoil_every_byte(sampling, |rig| {
        let other = Config {
            acc_range: AccRange::G16,
            gyr_range: GyrRange::Dps2000,
            rate: Rate::Hz208,
            ..Config::default()
        };
        rig.driver.reconfigure(other);
        rig.run_until_sampling(1_000_000);
        rig.driver.reconfigure(Config::default());
        rig.run_until_sampling(1_000_000);
    });
}
