//! Clips read back by decoders: how many pictures, how large, how long, and what they show.

use std::path::PathBuf;

use fs_err as fs;
use image::Rgb;

use super::*;
use crate::progress::Silent;

const SIZE_PX: (u32, u32) = (64, 48);
const DURATIONS_MS: [u32; 5] = [100, 100, 125, 300, 300];

/// A square that goes to the right over a still ground.
fn picture(place: usize) -> RgbImage {
    RgbImage::from_fn(SIZE_PX.0, SIZE_PX.1, |x, y| {
        let is_square = (8 * place as u32..8 * place as u32 + 16).contains(&x) && (16..32).contains(&y);
        if is_square { Rgb([255, 77, 87]) } else { Rgb([16, 20, 40 + (y / 2) as u8]) }
    })
}

fn written(folder: &tempfile::TempDir, name: &str) -> PathBuf {
    let path = folder.path().join(name);
    write_clip::<ClipError>(&path, &DURATIONS_MS, false, &|place| Ok(picture(place)), &Silent).unwrap();
    path
}

/// The greatest mean difference of a part of a colour between two pictures.
fn difference(a: &RgbImage, b: &RgbImage) -> f64 {
    let sum: u64 = a.as_raw().iter().zip(b.as_raw()).map(|(a, b)| u64::from(a.abs_diff(*b))).sum();
    sum as f64 / a.as_raw().len() as f64
}

#[test]
fn a_gif_holds_each_picture_for_its_time_and_is_the_same_twice() {
    let folder = tempfile::tempdir().unwrap();
    let path = written(&folder, "clip.gif");
    let bytes = fs::read(&path).unwrap();
    assert!(bytes == fs::read(written(&folder, "again.gif")).unwrap());
    let mut options = gif::DecodeOptions::new();
    options.set_color_output(gif::ColorOutput::RGBA);
    let mut decoder = options.read_info(bytes.as_slice()).unwrap();
    assert_eq!((u32::from(decoder.width()), u32::from(decoder.height())), SIZE_PX);
    let (mut shown, mut delays) = (RgbImage::new(SIZE_PX.0, SIZE_PX.1), Vec::new());
    while let Some(frame) = decoder.read_next_frame().unwrap() {
        for (i, pixel) in frame.buffer.as_chunks::<4>().0.iter().enumerate() {
            if pixel[3] > 0 {
                let i = i as u32;
                shown.put_pixel(i % SIZE_PX.0, i / SIZE_PX.0, Rgb([pixel[0], pixel[1], pixel[2]]));
            }
        }
        let difference = difference(&shown, &picture(delays.len()));
        assert!(difference < 6.0, "picture {}: {difference}", delays.len());
        delays.push(frame.delay);
    }
    // 125 ms are 12 hundredths, and the rest goes to the next.
    assert_eq!(delays, [10, 10, 12, 30, 30]);
}

#[test]
fn an_mp4_holds_each_picture_and_is_the_same_twice() {
    let folder = tempfile::tempdir().unwrap();
    let bytes = fs::read(written(&folder, "clip.mp4")).unwrap();
    assert!(bytes == fs::read(written(&folder, "again.mp4")).unwrap());
    let mut demuxer = shiguredo_mp4::demux::Mp4FileDemuxer::new();
    demuxer.handle_input(shiguredo_mp4::demux::Input { position: 0, data: &bytes });
    let mut decoder = openh264::decoder::Decoder::new().unwrap();
    let (mut durations, mut parameters) = (Vec::new(), Vec::new());
    while let Some(sample) = demuxer.next_sample().unwrap() {
        if let Some(shiguredo_mp4::boxes::SampleEntry::Avc1(entry)) = sample.sample_entry {
            for unit in entry.avcc_box.sps_list.iter().chain(&entry.avcc_box.pps_list) {
                parameters.extend([0, 0, 0, 1]);
                parameters.extend(unit);
            }
        }
        let begin = usize::try_from(sample.data_offset).unwrap();
        let data = &bytes[begin..begin + sample.data_size];
        let annex_b = shiguredo_mp4::bitstream::h264::length_prefixed_to_annexb(
            data,
            shiguredo_mp4::bitstream::h264::LengthSize::FourBytes,
        );
        let stream = [std::mem::take(&mut parameters), annex_b.unwrap()].concat();
        let decoded = decoder.decode(&stream).unwrap().expect("a picture for each sample");
        let mut rgb = vec![0; 3 * (SIZE_PX.0 * SIZE_PX.1) as usize];
        decoded.write_rgb8(&mut rgb);
        let shown = RgbImage::from_raw(SIZE_PX.0, SIZE_PX.1, rgb).expect("a picture of that size");
        let difference = difference(&shown, &picture(durations.len()));
        // The decoder turns colours back by BT.601.
        assert!(difference < 12.0, "picture {}: {difference}", durations.len());
        durations.push(sample.duration);
    }
    assert_eq!(durations, DURATIONS_MS);
}

