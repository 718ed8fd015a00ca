//! Faults of the field while sampling: how soon each is seen, and that the driver recovers. What
//! comes out of wrong data is for `wrong_data.rs`.

mod fake;

use bno055_driver::config::{AxisMap, Mode, Units};
use bno055_driver::{
    BusError, Config, GLITCH_US, Imu, Micros, Next, SensorFault, TRANSFER_DEADLINE_US, Transfer,
};
use fake::{Chip, Rig, TICK_US, flying};

/// Bursts until the first fault, how long that took, and the fault.
fn first_fault(rig: &mut Rig, patience: usize) -> (usize, u64, SensorFault) {
    let (from, start) = (rig.ticks.len(), rig.chip.now);
    for _ in 0..100 * patience {
        rig.turn();
        if let Some(index) = rig.ticks[from..].iter().position(|(_, outcome)| outcome.is_err()) {
            return (index + 1, rig.chip.now - start, rig.ticks[from + index].1.unwrap_err());
        }
        if let Some(fault) = rig.driver.fault() {
            return (rig.ticks.len() - from, rig.chip.now - start, fault);
        }
    }
    panic!("no fault in {patience} bursts");
}

/// Time for the driver to notice, and then to set the chip up.
fn recovers(rig: &mut Rig) {
    rig.run_for(100_000);
    rig.run_until_sampling(2_500_000);
    assert!(rig.chip.holds(rig.driver.config()));
    assert!(rig.bursts(100).iter().all(Result::is_ok));
    assert_eq!(rig.driver.fault(), None);
}

/// Spoils the chip. Expects its first fault within `bursts_max` bursts and `us_max`, the same fault
/// and no sampling as long as the chip is spoilt, and recovery once it is mended.
fn seen_until_mended(
    spoil: impl Fn(&mut Chip),
    fault: SensorFault,
    bursts_max: usize,
    us_max: u64,
) {
    let mut rig = flying(Config::default());
    spoil(&mut rig.chip);
    let (bursts, us, found) = first_fault(&mut rig, 5);
    assert_eq!(found, fault);
    assert!(bursts <= bursts_max && us <= us_max, "{fault}: {bursts} {us}");
    rig.run_for(1_000_000);
    assert!(!rig.driver.is_sampling());
    assert_eq!(rig.driver.fault(), Some(fault));
    (rig.chip.bus, rig.chip.wire) = (None, None);
    recovers(&mut rig);
}

#[test]
fn unplugged_is_seen_at_the_first_burst() {
    seen_until_mended(|chip| chip.bus = Some(BusError::Nak), SensorFault::Nak, 1, 2 * TICK_US);
}

#[test]
fn one_lost_transfer_costs_one_sample() {
    let mut rig = flying(Config::default());
    rig.chip.bus = Some(BusError::Nak);
    assert_eq!(rig.bursts(1), [Err(SensorFault::Nak)]);
    rig.chip.bus = None;
    assert!(rig.bursts(50).iter().all(Result::is_ok));
    assert_eq!(rig.driver.health().starts, 1);
}

/// A cable that is silent for less than [`GLITCH_US`] does not cost a set-up, whatever it shows. A
/// longer silence does.
#[test]
fn a_short_silence_is_ridden_out_and_a_long_one_is_not() {
    type Silence = fn(&mut Chip);
    let silences: [(&str, Silence); 4] = [
        ("no acknowledge", |chip| chip.bus = Some(BusError::Nak)),
        ("line held", |chip| chip.bus = Some(BusError::Stuck)),
        ("noise", |chip| chip.bus = Some(BusError::Arbitration)),
        ("all ones", |chip| chip.on_wire(|_, bytes| bytes.fill(0xFF))),
    ];
    for (name, silence) in silences {
        for (silent_us, starts) in [(40_000, 1), (GLITCH_US + 40_000, 2)] {
            let mut rig = flying(Config::default());
            silence(&mut rig.chip);
            rig.run_for(silent_us);
            (rig.chip.bus, rig.chip.wire) = (None, None);
            recovers(&mut rig);
            assert_eq!(rig.driver.health().starts, starts, "{name}, {silent_us} us");
        }
    }
}

