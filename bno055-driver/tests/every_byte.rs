//! A bus error at every byte of every transfer: driver and chip agree again afterwards, and nothing
//! false came out.

mod fake;

use bno055_driver::config::{AxisMap, Mode};
use bno055_driver::{
    Answer, BusError, Config, Imu, Micros, Next, Profile, Request, SoftIron, SystemError,
    SystemStatus,
};
use fake::{Chip, Rig, Spoiler};

const ERRORS: [BusError; 5] =
    [BusError::Nak, BusError::Timeout, BusError::Stuck, BusError::Arbitration, BusError::Protocol];

fn config() -> Config {
    Config {
        mode: Mode::Ndof,
        axes: AxisMap::PLACEMENTS[6],
        external_crystal: true,
        profile: Some(Profile { acc_offset: [1, 2, 3], mag_radius: 480, ..Profile::default() }),
        soft_iron: Some(SoftIron([[0x4000, 7, 0], [0, 0x4000, 0], [0, 0, 0x4000]])),
        ..Config::default()
    }
}

/// Runs `act` once clean, to learn its transfers, and then once for every byte of them and every
/// error.
fn spoil_every_byte(config: Config, start: fn(Config) -> Rig, act: fn(&mut Rig)) {
    let mut clean = start(config);
    let first = clean.chip.transfers;
    act(&mut clean);
    let transfers: Vec<_> = clean.chip.log[first as usize..].to_vec();
    let mut runs = 0;
    for (transfer, number) in transfers.iter().zip(first..) {
        for byte in 0..Chip::wire_len(transfer) {
            for error in ERRORS {
                let mut rig = start(config);
                assert_eq!(rig.chip.transfers, first, "the clean run is repeatable");
                rig.chip.spoiler = Some(Spoiler { transfer: number, byte, error });
                act(&mut rig);
                let what = format!("{transfer:?} byte {byte} {error:?}");
                assert!(rig.driver.is_sampling(), "{what}");
                assert!(rig.chip.holds(&config), "{what}");
                let health = rig.driver.health();
                assert_eq!(
                    health.nak + health.timeout + health.stuck + health.protocol,
                    1,
                    "counted: {what}"
                );
                for (_, outcome) in &rig.ticks {
                    if let Ok(sample) = outcome {
                        assert!((970..990).contains(&sample.acc[2]), "{what}: {sample:?}");
                    }
                }
                runs += 1;
            }
        }
    }
    assert!(runs > 0);
}

/// A rig whose chip has booted, so that the transfers are the set-up's alone.
fn booted(config: Config) -> Rig {
    let mut rig = Rig::new(config);
    rig.chip.now = fake::BOOT_US;
    rig
}

#[test]
fn of_the_set_up() {
    for config in [Config::default(), config()] {
        spoil_every_byte(config, booted, |rig| {
            rig.run_until_sampling(2_000_000);
            assert!(rig.bursts(3).iter().any(Result::is_ok));
        });
    }
}

fn sampling(config: Config) -> Rig {
    let mut rig = booted(config);
    rig.run_until_sampling(2_000_000);
    rig
}

#[test]
fn of_bursts_and_verifications() {
    spoil_every_byte(Config::default(), sampling, |rig| {
        rig.bursts(10);
        rig.run_until_sampling(2_000_000);
        // One of these may be the spoilt one.
        assert!(rig.bursts(3).iter().filter(|outcome| outcome.is_ok()).count() >= 2);
    });
}

#[test]
fn of_a_temperature_and_a_system_status() {
    spoil_every_byte(Config::default(), sampling, |rig| {
        rig.driver.request(Request::SystemStatus);
        rig.bursts(3);
        let running = Answer::SystemStatus(SystemStatus::NoFusion, SystemError::None);
        assert_eq!(rig.driver.answer(), Some(running));
        rig.driver.request(Request::Temperature);
        rig.bursts(3);
        assert_eq!(rig.driver.answer(), Some(Answer::Temperature(25)));
    });
}

#[test]
fn of_a_profile_and_a_self_test() {
    spoil_every_byte(config(), sampling, |rig| {
        let profile = config().profile.unwrap();
        rig.driver.request(Request::Profile);
        rig.run_until_sampling(2_000_000);
        assert_eq!(rig.driver.answer(), Some(Answer::Profile(profile)));
        rig.driver.request(Request::SelfTest);
        rig.run_until_sampling(3_000_000);
        assert!(matches!(rig.driver.answer(), Some(Answer::SelfTest(result)) if result.passed()));
    });
}

#[test]
fn of_suspend_and_resume() {
    spoil_every_byte(Config::default(), sampling, |rig| {
        rig.driver.suspend();
        rig.run_for(200_000);
        assert_eq!(rig.chip.pages[0][0x3E], 2);
        rig.driver.resume();
        rig.run_until_sampling(1_000_000);
    });
}

#[test]
fn of_a_calibration_status_and_a_soft_iron_matrix() {
    spoil_every_byte(config(), sampling, |rig| {
        rig.chip.pages[0][0x35] = 0b11_10_01_00;
        rig.driver.request(Request::CalibrationStatus);
        rig.bursts(3);
        let answer = rig.driver.answer();
        assert!(matches!(answer, Some(Answer::CalibrationStatus(status)) if status.gyr == 2));
        let matrix = config().soft_iron.unwrap();
        rig.driver.request(Request::SoftIron);
        rig.run_until_sampling(2_000_000);
        assert_eq!(rig.driver.answer(), Some(Answer::SoftIron(matrix)));
    });
}

/// To another mode, axis map and profile, and back.
#[test]
fn of_reconfigurations() {
    spoil_every_byte(Config::default(), sampling, |rig| {
        rig.driver.reconfigure(config());
        rig.run_until_sampling(2_000_000);
        assert!(rig.chip.holds(&config()));
        rig.driver.reconfigure(Config::default());
        rig.run_until_sampling(2_000_000);
    });
}

#[test]
fn of_fusion_outputs() {
    spoil_every_byte(config(), sampling, |rig| {
        for _ in 0..10 {
            let (start, burst) = (rig.chip.now, rig.driver.fusion_burst());
            let outcome = rig.chip.perform(&burst);
            let fusion =
                rig.driver.fusion(Micros(start), outcome.as_deref().map_err(|error| *error));
            if let Ok(fusion) = fusion {
                assert_eq!(fusion.quaternion(), [1.0, 0.0, 0.0, 0.0]);
            }
            while matches!(rig.driver.next(Micros(rig.chip.now)), Next::Transfer(_)) {
                rig.turn();
            }
        }
    });
}
