use super::*;
use client::{Wire, request};
use std::fs;

fn signing(seed: u8) -> Signing {
    let key: Vec<u8> = (0..32).map(|byte| byte ^ seed).collect();
    Signing::parse(&key).unwrap()
}

fn order() -> Vec<u8> {
    Wire::default().frame(&request::ARM.message())
}

#[test]
fn what_is_signed_is_verified_once_and_is_the_same_frame() {
    let (ours, theirs) = (signing(0), signing(0));
    let signed = ours.sign(&order());
    assert_eq!(signed.len(), order().len() + SIGNATURE);
    assert_eq!(Wire::default().receive_frames(&signed).len(), 1, "any station reads it");
    assert_eq!(theirs.verified(&signed), Some(order()));
    assert_eq!(theirs.verified(&signed), None, "a second time");
    let again = ours.sign(&order());
    assert_ne!(again, signed);
    assert_eq!(theirs.verified(&again), Some(order()));
}

#[test]
fn what_is_unsigned_changed_or_of_another_key_is_refused() {
    let signed = signing(0).sign(&order());
    assert_eq!(signing(7).verified(&signed), None);
    assert_eq!(signing(0).verified(&order()), None);
    for at in 0..signed.len() {
        for bit in 0..8 {
            let mut changed = signed.clone();
            changed[at] ^= 1 << bit;
            assert_eq!(signing(0).verified(&changed), None, "bit {bit} of byte {at}");
        }
        assert_eq!(signing(0).verified(&signed[..at]), None);
    }
}

/// A frame of another form is longer than the longest one where it has a signature.
#[test]
fn a_frame_of_another_form_is_refused() {
    for flags in 0..=255 {
        let mut frame = vec![0xFD, 255, flags, 0, 0, 1, 1, 0, 0, 0];
        for length in [280, 284, 300] {
            frame.resize(length, 1);
            assert_eq!(signing(0).verified(&frame), None);
        }
    }
}

#[cfg(unix)]
#[test]
fn a_key_is_a_file_of_32_bytes_that_is_its_owners_alone() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("key");
    let refused = |bytes: &[u8], mode: u32| {
        fs::write(&path, bytes).unwrap();
        fs::set_permissions(&path, fs::Permissions::from_mode(mode)).unwrap();
        Signing::read(&path).err().map(|error| {
            assert!(error.is::<BadInput>());
            error.to_string()
        })
    };
    let key: Vec<u8> = (0..32).collect();
    assert_eq!(refused(&key, 0o600), None);
    assert_eq!(refused(&key, 0o400), None);
    for (bytes, mode, part) in [
        (&key[..], 0o640, "mode is 640"),
        (&key[..], 0o604, "chmod 600"),
        (&key[..31], 0o600, "this one has 31"),
        (&[key.clone(), vec![10]].concat()[..], 0o600, "this one has more"),
        (b"", 0o600, "this one has 0"),
        (&[0; 32], 0o600, "no secret"),
    ] {
        let said = refused(bytes, mode).unwrap();
        assert!(said.contains(part) && said.contains("key"), "{said}");
    }
    let said = Signing::read(folder.path()).err().unwrap().to_string();
    assert!(said.contains("no file"), "{said}");
    assert!(Signing::read(Path::new("no/such/key")).is_err());
}
