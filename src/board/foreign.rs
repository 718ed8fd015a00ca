//! A driver that others wrote, on this board: it reads the sensor's temperature, and the first
//! servo's pulses show it. It is an example of what the [traits](crate::samd21::traits) are for.

use bno055::{BNO055OperationMode, Bno055};
use embedded_hal::delay::DelayNs;
use embedded_hal::pwm::SetDutyCycle;

use crate::samd21::frame;
use crate::samd21::i2c::Bus;
use crate::samd21::traits::{Delay, ServoPulse};

/// The sensor starts for so long behind power-on (data sheet, table 0-2).
const START_UP_MS: u32 = 850;
/// The pulse of 0 degrees Celsius, us; each degree adds one.
const ZERO_US: u16 = 1_500;
const SHOWN_MS: u32 = 200;

/// Shows the temperature, if the sensor answers, and gives the bus back.
pub(crate) fn show(mut bus: Bus) -> Bus {
    let _ = show_on(&mut bus);
    bus
}

fn show_on(bus: &mut Bus) -> Option<()> {
    Delay.delay_ms(START_UP_MS);
    // 0x28, where COM3 is low.
    let mut sensor = Bno055::new(bus).with_alternative_address();
    sensor.init(&mut Delay).ok()?;
    sensor.set_mode(BNO055OperationMode::AMG, &mut Delay).ok()?;
    let celsius = sensor.temperature().ok()?;
    ServoPulse.set_duty_cycle(ZERO_US.saturating_add_signed(celsius.into())).ok()?;
    Delay.delay_ms(SHOWN_MS);
    frame::force_neutral();
    Some(())
}
