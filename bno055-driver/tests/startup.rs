//! From power-on to sampling: what goes over the bus, and what the driver says when the chip is not
//! as it should be.

mod fake;

use std::num::NonZeroU8;

use bno055_driver::config::{
    AccRange, Address, Axis, AxisMap, Mode, ResetPolicy, Sensors, Signed, Units,
};
use bno055_driver::{
    BOOT_DEADLINE_US, BusError, Bytes, Config, Driver, Imu, Micros, Next, Profile, SensorFault,
    SoftIron, SystemError, Transfer, registers,
};
use fake::{BOOT_US, Rig};

const PROFILE: Profile = Profile {
    acc_offset: [-24, 13, 5],
    mag_offset: [-301, 640, 77],
    gyr_offset: [-1, 0, 2],
    acc_radius: 1000,
    mag_radius: 712,
};

fn read(register: u8, len: u8) -> Transfer {
    Transfer::Read { register, len }
}

fn write<const N: usize>(register: u8, bytes: [u8; N]) -> Transfer {
    Transfer::Write { register, bytes: Bytes::new(bytes) }
}

/// The transfers of a set-up, without the calls that nobody answered.
fn answered(rig: &Rig) -> Vec<Transfer> {
    let call = write(0x07, [0]);
    let calls = rig.chip.log.iter().take_while(|transfer| **transfer == call).count();
    rig.chip.log[calls - 1..].to_vec()
}

#[test]
fn set_up_is_exactly_this() {
    let rig = Rig::sampling(Config::default());
    let mut log = answered(&rig);
    let bursts = log.iter().rev().take_while(|transfer| **transfer == read(0x08, 18)).count();
    assert!(bursts >= 2, "two fresh bursts before sampling");
    log.truncate(log.len() - bursts);
    assert_eq!(
        log,
        [
            write(0x07, [0]),
            read(0x00, 8),
            write(0x3D, [0]),
            read(0x3D, 1),
            read(0x36, 5),
            write(0x3E, [0]),
            read(0x3E, 1),
            write(0x3B, [0]),
            read(0x3B, 1),
            write(0x41, [0x24, 0x00]),
            read(0x41, 2),
            write(0x07, [1]),
            read(0x07, 1),
            // 8 g / 62.5 Hz, 30 Hz regular, 2000 deg/s / 116 Hz, all normal.
            write(0x08, [0x0E, 0x0F, 0x10, 0x00]),
            read(0x08, 4),
            read(0x50, 16),
            write(0x07, [0]),
            read(0x07, 1),
            write(0x3D, [7]),
            read(0x3D, 1),
            read(0x39, 2),
        ]
    );
    assert!(rig.chip.holds(rig.driver.config()));
    assert_eq!(rig.driver.fault(), None);
    assert_eq!(rig.driver.identity().software, 0x0311);
    assert_eq!(rig.driver.identity().bootloader, 0x15);
    assert_eq!(rig.driver.identity().unique_id[..3], [0xB0, 0xB1, 0xB2]);
}

#[test]
fn every_setting_reaches_the_chip() {
    let config = Config {
        mode: Mode::Ndof,
        sensors: Sensors { acc_range: AccRange::G4, ..Sensors::default() },
        units: Units { acc: bno055_driver::config::AccUnit::MilliG, ..Units::default() },
        axes: AxisMap::new(Signed::plus(Axis::Y), Signed::minus(Axis::X), Signed::plus(Axis::Z))
            .unwrap(),
        power: bno055_driver::config::Power::Low,
        external_crystal: true,
        profile: Some(PROFILE),
        soft_iron: Some(SoftIron([[0x4000, 1, 2], [3, 0x4100, 4], [5, 6, 0x3F00]])),
        ..Config::default()
    };
    let rig = Rig::sampling(config);
    assert!(rig.chip.holds(&config));
    let log = answered(&rig);
    let clock = log.iter().position(|transfer| *transfer == write(0x3F, [0x80])).unwrap();
    assert_eq!(log[clock - 1], read(0x38, 1), "clock free to be changed");
    assert_eq!(log[clock + 1], read(0x38, 1), "clock settled");
    assert!(log[clock + 2..].contains(&write(0x3D, [0x0C])));
}

