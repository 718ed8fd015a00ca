//! From where a page comes, and so whether it may command: the token says only that its owner knows
//! the address.

use std::net::IpAddr;

use anyhow::{Result, anyhow};

use super::desk::Message;
use crate::vehicle::admission::{Admission, remedy};

/// Who is at the other end of a connection.
#[derive(Clone, Copy, Debug)]
pub struct Visitor {
    from: IpAddr,
    may_command: bool,
}

impl Visitor {
    /// Whoever comes from this address.
    pub fn of(from: IpAddr, admission: &Admission) -> Self {
        Self { from, may_command: admission.admits(from) }
    }

    /// Lets an order pass. A STOP always passes: whoever sees the vehicle must be able to stop it.
    ///
    /// # Errors
    /// It would change something, and this visitor may not.
    pub fn admit(self, message: &Message) -> Result<()> {
        match self.may_command || message.is_for_everybody() {
            true => Ok(()),
            false => Err(anyhow!("refused: {}", remedy(self.from))),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_on_another_computer_stops_and_looks_but_orders_nothing_else() {
        let orders = include_str!("../../../../lab/fuzz_corpus/order/all.jsonl");
        let order = |line| serde_json::from_str::<Message>(line).unwrap();
        let admits = |from: &str| {
            let visitor = Visitor::of(from.parse().unwrap(), &Admission::default());
            let admitted = orders.lines().filter(|line| visitor.admit(&order(line)).is_ok());
            admitted.count()
        };
        assert_eq!(admits("127.0.0.1"), orders.lines().count());
        assert_eq!(admits("192.168.1.20"), 3, "stop, read-file and write-file");
        let visitor = Visitor::of("192.168.1.20".parse().unwrap(), &Admission::default());
        let arm = order(r#"{"id":1,"heard_ms":0,"order":"arm"}"#);
        let said = visitor.admit(&arm).unwrap_err().to_string();
        assert!(said.contains("--accept-commands-from 192.168.1.20"), "{said}");
    }
}
