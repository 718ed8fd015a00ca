//! Connections that have not shown a token: few, so that whoever holds them keeps nobody out.

use std::collections::VecDeque;
use std::sync::{Mutex, PoisonError};

use tokio::task::{AbortHandle, Id};

/// Most connections without a token.
const CONNECTIONS: usize = 64;

/// The tasks of connections that have not shown a token, oldest first.
#[derive(Default)]
pub struct Strangers(Mutex<VecDeque<AbortHandle>>);

impl Strangers {
    /// Keeps a task; where there are too many, the oldest one ends.
    pub fn add(&self, task: AbortHandle) {
        let mut tasks = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        tasks.retain(|task| !task.is_finished());
        tasks.push_back(task);
        if tasks.len() > CONNECTIONS {
            end_oldest(&mut tasks);
        }
    }

    /// Ends the oldest task.
    pub fn end_one(&self) {
        end_oldest(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner));
    }

    /// Whether a task has not shown the token.
    pub fn has(&self, task: Id) -> bool {
        let tasks = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        tasks.iter().any(|other| other.id() == task)
    }

    /// A task has shown the token, and stays.
    pub fn forget(&self, task: Id) {
        let mut tasks = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        tasks.retain(|other| other.id() != task);
    }
}

fn end_oldest(tasks: &mut VecDeque<AbortHandle>) {
    if let Some(task) = tasks.pop_front() {
        task.abort();
    }
}
