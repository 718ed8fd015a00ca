//! How the page's tasks ask the thread that owns the port.

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, Receiver, Sender};
use std::time::Instant;

use anyhow::{Result, anyhow};
use client::Request;
use tokio::sync::oneshot::{self, error::TryRecvError};

/// Where an answer goes.
pub type Reply<T> = oneshot::Sender<Result<T>>;

/// What the thread that owns the port is asked for.
pub enum Ask {
    /// A request to the vehicle.
    Request(Request, Condition, Reply<()>),
    /// A log from now on, of the test of this name or of whatever happens; the answer is its path.
    Record(Option<&'static str>, Reply<PathBuf>),
    /// The end of the log.
    EndRecording(Reply<()>),
    /// Every frame of the vehicle from now on, until the receiver has gone.
    Listen(Sender<Vec<u8>>),
    /// Frames to the vehicle that ask for no answer.
    Send(Vec<u8>),
}

/// When a request may still be sent to the vehicle.
#[derive(Clone, Copy, Debug, Default)]
pub struct Condition {
    /// Not after this time.
    pub until: Option<Instant>,
    /// Not once this flag is set.
    pub unless: Option<&'static AtomicBool>,
}

impl Condition {
    /// Why it may not be sent any more.
    pub fn refusal(&self) -> Option<&'static str> {
        if self.is_over() {
            return Some("the order waited too long and was not given: press again");
        }
        let stopped = self.unless?.load(Ordering::SeqCst);
        stopped.then_some("stopped by the operator")
    }

    /// Whether its time is over.
    pub fn is_over(&self) -> bool {
        self.until.is_some_and(|until| Instant::now() > until)
    }
}

impl Ask {
    /// Answers that it is not done.
    pub fn refuse(self, why: &str) {
        // Who asked may be gone.
        let _ = match self {
            Self::Request(.., reply) | Self::EndRecording(reply) => {
                reply.send(Err(anyhow!("{why}"))).is_ok()
            }
            Self::Record(_, reply) => reply.send(Err(anyhow!("{why}"))).is_ok(),
            // Who listens finds that nobody sends.
            Self::Listen(_) | Self::Send(_) => false,
        };
    }
}

/// A handle to ask by, for any thread or task. What is asked stands in the queue at once, in the
/// order of the calls; the answer is waited for by whoever wants it.
#[derive(Clone)]
pub struct Handle(Sender<Ask>);

impl Handle {
    /// A handle, and the queue from which the port's thread takes what is asked.
    pub fn new() -> (Self, Receiver<Ask>) {
        let (sender, receiver) = mpsc::channel();
        (Self(sender), receiver)
    }

    /// Asks the vehicle, unless the condition forbids it when its turn comes. The answer is an
    /// error for the vehicle's refusal, silence, or a port that went away.
    pub fn request(&self, request: Request, condition: Condition) -> Answer<()> {
        self.ask(|reply| Ask::Request(request, condition, reply))
    }

    /// Begins a log, of the test of this name or of whatever happens; the answer is its path, or an
    /// error if another log is being written, the folder takes no file, or there is no port.
    pub fn record(&self, test: Option<&'static str>) -> Answer<PathBuf> {
        self.ask(|reply| Ask::Record(test, reply))
    }

    /// Ends the log. The answer is an error if it could not be written, or there is no port.
    pub fn end_recording(&self) -> Answer<()> {
        self.ask(Ask::EndRecording)
    }

    /// Every frame of the vehicle from now on, in bytes; the sender is gone once the port is.
    pub fn listen(&self) -> Receiver<Vec<u8>> {
        let (sender, receiver) = mpsc::channel();
        // Where the thread has ended, the sender is gone at once.
        let _ = self.0.send(Ask::Listen(sender));
        receiver
    }

    /// Sends frames that ask for no answer.
    pub fn send(&self, bytes: &[u8]) {
        let _ = self.0.send(Ask::Send(bytes.to_owned()));
    }

    fn ask<T>(&self, ask: impl FnOnce(Reply<T>) -> Ask) -> Answer<T> {
        let (reply, answer) = oneshot::channel();
        // Where the thread has ended, the answer says so.
        let _ = self.0.send(ask(reply));
        Answer(answer)
    }
}

/// An answer to come.
pub struct Answer<T>(oneshot::Receiver<Result<T>>);

impl<T> Answer<T> {
    /// Waits for it on a thread of its own.
    ///
    /// # Errors
    /// Those of what was asked, or the program is about to end.
    pub fn wait(self) -> Result<T> {
        self.0.blocking_recv().unwrap_or_else(|_| Err(ending()))
    }

    /// The answer, if it has come.
    pub fn look(&mut self) -> Option<Result<T>> {
        match self.0.try_recv() {
            Ok(answer) => Some(answer),
            Err(TryRecvError::Empty) => None,
            Err(TryRecvError::Closed) => Some(Err(ending())),
        }
    }

    /// The answer, once it comes.
    ///
    /// # Errors
    /// As [`Answer::wait`].
    pub async fn come(self) -> Result<T> {
        self.0.await.unwrap_or_else(|_| Err(ending()))
    }
}

fn ending() -> anyhow::Error {
    anyhow!("the program is about to end")
}
