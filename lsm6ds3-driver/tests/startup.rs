//! From power-on to the first sample.

mod fake;

use fake::Rig;
use lsm6ds3_driver::config::{AccRange, Address, GyrRange, Rate};
use lsm6ds3_driver::{BOOT_DEADLINE_US, BusError, Chip, Config, Imu, SensorFault, Transfer};

/// The first fault that is not the boot's, within a second.
fn fault(rig: &mut Rig) -> SensorFault {
    for _ in 0..10_000 {
        match rig.driver.fault() {
            Some(SensorFault::Booting) => rig.turn(),
            Some(fault) => return fault,
            None => break,
        }
    }
    panic!("no fault: {:?}", rig.driver.fault());
}

#[test]
fn set_up_is_exactly_this() {
    let mut rig = Rig::new(Config::default());
    rig.chip.now = fake::BOOT_US;
    rig.run_until_sampling(1_000_000);
    let set = [0x7C, 0x78, 0x44, 0, 0, 0, 0, 0, 0x38, 0x38];
    assert_eq!(
        rig.chip.log,
        [
            Transfer::write(0x01, [0]),
            Transfer::read(0x0F, 1),
            Transfer::write(0x12, [0x05]),
            Transfer::read(0x12, 1),
            Transfer::write(0x10, set),
            Transfer::read(0x10, 18),
            Transfer::read(0x22, 12),
            Transfer::read(0x22, 12),
        ]
    );
    assert_eq!(rig.driver.chip(), Some(Chip::Lsm6ds3));
    assert!(rig.driver.health().setup_us < 100_000, "{}", rig.driver.health().setup_us);
}

/// CTRL1_XL and CTRL2_G by the tables 52 to 55 of the data sheet.
#[test]
fn every_setting_reaches_the_chip() {
    let acc =
        [(AccRange::G2, 0b00), (AccRange::G4, 0b10), (AccRange::G8, 0b11), (AccRange::G16, 0b01)];
    let gyr = [
        (GyrRange::Dps125, 0b001),
        (GyrRange::Dps245, 0b000),
        (GyrRange::Dps500, 0b010),
        (GyrRange::Dps1000, 0b100),
        (GyrRange::Dps2000, 0b110),
    ];
    let rates =
        [(Rate::Hz104, 4), (Rate::Hz208, 5), (Rate::Hz416, 6), (Rate::Hz833, 7), (Rate::Hz1660, 8)];
    for (acc_range, fs_xl) in acc {
        for (gyr_range, fs_g) in gyr {
            for (rate, odr) in rates {
                let mut rig = Rig::new(Config { acc_range, gyr_range, rate, ..Config::default() });
                rig.run_until_sampling(1_000_000);
                assert_eq!(rig.chip.registers[0x10], odr << 4 | fs_xl << 2);
                assert_eq!(rig.chip.registers[0x11], odr << 4 | fs_g << 1);
            }
        }
    }
}

#[test]
fn every_chip_of_the_family_samples() {
    for (id, chip) in [(0x69, Chip::Lsm6ds3), (0x6A, Chip::Lsm6dsl), (0x6C, Chip::Lsm6dso)] {
        let mut rig = Rig::of(id, Config::default());
        rig.run_until_sampling(1_000_000);
        assert!(rig.bursts(10).iter().all(Result::is_ok));
        assert_eq!(rig.driver.chip(), Some(chip));
        assert_eq!(rig.driver.celsius(), Some(25.0));
    }
}

#[test]
fn another_chip_is_named() {
    let mut rig = Rig::of(0x68, Config::default());
    rig.run_for(BOOT_DEADLINE_US + 20_000);
    assert_eq!(rig.driver.fault(), Some(SensorFault::WrongChip { found: 0x68 }));
}

#[test]
fn a_chip_that_does_not_answer_is_no_fault_until_it_is_late() {
    let mut rig = Rig::new(Config::default());
    rig.chip.bus = Some(BusError::Nak);
    rig.run_for(BOOT_DEADLINE_US - 10_000);
    assert_eq!(rig.driver.fault(), Some(SensorFault::Booting));
    rig.run_for(20_000);
    assert_eq!(rig.driver.fault(), Some(SensorFault::Nak));
    rig.chip.bus = None;
    rig.run_until_sampling(200_000);
}

#[test]
fn a_chip_at_the_other_address_is_found_where_that_is_allowed() {
    for either_address in [false, true] {
        let mut rig = Rig::new(Config { either_address, ..Config::default() });
        rig.chip.address = Address::High.value();
        rig.run_for(500_000);
        assert_eq!(rig.driver.is_sampling(), either_address);
    }
}

#[test]
fn a_program_before_that_left_the_functions_registers_open_is_no_hindrance() {
    let mut rig = Rig::new(Config::default());
    rig.chip.registers[0x01] = 0x80;
    rig.run_until_sampling(1_000_000);
}

#[test]
fn each_register_that_does_not_hold_is_named() {
    for register in 0x10..=0x19_u8 {
        let mut rig = Rig::new(Config::default());
        rig.chip.on_wire(move |first, bytes| {
            if first == 0x10 {
                bytes[usize::from(register - 0x10)] ^= 0x02;
            }
        });
        let SensorFault::Configuration { register: found, .. } = fault(&mut rig) else {
            panic!("{register:#x}: {:?}", rig.driver.fault());
        };
        assert_eq!(found, register);
        assert_eq!(rig.driver.health().failed_setups, 1);
    }
}

#[test]
fn frozen_data_never_start_sampling() {
    let mut rig = Rig::new(Config::default());
    rig.chip.frozen = true;
    rig.run_for(3_000_000);
    assert!(!rig.driver.is_sampling());
    assert!(rig.ticks.is_empty());
}

#[test]
fn a_self_test_measures_the_stimulus() {
    let mut rig = Rig::flying(Config::default());
    rig.driver.begin_self_test();
    rig.run_until_sampling(3_000_000);
    let result = rig.driver.self_test().unwrap();
    assert!(result.passed(), "{result:?}");
    assert!(result.acc_mg.iter().all(|mg| (495..505).contains(mg)), "{result:?}");
    assert!(result.gyr_dps.iter().all(|dps| (398..403).contains(dps)), "{result:?}");
    assert!(rig.bursts(10).iter().all(Result::is_ok));

    rig.chip.is_dead = true;
    rig.driver.begin_self_test();
    rig.run_until_sampling(3_000_000);
    let result = rig.driver.self_test().unwrap();
    assert!(!result.acc && !result.gyr, "{result:?}");
}
