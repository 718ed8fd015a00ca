//! The chip as a bus master sees it.

mod calibration;
mod faults;
mod navigation;
mod options;
pub(crate) mod sensors;

use super::registers::{page1, status, trigger, unit};
use super::*;
use crate::inertial::WarmUp;
use samd21::board::{I2cEvent, I2cReply};

/// A master with a clock of its own, 25 us a byte plus the chip's stretching.
struct Bus {
    chip: Bno055,
    now: Ticks,
    truth: Stimulus,
    sensed: Ticks,
}

impl Bus {
    fn new(config: Config) -> Self {
        Self {
            chip: Bno055::new(config),
            now: Ticks::ZERO,
            truth: Stimulus::REST,
            sensed: Ticks::ZERO,
        }
    }

    /// A quiet sensor that has started.
    fn started() -> Self {
        Self::started_as(Config::default())
    }

    fn started_as(config: Config) -> Self {
        let mut bus = Self::new(Config { errors: ImuErrors::NONE, ..config });
        bus.wait_ms(700);
        bus
    }

    fn running(mode: Mode) -> Self {
        Self::running_as(Config::default(), mode)
    }

    fn running_as(config: Config, mode: Mode) -> Self {
        let mut bus = Self::started_as(config);
        bus.write(page0::OPR_MODE, &[mode as u8]);
        bus.wait_ms(30);
        bus
    }

    fn sense(&mut self) {
        while self.sensed + Ticks::from_us(500) <= self.now {
            self.sensed += Ticks::from_us(500);
            self.chip.sense(self.sensed, &self.truth);
        }
    }

    fn wait_ms(&mut self, ms: u64) {
        self.now += Ticks::from_ms(ms);
        self.sense();
    }

    fn event(&mut self, event: I2cEvent) -> I2cReply {
        self.now += Ticks::from_us(25);
        self.sense();
        let reply = self.chip.i2c(self.now, event);
        self.now += reply.stretch;
        reply
    }

    fn start(&mut self, read: bool) -> bool {
        let address = self.chip.address();
        self.event(I2cEvent::Start { address, read }).ack
    }

    fn write(&mut self, register: u8, values: &[u8]) -> bool {
        let mut ack = self.start(false) && self.event(I2cEvent::Write(register)).ack;
        for &value in values {
            ack = ack && self.event(I2cEvent::Write(value)).ack;
        }
        self.event(I2cEvent::Stop);
        ack
    }

    fn read<const N: usize>(&mut self, register: u8) -> [u8; N] {
        assert!(self.start(false) && self.event(I2cEvent::Write(register)).ack);
        assert!(self.start(true));
        let bytes = [(); N].map(|()| self.event(I2cEvent::Read).data);
        self.event(I2cEvent::Stop);
        bytes
    }

    fn byte(&mut self, register: u8) -> u8 {
        self.read::<1>(register)[0]
    }

    fn words(&mut self, register: u8) -> [i16; 3] {
        let b = self.read::<6>(register);
        [0, 2, 4].map(|i| i16::from_le_bytes([b[i], b[i + 1]]))
    }
}

#[test]
fn boots_in_its_time_and_gathers_itself() {
    for seed in 0..20 {
        let mut bus = Bus::new(Config { seed, ..Config::default() });
        let mut answered = None;
        let mut not_itself = false;
        loop {
            if bus.write(page0::CHIP_ID, &[]) {
                answered.get_or_insert(bus.now);
                match bus.byte(page0::CHIP_ID) {
                    0xA0 => break,
                    id => not_itself |= id == 0,
                }
            }
            bus.wait_ms(2);
        }
        let answered = answered.unwrap().as_us() / 1000;
        assert!((400..=653).contains(&answered), "seed {seed}: {answered} ms");
        assert!(not_itself);
    }
}

#[test]
fn register_map_after_power_on() {
    let mut bus = Bus::started();
    assert_eq!(bus.read::<8>(0), [0xA0, 0xFB, 0x32, 0x0F, 0x11, 0x03, 0x15, 0]);
    assert_eq!(bus.byte(page0::ST_RESULT), 0x0F);
    assert_eq!(bus.byte(page0::UNIT_SEL), 0x80);
    assert_eq!(bus.byte(page0::OPR_MODE), 0);
    assert_eq!(bus.byte(page0::SYS_STATUS), status::IDLE);
    assert_eq!(bus.read::<2>(page0::AXIS_MAP_CONFIG), [0x24, 0]);
    bus.write(page0::PAGE_ID, &[1]);
    assert_eq!(bus.read::<3>(page1::ACC_CONFIG), [0x0D, 0x0B, 0x38]);
    assert_eq!(bus.byte(page0::PAGE_ID), 1);
    assert_ne!(bus.read::<16>(page1::UNIQUE_ID), [0; 16]);
    bus.write(page0::PAGE_ID, &[2]);
    assert_eq!(bus.byte(page0::PAGE_ID), 1);
}

