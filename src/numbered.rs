//! Enums whose variants have a number and a text, for messages between the vehicle and its hosts.

use core::fmt;

use crate::format::Whole;

/// A number that stands for nothing in this version.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct UnknownCode(pub u32);

impl fmt::Display for UnknownCode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "unknown code {}", Whole(self.0))
    }
}

impl core::error::Error for UnknownCode {}

/// An enum whose variants are numbers with words: `ALL`, `code`, `TryFrom<u8>` and `Display`.
macro_rules! numbered {
    (
        $(#[$meta:meta])*
        $name:ident { $($(#[$doc:meta])* $variant:ident = $number:literal, $words:literal;)+ }
    ) => {
        $(#[$meta])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
        #[repr(u8)]
        pub enum $name { $($(#[$doc])* $variant = $number,)+ }

        impl $name {
            /// All of them, in the order of the list.
            pub const ALL: &'static [Self] = &[$(Self::$variant,)+];

            /// Its number.
            pub const fn code(self) -> u8 {
                self as u8
            }
        }

        impl TryFrom<u8> for $name {
            type Error = $crate::numbered::UnknownCode;

            fn try_from(code: u8) -> Result<Self, Self::Error> {
                match code {
                    $($number => Ok(Self::$variant),)+
                    _ => Err($crate::numbered::UnknownCode(code.into())),
                }
            }
        }

        impl core::fmt::Display for $name {
            fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
                f.write_str(match self { $(Self::$variant => $words,)+ })
            }
        }
    };
}

/// An enum whose variants may hold details, and its kind: the [`numbered!`] enum without them.
macro_rules! detailed {
    (
        $(#[$meta:meta])*
        $name:ident, $(#[$kind_meta:meta])* $kind:ident {
            $($(#[$doc:meta])* $variant:ident $(($detail:ty))? = $number:literal, $words:literal;)+
        }
    ) => {
        $(#[$meta])*
        #[derive(Clone, Copy, Debug, PartialEq)]
        pub enum $name { $($(#[$doc])* $variant $(($detail))?,)+ }

        impl $name {
            /// Without the details.
            pub const fn kind(&self) -> $kind {
                match self { $(Self::$variant { .. } => $kind::$variant,)+ }
            }
        }

        $crate::numbered::numbered! {
            $(#[$kind_meta])*
            $kind { $($(#[$doc])* $variant = $number, $words;)+ }
        }
    };
}

pub(crate) use {detailed, numbered};
