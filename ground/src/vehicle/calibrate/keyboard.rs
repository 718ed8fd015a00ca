//! Lines from standard input, read without waiting.

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

/// Standard input, read by a thread of its own.
pub struct Keyboard {
    lines: Receiver<String>,
}

impl Keyboard {
    /// Begins to listen.
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

/// Whether standard input is a terminal, so that a person can be asked.
pub fn is_attended() -> bool {
    io::stdin().is_terminal() && io::stderr().is_terminal()
}
