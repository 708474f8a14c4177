//! The macro that defines a config: unit, doc comment, default and bounds of each key in one place.

/// Defines a config with unit, default and bounds of each key in one place: `/// unit`, `key: Type = default, in bounds;`.
///
/// A key without numbers has no bounds. In files every key may be left out, and one that is not known is an error.
macro_rules! define_config {
    ($(#[$($of_struct:tt)*])* pub struct $Name:ident {
        $($(#[$($of_key:tt)*])* $key:ident: $Type:ty = $default:expr $(, in $rule:expr)?;)*
    }) => {
        $(#[$($of_struct)*])*
        #[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
        #[serde(deny_unknown_fields, default)]
        pub struct $Name { $($(#[$($of_key)*])* pub $key: $Type),* }

        impl Default for $Name {
            fn default() -> Self {
                Self { $($key: $default),* }
            }
        }

        impl $crate::config::Bounds for $Name {
            const BOUNDS: $crate::config::Keys = &[$($((stringify!($key), $rule),)?)*];
            const DOCS: $crate::config::Docs =
                &[$((stringify!($key), $crate::config::doc_lines!(@ [] $([$($of_key)*])*))),*];
            const ABOUT: $crate::config::Lines = $crate::config::doc_lines!(@ [] $([$($of_struct)*])*);
        }
    };
}
pub(crate) use define_config;

/// The lines of a doc comment among attributes, each in brackets.
macro_rules! doc_lines {
    (@ [$($line:expr,)*]) => { &[$($line),*] };
    (@ [$($line:expr,)*] [doc = $text:literal] $($rest:tt)*) => {
        $crate::config::doc_lines!(@ [$($line,)* $text,] $($rest)*)
    };
    (@ [$($line:expr,)*] [$($other:tt)*] $($rest:tt)*) => {
        $crate::config::doc_lines!(@ [$($line,)*] $($rest)*)
    };
}
pub(crate) use doc_lines;
