//! The self-test: a stimulus moves both sensors' masses (application note AN4650, section 11).

use tvc_imu::judge::Words;

use crate::chip::Chip;
use crate::config::{AccRange, GyrRange};
use crate::registers as reg;

/// Bursts of each mean.
pub(crate) const BURSTS: u8 = 5;
/// Until the outputs have settled, without and with the stimulus, us.
const SETTLE_US: [u64; 2] = [800_000, 200_000];
/// Between two bursts, us: longer than a refresh of either sensor.
pub(crate) const BURST_US: u64 = 25_000;

/// Most that the stimulus of a sound chip changes the acceleration, mg.
const MOST_MG: u16 = 1_700;
/// Least and most that it changes the rate at +-2000 deg/s, deg/s.
const LEAST_DPS: u16 = 150;
/// See [`LEAST_DPS`].
const MOST_DPS: u16 = 700;

/// Changes by the self-test's stimulus, of a chip at rest.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SelfTest {
    /// Change of the accelerations, mg.
    pub acc_mg: [u16; 3],
    /// Change of the rates, deg/s.
    pub gyr_dps: [u16; 3],
    /// The accelerometer's changes are those of a sound chip.
    pub acc: bool,
    /// The gyroscope's changes are those of a sound chip.
    pub gyr: bool,
}

impl SelfTest {
    /// Whether both sensors passed.
    #[must_use]
    pub fn passed(&self) -> bool {
        self.acc && self.gyr
    }
}

/// The two halves of the test.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Half {
    /// Without the stimulus.
    Without,
    /// With it.
    With,
}

impl Half {
    /// The half that comes first.
    pub(crate) const FIRST: Self = Self::Without;

    /// The half behind this one, or the result behind the last.
    pub(crate) fn next(self, sums: &Sums, chip: Chip) -> Result<Self, SelfTest> {
        match self {
            Self::Without => Ok(Self::With),
            Self::With => Err(sums.result(chip)),
        }
    }

    /// How long to wait for the first burst, us.
    pub(crate) const fn settle_us(self) -> u64 {
        let [without, with] = SETTLE_US;
        match self {
            Self::Without => without,
            Self::With => with,
        }
    }

    /// The control registers: +-4 g at 52 Hz, +-2000 deg/s at 208 Hz, and the positive stimulus of
    /// both sensors in CTRL5_C.
    pub(crate) const fn controls(self, chip: Chip) -> [u8; reg::CONTROLS] {
        let stimulus = match self {
            Self::Without => 0,
            Self::With => 0x05,
        };
        let [ninth, tenth] = chip.last_controls();
        [0x38, 0x5C, reg::BDU | reg::IF_INC, 0, stimulus, 0, 0, 0, ninth, tenth]
    }
}

/// Sums of the words, without and with the stimulus.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Sums {
    acc: [[i32; 3]; 2],
    gyr: [[i32; 3]; 2],
}

impl Sums {
    /// Adds a burst.
    pub(crate) fn add(&mut self, half: Half, Words([acc, _, gyr]): &Words) {
        let [acc_sums, gyr_sums] =
            [&mut self.acc, &mut self.gyr].map(|[without, with]| match half {
                Half::Without => without,
                Half::With => with,
            });
        for (sums, words) in [(acc_sums, acc), (gyr_sums, gyr)] {
            for (sum, word) in sums.iter_mut().zip(words) {
                *sum += i32::from(*word);
            }
        }
    }

    fn result(&self, chip: Chip) -> SelfTest {
        let change = |[without, with]: &[[i32; 3]; 2], unit: f32| {
            let mut changes = [0; 3];
            for (change, (without, with)) in changes.iter_mut().zip(without.iter().zip(with)) {
                *change = (without.abs_diff(*with) as f32 * unit / f32::from(BURSTS)) as u16;
            }
            changes
        };
        let acc_mg = change(&self.acc, AccRange::G4.mg());
        let gyr_dps = change(&self.gyr, GyrRange::Dps2000.mdps() / 1000.0);
        let within = |changes: &[u16; 3], least, most| {
            changes.iter().all(|change| (least..=most).contains(change))
        };
        SelfTest {
            acc_mg,
            gyr_dps,
            acc: within(&acc_mg, chip.self_test_least_mg(), MOST_MG),
            gyr: within(&gyr_dps, LEAST_DPS, MOST_DPS),
        }
    }
}
