//! Builds images and reads them.

use super::{Image, ImageError};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

pub use image_build::Source;

/// Images with other features are written to one place: each is read before the next is built.
static PLACE: Mutex<()> = Mutex::new(());

/// A toolchain that can build for the chip; see [`image_build::Builder`].
pub struct Builder(image_build::Builder);

impl Builder {
    /// A builder into `target/chip` of the workspace that this crate belongs to. A missing Rust
    /// target is added through rustup. `say` gets lines of progress for a person.
    ///
    /// # Errors
    /// [`ImageError::Build`].
    pub fn new(say: &mut dyn FnMut(&str)) -> Result<Self, ImageError> {
        Ok(Self(image_build::Builder::in_tree(&workspace(), say)?))
    }

    /// Builds an image and reads it.
    ///
    /// # Errors
    /// Every [`ImageError`].
    pub fn build(&self, source: &Source<'_>) -> Result<Image, ImageError> {
        let _place = PLACE.lock().unwrap_or_else(PoisonError::into_inner);
        Image::open(&self.0.build(source)?)
    }
}

/// Builds the firmware of the workspace that this crate belongs to and reads it. `say` gets lines
/// of progress for a person.
///
/// # Errors
/// Every [`ImageError`].
pub fn build(say: &mut dyn FnMut(&str)) -> Result<Image, ImageError> {
    let _place = PLACE.lock().unwrap_or_else(PoisonError::into_inner);
    Image::open(&build_in(&workspace(), say)?)
}

/// Builds the firmware of a source tree and gives the path of its ELF file. `say` gets lines of
/// progress for a person.
///
/// # Errors
/// [`ImageError::Build`].
pub fn build_in(tree: &Path, say: &mut dyn FnMut(&str)) -> Result<PathBuf, ImageError> {
    let builder = image_build::Builder::in_tree(tree, say)?;
    let firmware = Source::firmware(tree);
    if !builder.path(&firmware).exists() {
        say("building the image for the chip; the first time this takes a minute or two");
    }
    Ok(builder.build(&firmware)?)
}

/// The source tree that this crate was built from; it may be gone.
pub fn workspace() -> PathBuf {
    let own = Path::new(env!("CARGO_MANIFEST_DIR"));
    own.parent().unwrap_or(own).to_owned()
}
