//! The driver as the firmware calls one of any sensor.

use tvc_imu::{Bursts, BusError, Imu, Micros, Next, Refresh, Sample, SensorFault};

use super::Driver;

impl Imu for Driver {
    fn next(&mut self, now: Micros) -> Next {
        Driver::next(self, now)
    }

    fn complete(&mut self, now: Micros, outcome: Result<&[u8], BusError>) {
        Driver::complete(self, now, outcome);
    }

    fn is_sampling(&self) -> bool {
        Driver::is_sampling(self)
    }

    fn bursts(&self) -> Bursts {
        Bursts {
            address: self.config.address.value(),
            whole: Driver::is_sampling(self).then(|| self.burst()),
            rates: self.rates_burst(),
        }
    }

    fn sample(
        &mut self,
        time: Micros,
        outcome: Result<&[u8], BusError>,
    ) -> Result<Sample, SensorFault> {
        Driver::sample(self, time, outcome)
    }

    fn overdue(&mut self, time: Micros, outcome: Result<&[u8], BusError>) {
        // What it says of the chip's health has been counted.
        let _ = Driver::overdue(self, time, outcome);
    }

    fn missed(&mut self) -> SensorFault {
        Driver::missed(self)
    }

    fn fresh(&self) -> u32 {
        self.health.fresh
    }

    fn refresh(&self) -> &Refresh {
        &self.refresh
    }
}