/// A chip that has reset behind a short silence has lost its settings: it shows zeros, and is set
/// up anew.
#[test]
fn a_reset_behind_a_short_silence_is_not_ridden_out() {
    let mut rig = flying(Config::default());
    rig.chip.bus = Some(BusError::Nak);
    rig.run_for(20_000);
    rig.chip.bus = None;
    rig.chip.power_on(0);
    recovers(&mut rig);
    assert_eq!(rig.driver.health().starts, 2);
}

#[test]
fn a_stuck_bus_is_seen_at_the_masters_deadline() {
    for (error, fault) in
        [(BusError::Stuck, SensorFault::Stuck), (BusError::Timeout, SensorFault::Timeout)]
    {
        let deadline_us = TICK_US + TRANSFER_DEADLINE_US;
        seen_until_mended(|chip| chip.bus = Some(error), fault, 1, deadline_us);
    }
}

#[test]
fn all_ones_are_seen_at_the_first_burst() {
    seen_until_mended(
        |chip| chip.on_wire(|_, bytes| bytes.fill(0xFF)),
        SensorFault::AllOnes,
        1,
        2 * TICK_US,
    );
}

#[test]
fn a_reset_chip_is_seen_and_set_up_again() {
    // Whatever its boot time: none, shorter than a tick, or the usual.
    for boot_us in [0, 5_000, 650_000] {
        let config = Config { axes: AxisMap::PLACEMENTS[3], ..Config::default() };
        let mut rig = flying(config);
        rig.chip.power_on(boot_us);
        let (bursts, us, fault) = first_fault(&mut rig, 5);
        assert!(bursts <= 2 && us <= 2 * TICK_US, "{bursts} {us}");
        assert_eq!(
            fault,
            if boot_us == 0 { SensorFault::AllZero } else { SensorFault::Nak },
            "{boot_us}"
        );
        recovers(&mut rig);
        assert_eq!(rig.driver.health().starts, 2);
    }
}

#[test]
fn a_chip_found_in_config_reports_reset_until_it_samples_again() {
    let mut rig = flying(Config::default());
    rig.chip
        .perform(&Transfer::Write { register: 0x3D, bytes: bno055_driver::Bytes::new([0]) })
        .unwrap();
    rig.chip.now += 19_000;
    let (bursts, _, fault) = first_fault(&mut rig, 5);
    assert!(bursts <= 2);
    assert_eq!(fault, SensorFault::AllZero);
    for _ in 0..8 {
        rig.turn();
    }
    assert!(!rig.driver.is_sampling());
    while !rig.driver.is_sampling() {
        assert_eq!(rig.driver.fault(), Some(SensorFault::Reset));
        rig.turn();
    }
    assert_eq!(rig.driver.health().resets, 1);
    recovers(&mut rig);
}

/// As with a grounded BL_IND pin: the mode is kept, and the chip has an error of its own to tell.
#[test]
fn zeros_with_an_error_are_seen_at_once_and_the_error_once_it_is_read() {
    let mut rig = flying(Config::default());
    rig.chip.on_wire(|register, bytes| match (register, bytes.len()) {
        (0x08, 18) => bytes.fill(0),
        (0x36, 5) => bytes[3..].copy_from_slice(&[1, 1]),
        (0x39, 2) => bytes.copy_from_slice(&[1, 1]),
        _ => {}
    });
    let (bursts, us, fault) = first_fault(&mut rig, 5);
    assert!(bursts <= 2 && us <= 2 * TICK_US, "{bursts} {us}");
    assert_eq!(fault, SensorFault::AllZero);
    rig.run_for(500_000);
    let error = bno055_driver::SystemError::Peripherals.code();
    assert_eq!(rig.driver.fault(), Some(SensorFault::System { error }));
    rig.chip.wire = None;
    recovers(&mut rig);
}

