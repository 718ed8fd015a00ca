//! The state of the flight as words of 32 bits: telemetry sends them, and a replay continues from
//! them.

use tvc_fusion::fixed;
use tvc_imu::Micros;
use tvc_pid::{PidState, Q16, State, SurfaceState};

/// A value that consists of words of 32 bits.
pub(crate) trait Words: Sized {
    /// How many they are.
    const WORDS: usize;

    /// Shows the words, in the order of the fields.
    fn tell(&self, each: &mut dyn FnMut(i32));

    /// The value that [told](Self::tell) these words.
    fn told(next: &mut dyn FnMut() -> i32) -> Self;
}

/// What one word holds: how it becomes the word, and the word becomes it.
macro_rules! one_word {
    ($($type:ty: $value:ident => $word:expr, $told:ident => $back:expr;)*) => {$(
        impl Words for $type {
            const WORDS: usize = 1;

            fn tell(&self, each: &mut dyn FnMut(i32)) {
                let $value = *self;
                each($word);
            }

            fn told(next: &mut dyn FnMut() -> i32) -> Self {
                let $told = next();
                $back
            }
        }
    )*};
}

one_word! {
    i32: value => value, word => word;
    u32: value => value as i32, word => word as u32;
    u8: value => value.into(), word => word as u8;
    bool: value => value.into(), word => word != 0;
    Q16: value => value.to_bits(), word => Self::from_bits(word);
}

impl Words for Micros {
    const WORDS: usize = 2;

    #[inline(never)]
    fn tell(&self, each: &mut dyn FnMut(i32)) {
        each(self.0 as i32);
        each((self.0 >> 32) as i32);
    }

    fn told(next: &mut dyn FnMut() -> i32) -> Self {
        let (low, high) = (next() as u32, next() as u32);
        Self(u64::from(high) << 32 | u64::from(low))
    }
}

/// Nothing flies at time 0, which is none.
impl Words for Option<Micros> {
    const WORDS: usize = 2;

    fn tell(&self, each: &mut dyn FnMut(i32)) {
        self.unwrap_or_default().tell(each);
    }

    fn told(next: &mut dyn FnMut() -> i32) -> Self {
        let at = Micros::told(next);
        (at.0 > 0).then_some(at)
    }
}

impl Words for fixed::State {
    const WORDS: usize = Self::WORDS;

    fn tell(&self, each: &mut dyn FnMut(i32)) {
        self.words().iter().for_each(|word| each(*word as i32));
    }

    fn told(next: &mut dyn FnMut() -> i32) -> Self {
        Self::from_words(&core::array::from_fn(|_| next() as u32))
    }
}

impl<V: Words, const N: usize> Words for [V; N] {
    const WORDS: usize = N * V::WORDS;

    fn tell(&self, each: &mut dyn FnMut(i32)) {
        for value in self {
            value.tell(each);
        }
    }

    fn told(next: &mut dyn FnMut() -> i32) -> Self {
        core::array::from_fn(|_| V::told(next))
    }
}

/// States of control laws, whose numbers are in fixed point.
macro_rules! of_law {
    ($($state:ident)*) => {$(
        impl Words for $state<Q16> {
            const WORDS: usize = <Self as State<Q16>>::NUMBERS;

            fn tell(&self, each: &mut dyn FnMut(i32)) {
                State::tell(self, &mut |number: Q16| each(number.to_bits()));
            }

            fn told(next: &mut dyn FnMut() -> i32) -> Self {
                State::told(&mut || Q16::from_bits(next()))
            }
        }
    )*};
}

of_law!(PidState SurfaceState);

/// Declares a struct of such values.
macro_rules! words {
    (
        $(#[$about:meta])*
        $sight:vis struct $name:ident {
            $($(#[$field_about:meta])* $field_sight:vis $field:ident: $type:ty,)*
        }
    ) => {
        $(#[$about])*
        $sight struct $name {
            $($(#[$field_about])* $field_sight $field: $type,)*
        }

        impl $crate::words::Words for $name {
            const WORDS: usize = 0 $(+ <$type as $crate::words::Words>::WORDS)*;

            #[inline(never)]
            fn tell(&self, each: &mut dyn FnMut(i32)) {
                $($crate::words::Words::tell(&self.$field, each);)*
            }

            #[inline(never)]
            fn told(next: &mut dyn FnMut() -> i32) -> Self {
                Self { $($field: $crate::words::Words::told(next),)* }
            }
        }
    };
}
pub(crate) use words;
