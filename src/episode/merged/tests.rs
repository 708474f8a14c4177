//! The joined file: what readers of each kind find in it, and what it draws.

use std::path::Path;

use foxglove::messages as fox;

use super::*;
use crate::episode::archive_reader::Archive;
use crate::episode::messages::wire;
use crate::episode::tests::{folder, labels_of, map, meta, source, three};
use crate::episode::{DetectionWriter, EpisodeWriter, LabelWriter};
use crate::files::sha256_of;
use crate::progress::Silent;

const LOOK: MergedLook = MergedLook {
    harmful: [255, 0, 0],
    harmless: [0, 0, 255],
    unlabelled: [128; 3],
    predicted_harmful: [255, 128, 0],
    predicted_harmless: [200, 180, 255],
    zone: [0, 255, 0],
    ink: [0; 3],
    text: [255; 3],
    min_score: 0.3,
};

/// An episode of three samples, its labels, and two, one and no boxes that a network reports, of which one has a low score.
struct Made {
    folder: tempfile::TempDir,
    episode: EpisodeReader,
    labels: LabelReader,
    detections: DetectionReader,
}

fn made() -> Made {
    let (folder, path) = folder();
    let mut writer = EpisodeWriter::create(&path, &meta(), &map()).unwrap();
    three().iter().for_each(|sample| writer.write(sample).unwrap());
    writer.finish().unwrap();
    let meta = source(&sha256_of(&path).unwrap());
    let labels = folder.path().join("labels.mcap");
    let mut writer = LabelWriter::create(&labels, &meta).unwrap();
    three().iter().for_each(|sample| writer.write(&labels_of(sample), sample).unwrap());
    writer.finish().unwrap();
    let detections = folder.path().join("detections.mcap");
    let mut writer = DetectionWriter::create(&detections, &meta).unwrap();
    for (sample, n) in three().iter().zip([2, 1, 0]) {
        let found = [(Harm::Harmful, 0.75), (Harm::Harmless, 0.5), (Harm::Harmful, 0.25)];
        let found = found.iter().take(n).chain(&found[2..]).map(|&(harm, score)| Detection {
            box_in_ego: sample.objects()[0].box_in_ego,
            velocity_in_ego_mps: [0.0; 2],
            harm,
            score,
            spread: None,
        });
        writer
            .write(&SampleDetections { time_ns: sample.measured.time_ns, detections: found.collect() })
            .unwrap();
    }
    writer.finish().unwrap();
    Made {
        episode: EpisodeReader::open(&path).unwrap(),
        labels: LabelReader::open(&labels).unwrap(),
        detections: DetectionReader::open(&detections).unwrap(),
        folder,
    }
}

fn merge(made: &Made, name: &str) -> PathBuf {
    let sources = MergeSources {
        episode: &made.episode,
        labels: Some(&made.labels),
        detections: Some(&made.detections),
    };
    write_merged(&made.folder.path().join(name), sources, &LOOK, &Silent).unwrap()
}

fn messages<M: crate::episode::messages::TopicMessage>(path: &Path, topic: topics::Topic<M>) -> Vec<M> {
    let archive = Archive::open(path, &[topic.spec()]).unwrap();
    archive.messages_of(topic).unwrap().into_iter().map(|(_, message)| message).collect()
}

#[test]
fn the_readers_of_each_kind_read_the_joined_file() {
    let made = made();
    let path = merge(&made, "joined.mcap");
    let episode = EpisodeReader::open(&path).unwrap();
    assert_eq!(episode.samples().map(Result::unwrap).collect::<Vec<_>>(), three());
    assert_eq!((episode.meta(), episode.map().unwrap()), (&meta(), map()));
    let labels = LabelReader::open(&path).unwrap();
    assert_eq!((labels.samples(), labels.meta()), (made.labels.samples(), made.labels.meta()));
    let detections = DetectionReader::open(&path).unwrap();
    assert_eq!(detections.samples(), made.detections.samples());
    let archive = Archive::open(&path, &[]).unwrap();
    let found: Vec<&str> = archive.topics().collect();
    assert!(topics::DRAWINGS.iter().all(|drawing| !found.contains(drawing)), "{found:?}");
    let drawn = found.iter().filter(|topic| topic.starts_with("/view/")).count();
    assert_eq!(drawn, 8, "{found:?}");
}

#[test]
fn the_same_files_give_the_same_bytes_and_an_episode_alone_has_fewer_topics() {
    let made = made();
    let read = |name| fs_err::read(merge(&made, name)).unwrap();
    assert!(read("a.mcap") == read("b.mcap"));
    let sources = MergeSources { episode: &made.episode, labels: None, detections: None };
    let path = write_merged(&made.folder.path().join("alone.mcap"), sources, &LOOK, &Silent).unwrap();
    let archive = Archive::open(&path, &[]).unwrap();
    let found: Vec<&str> = archive.topics().filter(|topic| topic.starts_with("/view/")).collect();
    assert_eq!(
        found,
        ["/view/boxes", "/view/ego", "/view/numbers", "/view/objects", "/view/truth_annotations"]
    );
    let numbers = messages(&path, topics::VIEW_NUMBERS);
    assert_eq!((numbers[0].n_objects, numbers[0].n_harmful, numbers[0].zone_depth_m), (Some(2), None, None));
}

