//! Small Argoverse 2 logs for tests, made in code: feather files with one batch, plain or packed, and packed to do harm.

use std::io::{Cursor, Write as _};
use std::path::{Path, PathBuf};

use fs_err as fs;
use half::f16;
use image::{ImageFormat, RgbImage};
use polars_arrow_format::ipc::planus::Builder;
use polars_arrow_format::ipc::{
    Block, BodyCompression, BodyCompressionMethod, Buffer, CompressionType, Field, FieldNode, FloatingPoint,
    Footer, Int, Message, MessageHeader, MetadataVersion, Precision, RecordBatch, Schema, Type, Utf8,
};

/// A column to write.
pub(super) enum Made {
    Half(Vec<f32>),
    Double(Vec<f64>),
    Byte(Vec<u8>),
    Long(Vec<i64>),
    Text(Vec<&'static str>),
    /// One row of a whole number, in a buffer that is packed already.
    Packed(Vec<u8>),
    /// One row of text, whose buffer is packed already and unpacks to so many bytes.
    PackedText(Vec<u8>, i32),
}

/// How a file's buffers are packed, and how often its footer names its one batch.
pub(super) struct BatchPacking {
    pub(super) codec: Option<CompressionType>,
    pub(super) n_batches: usize,
    /// That the batch says it has, where it does not say how many it has.
    pub(super) n_rows: Option<i64>,
}

impl Made {
    fn n_rows(&self) -> usize {
        match self {
            Self::Half(values) => values.len(),
            Self::Double(values) => values.len(),
            Self::Byte(values) => values.len(),
            Self::Long(values) => values.len(),
            Self::Text(values) => values.len(),
            Self::Packed(_) | Self::PackedText(..) => 1,
        }
    }

    fn arrow_type(&self) -> Type {
        let float = |precision| Type::FloatingPoint(Box::new(FloatingPoint { precision }));
        let int = |bit_width, is_signed| Type::Int(Box::new(Int { bit_width, is_signed }));
        match self {
            Self::Half(_) => float(Precision::Half),
            Self::Double(_) => float(Precision::Double),
            Self::Byte(_) => int(8, false),
            Self::Long(_) | Self::Packed(_) => int(64, true),
            Self::Text(_) | Self::PackedText(..) => Type::Utf8(Box::new(Utf8 {})),
        }
    }