/// Every setting that there is, each written and read back.
#[test]
fn a_set_up_with_everything_is_exactly_this() {
    let matrix = SoftIron([[0x4000, 1, 2], [3, 0x4100, 4], [5, 6, 0x3F00]]);
    let config = Config {
        mode: Mode::Ndof,
        power: bno055_driver::config::Power::Low,
        axes: AxisMap::PLACEMENTS[0],
        external_crystal: true,
        profile: Some(PROFILE),
        soft_iron: Some(matrix),
        ..Config::default()
    };
    let rig = Rig::sampling(config);
    // The clock and the fresh bursts are waited for.
    let mut log = answered(&rig);
    log.dedup();
    let [map, sign] = config.axes.registers();
    assert_eq!(
        log,
        [
            write(0x07, [0]),
            read(0x00, 8),
            write(0x3D, [0]),
            read(0x3D, 1),
            read(0x36, 5),
            write(0x3E, [1]),
            read(0x3E, 1),
            write(0x3B, [0]),
            read(0x3B, 1),
            write(0x41, [map, sign]),
            read(0x41, 2),
            write(0x43, matrix.registers()),
            read(0x43, 18),
            write(0x55, PROFILE.registers()),
            read(0x55, 22),
            write(0x07, [1]),
            read(0x07, 1),
            write(0x08, [0x0E, 0x0F, 0x10, 0x00]),
            read(0x08, 4),
            read(0x50, 16),
            write(0x07, [0]),
            read(0x07, 1),
            read(0x38, 1),
            write(0x3F, [0x80]),
            read(0x38, 1),
            write(0x3D, [0x0C]),
            read(0x3D, 1),
            read(0x39, 2),
            read(0x08, 18),
        ]
    );
}

#[test]
fn a_chip_that_boots_slowly_is_no_fault_until_it_is_late() {
    let mut driver = Driver::new(Config::default());
    let mut now = Micros(0);
    let mut calls = 0;
    while now.0 < BOOT_DEADLINE_US {
        match driver.next(now) {
            Next::Transfer(transfer) => {
                assert_eq!(transfer, write(0x07, [0]));
                calls += 1;
                assert_eq!(driver.fault(), Some(SensorFault::Booting), "at {now:?}");
                driver.complete(now.after(200), Err(BusError::Nak));
            }
            Next::Wait(until) => now = until,
            Next::Sample => unreachable!("nobody is there"),
        }
    }
    assert_eq!(calls, 92, "polled every 20 ms");
    let Next::Transfer(_) = driver.next(now) else { panic!("goes on trying") };
    driver.complete(now, Err(BusError::Nak));
    assert_eq!(driver.fault(), Some(SensorFault::Nak));
    assert!(!driver.is_sampling());
}

#[test]
fn wrong_identity_is_retried_and_then_named() {
    let mut rig = Rig::new(Config::default());
    rig.chip.on_wire(|register, bytes| {
        if register == 0 {
            bytes[0] = 0x55;
        }
    });
    rig.run_for(BOOT_DEADLINE_US - 100_000);
    assert_eq!(rig.driver.fault(), Some(SensorFault::Booting));
    rig.run_for(200_000);
    assert_eq!(rig.driver.fault(), Some(SensorFault::WrongChip { found: 0x55 }));
    rig.chip.wire = None;
    rig.run_until_sampling(200_000);
}

#[test]
fn a_dead_gyroscope_is_named() {
    let mut rig = Rig::new(Config::default());
    rig.chip.pages[0][3] = 0;
    rig.run_for(BOOT_DEADLINE_US + 100_000);
    assert_eq!(rig.driver.fault(), Some(SensorFault::DeadSensor { sensor: 3, found: 0 }));
    assert_eq!(rig.driver.fault().unwrap().to_string(), "IMU gyroscope dead: id 0x00");
}

#[test]
fn self_test_and_system_error_are_named() {
    let mut rig = Rig::new(Config::default());
    rig.chip.pages[0][0x36] = 0x0B;
    rig.run_for(BOOT_US + 200_000);
    assert_eq!(rig.driver.fault(), Some(SensorFault::SelfTest { result: 0x0B }));
    rig.chip.pages[0][0x36] = 0x0F;
    rig.chip.pages[0][0x39..0x3B].copy_from_slice(&[1, 9]);
    rig.run_for(1_000_000);
    assert_eq!(rig.driver.fault(), Some(SensorFault::System { error: SystemError::Fusion.code() }));
    rig.chip.pages[0][0x39] = 0;
    rig.run_until_sampling(1_000_000);
}

