//! The virtual rig behind the port, if it can be acted on: it is in this process, or its socket
//! stands beside the port (`tvc rig --pty --link`).

use std::path::{Path, PathBuf};
use std::sync::mpsc::{Sender, channel};
use std::time::Duration;

use ::rig::action::Action;
use ::rig::bno055::FaultKind;
use anyhow::{Context, Result, anyhow, bail};
use serde_json::{Value, json};
use tokio::task::spawn_blocking;
use tokio::time::sleep;

use super::model::Model;
use crate::flight::rig::{PATIENCE, answer, ask, control_path};
use crate::vehicle::on_rig::Asked;

/// Time between two looks at the rig.
const LOOK: Duration = Duration::from_millis(200);

/// How the rig is acted on.
#[derive(Clone, Debug)]
pub enum RigControl {
    /// There is no rig.
    None,
    /// By this socket.
    Socket(PathBuf),
    /// It is in this process.
    Here(Sender<Asked>),
}

impl RigControl {
    /// The socket beside a port; there is none beside a port that was not named.
    pub fn beside(port: Option<&str>) -> Self {
        port.map_or(Self::None, |port| Self::Socket(control_path(Path::new(port))))
    }

    /// Acts on the rig; how it is then.
    ///
    /// # Errors
    /// There is no rig, it does not answer, or it refuses.
    pub async fn act(self, action: &str) -> Result<Value> {
        let action = action.to_owned();
        match self {
            Self::None => bail!("this port is no virtual rig"),
            Self::Socket(path) => spawn_blocking(move || ask(&path, &action)).await?,
            Self::Here(rig) => {
                let (tell, told) = channel();
                let ended = "the rig has ended";
                rig.send((action, tell)).context(ended)?;
                let line = spawn_blocking(move || told.recv_timeout(PATIENCE)).await?;
                answer(&line.context(ended)?)
            }
        }
    }

    /// Keeps in the model how the rig is, for ever.
    pub async fn watch(self, model: &Model) {
        if matches!(self, Self::None) {
            return std::future::pending().await;
        }
        loop {
            let look = self.clone().act("state").await.unwrap_or_default();
            model.lock().rig.renew(look);
            sleep(LOOK).await;
        }
    }
}

/// Words that are an action.
///
/// # Errors
/// They are none.
pub fn admit(words: &str) -> Result<()> {
    words.parse::<Action>().map(drop).map_err(|why| anyhow!(why))
}

/// What the page offers: the kinds of faults with what each takes.
pub fn vocabulary() -> Value {
    let faults = FaultKind::ALL.map(|kind| {
        let takes_share = kind.hardest().probability().is_some();
        json!({ "kind": kind.name(), "share": takes_share })
    });
    json!({ "faults": faults })
}
