//! What a driver reports of its sensor.

use crate::pace::Progress;
use crate::{BusError, Health, Refresh, SensorFault, Transferred};

/// What a driver reports of its sensor besides the samples.
#[derive(Clone, Debug)]
pub struct Report {
    /// The present reason for missing samples: the first cause, until the sensor samples again or
    /// has a worse cause.
    pub fault: Option<SensorFault>,
    /// The counters.
    pub health: Health,
    /// The sensor's refreshes.
    pub refresh: Refresh,
}

impl Report {
    /// The report of a sensor that is being set up.
    #[must_use]
    pub fn new(refresh: Refresh) -> Self {
        Self { fault: Some(SensorFault::Booting), health: Health::default(), refresh }
    }

    /// The reason for a sample that is missing.
    #[must_use]
    pub fn cause(&self) -> SensorFault {
        self.fault.unwrap_or(SensorFault::Booting)
    }

    /// Takes the outcome of a transfer of the set-up and its progress; whether no such sensor is at
    /// this address.
    pub fn progressed<A>(&mut self, outcome: Transferred<'_>, progress: &Progress<A>) -> bool {
        if let Err(error) = outcome {
            self.health.count(error.into());
        }
        if let Progress::Failed(fault) = *progress {
            let failed = u32::from(!fault.is_bus());
            self.health.failed_setups = self.health.failed_setups.wrapping_add(failed);
            self.fault = Some(fault);
        }
        outcome == Err(BusError::Nak)
            || matches!(progress, Progress::Failed(SensorFault::WrongChip { .. }))
    }

    /// The sensor samples after a set-up of this time, us.
    pub fn started(&mut self, setup_us: u64) {
        self.health.starts = self.health.starts.wrapping_add(1);
        self.health.setup_us = setup_us;
        self.fault = None;
    }

    /// The sensor is set up anew for this reason.
    pub fn restarted(&mut self, fault: SensorFault) {
        if fault == SensorFault::Reset {
            self.health.resets = self.health.resets.wrapping_add(1);
        }
        self.fault = Some(fault);
    }
}
