//! The kinds of damage, and the check that must name each.

use std::path::{Path, PathBuf};

use fs_err as fs;
use harmzone::config::to_toml;
use harmzone::episode::{EpisodeEntry, LabelManifest, Manifest, Split};
use harmzone::generate::GenerateConfig;
use harmzone::geometry::{Ego, Point, Transform};
use harmzone::object::{Harm, Kind};
use harmzone::random::{Rng, stream};
use harmzone::sample::Sample;
use harmzone::sensors::{Rig, RigConfig};
use harmzone::zone::ZoneConfig;
use nalgebra::{UnitQuaternion, Vector3};
use rand::RngExt as _;

use super::rewrite::{
    change_labels, change_manifest, episode, exchange, label_file, largest, name_hash, read, replace,
    rewrite, rewrite_each, rewrite_labels, rewrite_raw, rewrite_under_labels, shift_stamps, spoil_manifest,
    truth,
};

/// A kind of damage: what is damaged, the check that names it, and the damage to a data set's copy; the number varies the place.
pub type Damage = (&'static str, &'static str, fn(&Path, u64));

const OBJECTS: &str = "/truth/objects";
const CLOUD: &str = "/lidar_top";
const CAMERA_INFO: &str = "/cam_front/camera_info";
const IMAGE: &str = "/cam_front/image_rect_compressed";

fn rng(i: u64) -> Rng {
    stream(i, "doctor", 0)
}

/// Changes one bit.
fn flip(file: &Path, i: u64) {
    let mut bytes = fs::read(file).expect("a readable file");
    let bit = rng(i).random_range(0..bytes.len() * 8);
    bytes[bit / 8] ^= 1 << (bit % 8);
    fs::write(file, bytes).expect("a writable copy");
}

/// Leaves a part of the beginning.
fn cut(file: &Path, i: u64) {
    let bytes = fs::read(file).expect("a readable file");
    let at = rng(i).random_range(0..bytes.len());
    fs::write(file, &bytes[..at]).expect("a writable copy");
}

fn remove(file: &Path) {
    fs::remove_file(file).expect("a writable copy");
}

fn swap(one: &Path, other: &Path) {
    let aside = one.with_extension("swapped");
    for (from, to) in [(one, aside.as_path()), (other, one), (aside.as_path(), other)] {
        fs::rename(from, to).expect("a writable copy");
    }
}

fn labels_json(path: &Path) -> PathBuf {
    path.join("labels/rect").join(LabelManifest::FILE)
}

/// One of the samples.
fn some(samples: &mut [Sample], i: u64) -> &mut Sample {
    let n = samples.len() as u64;
    &mut samples[(i % n) as usize]
}

/// The camera of every sample turned aside, and the rig in the metadata with it.
fn turn_camera(path: &Path, i: u64) {
    rewrite(path, i as usize, |meta, samples| {
        let mut rig: RigConfig = toml::from_str(&meta.rig_toml).expect("a rig");
        rig.cameras.get_mut("cam_front").expect("a front camera").yaw_deg = 25.0 + i as f64;
        let camera = Rig::try_from(&rig).expect("a valid rig").front().ego_from_camera;
        samples.iter_mut().for_each(|sample| sample.measured.ego_from_camera = camera);
        meta.rig_toml = to_toml(&rig);
    });
}

/// The four numbers of a message's quaternions (`foxglove.Quaternion`: x, y, z, w, each a tag and a double), at a camera's.
fn quaternion_at(bytes: &[u8]) -> Option<UnitQuaternion<f64>> {
    let number = |i: usize, tag: u8| {
        let part = &bytes[9 * i..9 * i + 9];
        (part[0] == tag).then(|| f64::from_le_bytes(part[1..].try_into().expect("eight bytes")))
    };
    let [x, y, z, w] = [number(0, 0x09)?, number(1, 0x11)?, number(2, 0x19)?, number(3, 0x21)?];
    // A camera that looks ahead has halves, of either sign.
    [x, y, z, w]
        .iter()
        .all(|of| (of.abs() - 0.5).abs() < 0.1)
        .then(|| UnitQuaternion::new_normalize(nalgebra::Quaternion::new(w, x, y, z)))
}

/// Turns the cameras of a message about the way they look.
fn turn_over(message: &mut mcap::Message<'static>) {
    let over = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), std::f64::consts::PI);
    for at in 0..message.data.len().saturating_sub(35) {
        if let Some(turned) = quaternion_at(&message.data[at..at + 36]).map(|found| found * over) {
            for (i, number) in turned.coords.iter().enumerate() {
                message.data.to_mut()[at + 9 * i + 1..at + 9 * i + 9].copy_from_slice(&number.to_le_bytes());
            }
        }
    }
}