#[test]
fn each_register_that_does_not_hold_is_named() {
    // The register, and the block in which it is read back.
    for (register, block, len) in [
        (0x3E, 0x3E, 1),
        (0x3B, 0x3B, 1),
        (0x41, 0x41, 2),
        (0x42, 0x41, 2),
        (0x43, 0x43, 18),
        (0x55, 0x55, 22),
        (0x08, 0x08, 4),
        (0x09, 0x08, 4),
        (0x0A, 0x08, 4),
        (0x0B, 0x08, 4),
    ] {
        let mut rig = Rig::new(Config {
            profile: Some(PROFILE),
            soft_iron: Some(SoftIron::IDENTITY),
            ..Config::default()
        });
        // The wire inverts the low bit of that register; the data burst starts at 8, too, but is
        // longer.
        rig.chip.on_wire(move |at, bytes| {
            if at == block && bytes.len() == len {
                bytes[usize::from(register - block)] ^= 1;
            }
        });
        rig.run_for(BOOT_US + 200_000);
        let Some(SensorFault::Configuration { register: named, .. }) = rig.driver.fault() else {
            panic!("register {register:#x}: {:?}", rig.driver.fault());
        };
        assert_eq!(named, register);
        assert!(!rig.driver.is_sampling());
        rig.chip.wire = None;
        rig.run_until_sampling(1_000_000);
        assert!(rig.chip.holds(rig.driver.config()));
    }
}

#[test]
fn a_profile_out_of_range_is_never_written() {
    let profile = Profile { mag_offset: [0, 0, 0x218C], ..PROFILE };
    let mut rig =
        Rig::new(Config { mode: Mode::Ndof, profile: Some(profile), ..Config::default() });
    rig.run_for(BOOT_US + 200_000);
    assert_eq!(rig.driver.fault(), Some(SensorFault::Profile { register: 0x5F }));
    assert!(
        rig.chip
            .log
            .iter()
            .all(|transfer| !matches!(transfer, Transfer::Write { register: 0x55, .. }))
    );
}

#[test]
fn a_crystal_that_does_not_start_is_named() {
    let mut rig = Rig::new(Config { external_crystal: true, ..Config::default() });
    rig.chip.crystal = false;
    rig.run_for(BOOT_US + 1_500_000);
    assert_eq!(rig.driver.fault(), Some(SensorFault::Clock));
}

#[test]
fn failures_of_an_answering_chip_are_retried_at_a_slowing_pace() {
    let mut rig = Rig::new(Config::default());
    rig.chip.pages[0][0x36] = 0;
    rig.run_for(BOOT_US + 10_000_000);
    let failed = rig.driver.health().failed_setups;
    // 50, 100, 200, 400 and then 800 ms apart, and 25 ms for each attempt.
    assert!((13..=18).contains(&failed), "{failed}");
}

#[test]
fn the_chip_is_never_reset_unless_allowed() {
    let reset = write(0x3F, [0x20]);
    let mut rig = Rig::new(Config::default());
    rig.chip.pages[0][0x36] = 0;
    rig.run_for(BOOT_US + 10_000_000);
    assert!(!rig.chip.log.contains(&reset));

    let limit = NonZeroU8::new(3).unwrap();
    let mut rig =
        Rig::new(Config { reset: ResetPolicy::AfterFailures(limit), ..Config::default() });
    rig.chip.pages[0][0x36] = 0;
    rig.run_for(BOOT_US + 500_000);
    assert_eq!(rig.chip.log.iter().filter(|transfer| **transfer == reset).count(), 1);
    rig.run_until_sampling(1_000_000);
    assert!(rig.chip.holds(rig.driver.config()), "the reset mended it");
}

