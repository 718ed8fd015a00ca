//! Time.

/// A moment, in microseconds since the owner's clock started; never wraps in practice.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Micros(pub u64);

impl Micros {
    /// The moment `us` microseconds later.
    #[must_use]
    pub const fn after(self, us: u64) -> Self {
        Self(self.0.saturating_add(us))
    }

    /// Microseconds from `earlier` to `self`; 0 if `earlier` is later.
    #[must_use]
    pub const fn since(self, earlier: Self) -> u64 {
        self.0.saturating_sub(earlier.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_saturates_at_both_ends() {
        assert_eq!(Micros(5).since(Micros(7)), 0);
        assert_eq!(Micros(7).since(Micros(5)), 2);
        assert_eq!(Micros(u64::MAX - 1).after(5), Micros(u64::MAX));
    }
}
