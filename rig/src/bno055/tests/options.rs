//! What a real chip may do worse than the default one.

use super::*;
use crate::inertial::{Magnetometer, MagnetometerHealth};

fn late(ms: u64) -> Config {
    Config { late_registers: Ticks::from_ms(ms), ..Config::default() }
}

#[test]
fn a_late_register_reads_as_before_until_its_time_has_come() {
    let mut bus = Bus::started_as(late(20));
    bus.write(page0::UNIT_SEL, &[0x01]);
    let written = bus.now;
    assert_eq!(bus.byte(page0::UNIT_SEL), 0x80);
    while bus.byte(page0::UNIT_SEL) != 0x01 {}
    let took = (bus.now - written).as_us();
    assert!((18_000..21_500).contains(&took), "{took} us");
    // Several bytes are late each, in their order.
    bus.write(page0::AXIS_MAP_CONFIG, &[0x21, 0x01]);
    assert_eq!(bus.read::<2>(page0::AXIS_MAP_CONFIG), [0x24, 0]);
    bus.wait_ms(25);
    assert_eq!(bus.read::<2>(page0::AXIS_MAP_CONFIG), [0x21, 0x01]);
}

/// The page counts that was in force when the byte was written. A mode change begins late, too.
#[test]
fn a_late_write_keeps_its_page_and_delays_what_it_asks_for() {
    let mut bus = Bus::started_as(late(10));
    bus.write(page0::PAGE_ID, &[1]);
    assert_eq!(bus.byte(page0::PAGE_ID), 1, "a page is never late");
    bus.write(page1::ACC_CONFIG, &[0x0E]);
    assert_eq!(bus.byte(page1::ACC_CONFIG), 0x0D);
    bus.write(page0::PAGE_ID, &[0]);
    bus.wait_ms(10);
    bus.write(page0::PAGE_ID, &[1]);
    assert_eq!(bus.byte(page1::ACC_CONFIG), 0x0E);
    bus.write(page0::PAGE_ID, &[0]);
    bus.write(page0::OPR_MODE, &[Mode::Amg as u8]);
    let asked = bus.now;
    while bus.byte(page0::OPR_MODE) == 0 {}
    let took = (bus.now - asked).as_us();
    assert!((15_500..19_000).contains(&took), "{took} us");
}

#[test]
fn a_reset_forgets_what_was_still_to_act() {
    let mut bus = Bus::started_as(late(50));
    bus.write(page0::UNIT_SEL, &[0x01]);
    bus.chip.inject(bus.now, Fault::ConfigReset);
    bus.wait_ms(60);
    assert_eq!(bus.byte(page0::UNIT_SEL), 0x80);
}

/// A write that follows too soon is lost with all its bytes; reads in between change nothing.
#[test]
fn hasty_writes_are_lost() {
    let mut bus = Bus::started_as(Config { lost_within: Ticks::from_ms(5), ..Config::default() });
    bus.write(page0::AXIS_MAP_CONFIG, &[0x21, 0x01]);
    bus.write(page0::UNIT_SEL, &[0x01]);
    assert_eq!(bus.read::<2>(page0::AXIS_MAP_CONFIG), [0x21, 0x01]);
    assert_eq!(bus.byte(page0::UNIT_SEL), 0x80);
    bus.wait_ms(5);
    bus.write(page0::UNIT_SEL, &[0x01]);
    assert_eq!(bus.byte(page0::UNIT_SEL), 0x01);
    bus.write(page0::AXIS_MAP_CONFIG, &[0x24, 0]);
    bus.wait_ms(20);
    assert_eq!(bus.read::<2>(page0::AXIS_MAP_CONFIG), [0x21, 0x01]);
}

/// How often each sensor's words change in two seconds in which everything changes all the time,
/// and at how many of those moments two of them do.
fn refreshes(config: Config, mode: Mode) -> ([u32; 3], u32) {
    let mut bus = Bus::running_as(config, mode);
    let (mut changes, mut together) = ([0; 3], 0);
    let mut last = bus.chip.faultless;
    for step in 0..4000 {
        let moving = f64::from(step);
        bus.truth.specific_force_m_s2[2] = 5.0 + 1e-3 * moving;
        bus.truth.rate_rad_s[0] = 1e-3 * moving;
        bus.truth.field_ut[1] = 0.01 * moving;
        bus.now += Ticks::from_us(500);
        bus.sense();
        let now = bus.chip.faultless;
        let changed: Vec<usize> = (0..3).filter(|sensor| now[*sensor] != last[*sensor]).collect();
        for sensor in &changed {
            changes[*sensor] += 1;
        }
        together += u32::from(changed.len() > 1);
        last = now;
    }
    (changes, together)
}

const OWN: RefreshRates = RefreshRates { acc_hz: 62.5, gyr_hz: 80.0, mag_hz: 35.0 };

fn own_clocks() -> Config {
    Config { clock_error: 0.0, refresh: Some(OWN), ..Config::default() }
}

