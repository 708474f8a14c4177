//! Feather files (Arrow IPC, version 2): flat columns of numbers and text, plain or compressed with LZ4 or zstd.
//!
//! The metadata is read by the Arrow project's own flatbuffer schema; columns become `f64`, `i64` or text. No length in a file is trusted.

use std::collections::BTreeMap;
use std::io::Read;
use std::path::{Path, PathBuf};

use half::f16;
use polars_arrow_format::ipc::planus::ReadAsRoot;
use polars_arrow_format::ipc::{
    CompressionType, FieldRef, FooterRef, MessageHeaderRef, MessageRef, Precision, RecordBatchRef, TypeRef,
};

use crate::import::ImportError;
use crate::import::error::read;

const MAGIC: &[u8] = b"ARROW1";
/// The magic and its padding at the file's beginning.
const HEAD_BYTES: usize = 8;
/// The marker and the length before each message.
const PREFIX_BYTES: usize = 8;
/// Most bytes of a column's part, and of all that a file unpacks to: a sweep has some 100,000 points, which take 2 MB.
const MAX_COLUMN_BYTES: usize = 1 << 26;
const MAX_FILE_BYTES: usize = 1 << 28;
/// Most rows times columns, each of which takes 8 bytes in memory, however few it has in the file.
const MAX_VALUES: usize = 1 << 24;
/// The widest table of a log has 14.
const MAX_COLUMNS: usize = 256;
/// Arrow fills buffers up to a multiple of this.
const PADDING_BYTES: usize = 64;

/// A file's columns.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Table {
    columns: BTreeMap<String, Column>,
    pub(super) n_rows: usize,
    path: PathBuf,
}

#[derive(Debug, Clone, PartialEq)]
enum Column {
    Float(Vec<f64>),
    Integer(Vec<i64>),
    Text(Vec<String>),
}

/// How a column lies in its buffers.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Layout {
    Half,
    Single,
    Double,
    Integer {
        bytes: usize,
        is_signed: bool,
    },
    /// With offsets of so many bytes.
    Text {
        offset_bytes: usize,
    },
}

type Told<T> = Result<T, String>;

impl Table {
    /// Reads a file.
    ///
    /// # Errors
    /// A file that is missing, cut short, damaged or no Arrow file; a column of another type than numbers and text; missing values.
    pub(super) fn read(path: &Path) -> Result<Self, ImportError> {
        let bytes = read(path)?;
        let (columns, n_rows) = parse(&bytes).map_err(|message| ImportError::at(path, message))?;
        Ok(Self { columns, n_rows, path: path.to_owned() })
    }

    fn column(&self, name: &str) -> Result<&Column, ImportError> {
        self.columns.get(name).ok_or_else(|| {
            let found: Vec<&String> = self.columns.keys().collect();
            ImportError::at(&self.path, format!("the table has the columns {found:?} and lacks `{name}`"))
        })
    }

    /// A fault of the table.
    pub(super) fn fault(&self, message: String) -> ImportError {
        ImportError::at(&self.path, message)
    }

    fn wrong(&self, name: &str, wanted: &str) -> ImportError {
        ImportError::at(&self.path, format!("the column `{name}` does not hold {wanted}"))
    }

    /// A column of finite numbers.
    pub(super) fn floats(&self, name: &str) -> Result<Vec<f64>, ImportError> {
        let numbers = match self.column(name)? {
            Column::Float(numbers) => numbers.clone(),
            Column::Integer(numbers) => numbers.iter().map(|number| *number as f64).collect(),
            Column::Text(_) => return Err(self.wrong(name, "numbers")),
        };
        if let Some(row) = numbers.iter().position(|number| !number.is_finite()) {
            return Err(self.wrong(name, &format!("a finite number in row {row}")));
        }
        Ok(numbers)
    }

    /// A column of numbers, finite or not, as floats.
    pub(super) fn raw_floats(&self, name: &str) -> Result<Vec<f32>, ImportError> {
        match self.column(name)? {
            Column::Float(numbers) => Ok(numbers.iter().map(|number| *number as f32).collect()),
            Column::Integer(numbers) => Ok(numbers.iter().map(|number| *number as f32).collect()),
            Column::Text(_) => Err(self.wrong(name, "numbers")),
        }
    }

