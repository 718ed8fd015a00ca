//! `bossac`, which writes flash through the Nano's bootloader.
//!
//! Versions differ where it hurts. From 1.9 on the offset is counted from the start of flash; 1.7
//! and 1.8 add the bootloader's 8 KB to it by themselves. Without `-e` 1.9 erases each row before
//! it writes it and leaves all others (BOSSA, `D2xNvmFlash::eraseAuto`), so that the parameters at
//! the end of flash are kept.

use std::env;
use std::ffi::OsStr;
use std::path::PathBuf;
use std::process::Command;

use anyhow::{Context, Result, bail};

use report::exit::BadInput;

/// The oldest version that counts the offset from the start of flash.
const OLDEST: (u32, u32) = (1, 9);

/// Where to get it.
const WHERE: &str = "Debian and Ubuntu: apt install bossa-cli; macOS: brew install --cask bossa; \
                     Windows: bossa-x64-1.9.1.msi of github.com/shumatech/BOSSA/releases, its \
                     folder on the PATH; or write a file with --uf2 or --bin";

/// A programmer that is new enough.
#[derive(Debug)]
pub(super) struct Bossac {
    program: PathBuf,
}

impl Bossac {
    /// The one on the PATH.
    ///
    /// # Errors
    /// [`BadInput`] if there is none or it is too old; says where to get one.
    pub(super) fn find() -> Result<Self> {
        Self::find_on(&env::var_os("PATH").unwrap_or_default())
    }

    fn find_on(path: &OsStr) -> Result<Self> {
        let name = format!("bossac{}", env::consts::EXE_SUFFIX);
        let program = env::split_paths(path)
            .map(|folder| folder.join(&name))
            .find(|candidate| candidate.is_file())
            .ok_or_else(|| BadInput::new(format!("bossac is not installed ({WHERE})")))?;
        // It has no option for the version alone; its help ends with status 1.
        let help = Command::new(&program)
            .arg("--help")
            .output()
            .with_context(|| format!("starting {}", program.display()))?;
        let help = [help.stdout, help.stderr].concat();
        match version(&String::from_utf8_lossy(&help)) {
            Some(version) if version >= OLDEST => Ok(Self { program }),
            Some((major, minor)) => bail!(BadInput::new(format!(
                "{} is version {major}.{minor} and does not know where the image goes; the one \
                 that Arduino installs for this board (1.7.0-arduino3) is too old, 1.9.1 is right \
                 ({WHERE})",
                program.display()
            ))),
            None => bail!(BadInput::new(format!(
                "{} does not tell its version; 1.9.1 is right ({WHERE})",
                program.display()
            ))),
        }
    }

    /// Writes `bytes` to `address` through the bootloader at `port`, verifies them and starts them.
    ///
    /// # Errors
    /// bossac failed.
    pub(super) fn write(&self, port: &str, address: u32, bytes: &[u8]) -> Result<()> {
        let folder = tempfile::tempdir().context("making a temporary folder")?;
        let file = folder.path().join("firmware.bin");
        std::fs::write(&file, bytes).context("writing the image for bossac")?;
        eprintln!("writing {} bytes through {port}", bytes.len());
        let status = Command::new(&self.program)
            .args(arguments(port, address))
            .arg(&file)
            .status()
            .with_context(|| format!("starting {}", self.program.display()))?;
        if !status.success() {
            bail!("bossac failed ({status}); double-tap the reset button and try again");
        }
        Ok(())
    }
}

/// Never without the offset: bossac would begin at the bootloader.
fn arguments(port: &str, address: u32) -> Vec<String> {
    let mut arguments = vec![format!("--port={}", port.trim_start_matches("/dev/"))];
    arguments.extend(["-U", "-i", "-w", "-v", "-R"].map(String::from));
    arguments.push(format!("--offset=0x{address:X}"));
    arguments
}

/// The version in bossac's help, as in "Version 1.9.1".
fn version(help: &str) -> Option<(u32, u32)> {
    let (_, version) = help.split_once("Version ")?;
    let mut numbers = version.split(|c: char| !c.is_ascii_digit());
    Some((numbers.next()?.parse().ok()?, numbers.next()?.parse().ok()?))
}

#[cfg(test)]
mod tests {
    use super::*;
    #[cfg(unix)]
    use std::path::Path;

    #[test]
    fn versions_of_every_kind_are_read() {
        let head = "Usage: bossac [OPTION...] [FILE]\n\
                    Basic Open Source SAM-BA Application (BOSSA) ";
        for (said, read) in [
            ("Version 1.9.1\n", Some((1, 9))),
            ("Version 1.9.1-17-g89f3556\n", Some((1, 9))),
            ("Version 1.7.0-arduino3\n", Some((1, 7))),
            ("Version 1.10\n", Some((1, 10))),
            ("Version unknown\n", None),
            ("", None),
        ] {
            assert_eq!(version(&format!("{head}{said}")), read, "{said}");
        }
    }

    /// A program that says it is bossac of a version and keeps what it is started with.
    #[cfg(unix)]
    fn stand_in(folder: &Path, version: &str, status: u8) {
        let text = format!(
            "if [ \"$1\" = --help ]; then echo '(BOSSA) Version {version}'; exit 1; fi\n\
             cd \"$(dirname \"$0\")\" && echo \"$@\" > started\n\
             for file; do :; done; cat \"$file\" > written\n\
             exit {status}\n"
        );
        crate::script::write(&folder.join("bossac"), &text);
    }

    #[cfg(unix)]
    #[test]
    fn the_image_goes_above_the_bootloader_and_nothing_else_is_erased() {
        let folder = tempfile::tempdir().unwrap();
        for version in ["2.0", "1.10", "1.9", "1.9.1"] {
            stand_in(folder.path(), version, 0);
            Bossac::find_on(folder.path().as_os_str()).unwrap();
        }
        let bossac = Bossac::find_on(folder.path().as_os_str()).unwrap();
        bossac.write("/dev/ttyACM3", 0x2000, b"image").unwrap();
        let started = std::fs::read_to_string(folder.path().join("started")).unwrap();
        let (arguments, file) = started.trim_end().rsplit_once(' ').unwrap();
        assert_eq!(
            arguments, "--port=ttyACM3 -U -i -w -v -R --offset=0x2000",
            "no -e: it would erase the parameters"
        );
        assert!(!Path::new(file).exists(), "{file} is left behind");
        let written = std::fs::read(folder.path().join("written")).unwrap();
        assert_eq!(written, b"image");
        stand_in(folder.path(), "1.9.1", 1);
        let error = bossac.write("COM4", 0x2000, b"image").unwrap_err();
        assert!(error.to_string().contains("bossac failed"), "{error}");
    }

    #[cfg(unix)]
    #[test]
    fn arduinos_own_is_refused_with_the_way_to_a_newer_one() {
        let folder = tempfile::tempdir().unwrap();
        for version in ["1.7.0-arduino3", "1.8", "x"] {
            stand_in(folder.path(), version, 0);
            let error = Bossac::find_on(folder.path().as_os_str()).unwrap_err();
            assert!(error.is::<BadInput>(), "{error}");
            let said = error.to_string();
            for system in ["1.9.1 is right", "Debian", "macOS", "Windows"] {
                assert!(said.contains(system), "{version}: {said}");
            }
        }
        assert!(!folder.path().join("started").exists());
    }

    #[test]
    fn without_bossac_it_says_where_to_get_it() {
        let folder = tempfile::tempdir().unwrap();
        let error = Bossac::find_on(folder.path().as_os_str()).unwrap_err();
        assert!(error.to_string().contains("bossac is not installed"));
    }
}
