//! A folder to serve: a small data set with boxes of a made-up detector, scores and a report, and a data set of a thousand
//! episodes, whose files are few and have many names.

#![allow(dead_code, reason = "each test file uses its part")]

use std::path::{Path, PathBuf};

use fs_err as fs;
use harmzone::episode::manifest::{LabelEntry, LabelManifest};
use harmzone::episode::{
    DetectionWriter, EpisodeEntry, EpisodeReader, LabelReader, Manifest, SampleDetections, SourceMeta, Split,
};
use harmzone::eval::json;
use harmzone::geometry::Point;
use harmzone::object::{Detection, Harm};

use crate::made_data::{done, text};

/// Towns and weathers of the thousand, for the filters; only their names.
const TOWNS: [&str; 4] = ["downtown", "market", "oldtown", "suburb"];
const WEATHERS: [&str; 3] = ["ClearNoon", "FogNoon", "WetSunset"];

/// Makes `small`, labelled, and `found` with boxes for it: each truth as it is, but in every other episode the first harmful
/// object of a sample called harmless, and one box where nothing is.
pub fn small(folder: &Path) -> PathBuf {
    let data = folder.join("small");
    let flags = "--town downtown --episodes 3 --samples 3 --seed 10 --jobs 2 --ood --set val_every=1";
    done(&[&["gen"], &flags.split(' ').collect::<Vec<_>>()[..], &["--out", text(&data)]].concat());
    done(&["label", text(&data)]);
    let found = folder.join("found");
    fs::create_dir_all(&found).expect("a writable folder");
    let (mut ids, mut boxes) = (Vec::new(), Vec::new());
    for (i, entry) in Manifest::read(&data).expect("it was made").episodes.iter().enumerate() {
        for (j, detections) in predict(&data, entry, i % 2 == 0, &found).into_iter().enumerate() {
            ids.push(format!("{}/{j}", entry.name));
            boxes.push(detections);
        }
    }
    let pairs = ids.iter().map(String::as_str).zip(boxes.iter().map(Vec::as_slice));
    json::write_predictions(&found.join("predictions.json"), pairs).expect("a writable folder");
    data
}

/// Writes the boxes of an episode, and returns them.
fn predict(data: &Path, entry: &EpisodeEntry, is_faulty: bool, to: &Path) -> Vec<Vec<Detection>> {
    let reader = EpisodeReader::open_entry(data, entry).expect("it was made");
    let labels = data.join("labels/rect").join(format!("{}.mcap", entry.name));
    let labels = LabelReader::open(&labels).expect("it was labelled");
    let meta = SourceMeta {
        episode: entry.name.clone(),
        episode_sha256: entry.sha256.clone(),
        set: "made".into(),
        config_toml: String::new(),
        generator_version: String::new(),
    };
    let mut writer =
        DetectionWriter::create(&to.join(format!("{}.mcap", entry.name)), &meta).expect("writable");
    let mut all = Vec::new();
    for (sample, labels) in reader.samples().zip(labels.samples()) {
        let sample = sample.expect("it was made");
        let detection = |box_in_ego, harm| Detection {
            box_in_ego,
            velocity_in_ego_mps: [0.0; 2],
            harm,
            score: 0.75,
            spread: None,
        };
        let mut detections = Vec::new();
        for (object, label) in sample.objects().iter().zip(&labels.labels) {
            let is_first = detections.iter().all(|of: &Detection| of.harm == Harm::Harmless);
            let is_missed = is_faulty && is_first && label.harm == Harm::Harmful;
            detections
                .push(detection(object.box_in_ego, if is_missed { Harm::Harmless } else { label.harm }));
        }
        if let (true, Some(object)) = (is_faulty, sample.objects().first()) {
            let mut nowhere = object.box_in_ego;
            nowhere.center = Point::new(18.0, 14.0, 0.8);
            detections.push(detection(nowhere, Harm::Harmful));
        }
        let time_ns = sample.measured.time_ns;
        writer.write(&SampleDetections { time_ns, detections: detections.clone() }).expect("valid boxes");
        all.push(detections);
    }
    writer.finish().expect("a writable folder");
    all
}

/// Scores of the small data set in `scores`, and `report.html`.
pub fn scores_and_report(folder: &Path) {
    let (found, data) = (folder.join("found/predictions.json"), folder.join("small"));
    let (scores, page) = (folder.join("scores"), folder.join("report.html"));
    done(&["eval", "--predictions", text(&found), "--data", text(&data), "--ood", "--out", text(&scores)]);
    done(&["report", text(&page), "--ood", text(&scores)]);
}

/// Cuts a file in half, and leaves its other names alone.
pub fn tear(file: &Path) {
    let bytes = fs::read(file).expect("it was made");
    fs::remove_file(file).expect("a writable folder");
    fs::write(file, &bytes[..bytes.len() / 2]).expect("a writable folder");
}

/// Makes `big` of `n` episodes and `found-big` with boxes for it, of the files of the small data set.
pub fn big(folder: &Path, n: usize) -> PathBuf {
    let (small, big) = (folder.join("small"), folder.join("big"));
    let (found, found_big) = (folder.join("found"), folder.join("found-big"));
    let mut manifest = Manifest::read(&small).expect("it was made");
    let mut labels = LabelManifest::read(&small, "rect").expect("it was labelled");
    let labels_big = LabelManifest::folder(&big, "rect");
    for path in [&big.join("episodes"), &labels_big, &found_big] {
        fs::create_dir_all(path).expect("a writable folder");
    }
    fs::write(found_big.join("predictions.json"), b"{}").expect("a writable folder");
    let (sources, label_sources) = (manifest.episodes.clone(), labels.episodes.clone());
    (manifest.episodes, labels.episodes) = (Vec::new(), Vec::new());
    for i in 0..n {
        let (source, label) = (&sources[i % sources.len()], &label_sources[i % sources.len()]);
        // The first ones keep their names, by which the boxes are known to be of this data set.
        let name = if i < sources.len() { source.name.clone() } else { format!("episode-{i:04}") };
        let file = format!("{name}.mcap");
        let link = |from: PathBuf, to: PathBuf| fs::hard_link(from, to).expect("one disk");
        link(small.join(&source.file), big.join("episodes").join(&file));
        link(LabelManifest::folder(&small, "rect").join(&label.file), labels_big.join(&file));
        link(found.join(format!("{}.mcap", source.name)), found_big.join(&file));
        labels.episodes.push(LabelEntry { name: name.clone(), file: file.clone(), ..label.clone() });
        manifest.episodes.push(EpisodeEntry {
            file: format!("episodes/{file}"),
            split: Split::ALL[i % 3],
            town: TOWNS[i % TOWNS.len()].into(),
            weather: WEATHERS[i % WEATHERS.len()].into(),
            name,
            ..source.clone()
        });
    }
    manifest.write(&big).expect("a writable folder");
    labels.write(&big).expect("a writable folder");
    big
}
