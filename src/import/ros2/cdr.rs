//! Messages from CDR bytes and their type: a tree of values, in which long arrays stay the bytes that they are.
//!
//! CDR is XCDR version 1 as ROS 2 writes it: four bytes that say the byte order, then each number at a multiple of its
//! size. One decoder serves all message types, those of a bag's own packages too. Why it is our own: the kept crate with
//! a decoder from schema text, `re_ros_msg`, allocates by lengths that it has not checked, refuses constants such as
//! `0x01` with their whole type, and does not say which field a short message lacks.

use std::fmt;

use thiserror::Error;

use super::schema::{Count, Element, FieldType, MessageType, NumberType};

/// The bytes before the message: representation and options.
const HEADER_BYTES: usize = 4;
/// Fields without bytes, such as arrays of no elements, can nest without end: a message has no more fields than this, and
/// so many more for each of its bytes.
const MOST_FIELDS: usize = 1024;
const MOST_FIELDS_A_BYTE: usize = 8;
/// Writers pad a message's end to at most this boundary.
const MAX_PADDING_BYTES: usize = 8;

/// A value of a message.
#[derive(Debug, Clone, PartialEq)]
pub enum Value<'a> {
    Number(f64),
    /// A whole number, which a float of 64 bits may not hold.
    Whole(i128),
    Text(&'a str),
    Numbers(Numbers<'a>),
    List(Vec<Value<'a>>),
    Struct(Vec<(&'a str, Value<'a>)>),
}

/// An array of numbers as it lies in the message.
#[derive(Debug, Clone, PartialEq)]
pub struct Numbers<'a> {
    pub bytes: &'a [u8],
    number: NumberType,
    is_big_endian: bool,
}

impl Numbers<'_> {
    #[must_use]
    pub fn to_f64(&self) -> Vec<f64> {
        let chunks = self.bytes.chunks_exact(self.number.size());
        chunks.map(|bytes| self.number.read(bytes, self.is_big_endian)).collect()
    }
}

/// Why bytes are no message of a type, or a message lacks a field.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum CdrError {
    #[error("its {found} bytes are too few for a CDR message, which begins with 4 bytes on the byte order")]
    NoHeader { found: usize },
    #[error("its encoding {found:#06x} is none that is read: 0x0000 and 0x0001 are (plain CDR, XCDR 1)")]
    Encoding { found: u16 },
    #[error("it has {found} bytes, which end in the field `{field}` of the type `{name}`")]
    Short { field: String, name: String, found: usize },
    #[error("it would have more than {most} fields in {n_bytes} bytes, by its type `{name}`")]
    Fields { name: String, n_bytes: usize, most: usize },
    #[error("it has {n_bytes} bytes more than its type `{name}` says")]
    Long { name: String, n_bytes: usize },
    #[error("the text in its field `{field}` is not UTF-8")]
    Text { field: String },
    #[error("its field `{field}` is a wstring, which is not read")]
    WideText { field: String },
    #[error("it has no field `{field}`; there are {found}")]
    NoField { field: String, found: String },
    #[error("its field `{field}` is {found}; {wanted} is needed")]
    Kind { field: String, found: &'static str, wanted: &'static str },
}

/// Decodes a message.
///
/// # Errors
/// The bytes are fewer or more than the type says, or not plain CDR.
pub fn decode<'a>(message_type: &'a MessageType, bytes: &'a [u8]) -> Result<Value<'a>, CdrError> {
    let Some((header, body)) = bytes.split_at_checked(HEADER_BYTES) else {
        return Err(CdrError::NoHeader { found: bytes.len() });
    };
    let is_big_endian = match u16::from_be_bytes([header[0], header[1]]) {
        0 => true,
        1 => false,
        found => return Err(CdrError::Encoding { found }),
    };
    let mut decoder =
        Decoder { message_type, bytes: body, position: 0, n_fields: 0, is_big_endian, path: Vec::new() };
    let value = decoder.read_struct(0)?;
    let n_left = body.len() - decoder.position;
    if n_left >= MAX_PADDING_BYTES {
        return Err(CdrError::Long { name: message_type.name.clone(), n_bytes: n_left });
    }
    Ok(value)
}

