//! The trait that a control loop calls.

use crate::fault::SensorFault;
use crate::refresh::Refresh;
use crate::sample::{Sample, Scale};
use crate::time::Micros;
use crate::transfer::{BusError, Transfer};

/// What the owner of the bus is to do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Next {
    /// Perform this transfer and hand its outcome to [`Imu::complete`].
    Transfer(Transfer),
    /// Nothing before this moment; [`Micros`] at its maximum while the sensor is suspended.
    Wait(Micros),
    /// Sampling: a burst may be armed for the next tick.
    Sample,
}

/// The transfers that ticks start, to a 7-bit address.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Bursts {
    /// The slave's address.
    pub address: u8,
    /// Reads all sensors; `None` while the sensor is set up.
    pub whole: Option<Transfer>,
    /// Reads the rates alone, in less time; `None` where that says nothing.
    pub rates: Option<Transfer>,
}

/// What a control loop has to know of a sensor before it has one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Description {
    /// What a count is worth.
    pub scale: Scale,
    /// Lag of the gyroscope's filter, s: that of a first-order one.
    pub gyr_lag_s: f32,
    /// An acceleration beyond this clips, counts.
    pub acc_range: u16,
    /// Rates beyond this clip, counts.
    pub gyr_range: u16,
    /// Payload of a whole burst, bytes.
    pub burst_bytes: u32,
    /// Payload in front of the rates, bytes.
    pub rates_at: u32,
    /// How long the sensor stretches the clock in each byte, us.
    pub stretch_us: u32,
}

/// An inertial sensor, without its bus.
pub trait Imu {
    /// What to do now. Asking again without reporting gives the same answer.
    fn next(&mut self, now: Micros) -> Next;

    /// Takes the outcome of the transfer that [`next`](Self::next) gave out: the bytes read, none
    /// for a write.
    fn complete(&mut self, now: Micros, outcome: Result<&[u8], BusError>);

    /// Whether the sensor is set up and gives samples.
    fn is_sampling(&self) -> bool;

    /// What the next tick is to start.
    fn bursts(&self) -> Bursts;

    /// Takes the outcome of a burst that started at `time`; of the rates alone, the time at which a
    /// whole one would have started that reads them at the same moment.
    ///
    /// # Errors
    /// The fault for which the data are not to be used. The driver recovers by itself.
    fn sample(
        &mut self,
        time: Micros,
        outcome: Result<&[u8], BusError>,
    ) -> Result<Sample, SensorFault>;

    /// Takes the outcome of a burst that comes too late to be used: it counts for the sensor's
    /// health alone.
    fn overdue(&mut self, time: Micros, outcome: Result<&[u8], BusError>);

    /// Notes that a tick went by without its burst, and gives the fault to report for it.
    fn missed(&mut self) -> SensorFault;

    /// How many bursts had new data so far; wraps.
    fn fresh(&self) -> u32;

    /// What is known of the sensor's refreshes.
    fn refresh(&self) -> &Refresh;
}
