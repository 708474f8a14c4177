//! Tiny logs of each format, made in code or exported from the made data set: what one file is replaced of.

use std::path::{Path, PathBuf};

use fs_err as fs;
use harmzone::export::kitti::{KittiRequest, run as export_kitti};
use harmzone::export::nuscenes::{Naming, NuScenesRequest, Release, run as export_nuscenes};
use harmzone::progress::Silent;

use super::made_episode::dataset;
use super::scratch;

#[allow(
    clippy::unwrap_used,
    clippy::disallowed_methods,
    dead_code,
    reason = "the library's own tests share it"
)]
#[path = "../../src/import/av2/made.rs"]
mod av2;

use av2::{FIRST_NS, Made, feather};

/// The files of a log that may be replaced, in a fixed order.
pub struct LogFolder {
    pub root: PathBuf,
    pub files: Vec<PathBuf>,
}

impl LogFolder {
    fn of(root: PathBuf) -> Self {
        Self { files: scratch::files_under(&root), root }
    }
}

fn write(path: PathBuf, bytes: impl AsRef<[u8]>) {
    fs::create_dir_all(path.parent().expect("it lies in a folder")).expect("a folder can be made");
    fs::write(path, bytes).expect("the scratch folder has room");
}

/// The made data set as `harmzone export nuscenes` writes it.
pub fn nuscenes() -> LogFolder {
    let made = dataset("nuscenes/data");
    let out = scratch::place("nuscenes/log");
    let request = NuScenesRequest {
        dataset: &made.dataset,
        out: &out,
        labels: "harm",
        naming: Naming::Kinds,
        release: Release::Mini,
        force: true,
    };
    export_nuscenes(&request, &Silent).expect("the made data set can be exported");
    let mut log = LogFolder::of(out);
    // Masks of maps are not read, and one that is black stands for all pictures of cameras that are not there.
    log.files.retain(|path| !path.components().any(|part| part.as_os_str() == "maps"));
    log
}

/// The four layouts of KITTI: exported by us, single frames, tracking, raw.
pub fn kitti() -> [LogFolder; 4] {
    let made = dataset("kitti/data");
    let exported = scratch::place("kitti/exported");
    let request = KittiRequest {
        dataset: &made.dataset,
        out: &exported,
        labels: "harm",
        naming: Naming::Kinds,
        force: true,
    };
    export_kitti(&request, &Silent).expect("the made data set can be exported");
    let [object, tracking, raw] =
        ["object", "tracking", "raw"].map(|name| scratch::empty_folder(&format!("kitti/{name}")));
    kitti_object(&object);
    kitti_tracking(&tracking);
    kitti_raw(&raw);
    [exported, object, tracking, raw].map(LogFolder::of)
}

const CALIBRATION: &str = "\
P2: 7.0e+02 0 6.0e+02 4.5e+01 0 7.0e+02 1.8e+02 -3.5e-01 0 0 1 5.0e-03
P3: 7.0e+02 0 6.0e+02 -3.3e+02 0 7.0e+02 1.8e+02 2.3 0 0 1 3.0e-03
R0_rect: 1 0 0 0 1 0 0 0 1
Tr_velo_to_cam: 0 -1 0 0.0 0 0 -1 -0.08 1 0 0 -0.27
Tr_imu_to_velo: 1 0 0 -0.81 0 1 0 0.0 0 0 1 -0.8
";
const LABELS: &str = "\
Car 0.00 0 -1.57 580 170 620 200 1.50 1.60 4.00 0.00 1.65 20.00 -1.5707963267948966
Misc 0.00 0 -1.57 600 170 650 200 1.50 1.60 4.00 5.00 1.65 20.00 -1.5707963267948966
DontCare -1 -1 -10 503.89 169.71 590.61 190.13 -1 -1 -1 -1000 -1000 -1000 -10
";
const TRACKLETS: &str = r#"<?xml version="1.0"?>
<boost_serialization signature="serialization::archive" version="9"><tracklets class_id="0"><count>1</count>
<item_version>1</item_version><item><objectType>Car</objectType><h>1.5</h><w>1.7</w><l>4.1</l><first_frame>0</first_frame>
<poses><count>2</count><item_version>2</item_version>
<item><tx>20</tx><ty>0.5</ty><tz>-1.7</tz><rx>0</rx><ry>0</ry><rz>0.1</rz><state>2</state><occlusion>0</occlusion><occlusion_kf>0</occlusion_kf><truncation>0</truncation></item>
<item><tx>21</tx><ty>0.5</ty><tz>-1.7</tz><rx>0</rx><ry>0</ry><rz>0.1</rz><state>2</state><occlusion>0</occlusion><occlusion_kf>0</occlusion_kf><truncation>0</truncation></item>
</poses><finished>1</finished></item></tracklets></boost_serialization>
"#;

/// Some beams on a road 1.73 m below.
fn cloud() -> Vec<u8> {
    let mut bytes = Vec::new();
    for beam in 0..8 {
        let elevation = (-2.0 - f64::from(beam) * 3.0).to_radians();
        for step in 0..24 {
            let azimuth = f64::from(step * 15).to_radians();
            let range = (1.73 / -elevation.tan()).min(20.0);
            for value in [range * azimuth.cos(), range * azimuth.sin(), range * elevation.tan(), 0.25] {
                bytes.extend((value as f32).to_le_bytes());
            }
        }
    }
    bytes
}

fn picture(format: image::ImageFormat) -> Vec<u8> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    image::RgbImage::new(62, 19).write_to(&mut bytes, format).expect("a picture can be packed");
    bytes.into_inner()
}

