//! The right answers during the set-up.

use super::{Judged, SetupStep, Verdict};
use crate::config::Config;
use crate::registers as reg;
use crate::request::Request;
use crate::settings::Setting;
use crate::status::{Identity, SystemStatus};
use crate::verify;
use tvc_imu::{SensorFault, Transfer};

/// Pause before a second read of a register that does not hold the written value yet.
const READ_BACK_PAUSE_US: u64 = 5_000;
/// Longest time for a write to show. The data sheet asks for 2 us between writes, but hosts report
/// late or lost writes when they follow each other at once.
const READ_BACK_TIMEOUT_US: u64 = 50_000;

pub(super) fn identify(bytes: &[u8], config: &Config, identity: &mut Identity) -> Judged {
    let &[chip, acc, mag, gyr, low, high, bootloader, page] = bytes else {
        return Err(SensorFault::Protocol);
    };
    verify::identify([chip, acc, mag, gyr], config)?;
    if page != 0 {
        return Err(SensorFault::Configuration { register: reg::PAGE_ID, found: page });
    }
    identity.software = u16::from_le_bytes([low, high]);
    identity.bootloader = bootloader;
    Ok(Verdict::Go(SetupStep::EnterConfig, 0))
}

pub(super) fn await_mode(bytes: &[u8], mode: u8, next: SetupStep) -> Verdict {
    let found = bytes.first().map_or(u8::MAX, |found| found & 0x0F);
    if found == mode {
        return Verdict::Go(next, 0);
    }
    let fault = SensorFault::Configuration { register: reg::OPR_MODE, found };
    Verdict::Again(5_000, 100_000, fault)
}

pub(super) fn answer(request: Request, bytes: &[u8], next: SetupStep) -> Judged {
    let answer = request.decode(bytes).ok_or(SensorFault::Protocol)?;
    Ok(Verdict::Answer(answer, next))
}

pub(super) fn await_self_test(request: Request, bytes: &[u8], next: SetupStep) -> Judged {
    match *bytes {
        [result, _, _, status, _] if SystemStatus::from_register(status).is_starting() => {
            Ok(Verdict::Again(10_000, 1_000_000, SensorFault::SelfTest { result }))
        }
        _ => answer(request, bytes, next),
    }
}

pub(super) fn diagnose(bytes: &[u8], config: &Config) -> Judged {
    let &[result, _, _, status, error] = bytes else {
        return Err(SensorFault::Protocol);
    };
    match SystemStatus::from_register(status) {
        SystemStatus::Error => return Err(SensorFault::System { error }),
        status if status.is_starting() => {
            return Ok(Verdict::Again(10_000, 600_000, SensorFault::System { error }));
        }
        _ => {}
    }
    let needed = if config.needs_mag { 0x0F } else { 0x0D };
    if result & needed != needed {
        return Err(SensorFault::SelfTest { result });
    }
    let (mode, sensors) = (config.mode, &config.sensors);
    match config.profile.and_then(|profile| profile.wrong_register(mode, sensors)) {
        Some(register) => Err(SensorFault::Profile { register }),
        None => Ok(Verdict::Go(SetupStep::Write(Setting::Power), 0)),
    }
}

pub(super) fn confirm(
    setting: Setting,
    bytes: &[u8],
    config: &Config,
    identity: &mut Identity,
) -> Verdict {
    match setting.write(config) {
        Transfer::Write { register, bytes: written } => {
            for (offset, (&found, &written)) in bytes.iter().zip(written.as_slice()).enumerate() {
                if (found ^ written) & setting.mask(config, offset) != 0 {
                    let register = register.saturating_add(offset as u8);
                    let fault = SensorFault::Configuration { register, found };
                    return Verdict::Again(READ_BACK_PAUSE_US, READ_BACK_TIMEOUT_US, fault);
                }
            }
        }
        Transfer::Read { .. } => {
            if let Ok(unique_id) = bytes.try_into() {
                identity.unique_id = unique_id;
            }
        }
    }
    match setting.next(config) {
        // A register that is only read needs no write first.
        Some(next @ Setting::UniqueId) => Verdict::Go(SetupStep::Confirm(next), 0),
        Some(next) => Verdict::Go(SetupStep::Write(next), 0),
        None if config.external_crystal => Verdict::Go(SetupStep::AwaitClock, 0),
        None => Verdict::Go(SetupStep::EnterMode, 0),
    }
}

/// Waits until the clock source may be changed, for a limited time, us; then the next step follows.
pub(super) fn await_clock(bytes: &[u8], next: SetupStep, timeout_us: u64) -> Verdict {
    match bytes {
        // Bit 0 set: the clock is being configured and must be left alone.
        [status] if status & 1 == 0 => Verdict::Go(next, 0),
        _ => Verdict::Again(10_000, timeout_us, SensorFault::Clock),
    }
}

pub(super) fn await_running(bytes: &[u8], config: &Config) -> Judged {
    let &[status, error] = bytes else {
        return Err(SensorFault::Protocol);
    };
    let fault = SensorFault::System { error };
    match SystemStatus::from_register(status) {
        SystemStatus::Error => Err(fault),
        status if status == config.mode.status() => Ok(Verdict::Go(SetupStep::AwaitData, 0)),
        _ => Ok(Verdict::Again(5_000, 500_000, fault)),
    }
}