#[test]
fn a_folder_holds_the_pictures_as_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let path = written(&folder, "frames");
    for place in 0..DURATIONS_MS.len() {
        let read = image::open(path.join(format!("{place:04}.png"))).unwrap().into_rgb8();
        assert!(read == picture(place), "{place}");
    }
    let frames: serde_json::Value =
        serde_json::from_slice(&fs::read(path.join("frames.json")).unwrap()).unwrap();
    assert_eq!(frames[2], serde_json::json!({ "file": "0002.png", "duration_ms": 125 }));
    assert_eq!(fs::read_dir(&path).unwrap().count(), DURATIONS_MS.len() + 1);
}

#[test]
fn what_is_there_stays_without_force_and_another_end_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("clip.gif");
    fs::write(&path, b"mine").unwrap();
    let write = |path: &Path, durations: &[u32], force| {
        write_clip::<ClipError>(path, durations, force, &|place| Ok(picture(place)), &Silent)
    };
    assert!(matches!(write(&path, &[100], false), Err(ClipError::Exists { .. })));
    assert_eq!(fs::read(&path).unwrap(), b"mine");
    write(&path, &[100], true).unwrap();
    assert!(fs::read(&path).unwrap().starts_with(b"GIF89a"));
    assert!(matches!(write(&path, &[], true), Err(ClipError::Empty { .. })));
    let message = write(&folder.path().join("clip.avi"), &[100], false).unwrap_err().to_string();
    assert!(message.contains(".mp4") && message.contains("`.avi`"), "{message}");
}

#[test]
fn a_folder_of_pictures_with_a_file_of_the_users_is_not_replaced() {
    let folder = tempfile::tempdir().unwrap();
    let path = written(&folder, "frames");
    let again =
        || write_clip::<ClipError>(&path, &DURATIONS_MS[..2], true, &|place| Ok(picture(place)), &Silent);
    let mine = path.join("me.png");
    fs::write(&mine, b"mine").unwrap();
    let told = again().unwrap_err().to_string();
    assert!(told.contains("`me.png`"), "{told}");
    assert_eq!(fs::read(&mine).unwrap(), b"mine");
    fs::remove_file(&mine).unwrap();
    again().unwrap();
    assert_eq!(fs::read_dir(&path).unwrap().count(), 3);
}

#[test]
fn an_mp4_of_odd_sides_or_of_several_sizes_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("clip.mp4");
    let odd = |_: usize| -> Result<RgbImage, ClipError> { Ok(RgbImage::new(63, 48)) };
    let failed = write_clip::<ClipError>(&path, &[100], false, &odd, &Silent).unwrap_err();
    assert!(matches!(failed, ClipError::Size { width_px: 63, .. }), "{failed}");
    let grows =
        |place: usize| -> Result<RgbImage, ClipError> { Ok(RgbImage::new(64, 48 + 2 * place as u32)) };
    let failed = write_clip::<ClipError>(&path, &[100, 100], false, &grows, &Silent).unwrap_err();
    assert!(matches!(failed, ClipError::OtherSize { .. }), "{failed}");
    assert!(!path.exists());
}
