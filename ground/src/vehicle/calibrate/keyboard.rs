//! Lines that a person types, read without waiting for them.

use std::io::{self, BufRead, IsTerminal};
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::thread;

/// What came from the keyboard.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Typed {
    /// Nothing yet.
    Nothing,
    /// A line, without blanks at its ends.
    Line(String),
    /// Standard input has ended.
    Nobody,
}

/// Whether an answer is a yes.
pub fn is_yes(answer: &str) -> bool {
    matches!(answer.to_lowercase().as_str(), "y" | "yes")
}

/// Standard input, read by a thread of its own.
pub struct Keyboard {
    lines: Receiver<String>,
}

impl Keyboard {
    /// Starts the thread that reads.
    pub fn listen() -> Self {
        let (sender, lines) = channel();
        thread::spawn(move || {
            for line in io::stdin().lock().lines() {
                match line {
                    Ok(line) if sender.send(line.trim().to_owned()).is_ok() => {}
                    _ => return,
                }
            }
        });
        Self { lines }
    }

    /// The next line, without waiting for it.
    pub fn poll(&self) -> Typed {
        match self.lines.try_recv() {
            Ok(line) => Typed::Line(line),
            Err(TryRecvError::Empty) => Typed::Nothing,
            Err(TryRecvError::Disconnected) => Typed::Nobody,
        }
    }
}

/// Whether a person can be asked: standard input and standard error are terminals.
pub fn is_attended() -> bool {
    io::stdin().is_terminal() && io::stderr().is_terminal()
}
