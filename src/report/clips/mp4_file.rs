//! A clip as MP4 with H.264 (baseline), which every browser plays: OpenH264 with a fixed quality, on one thread.
//!
//! Colours are BT.709, of limited range, as the stream says; the sum is in whole numbers, so that any machine gives the same bytes.

use std::num::NonZeroU32;
use std::path::Path;

use image::RgbImage;
use openh264::OpenH264API;
use openh264::encoder::{
    BitRate, Encoder, EncoderConfig, FrameRate, FrameType, IntraFramePeriod, QpRange, RateControlMode,
    VuiConfig,
};
use openh264::formats::YUVSlices;
use openh264::{Timestamp, encoder::Complexity};
use shiguredo_mp4::TrackKind;
use shiguredo_mp4::bitstream::h264::{
    H264NalUnitType, H264SampleEntryConfig, LengthSize, build_avc1_box_from_annexb, parse_annexb_nal_units,
};
use shiguredo_mp4::boxes::SampleEntry;
use shiguredo_mp4::mux::{Mp4FileMuxer, Mp4FileMuxerOptions, Sample, estimate_maximum_moov_box_size};

use super::{ClipError, encode_error};

/// What OpenH264 encodes.
const MOST_PX: u32 = 2160;
/// Times are counted in so many parts of a second.
const TIMESCALE: NonZeroU32 = NonZeroU32::new(1000).expect("it is not zero");
/// Pictures between two that need no other, so that players can jump.
const KEY_PICTURES: u32 = 32;
/// The quantiser's step, one for all pictures: lines and text stay clean.
const QUALITY: QpRange = QpRange::new(22, 22);
/// More than the bounds let it use.
const BITS_PER_S: BitRate = BitRate::from_bps(24_000_000);
const MOST_PER_S: FrameRate = FrameRate::from_hz(30.0);

#[derive(Default)]
pub(super) struct Mp4File {
    encoder: Option<Encoder>,
    size_px: (u32, u32),
    pictures: Vec<Encoded>,
    /// Start of the next picture.
    time_ms: u64,
}

struct Encoded {
    /// Units with their lengths before them.
    bytes: Vec<u8>,
    is_key: bool,
    duration_ms: u32,
    /// With the parameters of the stream, where they came with this picture.
    entry: Option<SampleEntry>,
}

impl Mp4File {
    pub(super) fn add(&mut self, picture: &RgbImage, duration_ms: u32, path: &Path) -> Result<(), ClipError> {
        let fail = encode_error(path);
        let (width_px, height_px) = picture.dimensions();
        if width_px % 2 + height_px % 2 > 0 || width_px.max(height_px) > MOST_PX || width_px * height_px == 0
        {
            return Err(ClipError::Size { width_px, height_px, most_px: MOST_PX, path: path.to_owned() });
        }
        self.size_px = (width_px, height_px);
        let encoder = match &mut self.encoder {
            Some(encoder) => encoder,
            none => {
                let encoder = Encoder::with_api_config(OpenH264API::from_source(), config());
                none.insert(encoder.map_err(|error| fail(error.to_string()))?)
            }
        };
        let planes = Planes::of(picture);
        let size = (width_px as usize, height_px as usize);
        let yuv = YUVSlices::new((&planes.y, &planes.u, &planes.v), size, (size.0, size.0 / 2, size.0 / 2));
        let stream = encoder
            .encode_at(&yuv, Timestamp::from_millis(self.time_ms))
            .map_err(|error| fail(error.to_string()))?;
        let kind = stream.frame_type();
        if matches!(kind, FrameType::Invalid | FrameType::Skip) {
            return Err(fail(format!("it left out picture {}", self.pictures.len())));
        }
        let (is_key, annex_b) = (kind == FrameType::IDR, stream.to_vec());
        let units = parse_annexb_nal_units(&annex_b).map_err(|error| fail(error.to_string()))?;
        let mut bytes = Vec::with_capacity(annex_b.len());
        let mut has_parameters = false;
        for unit in units {
            if matches!(unit.nal_unit_type, H264NalUnitType::Sps | H264NalUnitType::Pps) {
                has_parameters = true;
                continue; // they stand in the file's head
            }
            let length = u32::try_from(unit.data.len()).map_err(|error| fail(error.to_string()))?;
            bytes.extend(length.to_be_bytes());
            bytes.extend(unit.data);
        }
        let entry = (has_parameters && self.pictures.is_empty())
            .then(|| {
                build_avc1_box_from_annexb(
                    &annex_b,
                    &H264SampleEntryConfig { length_size: LengthSize::FourBytes },
                )
            })
            .transpose()
            .map_err(|error| fail(error.to_string()))?
            .map(SampleEntry::Avc1);
        self.pictures.push(Encoded { bytes, is_key, duration_ms, entry });
        self.time_ms += u64::from(duration_ms);
        Ok(())
    }