#[test]
fn config_reads_zero_and_modes_take_their_time() {
    let mut bus = Bus::started();
    assert_eq!(bus.read::<44>(page0::ACC_DATA), [0; 44]);
    bus.write(page0::OPR_MODE, &[Mode::Amg as u8]);
    let asked = bus.now;
    while bus.byte(page0::OPR_MODE) == 0 {}
    let took = (bus.now - asked).as_us();
    assert!((6500..9000).contains(&took), "{took} us");
    bus.wait_ms(12);
    assert_eq!(bus.words(page0::ACC_DATA), [0, 0, 981]);
    assert_eq!(bus.words(page0::MAG_DATA), [0, 274, -752]);
    assert_eq!(bus.words(page0::GYR_DATA), [0, 0, 0]);
    assert_eq!(bus.byte(page0::SYS_STATUS), status::NO_FUSION);
    bus.write(page0::OPR_MODE, &[0]);
    let asked = bus.now;
    while bus.byte(page0::OPR_MODE) != 0 {}
    let took = (bus.now - asked).as_us();
    assert!((18_500..21_000).contains(&took), "{took} us");
    assert_eq!(bus.read::<44>(page0::ACC_DATA), [0; 44]);
}

#[test]
fn settings_are_only_taken_in_config() {
    let mut bus = Bus::running(Mode::Amg);
    bus.write(page0::UNIT_SEL, &[0x01]);
    bus.write(page0::AXIS_MAP_CONFIG, &[0x21]);
    bus.write(page0::PAGE_ID, &[1]);
    bus.write(page1::ACC_CONFIG, &[0x0F]);
    assert_eq!(bus.byte(page1::ACC_CONFIG), 0x0D);
    bus.write(page0::PAGE_ID, &[0]);
    assert_eq!(bus.byte(page0::UNIT_SEL), 0x80);
    assert_eq!(bus.byte(page0::AXIS_MAP_CONFIG), 0x24);
    // Straight from one running mode to another: ignored.
    bus.write(page0::OPR_MODE, &[Mode::Ndof as u8]);
    bus.wait_ms(40);
    assert_eq!(bus.byte(page0::OPR_MODE), Mode::Amg as u8);
}

#[test]
fn values_that_do_not_exist_are_ignored() {
    let mut bus = Bus::started();
    for map in [0x00, 0x20, 0x3F, 0x14] {
        bus.write(page0::AXIS_MAP_CONFIG, &[map]);
        assert_eq!(bus.byte(page0::AXIS_MAP_CONFIG), 0x24, "{map:#x}");
    }
    bus.write(page0::OPR_MODE, &[0x0D]);
    bus.wait_ms(30);
    assert_eq!(bus.byte(page0::OPR_MODE), 0);
    bus.write(page0::PAGE_ID, &[1]);
    bus.write(page1::GYR_CONFIG_0, &[0x3D]);
    assert_eq!(bus.byte(page1::GYR_CONFIG_0), 0x38);
    bus.write(page1::GYR_CONFIG_0, &[0x10]);
    assert_eq!(bus.byte(page1::GYR_CONFIG_0), 0x10);
}

#[test]
fn axis_map_and_units() {
    let mut bus = Bus::started();
    bus.truth.specific_force_m_s2 = [1.0, 2.0, 3.0];
    bus.truth.rate_rad_s = [0.1, 0.0, -0.1];
    // Output x shows Y, y shows X; z inverted.
    bus.write(page0::AXIS_MAP_CONFIG, &[0x21, 0x01]);
    bus.write(page0::UNIT_SEL, &[unit::ACC_MG | unit::GYR_RPS]);
    bus.write(page0::OPR_MODE, &[Mode::AccGyro as u8]);
    bus.wait_ms(30);
    assert_eq!(bus.words(page0::ACC_DATA), [204, 102, -306]);
    assert_eq!(bus.words(page0::GYR_DATA), [0, 90, 90]);
    assert_eq!(bus.words(page0::MAG_DATA), [0, 0, 0]);
}

#[test]
fn refreshes_at_100_hz_by_its_own_clock() {
    let mut bus = Bus::new(Config::default());
    bus.wait_ms(700);
    bus.write(page0::OPR_MODE, &[Mode::Amg as u8]);
    bus.wait_ms(30);
    let (mut refreshes, mut last) = (0, bus.chip.refresh);
    let first = last.at;
    for _ in 0..20_000 {
        bus.now += Ticks::from_us(500);
        bus.sense();
        if bus.chip.refresh != last {
            refreshes += 1;
            last = bus.chip.refresh;
        }
    }
    let period = (last.at - first).as_us_f64() / f64::from(refreshes);
    assert!((9900.0..=10_100.0).contains(&period), "{period}");
    assert!((period - 10_000.0).abs() > 1.0, "the clock has an error: {period}");
}