    /// The buffers after the one of validity.
    fn buffers(&self, codec: Option<CompressionType>) -> Vec<Vec<u8>> {
        let plain = match self {
            Self::Half(values) => vec![values.iter().flat_map(|v| f16::from_f32(*v).to_le_bytes()).collect()],
            Self::Double(values) => vec![values.iter().flat_map(|v| v.to_le_bytes()).collect()],
            Self::Byte(values) => vec![values.clone()],
            Self::Long(values) => vec![values.iter().flat_map(|v| v.to_le_bytes()).collect()],
            Self::Packed(packed) => return vec![packed.clone()],
            Self::PackedText(packed, end) => {
                let offsets: Vec<u8> = [0, *end].iter().flat_map(|v| v.to_le_bytes()).collect();
                return vec![codec.map_or(offsets.clone(), |codec| pack(&offsets, codec)), packed.clone()];
            }
            Self::Text(values) => {
                let mut end = 0i32;
                let mut offsets = end.to_le_bytes().to_vec();
                for value in values {
                    end += i32::try_from(value.len()).unwrap();
                    offsets.extend(end.to_le_bytes());
                }
                vec![offsets, values.concat().into_bytes()]
            }
        };
        let Some(codec) = codec else { return plain };
        let packed = |bytes: Vec<u8>| if bytes.is_empty() { bytes } else { pack(&bytes, codec) };
        plain.into_iter().map(packed).collect()
    }
}

/// A whole feather file, plain or packed with LZ4.
pub(super) fn feather(columns: &[(&str, Made)], is_packed: bool) -> Vec<u8> {
    let codec = is_packed.then_some(CompressionType::Lz4Frame);
    feather_as(columns, &BatchPacking { codec, n_batches: 1, n_rows: None })
}

/// A whole feather file that is packed so.
pub(super) fn feather_as(columns: &[(&str, Made)], packing: &BatchPacking) -> Vec<u8> {
    let (mut body, mut buffers, mut nodes) = (Vec::new(), Vec::new(), Vec::new());
    for (_, column) in columns {
        nodes.push(FieldNode { length: column.n_rows() as i64, null_count: 0 });
        for bytes in std::iter::once(Vec::new()).chain(column.buffers(packing.codec)) {
            buffers.push(Buffer { offset: body.len() as i64, length: bytes.len() as i64 });
            body.extend(bytes);
            body.resize(body.len().next_multiple_of(8), 0);
        }
    }
    let method = BodyCompressionMethod::Buffer;
    let compression = packing.codec.map(|codec| Box::new(BodyCompression { codec, method }));
    let length = packing.n_rows.unwrap_or(columns.first().map_or(0, |(_, column)| column.n_rows()) as i64);
    let batch = RecordBatch {
        length,
        nodes: Some(nodes),
        buffers: Some(buffers),
        compression,
        variadic_buffer_counts: None,
    };
    let message = Message {
        version: MetadataVersion::V5,
        header: Some(MessageHeader::RecordBatch(Box::new(batch))),
        body_length: body.len() as i64,
        custom_metadata: None,
    };
    let mut head = Builder::new().finish(&message, None).to_vec();
    head.resize(head.len().next_multiple_of(8), 0);
    let field = |(name, column): &(&str, Made)| Field {
        name: Some((*name).to_owned()),
        nullable: true,
        type_: Some(column.arrow_type()),
        ..Field::default()
    };
    let schema = Schema { fields: Some(columns.iter().map(field).collect()), ..Schema::default() };
    let block = Block { offset: 8, meta_data_length: head.len() as i32 + 8, body_length: body.len() as i64 };
    let footer = Footer {
        version: MetadataVersion::V5,
        schema: Some(Box::new(schema)),
        dictionaries: None,
        record_batches: Some(vec![block; packing.n_batches]),
        custom_metadata: None,
    };
    let footer = Builder::new().finish(&footer, None).to_vec();
    let mut file = b"ARROW1\0\0".to_vec();
    file.extend([0xff; 4]);
    file.extend((head.len() as i32).to_le_bytes());
    file.extend(head);
    file.extend(body);
    file.extend(&footer);
    file.extend((footer.len() as i32).to_le_bytes());
    file.extend(b"ARROW1");
    file
}

fn pack(plain: &[u8], codec: CompressionType) -> Vec<u8> {
    pack_all(std::iter::once(plain), plain.len(), codec)
}

/// A buffer of zeros, packed.
pub(super) fn pack_zeros(n_bytes: usize, codec: CompressionType) -> Vec<u8> {
    let part = vec![0; 1 << 20];
    assert!(n_bytes.is_multiple_of(part.len()), "whole parts are written");
    pack_all(std::iter::repeat_n(part.as_slice(), n_bytes / part.len()), n_bytes, codec)
}

fn pack_all<'a>(parts: impl Iterator<Item = &'a [u8]>, n_bytes: usize, codec: CompressionType) -> Vec<u8> {
    let length = (n_bytes as i64).to_le_bytes().to_vec();
    match codec {
        CompressionType::Lz4Frame => {
            let mut encoder = lz4_flex::frame::FrameEncoder::new(length);
            parts.for_each(|part| encoder.write_all(part).unwrap());
            encoder.finish().unwrap()
        }
        CompressionType::Zstd => {
            let mut encoder = zstd::stream::write::Encoder::new(length, 1).unwrap();
            parts.for_each(|part| encoder.write_all(part).unwrap());
            encoder.finish().unwrap()
        }
    }
}

pub(super) const FIRST_NS: i64 = 315_973_157_959_879_000;

pub(super) fn write(path: PathBuf, bytes: &[u8]) {
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    fs::write(path, bytes).unwrap();
}

fn pose_columns(tx_m: Vec<f64>) -> Vec<(&'static str, Made)> {
    let n = tx_m.len();
    let zeros = || Made::Double(vec![0.0; n]);
    vec![
        ("qw", Made::Double(vec![1.0; n])),
        ("qx", zeros()),
        ("qy", zeros()),
        ("qz", zeros()),
        ("tx_m", Made::Double(tx_m)),
        ("ty_m", zeros()),
        ("tz_m", zeros()),
    ]
}

