//! States as plain numbers.

use crate::scalar::Scalar;

/// A value of numbers of one type, to be read, stored and restored.
pub trait State<T>: Sized {
    /// Number of numbers.
    const NUMBERS: usize;

    /// Shows the numbers, in the order of the fields.
    fn tell(&self, each: &mut impl FnMut(T));

    /// The value with these numbers from [`tell`](Self::tell).
    fn told(next: &mut impl FnMut() -> T) -> Self;
}

impl<T: Scalar> State<T> for T {
    const NUMBERS: usize = 1;

    fn tell(&self, each: &mut impl FnMut(T)) {
        each(*self);
    }

    fn told(next: &mut impl FnMut() -> T) -> Self {
        next()
    }
}

/// 0 or 1.
impl<T: Scalar> State<T> for bool {
    const NUMBERS: usize = 1;

    fn tell(&self, each: &mut impl FnMut(T)) {
        each(if *self { T::ONE } else { T::ZERO });
    }

    fn told(next: &mut impl FnMut() -> T) -> Self {
        next() != T::ZERO
    }
}

/// Whether there is a value, and the value.
impl<T: Scalar, V: State<T> + Copy + Default> State<T> for Option<V> {
    const NUMBERS: usize = 1 + V::NUMBERS;

    fn tell(&self, each: &mut impl FnMut(T)) {
        self.is_some().tell(each);
        self.unwrap_or_default().tell(each);
    }

    fn told(next: &mut impl FnMut() -> T) -> Self {
        let is_some = bool::told(next);
        let value = V::told(next);
        is_some.then_some(value)
    }
}

impl<T: Scalar, V: State<T>, const N: usize> State<T> for [V; N] {
    const NUMBERS: usize = N * V::NUMBERS;

    fn tell(&self, each: &mut impl FnMut(T)) {
        for value in self {
            value.tell(each);
        }
    }

    fn told(next: &mut impl FnMut() -> T) -> Self {
        core::array::from_fn(|_| V::told(next))
    }
}

/// Declares a struct of such values as a [`State`].
macro_rules! state {
    (
        $(#[$about:meta])*
        $sight:vis struct $name:ident {
            $($(#[$field_about:meta])* $field_sight:vis $field:ident: $type:ty,)*
        }
    ) => {
        $(#[$about])*
        #[derive(Clone, Copy, Debug, Default, PartialEq)]
        $sight struct $name<T> {
            $($(#[$field_about])* $field_sight $field: $type,)*
        }

        impl<T: $crate::Scalar> $crate::State<T> for $name<T> {
            const NUMBERS: usize = 0 $(+ <$type as $crate::State<T>>::NUMBERS)*;

            #[inline(never)]
            fn tell(&self, each: &mut impl FnMut(T)) {
                $(self.$field.tell(each);)*
            }

            #[inline(never)]
            fn told(next: &mut impl FnMut() -> T) -> Self {
                Self { $($field: $crate::State::told(next),)* }
            }
        }
    };
}
pub(crate) use state;
