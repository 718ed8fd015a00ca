//! Which image a command takes, and the files that `tvc flash` writes of it.

use std::path::Path;
use std::process::{Command, Output};

use crate::running::{assert_refused, object};
use rig::Image;

/// Runs `tvc` in `folder`.
fn tvc_in(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_tvc")).args(arguments).current_dir(folder).output().unwrap()
}

fn assert_met(output: &Output) -> String {
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{said}");
    said
}

/// The bytes that a UF2 file puts into flash from 0x2000 on (UF2 specification, "File format").
fn read_uf2(file: &[u8]) -> Vec<u8> {
    let mut flash = Vec::new();
    for block in file.chunks(512) {
        let word = |at: usize| u32::from_le_bytes(block[at..at + 4].try_into().unwrap());
        assert_eq!([word(0), word(4), word(508)], [0x0A32_4655, 0x9E5D_5157, 0x0AB1_6F30]);
        assert_eq!(word(12), 0x2000 + flash.len() as u32);
        assert_eq!(word(28), 0x68ED_2B88, "the family of the SAMD21");
        flash.extend_from_slice(&block[32..32 + word(16) as usize]);
    }
    flash
}

/// The three files hold one image; a command outside of the source tree takes the ELF file.
#[test]
fn files_of_the_image_agree_and_fly() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let said =
        assert_met(&tvc_in(folder, &["flash", "--elf", "f.elf", "--bin", "f.bin", "--uf2", "."]));
    assert!(said.contains("image: built from "), "{said}");
    let read = |name: &str| std::fs::read(folder.join(name)).unwrap();
    let (elf, bin, uf2) = (read("f.elf"), read("f.bin"), read("tvc-nano.uf2"));
    assert_eq!(Image::parse("f.elf", &elf).unwrap().bytes(), bin);
    let flash = read_uf2(&uf2);
    assert_eq!(flash[..bin.len()], bin);
    assert!(flash[bin.len()..].iter().all(|byte| *byte == 0xFF));
    // The first two words are the stack's top and an entry above the bootloader.
    let word = |at: usize| u32::from_le_bytes(bin[at..at + 4].try_into().unwrap());
    assert_eq!(word(0), 0x2000_7800);
    assert!((0x2000..0x2000 + bin.len() as u32).contains(&word(4)));

    let said = assert_met(&tvc_in(folder, &["flash", "--image", "f.elf", "--bin", "again.bin"]));
    assert!(said.contains("image: f.elf"), "{said}");
    assert_eq!(read("again.bin"), bin);
    // Its status also depends on how fast this machine is.
    let output = tvc_in(folder, &["fly", "--image", "f.elf", "--start", "0.4", "--json"]);
    assert_eq!(object(&output)["runs"][0]["stayed_active"], true);
}

/// Then it would be another one in every folder, and the build of a release could not be repeated.
#[test]
fn no_path_of_this_machine_is_in_the_image() {
    let folder = tempfile::tempdir().unwrap();
    assert_met(&tvc_in(folder.path(), &["flash", "--elf", "f.elf", "--bin", "f.bin"]));
    let holds = |name: &str, text: &str| {
        let bytes = std::fs::read(folder.path().join(name)).unwrap();
        bytes.windows(text.len()).any(|part| part == text.as_bytes())
    };
    assert!(!holds("f.bin", ".rs"), "the flight image names a source");
    let tree = Path::new(env!("CARGO_MANIFEST_DIR")).join("..").canonicalize().unwrap();
    assert!(!holds("f.elf", tree.to_str().unwrap()));
}

#[test]
fn a_file_that_is_no_image_is_refused_before_everything_else() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("no.elf");
    std::fs::write(&path, "hello").unwrap();
    let path = path.to_str().unwrap();
    for command in [&["fly"][..], &["flash", "--bin", "x.bin"], &["rig", "--pty"]] {
        let with = |image: &'static str| [command, &["--image", image]].concat();
        assert_refused(&with("no/such.elf"), "cannot read the image no/such.elf");
        let refused = [command, &["--image", path]].concat();
        assert_refused(&refused, "is not an image for this chip");
    }
}

/// What a newcomer tries first ends well, not with a requirement that was missed.
#[test]
fn the_examples_of_a_flight_in_the_help_meet_every_requirement() {
    let folder = tempfile::tempdir().unwrap();
    let help = String::from_utf8(tvc_in(folder.path(), &["fly", "--help"]).stdout).unwrap();
    let examples: Vec<&str> = help
        .lines()
        .filter_map(|line| line.strip_prefix("  tvc "))
        .filter_map(|line| line.split("  ").next())
        .filter(|line| line.contains("--gains") || line.contains("--vibration"))
        .collect();
    assert_eq!(examples.len(), 2, "{examples:?}");
    for example in examples {
        let arguments: Vec<&str> = example.split(' ').collect();
        assert_met(&tvc_in(folder.path(), &arguments));
    }
}
