//! Arguments that more than one command takes.

use std::ops::{RangeBounds, RangeInclusive};

/// Parses a number in a range; otherwise the error says `what` it is.
///
/// # Errors
/// `what`.
pub fn number(text: &str, range: impl RangeBounds<f64>, what: &str) -> Result<f64, String> {
    let number = text.trim().parse().ok();
    number.filter(|number| range.contains(number)).ok_or_else(|| what.to_owned())
}

/// Two numbers in ranges, with a comma between them.
///
/// # Errors
/// `what`.
pub fn numbers(
    text: &str,
    [first, second]: [RangeInclusive<f64>; 2],
    what: &str,
) -> Result<(f64, f64), String> {
    let (a, b) = text.split_once(',').ok_or(what)?;
    Ok((number(a, first, what)?, number(b, second, what)?))
}

/// Parses a length of time, s, above 0 and at most 1e6.
///
/// # Errors
/// What such a time looks like.
pub fn seconds(text: &str) -> Result<f64, String> {
    number(text, f64::MIN_POSITIVE..=1e6, "a time is a number of seconds above 0, such as 10")
}

/// Parses a part of a campaign, `3/16`, as index from 0 and number.
///
/// # Errors
/// What a shard looks like.
pub fn shard(text: &str) -> Result<(u64, u64), String> {
    let parsed = text
        .split_once('/')
        .and_then(|(i, n)| Some((i.trim().parse::<u64>().ok()?, n.trim().parse::<u64>().ok()?)));
    match parsed {
        Some((i, n)) if i >= 1 && i <= n => Ok((i - 1, n)),
        _ => Err("a shard is I/N with I from 1 to N, such as 3/16".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shards_count_from_one() {
        assert_eq!(shard("1/4"), Ok((0, 4)));
        assert_eq!(shard("4/4"), Ok((3, 4)));
        for bad in ["0/4", "5/4", "1", "a/b", "1/0", "-1/4"] {
            assert!(shard(bad).is_err(), "{bad}");
        }
    }
}
