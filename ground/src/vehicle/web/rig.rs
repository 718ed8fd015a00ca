//! The virtual rig behind the port, if it is one that can be acted on: its socket stands beside the
//! port (`tvc rig --pty --link`).

use std::path::{Path, PathBuf};
use std::time::Duration;

use ::rig::action::{Action, HELP};
use ::rig::bno055::FaultKind;
use anyhow::{Context, Result, anyhow};
use serde_json::{Value, json};
use tokio::time::{sleep, timeout};

use super::model::Model;
use crate::flight::rig::control_path;

/// Time between two looks at the rig.
const LOOK: Duration = Duration::from_millis(200);
/// Time for an answer.
const PATIENCE: Duration = Duration::from_secs(2);

/// The place of the rig's socket.
#[derive(Clone, Debug)]
pub struct RigSocket(Option<PathBuf>);

impl RigSocket {
    /// The socket beside a port; there is none beside a port that was not named.
    pub fn beside(port: Option<&str>) -> Self {
        Self(port.map(|port| control_path(Path::new(port))))
    }

    /// Acts on the rig; how it is then.
    ///
    /// # Errors
    /// There is no rig, it does not answer, or it refuses.
    pub async fn act(self, action: &str) -> Result<Value> {
        let path = self.0.context("this port is no virtual rig")?;
        let answer = timeout(PATIENCE, ask(&path, action)).await;
        answer.context("the rig does not answer")?
    }

    /// Keeps in the model how the rig is, for ever.
    pub async fn watch(self, model: &Model) {
        while self.0.is_some() {
            let look = self.clone().act("state").await.unwrap_or_default();
            model.lock().rig.renew(look);
            sleep(LOOK).await;
        }
        std::future::pending().await
    }
}

/// Words that are an action.
///
/// # Errors
/// They are none.
pub fn admit(words: &str) -> Result<()> {
    words
        .parse::<Action>()
        .map(drop)
        .map_err(|why| anyhow!(why))
}

/// What the page offers: the kinds of faults with what each takes, and the words of all actions.
pub fn vocabulary() -> Value {
    let faults = FaultKind::ALL.map(|kind| {
        let takes_share = kind.hardest().probability().is_some();
        json!({ "kind": kind.name(), "share": takes_share })
    });
    json!({ "faults": faults, "actions": HELP })
}

#[cfg(unix)]
async fn ask(path: &Path, action: &str) -> Result<Value> {
    use crate::flight::rig::answer;
    use report::input::ANSWER;
    use tokio::io::{AsyncBufReadExt, AsyncReadExt, AsyncWriteExt, BufReader};
    use tokio::net::UnixStream;

    let stream = UnixStream::connect(path).await;
    let mut stream = stream.context("no rig that can be acted on is at this port")?;
    stream.write_all(format!("{action}\n").as_bytes()).await?;
    let mut line = String::new();
    BufReader::new(stream.take(ANSWER))
        .read_line(&mut line)
        .await?;
    answer(&line)
}

#[cfg(not(unix))]
async fn ask(_path: &Path, _action: &str) -> Result<Value> {
    anyhow::bail!("this port is no virtual rig")
}