/// Words in the order of the registers: accelerometer, magnetometer, gyroscope.
#[test]
fn each_sensor_refreshes_at_its_own_rate_and_phase() {
    let near = |counted: [u32; 3], hz: [f64; 3]| {
        for (counted, hz) in counted.into_iter().zip(hz) {
            assert!((f64::from(counted) - 2.0 * hz).abs() <= 2.0, "{counted} at {hz} Hz");
        }
    };
    let (counted, together) = refreshes(own_clocks(), Mode::Amg);
    near(counted, [62.5, 35.0, 80.0]);
    assert!(together < 40, "{together} moments of more than one sensor");
    let (counted, together) = refreshes(Config::default(), Mode::Amg);
    near(counted, [100.0, 10.0, 100.0]);
    assert!(together >= 198, "all at once by default: {together}");
    let (counted, _) = refreshes(own_clocks(), Mode::Ndof);
    near(counted, [100.0, 20.0, 100.0]);
}

/// What is on the bus is what the refresh of that sensor wrote, and survives those of the others.
#[test]
fn a_refresh_of_one_sensor_leaves_the_words_of_the_others() {
    let mut bus = Bus::running_as(own_clocks(), Mode::Amg);
    bus.truth.rate_rad_s = [0.5; 3];
    bus.wait_ms(200);
    assert_eq!(bus.words(page0::ACC_DATA), [0, 0, 981]);
    assert_eq!(bus.words(page0::MAG_DATA), [0, 274, -752]);
    assert_eq!(bus.words(page0::GYR_DATA), [458; 3]);
    bus.chip.inject(bus.now, Fault::Frozen);
    bus.truth = Stimulus::REST;
    bus.wait_ms(100);
    assert_eq!(bus.words(page0::GYR_DATA), [458; 3]);
}

fn field_config(age_ms: u64, health: MagnetometerHealth) -> Config {
    Config { magnetometer: Magnetometer { age: Ticks::from_ms(age_ms), health }, ..own_clocks() }
}

/// From a step of the field to the first word that shows it: the age, and up to one period of
/// 28.6 ms more.
#[test]
fn the_field_is_as_old_as_it_is_said_to_be() {
    for (age_ms, range) in [(0, 0..30), (15, 15..45), (50, 50..80)] {
        let mut bus = Bus::running_as(field_config(age_ms, MagnetometerHealth::Ok), Mode::Amg);
        bus.wait_ms(200);
        bus.truth.field_ut = [40.0, 0.0, 0.0];
        let stepped = bus.now;
        while bus.chip.faultless[1][0] != 640 {
            bus.wait_ms(1);
        }
        let after = (bus.now - stepped).as_us() / 1000;
        assert!(range.contains(&after), "{age_ms} ms old: {after} ms");
    }
}

#[test]
fn a_dead_magnetometer_reads_zero_and_a_stuck_one_its_first_field() {
    for (health, expected) in [
        (MagnetometerHealth::Ok, [640, 0, 0]),
        (MagnetometerHealth::Dead, [0; 3]),
        (MagnetometerHealth::Stuck, [0, 274, -752]),
    ] {
        let mut bus = Bus::running_as(field_config(0, health), Mode::Amg);
        bus.wait_ms(100);
        bus.truth.field_ut = [40.0, 0.0, 0.0];
        bus.wait_ms(100);
        assert_eq!(bus.words(page0::MAG_DATA), expected, "{health:?}");
        // A change of mode mends nothing, and nothing else tells.
        bus.write(page0::OPR_MODE, &[0]);
        bus.wait_ms(30);
        bus.write(page0::OPR_MODE, &[Mode::Amg as u8]);
        bus.wait_ms(100);
        assert_eq!(bus.words(page0::MAG_DATA), expected, "{health:?}");
        assert_eq!(bus.words(page0::ACC_DATA), [0, 0, 981]);
        assert_eq!(bus.byte(page0::ST_RESULT), 0x0F);
        assert_eq!(bus.byte(page0::MAG_ID), 0x32);
    }
}

/// At 0x29 the chip starts, runs, and suffers a lost acknowledge and a pulled cable as at 0x28.
/// Nobody answers at the other address.
#[test]
fn the_other_address_does_all_the_same() {
    for (address, other) in [(0x28, 0x29), (0x29, 0x28)] {
        let mut bus = Bus::running_as(Config { address, ..Config::default() }, Mode::Amg);
        assert_eq!(bus.words(page0::ACC_DATA), [0, 0, 981]);
        let read = true;
        let wrong = I2cEvent::Start { address: other, read };
        assert_eq!(bus.event(wrong), I2cReply::NAK);
        assert_eq!(bus.event(I2cEvent::Read), I2cReply::NAK);
        bus.event(I2cEvent::Stop);
        bus.chip.inject(bus.now, Fault::Naks { probability: 1.0 });
        assert!(!bus.write(page0::CHIP_ID, &[]));
        bus.chip.clear(bus.now, Fault::Naks { probability: 1.0 });
        assert!(bus.write(page0::CHIP_ID, &[]));
        bus.chip.inject(bus.now, Fault::Unplugged);
        assert!(!bus.write(page0::CHIP_ID, &[]));
        bus.chip.clear(bus.now, Fault::Unplugged);
        bus.wait_ms(700);
        assert_eq!(bus.byte(page0::CHIP_ID), 0xA0);
        assert_eq!(bus.byte(page0::OPR_MODE), 0);
    }
}