    pub(super) fn integers(&self, name: &str) -> Result<&[i64], ImportError> {
        match self.column(name)? {
            Column::Integer(numbers) => Ok(numbers),
            _ => Err(self.wrong(name, "whole numbers")),
        }
    }

    /// Times in nanoseconds.
    pub(super) fn times_ns(&self, name: &str) -> Result<Vec<u64>, ImportError> {
        let times = self.integers(name)?.iter().map(|time| u64::try_from(*time).ok()).collect::<Option<_>>();
        times.ok_or_else(|| self.wrong(name, "times from 0 on"))
    }

    pub(super) fn texts(&self, name: &str) -> Result<&[String], ImportError> {
        match self.column(name)? {
            Column::Text(texts) => Ok(texts),
            _ => Err(self.wrong(name, "text")),
        }
    }
}

fn parse(bytes: &[u8]) -> Told<(BTreeMap<String, Column>, usize)> {
    let damaged = |_| "the file is damaged: its Arrow metadata cannot be read".to_owned();
    let cut = || "the file is cut short or no Arrow file (feather, version 2)".to_owned();
    let ends_right = bytes.len() >= 2 * HEAD_BYTES + 4 && bytes.starts_with(MAGIC) && bytes.ends_with(MAGIC);
    let tail = bytes.len().saturating_sub(MAGIC.len() + 4);
    let length = bytes.get(tail..tail + 4).filter(|_| ends_right).ok_or_else(cut)?;
    let footer_bytes = i32::from_le_bytes(length.try_into().expect("four bytes were taken"));
    let begin =
        usize::try_from(footer_bytes).ok().and_then(|length| tail.checked_sub(length)).ok_or_else(cut)?;
    let footer = FooterRef::read_as_root(&bytes[begin..tail]).map_err(damaged)?;
    let schema = footer.schema().map_err(damaged)?.ok_or_else(cut)?;
    let mut fields = Vec::new();
    for field in schema.fields().map_err(damaged)?.into_iter().flatten() {
        if fields.len() == MAX_COLUMNS {
            return Err(format!("the table has more than {MAX_COLUMNS} columns; up to so many are read"));
        }
        let field = field.map_err(damaged)?;
        let name = field.name().map_err(damaged)?.unwrap_or_default().to_owned();
        let layout = layout_of(&field).map_err(damaged)?;
        fields.push((
            name.clone(),
            layout.ok_or_else(|| format!("the column `{name}` holds neither numbers nor text"))?,
        ));
    }
    let mut columns: BTreeMap<String, Column> =
        fields.iter().map(|(name, layout)| (name.clone(), layout.empty())).collect();
    let mut n_rows = 0;
    let mut n_left_bytes = MAX_FILE_BYTES;
    for block in footer.record_batches().map_err(damaged)?.into_iter().flatten() {
        let at = |number: i64| usize::try_from(number).map_err(|_| cut());
        let (begin, body_bytes) = (at(block.offset())?, at(block.body_length())?);
        let body = begin.checked_add(at(block.meta_data_length().into())?).ok_or_else(cut)?;
        let head = bytes.get(begin.saturating_add(PREFIX_BYTES)..body).ok_or_else(cut)?;
        let body = bytes.get(body..body.saturating_add(body_bytes)).ok_or_else(cut)?;
        let message = MessageRef::read_as_root(head).map_err(damaged)?;
        let Some(MessageHeaderRef::RecordBatch(batch)) = message.header().map_err(damaged)? else {
            return Err(cut());
        };
        let n_more = usize::try_from(batch.length().map_err(damaged)?).map_err(|_| cut())?;
        n_rows = n_more.checked_add(n_rows).ok_or_else(cut)?;
        if n_rows.saturating_mul(fields.len()) > MAX_VALUES {
            return Err(format!(
                "the table has {n_rows} rows of {} columns; up to {MAX_VALUES} values are read",
                fields.len()
            ));
        }
        add_batch(&batch, n_more, body, &fields, &mut columns, &mut n_left_bytes)?;
    }
    Ok((columns, n_rows))
}