/// The second field of a calibration as Protobuf has it: its tag, and four bytes.
fn width_field(width_px: u32) -> [u8; 5] {
    let [a, b, c, d] = width_px.to_le_bytes();
    [2 << 3 | 5, a, b, c, d]
}

/// The farthest point of one sample is so many millimetres away as it was metres.
fn point_in_millimetres(path: &Path, i: u64) {
    let (_, samples) = read(&episode(path, i as usize));
    let points = &samples[i as usize % samples.len()].measured.points;
    let farthest = points.iter().max_by(|a, b| a.x_m.hypot(a.y_m).total_cmp(&b.x_m.hypot(b.y_m)));
    let point = farthest.expect("a cloud with points");
    let bytes = |scale: f32| {
        [point.x_m, point.y_m, point.z_m].map(|coordinate| (scale * coordinate).to_le_bytes()).concat()
    };
    rewrite_raw(path, i as usize, |messages| replace(messages, CLOUD, &bytes(1.0), &bytes(1e3)));
}

/// An object's number in the message of one sample becomes another.
fn replace_number(path: &Path, i: u64, number: fn(&Sample) -> f64, other: fn(f64) -> f64) {
    let (_, samples) = read(&episode(path, i as usize));
    let found = number(&samples[0]);
    rewrite_raw(path, i as usize, |messages| {
        replace(messages, OBJECTS, &found.to_le_bytes(), &other(found).to_le_bytes());
    });
}

/// Two objects of all samples get ids of one length, then one sample's are made the same.
fn same_id(path: &Path, i: u64) {
    rewrite(path, i as usize, |_, samples| {
        let first = |place: usize| samples[0].objects()[place].id.clone();
        let renamed = [(first(0), "object-a"), (first(1), "object-b")];
        for object in samples.iter_mut().flat_map(|sample| truth(sample).objects.iter_mut()) {
            let new = renamed.iter().find(|(old, _)| *old == object.id);
            object.id = new.map_or(object.id.clone(), |(_, new)| Some((*new).to_owned()));
        }
    });
    rewrite_raw(path, i as usize, |messages| replace(messages, OBJECTS, b"object-b", b"object-a"));
}

fn shift_lidar(sample: &mut Sample) {
    let moved = Transform::<Ego, Ego>::from_xyz_yaw(0.3, 0.0, 0.1, 0.0);
    sample.measured.ego_from_lidar = moved * sample.measured.ego_from_lidar;
}

/// A fact of an entry that its episode says otherwise.
fn change_entry(path: &Path, i: u64) {
    change_manifest(path, |manifest| {
        let n = manifest.episodes.len() as u64;
        let entry = &mut manifest.episodes[(i % n) as usize];
        match i % 4 {
            0 => "elsewhere".clone_into(&mut entry.town),
            1 => "FogNight".clone_into(&mut entry.weather),
            2 => entry.seed += 1,
            _ => entry.ood = !entry.ood,
        }
    });
}

/// Changes one bit of the first sample, and names the file's new hash in the manifest: only what the file says of itself tells.
fn flip_under_its_hash(path: &Path, i: u64) {
    let file = episode(path, i as usize);
    let mut bytes = fs::read(&file).expect("a readable file");
    // Of three samples, each a chunk, and most of it the packed picture and points.
    let at = rng(i).random_range(bytes.len() * 3 / 20..bytes.len() / 4);
    bytes[at] ^= 1 << (i % 8);
    fs::write(&file, bytes).expect("a writable copy");
    name_hash(path, i as usize);
}

/// Hundreds of samples in which nothing stands: more than any town explains. Without most points, so that they are soon written.
fn empty_town(path: &Path, i: u64) {
    const N_SAMPLES: u64 = 320;
    const PERIOD_NS: u64 = 300_000_000;
    rewrite(path, i as usize, |_, samples| {
        let mut one = samples[0].clone();
        one.measured.points.truncate(100);
        truth(&mut one).objects.clear();
        let first_ns = one.measured.time_ns;
        let at = |k: u64| {
            let mut sample = one.clone();
            sample.measured.time_ns = first_ns + k * PERIOD_NS;
            sample
        };
        *samples = (0..N_SAMPLES).map(at).collect();
    });
}

/// The checks that only warn.
pub const WARNING: [&str; 2] = ["motion", "statistics"];

