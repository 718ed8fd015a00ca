//! What tells builds of the same version apart.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// Folders of what the image is made from.
pub(crate) const SOURCES: [&str; 6] =
    ["src", "fusion/src", "pid/src", "imu/src", "bno055-driver/src", "lsm6ds3-driver/src"];

/// The build id of the image that a source tree makes: FNV-1a over names and contents of its
/// sources. The vehicle tells the first eight of its sixteen digits.
///
/// # Errors
/// A source cannot be read.
pub fn build_id(tree: &Path) -> io::Result<u64> {
    sum_of(tree, &SOURCES)
}

/// The same of other files and folders of a tree.
///
/// # Errors
/// One cannot be read.
pub fn sum_of(tree: &Path, sources: &[&str]) -> io::Result<u64> {
    let mut files = Vec::new();
    for source in sources {
        collect(tree.join(source), &mut files)?;
    }
    files.sort();
    let mut id = 0xCBF2_9CE4_8422_2325_u64;
    for file in files {
        let name = file.strip_prefix(tree).unwrap_or(&file).to_string_lossy().replace('\\', "/");
        for byte in name.bytes().chain(fs::read(&file)?) {
            id = (id ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01B3);
        }
    }
    Ok(id)
}

/// The files at or below a path.
fn collect(path: PathBuf, files: &mut Vec<PathBuf>) -> io::Result<()> {
    if path.is_file() {
        files.push(path);
        return Ok(());
    }
    fs::read_dir(path)?.try_for_each(|entry| collect(entry?.path(), files))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_and_contents_count() {
        let folder = std::env::temp_dir().join(format!("tvc-build-id-{}", std::process::id()));
        for source in SOURCES {
            fs::create_dir_all(folder.join(source)).unwrap();
        }
        let id = || build_id(&folder).unwrap();
        let empty = id();
        fs::write(folder.join("src/a.rs"), "x").unwrap();
        let one = id();
        fs::rename(folder.join("src/a.rs"), folder.join("src/b.rs")).unwrap();
        let renamed = id();
        fs::write(folder.join("src/b.rs"), "y").unwrap();
        let changed = id();
        fs::remove_dir_all(&folder).unwrap();
        assert!(build_id(&folder).is_err());
        let mut ids = vec![empty, one, renamed, changed];
        ids.sort_unstable();
        ids.dedup();
        assert_eq!(ids.len(), 4);
    }
}