fn layout_of(field: &FieldRef<'_>) -> Result<Option<Layout>, polars_arrow_format::ipc::planus::Error> {
    // A dictionary's column holds numbers of its words, which are elsewhere.
    if field.dictionary()?.is_some() {
        return Ok(None);
    }
    let long = Layout::Integer { bytes: 8, is_signed: true };
    Ok(match field.type_()? {
        Some(TypeRef::FloatingPoint(number)) => Some(match number.precision()? {
            Precision::Half => Layout::Half,
            Precision::Single => Layout::Single,
            Precision::Double => Layout::Double,
        }),
        Some(TypeRef::Int(number)) => {
            let bytes = usize::try_from(number.bit_width()? / 8).unwrap_or_default();
            let is_signed = number.is_signed()?;
            [1, 2, 4, 8].contains(&bytes).then_some(Layout::Integer { bytes, is_signed })
        }
        Some(TypeRef::Timestamp(_) | TypeRef::Duration(_)) => Some(long),
        Some(TypeRef::Utf8(_)) => Some(Layout::Text { offset_bytes: 4 }),
        Some(TypeRef::LargeUtf8(_)) => Some(Layout::Text { offset_bytes: 8 }),
        _ => None,
    })
}

/// Adds a batch's rows to the columns, and takes what they unpack to from the bytes that are left to the file.
fn add_batch(
    batch: &RecordBatchRef<'_>,
    n_rows: usize,
    body: &[u8],
    fields: &[(String, Layout)],
    columns: &mut BTreeMap<String, Column>,
    n_left_bytes: &mut usize,
) -> Told<()> {
    let damaged = |_| "the file is damaged: a batch's metadata cannot be read".to_owned();
    let short = || "the file is damaged: a batch has fewer buffers than its columns need".to_owned();
    let codec = batch
        .compression()
        .map_err(damaged)?
        .map(|compression| compression.codec())
        .transpose()
        .map_err(damaged)?;
    let mut nodes = batch.nodes().map_err(damaged)?.into_iter().flatten();
    let mut buffers = batch.buffers().map_err(damaged)?.into_iter().flatten();
    for (name, layout) in fields {
        let node = nodes.next().ok_or_else(short)?;
        if node.null_count() != 0 {
            return Err(format!(
                "the column `{name}` has {} missing values; none may be missing",
                node.null_count()
            ));
        }
        let mut buffer = |n_needed: usize| -> Told<Vec<u8>> {
            let buffer = buffers.next().ok_or_else(short)?;
            let at = |number: i64| usize::try_from(number).map_err(|_| short());
            let begin = at(buffer.offset())?;
            let packed = body.get(begin..begin.saturating_add(at(buffer.length())?)).ok_or_else(short)?;
            let n_most = n_needed.next_multiple_of(PADDING_BYTES).min(MAX_COLUMN_BYTES).min(*n_left_bytes);
            let bytes = unpack(packed, codec, n_most).map_err(|why| {
                format!("the column `{name}` cannot be unpacked ({why}); the file is damaged")
            })?;
            *n_left_bytes -= bytes.len();
            Ok(bytes)
        };
        buffer(n_rows.div_ceil(8))?; // Which values are there: all.
        let told =
            || format!("the column `{name}` has less data than its {n_rows} rows need; the file is damaged");
        let column = columns.get_mut(name).expect("each field has its column");
        match (layout, column) {
            (Layout::Text { offset_bytes }, Column::Text(texts)) => {
                let offsets = buffer((n_rows + 1) * offset_bytes)?;
                let end = offsets.get(n_rows * offset_bytes..(n_rows + 1) * offset_bytes);
                let n_bytes = match end {
                    Some(end) => usize::try_from(signed(end)).map_err(|_| told())?,
                    None if n_rows == 0 => 0,
                    None => return Err(told()),
                };
                let data = buffer(n_bytes)?;
                append_texts(&offsets, &data, *offset_bytes, n_rows, texts).ok_or_else(told)?;
            }
            (layout, column) => {
                let data = buffer(n_rows * layout.value_bytes())?;
                layout.append_numbers(&data, n_rows, column).ok_or_else(told)?;
            }
        }
    }
    Ok(())
}

