//! The source of both front ends, which differ by `.await` only.

use tvc_imu::{Micros, Next};

/// Longest wait of a front end for a chip: the slowest boot, a crystal, a self-test and a set-up.
pub(crate) const TIMEOUT_US: u64 = 5_000_000;
/// Most turns of a wait, for any clock.
pub(crate) const TURNS_MAX: u32 = 4_000;
/// Most transfers without a wait: more than a whole set-up between two of its pauses.
pub(crate) const BURST_MAX: u32 = 64;

/// Microseconds to wait, if any.
pub(crate) fn pause(next: Next, now: Micros) -> Option<u32> {
    match next {
        Next::Wait(until) => Some(until.since(now).min(TIMEOUT_US) as u32),
        Next::Transfer(_) | Next::Sample => None,
    }
}

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
    ($I2c:path, $DelayNs:path, $hal:ident, [$($async:tt)?], [$($await:tt)*]) => {
        use $hal::i2c::{Error as _, ErrorKind};
        use $I2c as I2c;
        use $DelayNs as DelayNs;

        use tvc_imu::{BusError, Imu, Micros, Next, READ_MAX, RawSample, SensorFault, Transfer, Transferred, WRITE_MAX};

        use crate::config::Config;
        use crate::driver::Driver;
        use crate::front::{BURST_MAX, TIMEOUT_US, TURNS_MAX, pause, the};
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
            i2c: I2C,
            delay: D,
            clock: C,
            driver: Driver,
            bus_error: Option<I2C::Error>,
        }

        impl<I2C: I2c, D: DelayNs, C: FnMut() -> Micros> Bno055<I2C, D, C> {
            /// A driver that will set the chip up by `config`, still without a transfer.
            pub fn new(i2c: I2C, delay: D, clock: C, config: Config) -> Self {
                Self { i2c, delay, clock, driver: Driver::new(config), bus_error: None }
            }

            /// Waits until the chip samples: about 0.1 s for a running chip, 0.8 s after power-on.
            ///
            /// # Errors
            /// The fault, once it is certain. The next call, or [`sample`](Self::sample), tries
            /// again.
            pub $($async)? fn start(&mut self) -> Result<(), SensorFault> {
                self.drive(Driver::is_sampling) $($await)*
            }

            /// Takes a sample, and verifies one register after it.
            ///
            /// # Errors
            /// The reason for a missing sample. Each call does one part of the set-up of a lost
            /// chip, without waiting: go on calling at your own pace.
            pub $($async)? fn sample(&mut self) -> Result<RawSample, SensorFault> {
                self.errands() $($await)*;
                let mut buffer = [0; READ_MAX];
                let (time, outcome) = self.burst(self.driver.burst(), &mut buffer) $($await)*?;
                let sample = self.driver.sample(time, outcome);
                self.errands() $($await)*;
                sample.map(|sample| sample.raw)
            }

            /// Reads the fusion outputs, in fusion modes, and verifies one register after it.
            ///
            /// # Errors
            /// As of [`sample`](Self::sample).
            pub $($async)? fn fusion(&mut self) -> Result<FusionSample, SensorFault> {
                self.errands() $($await)*;
                let mut buffer = [0; READ_MAX];
                let (time, outcome) = self.burst(self.driver.fusion_burst(), &mut buffer) $($await)*?;
                let sample = self.driver.fusion(time, outcome);
                self.errands() $($await)*;
                sample
            }

            /// Reads the temperature in degrees Celsius.
            ///
            /// # Errors
            /// The reason for a missing answer.
            pub $($async)? fn temperature(&mut self) -> Result<f32, SensorFault> {
                let count = the!(Temperature, self.ask(Request::Temperature) $($await)*?)?;
                Ok(self.driver.config().units.celsius(count))
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
                self.driver.reconfigure(config);
                self.start() $($await)*
            }

            /// Puts the chip into its suspend mode.
            ///
            /// # Errors
            /// The reason for a missing answer.
            pub $($async)? fn suspend(&mut self) -> Result<(), SensorFault> {
                self.driver.suspend();
                self.drive(Driver::is_suspended) $($await)*
            }

            /// Sets a suspended chip up again, and waits until it samples.
            ///
            /// # Errors
            /// As of [`start`](Self::start).
            pub $($async)? fn resume(&mut self) -> Result<(), SensorFault> {
                self.driver.resume();
                self.start() $($await)*
            }

            /// The driver underneath: its fault, counters, settings and the chip's identity.
            pub fn driver(&self) -> &Driver {
                &self.driver
            }

            /// The bus' own error of the last transfer that failed; given once.
            pub fn bus_error(&mut self) -> Option<I2C::Error> {
                self.bus_error.take()
            }

            /// Gives bus, delay and clock back; the chip keeps running.
            pub fn release(self) -> (I2C, D, C) {
                (self.i2c, self.delay, self.clock)
            }

            $($async)? fn ask(&mut self, request: Request) -> Result<Answer, SensorFault> {
                self.driver.request(request);
                let outcome = self.drive(|driver| !driver.is_asking() && driver.is_sampling()) $($await)*;
                self.driver.cancel();
                match (self.driver.answer(), outcome) {
                    (Some(answer), _) => Ok(answer),
                    (None, Err(fault)) => Err(fault),
                    (None, Ok(())) => Err(SensorFault::Protocol),
                }
            }

            /// Does the driver's tasks until it is `finished`, fails for certain, or takes too
            /// long.
            $($async)? fn drive(&mut self, finished: impl Fn(&Driver) -> bool) -> Result<(), SensorFault> {
                let failures = self.driver.health().failed_setups;
                let begin = (self.clock)();
                for _ in 0..TURNS_MAX {
                    if finished(&self.driver) {
                        return Ok(());
                    }
                    let now = (self.clock)();
                    if self.driver.health().failed_setups != failures || now.since(begin) > TIMEOUT_US {
                        break;
                    }
                    let next = self.driver.next(now);
                    if let Next::Transfer(transfer) = next {
                        self.perform(transfer) $($await)*;
                    } else if let Some(us) = pause(next, now) {
                        self.delay.delay_us(us) $($await)*;
                    } else {
                        break;
                    }
                }
                Err(self.driver.fault().unwrap_or(SensorFault::Booting))
            }

            /// Does the driver's tasks until it needs to wait.
            $($async)? fn errands(&mut self) {
                for _ in 0..BURST_MAX {
                    let Next::Transfer(transfer) = self.driver.next((self.clock)()) else { break };
                    self.perform(transfer) $($await)*;
                }
            }

            $($async)? fn perform(&mut self, transfer: Transfer) {
                let mut buffer = [0; READ_MAX];
                let outcome = self.transfer(transfer, &mut buffer) $($await)*;
                self.driver.complete((self.clock)(), outcome);
            }

            /// Start and outcome of a burst; an error if the chip does not sample.
            $($async)? fn burst<'b>(
                &mut self,
                transfer: Transfer,
                buffer: &'b mut [u8; READ_MAX],
            ) -> Result<(Micros, Transferred<'b>), SensorFault> {
                if !self.driver.is_sampling() {
                    return Err(self.driver.fault().unwrap_or(SensorFault::Booting));
                }
                let time = (self.clock)();
                let outcome = self.transfer(transfer, buffer) $($await)*;
                Ok((time, outcome))
            }

            $($async)? fn transfer<'b>(
                &mut self,
                transfer: Transfer,
                buffer: &'b mut [u8; READ_MAX],
            ) -> Transferred<'b> {
                let address = self.driver.config().address.value();
                let outcome = match transfer {
                    Transfer::Read { register, len } => {
                        let bytes = buffer.get_mut(..usize::from(len)).ok_or(BusError::Protocol)?;
                        self.i2c.write_read(address, &[register], bytes) $($await)*.map(|()| &*bytes)
                    }
                    Transfer::Write { register, bytes } => {
                        let mut message = [register; 1 + WRITE_MAX];
                        for (to, from) in message.iter_mut().skip(1).zip(bytes.iter()) {
                            *to = *from;
                        }
                        let message = message.get(..1 + bytes.len()).ok_or(BusError::Protocol)?;
                        self.i2c.write(address, message) $($await)*.map(|()| &[][..])
                    }
                };
                outcome.map_err(|error| {
                    let fault = match error.kind() {
                        ErrorKind::NoAcknowledge(_) => BusError::Nak,
                        ErrorKind::ArbitrationLoss => BusError::Arbitration,
                        ErrorKind::Bus => BusError::Stuck,
                        ErrorKind::Overrun => BusError::Protocol,
                        // Masters have no error kind for an abandoned transfer.
                        _ => BusError::Timeout,
                    };
                    self.bus_error = Some(error);
                    fault
                })
            }
        }
    };
}
pub(crate) use front_end;
