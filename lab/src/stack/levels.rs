//! Interrupts on the stack: main, and on it one handler of each priority.
//!
//! A handler is interrupted by those of a higher priority alone (ARM DDI 0419, B1.5.4), so at any
//! time at most one of each priority is on the stack. The priorities are those that the emulated
//! chip's registers hold once the image has set them. Every handler of the vector table counts,
//! whether its interrupt is enabled or not.

use std::collections::BTreeMap;

use samd21::chip::EXCEPTIONS;

use super::depth::{Calls, Deepest};

/// Bytes that an exception stacks (ARM DDI 0419, B1.5.6), and what may align them.
pub const FRAME_BYTES: u32 = 32 + 4;

/// The exceptions of one priority.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Level {
    /// 0 to 3, the lowest first; HardFault has -1 and NMI -2.
    pub priority: i8,
    /// The number of the exception whose handler goes deepest.
    pub exception: usize,
    /// Its way, without what the exception itself stacks.
    pub deepest: Deepest,
}

/// The priorities in use, the least urgent first, of handlers by their exception. The reset does
/// not belong to them.
pub fn levels(
    handlers: &BTreeMap<usize, u32>,
    priorities: &[i8; EXCEPTIONS],
    calls: &Calls,
) -> Vec<Level> {
    let mut levels: BTreeMap<i8, Level> = BTreeMap::new();
    for (&exception, &handler) in handlers.range(2..EXCEPTIONS) {
        let level =
            Level { priority: priorities[exception], exception, deepest: calls.deepest(handler) };
        let known = levels.get(&level.priority);
        if known.is_none_or(|known| known.deepest.bytes < level.deepest.bytes) {
            levels.insert(level.priority, level);
        }
    }
    levels.into_values().rev().collect()
}

/// What an exception is called.
pub fn exception_name(number: usize) -> String {
    match number {
        2 => "NMI".into(),
        3 => "HardFault".into(),
        11 => "SVCall".into(),
        14 => "PendSV".into(),
        15 => "SysTick".into(),
        _ => format!("interrupt {}", number.saturating_sub(16)),
    }
}
