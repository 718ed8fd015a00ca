//! MAVLink frames with other content and order, whose checksums are right.

use std::ops::Range;

use client::Wire;
use mavlink::dialects::common::MavMessage;
use mavlink::{Message, calculate_crc};
use rand::Rng;
use rand::rngs::StdRng;
use rand::seq::IndexedRandom;

/// Bytes of a frame before its payload.
const HEADER: usize = 10;
/// Bytes of the checksum behind it.
const CHECKSUM: usize = 2;
/// Where a frame has its flags, its sequence number, its sender and the number of its message.
const FLAGS_AT: usize = 2;
const SEQUENCE_AT: usize = 4;
const SENDER_AT: Range<usize> = 5..7;
const MESSAGE_AT: Range<usize> = 7..HEADER;
/// Most changes of one input.
const CHANGES: usize = 12;
/// Longest payload.
const PAYLOAD: usize = 255;

/// Values that break arithmetic.
fn hostile(random: &mut StdRng) -> [u8; 4] {
    let values = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, -0.0, 1e-40];
    match random.random_range(0..4) {
        0 => values.choose(random).map_or([0; 4], |v| v.to_le_bytes()),
        1 => [0xFF; 4],
        2 => [0; 4],
        _ => random.random(),
    }
}

/// The frames of an input, each with the bytes of time before it; what is between them is left out.
fn frames(bytes: &[u8], stamp: usize) -> Vec<(Vec<u8>, Vec<u8>)> {
    let mut frames = Vec::new();
    let mut at = 0;
    while let Some(rest) = bytes.get(at + stamp..) {
        match Wire::frame_length(rest) {
            // A signature would not be right afterwards.
            Some(length) if rest[FLAGS_AT] == 0 => {
                frames.push((bytes[at..at + stamp].to_vec(), rest[..length].to_vec()));
                at += stamp + length;
            }
            _ => at += 1,
        }
        if at > bytes.len() {
            break;
        }
    }
    frames
}

/// An input with changed frames; `None` for one without any.
pub fn reframe(bytes: &[u8], stamp: usize, random: &mut StdRng) -> Option<Vec<u8>> {
    let mut frames = frames(bytes, stamp);
    for _ in 0..random.random_range(1..CHANGES) {
        if frames.is_empty() {
            return None;
        }
        let at = random.random_range(0..frames.len());
        let other = random.random_range(0..frames.len());
        let (time, frame) = &mut frames[at];
        let payload = HEADER..frame.len() - CHECKSUM;
        match random.random_range(0..11) {
            0 => change_time(time, random),
            1..4 => {
                let end = payload.end - payload.len().min(4);
                let from = random.random_range(payload.start..=end);
                let value = hostile(random);
                let length = (payload.end - from).min(4);
                frame[from..from + length].copy_from_slice(&value[..length]);
            }
            4 => frame[SEQUENCE_AT] = random.random(),
            5 => frame[random.random_range(SENDER_AT)] = random.random_range(0..4),
            6 => frames.swap(at, other),
            7 => drop(frames.remove(at)),
            8 => resize(frame, random.random_range(0..=PAYLOAD)),
            9 => {
                // Another message, of which this content is none.
                let message = frames[other].1[MESSAGE_AT].to_vec();
                frames[at].1[MESSAGE_AT].copy_from_slice(&message);
            }
            _ => {
                let copy = frames[at].clone();
                frames.insert(other, copy);
            }
        }
    }
    let mut bytes = Vec::new();
    for (time, mut frame) in frames {
        seal(&mut frame);
        bytes.extend(time);
        bytes.extend(frame);
    }
    Some(bytes)
}

/// Another time before a frame, if there is one.
fn change_time(time: &mut [u8], random: &mut StdRng) {
    let Ok(now) = <[u8; 8]>::try_from(&*time).map(u64::from_be_bytes) else {
        return;
    };
    let times = [0, 1, u64::MAX, u64::MAX / 1000, now.wrapping_add(1 << 40), now.wrapping_sub(1)];
    if let Some(new) = times.choose(random) {
        time.copy_from_slice(&new.to_be_bytes());
    }
}

/// Makes the payload so long.
fn resize(frame: &mut Vec<u8>, length: usize) {
    frame.truncate(frame.len() - CHECKSUM);
    frame.resize(HEADER + length, 0xA5);
    frame[1] = length as u8;
    frame.extend([0; CHECKSUM]);
}

/// Puts the checksum right.
fn seal(frame: &mut [u8]) {
    let end = frame.len() - CHECKSUM;
    let id = u32::from_le_bytes([frame[7], frame[8], frame[9], 0]);
    let sum = calculate_crc(&frame[1..end], MavMessage::extra_crc(id));
    frame[end..].copy_from_slice(&sum.to_le_bytes());
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;

    /// Frames whose content was changed are still whole: otherwise they would be skipped, and what
    /// comes behind the checksum would not be tried.
    #[test]
    fn frames_with_other_content_have_right_checksums() {
        let stored = super::super::corpus::stored("log");
        let log = stored.iter().find(|one| frames(one, 8).len() > 20).unwrap();
        let mut random = StdRng::seed_from_u64(1);
        let (mut sent, mut whole) = (0, 0);
        for _ in 0..50 {
            let bytes = reframe(log, 8, &mut random).unwrap();
            for (_, frame) in frames(&bytes, 8) {
                sent += 1;
                whole += Wire::default().receive_frames(&frame).len();
            }
        }
        assert!(whole * 10 > sent * 9, "{whole} of {sent}");
    }
}