/// A sweep over a road 0.33 m below the axle.
fn sweep() -> Vec<(&'static str, Made)> {
    let (mut x, mut y) = (Vec::new(), Vec::new());
    for i in -40..90 {
        for j in -30..=30 {
            x.push(i as f32 * 0.25);
            y.push(j as f32 * 0.25);
        }
    }
    let n = x.len();
    vec![
        ("x", Made::Half(x)),
        ("y", Made::Half(y)),
        ("z", Made::Half(vec![-0.33; n])),
        ("intensity", Made::Byte((0..n).map(|i| (i % 256) as u8).collect())),
        ("laser_number", Made::Byte((0..n).map(|i| (i % 64) as u8).collect())),
        ("offset_ns", Made::Long(vec![0; n])),
    ]
}

/// A log of `n` sweeps 0.1 s apart at 10 m/s along the city's x; a car drives 20 m ahead, a bollard stands aside.
pub(super) fn log(folder: &Path, n_sweeps: i64, is_packed: bool) {
    let times: Vec<i64> = (0..n_sweeps).map(|i| FIRST_NS + i * 100_000_000).collect();
    for time_ns in &times {
        write(folder.join(format!("sensors/lidar/{time_ns}.feather")), &feather(&sweep(), is_packed));
    }
    let mut poses = vec![("timestamp_ns", Made::Long(times.clone()))];
    poses.extend(pose_columns((0..n_sweeps).map(|i| i as f64).collect()));
    write(folder.join("city_SE3_egovehicle.feather"), &feather(&poses, is_packed));
    let n = times.len();
    let twice = |values: [f64; 2]| Made::Double(values.repeat(n));
    let mut cuboids = vec![
        ("timestamp_ns", Made::Long(times.iter().flat_map(|time_ns| [*time_ns; 2]).collect())),
        ("track_uuid", Made::Text(["car", "post"].repeat(n))),
        ("category", Made::Text(["REGULAR_VEHICLE", "BOLLARD"].repeat(n))),
        ("length_m", twice([4.0, 0.4])),
        ("width_m", twice([1.9, 0.4])),
        ("height_m", twice([1.6, 1.0])),
    ];
    let tx_m = (0..n).flat_map(|i| [20.0, 15.0 - i as f64]).collect();
    cuboids.extend(pose_columns(tx_m));
    write(folder.join("annotations.feather"), &feather(&cuboids, is_packed));
}

/// Adds the calibration and a picture near each sweep.
pub(super) fn cameras(folder: &Path, n_sweeps: i64, size_px: [u32; 2]) {
    let half = std::f64::consts::FRAC_1_SQRT_2 / std::f64::consts::SQRT_2;
    // The camera's optical axes: x to the right, y down, z ahead.
    let mounts = vec![
        ("sensor_name", Made::Text(vec!["up_lidar", "ring_front_center"])),
        ("qw", Made::Double(vec![1.0, half])),
        ("qx", Made::Double(vec![0.0, -half])),
        ("qy", Made::Double(vec![0.0, half])),
        ("qz", Made::Double(vec![0.0, -half])),
        ("tx_m", Made::Double(vec![1.3, 1.6])),
        ("ty_m", Made::Double(vec![0.0, 0.0])),
        ("tz_m", Made::Double(vec![1.6, 1.4])),
    ];
    write(folder.join("calibration/egovehicle_SE3_sensor.feather"), &feather(&mounts, true));
    let lens = vec![
        ("sensor_name", Made::Text(vec!["ring_front_center"])),
        ("fx_px", Made::Double(vec![1700.0])),
        ("fy_px", Made::Double(vec![1700.0])),
        ("cx_px", Made::Double(vec![774.5])),
        ("cy_px", Made::Double(vec![1023.5])),
        ("k1", Made::Double(vec![-0.2])),
        ("width_px", Made::Long(vec![1550])),
        ("height_px", Made::Long(vec![2048])),
    ];
    write(folder.join("calibration/intrinsics.feather"), &feather(&lens, true));
    let mut picture = Vec::new();
    RgbImage::new(size_px[0], size_px[1])
        .write_to(&mut Cursor::new(&mut picture), ImageFormat::Jpeg)
        .unwrap();
    for i in 0..n_sweeps {
        let time_ns = FIRST_NS + i * 100_000_000 + 20_000_000;
        write(folder.join(format!("sensors/cameras/ring_front_center/{time_ns}.jpg")), &picture);
    }
}