/// A data line that is held low reads as zeros, too: bursts of zeros are a reset only if the mode
/// says so, or if they do not end.
#[test]
fn zeros_are_a_reset_when_the_mode_says_so_or_when_they_do_not_end() {
    let mut rig = flying(Config::default());
    let zeros = |rig: &mut Rig| rig.driver.sample(Micros(rig.chip.now), Ok(&[0; 18]));
    for _ in 0..2 {
        assert_eq!(zeros(&mut rig), Err(SensorFault::AllZero));
        assert!(rig.driver.is_sampling());
    }
    assert_eq!(zeros(&mut rig), Err(SensorFault::Reset));
    assert!(!rig.driver.is_sampling());

    let mut rig = flying(Config::default());
    assert_eq!(zeros(&mut rig), Err(SensorFault::AllZero));
    for _ in 0..2 {
        let Next::Transfer(read) = rig.driver.next(Micros(rig.chip.now)) else {
            panic!("the mode is to be read")
        };
        let mode = Transfer::Read { register: 0x3D, len: 1 };
        assert_eq!(read, mode);
        assert!(rig.driver.is_sampling());
        rig.driver.complete(Micros(rig.chip.now), Ok(&[0]));
    }
    assert_eq!(rig.driver.fault(), Some(SensorFault::Reset));
    assert!(!rig.driver.is_sampling());
}

/// Zeros around a register that lost its setting are a reset. Zeros among other bad samples are no
/// reset.
#[test]
fn zeros_are_a_reset_beside_a_wrong_register_and_not_beside_noise() {
    let zeros = |rig: &mut Rig| rig.driver.sample(Micros(rig.chip.now), Ok(&[0; 18]));
    let mut rig = flying(Config::default());
    assert_eq!(zeros(&mut rig), Err(SensorFault::AllZero));
    let Next::Transfer(_) = rig.driver.next(Micros(rig.chip.now)) else {
        panic!("the mode is to be read")
    };
    rig.driver.complete(Micros(rig.chip.now), Ok(&[0]));
    assert_eq!(zeros(&mut rig), Err(SensorFault::Reset));

    let mut rig = flying(Config::default());
    for _ in 0..2 {
        let burst = rig.driver.burst();
        let mut bytes = rig.chip.perform(&burst).unwrap();
        // The highest bit of a rate.
        bytes[17] ^= 0x80;
        let flipped = rig.driver.sample(Micros(rig.chip.now), Ok(&bytes));
        assert_eq!(flipped, Err(SensorFault::Implausible));
        assert!(rig.bursts(2).iter().all(Result::is_ok));
    }
    assert_eq!(zeros(&mut rig), Err(SensorFault::Unreliable));
}

#[test]
fn frozen_data_are_seen_within_70_ms() {
    let mut rig = flying(Config::default());
    // Until the refresh is known, a slow one is allowed for.
    rig.bursts(100);
    rig.chip.frozen = true;
    let outcomes = rig.bursts(8);
    let (last, before) = outcomes.split_last().unwrap();
    assert!(before.iter().all(Result::is_ok), "{outcomes:?}");
    assert_eq!(*last, Err(SensorFault::Frozen));
    rig.chip.frozen = false;
    recovers(&mut rig);
}

#[test]
fn a_dead_gyroscope_is_frozen_although_the_others_move() {
    let mut rig = flying(Config::default());
    rig.chip.gyro_dead = true;
    let (bursts, _, fault) = first_fault(&mut rig, 40);
    assert_eq!(fault, SensorFault::Frozen);
    assert!(bursts <= 21, "{bursts}");
}

/// A register of a chip in its mode reads another value than was written.
fn changed(config: Config, register: usize, value: u8) -> SensorFault {
    let faults: Vec<SensorFault> = (0..8)
        .map(|phase| {
            let mut rig = flying(config);
            rig.bursts(phase);
            rig.chip.pages[0][register] = value;
            let (_, us, fault) = first_fault(&mut rig, 40);
            assert!(us <= 100_000, "{us} us");
            recovers(&mut rig);
            fault
        })
        .collect();
    assert!(faults.iter().all(|fault| *fault == faults[0]), "{faults:?}");
    faults[0]
}

/// The chip has quietly reset.
#[test]
fn a_register_with_its_reset_value_is_seen_within_100_ms() {
    let config = Config { axes: AxisMap::PLACEMENTS[0], ..Config::default() };
    assert_eq!(changed(config, 0x41, 0x24), SensorFault::Reset);
    assert_eq!(changed(config, 0x42, 0x00), SensorFault::Reset);
    assert_eq!(changed(Config::default(), 0x3B, 0x80), SensorFault::Reset);
}

#[test]
fn a_register_with_another_value_is_seen_within_100_ms() {
    let units = Units { gyr: bno055_driver::config::GyrUnit::RadianPerSecond, ..Units::default() };
    let fault = changed(Config { units, ..Config::default() }, 0x3B, 0x00);
    assert_eq!(fault, SensorFault::Configuration { register: 0x3B, found: 0x00 });
}