struct Decoder<'a> {
    message_type: &'a MessageType,
    bytes: &'a [u8],
    position: usize,
    /// Read or begun so far.
    n_fields: usize,
    is_big_endian: bool,
    /// The fields that lead to the one being read.
    path: Vec<&'a str>,
}

impl<'a> Decoder<'a> {
    fn read_struct(&mut self, struct_idx: usize) -> Result<Value<'a>, CdrError> {
        let message_type = self.message_type;
        let fields = &message_type.structs[struct_idx].fields;
        let most = MOST_FIELDS.saturating_add(self.bytes.len().saturating_mul(MOST_FIELDS_A_BYTE));
        // A struct without fields counts, too.
        self.n_fields += fields.len().max(1);
        if self.n_fields > most {
            let (name, n_bytes) = (message_type.name.clone(), self.bytes.len() + HEADER_BYTES);
            return Err(CdrError::Fields { name, n_bytes, most });
        }
        let mut values = Vec::with_capacity(fields.len());
        for field in fields {
            self.path.push(&field.name);
            values.push((field.name.as_str(), self.read_field(field)?));
            self.path.pop();
        }
        Ok(Value::Struct(values))
    }

    fn read_field(&mut self, field: &FieldType) -> Result<Value<'a>, CdrError> {
        let count = match field.count {
            Count::One => return self.read_element(field.element),
            Count::Fixed(count) => count,
            Count::Any => self.read_length()?,
        };
        if let Element::Number(number) = field.element {
            if count > 0 {
                self.align(number.size());
            }
            let bytes = self.take(count.saturating_mul(number.size()))?;
            return Ok(Value::Numbers(Numbers { bytes, number, is_big_endian: self.is_big_endian }));
        }
        // Every element takes a byte or more, so that a length beyond the message is found before memory is taken.
        if count > self.bytes.len().saturating_sub(self.position) {
            return Err(self.short());
        }
        let elements: Result<_, _> = (0..count).map(|_| self.read_element(field.element)).collect();
        Ok(Value::List(elements?))
    }

    fn read_element(&mut self, element: Element) -> Result<Value<'a>, CdrError> {
        match element {
            Element::Struct(struct_idx) => self.read_struct(struct_idx),
            Element::Text => self.read_text(),
            Element::WideText => Err(CdrError::WideText { field: self.path.join(".") }),
            Element::Number(number) => {
                self.align(number.size());
                let bytes = self.take(number.size())?;
                Ok(match number {
                    NumberType::I64 | NumberType::U64 => {
                        Value::Whole(number.read_whole(bytes, self.is_big_endian))
                    }
                    _ => Value::Number(number.read(bytes, self.is_big_endian)),
                })
            }
        }
    }

    fn read_length(&mut self) -> Result<usize, CdrError> {
        self.align(4);
        let bytes = self.take(4)?;
        Ok(NumberType::U32.read(bytes, self.is_big_endian) as usize)
    }

    fn read_text(&mut self) -> Result<Value<'a>, CdrError> {
        let length = self.read_length()?;
        let bytes = self.take(length)?;
        let text = bytes.strip_suffix(&[0]).unwrap_or(bytes);
        let fail = |_| CdrError::Text { field: self.path.join(".") };
        Ok(Value::Text(std::str::from_utf8(text).map_err(fail)?))
    }

    fn align(&mut self, size: usize) {
        self.position = self.position.next_multiple_of(size);
    }

    fn take(&mut self, n_bytes: usize) -> Result<&'a [u8], CdrError> {
        let end = self.position.saturating_add(n_bytes);
        let bytes = self.bytes.get(self.position..end).ok_or_else(|| self.short())?;
        self.position = end;
        Ok(bytes)
    }

    fn short(&self) -> CdrError {
        let (field, name) = (self.path.join("."), self.message_type.name.clone());
        CdrError::Short { field, name, found: self.bytes.len() + HEADER_BYTES }
    }
}

