//! Interrupts on the stack: main, and on it one handler of each priority.
//!
//! A handler is interrupted by those of a higher priority alone (ARM DDI 0419, B1.5.4), so at any
//! time at most one of each priority is on the stack. The priorities are those that the emulated
//! chip's registers hold once the image has set them. Every handler of the vector table counts,
//! whether its interrupt is enabled or not.

use crate::functions::exception_name;
use std::collections::BTreeMap;

use samd21::chip::EXCEPTIONS;

use super::depth::{Calls, Deepest};

/// Bytes that an exception stacks (ARM DDI 0419, B1.5.6), and what may align them.
const FRAME_BYTES: u32 = 32 + 4;

/// What is on the stack at the same time: main, and the exceptions of each priority.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Level {
    /// What it is called.
    pub name: String,
    /// The number of the exception whose handler goes deepest; main is none.
    pub exception: Option<usize>,
    /// Bytes that the exception stacks.
    pub stacked: u32,
    /// The way of main or of the handler, without what the exception stacks.
    pub deepest: Deepest,
}

/// Main, from the `reset`, and the priorities in use, the least urgent first, of handlers by their
/// exception.
pub fn levels(
    reset: u32,
    handlers: &BTreeMap<usize, u32>,
    priorities: &[i8; EXCEPTIONS],
    calls: &Calls,
) -> Vec<Level> {
    let mut of_handlers: BTreeMap<i8, (usize, Deepest)> = BTreeMap::new();
    for (&exception, &handler) in handlers.range(2..EXCEPTIONS) {
        let deepest = calls.deepest(handler);
        let known = of_handlers.get(&priorities[exception]);
        if known.is_none_or(|(_, known)| known.bytes < deepest.bytes) {
            of_handlers.insert(priorities[exception], (exception, deepest));
        }
    }
    let main =
        Level { name: "main".into(), exception: None, stacked: 0, deepest: calls.deepest(reset) };
    let mut levels = vec![main];
    for (priority, (exception, deepest)) in of_handlers.into_iter().rev() {
        let name = match exception {
            2 | 3 => exception_name(exception),
            _ => format!("priority {priority}"),
        };
        levels.push(Level { name, exception: Some(exception), stacked: FRAME_BYTES, deepest });
    }
    levels
}
