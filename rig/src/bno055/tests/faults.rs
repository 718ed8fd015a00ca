//! Faults as a bus master sees them.

use super::*;

#[test]
fn faults_of_the_data() {
    let mut bus = Bus::running(Mode::Amg);
    bus.truth.rate_rad_s = [0.5; 3];
    bus.wait_ms(100);
    let fault = |bus: &mut Bus, fault: Fault| {
        bus.chip.inject(bus.now, fault);
        bus.wait_ms(50);
    };
    fault(&mut bus, Fault::AllOnes);
    assert_eq!(bus.read::<18>(page0::ACC_DATA), [0xFF; 18]);
    bus.chip.clear(bus.now, Fault::AllOnes);
    fault(&mut bus, Fault::GyroDead);
    assert_eq!(bus.words(page0::GYR_DATA), [0; 3]);
    assert_eq!(bus.byte(page0::GYR_ID), 0);
    assert_eq!(bus.byte(page0::ST_RESULT), 0x0B);
    bus.chip.clear(bus.now, Fault::GyroDead);
    bus.wait_ms(50);
    assert_eq!(bus.words(page0::GYR_DATA), [458; 3]);
    fault(&mut bus, Fault::Frozen);
    bus.truth.rate_rad_s = [0.0; 3];
    bus.wait_ms(100);
    assert_eq!(bus.words(page0::GYR_DATA), [458; 3]);
    bus.chip.clear(bus.now, Fault::Frozen);
    fault(&mut bus, Fault::CorruptWords { probability: 1.0 });
    assert_eq!(bus.words(page0::ACC_DATA), [-1; 3]);
    assert_eq!(bus.byte(page0::CHIP_ID), 0xA0, "only data words suffer");
    bus.chip.clear(bus.now, Fault::CorruptWords { probability: 0.0 });
    fault(&mut bus, Fault::Spikes { probability: 1.0 });
    assert_eq!(bus.words(page0::ACC_DATA)[2], 981 ^ i16::MIN);
    bus.chip.clear(bus.now, Fault::Spikes { probability: 0.0 });
    fault(&mut bus, Fault::FixedPattern);
    assert_eq!(bus.words(page0::ACC_DATA), [1962, 568, 0]);
    bus.chip.clear(bus.now, Fault::FixedPattern);
    fault(&mut bus, Fault::ConfigReset);
    assert_eq!(bus.byte(page0::OPR_MODE), 0);
    assert_eq!(bus.read::<18>(page0::ACC_DATA), [0; 18]);
}

#[test]
fn faults_of_the_bus() {
    let mut bus = Bus::running(Mode::Amg);
    bus.chip.inject(bus.now, Fault::Unplugged);
    assert!(!bus.write(page0::CHIP_ID, &[]));
    bus.chip.clear(bus.now, Fault::Unplugged);
    assert!(!bus.write(page0::CHIP_ID, &[]), "it boots first");
    bus.wait_ms(700);
    assert_eq!(bus.byte(page0::OPR_MODE), 0);

    bus.chip.inject(bus.now, Fault::SclStuck);
    assert!(bus.chip.held_low(bus.now).scl);
    bus.chip.clear(bus.now, Fault::SclStuck);
    bus.chip.inject(bus.now, Fault::SdaHeld { clocks: 3 });
    for _ in 0..3 {
        assert!(bus.chip.held_low(bus.now).sda);
        bus.chip.clocked();
    }
    assert!(!bus.chip.held_low(bus.now).sda);

    let long = Fault::LongStretch { stretch: Ticks::from_ms(5), probability: 1.0 };
    bus.chip.inject(bus.now, long);
    let start = I2cEvent::Start { address: bus.chip.address(), read: false };
    assert!(bus.event(start).stretch > Ticks::from_ms(5));
}

#[test]
fn all_zero_keeps_its_mode_and_tells_an_error() {
    let mut bus = Bus::running(Mode::Amg);
    bus.chip.inject(bus.now, Fault::AllZero);
    bus.wait_ms(50);
    assert_eq!(bus.read::<18>(page0::ACC_DATA), [0; 18]);
    assert_eq!(bus.byte(page0::OPR_MODE), Mode::Amg as u8);
    assert_eq!(bus.read::<2>(page0::SYS_STATUS), [status::ERROR, error::PERIPHERAL_INIT]);
    bus.chip.clear(bus.now, Fault::AllZero);
    bus.wait_ms(50);
    assert_eq!(bus.words(page0::ACC_DATA), [0, 0, 981]);
    assert_eq!(bus.byte(page0::SYS_ERR), 0);
}

#[test]
fn registers_that_changed_by_themselves() {
    let mut bus = Bus::started();
    bus.write(page0::UNIT_SEL, &[0]);
    bus.write(page0::OPR_MODE, &[Mode::Amg as u8]);
    bus.truth.specific_force_m_s2 = [1.0, 2.0, 9.0];
    bus.wait_ms(100);
    bus.chip.inject(bus.now, Fault::SwappedAxes);
    bus.wait_ms(50);
    assert_eq!(bus.words(page0::ACC_DATA), [200, 100, 900]);
    assert_eq!(bus.chip.faultless[0], [100, 200, 900]);
    bus.chip.inject(bus.now, Fault::RevertedAxisMap);
    bus.wait_ms(50);
    assert_eq!(bus.words(page0::ACC_DATA), [100, 200, 900]);
    assert_eq!(bus.byte(page0::UNIT_SEL), 0);
    bus.chip.inject(bus.now, Fault::RevertedUnits);
    assert_eq!(bus.byte(page0::UNIT_SEL), unit::ANDROID);
}

