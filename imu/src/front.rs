//! The source of both front ends, which differ by `.await` only.

use crate::{Micros, Next};

/// Longest wait of a front end for a sensor: the slowest boot, a crystal, a self-test and a set-up.
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

macro_rules! front_end {
    ($I2c:path, $DelayNs:path, $hal:ident, [$($async:tt)?], [$($await:tt)*]) => {
        use $hal::i2c::{Error as _, ErrorKind};
        use $I2c as I2c;
        use $DelayNs as DelayNs;

        use crate::front::{BURST_MAX, TIMEOUT_US, TURNS_MAX, pause};
        use crate::{
            BusError, Imu, Micros, Next, READ_MAX, Sample, SensorFault, Transfer, Transferred,
            WRITE_MAX,
        };

        /// A sensor on a bus: its driver with the bus, a delay and a clock.
        ///
        /// `clock` gives the time in microseconds; it stamps the samples and paces the set-up. The
        /// bus needs a deadline for a transfer, best
        /// [`TRANSFER_DEADLINE_US`](crate::TRANSFER_DEADLINE_US): a bus that waits for ever blocks
        /// the driver for ever.
        #[derive(Debug)]
        pub struct Device<I2C: I2c, D, C, T> {
            i2c: I2C,
            delay: D,
            clock: C,
            driver: T,
            bus_error: Option<I2C::Error>,
        }

        impl<I2C: I2c, D: DelayNs, C: FnMut() -> Micros, T: Imu> Device<I2C, D, C, T> {
            /// The sensor of a driver, still without a transfer.
            pub fn new(i2c: I2C, delay: D, clock: C, driver: T) -> Self {
                Self { i2c, delay, clock, driver, bus_error: None }
            }

            /// Waits until the sensor samples.
            ///
            /// # Errors
            /// The fault, once it is certain. The next call, or [`sample`](Self::sample), tries
            /// again.
            pub $($async)? fn start(&mut self) -> Result<(), SensorFault> {
                self.drive(T::is_sampling) $($await)*
            }

            /// Takes a sample, and does the driver's transfers before and after it.
            ///
            /// # Errors
            /// The reason for a missing sample. Each call does one part of the set-up of a lost
            /// sensor, without waiting: go on calling at your own pace.
            pub $($async)? fn sample(&mut self) -> Result<Sample, SensorFault> {
                self.errands() $($await)*;
                let mut buffer = [0; READ_MAX];
                let Some(whole) = self.driver.bursts().whole else {
                    return Err(self.driver.report().cause());
                };
                let (time, outcome) = self.burst(whole, &mut buffer) $($await)*?;
                let sample = self.driver.sample(time, outcome);
                self.errands() $($await)*;
                sample
            }

            /// The driver underneath.
            pub fn driver(&self) -> &T {
                &self.driver
            }

            /// The driver underneath, for its own calls.
            pub fn driver_mut(&mut self) -> &mut T {
                &mut self.driver
            }

            /// The bus' own error of the last transfer that failed; given once.
            pub fn bus_error(&mut self) -> Option<I2C::Error> {
                self.bus_error.take()
            }

            /// Gives bus, delay and clock back; the sensor keeps running.
            pub fn release(self) -> (I2C, D, C) {
                (self.i2c, self.delay, self.clock)
            }

            /// Does the driver's tasks until it is `finished`, fails for certain, or takes too
            /// long.
            ///
            /// # Errors
            /// The driver's fault.
            pub $($async)? fn drive(&mut self, finished: impl Fn(&T) -> bool) -> Result<(), SensorFault> {
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
                Err(self.driver.report().cause())
            }

            /// Does the driver's tasks until it needs to wait.
            pub $($async)? fn errands(&mut self) {
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

            /// Start and outcome of a burst.
            ///
            /// # Errors
            /// The driver's fault, if the sensor does not sample.
            pub $($async)? fn burst<'b>(
                &mut self,
                transfer: Transfer,
                buffer: &'b mut [u8; READ_MAX],
            ) -> Result<(Micros, Transferred<'b>), SensorFault> {
                if !self.driver.is_sampling() {
                    return Err(self.driver.report().cause());
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
                let address = self.driver.bursts().address;
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