/// A buffer's bytes, `n_most` at most: its length stands before them where they are compressed.
fn unpack(packed: &[u8], codec: Option<CompressionType>, n_most: usize) -> Told<Vec<u8>> {
    let plain = |bytes: &[u8]| bytes[..bytes.len().min(n_most)].to_vec();
    let Some(codec) = codec.filter(|_| !packed.is_empty()) else { return Ok(plain(packed)) };
    let (length, packed) = packed.split_first_chunk::<8>().ok_or("no length")?;
    let length = i64::from_le_bytes(*length);
    if length == -1 {
        return Ok(plain(packed));
    }
    let length = u64::try_from(length).map_err(|_| "a length below 0")?;
    if length > n_most as u64 {
        return Err(format!("a part would have {length} bytes; up to {n_most} are valid"));
    }
    let mut bytes = Vec::new();
    let read = match codec {
        CompressionType::Lz4Frame => {
            lz4_flex::frame::FrameDecoder::new(packed).take(length).read_to_end(&mut bytes)
        }
        CompressionType::Zstd => zstd::stream::read::Decoder::new(packed)
            .and_then(|decoder| decoder.take(length).read_to_end(&mut bytes)),
    };
    read.map_err(|error| error.to_string())?;
    if bytes.len() as u64 == length { Ok(bytes) } else { Err(format!("{} of {length} bytes", bytes.len())) }
}

fn append_texts(
    offsets: &[u8],
    data: &[u8],
    offset_bytes: usize,
    n_rows: usize,
    texts: &mut Vec<String>,
) -> Option<()> {
    let offset = |row: usize| -> Option<usize> {
        let bytes = offsets.get(row * offset_bytes..(row + 1) * offset_bytes)?;
        usize::try_from(signed(bytes)).ok()
    };
    for row in 0..n_rows {
        let text = data.get(offset(row)?..offset(row + 1)?)?;
        texts.push(std::str::from_utf8(text).ok()?.to_owned());
    }
    Some(())
}

/// A little-endian whole number with its sign.
fn signed(bytes: &[u8]) -> i64 {
    let fill = if bytes.last().is_some_and(|byte| byte & 0x80 != 0) { 0xff } else { 0 };
    let mut whole = [fill; 8];
    whole[..bytes.len()].copy_from_slice(bytes);
    i64::from_le_bytes(whole)
}

impl Layout {
    /// Bytes of a number.
    fn value_bytes(self) -> usize {
        match self {
            Self::Half => 2,
            Self::Single => 4,
            Self::Double => 8,
            Self::Integer { bytes, .. } => bytes,
            Self::Text { offset_bytes } => offset_bytes,
        }
    }

    fn empty(self) -> Column {
        match self {
            Self::Half | Self::Single | Self::Double => Column::Float(Vec::new()),
            Self::Integer { .. } => Column::Integer(Vec::new()),
            Self::Text { .. } => Column::Text(Vec::new()),
        }
    }

    fn append_numbers(self, data: &[u8], n_rows: usize, column: &mut Column) -> Option<()> {
        match (self, column) {
            (Self::Half, Column::Float(numbers)) => {
                let data = data.get(..n_rows.checked_mul(2)?)?;
                numbers.extend(data.as_chunks().0.iter().map(|bytes| f16::from_le_bytes(*bytes).to_f64()));
            }
            (Self::Single, Column::Float(numbers)) => {
                let data = data.get(..n_rows.checked_mul(4)?)?;
                numbers.extend(data.as_chunks().0.iter().map(|bytes| f64::from(f32::from_le_bytes(*bytes))));
            }
            (Self::Double, Column::Float(numbers)) => {
                let data = data.get(..n_rows.checked_mul(8)?)?;
                numbers.extend(data.as_chunks().0.iter().map(|bytes| f64::from_le_bytes(*bytes)));
            }
            (Self::Integer { bytes, is_signed }, Column::Integer(numbers)) => {
                let data = data.get(..n_rows.checked_mul(bytes)?)?;
                numbers.extend(data.chunks_exact(bytes).map(|of| {
                    let mut whole = [0; 8];
                    whole[..bytes].copy_from_slice(of);
                    if is_signed { signed(of) } else { i64::from_le_bytes(whole) }
                }));
            }
            _ => return None,
        }
        Some(())
    }
}
