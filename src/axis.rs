//! The axes that are steered, each by a rudder of its own.

/// An axis of the body about which a servo turns the vehicle.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Axis {
    /// The body's y, by the servo on D3.
    Pitch,
    /// The body's x, by the servo on D2.
    Roll,
}

impl Axis {
    /// How many there are at most.
    pub const COUNT: usize = 2;

    /// All, in the order in which lists name them.
    pub const ALL: [Self; Self::COUNT] = [Self::Pitch, Self::Roll];

    /// Its place in lists, and the number of its servo less one.
    pub const fn index(self) -> usize {
        self as usize
    }

    /// What belongs to it of a list.
    pub(crate) fn of<T>(self, all: [T; Self::COUNT]) -> T {
        let [pitch, roll] = all;
        match self {
            Self::Pitch => pitch,
            Self::Roll => roll,
        }
    }
}
