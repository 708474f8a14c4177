//! KITTI's layouts from end to end, whole and damaged.

use std::path::Path;

use fs_err as fs;

use super::made::{episode, import, object_set, options, raw_drive, tracking_set, write};
use crate::import::ImportOptions;
use crate::sample::IgnoredRegion;

#[test]
fn an_object_frame_becomes_an_episode_with_its_box_region_camera_and_rings() {
    let root = tempfile::tempdir().unwrap();
    let (source, out) = (root.path().join("kitti"), root.path().join("out"));
    object_set(&source, 2);
    let summary = import(&source, &out, &[], &options()).unwrap();
    assert_eq!((summary.n_episodes, summary.n_samples, summary.n_objects.total()), (2, 2, 4));
    let reader = episode(&out, "kitti-000001");
    assert!(reader.meta().ood && reader.meta().town == "karlsruhe");
    let log = reader.log().unwrap();
    assert_eq!(log.sample_names.values().collect::<Vec<_>>(), ["000001"]);
    assert!(log.methods["speed"].contains("assumed") && log.labelled.as_ref().unwrap().in_camera_view);
    let sample = reader.sample(0).unwrap();
    let truth = sample.truth.unwrap();
    let car = &truth.objects[0].box_in_ego;
    // The camera 0 sits 0.27 m ahead of the Velodyne and 0.08 m under it: 20 + 0.27 + 0.76 ahead of the axle.
    let wanted = [21.03, 0.0, 1.73 - 0.08 - 1.65 + 0.75];
    let center = [car.center.x(), car.center.y(), car.center.z()];
    assert!(center.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-6), "{center:?}");
    assert!(car.yaw_rad.abs() < 1e-6);
    assert!(truth.objects[0].n_lidar_points.unwrap() > 0 && truth.objects[1].is_ood());
    assert!(matches!(truth.ignored[..], [IgnoredRegion::Image { left_px: 503.89, .. }]));
    let measured = sample.measured;
    assert_eq!((measured.intrinsics.cx_px, measured.intrinsics.fx_px), (600.0, 700.0));
    // The baseline: (45 - 600 * 0.005) / 700 to the left of camera 0.
    let camera_y_m = measured.ego_from_camera.isometry.translation.y;
    assert!((camera_y_m - 42.0 / 700.0).abs() < 1e-9, "{camera_y_m}");
    assert!(measured.points.iter().any(|point| point.ring == 60) && measured.points[0].intensity == 63.75);
}

#[test]
fn a_set_without_labels_has_no_truth() {
    let root = tempfile::tempdir().unwrap();
    let (source, out) = (root.path().join("kitti"), root.path().join("out"));
    object_set(&source, 1);
    fs::remove_dir_all(source.join("training/label_2")).unwrap();
    fs::rename(source.join("training"), source.join("testing")).unwrap();
    assert!(!import(&source, &out, &[], &options()).unwrap().is_labelled);
    let reader = episode(&out, "kitti-testing-000000");
    assert!(reader.sample(0).unwrap().truth.is_none() && reader.log().unwrap().labelled.is_none());
}

#[test]
fn a_sequence_has_measured_speed_poses_and_velocities() {
    let root = tempfile::tempdir().unwrap();
    let (source, out) = (root.path().join("kitti"), root.path().join("out"));
    tracking_set(&source, 5);
    import(&source, &out, &["compensate_motion=true"], &options()).unwrap();
    let reader = episode(&out, "kitti-tracking-0000");
    let sample = reader.sample(2).unwrap();
    let (state, pose) = (sample.measured.ego_state, sample.measured.world_from_ego);
    assert!((state.speed_mps - 10.0).abs() < 1e-9 && state.steering_angle_rad.abs() < 1e-3, "{state:?}");
    assert!((pose.isometry.translation.y - 2.0 - 0.05).abs() < 0.01, "{pose:?}");
    let truth = sample.truth.clone().unwrap();
    let car = &truth.objects[0];
    assert_eq!(car.id.as_deref(), Some("7"));
    let [ahead_mps, left_mps] = car.velocity_in_ego_mps;
    assert!((ahead_mps - 10.0).abs() < 0.01 && left_mps.abs() < 0.01, "{ahead_mps} {left_mps}");
    let methods = &reader.log().unwrap().methods;
    assert!(methods["motion"].contains("moved by the poses") && methods["speed"].contains("measured"));
    // 40 degrees to the left the wall was seen a ninth of a turn before, 11 cm of the ego's way; to the right after.
    let wall_m = |y_m: f32| {
        let is_there = |x_m: &f32, y: f32| (y - y_m).abs() < 0.05 && *x_m > 15.0;
        let points = sample.measured.points.iter();
        points.map(|point| (point.x_m, point.y_m)).find(|(x_m, y)| is_there(x_m, *y)).unwrap().0
    };
    let (left_m, right_m) = (wall_m(12.856), wall_m(-12.856));
    assert!((left_m - 15.21).abs() < 0.01 && (right_m - 15.432).abs() < 0.01, "{left_m} {right_m}");
}

