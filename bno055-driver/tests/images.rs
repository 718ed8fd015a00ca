//! Whatever the chip answers, the driver neither panics nor loops nor lets a sample out that it
//! should not.

mod fake;

use bno055_driver::config::{AxisMap, Mode, ResetPolicy};
use bno055_driver::{BusError, Config, Driver, FusionSample, Imu, Micros, Next, Profile, Request};

const MODES: [Mode; 12] = [
    Mode::AccOnly,
    Mode::MagOnly,
    Mode::GyrOnly,
    Mode::AccMag,
    Mode::AccGyr,
    Mode::MagGyr,
    Mode::Amg,
    Mode::Imu,
    Mode::Compass,
    Mode::M4g,
    Mode::NdofFmcOff,
    Mode::Ndof,
];

struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }

    fn fill(&mut self, bytes: &mut [u8]) {
        // Mostly noise, but often enough the bytes that mean something.
        for byte in bytes {
            let random = self.next();
            *byte = match random >> 8 & 7 {
                0 => 0x00,
                1 => 0xFF,
                _ => random as u8,
            };
        }
    }

    fn config(&mut self) -> Config {
        Config {
            mode: MODES[self.next() as usize % MODES.len()],
            axes: AxisMap::PLACEMENTS[self.next() as usize % 8],
            external_crystal: self.next().is_multiple_of(4),
            profile: (self.next().is_multiple_of(4)).then(Profile::default),
            reset: if self.next().is_multiple_of(4) {
                ResetPolicy::AfterFailures(2.try_into().unwrap())
            } else {
                ResetPolicy::Never
            },
            ..Config::default()
        }
    }
}

/// One million register images through every decoder: bursts of all modes, fusion, profiles,
/// answers of all lengths.
#[test]
fn one_million_random_images_decode() {
    let mut random = Random(42);
    // Drivers that sample, one for each mode, renewed when an image has thrown them out.
    let sampling: Vec<Driver> = MODES
        .iter()
        .map(|&mode| fake::Rig::sampling(Config { mode, ..Config::default() }).driver)
        .collect();
    let mut drivers = sampling.clone();
    let mut image = [0; 128];
    let (mut believed, mut judged) = (0_u32, 0_u32);
    for round in 0..1_000_000_u64 {
        random.fill(&mut image);
        let index = round as usize % MODES.len();
        let driver = &mut drivers[index];
        let now = Micros(10_000_000 + round * 10_000);
        let expected = driver.burst().answer_len();
        // One in eight has a wrong length.
        let len =
            if random.next().is_multiple_of(8) { random.next() as usize % 33 } else { expected };
        let outcome = driver.sample(now, Ok(&image[8..8 + len]));
        let rates = driver.rates_burst().is_some().then_some(6);
        assert!(outcome.is_err() || len == expected || Some(len) == rates);
        judged += 1;
        believed += u32::from(outcome.is_ok());
        if let Next::Transfer(transfer) = driver.next(now) {
            driver.complete(now, Ok(&image[64..64 + transfer.answer_len()]));
        }
        let fusion: Result<FusionSample, _> = driver.fusion(now, Ok(&image[0x1A..0x34]));
        if let Ok(fusion) = fusion {
            let norm: f32 = fusion.quaternion().iter().map(|q| q * q).sum::<f32>().sqrt();
            assert!((0.949..1.051).contains(&norm));
        }
        assert!(Profile::from_bytes(&image).is_err());
        if !driver.is_sampling() {
            *driver = sampling[index].clone();
        }
    }
    assert_eq!(judged, 1_000_000);
    // Single sensors have few checks to fail, and a driver that has been renewed has no burst to
    // compare with; noise over nine words hardly ever passes.
    assert!(believed < 300_000, "{believed}");
}

/// Random answers and errors to everything, from power-on: the driver goes on, and waits only for
/// what is to come.
#[test]
fn random_answers_never_stop_the_driver() {
    let mut random = Random(7);
    for _ in 0..300 {
        let mut driver = Driver::new(random.config());
        let mut now = Micros(0);
        for _ in 0..300 {
            let mut bytes = [0; 40];
            random.fill(&mut bytes);
            match driver.next(now) {
                Next::Transfer(transfer) => {
                    let right = transfer.answer_len();
                    let len = if random.next().is_multiple_of(16) {
                        random.next() as usize % 40
                    } else {
                        right
                    };
                    // Half the time the identity is right, so that the set-up gets somewhere.
                    if right == 8 && random.next().is_multiple_of(2) {
                        bytes[..8].copy_from_slice(&[0xA0, 0xFB, 0x32, 0x0F, 0, 0, 0, 0]);
                    }
                    let outcome = match random.next() % 24 {
                        0 => Err(BusError::Nak),
                        1 => Err(BusError::Stuck),
                        _ => Ok(&bytes[..len]),
                    };
                    now = now.after(500);
                    driver.complete(now, outcome);
                }
                Next::Wait(until) => {
                    assert!(until > now && until.since(now) <= 1_000_000, "{:?}", until.since(now));
                    now = until;
                }
                Next::Sample => {
                    now = now.after(10_000);
                    let _ = driver.sample(now, Ok(&bytes[..18]));
                }
            }
            if random.next().is_multiple_of(64) {
                driver.request(
                    [Request::Profile, Request::SelfTest, Request::Temperature]
                        [random.next() as usize % 3],
                );
            }
        }
        assert!(driver.is_sampling() || driver.fault().is_some());
    }
}
