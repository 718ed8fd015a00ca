//! The self-test without the feature `self-test`: types without values, so that the compiler leaves
//! out its code.

use tvc_imu::judge::Words;

use crate::chip::Chip;
use crate::registers as reg;

/// A half of the self-test, or its result: without the feature `self-test` no such value exists.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Absent {}

pub(crate) use Absent as SelfTest;
pub(crate) use Absent as Half;

pub(crate) const BURSTS: u8 = 1;
pub(crate) const BURST_US: u64 = 0;

impl Absent {
    pub(crate) fn next(self, _sums: &Sums, _chip: Chip) -> Result<Self, SelfTest> {
        match self {}
    }

    pub(crate) const fn settle_us(self) -> u64 {
        match self {}
    }

    pub(crate) const fn controls(self, _chip: Chip) -> [u8; reg::CONTROLS] {
        match self {}
    }
}

#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Sums {}

impl Sums {
    pub(crate) fn add(&mut self, half: Half, _words: &Words) {
        match half {}
    }
}
