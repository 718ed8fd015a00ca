//! The trait of a driver, for a control loop.

use crate::fault::SensorFault;
use crate::health::Health;
use crate::refresh::Refresh;
use crate::report::Report;
use crate::sample::{Sample, Scale};
use crate::time::Micros;
use crate::transfer::{Transfer, Transferred};

/// Next task of the bus' owner.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Next {
    /// Perform this transfer and hand its outcome to [`Imu::complete`].
    Transfer(Transfer),
    /// Nothing to do before this moment; the maximum of [`Micros`] while the sensor is suspended.
    Wait(Micros),
    /// Sampling: a burst may be armed for the next tick.
    Sample,
}

/// The transfers of the ticks, to a 7-bit address.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Bursts {
    /// The slave's address.
    pub address: u8,
    /// Reads all sensors; `None` while the sensor is set up.
    pub whole: Option<Transfer>,
    /// Reads the rates alone, in less time; `None` if rates alone cannot be judged.
    pub rates: Option<Transfer>,
}

/// Properties of a sensor that a control loop needs in advance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Description {
    /// Units of a count.
    pub scale: Scale,
    /// It has a magnetometer.
    pub has_mag: bool,
    /// Lag of the gyroscope's filter, as of a first-order filter, s.
    pub gyr_lag_s: f32,
    /// An acceleration beyond this clips, counts.
    pub acc_range: u16,
    /// Rates beyond this clip, counts.
    pub gyr_range: u16,
    /// Time between two refreshes, us. [`Refresh`] measures it unless the sensor refreshes faster
    /// than any loop reads.
    pub refresh_us: u32,
    /// Payload of a whole burst, bytes.
    pub burst_bytes: u32,
    /// Payload in front of the rates, bytes.
    pub rates_at: u32,
    /// How long the sensor stretches the clock in each byte, us.
    pub stretch_us: u32,
    /// How much longer than planned a burst may take, us.
    pub reserve_us: u32,
}

/// An inertial sensor, without its bus.
pub trait Imu {
    /// The task now. Without a report in between, the next call gives the same answer.
    fn next(&mut self, now: Micros) -> Next;

    /// Takes the outcome of the transfer from [`next`](Self::next): the bytes read, none for a
    /// write.
    fn complete(&mut self, now: Micros, outcome: Transferred<'_>);

    /// Whether the sensor is set up and gives samples.
    fn is_sampling(&self) -> bool;

    /// The transfers for the next tick.
    fn bursts(&self) -> Bursts;

    /// Takes the outcome of a burst that started at `time`. For a burst of the rates alone, `time`
    /// is the start of a whole burst that would read the rates at the same moment.
    ///
    /// # Errors
    /// The fault that makes the data unusable. The driver recovers by itself.
    fn sample(&mut self, time: Micros, outcome: Transferred<'_>) -> Result<Sample, SensorFault>;

    /// Takes the outcome of a burst that is too late to be used. It counts for the sensor's health
    /// alone.
    fn overdue(&mut self, time: Micros, outcome: Transferred<'_>);

    /// Counts a tick without a burst, and gives the fault to report.
    fn missed(&mut self) -> SensorFault {
        let report = self.report_mut();
        report.health.count(SensorFault::Late);
        *report.fault.get_or_insert(SensorFault::Late)
    }

    /// The report of the sensor.
    fn report(&self) -> &Report;

    /// The report of the sensor, to be changed.
    fn report_mut(&mut self) -> &mut Report;

    /// See [`Report::health`].
    fn health(&self) -> &Health {
        &self.report().health
    }

    /// See [`Report::fault`].
    fn fault(&self) -> Option<SensorFault> {
        self.report().fault
    }

    /// See [`Report::refresh`].
    fn refresh(&self) -> &Refresh {
        &self.report().refresh
    }
}
