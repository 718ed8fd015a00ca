//! Texts that tests make and the repository keeps: a reviewer sees a change of behaviour as a
//! difference. `STATES=overwrite cargo test -p tvc-nano --lib` writes them anew.

use std::path::Path;
use std::string::String;
use std::sync::Mutex;
use std::{env, format, fs};

/// Tests run side by side, and several of them may write parts of one page.
static WRITING: Mutex<()> = Mutex::new(());

/// The file of the repository at `path` is `text`.
pub(crate) fn assert_kept(path: &str, text: &str) {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join(path);
    if env::var_os("STATES").is_some_and(|value| value == "overwrite") {
        fs::write(file, text).unwrap();
        return;
    }
    let kept = fs::read_to_string(file).unwrap_or_default();
    let mut lines = kept.lines().zip(text.lines()).enumerate();
    let differs = lines.find(|(_, (kept, made))| kept != made);
    assert!(
        kept == text,
        "{path} is not what the code does, first at {differs:?}; \
         STATES=overwrite cargo test -p tvc-nano --lib writes it anew"
    );
}

/// The part of a page between the comments `<!-- name -->` and `<!-- /name -->` is `text`.
pub(crate) fn assert_part_kept(path: &str, name: &str, text: &str) {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join(path);
    let _writing = WRITING.lock();
    let page = fs::read_to_string(file).unwrap();
    let (opens, closes) = (format!("<!-- {name} -->\n"), format!("<!-- /{name} -->"));
    let (before, rest) = page.split_once(&opens).unwrap();
    let (_, after) = rest.split_once(&closes).unwrap();
    let wanted: String = [before, &opens, text, &closes, after].concat();
    assert_kept(path, &wanted);
}