impl<'a> Value<'a> {
    /// The value at a path of names and, in lists, indices: `transforms.0.header.frame_id`, or `transforms[0].header`.
    ///
    /// # Errors
    /// There is no such field; the error names those that there are.
    pub fn at(&self, path: &str) -> Result<Value<'a>, CdrError> {
        let mut here = self;
        let mut steps =
            path.split(['.', '[']).map(|step| step.trim_end_matches(']')).filter(|step| !step.is_empty());
        while let Some(step) = steps.next() {
            let missing = |found: String| CdrError::NoField { field: path.to_owned(), found };
            here = match here {
                Value::Struct(fields) => {
                    let names =
                        || fields.iter().map(|(name, _)| format!("`{name}`")).collect::<Vec<_>>().join(", ");
                    let found = fields.iter().find(|(name, _)| *name == step);
                    &found.ok_or_else(|| missing(names()))?.1
                }
                Value::List(values) => {
                    let found = step.parse().ok().and_then(|idx: usize| values.get(idx));
                    found.ok_or_else(|| missing(format!("{} elements", values.len())))?
                }
                Value::Numbers(numbers) if steps.next().is_none() => {
                    let values = numbers.to_f64();
                    let found = step.parse().ok().and_then(|idx: usize| values.get(idx).copied());
                    return Ok(Value::Number(
                        found.ok_or_else(|| missing(format!("{} elements", values.len())))?,
                    ));
                }
                other => return Err(missing(format!("none in {}", other.kind()))),
            };
        }
        Ok(here.clone())
    }

    /// # Errors
    /// There is no such field, or it is no number.
    pub fn number(&self, path: &str) -> Result<f64, CdrError> {
        match self.at(path)? {
            Value::Number(number) => Ok(number),
            Value::Whole(number) => Ok(number as f64),
            other => Err(other.is_not(path, "a number")),
        }
    }

    /// # Errors
    /// There is no such field, or it is no text.
    pub fn text(&self, path: &str) -> Result<&'a str, CdrError> {
        match self.at(path)? {
            Value::Text(text) => Ok(text),
            other => Err(other.is_not(path, "text")),
        }
    }

    /// # Errors
    /// There is no such field, or it is no array of numbers.
    pub fn numbers(&self, path: &str) -> Result<Numbers<'a>, CdrError> {
        match self.at(path)? {
            Value::Numbers(numbers) => Ok(numbers),
            other => Err(other.is_not(path, "an array of numbers")),
        }
    }

    /// # Errors
    /// There is no such field, or it is no list of messages.
    pub fn list(&self, path: &str) -> Result<Vec<Value<'a>>, CdrError> {
        match self.at(path)? {
            Value::List(values) => Ok(values),
            other => Err(other.is_not(path, "a list")),
        }
    }

    /// The numbers of several fields.
    ///
    /// # Errors
    /// As [`Value::number`].
    pub fn numbers_at<const N: usize>(&self, path: &str, names: [&str; N]) -> Result<[f64; N], CdrError> {
        let part = self.at(path)?;
        let mut numbers = [0.0; N];
        for (number, name) in numbers.iter_mut().zip(names) {
            *number = part.number(name)?;
        }
        Ok(numbers)
    }

    fn kind(&self) -> &'static str {
        match self {
            Self::Number(_) | Self::Whole(_) => "a number",
            Self::Text(_) => "text",
            Self::Numbers(_) => "an array of numbers",
            Self::List(_) => "a list",
            Self::Struct(_) => "a message",
        }
    }

    fn is_not(&self, field: &str, wanted: &'static str) -> CdrError {
        CdrError::Kind { field: field.to_owned(), found: self.kind(), wanted }
    }
}

