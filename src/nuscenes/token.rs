//! Tokens: the keys of nuScenes' rows, 32 hexadecimal digits, or any text in folders of others.

use std::fmt;

use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::files::sha256_hex;

/// A row's key. Sixteen bytes where it is 32 lower-case hexadecimal digits: whole nuScenes has millions.
#[derive(Clone, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Token {
    Hex([u8; 16]),
    Text(Box<str>),
}

impl Token {
    /// The token of what a key names: the same in each run.
    #[must_use]
    pub fn of(table: &str, key: &str) -> Self {
        Self::from(&sha256_hex(format!("{table}/{key}").as_bytes())[..32])
    }

    /// The token that points nowhere, as `prev` of a first row.
    #[must_use]
    pub fn none() -> Self {
        Self::Text("".into())
    }

    #[must_use]
    pub fn is_none(&self) -> bool {
        matches!(self, Self::Text(text) if text.is_empty())
    }
}

impl From<&str> for Token {
    fn from(text: &str) -> Self {
        let digits = text.as_bytes();
        let value = |digit: u8| match digit {
            b'0'..=b'9' => Some(digit - b'0'),
            b'a'..=b'f' => Some(digit - b'a' + 10),
            _ => None,
        };
        let mut bytes = [0; 16];
        if digits.len() != 32 {
            return Self::Text(text.into());
        }
        for (byte, pair) in bytes.iter_mut().zip(digits.chunks_exact(2)) {
            let (Some(high), Some(low)) = (value(pair[0]), value(pair[1])) else {
                return Self::Text(text.into());
            };
            *byte = high << 4 | low;
        }
        Self::Hex(bytes)
    }
}

impl fmt::Display for Token {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Hex(bytes) => bytes.iter().try_for_each(|byte| write!(formatter, "{byte:02x}")),
            Self::Text(text) => formatter.write_str(text),
        }
    }
}

impl fmt::Debug for Token {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "Token({self})")
    }
}

impl Serialize for Token {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl<'de> Deserialize<'de> for Token {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Text;
        impl serde::de::Visitor<'_> for Text {
            type Value = Token;

            fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
                formatter.write_str("a token, which is text")
            }

            fn visit_str<E>(self, text: &str) -> Result<Token, E> {
                Ok(Token::from(text))
            }
        }
        deserializer.deserialize_str(Text)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_text_is_kept_as_it_is() {
        for text in
            ["", "ca9a282c9e77460f8360f564131a8af5", "CA9A282C9E77460F8360F564131A8AF5", "scene 1", "ca9a"]
        {
            assert_eq!(Token::from(text).to_string(), text);
        }
        assert!(matches!(Token::of("sample", "a/0"), Token::Hex(_)));
        assert_ne!(Token::of("sample", "a/0"), Token::of("sample", "a/1"));
        assert!(Token::none().is_none() && !Token::from("a").is_none());
    }
}
