//! What can be said to `tvc flash`.

use std::path::PathBuf;

use clap::Args;

/// Options of `tvc flash`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  cargo tvc flash                          find the Nano, enter its bootloader, write with bossac
  cargo tvc flash --port /dev/ttyACM0      a given port
  cargo tvc flash --uf2 /media/NANO/f.uf2  copy onto the drive of a UF2 bootloader
  cargo tvc flash --bin firmware.bin       only write the raw image, for other programmers

The image is linked at 0x2000, above the bootloader; never write it to 0x0. bossac erases everything
above the bootloader (-e), stored parameters too: `tvc param dump FILE` first, `tvc param load FILE`
and `tvc param save` afterwards.
Exit status: 0 written, 1 something failed, 2 unusable input.")]
pub struct Flash {
    /// Serial port of the Nano [default: the only SAMD21 that is connected].
    #[arg(long, value_name = "PORT", conflicts_with_all = ["uf2", "bin"])]
    pub port: Option<String>,

    /// Write a UF2 file instead: copy it onto the board's drive, or name a file there.
    #[arg(long, value_name = "FILE.uf2", conflicts_with = "bin")]
    pub uf2: Option<PathBuf>,

    /// Write the raw image instead (first byte belongs at 0x2000).
    #[arg(long, value_name = "FILE.bin")]
    pub bin: Option<PathBuf>,
}