#[test]
fn a_system_error_while_sampling_is_seen() {
    let mut rig = flying(Config::default());
    rig.chip.pages[0][0x39..0x3B].copy_from_slice(&[1, 2]);
    let (_, us, fault) = first_fault(&mut rig, 40);
    assert!(us <= 100_000, "{us}");
    assert_eq!(fault.to_string(), "IMU error: 0x02");
    assert_eq!(fault.code(), 0x0A02);
    rig.chip.pages[0][0x39] = 0;
    recovers(&mut rig);
}

#[test]
fn a_wrong_bit_in_a_verification_withholds_no_more_than_a_sample() {
    let mut rig = flying(Config::default());
    let from = rig.ticks.len();
    rig.chip.on_wire(|register, bytes| bytes[0] ^= u8::from(register == 0x3B));
    let mismatched = |rig: &Rig| rig.driver.health().mismatched;
    while mismatched(&rig) == 0 {
        rig.turn();
    }
    rig.chip.wire = None;
    rig.bursts(20);
    assert_eq!(mismatched(&rig), 1);
    assert_eq!(rig.driver.health().starts, 1, "no set-up for a wrong bit");
    assert!(rig.ticks[from..].iter().filter(|(_, outcome)| outcome.is_err()).count() <= 1);
}

#[test]
fn samples_are_withheld_while_a_register_is_in_doubt() {
    let mut rig = flying(Config::default());
    rig.chip.pages[0][0x3B] = 0x02;
    while rig.driver.health().mismatched == 0 {
        rig.turn();
    }
    let bytes = rig.chip.burst_with(|_| ());
    assert_eq!(
        rig.driver.sample(Micros(rig.chip.now), Ok(&bytes)),
        Err(SensorFault::RegisterMismatch)
    );
    assert_eq!(rig.driver.health().withheld, 1);
    while rig.driver.is_sampling() {
        rig.turn();
    }
    let fault = SensorFault::Configuration { register: 0x3B, found: 2 };
    assert_eq!(rig.driver.fault(), Some(fault), "read again, it is told");
}

#[test]
fn a_verification_under_way_when_a_burst_fails_is_ignored() {
    let mut rig = flying(Config::default());
    rig.bursts(1);
    let Next::Transfer(_) = rig.driver.next(Micros(rig.chip.now)) else {
        panic!("a verification is due")
    };
    while rig.driver.is_sampling() {
        assert!(rig.driver.sample(Micros(rig.chip.now), Ok(&[0; 18])).is_err());
    }
    rig.driver.complete(Micros(rig.chip.now), Ok(&[7]));
    assert_eq!(rig.driver.sample(Micros(rig.chip.now), Ok(&[1; 18])), Err(SensorFault::Reset));
    recovers(&mut rig);
}

#[test]
fn missed_ticks_are_counted_and_reported() {
    let mut rig = flying(Config::default());
    assert_eq!(rig.driver.missed(), SensorFault::Late);
    assert_eq!(rig.driver.fault(), Some(SensorFault::Late));
    assert!(rig.bursts(1)[0].is_ok());
    assert_eq!((rig.driver.fault(), rig.driver.health().late), (None, 1));
}

#[test]
fn fusion_outputs_are_judged_and_verified_too() {
    let mut rig = Rig::sampling(Config { mode: Mode::Ndof, ..Config::default() });
    let read = |rig: &mut Rig| {
        let (start, transfer) = (rig.chip.now, rig.driver.fusion_burst());
        let outcome = rig.chip.perform(&transfer);
        rig.driver.fusion(Micros(start), outcome.as_deref().map_err(|error| *error))
    };
    assert_eq!(read(&mut rig).unwrap().quaternion(), [1.0, 0.0, 0.0, 0.0]);
    let Next::Transfer(_) = rig.driver.next(Micros(rig.chip.now)) else {
        panic!("a verification is due")
    };
    rig.chip.power_on(0);
    assert_eq!(read(&mut rig), Err(SensorFault::AllZero));
    while rig.driver.is_sampling() {
        assert!(read(&mut rig).is_err());
    }
    assert_eq!(rig.driver.fault(), Some(SensorFault::Reset));
    rig.run_until_sampling(500_000);
    assert!(read(&mut rig).is_ok());
}
