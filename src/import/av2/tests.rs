//! Argoverse 2 logs from end to end, whole and damaged.

use std::path::Path;

use fs_err as fs;
use polars_arrow_format::ipc::CompressionType;

use super::feather::Table;
use super::made::{BatchPacking, FIRST_NS, Made, cameras, feather, feather_as, log, pack_zeros, write};
use super::open_av2;
use crate::episode::{EpisodeReader, Split};
use crate::import::{ImportConfig, ImportError, ImportOptions, ImportSummary, LogFormat, run};
use crate::progress::Silent;
use crate::sample::ImageFormat;

fn import(source: &Path, out: &Path) -> Result<ImportSummary, ImportError> {
    let config = ImportConfig::load(LogFormat::Av2, None, &[]).unwrap();
    let options = ImportOptions { scenes: Vec::new(), split: Split::Test, skip_bad: false, force: false };
    run(&open_av2(source, &config)?, LogFormat::Av2, &config, out, &options, &Silent)
}

#[test]
fn columns_come_back_plain_and_packed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("table.feather");
    for is_packed in [false, true] {
        let columns = [
            ("half", Made::Half(vec![1.5, -2.25])),
            ("long", Made::Long(vec![-3, i64::MAX])),
            ("byte", Made::Byte(vec![0, 255])),
            ("text", Made::Text(vec!["", "häng"])),
        ];
        write(path.clone(), &feather(&columns, is_packed));
        let table = Table::read(&path).unwrap();
        assert_eq!(table.n_rows, 2);
        assert_eq!(table.floats("half").unwrap(), [1.5, -2.25]);
        assert_eq!(table.integers("long").unwrap(), [-3, i64::MAX]);
        assert_eq!(table.integers("byte").unwrap(), [0, 255]);
        assert_eq!(table.texts("text").unwrap(), ["", "häng"]);
        assert!(table.floats("text").is_err() && table.texts("long").is_err());
        let told = table.floats("width").unwrap_err().to_string();
        assert!(told.contains("lacks `width`") && told.contains("table.feather"), "{told}");
    }
}

#[test]
fn no_cut_and_no_flipped_byte_of_a_feather_file_panics() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("table.feather");
    let whole = feather(&[("x", Made::Double(vec![1.0; 40])), ("name", Made::Text(vec!["a"; 40]))], true);
    for at in 0..whole.len() {
        fs::write(&path, &whole[..at]).unwrap();
        assert!(Table::read(&path).is_err(), "cut at {at}");
        let mut flipped = whole.clone();
        flipped[at] ^= 0x81;
        fs::write(&path, &flipped).unwrap();
        // Most are told; a flipped name or number cannot be.
        let _ = Table::read(&path);
    }
}

#[test]
fn a_feather_file_that_unpacks_to_more_than_its_rows_need_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bomb.feather");
    let told = |columns: &[(&str, Made)], packing: &BatchPacking| {
        let file = feather_as(columns, packing);
        assert!(file.len() < 8 << 20, "{} bytes", file.len());
        write(path.clone(), &file);
        let told = Table::read(&path).unwrap_err().to_string();
        assert!(told.contains("bomb.feather"), "{told}");
        told
    };
    let large = 128 << 20;
    for codec in [CompressionType::Zstd, CompressionType::Lz4Frame] {
        let once = || BatchPacking { codec: Some(codec), n_batches: 1, n_rows: None };
        let zeros = || pack_zeros(large, codec);
        let number = told(&[("x", Made::Packed(zeros()))], &once());
        assert!(number.contains("`x`") && number.contains("up to 64 are valid"), "{number}");
        let text = told(&[("name", Made::PackedText(zeros(), large as i32))], &once());
        assert!(text.contains("`name`") && text.contains("up to 67108864 are valid"), "{text}");
        // A frame that holds more than the length before it says is read up to that length.
        let mut lies = zeros();
        lies[..8].copy_from_slice(&8_i64.to_le_bytes());
        write(path.clone(), &feather_as(&[("x", Made::Packed(lies))], &once()));
        assert_eq!(Table::read(&path).unwrap().integers("x").unwrap(), [0]);
        let rows = BatchPacking { n_rows: Some(1 << 40), ..once() };
        assert!(told(&[("x", Made::Packed(zeros()))], &rows).contains("1099511627776 rows"));
        // One batch that is named again and again.
        let part = 32 << 20;
        let text = || [("name", Made::PackedText(pack_zeros(part, codec), part as i32))];
        assert!(told(&text(), &BatchPacking { n_batches: 1000, ..once() }).contains("`name`"));
        write(path.clone(), &feather_as(&text(), &once()));
        assert_eq!(Table::read(&path).unwrap().texts("name").unwrap()[0].len(), part);
    }
}

