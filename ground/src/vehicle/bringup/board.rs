//! The rows about the chip: who it is, its clocks, its supply, its memories.

use std::time::Duration;

use anyhow::Result;
use client::client::ANSWER;
use client::{BoardValue, request};
use tvc_nano::bringup::words::*;
use tvc_nano::bringup::{Pulse, What};

use super::row::{Row, checks};
use super::session::{Heard, REPEATED, Session};

checks! {
    CHIP "chip": "another chip than the Nano 33 IoT's: check which board it is";
    FUSES "fuses":
        "a watchdog that is always on resets the board for ever, and a protected bootloader \
         cannot be replaced: write the user row as Arduino ships it, by a debug probe";
    BOOTLOADER "bootloader":
        "with UF2 use `tvc flash --uf2`; with none only a debug probe writes the next image";
    CLOCK "clock":
        "the processor's clock does not follow USB: all times are wrong by that much. Try another \
         port or cable";
    FREE_CLOCK "free clock":
        "the clock is off by that much without USB, as on most boards without a crystal; keep the \
         cable in, or save the parameters once USB has corrected it";
    SLOW_CLOCK "slow clock":
        "the watchdog's times change by as much; beyond these limits the chip is faulty";
    SUPPLY "supply":
        "the brown-out detector is off or sees too low a voltage: measure 3.3 V at the pin, take \
         another cable";
    LINES "bus lines":
        "a line of the sensor's bus stays low: look for a short, a missing pull-up or a sensor \
         without power";
    SERVO "servo pulse":
        "no pulse: put a jumper from D3 to D2; another length: the timer or its clock is wrong. \
         Connect no servo before this passes";
    FLASH "flash":
        "flash that takes longer than the data sheet allows may be worn or starved of voltage, \
         and the watchdog counts meanwhile";
    ENGINE "crc engine":
        "the DSU's engine is slow or wrong, so the core reads the image: that costs a fifth of \
         its time and is as safe. Report it with this table";
    STACK "stack": "little is left of the stack: report it with this table";
}

/// Of [`CLOCK_STATUS`]: the DFLL runs right, and the voltage is below the brown-out detector's.
const DFLL_READY: u32 = 1 << 4;
const BROWNED_OUT: u32 = 1 << 10;

/// Chip, serial number, fuses, bootloader.
///
/// # Errors
/// The vehicle no longer answers.
pub fn identity(session: &mut Session) -> Result<Vec<Row>> {
    let id = session.peek(DEVICE_ID)?;
    let mut serial = String::new();
    for address in SERIAL {
        serial += &format!("{:08x}", session.peek(address)?);
    }
    let cause = match session.peek(RESET_CAUSE)? as u8 {
        0x01 => "power-on",
        0x02 | 0x04 => "brown-out",
        0x10 => "reset button",
        0x20 => "watchdog",
        0x40 => "software",
        _ => "unknown",
    };
    // Everything but die and revision.
    let known = id & 0xFFFF_00FF == 0x1001_0005;
    let revision = char::from(b'A' + (id >> 8 & 0xF) as u8);
    let name = if known { "SAMD21G18A" } else { "unknown" };
    let found =
        format!("{name} ({id:#010x}), revision {revision}, serial {serial}, last reset {cause}");
    let chip = CHIP.of("SAMD21G18A", found, known);

    let fuses = session.peek(USER_ROW)?;
    let (protected, always) = (fuses & 7, fuses >> 25 & 3);
    let fuses = FUSES.of(
        "bootloader open (7), watchdog off (0)",
        format!("bootloader {protected}, watchdog {always}, user row {fuses:#010x}"),
        (protected, always) == (7, 0),
    );
    let bootloader =
        BOOTLOADER.of("Arduino", bootloader(session)?, session.peek(ARDUINO_AT)? == ARDUINO);
    Ok(vec![chip, fuses, bootloader])
}

/// By the word that it looks for in RAM, which its program holds.
fn bootloader(session: &mut Session) -> Result<&'static str> {
    if session.peek(ARDUINO_AT)? == ARDUINO {
        return Ok("Arduino");
    }
    for address in (0..BOOTLOADER_END).step_by(4) {
        match session.peek(address)? {
            UF2 => return Ok("UF2"),
            ARDUINO => return Ok("Arduino, another version"),
            _ => {}
        }
    }
    Ok("none that is known")
}

