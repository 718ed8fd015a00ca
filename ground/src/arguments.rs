//! Arguments that more than one command takes.

/// Parses a length of time, s, above 0 and at most 1e6.
///
/// # Errors
/// What such a time looks like.
pub fn seconds(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(seconds) if seconds > 0.0 && seconds <= 1e6 => Ok(seconds),
        _ => Err("a time is a number of seconds above 0, such as 10".into()),
    }
}