#[test]
fn boxes_stay_until_they_are_gone_and_low_scores_are_not_drawn() {
    let made = made();
    let path = merge(&made, "joined.mcap");
    let told = |update: &fox::SceneUpdate| {
        let entities = update.entities.iter().map(|entity| entity.id.clone()).collect::<Vec<_>>();
        let deletions = update.deletions.iter().map(|deletion| deletion.id.clone()).collect::<Vec<_>>();
        (entities, deletions)
    };
    let detections: Vec<_> = messages(&path, topics::VIEW_DETECTIONS).iter().map(told).collect();
    let names = |of: &[&str]| of.iter().map(|name| (*name).to_owned()).collect::<Vec<String>>();
    assert_eq!(
        detections,
        [
            (names(&["detection:0", "detection:1"]), names(&[])),
            (names(&["detection:0"]), names(&["detection:1"])),
            (names(&[]), names(&["detection:0"])),
        ]
    );
    let truth = messages(&path, topics::VIEW_BOXES);
    assert!(truth.iter().all(|update| update.entities.len() == 2 && update.deletions.is_empty()));
    for entity in &truth[0].entities {
        assert_eq!(
            (entity.lifetime, entity.cubes.len(), entity.lines.len()),
            (Some(fox::Duration::new(0, 0)), 1, 1)
        );
    }
    // The hay bale is harmful and out of distribution: dashed, and with its name.
    let [car, bale] = truth[0].entities.as_slice() else { panic!("two boxes") };
    assert_eq!((car.lines[0].points.len(), car.texts.len()), (24, 0));
    assert!(bale.lines[0].points.len() > 100, "{}", bale.lines[0].points.len());
    assert_eq!(bale.texts[0].text, "hay bale");
    assert_eq!(bale.cubes[0].color.as_ref().map(|color| (color.r, color.b)), Some((1.0, 0.0)));
}

#[test]
fn numbers_and_rows_tell_what_is_drawn() {
    let made = made();
    let path = merge(&made, "joined.mcap");
    let numbers = messages(&path, topics::VIEW_NUMBERS);
    let first = &numbers[0];
    assert_eq!((first.speed_mps, first.n_harmful, first.n_predicted), (0.1, Some(1), Some(2)));
    assert_eq!((first.n_predicted_harmful, first.highest_harmful_score), (Some(1), Some(0.75)));
    // From the bumper at 3.6 m to the corners at 9 m.
    assert!((first.zone_depth_m.unwrap() - 5.4).abs() < 1e-12, "{first:?}");
    assert_eq!((numbers[2].n_predicted, numbers[2].highest_harmful_score), (Some(0), Some(0.0)));
    let rows: Vec<wire::ViewObjects> = messages(&path, topics::VIEW_OBJECTS);
    let told: Vec<_> = rows[0].objects.iter().map(|row| (row.id.as_str(), row.harm.as_str())).collect();
    assert_eq!(told, [("hay_bale:2", "harmful"), ("car:1", "harmless")]);
    assert!((rows[0].objects[1].distance_m - 10.0).abs() < 0.01);
}

#[test]
fn annotations_lie_in_the_picture_and_the_car_is_drawn_once() {
    let made = made();
    let path = merge(&made, "joined.mcap");
    for annotations in messages(&path, topics::VIEW_TRUTH_ANNOTATIONS) {
        let points = annotations.points.iter().flat_map(|list| &list.points);
        let is_inside = |point: &fox::Point2| {
            (-1e-6..=800.0 + 1e-6).contains(&point.x) && (-1e-6..=450.0 + 1e-6).contains(&point.y)
        };
        assert!(points.clone().count() > 20 && points.clone().all(is_inside), "{annotations:?}");
        assert_eq!(annotations.points[0].metadata[0].value, "danger_zone");
        assert!(annotations.texts[0].text.ends_with("predicted harmful"), "{:?}", annotations.texts[0]);
    }
    let drawn = messages(&path, topics::VIEW_EGO);
    assert_eq!(drawn.len(), 1);
    let [car] = drawn[0].entities.as_slice() else { panic!("one entity") };
    assert!(car.frame_locked && car.models[0].data.starts_with(b"glTF"));
}

#[test]
fn labels_of_other_samples_are_refused() {
    let made = made();
    let labels = made.folder.path().join("other.mcap");
    let mut writer = LabelWriter::create(&labels, made.labels.meta()).unwrap();
    let first = &three()[0];
    writer.write(&labels_of(first), first).unwrap();
    writer.finish().unwrap();
    let other = LabelReader::open(&labels).unwrap();
    let sources = MergeSources { episode: &made.episode, labels: Some(&other), detections: None };
    let out = made.folder.path().join("refused.mcap");
    let message = write_merged(&out, sources, &LOOK, &Silent).unwrap_err().to_string();
    assert!(message.contains("sample 1") && message.contains("`labels` is missing"), "{message}");
    assert!(!out.exists());
}