/// The clocks, while the vehicle's messages are listened to for some seconds.
///
/// # Errors
/// The vehicle no longer answers.
pub fn clocks(session: &mut Session) -> Result<Vec<Row>> {
    const WHILE: Duration = Duration::from_millis(3_500);
    session.measure(What::Count)?;
    session.listen(Duration::from_millis(50))?;
    session.heard = Heard::default();
    let slow_from = session.peek_at(SLOW_COUNT)?;
    let (mut points, mut frames) = (Vec::new(), 0_i64);
    let mut last: Option<BoardValue> = None;
    let until = session.now() + WHILE;
    while session.now() < until {
        let told = session.peek_at(USB_FRAME)?;
        if let Some(before) = last.replace(told) {
            frames += passed_ms(before, told) + lost_ms(before, told);
        }
        points.push((f64::from(told.time_ms), frames as f64));
        session.listen(Duration::from_millis(15))?;
    }
    let slow_to = session.peek_at(SLOW_COUNT)?;
    let rate = 1000.0 * slope(&points);
    let locked = session.peek(CLOCK_STATUS)? & DFLL_READY != 0;
    let clock = CLOCK.of(
        "999.5 to 1000.5 frames of USB a second, DFLL ready",
        format!("{rate:.2}, DFLL {}", if locked { "ready" } else { "not ready" }),
        locked && (rate - 1000.0).abs() <= 0.5,
    );
    // The first look has the register brought up to date.
    session.peek(DFLL_VALUE)?;
    let fine = session.peek(DFLL_VALUE)? & 0x3FF;
    // 0.023 % a step, an estimate.
    let percent = (511.0 - f64::from(fine)) * 0.023;
    let free = FREE_CLOCK.of(
        "FINE 467 to 555 (within 1 %)",
        format!("FINE {fine} (about {percent:+.1} %)"),
        (467..=555).contains(&fine),
    );
    let counted = (slow_to.value & 0xFFFF).wrapping_sub(slow_from.value & 0xFFFF) & 0xFFFF;
    let ratio = f64::from(counted) / 1.024 / passed_ms(slow_from, slow_to).max(1) as f64;
    let slow = SLOW_CLOCK.within(ratio, 0.87..=1.25, "of 32,768 Hz");
    Ok(vec![clock, free, slow])
}

/// Least squares: dy/dx.
fn slope(points: &[(f64, f64)]) -> f64 {
    let n = points.len().max(1) as f64;
    let mean = |of: fn(&(f64, f64)) -> f64| points.iter().map(of).sum::<f64>() / n;
    let (x0, y0) = (mean(|p| p.0), mean(|p| p.1));
    let sum = |of: &dyn Fn(&(f64, f64)) -> f64| points.iter().map(of).sum::<f64>();
    sum(&|p| (p.0 - x0) * (p.1 - y0)) / sum(&|p| (p.0 - x0).powi(2))
}

/// Brown-out detector and the levels of the sensor's bus.
///
/// # Errors
/// The vehicle no longer answers.
pub fn levels(session: &mut Session) -> Result<Vec<Row>> {
    let bod = session.peek(BROWN_OUT)?;
    let low = session.peek(CLOCK_STATUS)? & BROWNED_OUT != 0;
    let (enabled, level) = (bod & 2 != 0, bod >> 16 & 0x3F);
    let supply = SUPPLY.of(
        "detector on, level 37 or more, voltage above it",
        format!(
            "{}, level {level}, voltage {}",
            if enabled { "on" } else { "off" },
            if low { "below it" } else { "above it" }
        ),
        enabled && level >= 37 && !low,
    );
    let mut high = 0;
    for _ in 0..40 {
        high |= session.peek(PORT_IN)? >> 8 & 3;
        session.listen(Duration::from_millis(1))?;
    }
    let name = |bit: u32| {
        if high >> bit & 1 == 1 { "high at times" } else { "always low" }
    };
    let lines =
        LINES.of("both high at times", format!("SDA {}, SCL {}", name(0), name(1)), high == 3);
    Ok(vec![supply, lines])
}