impl fmt::Display for Value<'_> {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Number(number) => write!(out, "{number}"),
            Self::Whole(number) => write!(out, "{number}"),
            Self::Text(text) => write!(out, "{text}"),
            other => write!(out, "{}", other.kind()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn speed() -> MessageType {
        let text = "string name\nuint8 unit\nfloat64 mps\nuint16[] raw\nuint64 id\nPart[] parts\n\
            ===\nMSG: car/Part\nint16 n\n";
        MessageType::parse("car/Speed", text).unwrap()
    }

    /// `car`, 7, 1.5, [1, 2, 3], 2^63, [-1, 2], laid out by hand.
    fn packed(is_big_endian: bool) -> Vec<u8> {
        let order = |mut bytes: Vec<u8>| {
            if is_big_endian {
                bytes.reverse();
            }
            bytes
        };
        let mut bytes = vec![0, u8::from(!is_big_endian), 0, 0];
        bytes.extend(order(4u32.to_le_bytes().to_vec()));
        bytes.extend(b"car\0");
        bytes.extend([7, 0, 0, 0, 0, 0, 0, 0]);
        bytes.extend(order(1.5f64.to_le_bytes().to_vec()));
        bytes.extend(order(3u32.to_le_bytes().to_vec()));
        [1u16, 2, 3].iter().for_each(|n| bytes.extend(order(n.to_le_bytes().to_vec())));
        bytes.extend([0; 6]); // 34 -> 40
        bytes.extend(order((1u64 << 63).to_le_bytes().to_vec()));
        bytes.extend(order(2u32.to_le_bytes().to_vec()));
        [-1i16, 2].iter().for_each(|n| bytes.extend(order(n.to_le_bytes().to_vec())));
        bytes
    }

    #[test]
    fn both_byte_orders_give_the_same_message() {
        let speed = speed();
        for bytes in [packed(false), packed(true)] {
            let message = decode(&speed, &bytes).unwrap();
            assert_eq!(message.text("name").unwrap(), "car");
            assert_eq!((message.number("unit").unwrap(), message.number("mps").unwrap()), (7.0, 1.5));
            assert_eq!(message.numbers("raw").unwrap().to_f64(), [1.0, 2.0, 3.0]);
            assert_eq!(message.at("id").unwrap(), Value::Whole(1 << 63));
            assert_eq!(
                (message.number("parts[0].n").unwrap(), message.number("raw.2").unwrap()),
                (-1.0, 3.0)
            );
        }
    }

    #[test]
    fn a_message_cut_anywhere_is_refused_in_words() {
        let (speed, bytes) = (speed(), packed(false));
        for n_bytes in 0..bytes.len() {
            let error = decode(&speed, &bytes[..n_bytes]).unwrap_err();
            assert!(matches!(error, CdrError::NoHeader { .. } | CdrError::Short { .. }), "{error}");
        }
        let told = decode(&speed, &bytes[..20]).unwrap_err().to_string();
        assert_eq!(told, "it has 20 bytes, which end in the field `mps` of the type `car/Speed`");
    }

    #[test]
    fn a_length_beyond_the_message_takes_no_memory() {
        let (speed, mut bytes) = (speed(), packed(false));
        let at = bytes.len() - 8;
        bytes[at..at + 4].copy_from_slice(&u32::MAX.to_le_bytes());
        assert!(matches!(decode(&speed, &bytes), Err(CdrError::Short { field, .. }) if field == "parts"));
        bytes.extend([0; 40]);
        assert!(decode(&speed, &bytes).is_err());
    }

    #[test]
    fn another_type_or_encoding_is_told() {
        let (speed, mut bytes) = (speed(), packed(false));
        bytes.extend([0; 16]);
        assert!(matches!(decode(&speed, &bytes), Err(CdrError::Long { n_bytes: 16, .. })));
        bytes[1] = 7;
        assert!(decode(&speed, &bytes).unwrap_err().to_string().contains("0x0007"));
        let bytes = packed(false);
        let message = decode(&speed, &bytes).unwrap();
        let told = message.number("speed").unwrap_err().to_string();
        assert!(told.contains("`mps`") && told.contains("`speed`"), "{told}");
        assert!(message.number("name").unwrap_err().to_string().contains("is text; a number is needed"));
    }
}
