//! Enums for the values of a register's field.

/// Defines enums from the values of fields as the data sheet lists them.
///
/// The first form is for fields that the driver writes: a variant is its value. The second form,
/// with `_ => Unknown`, takes every value, for fields that the chip reports.
macro_rules! register_enums {
    ($(
        $(#[$meta:meta])*
        pub enum $name:ident { $($(#[$note:meta])* $variant:ident = $value:literal,)* }
    )*) => {$(
        $(#[$meta])*
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
        #[repr(u8)]
        pub enum $name { $($(#[$note])* $variant = $value,)* }
    )*};
    ($(
        $(#[$meta:meta])*
        pub enum $name:ident {
            $($(#[$note:meta])* $variant:ident = $value:literal,)*
            _ => Unknown
        }
    )*) => {$(
        $(#[$meta])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        pub enum $name {
            $($(#[$note])* $variant,)*
            /// A value that the data sheet does not name.
            Unknown(u8),
        }

        impl $name {
            /// Meaning of the register's value.
            pub const fn from_register(value: u8) -> Self {
                match value {
                    $($value => Self::$variant,)*
                    other => Self::Unknown(other),
                }
            }

            /// The register's value.
            pub const fn code(self) -> u8 {
                match self {
                    $(Self::$variant => $value,)*
                    Self::Unknown(other) => other,
                }
            }
        }
    )*};
}
pub(crate) use register_enums;
