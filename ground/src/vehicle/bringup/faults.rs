//! The rows about the link, and about the two ways in which a program can fail.

use anyhow::Result;
use client::{LatchKind, StateCode, StateKind, request};
use std::time::Duration;
use tvc_nano::bringup::{What, words};

use super::row::{Check, Row, checks};
use super::session::{REPEATED, Session};

checks! {
    USB "usb": "frames are lost on their way: take another cable, port or hub";
    CRASH "crash record": "a crash leaves no trace: report it with this table";
    WATCHDOG "watchdog":
        "a program that hangs is not ended: do not fly. Press the reset button to go on";
}

/// Words in a row as a loop-back, with what was lost since the start.
///
/// # Errors
/// The vehicle no longer answers.
pub fn usb(session: &mut Session) -> Result<Row> {
    const WORDS: u32 = 300;
    let (mut longest, mut repeated) = (Duration::ZERO, 0);
    for index in 0..WORDS {
        let begun = session.now();
        session.peek(words::RAM + 4 * index)?;
        let took = session.now() - begun;
        longest = longest.max(took);
        repeated += u32::from(took >= REPEATED);
    }
    let counts = session.link.client().counts();
    Ok(USB.of(
        "nothing lost",
        format!(
            "{} of {} frames lost, {} damaged, {repeated} of {WORDS} answers late, longest {} ms",
            counts.lost,
            counts.messages,
            counts.crc_errors,
            longest.as_millis()
        ),
        counts.lost == 0 && counts.crc_errors == 0 && repeated == 0,
    ))
}

/// Fails its self-check on purpose: the next start tells so.
///
/// # Errors
/// The rig stopped.
pub fn crash(session: &mut Session) -> Result<Row> {
    const EXPECTED: &str = "\"self-check failed: ordered\" after the reset";
    fall(session, What::FailCheck, CRASH, EXPECTED, LatchKind::SelfCheck)
}

/// Hangs on purpose: the watchdog ends it.
///
/// # Errors
/// The rig stopped.
pub fn watchdog(session: &mut Session) -> Result<Row> {
    const EXPECTED: &str = "on; \"watchdog reset\" after a program that hangs";
    let control = session.peek(words::WATCHDOG)?;
    if control & 2 == 0 {
        return Ok(WATCHDOG.failed(EXPECTED, "it is off"));
    }
    fall(session, What::Hang, WATCHDOG, EXPECTED, LatchKind::Watchdog)
}

/// Gives an order that ends in a reset, and looks at what the vehicle latches. That is acknowledged
/// by disarming, so that the vehicle is as it was.
fn fall(
    session: &mut Session,
    order: What,
    check: Check,
    expected: &str,
    latch: LatchKind,
) -> Result<Row> {
    let back = session.fall(order)?;
    let said = session.reason();
    let row = if !back {
        check.failed(expected, "the vehicle did not come back by itself")
    } else if session.state_code() == Some(StateCode::Latched(latch)) {
        check.of(expected, said, true)
    } else {
        check.failed(expected, format!("it said \"{said}\""))
    };
    if session.state() == Some(StateKind::Latched) {
        let _ = session.order(request::DISARM)?;
        session
            .wait(Duration::from_secs(2), |session| session.state() != Some(StateKind::Latched))?;
    }
    Ok(row)
}