#[test]
fn a_log_without_pictures_gets_the_virtual_camera_the_fitted_ground_and_velocities() {
    let root = tempfile::tempdir().unwrap();
    let (source, out) = (root.path().join("av2/some-log"), root.path().join("out"));
    log(&source, 5, true);
    let summary = import(source.parent().unwrap(), &out).unwrap();
    assert_eq!((summary.n_episodes, summary.n_samples, summary.n_objects.total()), (1, 5, 10));
    let reader = EpisodeReader::open(&out.join("episodes/some-log.mcap")).unwrap();
    let sample = reader.sample(2).unwrap();
    let measured = &sample.measured;
    assert!((measured.ego_state.speed_mps - 10.0).abs() < 1e-6, "{:?}", measured.ego_state);
    let (lidar, pose) =
        (measured.ego_from_lidar.isometry.translation, measured.world_from_ego.isometry.translation);
    assert!((lidar.z - 1.64 - 0.33).abs() < 1e-3 && (pose.z + 0.33).abs() < 1e-3, "{lidar} {pose}");
    assert_eq!(measured.intrinsics.width_px, 800);
    let lowest_m =
        measured.points.iter().map(|point| f64::from(point.z_m) + lidar.z).fold(f64::MAX, f64::min);
    assert!(lowest_m.abs() < 1e-3, "{lowest_m}");
    let objects = sample.objects();
    assert_eq!(objects[0].id.as_deref(), Some("car"));
    let [car_mps, post_mps] = [0, 1].map(|i| objects[i].velocity_in_ego_mps[0]);
    assert!((car_mps - 10.0).abs() < 1e-6 && post_mps.abs() < 1e-6, "{car_mps} {post_mps}");
    let methods = &reader.log().unwrap().methods;
    assert!(methods["camera"].contains("virtual") && methods["ground"].starts_with("fitted"), "{methods:?}");
}

#[test]
fn pictures_are_taken_with_their_calibration_and_checked_against_it() {
    let root = tempfile::tempdir().unwrap();
    let (source, out) = (root.path().join("some-log"), root.path().join("out"));
    log(&source, 1, false);
    cameras(&source, 1, [1550, 2048]);
    import(&source, &out).unwrap();
    let reader = EpisodeReader::open(&out.join("episodes/some-log.mcap")).unwrap();
    let measured = reader.sample(0).unwrap().measured;
    assert_eq!((measured.intrinsics.width_px, measured.intrinsics.cx_px), (1550, 774.5));
    assert!((measured.ego_from_lidar.isometry.translation.x - 1.3).abs() < 1e-9);
    cameras(&source, 1, [800, 600]);
    let told = import(&source, &root.path().join("other")).unwrap_err().to_string();
    assert!(told.contains("800 x 600") && told.contains("1550 x 2048"), "{told}");
}

#[test]
fn a_sweep_without_a_near_picture_gets_a_black_one_and_the_others_keep_theirs() {
    let root = tempfile::tempdir().unwrap();
    let (source, out) = (root.path().join("some-log"), root.path().join("out"));
    log(&source, 3, false);
    cameras(&source, 3, [1550, 2048]);
    // As if the camera had begun late.
    fs::remove_file(source.join(format!("sensors/cameras/ring_front_center/{}.jpg", FIRST_NS + 20_000_000)))
        .unwrap();
    let summary = import(&source, &out).unwrap();
    assert_eq!(summary.n_samples, 3);
    assert!(
        summary.notes.iter().any(|note| note.contains("no picture of `ring_front_center`")),
        "{summary:?}"
    );
    let reader = EpisodeReader::open(&out.join("episodes/some-log.mcap")).unwrap();
    let of = |sample_idx: usize| reader.sample(sample_idx).unwrap().measured;
    let formats = [of(0).image.format, of(1).image.format];
    assert_eq!(formats, [ImageFormat::Png, ImageFormat::Jpeg]);
    assert_eq!(of(0).intrinsics, of(1).intrinsics);
    assert!(reader.log().unwrap().methods["camera"].contains("byte by byte"));
}

