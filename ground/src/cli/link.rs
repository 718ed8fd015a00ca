//! What every command that talks to a vehicle understands.

use clap::Args;

/// Where the vehicle is.
#[derive(Debug, Args)]
pub struct Port {
    /// Serial port of the Nano, or the path that `tvc rig --pty` prints [default: the only SAMD21
    /// that is connected].
    #[arg(long, value_name = "PORT")]
    pub port: Option<String>,
}

/// A length of time in seconds, above zero.
pub fn seconds(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(seconds) if seconds > 0.0 && seconds <= 1e6 => Ok(seconds),
        _ => Err("a time is a number of seconds above 0, such as 10".into()),
    }
}
