//! Message types from their own text: what a bag's `ros2msg` schema says of a message's fields, in order.
//!
//! The text is the `.msg` file, then, after lines of `=`, a `MSG: package/Type` and its file for each type it needs.
//! Constants, defaults and bounds do not change how a message lies in memory and are passed over.

use std::collections::BTreeMap;

use thiserror::Error;

/// A message type with all types it is made of.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MessageType {
    /// `sensor_msgs/PointCloud2`: without the `/msg/` that some writers put in between.
    pub name: String,
    /// The types, this one first; fields name them by index.
    pub structs: Vec<StructType>,
}

/// The fields of one type in the order in which they are packed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StructType {
    pub name: String,
    pub fields: Vec<FieldType>,
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FieldType {
    pub name: String,
    pub element: Element,
    pub count: Count,
}

/// What one element of a field is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Element {
    Number(NumberType),
    Text,
    WideText,
    /// Index into [`MessageType::structs`].
    Struct(usize),
}

/// How many elements a field has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Count {
    One,
    /// As many as the type says.
    Fixed(usize),
    /// As many as the message says.
    Any,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NumberType {
    Bool,
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F32,
    F64,
}

impl NumberType {
    #[must_use]
    pub const fn size(self) -> usize {
        match self {
            Self::Bool | Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::I64 | Self::U64 | Self::F64 => 8,
        }
    }

    /// Reads one value; `bytes` has its size.
    #[must_use]
    pub fn read(self, bytes: &[u8], is_big_endian: bool) -> f64 {
        macro_rules! read {
            ($Type:ty) => {{
                let bytes = bytes.try_into().expect("the caller cuts as many bytes as the type has");
                if is_big_endian { <$Type>::from_be_bytes(bytes) } else { <$Type>::from_le_bytes(bytes) }
            }};
        }
        match self {
            Self::Bool => f64::from(u8::from(bytes[0] != 0)),
            Self::I8 => f64::from(bytes[0].cast_signed()),
            Self::U8 => f64::from(bytes[0]),
            Self::I16 => f64::from(read!(i16)),
            Self::U16 => f64::from(read!(u16)),
            Self::I32 => f64::from(read!(i32)),
            Self::U32 => f64::from(read!(u32)),
            Self::I64 => read!(i64) as f64,
            Self::U64 => read!(u64) as f64,
            Self::F32 => f64::from(read!(f32)),
            Self::F64 => read!(f64),
        }
    }

    /// As [`Self::read`], exactly, for the types of whole numbers.
    #[must_use]
    pub fn read_whole(self, bytes: &[u8], is_big_endian: bool) -> i128 {
        let mut eight = [0; 8];
        match (self, is_big_endian) {
            (Self::U64 | Self::I64, true) => eight.copy_from_slice(bytes),
            (Self::U64 | Self::I64, false) => {
                eight.iter_mut().rev().zip(bytes).for_each(|(to, from)| *to = *from);
            }
            _ => return self.read(bytes, is_big_endian) as i128,
        }
        if self == Self::I64 {
            i128::from(i64::from_be_bytes(eight))
        } else {
            i128::from(u64::from_be_bytes(eight))
        }
    }

    fn from_name(name: &str) -> Option<Self> {
        Some(match name {
            "bool" => Self::Bool,
            "int8" => Self::I8,
            "uint8" | "byte" | "char" => Self::U8,
            "int16" => Self::I16,
            "uint16" => Self::U16,
            "int32" => Self::I32,
            "uint32" => Self::U32,
            "int64" => Self::I64,
            "uint64" => Self::U64,
            "float32" => Self::F32,
            "float64" => Self::F64,
            _ => return None,
        })
    }
}

/// Types lie in types at most so deep; those that cars send have six levels.
const DEEPEST: usize = 64;
/// Most fields that a search for numbers looks at: types that hold each other twice have more than any memory.
const MOST_PATHS: usize = 100_000;

/// What is wrong with a schema's text.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum SchemaError {
    #[error("its schema text is empty")]
    Empty,
    #[error("its schema has the line `{line}`; `type name` is needed")]
    Line { line: String },
    #[error("its schema needs the type `{wanted}`, which the text does not define")]
    Undefined { wanted: String },
    #[error("its schema's type `{name}` holds itself")]
    Endless { name: String },
    #[error(
        "its schema's type `{name}` lies in others, or holds others, that lie in each other; up to {DEEPEST} may"
    )]
    Deep { name: String },
}