#[test]
fn a_raw_recording_without_tracklets_is_unlabelled_and_keeps_its_stamps() {
    let root = tempfile::tempdir().unwrap();
    let (source, out) = (root.path().join("kitti"), root.path().join("out"));
    raw_drive(&source, 3);
    import(&source, &out, &["ground=fit"], &options()).unwrap();
    let reader = episode(&out, "kitti-2011_09_26_drive_0001_sync");
    assert_eq!(reader.times_ns()[1], 1_317_042_145_100_000_000);
    let sample = reader.sample(1).unwrap();
    assert!(sample.truth.is_none());
    let lidar_z_m = sample.measured.ego_from_lidar.isometry.translation.z;
    assert!((lidar_z_m - 1.73).abs() < 0.02, "{lidar_z_m}");
}

#[test]
fn frames_without_a_stamp_are_left_out_and_the_others_keep_their_files() {
    let root = tempfile::tempdir().unwrap();
    let (source, out) = (root.path().join("kitti"), root.path().join("out"));
    raw_drive(&source, 5);
    let drive = source.join("2011_09_26/2011_09_26_drive_0001_sync");
    // As in the download of drive 0009: a line is empty, and its number has no file.
    for (folder, suffix, number) in [("velodyne_points", "bin", 1), ("oxts", "txt", 3)] {
        let path = drive.join(folder).join("timestamps.txt");
        let text = fs::read_to_string(&path).unwrap();
        let lines = text.lines().enumerate().map(|(i, line)| if i == number { "" } else { line });
        fs::write(&path, lines.collect::<Vec<_>>().join("\n") + "\n\n").unwrap();
        fs::remove_file(drive.join(format!("{folder}/data/{number:010}.{suffix}"))).unwrap();
    }
    import(&source, &out, &[], &options()).unwrap();
    let reader = episode(&out, "kitti-2011_09_26_drive_0001_sync");
    let tenths: Vec<u64> = reader.times_ns().iter().map(|time_ns| time_ns / 100_000_000 % 10).collect();
    assert_eq!(tenths, [0, 2, 3, 4]);
    let log = reader.log().unwrap();
    assert!(log.methods["frames"].starts_with("1 of 5"), "{:?}", log.methods);
    let names: Vec<&str> = log.sample_names.values().map(String::as_str).collect();
    assert_eq!(names, ["0000000000", "0000000002", "0000000003", "0000000004"]);
}

#[test]
fn an_import_goes_on_where_it_stopped_and_takes_further_drives() {
    let root = tempfile::tempdir().unwrap();
    let (source, out) = (root.path().join("kitti"), root.path().join("out"));
    object_set(&source, 3);
    let only = |name: &str| ImportOptions { scenes: vec![name.to_owned()], ..options() };
    import(&source, &out, &[], &only("kitti-000002")).unwrap();
    let manifest = fs::read(out.join("episodes/kitti-000002.mcap")).unwrap();
    let summary = import(&source, &out, &[], &options()).unwrap();
    assert_eq!((summary.n_episodes, summary.n_kept), (3, 1));
    assert_eq!(fs::read(out.join("episodes/kitti-000002.mcap")).unwrap(), manifest);
    let told = import(&source, &out, &["every=2"], &options()).unwrap_err().to_string();
    assert!(told.contains("every = 1") && told.contains("--force"), "{told}");
    let told = import(&source, &out, &[], &only("kitti-7")).unwrap_err().to_string();
    assert!(told.contains("`kitti-000000`"), "{told}");
}

