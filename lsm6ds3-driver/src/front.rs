//! The source of both front ends, which differ by `.await` only.

macro_rules! front_end {
    ($I2c:path, $DelayNs:path, $Device:path, [$($async:tt)?], [$($await:tt)*]) => {
        use $I2c as I2c;
        use $DelayNs as DelayNs;
        use $Device as Device;

        use tvc_imu::{Imu, Micros, RawSample, SensorFault};

        use crate::config::Config;
        use crate::driver::Driver;
        use crate::self_test::SelfTest;

        /// A chip of the family on a bus.
        ///
        /// `clock` gives the time in microseconds; it stamps the samples and paces the set-up. The
        /// bus needs a deadline for a transfer, best
        /// [`TRANSFER_DEADLINE_US`](crate::TRANSFER_DEADLINE_US): a bus that waits for ever blocks
        /// the driver for ever.
        #[derive(Debug)]
        pub struct Lsm6ds3<I2C: I2c, D, C> {
            device: Device<I2C, D, C, Driver>,
        }

        impl<I2C: I2c, D: DelayNs, C: FnMut() -> Micros> Lsm6ds3<I2C, D, C> {
            /// A driver that will set the chip up by `config`, still without a transfer.
            pub fn new(i2c: I2C, delay: D, clock: C, config: Config) -> Self {
                Self { device: Device::new(i2c, delay, clock, Driver::new(config)) }
            }

            /// Waits until the chip samples: about 0.1 s.
            ///
            /// # Errors
            /// The fault, once it is certain. The next call, or [`sample`](Self::sample), tries
            /// again.
            pub $($async)? fn start(&mut self) -> Result<(), SensorFault> {
                self.device.start() $($await)*
            }

            /// Takes a sample, and verifies the control registers after it.
            ///
            /// # Errors
            /// The reason for a missing sample. Each call does one part of the set-up of a lost
            /// chip, without waiting: go on calling at your own pace.
            pub $($async)? fn sample(&mut self) -> Result<RawSample, SensorFault> {
                self.device.sample() $($await)*.map(|sample| sample.raw)
            }

            /// Runs the built-in self-test of a chip at rest; sampling pauses for 1.3 s.
            ///
            /// # Errors
            /// The reason for a missing answer. A failed test is an answer.
            pub $($async)? fn self_test(&mut self) -> Result<SelfTest, SensorFault> {
                self.device.driver_mut().begin_self_test();
                self.device.drive(|driver| driver.is_sampling()) $($await)*?;
                self.driver().self_test().ok_or(SensorFault::Protocol)
            }

            /// Sets the chip up with other settings, and waits until it samples.
            ///
            /// # Errors
            /// As of [`start`](Self::start).
            pub $($async)? fn reconfigure(&mut self, config: Config) -> Result<(), SensorFault> {
                self.device.driver_mut().reconfigure(config);
                self.start() $($await)*
            }

            /// The driver underneath: its fault, counters, settings, temperature and chip.
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
        }
    };
}
pub(crate) use front_end;