/// The type's name as this module spells it.
#[must_use]
pub fn short_name(name: &str) -> String {
    name.replacen("/msg/", "/", 1)
}

impl MessageType {
    /// Reads a type of a `ros2msg` schema.
    ///
    /// # Errors
    /// The text is empty, has a line that is no field, or needs a type that it does not define.
    pub fn parse(name: &str, text: &str) -> Result<Self, SchemaError> {
        let name = short_name(name);
        let mut parts: BTreeMap<String, Vec<&str>> = BTreeMap::new();
        let mut part = name.clone();
        for line in text.lines().map(str::trim) {
            if line.len() >= 3 && line.bytes().all(|byte| byte == b'=') {
                continue;
            }
            if let Some(next) = line.strip_prefix("MSG:") {
                part = short_name(next.trim());
            }
            let lines = parts.entry(part.clone()).or_default();
            if !line.is_empty() && !line.starts_with('#') && !line.starts_with("MSG:") {
                lines.push(line);
            }
        }
        if text.trim().is_empty() {
            return Err(SchemaError::Empty);
        }
        for known in ["builtin_interfaces/Time", "builtin_interfaces/Duration"] {
            parts.entry(known.to_owned()).or_insert_with(|| vec!["int32 sec", "uint32 nanosec"]);
        }
        let mut builder = Builder { parts, structs: Vec::new(), depths: Vec::new(), open: Vec::new() };
        builder.build(&name)?;
        Ok(Self { name, structs: builder.structs })
    }

    /// Paths of all numbers in the type, such as `twist.twist.linear.x`; not those within lists.
    #[must_use]
    pub fn number_paths(&self) -> Vec<String> {
        let (mut paths, mut n_left) = (Vec::new(), MOST_PATHS);
        self.collect_paths(0, "", &mut paths, &mut n_left);
        paths
    }

    fn collect_paths(&self, struct_idx: usize, prefix: &str, paths: &mut Vec<String>, n_left: &mut usize) {
        for field in &self.structs[struct_idx].fields {
            let Some(left) = n_left.checked_sub(1) else { return };
            *n_left = left;
            let path = format!("{prefix}{}", field.name);
            match (field.element, field.count) {
                (Element::Number(_), Count::One) => paths.push(path),
                (Element::Struct(inner), Count::One) => {
                    self.collect_paths(inner, &format!("{path}."), paths, n_left);
                }
                _ => {}
            }
        }
    }
}

struct Builder<'a> {
    parts: BTreeMap<String, Vec<&'a str>>,
    structs: Vec<StructType>,
    /// Levels in each struct, itself among them.
    depths: Vec<usize>,
    /// Types that are being built: one that needs itself would never end.
    open: Vec<String>,
}