/// What is done to a log, and what must be told.
type Damage = (&'static str, fn(&Path), &'static str);

const DAMAGES: [Damage; 6] = [
    ("cut sweep", |log| cut(&log.join(format!("sensors/lidar/{FIRST_NS}.feather"))), "cut short"),
    ("cut poses", |log| cut(&log.join("city_SE3_egovehicle.feather")), "cut short"),
    ("no poses", |log| fs::remove_file(log.join("city_SE3_egovehicle.feather")).unwrap(), "is missing"),
    (
        "no column",
        |log| {
            let columns = [("x", Made::Half(vec![1.0])), ("y", Made::Half(vec![1.0]))];
            write(log.join(format!("sensors/lidar/{FIRST_NS}.feather")), &feather(&columns, true));
        },
        "lacks `z`",
    ),
    (
        "late poses",
        |log| {
            let one = || Made::Double(vec![1.0]);
            let zero = || Made::Double(vec![0.0]);
            let times = ("timestamp_ns", Made::Long(vec![FIRST_NS + 9_000_000_000]));
            let turn = [("qw", one()), ("qx", zero()), ("qy", zero()), ("qz", zero())];
            let place = [("tx_m", zero()), ("ty_m", zero()), ("tz_m", zero())];
            let columns: Vec<(&str, Made)> = [times].into_iter().chain(turn).chain(place).collect();
            write(log.join("city_SE3_egovehicle.feather"), &feather(&columns, true));
        },
        "no pose belongs to the sample at 315973157959879000 ns",
    ),
    (
        "text for numbers",
        |log| {
            let columns = [("timestamp_ns", Made::Text(vec!["now"]))];
            write(log.join("annotations.feather"), &feather(&columns, true));
        },
        "does not hold whole numbers",
    ),
];

fn cut(path: &Path) {
    let bytes = fs::read(path).unwrap();
    fs::write(path, &bytes[..bytes.len() / 2]).unwrap();
}

#[test]
fn a_damaged_log_is_told_and_leaves_no_episode() {
    for (name, damage, wanted) in DAMAGES {
        let root = tempfile::tempdir().unwrap();
        let (source, out) = (root.path().join("some-log"), root.path().join("out"));
        log(&source, 2, true);
        damage(&source);
        let told = import(&source, &out).expect_err(name).to_string();
        assert!(told.contains(wanted), "{name}: {told}");
        assert_eq!(fs::read_dir(out.join("episodes")).unwrap().count(), 0, "{name}");
    }
}

/// The real log beside the project; without it the test says so.
#[test]
fn the_sample_log_imports_and_its_points_are_counted_as_argoverse_counts_them() {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/samples/av2");
    if !source.is_dir() {
        tell(format_args!("skipped: there is no sample log at {}", source.display()));
        return;
    }
    let root = tempfile::tempdir().unwrap();
    let out = root.path().join("out");
    let summary = import(&source, &out).unwrap();
    assert_eq!((summary.n_episodes, summary.n_samples), (1, 1));
    let name = "adcf7d18-0510-35b0-a2fa-b4cea13a6d76";
    let reader = EpisodeReader::open(&out.join(format!("episodes/{name}.mcap"))).unwrap();
    assert_eq!(reader.meta().town, "pit");
    let table = Table::read(&source.join(name).join("annotations.feather")).unwrap();
    let times = table.integers("timestamp_ns").unwrap();
    let (ids, counts) = (table.texts("track_uuid").unwrap(), table.integers("num_interior_pts").unwrap());
    let objects = reader.sample(0).unwrap().truth.unwrap().objects;
    let (mut n_same, mut n_all) = (0, 0);
    for i in (0..times.len()).filter(|i| times[*i] == FIRST_NS) {
        let object = objects.iter().find(|object| object.id.as_ref() == Some(&ids[i])).unwrap();
        // The reader counts those in the front camera's view alone.
        let found = i64::from(object.n_lidar_points.unwrap());
        assert!(found <= counts[i], "{found} of {}", counts[i]);
        n_same += usize::from(found == counts[i]);
        n_all += 1;
    }
    assert!(n_all == objects.len() && n_same >= 15, "{n_same} of {n_all}");
}

/// Says on standard error that a test had nothing to work on.
fn tell(what: std::fmt::Arguments<'_>) {
    use std::io::Write as _;
    writeln!(std::io::stderr(), "{what}").expect("standard error takes a line");
}