#[test]
fn a_hung_chip_needs_its_power_cut() {
    let mut bus = Bus::running(Mode::Amg);
    bus.chip.inject(bus.now, Fault::Hung);
    bus.wait_ms(2000);
    assert!(!bus.write(page0::CHIP_ID, &[]));
    bus.chip.clear(bus.now, Fault::Hung);
    assert!(!bus.write(page0::CHIP_ID, &[]), "it boots first");
    bus.wait_ms(700);
    assert_eq!(bus.byte(page0::OPR_MODE), 0);
}

#[test]
fn a_flipped_bit_is_one_bit_of_a_byte() {
    let mut bus = Bus::running(Mode::Amg);
    bus.chip.inject(bus.now, Fault::BitFlips { probability: 1.0 });
    for _ in 0..20 {
        assert_eq!((bus.byte(page0::CHIP_ID) ^ 0xA0).count_ones(), 1);
    }
    bus.chip.inject(bus.now, Fault::BitFlips { probability: 0.0 });
    assert_eq!(bus.byte(page0::CHIP_ID), 0xA0);
}

#[test]
fn bus_errors_and_other_masters_strike_when_a_byte_begins() {
    let mut bus = Bus::running(Mode::Amg);
    let now = bus.now;
    assert!(!bus.chip.glitch(now));
    bus.chip.inject(now, Fault::BusErrors { probability: 1.0 });
    assert!(bus.chip.glitch(now));
    bus.chip.clear(now, Fault::BusErrors { probability: 1.0 });
    let other = Fault::ArbitrationLosses { probability: 1.0 };
    bus.chip.inject(now, other);
    assert!(!bus.chip.held_low(now).sda);
    assert!(!bus.chip.glitch(now), "no START or STOP of its own");
    assert!(bus.chip.held_low(now).sda);
    bus.chip.clear(now, other);
    assert!(!bus.chip.held_low(now + Ticks::from_ms(1)).sda);
}

#[test]
fn lost_acknowledges_end_a_transfer() {
    let mut bus = Bus::running(Mode::Amg);
    bus.chip.inject(bus.now, Fault::Naks { probability: 1.0 });
    assert!(!bus.start(false));
    assert!(!bus.event(I2cEvent::Write(page0::CHIP_ID)).ack);
    bus.chip.clear(bus.now, Fault::Naks { probability: 1.0 });
    assert!(bus.start(false));
    bus.chip.inject(bus.now, Fault::Naks { probability: 1.0 });
    assert!(!bus.event(I2cEvent::Write(page0::CHIP_ID)).ack);
    bus.chip.clear(bus.now, Fault::Naks { probability: 1.0 });
    assert_eq!(bus.byte(page0::CHIP_ID), 0xA0);
}

#[test]
fn a_torn_word_has_the_high_byte_of_the_refresh_before() {
    let mut bus = Bus::running(Mode::Amg);
    bus.truth.specific_force_m_s2[2] = 2.55;
    bus.wait_ms(200);
    bus.truth.specific_force_m_s2[2] = 10.24;
    let fault = Fault::TornWords { probability: 1.0 };
    bus.chip.inject(bus.now, fault);
    let z = |chip: &Bno055| chip.faultless[0][2].to_le_bytes();
    let [_, old] = z(&bus.chip);
    while z(&bus.chip)[1] == old {
        bus.now += Ticks::from_us(500);
        bus.sense();
    }
    let [low, _] = z(&bus.chip);
    assert_eq!(bus.words(page0::ACC_DATA)[2].to_le_bytes(), [low, old]);
    bus.wait_ms(500);
    assert_eq!(bus.words(page0::ACC_DATA)[2], 1024, "at rest none shows");
}

#[test]
fn clocks_by_hand_free_the_line_and_hang_the_chip() {
    let mut bus = Bus::running(Mode::Amg);
    bus.chip.inject(bus.now, Fault::ClockHang);
    assert!(bus.chip.held_low(bus.now).sda);
    bus.chip.clocked();
    assert!(!bus.chip.held_low(bus.now).sda);
    assert!(!bus.write(page0::CHIP_ID, &[]));
    bus.chip.clear(bus.now, Fault::ClockHang);
    bus.wait_ms(700);
    assert_eq!(bus.byte(page0::CHIP_ID), 0xA0);
    assert_eq!(bus.byte(page0::OPR_MODE), 0, "its power was cut");
    // Unless nobody clocked it.
    let mut bus = Bus::running(Mode::Amg);
    bus.chip.inject(bus.now, Fault::ClockHang);
    bus.chip.clear(bus.now, Fault::ClockHang);
    assert_eq!(bus.byte(page0::OPR_MODE), Mode::Amg as u8);
}
