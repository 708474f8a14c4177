//! Small KITTI folders for tests, made in code.

use std::io::Cursor;
use std::path::{Path, PathBuf};

use fs_err as fs;
use image::{ImageFormat, RgbImage};

use super::open_kitti;
use crate::episode::{EpisodeReader, Split};
use crate::import::{ImportConfig, ImportError, ImportOptions, ImportSummary, LogFormat, run};
use crate::progress::Silent;

pub(super) const CALIBRATION: &str = "\
P2: 7.0e+02 0 6.0e+02 4.5e+01 0 7.0e+02 1.8e+02 -3.5e-01 0 0 1 5.0e-03
P3: 7.0e+02 0 6.0e+02 -3.3e+02 0 7.0e+02 1.8e+02 2.3 0 0 1 3.0e-03
R0_rect: 1 0 0 0 1 0 0 0 1
Tr_velo_to_cam: 0 -1 0 0.0 0 0 -1 -0.08 1 0 0 -0.27
Tr_imu_to_velo: 1 0 0 -0.81 0 1 0 0.0 0 0 1 -0.8
";
/// A car 20 m ahead of the camera on its axis, turned to drive away; a trailer; a region.
pub(super) const LABELS: &str = "\
Car 0.00 0 -1.57 580 170 620 200 1.50 1.60 4.00 0.00 1.65 20.00 -1.5707963267948966
Misc 0.00 0 -1.57 600 170 650 200 1.50 1.60 4.00 5.00 1.65 20.00 -1.5707963267948966
DontCare -1 -1 -10 503.89 169.71 590.61 190.13 -1 -1 -1 -1000 -1000 -1000 -10
";

/// 64 beams of 180 points on a road 1.73 m below, and on a wall all round at 20 m.
pub(super) fn cloud() -> Vec<u8> {
    let mut bytes = Vec::new();
    for beam in 0..64 {
        let elevation = (2.0 - f64::from(beam) * 26.0 / 63.0).to_radians();
        for step in 0..180 {
            let azimuth = f64::from(step * 2).to_radians();
            let range = if elevation < 0.0 { (1.73 / -elevation.tan()).min(20.0) } else { 20.0 };
            for value in [range * azimuth.cos(), range * azimuth.sin(), range * elevation.tan(), 0.25] {
                bytes.extend((value as f32).to_le_bytes());
            }
        }
    }
    bytes
}

pub(super) fn picture() -> Vec<u8> {
    let mut bytes = Vec::new();
    RgbImage::new(1242, 375).write_to(&mut Cursor::new(&mut bytes), ImageFormat::Png).unwrap();
    bytes
}

pub(super) fn write(path: PathBuf, bytes: impl AsRef<[u8]>) {
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    fs::write(path, bytes).unwrap();
}

/// Frames 0 to `n` of the object set.
pub(super) fn object_set(root: &Path, n_frames: usize) {
    for frame in 0..n_frames {
        let file = |folder: &str, suffix: &str| root.join(format!("training/{folder}/{frame:06}.{suffix}"));
        write(file("velodyne", "bin"), cloud());
        write(file("image_2", "png"), picture());
        write(file("calib", "txt"), CALIBRATION);
        write(file("label_2", "txt"), LABELS);
    }
}

/// A packet of the GPS/IMU at a place north of the first, at 10 m/s to the north.
pub(super) fn packet(frame: usize) -> String {
    let north_deg = (10.0 * 0.1 * frame as f64 / 6_378_137.0).to_degrees();
    let mut numbers = [0.0; 30];
    (numbers[0], numbers[1], numbers[5], numbers[8]) = (north_deg, 8.4, std::f64::consts::FRAC_PI_2, 10.0);
    numbers.map(|number| format!("{number:.12}")).join(" ")
}

/// Sequence 0000 of the tracking set: a car that keeps 20 m before the ego.
pub(super) fn tracking_set(root: &Path, n_frames: usize) {
    let car = LABELS.lines().next().unwrap();
    let labels: Vec<String> = (0..n_frames).map(|frame| format!("{frame} 7 {car}")).collect();
    let packets: Vec<String> = (0..n_frames).map(packet).collect();
    let calibration = CALIBRATION.replace("R0_rect:", "R_rect").replace("Tr_velo_to_cam:", "Tr_velo_cam");
    let calibration = calibration.replace("Tr_imu_to_velo:", "Tr_imu_velo");
    write(root.join("training/calib/0000.txt"), calibration);
    write(root.join("training/oxts/0000.txt"), packets.join("\n"));
    write(root.join("training/label_02/0000.txt"), labels.join("\n"));
    for frame in 0..n_frames {
        write(root.join(format!("training/velodyne/0000/{frame:06}.bin")), cloud());
        write(root.join(format!("training/image_02/0000/{frame:06}.png")), picture());
    }
}

/// A raw recording.
pub(super) fn raw_drive(root: &Path, n_frames: usize) {
    let date = root.join("2011_09_26");
    let drive = date.join("2011_09_26_drive_0001_sync");
    let project = CALIBRATION.lines().next().unwrap().trim_start_matches("P2:");
    let cameras =
        format!("calib_time: 09-Jan-2012 13:57:47\nR_rect_00: 1 0 0 0 1 0 0 0 1\nP_rect_02:{project}\n");
    write(date.join("calib_cam_to_cam.txt"), cameras);
    write(date.join("calib_velo_to_cam.txt"), "R: 0 -1 0 0 0 -1 1 0 0\nT: 0 -0.08 -0.27\n");
    write(date.join("calib_imu_to_velo.txt"), "R: 1 0 0 0 1 0 0 0 1\nT: -0.81 0 -0.8\n");
    let stamps: Vec<String> =
        (0..n_frames).map(|i| format!("2011-09-26 13:02:{:02}.{}00000000", 25 + i / 10, i % 10)).collect();
    for folder in ["velodyne_points", "image_02", "oxts"] {
        write(drive.join(folder).join("timestamps.txt"), stamps.join("\n"));
    }
    for frame in 0..n_frames {
        write(drive.join(format!("velodyne_points/data/{frame:010}.bin")), cloud());
        write(drive.join(format!("image_02/data/{frame:010}.png")), picture());
        write(drive.join(format!("oxts/data/{frame:010}.txt")), packet(frame));
    }
}

pub(super) fn options() -> ImportOptions {
    ImportOptions { scenes: Vec::new(), split: Split::Test, skip_bad: false, force: false }
}

/// Imports a folder into `out`.
pub(super) fn import(
    source: &Path,
    out: &Path,
    overrides: &[&str],
    options: &ImportOptions,
) -> Result<ImportSummary, ImportError> {
    let overrides: Vec<String> = overrides.iter().map(|text| (*text).to_owned()).collect();
    let config = ImportConfig::load(LogFormat::Kitti, None, &overrides).unwrap();
    let log = open_kitti(source, &config)?;
    run(&log, LogFormat::Kitti, &config, out, options, &Silent)
}

pub(super) fn episode(out: &Path, name: &str) -> EpisodeReader {
    EpisodeReader::open(&out.join(format!("episodes/{name}.mcap"))).unwrap()
}