#[test]
fn a_drive_of_the_same_name_of_another_log_is_told_and_made_anew_with_force() {
    let root = tempfile::tempdir().unwrap();
    let (source, other, out) =
        (root.path().join("kitti"), root.path().join("other"), root.path().join("out"));
    let name = "kitti-2011_09_26_drive_0001_sync";
    raw_drive(&source, 3);
    raw_drive(&other, 3);
    let drive = other.join("2011_09_26/2011_09_26_drive_0001_sync");
    for stamps in
        ["velodyne_points", "image_02", "oxts"].map(|folder| drive.join(folder).join("timestamps.txt"))
    {
        let text = fs::read_to_string(&stamps).unwrap();
        fs::write(&stamps, text.replace("2011-09-26", "2011-09-27")).unwrap();
    }
    import(&source, &out, &[], &options()).unwrap();
    let before = fs::read(out.join(format!("episodes/{name}.mcap"))).unwrap();
    let first_ns = episode(&out, name).times_ns()[0];
    let told = import(&other, &out, &[], &options()).unwrap_err().to_string();
    assert!(told.contains(&first_ns.to_string()) && told.contains("--force"), "{told}");
    assert_eq!(fs::read(out.join(format!("episodes/{name}.mcap"))).unwrap(), before);
    let forced = import(&other, &out, &[], &ImportOptions { force: true, ..options() }).unwrap();
    assert_eq!((forced.n_episodes, forced.n_kept), (1, 0));
    assert_eq!(episode(&out, name).times_ns()[0], first_ns + 86_400_000_000_000);
    // What cannot be opened any more costs nothing of what was imported.
    fs::remove_file(drive.join("oxts/timestamps.txt")).unwrap();
    assert_eq!(import(&other, &out, &[], &options()).unwrap().n_kept, 1);
}

#[test]
fn a_set_of_the_same_frame_numbers_is_told_apart_by_its_first_cloud() {
    let root = tempfile::tempdir().unwrap();
    let (source, other, out) =
        (root.path().join("kitti"), root.path().join("other"), root.path().join("out"));
    object_set(&source, 2);
    object_set(&other, 2);
    // The set has no stamps, so times are made up alike.
    for frame in ["000000", "000001"] {
        let path = other.join(format!("training/velodyne/{frame}.bin"));
        let mut cloud = fs::read(&path).unwrap();
        cloud[0] ^= 1;
        fs::write(&path, cloud).unwrap();
    }
    import(&source, &out, &[], &options()).unwrap();
    assert_eq!(import(&source, &out, &[], &options()).unwrap().n_kept, 2);
    let told = import(&other, &out, &[], &options()).unwrap_err().to_string();
    assert!(told.contains("first cloud") && told.contains("--force"), "{told}");
    let forced = import(&other, &out, &[], &ImportOptions { force: true, ..options() }).unwrap();
    assert_eq!((forced.n_episodes, forced.n_kept), (2, 0));
    assert_eq!(import(&other, &out, &[], &options()).unwrap().n_kept, 2);
}

#[test]
fn a_drive_that_lacks_samples_is_imported_again_where_none_may_be_missing() {
    let root = tempfile::tempdir().unwrap();
    let (source, out) = (root.path().join("kitti"), root.path().join("out"));
    raw_drive(&source, 3);
    let name = "kitti-2011_09_26_drive_0001_sync";
    let cloud = source.join("2011_09_26/2011_09_26_drive_0001_sync/velodyne_points/data/0000000001.bin");
    let whole = fs::read(&cloud).unwrap();
    cut(&cloud, 100_003);
    let skipping = ImportOptions { skip_bad: true, ..options() };
    let summary = import(&source, &out, &[], &skipping).unwrap();
    assert_eq!((summary.n_samples, summary.skipped.len()), (2, 1));
    let told = episode(&out, name).log().unwrap().methods["left_out"].clone();
    assert!(told.starts_with("1 of 3 samples") && told.ends_with(": 1"), "{told}");
    // What is here stays until it is made again.
    import(&source, &out, &[], &options()).unwrap_err();
    let summary = import(&source, &out, &[], &skipping).unwrap();
    assert_eq!((summary.n_samples, summary.n_kept), (2, 1));
    fs::write(&cloud, whole).unwrap();
    let summary = import(&source, &out, &[], &options()).unwrap();
    assert_eq!((summary.n_episodes, summary.n_samples, summary.n_kept), (1, 3, 0));
    assert_eq!(import(&source, &out, &[], &options()).unwrap().n_kept, 1);
}

