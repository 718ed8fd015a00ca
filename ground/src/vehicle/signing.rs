//! MAVLink 2 signing, for a link that leaves this computer: who does not have the key can listen,
//! but command nothing. The vehicle's own cable has none: frames are signed and looked at here.
//!
//! A signature is the frame's hash with the key, and the time: no frame is accepted twice, and none
//! of a station that is more than a minute behind when it is first heard. Both are `mavlink`'s.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use anyhow::Result;
use client::wire::{CHECKSUM, HEADER, SIGNATURE, SIGNED, START};
use mavlink::dialects::common::MavMessage;
use mavlink::{MAVLinkV2MessageRaw, Message, SigningConfig, SigningData, calculate_crc};

use report::exit::BadInput;

/// Bytes of a key.
const KEY: usize = 32;
/// Bytes that `mavlink` has for a frame: the longest, of a form that the vehicle does not know.
const LONGEST: usize = 283;
/// Where a frame has its flags.
const FLAGS_AT: usize = 2;
/// Which of the links of a station this one is: there is no other.
const LINK: u8 = 0;

/// A key, and the times of what it has signed and seen.
pub struct Signing(SigningData);

impl Signing {
    /// With the key in a file.
    ///
    /// # Errors
    /// [`BadInput`] for a file that cannot be read, that others may read, or that is no key.
    pub fn read(path: &Path) -> Result<Self> {
        let bad = |why: String| BadInput::new(format!("the key {}: {why}", path.display()));
        let file = File::open(path).map_err(|error| bad(error.to_string()))?;
        check_access(&file).map_err(bad)?;
        let mut key = Vec::new();
        // One byte more tells a longer file.
        let read = file.take(KEY as u64 + 1).read_to_end(&mut key);
        read.map_err(|error| bad(error.to_string()))?;
        Ok(Self::parse(&key).map_err(bad)?)
    }

    /// With the key that these bytes are.
    ///
    /// # Errors
    /// They are none.
    pub fn parse(key: &[u8]) -> Result<Self, String> {
        let length = key.len();
        let Ok(key) = <[u8; KEY]>::try_from(key) else {
            let length = if length > KEY { "more".to_owned() } else { length.to_string() };
            return Err(format!(
                "a key is a file of {KEY} random bytes, this one has {length}: \
                 `head -c {KEY} /dev/urandom` makes one"
            ));
        };
        if key.iter().all(|byte| *byte == key[0]) {
            return Err("all of its bytes are the same, which is no secret".into());
        }
        let config = SigningConfig::new(key, LINK, true, false);
        Ok(Self(SigningData::from_config(config)))
    }

    /// A frame with a signature.
    pub fn sign(&self, frame: &[u8]) -> Vec<u8> {
        let Some(mut raw) = with_flags(frame, SIGNED) else {
            return frame.to_vec();
        };
        self.0.sign_message(&mut raw);
        raw.raw_bytes().to_vec()
    }

    /// A frame without its signature, if that is right and new.
    pub fn verified(&self, frame: &[u8]) -> Option<Vec<u8>> {
        // Other flags make a frame of another form, which the vehicle does not know. The first byte
        // is no part of what is signed.
        let is_signed = frame.get(FLAGS_AT) == Some(&SIGNED);
        if !is_signed || frame[0] != START || frame.len() > LONGEST {
            return None;
        }
        let mut bytes = [0; LONGEST];
        bytes[..frame.len()].copy_from_slice(frame);
        let raw = MAVLinkV2MessageRaw::from_bytes_unparsed(bytes);
        if raw.raw_bytes() != frame || !self.0.verify_signature(&raw) {
            return None;
        }
        Some(with_flags(frame, 0)?.raw_bytes().to_vec())
    }
}

/// A frame with other flags and the checksum that goes with them, without a signature or with room
/// for one; `None` for no frame, or one of another form.
fn with_flags(frame: &[u8], flags: u8) -> Option<MAVLinkV2MessageRaw> {
    let end = HEADER + usize::from(*frame.get(1)?);
    if frame[FLAGS_AT..].first()? & !SIGNED != 0 || end + CHECKSUM + SIGNATURE > LONGEST {
        return None;
    }
    let mut bytes = [0; LONGEST];
    bytes[..end].copy_from_slice(frame.get(..end)?);
    bytes[FLAGS_AT] = flags;
    let id = u32::from_le_bytes([bytes[7], bytes[8], bytes[9], 0]);
    let sum = calculate_crc(&bytes[1..end], MavMessage::extra_crc(id));
    bytes[end..end + CHECKSUM].copy_from_slice(&sum.to_le_bytes());
    Some(MAVLinkV2MessageRaw::from_bytes_unparsed(bytes))
}

/// Refuses a key that is no file, or that other users can read: then it is none.
fn check_access(file: &File) -> Result<(), String> {
    let about = file.metadata().map_err(|error| error.to_string())?;
    if !about.is_file() {
        return Err("it is no file".into());
    }
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        let mode = about.permissions().mode();
        if mode & 0o077 != 0 {
            return Err(format!(
                "others can read or change it (its mode is {:03o}): chmod 600 it",
                mode & 0o777
            ));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests;
