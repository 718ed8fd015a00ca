//! From where commands are accepted: from this computer, and from elsewhere only if the user says
//! so.

use std::net::IpAddr;

use clap::Args;

/// The name of every address.
const ANY: &str = "any";

/// Who may command over a network.
#[derive(Clone, Debug, Default, Args)]
pub struct Admission {
    /// Accept commands from this address, too, not from this computer alone; `any` is every
    /// address. Can be given several times.
    #[arg(long, value_name = "ADDRESS", value_parser = commander)]
    pub accept_commands_from: Vec<Commander>,
}

/// Somebody who may command from elsewhere.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Commander {
    /// Whoever reaches the port.
    Anybody,
    /// One computer.
    At(IpAddr),
}

/// Parses an address, or the name of all.
fn commander(text: &str) -> Result<Commander, String> {
    match (text, text.parse::<IpAddr>()) {
        (ANY, _) => Ok(Commander::Anybody),
        (_, Ok(address)) => Ok(Commander::At(address.to_canonical())),
        _ => Err(format!("an address is a number such as 192.168.1.20, or {ANY}")),
    }
}

impl Admission {
    /// Whether commands from this address are accepted.
    pub fn admits(&self, from: IpAddr) -> bool {
        // Of a socket for both, an address of IPv4 comes as one of IPv6.
        let from = from.to_canonical();
        let mut others = self.accept_commands_from.iter();
        from.is_loopback()
            || others.any(|commander| match commander {
                Commander::Anybody => true,
                Commander::At(address) => *address == from,
            })
    }

    /// Whether commands are accepted from anywhere else than this computer.
    pub fn is_open(&self) -> bool {
        !self.accept_commands_from.is_empty()
    }
}

/// What to do so that commands from this address are accepted.
pub fn remedy(from: IpAddr) -> String {
    let from = from.to_canonical();
    format!("only this computer may command; --accept-commands-from {from} lets that one, too")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_this_computer_commands_unless_the_user_says_so() {
        let admission = |names: &[&str]| Admission {
            accept_commands_from: names.iter().map(|name| commander(name).unwrap()).collect(),
        };
        let admits = |admission: &Admission, from: &str| admission.admits(from.parse().unwrap());
        let closed = admission(&[]);
        for own in ["127.0.0.1", "127.8.9.1", "::1", "::ffff:127.0.0.1"] {
            assert!(admits(&closed, own), "{own}");
        }
        for other in ["192.168.1.20", "0.0.0.0", "::", "::ffff:192.168.1.20", "fe80::1"] {
            assert!(!admits(&closed, other), "{other}");
        }
        let one = admission(&["192.168.1.20"]);
        assert!(admits(&one, "192.168.1.20") && admits(&one, "::ffff:192.168.1.20"));
        assert!(!admits(&one, "192.168.1.21") && admits(&one, "127.0.0.1"));
        let all = admission(&["any"]);
        assert!(admits(&all, "203.0.113.5") && all.is_open() && !closed.is_open());
    }

    #[test]
    fn a_name_is_no_address() {
        for wrong in ["localhost", "192.168.1", "192.168.1.20:14550", "", "Any"] {
            assert!(commander(wrong).is_err(), "{wrong}");
        }
    }
}