/// What is done to a frame, and what must be told.
type Damage = (&'static str, fn(&Path), &'static str);

fn cut(path: &Path, to_bytes: usize) {
    let bytes = fs::read(path).unwrap();
    fs::write(path, &bytes[..to_bytes]).unwrap();
}

fn replace(path: &Path, from: &str, to: &str) {
    let text = fs::read_to_string(path).unwrap();
    assert!(text.contains(from));
    fs::write(path, text.replacen(from, to, 1)).unwrap();
}

const DAMAGES: [Damage; 15] = [
    ("cut cloud", |set| cut(&set.join("velodyne/000000.bin"), 100_003), "no multiple of 16"),
    ("no cloud", |set| fs::remove_file(set.join("velodyne/000000.bin")).unwrap(), "is missing"),
    ("empty cloud", |set| cut(&set.join("velodyne/000000.bin"), 0), "no points"),
    (
        "cloud of zeros",
        |set| fs::write(set.join("velodyne/000000.bin"), [0; 1600]).unwrap(),
        "none is a return",
    ),
    ("cut picture", |set| cut(&set.join("image_2/000000.png"), 300), "torn"),
    ("no picture", |set| fs::remove_file(set.join("image_2/000000.png")).unwrap(), "is missing"),
    ("no projection", |set| replace(&set.join("calib/000000.txt"), "P2:", "P9:"), "no row `P2`"),
    ("no calibration", |set| fs::remove_file(set.join("calib/000000.txt")).unwrap(), "is missing"),
    (
        "no mounting",
        |set| replace(&set.join("calib/000000.txt"), "Tr_velo_to_cam:", "Tr:"),
        "lacks `Tr_velo_to_cam`",
    ),
    ("short calibration", |set| cut(&set.join("calib/000000.txt"), 40), "P2"),
    (
        "swapped axes",
        |set| {
            replace(
                &set.join("calib/000000.txt"),
                "0 -1 0 0.0 0 0 -1 -0.08 1 0 0",
                "1 0 0 0.0 0 1 0 -0.08 0 0 1",
            );
        },
        "z axis points along",
    ),
    (
        "mirrored mounting",
        |set| replace(&set.join("calib/000000.txt"), "0 -1 0 0.0", "0 1 0 0.0"),
        "no rotation",
    ),
    ("short label", |set| replace(&set.join("label_2/000000.txt"), " 20.00 ", " "), "15 columns"),
    ("label of nan", |set| replace(&set.join("label_2/000000.txt"), "1.65 20.00", "nan 20.00"), "finite"),
    ("foreign category", |set| replace(&set.join("label_2/000000.txt"), "Car", "Zebra"), "`Zebra`"),
];

#[test]
fn a_damaged_frame_is_told_and_leaves_no_episode() {
    for (name, damage, wanted) in DAMAGES {
        let root = tempfile::tempdir().unwrap();
        let (source, out) = (root.path().join("kitti"), root.path().join("out"));
        object_set(&source, 2);
        damage(&source.join("training"));
        let told = import(&source, &out, &[], &options()).expect_err(name).to_string();
        assert!(told.contains(wanted), "{name}: {told}");
        assert_eq!(fs::read_dir(out.join("episodes")).unwrap().count(), 0, "{name}");
        let skipping = ImportOptions { skip_bad: true, ..options() };
        let summary = import(&source, &out, &[], &skipping).unwrap();
        assert_eq!((summary.n_episodes, summary.skipped.len()), (1, 1), "{name}: {:?}", summary.skipped);
        assert!(summary.skipped[0].contains(wanted), "{name}: {:?}", summary.skipped);
    }
}