#[test]
fn stuck_zero_or_frozen_data_never_start_sampling() {
    let mut rig = Rig::new(Config::default());
    rig.chip.frozen = true;
    rig.run_for(BOOT_US + 1_500_000);
    assert_eq!(rig.driver.fault(), Some(SensorFault::AllZero), "outputs stay zero");

    let mut rig = Rig::sampling(Config::default());
    rig.chip.frozen = true;
    // Until the refresh is known, a slow one is allowed for.
    let outcomes = rig.bursts(65);
    assert!(outcomes.contains(&Err(SensorFault::Frozen)));
    rig.run_for(3_000_000);
    assert!(!rig.driver.is_sampling());
    rig.chip.frozen = false;
    rig.run_until_sampling(2_000_000);
}

#[test]
fn suspend_and_resume() {
    let mut rig = Rig::sampling(Config::default());
    rig.driver.suspend();
    rig.run_for(200_000);
    assert_eq!(rig.driver.fault(), Some(SensorFault::Suspended));
    assert_eq!(rig.driver.next(Micros(rig.chip.now)), Next::Wait(Micros(u64::MAX)));
    assert_eq!((rig.chip.mode(), rig.chip.pages[0][0x3E]), (0, 2));
    rig.driver.resume();
    rig.run_until_sampling(300_000);
    assert!(rig.chip.holds(rig.driver.config()));
}

#[test]
fn reconfigure_changes_everything() {
    let mut rig = Rig::sampling(Config::default());
    let config = Config { mode: Mode::Imu, axes: AxisMap::PLACEMENTS[0], ..Config::default() };
    rig.driver.reconfigure(config);
    rig.run_until_sampling(300_000);
    // The chip chooses the sensors' settings in fusion modes: the driver leaves them as written.
    assert!(rig.chip.holds(&config));
    assert_eq!(rig.driver.burst(), read(0x08, 18));
}

#[test]
fn a_warm_chip_samples_within_120_ms() {
    let mut rig = Rig::sampling(Config::default());
    let restart = rig.chip.now;
    rig.driver = Driver::new(Config::default());
    rig.run_until_sampling(1_000_000);
    assert!(rig.chip.now - restart < 120_000, "{} us", rig.chip.now - restart);
}

/// Both addresses are tried in turn until a chip answers, where the configuration allows it.
#[test]
fn a_chip_at_the_other_address_is_found_where_that_is_allowed() {
    for either_address in [true, false] {
        let mut rig = Rig::new(Config { either_address, ..Config::default() });
        let mut tried = Vec::new();
        while rig.chip.now < 100_000 {
            rig.turn();
            tried.push(rig.driver.config().address);
        }
        let other = tried.contains(&Address::High);
        assert_eq!((other, tried.contains(&Address::Low)), (either_address, true));
        rig.run_until_sampling(2_000_000);
        let found = rig.driver.config().address;
        rig.run_for(100_000);
        assert_eq!(rig.driver.config().address, found, "it stays");
    }
}

/// A register that still reads as before is read again for some time before the set-up is given up.
#[test]
fn a_register_that_reads_back_late_is_waited_for() {
    use std::cell::Cell;
    for (late_reads, set_up_anew) in [(3, false), (1000, true)] {
        let mut rig = Rig::new(Config::default());
        let left = Cell::new(late_reads);
        rig.chip.on_wire(move |register, bytes| {
            if register == registers::UNIT_SEL && left.get() > 0 {
                left.set(left.get() - 1);
                bytes[0] ^= 0x80;
            }
        });
        rig.run_for(1_500_000);
        let failed = rig.driver.health().failed_setups > 0;
        assert_eq!((failed, rig.driver.is_sampling()), (set_up_anew, !set_up_anew));
    }
}

/// Without its magnetometer the chip is of use to whoever needs no heading.
#[test]
fn a_dead_magnetometer_is_a_fault_only_where_it_is_needed() {
    for needs_mag in [true, false] {
        let mut rig = Rig::new(Config { needs_mag, ..Config::default() });
        rig.chip.on_wire(|register, bytes| match register {
            registers::CHIP_ID => bytes[usize::from(registers::MAG_ID)] = 0xFF,
            registers::ST_RESULT => bytes[0] = 0x0D,
            registers::ACC_DATA if bytes.len() == 18 => bytes[6..12].fill(0),
            _ => {}
        });
        rig.run_for(1_500_000);
        assert_eq!(rig.driver.is_sampling(), !needs_mag);
        if !needs_mag {
            let samples = rig.bursts(100);
            assert!(samples.iter().all(|s| s.is_ok_and(|s| s.mag == [0; 3])));
        }
    }
}
