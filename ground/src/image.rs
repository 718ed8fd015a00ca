//! The image that a command flies or flashes.
//!
//! It is the file that `--image` names; else it is built from the source tree round the current
//! folder; else it is the one that was put into this program when it was installed. A `tvc` out of
//! a source tree's `target` holds none and builds from that tree wherever it is started.

use std::env;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use clap::Args;
use rig::image::{Image, build_in, workspace};

use report::exit::BadInput;
use report::input;

/// The image as `build.rs` has left it: empty unless the tool was built to be installed.
const EMBEDDED: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/image.elf"));

/// Digits of its build id that a vehicle tells.
const BUILD_DIGITS: usize = 8;

/// Which image.
#[derive(Clone, Debug, Default, Args)]
pub struct ImageOption {
    /// The image [default: built from the sources here, else the one in tvc].
    #[arg(long, value_name = "FILE.elf")]
    pub image: Option<PathBuf>,
}

/// An image and the ELF file that it was read from.
#[derive(Debug)]
pub struct Firmware {
    /// What goes into flash, and its symbols.
    pub image: Image,
    /// The bytes of the file.
    pub elf: Vec<u8>,
}

impl ImageOption {
    /// The image; it is built where there are sources. Which one it is goes to standard error.
    ///
    /// # Errors
    /// [`BadInput`] for a file that cannot be read or is no image; an image that does not build.
    pub fn image(&self) -> Result<Image> {
        Ok(self.firmware()?.image)
    }

    /// As [`image`](Self::image), with the bytes of the ELF file.
    ///
    /// # Errors
    /// As [`image`](Self::image).
    pub fn firmware(&self) -> Result<Firmware> {
        let (name, elf) = if let Some(path) = &self.image {
            let name = path.display().to_string();
            let elf = input::bytes(path, input::IMAGE)
                .map_err(|error| BadInput::new(format!("cannot read the image {name}: {error}")))?;
            (name, elf)
        } else if let Some(tree) = tree() {
            built(tree)?
        } else {
            ("the one in this program".to_owned(), EMBEDDED.to_vec())
        };
        let image = Image::parse(&name, &elf).map_err(BadInput::new)?;
        eprintln!("image: {name}");
        Ok(Firmware { image, elf })
    }
}

/// What an image is flown or flashed from without `--image`, and its build id as a vehicle tells
/// it; `None` if there is none.
pub fn at_hand() -> Option<(String, String)> {
    let (from, id) = match tree() {
        Some(tree) => {
            let id = image_build::build_id(&tree).ok()?;
            (format!("to be built from {}", tree.display()), format!("{id:016x}"))
        }
        None => ("in this program".to_owned(), env!("TVC_IMAGE_BUILD").to_owned()),
    };
    Some((from, id.chars().take(BUILD_DIGITS).collect()))
}

/// The tree that an image is built from; `None` where the one in this program is taken.
fn tree() -> Option<PathBuf> {
    let here = env::current_dir().unwrap_or_default();
    let around = image_build::tree_around(&here).map(Path::to_owned);
    around.or_else(|| EMBEDDED.is_empty().then(workspace))
}

/// The image that a tree builds, and what to call it.
fn built(tree: PathBuf) -> Result<(String, Vec<u8>)> {
    if !tree.exists() {
        bail!(
            "there is no image: this program holds none, and the sources in {} are gone; \
             give one with --image",
            tree.display()
        );
    }
    let path = build_in(&tree, &mut |line| eprintln!("{line}")).context("building the image")?;
    let elf = fs::read(&path).with_context(|| format!("reading {}", path.display()))?;
    Ok((format!("built from {}", tree.display()), elf))
}