#[test]
fn sets_without_pictures_get_black_ones_with_the_sets_calibration() {
    type Layout = (&'static str, fn(&Path, usize), &'static str, &'static str);
    let root = tempfile::tempdir().unwrap();
    let layouts: [Layout; 3] = [
        ("object", object_set, "training/image_2", "kitti-000001"),
        ("tracking", tracking_set, "training/image_02", "kitti-tracking-0000"),
        (
            "raw",
            raw_drive,
            "2011_09_26/2011_09_26_drive_0001_sync/image_02",
            "kitti-2011_09_26_drive_0001_sync",
        ),
    ];
    for (layout, make, pictures, drive) in layouts {
        let (source, out) = (root.path().join(layout), root.path().join(format!("{layout}-out")));
        make(&source, 2);
        fs::remove_dir_all(source.join(pictures)).unwrap();
        let summary = import(&source, &out, &[], &options()).unwrap();
        assert_eq!(summary.n_samples, 2, "{layout}");
        assert!(summary.notes.iter().any(|note| note.contains("no pictures of `cam_front`")), "{summary:?}");
        let reader = episode(&out, drive);
        let measured = reader.sample(0).unwrap().measured;
        assert_eq!((measured.intrinsics.fx_px, measured.intrinsics.width_px), (700.0, 1242), "{layout}");
        assert!(measured.image.decode().unwrap().iter().all(|value| *value == 0), "{layout}");
        let camera = &reader.log().unwrap().methods["camera"];
        assert!(camera.contains("a black one with the log's calibration"), "{camera}");
    }
}

#[test]
fn a_sequence_with_a_hole_in_its_poses_or_labels_beyond_its_end_is_told() {
    let told = |damage: &dyn Fn(&Path)| {
        let root = tempfile::tempdir().unwrap();
        let source = root.path().join("kitti");
        raw_drive(&source, 4);
        damage(&source.join("2011_09_26/2011_09_26_drive_0001_sync"));
        import(&source, &root.path().join("out"), &[], &options()).unwrap_err().to_string()
    };
    let late = |drive: &Path| {
        let stamps = (0..4).fold(String::new(), |all, i| all + &format!("2011-09-26 14:00:0{i}.0\n"));
        fs::write(drive.join("oxts/timestamps.txt"), stamps).unwrap();
    };
    let said = told(&late);
    assert!(said.contains("no pose belongs to the sample at 1317042145000000000 ns"), "{said}");
    let short =
        |drive: &Path| fs::write(drive.join("image_02/timestamps.txt"), "2011-09-26 13:02:25.0\n").unwrap();
    assert!(told(&short).contains("1 stamps of pictures and 4 of clouds"));
    let shifted = |drive: &Path| {
        let stamps = (0..4).fold(String::new(), |all, i| all + &format!("2011-09-26 13:02:25.{i}7\n"));
        fs::write(drive.join("image_02/timestamps.txt"), stamps).unwrap();
    };
    assert!(told(&shifted).contains("0.070 s from the sample"), "{}", told(&shifted));
    let broken = |drive: &Path| write(drive.join("tracklet_labels.xml"), "<tracklets>");
    assert!(told(&broken).contains("no valid XML"));
}

/// The real frames beside the project; without them the test says so.
#[test]
fn the_sample_frames_import() {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/samples/kitti");
    if !source.is_dir() {
        tell(format_args!("skipped: there are no sample frames at {}", source.display()));
        return;
    }
    let out = tempfile::tempdir().unwrap();
    let summary = import(&source, &out.path().join("out"), &[], &options()).unwrap();
    assert_eq!((summary.n_episodes, summary.skipped.len()), (8, 0));
    let reader = episode(&out.path().join("out"), "kitti-000001");
    let sample = reader.sample(0).unwrap();
    let truth = sample.truth.unwrap();
    assert_eq!((truth.objects.len(), truth.ignored.len()), (3, 4));
    assert!(truth.objects.iter().all(|object| object.n_lidar_points.unwrap() > 0), "{:?}", truth.objects);
    let rings = sample.measured.points.iter().map(|point| point.ring);
    assert_eq!((rings.clone().min(), rings.max()), (Some(0), Some(63)));
}

/// Says on standard error that a test had nothing to work on.
fn tell(what: std::fmt::Arguments<'_>) {
    use std::io::Write as _;
    writeln!(std::io::stderr(), "{what}").expect("standard error takes a line");
}