impl Builder<'_> {
    fn build(&mut self, name: &str) -> Result<usize, SchemaError> {
        if self.open.iter().any(|open| open == name) {
            return Err(SchemaError::Endless { name: name.to_owned() });
        }
        if let Some(known) = self.structs.iter().position(|known| known.name == name) {
            return Ok(known);
        }
        if self.open.len() >= DEEPEST {
            return Err(SchemaError::Deep { name: name.to_owned() });
        }
        let Some(lines) = self.parts.get(name).cloned() else {
            return Err(SchemaError::Undefined { wanted: name.to_owned() });
        };
        self.open.push(name.to_owned());
        let struct_idx = self.structs.len();
        self.structs.push(StructType { name: name.to_owned(), fields: Vec::new() });
        self.depths.push(1);
        let mut fields = Vec::new();
        for line in lines {
            fields.extend(self.field(name, line)?);
        }
        if fields.is_empty() {
            // No message is empty on the wire: ROS 2 puts one byte there.
            let name = "structure_needs_at_least_one_member".to_owned();
            fields.push(FieldType { name, element: Element::Number(NumberType::U8), count: Count::One });
        }
        let depth_of = |field: &FieldType| match field.element {
            Element::Struct(inner) => self.depths[inner],
            _ => 0,
        };
        let depth = 1 + fields.iter().map(depth_of).max().unwrap_or(0);
        if depth > DEEPEST {
            return Err(SchemaError::Deep { name: name.to_owned() });
        }
        self.depths[struct_idx] = depth;
        self.structs[struct_idx].fields = fields;
        self.open.pop();
        Ok(struct_idx)
    }

    /// The field of a line; `None` for a constant.
    fn field(&mut self, owner: &str, line: &str) -> Result<Option<FieldType>, SchemaError> {
        let fail = || SchemaError::Line { line: line.to_owned() };
        let (type_text, rest) = line.split_once(char::is_whitespace).ok_or_else(fail)?;
        let rest = rest.trim_start();
        let end = rest.find(|c: char| c.is_whitespace() || c == '=' || c == '#').unwrap_or(rest.len());
        let (name, after) = rest.split_at(end);
        if name.is_empty() {
            return Err(fail());
        }
        if after.trim_start().starts_with('=') {
            return Ok(None);
        }
        let (base, count) = match type_text.split_once('[') {
            None => (type_text, Count::One),
            Some((base, "]")) => (base, Count::Any),
            Some((base, bound)) if bound.starts_with("<=") => (base, Count::Any),
            Some((base, size)) => {
                let size = size.strip_suffix(']').and_then(|size| size.parse().ok()).ok_or_else(fail)?;
                (base, Count::Fixed(size))
            }
        };
        let base = base.split_once("<=").map_or(base, |(base, _)| base);
        let element = match (NumberType::from_name(base), base) {
            (Some(number), _) => Element::Number(number),
            (None, "string") => Element::Text,
            (None, "wstring") => Element::WideText,
            (None, "time") => Element::Struct(self.build("builtin_interfaces/Time")?),
            (None, "duration") => Element::Struct(self.build("builtin_interfaces/Duration")?),
            (None, base) => Element::Struct(self.build(&self.resolve(owner, base))?),
        };
        Ok(Some(FieldType { name: name.to_owned(), element, count }))
    }

    /// The full name of a type that a type of `owner`'s package names.
    fn resolve(&self, owner: &str, name: &str) -> String {
        if name.contains('/') {
            return short_name(name);
        }
        let package = owner.split('/').next().unwrap_or_default();
        let own = format!("{package}/{name}");
        if self.parts.contains_key(&own) || name != "Header" { own } else { "std_msgs/Header".to_owned() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SPEED: &str = "# speed of the car\nuint8 UNIT_MPS=0x01\nstring UNIT = \"m/s # no comment\"\nHeader header\n\
        float32[<=3] samples\nstring<=8 name \"car\"\nWheel[4] wheels # all four\n\
        ================================================================================\n\
        MSG: std_msgs/msg/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n=====\nMSG: car/Wheel\nfloat64 rps 0.0\n";

    #[test]
    fn constants_comments_bounds_and_defaults_leave_the_fields() {
        let speed = MessageType::parse("car/msg/Speed", SPEED).unwrap();
        let fields = &speed.structs[0].fields;
        let names: Vec<&str> = fields.iter().map(|field| field.name.as_str()).collect();
        assert_eq!(names, ["header", "samples", "name", "wheels"]);
        assert_eq!(
            (fields[1].count, fields[2].element, fields[3].count),
            (Count::Any, Element::Text, Count::Fixed(4))
        );
        assert_eq!(speed.number_paths(), ["header.stamp.sec", "header.stamp.nanosec"]);
    }

    #[test]
    fn a_schema_that_cannot_be_is_refused_in_words() {
        let told = |text: &str| MessageType::parse("car/Speed", text).unwrap_err().to_string();
        assert_eq!(told(" \n"), "its schema text is empty");
        assert!(told("Wheel w").contains("needs the type `car/Wheel`"));
        assert!(told("float64").contains("`float64`; `type name` is needed"));
        assert!(told("Wheel w\n===\nMSG: car/Wheel\nSpeed s\n").contains("holds itself"));
        let level = |i: usize| format!("===\nMSG: car/T{i}\nT{} a\nT{} b\n", i + 1, i + 1);
        let levels =
            |n: usize| (0..n).map(level).collect::<String>() + &format!("===\nMSG: car/T{n}\nuint8 x\n");
        assert!(told(&format!("T0 t\n{}", levels(100))).contains("up to 64 may"));
        // Its later half is known when the earlier one needs it.
        assert!(told(&format!("T40 u\nT0 t\n{}", levels(80))).contains("up to 64 may"));
        // Twice in each other forty times: there is an end to the search.
        let wide = MessageType::parse("car/Speed", &format!("T0 t\n{}", levels(40))).unwrap();
        assert!(wide.number_paths().len() < MOST_PATHS);
    }
}