/// The servo's pulse by the jumper.
///
/// # Errors
/// The vehicle no longer answers.
pub fn servo(session: &mut Session) -> Result<Row> {
    const EXPECTED: &str = "the neutral pulse +-4 us, frames of SRV_RATE_HZ +-5 us";
    let neutral = session.parameter("SRV_CENTRE_US")?.unwrap_or(1523.0);
    let rate = session.parameter("SRV_RATE_HZ")?.unwrap_or(50.0);
    let mut pulses = Vec::new();
    for _ in 0..9 {
        match session.measure(What::Pulse)? {
            Some(word) => pulses.push(Pulse::of(word)),
            None => return Ok(SERVO.failed(EXPECTED, "no pulse at D2")),
        }
        session.listen(Duration::from_millis(40))?;
    }
    let frame_us = 1e6 / f64::from(rate);
    let mut widths: Vec<u32> = pulses.iter().map(|pulse| pulse.width_us).collect();
    widths.sort_unstable();
    let width = f64::from(widths[widths.len() / 2]);
    let mut frames: Vec<f64> = pulses
        .windows(2)
        .map(|pair| {
            let apart = f64::from(pair[1].rise_us.wrapping_sub(pair[0].rise_us) & 0xF_FFFF);
            apart / (apart / frame_us).round().max(1.0)
        })
        .collect();
    frames.sort_by(f64::total_cmp);
    let frame = frames[frames.len() / 2];
    Ok(SERVO.of(
        EXPECTED,
        format!("{width:.0} us every {frame:.0} us"),
        (width - f64::from(neutral)).abs() <= 4.0 && (frame - frame_us).abs() <= 5.0,
    ))
}

/// Whether the DSU's engine reads the image, and how long it takes.
///
/// # Errors
/// The vehicle no longer answers.
pub fn engine(session: &mut Session) -> Result<Row> {
    const EXPECTED: &str = "right, the image within 10 ms";
    Ok(match session.measure(What::Image)? {
        Some(0) | None => ENGINE.of(EXPECTED, "the core reads the image", false),
        Some(us) => {
            let ms = f64::from(us) / 1e3;
            ENGINE.of(EXPECTED, format!("right, the image in {ms:.1} ms"), ms <= 10.0)
        }
    })
}

/// How long the processor stands still while the parameters are saved: the time that USB's frames
/// count and the processor's does not.
///
/// # Errors
/// The vehicle no longer answers.
pub fn flash(session: &mut Session) -> Result<Row> {
    /// Saves that are tried: each wears the flash.
    const TRIES: u32 = 4;
    let mut tries = 0;
    let (before, after) = loop {
        tries += 1;
        let before = session.peek_at(USB_FRAME)?;
        let begun = session.now();
        if let Err(failure) = session.order(request::SAVE)? {
            return Ok(FLASH.failed("saves the parameters", failure));
        }
        // An order that was repeated may have been obeyed twice.
        if session.now() - begun < REPEATED || tries == TRIES {
            break (before, session.peek_at(USB_FRAME)?);
        }
        // Until then an answer may be taken for that of the one that was lost.
        session.listen(ANSWER)?;
    };
    let lost = lost_ms(before, after) as f64;
    Ok(FLASH.within(lost, LOST_MS, "ms of the processor's time lost"))
}

/// By the processor's clock; below zero where a reset has begun it anew.
fn passed_ms(before: BoardValue, after: BoardValue) -> i64 {
    i64::from(after.time_ms) - i64::from(before.time_ms)
}

/// Frames of USB, each a millisecond, beyond those that the processor's clock has counted between
/// two looks at [`USB_FRAME`]. The number has 11 bits, which come round every two seconds.
fn lost_ms(before: BoardValue, after: BoardValue) -> i64 {
    let number = |look: BoardValue| i64::from(look.value >> 3 & 0x7FF);
    (number(after) - number(before) - passed_ms(before, after) + 1024).rem_euclid(2048) - 1024
}

/// Of a save at the data sheet's longest times, less what SysTick still counts.
const LOST_MS: std::ops::RangeInclusive<f64> = 0.0..=60.0;

/// How deep the stack has been, by the paint that it has left.
///
/// # Errors
/// The vehicle no longer answers.
pub fn stack(session: &mut Session) -> Result<Row> {
    /// Well below what the stack may ever need.
    const DEEPEST: u32 = RAM + 0x5000;
    let (mut low, mut high) = (DEEPEST, STACK_TOP);
    if session.peek(low)? != STACK_PAINT {
        return Ok(STACK.failed("paint at 0x20005000", "none: more than 10 KB were used"));
    }
    while high - low > 4 {
        let middle = (low + (high - low) / 2) & !3;
        if session.peek(middle)? == STACK_PAINT {
            low = middle;
        } else {
            high = middle;
        }
    }
    // What was skipped by a function's large frame may still lie below.
    let mut clean = 0;
    while clean < 64 && low > DEEPEST {
        low -= 4;
        clean += 1;
        if session.peek(low)? != STACK_PAINT {
            (high, clean) = (low, 0);
        }
    }
    let used = f64::from(STACK_TOP - high) / 1024.0;
    Ok(STACK.within(used, 0.0..=9.0, "KB used"))
}
