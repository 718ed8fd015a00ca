//! The sensor's bus, a servo's pulses and a delay as the traits of embedded-hal, for drivers that
//! others wrote. The flight uses none of them: its bus works in interrupts.

use embedded_hal::delay::DelayNs;
use embedded_hal::i2c::{ErrorKind, ErrorType, I2c, NoAcknowledgeSource, Operation};
use embedded_hal::pwm::{self, SetDutyCycle};
use tvc_imu::{BusError, Bytes, READ_MAX, Transfer};
use tvc_nano::servo::PulseUs;

use super::i2c::Bus;
use super::{frame, time, watchdog};

/// Waits, busy. The watchdog is held off meanwhile.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Delay;

impl DelayNs for Delay {
    fn delay_ns(&mut self, ns: u32) {
        const PART_US: u32 = 10_000;
        let mut left_us = ns.div_ceil(1_000);
        while left_us > 0 {
            let us = left_us.min(PART_US);
            time::delay_us(us);
            watchdog::hold_off();
            left_us -= us;
        }
    }
}

impl ErrorType for Bus {
    type Error = ErrorKind;
}

/// For devices with registers: a write begins with a register's number, and so does a read, behind
/// which comes a repeated start. Longer and other transactions end in [`ErrorKind::Other`]. Each
/// transfer has the bus's deadline.
impl I2c for Bus {
    fn transaction(
        &mut self,
        address: u8,
        operations: &mut [Operation<'_>],
    ) -> Result<(), ErrorKind> {
        match operations {
            [Operation::Write([register, bytes @ ..])] => {
                let bytes = Bytes::from_slice(bytes).ok_or(ErrorKind::Other)?;
                let register = *register;
                self.transfer(address, Transfer::Write { register, bytes })
            }
            [Operation::Write([register]), Operation::Read(place)]
                if (1..=READ_MAX).contains(&place.len()) =>
            {
                self.transfer(address, Transfer::read(*register, place.len() as u8))?;
                for (to, from) in place.iter_mut().zip(self.answer()) {
                    *to = *from;
                }
                Ok(())
            }
            _ => Err(ErrorKind::Other),
        }
    }
}

impl Bus {
    /// Carries out a transfer, and waits for its STOP.
    fn transfer(&mut self, address: u8, transfer: Transfer) -> Result<(), ErrorKind> {
        self.begin(address, &transfer);
        // A transfer that is late is given up in here.
        let over = loop {
            if let Some(over) = self.poll(time::now(), None) {
                break over;
            }
        };
        self.await_stop(&over, None);
        over.outcome.result.map_err(|error| match error {
            BusError::Nak => ErrorKind::NoAcknowledge(NoAcknowledgeSource::Unknown),
            BusError::Arbitration => ErrorKind::ArbitrationLoss,
            BusError::Protocol => ErrorKind::Bus,
            BusError::Timeout | BusError::Stuck => ErrorKind::Other,
        })
    }
}

/// The pulses of the first servo. A duty cycle is the pulse's length in microseconds.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ServoPulse;

impl pwm::ErrorType for ServoPulse {
    type Error = pwm::ErrorKind;
}

impl SetDutyCycle for ServoPulse {
    fn max_duty_cycle(&self) -> u16 {
        frame::length_us()
    }

    fn set_duty_cycle(&mut self, duty: u16) -> Result<(), pwm::ErrorKind> {
        if frame::send(PulseUs(duty)) { Ok(()) } else { Err(pwm::ErrorKind::Other) }
    }
}
