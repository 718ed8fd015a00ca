//! The source of both front ends, which differ by `.await` only.

/// The content of an answer of this kind.
macro_rules! the {
    ($kind:ident, $answer:expr) => {
        match $answer {
            Answer::$kind(it) => Ok(it),
            _ => Err(SensorFault::Protocol),
        }
    };
}
pub(crate) use the;

macro_rules! front_end {
    ($I2c:path, $DelayNs:path, $Device:path, [$($async:tt)?], [$($await:tt)*]) => {
        use $I2c as I2c;
        use $DelayNs as DelayNs;
        use $Device as Device;

        use tvc_imu::{Micros, READ_MAX, RawSample, SensorFault};

        use crate::config::Config;
        use crate::driver::Driver;
        use crate::front::the;
        use crate::fusion::FusionSample;
        use crate::profile::{Profile, SoftIron};
        use crate::request::{Answer, Request};
        use crate::status::{CalibrationStatus, SelfTest, SystemError, SystemStatus};

        /// A BNO055 on a bus.
        ///
        /// `clock` gives the time in microseconds; it stamps the samples and paces the set-up. The
        /// bus needs a deadline for a transfer, best
        /// [`TRANSFER_DEADLINE_US`](crate::TRANSFER_DEADLINE_US): a bus that waits for ever blocks
        /// the driver for ever.
        #[derive(Debug)]
        pub struct Bno055<I2C: I2c, D, C> {
            device: Device<I2C, D, C, Driver>,
        }

        impl<I2C: I2c, D: DelayNs, C: FnMut() -> Micros> Bno055<I2C, D, C> {
            /// A driver that will set the chip up by `config`, still without a transfer.
            pub fn new(i2c: I2C, delay: D, clock: C, config: Config) -> Self {
                Self { device: Device::new(i2c, delay, clock, Driver::new(config)) }
            }

            /// Waits until the chip samples: about 0.1 s for a running chip, 0.8 s after power-on.
            ///
            /// # Errors
            /// The fault, once it is certain. The next call, or [`sample`](Self::sample), tries
            /// again.
            pub $($async)? fn start(&mut self) -> Result<(), SensorFault> {
                self.device.start() $($await)*
            }

            /// Takes a sample, and verifies one register after it.
            ///
            /// # Errors
            /// The reason for a missing sample. Each call does one part of the set-up of a lost
            /// chip, without waiting: go on calling at your own pace.
            pub $($async)? fn sample(&mut self) -> Result<RawSample, SensorFault> {
                self.device.sample() $($await)*.map(|sample| sample.raw)
            }

            /// Reads the fusion outputs, in fusion modes, and verifies one register after it.
            ///
            /// # Errors
            /// As of [`sample`](Self::sample).
            pub $($async)? fn fusion(&mut self) -> Result<FusionSample, SensorFault> {
                self.device.errands() $($await)*;
                let mut buffer = [0; READ_MAX];
                let burst = self.driver().fusion_burst();
                let (time, outcome) = self.device.burst(burst, &mut buffer) $($await)*?;
                let sample = self.device.driver_mut().fusion(time, outcome);
                self.device.errands() $($await)*;
                sample
            }

            /// Reads the temperature in degrees Celsius.
            ///
            /// # Errors
            /// The reason for a missing answer.
            pub $($async)? fn temperature(&mut self) -> Result<f32, SensorFault> {
                let count = the!(Temperature, self.ask(Request::Temperature) $($await)*?)?;
                Ok(self.driver().config().units.celsius(count))
            }

            /// Reads how far the chip's fusion has calibrated itself.
            ///
            /// # Errors
            /// The reason for a missing answer.
            pub $($async)? fn calibration_status(&mut self) -> Result<CalibrationStatus, SensorFault> {
                the!(CalibrationStatus, self.ask(Request::CalibrationStatus) $($await)*?)
            }

            /// Reads the status of the chip and, for [`SystemStatus::Error`], the error.
            ///
            /// # Errors
            /// The reason for a missing answer.
            pub $($async)? fn system_status(&mut self) -> Result<(SystemStatus, SystemError), SensorFault> {
                match self.ask(Request::SystemStatus) $($await)*? {
                    Answer::SystemStatus(status, error) => Ok((status, error)),
                    _ => Err(SensorFault::Protocol),
                }
            }

            /// Reads the calibration profile; sampling pauses for about 0.1 s.
            ///
            /// # Errors
            /// The reason for a missing answer.
            pub $($async)? fn profile(&mut self) -> Result<Profile, SensorFault> {
                the!(Profile, self.ask(Request::Profile) $($await)*?)
            }

            /// Reads the soft-iron matrix; sampling pauses for about 0.1 s.
            ///
            /// # Errors
            /// The reason for a missing answer.
            pub $($async)? fn soft_iron(&mut self) -> Result<SoftIron, SensorFault> {
                the!(SoftIron, self.ask(Request::SoftIron) $($await)*?)
            }

            /// Runs the built-in self-test; sampling pauses for about 0.5 s.
            ///
            /// # Errors
            /// The reason for a missing answer. A failed test is an answer.
            pub $($async)? fn self_test(&mut self) -> Result<SelfTest, SensorFault> {
                the!(SelfTest, self.ask(Request::SelfTest) $($await)*?)
            }

            /// Sets the chip up with other settings, and waits until it samples.
            ///
            /// # Errors
            /// As of [`start`](Self::start).
            pub $($async)? fn reconfigure(&mut self, config: Config) -> Result<(), SensorFault> {
                self.device.driver_mut().reconfigure(config);
                self.start() $($await)*
            }

            /// Puts the chip into its suspend mode.
            ///
            /// # Errors
            /// The reason for a missing answer.
            pub $($async)? fn suspend(&mut self) -> Result<(), SensorFault> {
                self.device.driver_mut().suspend();
                self.device.drive(Driver::is_suspended) $($await)*
            }

            /// Sets a suspended chip up again, and waits until it samples.
            ///
            /// # Errors
            /// As of [`start`](Self::start).
            pub $($async)? fn resume(&mut self) -> Result<(), SensorFault> {
                self.device.driver_mut().resume();
                self.start() $($await)*
            }

            /// The driver underneath: its fault, counters, settings and the chip's identity.
            pub fn driver(&self) -> &Driver {
                self.device.driver()
            }

            /// The bus' own error of the last transfer that failed; given once.
            pub fn bus_error(&mut self) -> Option<I2C::Error> {
                self.device.bus_error()
            }

            /// Gives bus, delay and clock back; the chip keeps running.
            pub fn release(self) -> (I2C, D, C) {
                self.device.release()
            }

            $($async)? fn ask(&mut self, request: Request) -> Result<Answer, SensorFault> {
                self.device.driver_mut().request(request);
                let answered = |driver: &Driver| !driver.is_asking() && tvc_imu::Imu::is_sampling(driver);
                let outcome = self.device.drive(answered) $($await)*;
                self.device.driver_mut().cancel();
                match (self.device.driver_mut().answer(), outcome) {
                    (Some(answer), _) => Ok(answer),
                    (None, Err(fault)) => Err(fault),
                    (None, Ok(())) => Err(SensorFault::Protocol),
                }
            }
        }
    };
}
pub(crate) use front_end;
