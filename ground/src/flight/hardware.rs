//! The option for what the emulated parts are like.

use ::rig::bench::Hardware;
use clap::Args;

use report::exit::BadInput;

/// How the emulated parts differ from the default.
#[derive(Debug, Clone, Args)]
pub struct HardwareChoice {
    #[arg(
        long = "hardware",
        value_name = "KEY=VALUE",
        value_delimiter = ',',
        value_parser = setting,
        help = "Parts that differ, such as stretch=400 (docs/reference/hardware.md)"
    )]
    settings: Vec<String>,
}

impl HardwareChoice {
    /// The settings as they were given, with commas between them.
    pub fn text(&self) -> String {
        self.settings.join(",")
    }

    /// The parts.
    ///
    /// # Errors
    /// A setting that does not exist.
    pub fn hardware(&self) -> Result<Hardware, BadInput> {
        self.text().parse().map_err(BadInput::new)
    }
}

fn setting(text: &str) -> Result<String, String> {
    Hardware::default().set(text)?;
    Ok(text.to_owned())
}