/// All kinds; for data sets of two episodes or more, as `gen` makes them.
pub const KINDS: &[Damage] = &[
    ("a bit of an episode", "hashes", |path, i| flip(&episode(path, i as usize), i)),
    ("a bit of a label file", "hashes", |path, i| flip(&label_file(path, i as usize), i)),
    ("a bit of dataset.json", "manifest", |path, i| flip(&path.join(Manifest::FILE), i)),
    ("a bit of labels.json", "labels", |path, i| flip(&labels_json(path), i)),
    ("a bit of gen.toml", "config", |path, i| flip(&path.join("gen.toml"), i)),
    ("a cut episode", "crcs", |path, i| cut(&episode(path, i as usize), i)),
    ("a cut label file", "crcs", |path, i| cut(&label_file(path, i as usize), i)),
    ("a cut dataset.json", "manifest", |path, i| cut(&path.join(Manifest::FILE), i)),
    ("a cut labels.json", "labels", |path, i| cut(&labels_json(path), i)),
    ("a cut gen.toml", "config", |path, i| cut(&path.join("gen.toml"), i)),
    ("an episode is gone", "files", |path, i| remove(&episode(path, i as usize))),
    ("a label file is gone", "files", |path, i| remove(&label_file(path, i as usize))),
    ("dataset.json is gone", "manifest", |path, _| remove(&path.join(Manifest::FILE))),
    ("labels.json is gone", "labels", |path, _| remove(&labels_json(path))),
    ("gen.toml is gone", "config", |path, _| remove(&path.join("gen.toml"))),
    ("two episodes are swapped", "hashes", |path, _| swap(&episode(path, 0), &episode(path, 1))),
    ("two label files are swapped", "hashes", |path, _| swap(&label_file(path, 0), &label_file(path, 1))),
    ("an unknown episode", "files", |path, i| {
        let to = path.join(format!("episodes/unknown-{i}.mcap"));
        fs::copy(episode(path, i as usize), to).expect("a writable copy");
    }),
    ("an entry's fact", "entries", change_entry),
    ("an entry's count of objects", "entries", |path, i| {
        change_manifest(path, |of| of.episodes[i as usize % 2].n_objects.id.vehicle += 1);
    }),
    ("an entry's count of samples", "entries", |path, i| {
        change_manifest(path, |of| of.episodes[i as usize % 2].n_samples += 1);
    }),
    ("an entry's split", "entries", |path, i| {
        change_manifest(path, |of| of.episodes[i as usize % 2].split = Split::Test);
    }),
    ("an entry's hash", "hashes", |path, i| {
        change_manifest(path, |of| of.episodes[i as usize % 2].sha256 = "0".repeat(64));
    }),
    ("the config's hash", "config", |path, _| change_manifest(path, |of| of.config_sha256 = "0".repeat(64))),
    ("an entry is there twice", "manifest", |path, i| {
        spoil_manifest(path, |of| {
            let again = of.episodes[i as usize % 2].clone();
            of.episodes.push(EpisodeEntry { name: "again".to_owned(), ..again });
        });
    }),
    ("labels of another episode's version", "labels", |path, i| {
        rewrite_under_labels(path, i as usize, |_, samples| {
            some(samples, i).measured.points.pop();
        });
    }),
    ("label entries are exchanged", "labels", |path, _| {
        change_labels(path, |of| {
            let [one, other] = &mut of.episodes[..] else { panic!("two episodes") };
            std::mem::swap(&mut one.file, &mut other.file);
            std::mem::swap(&mut one.sha256, &mut other.sha256);
        });
    }),
    ("a label entry is gone", "labels", |path, i| {
        change_labels(path, |of| drop(of.episodes.remove(i as usize % 2)));
    }),
    ("the counts of labels", "labels", |path, _| change_labels(path, |of| of.counts.id.vehicle.harmful += 1)),
    ("another zone", "labels", |path, _| {
        change_labels(path, |of| {
            of.zone_toml = to_toml(&ZoneConfig { width_m: 2.0, ..ZoneConfig::default() });
        });
    }),
    ("a label is turned", "labels", |path, i| {
        rewrite_labels(path, i as usize, |of| of[0].labels[0].harm = Harm::other(of[0].labels[0].harm));
    }),
    ("the LiDAR is moved in a sample", "rig", |path, i| {
        rewrite(path, i as usize, |_, samples| shift_lidar(some(samples, i)));
    }),
    ("the LiDAR is moved in all", "rig", |path, i| rewrite_each(path, i as usize, shift_lidar)),
    ("the focal length", "rig", |path, i| {
        rewrite_each(path, i as usize, |sample| sample.measured.intrinsics.fx_px *= 1.1);
    }),
    ("the camera is upside down", "rig", |path, i| {
        rewrite_raw(path, i as usize, |messages| messages.iter_mut().for_each(turn_over));
    }),
    ("the camera looks aside", "camera", turn_camera),
    ("the rig in the metadata", "rig", |path, i| {
        rewrite(path, i as usize, |meta, _| {
            let mut rig: RigConfig = toml::from_str(&meta.rig_toml).expect("a rig");
            rig.lidars.get_mut("lidar_top").expect("a top LiDAR").x_m += 0.1;
            meta.rig_toml = to_toml(&rig);
        });
    }),
    ("the config in the metadata", "entries", |path, i| {
        rewrite(path, i as usize, |meta, _| {
            let mut config: GenerateConfig = toml::from_str(&meta.config_toml).expect("a config");
            config.seed += 1;
            meta.config_toml = to_toml(&config);
        });
    }),
    ("the name in the metadata", "entries", |path, i| {
        rewrite(path, i as usize, |meta, _| "elsewhere-ClearNoon-1".clone_into(&mut meta.name));
    }),
    ("a sample is lost", "entries", |path, i| {
        rewrite(path, i as usize, |_, samples| {
            samples.pop();
        });
    }),
    ("a sample's time", "times", |path, i| {
        rewrite(path, i as usize, |_, samples| samples[1].measured.time_ns += 1_000_000 * (i + 1));
    }),
    ("samples out of order", "times", |path, i| {
        rewrite_raw(path, i as usize, |of| of.sort_by_key(|message| std::cmp::Reverse(message.log_time)));
    }),
    ("stamps are shifted", "times", |path, i| {
        let topics = [IMAGE, CLOUD, CAMERA_INFO, OBJECTS, "/ego/state", "/ego/pose", "/truth/ignored"];
        rewrite_raw(path, i as usize, |of| shift_stamps(of, topics[i as usize % topics.len()]));
    }),
    ("messages are exchanged, stamps and all", "times", |path, i| {
        let topics = ["/tf", IMAGE, "/ego/state", "/truth/ignored", "/truth/markers", CLOUD, OBJECTS];
        rewrite_raw(path, i as usize, |of| exchange(of, topics[i as usize % topics.len()]));
    }),
    ("a message is lost", "schemas", |path, i| {
        let topics = ["/tf", "/ego/state", "/lidar_top", "/cam_front/camera_info", OBJECTS];
        rewrite_raw(path, i as usize, |of| {
            let topic = topics[i as usize % topics.len()];
            let at =
                of.iter().position(|message| message.channel.topic == topic).expect("the topic is there");
            of.remove(at);
        });
    }),
    ("a topic is lost", "schemas", |path, i| {
        rewrite_raw(path, i as usize, |of| of.retain(|message| message.channel.topic != "/lidar_top"));
    }),
    ("an id is there twice", "ids", same_id),
    ("an object becomes another kind", "ids", |path, i| {
        rewrite(path, i as usize, |_, samples| {
            let object = &mut truth(samples.last_mut().expect("samples")).objects[0];
            object.kind = Some(if object.kind == Some(Kind::Vehicle) { Kind::Static } else { Kind::Vehicle });
        });
    }),
    ("a box at NaN", "boxes", |path, i| {
        replace_number(path, i, |of| of.objects()[0].box_in_ego.center.x(), |_| f64::NAN);
    }),
    ("a box of negative length", "boxes", |path, i| {
        replace_number(path, i, |of| of.objects()[0].box_in_ego.length_m, |length_m| -length_m);
    }),
    ("a box of a hundred metres", "boxes", |path, i| {
        rewrite(path, i as usize, |_, samples| {
            truth(some(samples, i)).objects[0].box_in_ego.length_m = 100.0;
        });
    }),
    ("a speed of 200 m/s", "boxes", |path, i| {
        rewrite(path, i as usize, |_, samples| {
            truth(some(samples, i)).objects[0].velocity_in_ego_mps = [200.0, 0.0];
        });
    }),
    ("a box beside its points", "points", |path, i| {
        rewrite(path, i as usize, |_, samples| {
            let of = &mut largest(some(samples, i)).box_in_ego;
            of.center = Point::new(of.center.x(), of.center.y() + 6.0, of.center.z());
        });
    }),
    ("an object's count of points", "points", |path, i| {
        rewrite(path, i as usize, |_, samples| {
            let object = largest(some(samples, i));
            object.n_lidar_points = object.n_lidar_points.map(|n| 10 * n + 100);
        });
    }),
    ("a cloud lifted by 2 m", "points", |path, i| {
        rewrite(path, i as usize, |_, samples| {
            some(samples, i).measured.points.iter_mut().for_each(|point| point.z_m += 2.0);
        });
    }),
    ("a point in millimetres", "clouds", point_in_millimetres),
    ("a bit of a sample, its hash named", "crcs", flip_under_its_hash),
    ("a speed that the poses belie", "motion", |path, i| {
        rewrite_each(path, i as usize, |sample| sample.measured.ego_state.speed_mps += 20.0);
    }),
    ("a town without objects", "statistics", empty_town),
    ("a torn picture", "pictures", |path, i| {
        rewrite(path, i as usize, |_, samples| some(samples, i).measured.image.bytes.truncate(20));
    }),
    ("a calibration of a wider picture", "pictures", |path, i| {
        rewrite_raw(path, i as usize, |of| replace(of, CAMERA_INFO, &width_field(800), &width_field(810)));
    }),
];
