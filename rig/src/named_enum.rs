//! Enumerations whose values have names on the command line, in files and in tables.

/// Declares such an enumeration: `ALL` of it, `name`, `Display`, and `FromStr`, whose error lists
/// the names.
macro_rules! named_enum {
    (
        $(#[$attribute:meta])* $type:ident, $what:literal;
        $($(#[$doc:meta])* $value:ident = $name:literal,)*
    ) => {
        $(#[$attribute])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
        pub enum $type {
            $($(#[$doc])* $value,)*
        }

        impl $type {
            /// All of them.
            pub const ALL: [Self; [$($name),*].len()] = [$(Self::$value),*];

            /// Its name on the command line, in files and in tables.
            pub fn name(self) -> &'static str {
                match self {
                    $(Self::$value => $name,)*
                }
            }
        }

        impl std::fmt::Display for $type {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str(self.name())
            }
        }

        impl std::str::FromStr for $type {
            type Err = String;

            fn from_str(text: &str) -> Result<Self, String> {
                Self::ALL.into_iter().find(|value| value.name() == text).ok_or_else(|| {
                    let names = Self::ALL.map(Self::name).join(", ");
                    format!("there is no {} {text}; there are {names}", $what)
                })
            }
        }
    };
}

pub(crate) use named_enum;
