//! The stored inputs: small files that are right, and every input that has ever broken something,
//! named by what it broke.

use std::fs;
use std::path::{Path, PathBuf};

/// The folder of a kind of input.
pub fn folder(kind: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz_corpus").join(kind)
}

/// The stored inputs of a kind, by their names' order.
pub fn stored(kind: &str) -> Vec<Vec<u8>> {
    let mut paths: Vec<PathBuf> = fs::read_dir(folder(kind))
        .unwrap_or_else(|error| panic!("{kind}: {error}"))
        .map(|entry| entry.unwrap().path())
        .collect();
    paths.sort();
    assert!(!paths.is_empty(), "{kind} has no stored input");
    paths.iter().map(|path| fs::read(path).unwrap()).collect()
}
