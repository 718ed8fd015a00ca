//! Who may command: a request needs the token of this start, and a `Host` to which no foreign page
//! can point.

use std::net::IpAddr;
use std::sync::{Mutex, PoisonError};

use anyhow::{Result, anyhow};

/// Bytes of a token.
const LENGTH: usize = 16;

/// The secret of one start of the program, as hexadecimal digits.
pub struct Token(pub String);

impl Token {
    /// A new one, from the system's random numbers.
    ///
    /// # Errors
    /// The system has none.
    pub fn new() -> Result<Self> {
        let mut bytes = [0; LENGTH];
        getrandom::fill(&mut bytes).map_err(|error| anyhow!("making a token: {error}"))?;
        Ok(Self(bytes.iter().map(|byte| format!("{byte:02x}")).collect()))
    }

    /// Whether `given` is this token; how long that takes does not tell how much of it is right.
    pub fn is(&self, given: &str) -> bool {
        let difference =
            self.0.bytes().zip(given.bytes()).fold(0, |sum, (ours, theirs)| sum | (ours ^ theirs));
        given.len() == self.0.len() && difference == 0
    }
}

/// A word that stands for the token once: other users of this computer can read the command line of
/// a browser that is opened with it.
pub struct Once(Mutex<Option<Token>>);

impl Once {
    /// A new one.
    ///
    /// # Errors
    /// As [`Token::new`].
    pub fn new() -> Result<Self> {
        Ok(Self(Mutex::new(Some(Token::new()?))))
    }

    /// As hexadecimal digits; empty once it has been used.
    pub fn text(&self) -> String {
        let word = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        word.as_ref().map_or(String::new(), |word| word.0.clone())
    }

    /// Whether `given` is this word, which is used up then.
    pub fn take(&self, given: &str) -> bool {
        let mut word = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        word.take_if(|word| word.is(given)).is_some()
    }
}

/// Whether a request's `Host` is this computer by number or as `localhost`. A name may belong to a
/// foreign page that has pointed it here (DNS rebinding); a number cannot.
pub fn is_own_host(host: &str) -> bool {
    let name = match host.strip_prefix('[') {
        Some(rest) => rest.split(']').next().unwrap_or_default(),
        None => host.split(':').next().unwrap_or_default(),
    };
    name.eq_ignore_ascii_case("localhost") || name.parse::<IpAddr>().is_ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_whole_token_will_do() {
        let (token, other) = (Token::new().unwrap(), Token::new().unwrap());
        assert_eq!(token.0.len(), 2 * LENGTH);
        assert!(token.is(&token.0));
        assert!(!token.is(&other.0));
        assert!(!token.is(""));
        assert!(!token.is(&token.0[1..]));
        assert!(!token.is(&format!("{}0", token.0)));
    }

    #[test]
    fn a_word_is_good_once() {
        let word = Once::new().unwrap();
        let text = word.text();
        assert!(!word.take(""));
        assert!(word.take(&text));
        assert!(!word.take(&text));
    }

    #[test]
    fn a_foreign_name_is_no_host_of_ours() {
        for host in
            ["127.0.0.1:8650", "127.0.0.1", "localhost:8650", "[::1]:8650", "192.168.1.7:80"]
        {
            assert!(is_own_host(host), "{host}");
        }
        for host in ["", "evil.example:8650", "127.0.0.1.evil.example", "[evil]", "localhost.evil"]
        {
            assert!(!is_own_host(host), "{host}");
        }
    }
}