    /// The file, its index before the pictures, so that it plays while it loads.
    pub(super) fn finish(self, path: &Path) -> Result<Vec<u8>, ClipError> {
        let fail = |error: shiguredo_mp4::mux::MuxError| encode_error(path)(error.to_string());
        let options = Mp4FileMuxerOptions {
            reserved_moov_box_size: estimate_maximum_moov_box_size(&[self.pictures.len()]),
            ..Mp4FileMuxerOptions::default()
        };
        let mut muxer = Mp4FileMuxer::with_options(options).map_err(fail)?;
        let mut file = muxer.initial_boxes_bytes().to_vec();
        for picture in self.pictures {
            let sample = Sample {
                track_kind: TrackKind::Video,
                sample_entry: picture.entry,
                keyframe: picture.is_key,
                timescale: TIMESCALE,
                duration: picture.duration_ms,
                composition_time_offset: None,
                data_offset: file.len() as u64,
                data_size: picture.bytes.len(),
            };
            file.extend(picture.bytes);
            muxer.append_sample(&sample).map_err(fail)?;
        }
        for (offset, bytes) in muxer.finalize().map_err(fail)?.offset_and_bytes_pairs() {
            let begin = usize::try_from(offset).expect("an offset in a file in memory");
            file.resize(file.len().max(begin + bytes.len()), 0);
            file[begin..begin + bytes.len()].copy_from_slice(bytes);
        }
        Ok(file)
    }
}

fn config() -> EncoderConfig {
    EncoderConfig::new()
        .bitrate(BITS_PER_S)
        .max_frame_rate(MOST_PER_S)
        // With both bounds of the quantiser alike a constant quality; others may leave pictures out, or warn on standard error.
        .rate_control_mode(RateControlMode::Bufferbased)
        .qp(QUALITY)
        .skip_frames(false)
        .complexity(Complexity::High)
        .intra_frame_period(IntraFramePeriod::from_num_frames(KEY_PICTURES))
        // What would change pictures by itself, or by the number of cores.
        .scene_change_detect(false)
        .background_detection(false)
        .adaptive_quantization(false)
        .num_threads(1)
        .vui(VuiConfig::bt709())
}

/// Brightness, and colour of four pixels each.
struct Planes {
    y: Vec<u8>,
    u: Vec<u8>,
    v: Vec<u8>,
}

impl Planes {
    /// Of a picture with even sides.
    fn of(picture: &RgbImage) -> Self {
        let (width, height) = (picture.width() as usize, picture.height() as usize);
        let rows: Vec<&[u8]> = picture.as_raw().chunks_exact(3 * width).collect();
        let y = rows.iter().flat_map(|row| row.as_chunks::<3>().0).map(|&rgb| brightness(rgb)).collect();
        let (mut u, mut v) = (Vec::with_capacity(width * height / 4), Vec::with_capacity(width * height / 4));
        for pair in rows.chunks_exact(2) {
            for (above, below) in pair[0].chunks_exact(6).zip(pair[1].chunks_exact(6)) {
                let sum = |part: usize| {
                    [above[part], above[part + 3], below[part], below[part + 3]]
                        .map(i32::from)
                        .iter()
                        .sum::<i32>()
                };
                let [red, green, blue] = [sum(0), sum(1), sum(2)];
                u.push(colour(-6596, -22_189, 28_784, [red, green, blue]));
                v.push(colour(28_784, -26_145, -2639, [red, green, blue]));
            }
        }
        Self { y, u, v }
    }
}

/// Weights are of 65536, as below.
fn brightness([red, green, blue]: [u8; 3]) -> u8 {
    let sum = 11_966 * i32::from(red) + 40_254 * i32::from(green) + 4064 * i32::from(blue);
    (16 + ((sum + 32_768) >> 16)) as u8
}

/// Of the sums of four pixels.
fn colour(of_red: i32, of_green: i32, of_blue: i32, [red, green, blue]: [i32; 3]) -> u8 {
    let sum = of_red * red + of_green * green + of_blue * blue;
    (128 + ((sum + (1 << 17)) >> 18)).clamp(16, 240) as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn white_black_and_grey_have_no_colour_and_red_has() {
        let planes = |rgb: [u8; 3]| {
            let planes = Planes::of(&RgbImage::from_pixel(2, 2, image::Rgb(rgb)));
            (planes.y[0], planes.u[0], planes.v[0])
        };
        assert_eq!(planes([255; 3]), (235, 128, 128));
        assert_eq!(planes([0; 3]), (16, 128, 128));
        assert_eq!(planes([128; 3]).1, 128);
        // BT.709: 63, 102, 240.
        assert_eq!(planes([255, 0, 0]), (63, 102, 240));
    }
}