fn kitti_object(root: &Path) {
    let file = |folder: &str, suffix: &str| root.join(format!("training/{folder}/000000.{suffix}"));
    write(file("velodyne", "bin"), cloud());
    write(file("image_2", "png"), picture(image::ImageFormat::Png));
    write(file("calib", "txt"), CALIBRATION);
    write(file("label_2", "txt"), LABELS);
}

/// A packet of the GPS/IMU at a place north of the first, at 10 m/s to the north.
fn packet(frame: usize) -> String {
    let north_deg = (10.0 * 0.1 * frame as f64 / 6_378_137.0).to_degrees();
    let mut numbers = [0.0; 30];
    (numbers[0], numbers[1], numbers[5], numbers[8]) = (north_deg, 8.4, std::f64::consts::FRAC_PI_2, 10.0);
    numbers.map(|number| format!("{number:.9}")).join(" ")
}

fn kitti_tracking(root: &Path) {
    let car = LABELS.lines().next().expect("there are labels");
    let labels: Vec<String> = (0..2).map(|frame| format!("{frame} 7 {car}")).collect();
    let calibration = CALIBRATION.replace("R0_rect:", "R_rect").replace("Tr_velo_to_cam:", "Tr_velo_cam");
    write(root.join("training/calib/0000.txt"), calibration.replace("Tr_imu_to_velo:", "Tr_imu_velo"));
    write(root.join("training/oxts/0000.txt"), [packet(0), packet(1)].join("\n"));
    write(root.join("training/label_02/0000.txt"), labels.join("\n"));
    for frame in 0..2 {
        write(root.join(format!("training/velodyne/0000/{frame:06}.bin")), cloud());
        write(root.join(format!("training/image_02/0000/{frame:06}.png")), picture(image::ImageFormat::Png));
    }
}

fn kitti_raw(root: &Path) {
    let date = root.join("2011_09_26");
    let drive = date.join("2011_09_26_drive_0001_sync");
    let project = CALIBRATION.lines().next().expect("there are matrices").trim_start_matches("P2:");
    let cameras =
        format!("calib_time: 09-Jan-2012 13:57:47\nR_rect_00: 1 0 0 0 1 0 0 0 1\nP_rect_02:{project}\n");
    write(date.join("calib_cam_to_cam.txt"), cameras);
    write(date.join("calib_velo_to_cam.txt"), "R: 0 -1 0 0 0 -1 1 0 0\nT: 0 -0.08 -0.27\n");
    write(date.join("calib_imu_to_velo.txt"), "R: 1 0 0 0 1 0 0 0 1\nT: -0.81 0 -0.8\n");
    write(drive.join("tracklet_labels.xml"), TRACKLETS);
    for folder in ["velodyne_points", "image_02", "oxts"] {
        write(
            drive.join(folder).join("timestamps.txt"),
            "2011-09-26 13:02:25.000000000\n2011-09-26 13:02:25.100000000",
        );
    }
    for frame in 0..2 {
        write(drive.join(format!("velodyne_points/data/{frame:010}.bin")), cloud());
        write(drive.join(format!("image_02/data/{frame:010}.png")), picture(image::ImageFormat::Png));
        write(drive.join(format!("oxts/data/{frame:010}.txt")), packet(frame));
    }
}

const MAP: &str = r#"{"drivable_areas": {"1": {"area_boundary": [{"x": 0, "y": -4, "z": 0}, {"x": 40, "y": -4, "z": 0},
{"x": 40, "y": 0, "z": 0}, {"x": 20, "y": 4, "z": 0}, {"x": 0, "y": 4, "z": 0}]}}, "lane_segments": {"2": {"is_intersection": false,
"left_lane_boundary": [{"x": 0, "y": 2, "z": 0}, {"x": 40, "y": 2, "z": 0}],
"right_lane_boundary": [{"x": 0, "y": -2, "z": 0}, {"x": 40, "y": -2, "z": 0}]}}}"#;

/// A log of Argoverse 2 with two sweeps, plain and packed files side by side.
pub fn av2() -> LogFolder {
    const N_SWEEPS: i64 = 2;
    let root = scratch::empty_folder("av2/log");
    av2::log(&root, N_SWEEPS, false);
    av2::cameras(&root, N_SWEEPS, [62, 81]);
    // The library's pictures and sweeps are large.
    let double = |value| Made::Double(vec![value]);
    let lens = [
        ("sensor_name", Made::Text(vec!["ring_front_center"])),
        ("fx_px", double(68.0)),
        ("fy_px", double(68.0)),
        ("cx_px", double(31.0)),
        ("cy_px", double(40.5)),
        ("width_px", Made::Long(vec![62])),
        ("height_px", Made::Long(vec![81])),
    ];
    write(root.join("calibration/intrinsics.feather"), feather(&lens, true));
    for i in 0..N_SWEEPS {
        let (mut x, mut y) = (Vec::new(), Vec::new());
        for (column, row) in (0..24).flat_map(|column| (0..8).map(move |row| (column, row))) {
            x.push(column as f32 - 6.0);
            y.push(row as f32 - 4.0);
        }
        let n = x.len();
        let columns = [
            ("x", Made::Half(x)),
            ("y", Made::Half(y)),
            ("z", Made::Half(vec![-0.33; n])),
            ("intensity", Made::Byte((0..n).map(|i| i as u8).collect())),
            ("laser_number", Made::Byte((0..n).map(|i| (i % 64) as u8).collect())),
            ("offset_ns", Made::Long(vec![0; n])),
        ];
        let path = root.join(format!("sensors/lidar/{}.feather", FIRST_NS + i * 100_000_000));
        write(path, feather(&columns, i == 1));
    }
    write(root.join("map/log_map_archive_made____PIT_city_57819.json"), MAP);
    LogFolder::of(root)
}