#[test]
fn an_axis_is_never_torn_within_a_transfer_but_can_be_between_two() {
    let mut bus = Bus::running(Mode::Amg);
    bus.truth.specific_force_m_s2[2] = 2.55;
    bus.wait_ms(100);
    assert!(bus.start(false));
    bus.event(I2cEvent::Write(page0::ACC_DATA + 4));
    assert!(bus.start(true));
    let low = bus.event(I2cEvent::Read).data;
    // The registers move on between the two bytes.
    bus.truth.specific_force_m_s2[2] = 9.81;
    bus.wait_ms(100);
    let high = bus.event(I2cEvent::Read).data;
    bus.event(I2cEvent::Stop);
    assert_eq!(i16::from_le_bytes([low, high]), 255);

    bus.truth.specific_force_m_s2[2] = 2.55;
    bus.wait_ms(100);
    let low = bus.byte(page0::ACC_DATA + 4);
    bus.truth.specific_force_m_s2[2] = 9.81;
    bus.wait_ms(100);
    let high = bus.byte(page0::ACC_DATA + 5);
    assert_eq!(i16::from_le_bytes([low, high]), 0x3FF, "torn");
}

#[test]
fn a_burst_of_18_bytes_takes_the_time_users_measured() {
    let mut bus = Bus::running(Mode::Amg);
    let begin = bus.now;
    bus.read::<18>(page0::ACC_DATA);
    let took = (bus.now - begin).as_us();
    assert!((4000..4700).contains(&took), "{took} us");
}

#[test]
fn profile_groups_count_with_their_last_byte() {
    let mut bus = Bus::started();
    bus.write(page0::ACC_OFFSET, &[10, 0, 20, 0, 30]);
    assert_eq!(bus.read::<6>(page0::ACC_OFFSET), [0; 6]);
    bus.write(page0::ACC_OFFSET + 5, &[0]);
    assert_eq!(bus.read::<6>(page0::ACC_OFFSET), [10, 0, 20, 0, 30, 0]);
    // A magnetometer offset out of range is dropped, and fusion does not start.
    bus.write(0x5B, &[1, 0, 2, 0, 0x8C, 0x21]);
    assert_eq!(bus.read::<6>(0x5B), [0; 6]);
    bus.write(page0::OPR_MODE, &[Mode::Ndof as u8]);
    bus.wait_ms(30);
    assert_eq!(bus.read::<2>(page0::SYS_STATUS), [status::ERROR, error::FUSION_CONFIG]);
    assert_eq!(bus.words(page0::ACC_DATA), [0; 3]);
}

#[test]
fn offsets_correct_in_fusion_only() {
    for (mode, z) in [(Mode::Amg, 981), (Mode::Ndof, 951)] {
        let mut bus = Bus::started();
        bus.write(page0::ACC_OFFSET, &[0, 0, 0, 0, 30, 0]);
        bus.write(page0::OPR_MODE, &[mode as u8]);
        bus.wait_ms(30);
        assert_eq!(bus.words(page0::ACC_DATA), [0, 0, z], "{mode:?}");
    }
}

#[test]
fn fusion_shows_attitude() {
    let mut bus = Bus::running(Mode::Ndof);
    assert_eq!(bus.byte(page0::SYS_STATUS), status::FUSION);
    assert_eq!(bus.read::<2>(page0::QUA_DATA), [0x00, 0x40]);
}

#[test]
fn temperature_in_either_unit() {
    let warm_up = WarmUp { from_c: -10.0, to_c: 50.0, time_constant_s: 1.0 };
    for (units, then, later) in [(0x80, 20.0, 50.0), (0x90, 34.0, 61.0)] {
        let errors = ImuErrors { warm_up, ..ImuErrors::NONE };
        let mut bus = Bus::new(Config { errors, ..Config::default() });
        bus.wait_ms(700);
        bus.write(page0::UNIT_SEL, &[units]);
        // 50 C less 60 C times exp(-0.7).
        let read = f64::from(bus.byte(page0::TEMP).cast_signed());
        assert!((read - then).abs() <= 1.0, "{read} for {then}");
        bus.wait_ms(10_000);
        assert_eq!(f64::from(bus.byte(page0::TEMP).cast_signed()), later);
    }
    assert_eq!(Bus::started().byte(page0::TEMP), 27);
}

#[test]
fn resets() {
    let mut bus = Bus::running(Mode::Amg);
    bus.write(page0::SYS_TRIGGER, &[trigger::RST_SYS]);
    assert!(!bus.write(page0::CHIP_ID, &[]));
    bus.wait_ms(700);
    assert_eq!(bus.byte(page0::OPR_MODE), 0);
}

#[test]
fn self_test_takes_its_time() {
    let mut bus = Bus::started();
    bus.write(page0::SYS_TRIGGER, &[trigger::SELF_TEST]);
    assert_eq!(bus.byte(page0::SYS_STATUS), status::SELF_TEST);
    bus.wait_ms(400);
    assert_eq!(bus.read::<1>(page0::SYS_STATUS), [status::IDLE]);
    assert_eq!(bus.byte(page0::ST_RESULT), 0x0F);
}

#[test]
fn the_same_seed_gives_the_same_bytes() {
    let run = |seed: u64| {
        let mut bus = Bus::new(Config { seed, ..Config::default() });
        bus.wait_ms(700);
        bus.write(page0::OPR_MODE, &[Mode::Amg as u8]);
        bus.wait_ms(100);
        (bus.read::<18>(page0::ACC_DATA), bus.now)
    };
    assert_eq!(run(7), run(7));
    assert_ne!(run(7), run(8));
}
