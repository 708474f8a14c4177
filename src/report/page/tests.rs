//! The page of made-up scores: everything is reported, no value becomes markup, and nothing is fetched.

use std::path::Path;

use fs_err as fs;

use super::*;
use crate::dataset::{Fingerprint, SampleFacts};
use crate::episode::{LabelManifest, Manifest};
use crate::eval::{EvalSample, Protocol, evaluate};
use crate::geometry::{Box3, Point};
use crate::object::{Detection, Distribution, Harm, Kind, LabelledObject, Object};
use crate::outcome::test_data::{drives, summary};
use crate::report::provenance::Provenance;
use crate::report::scores::{FAULTS_FILE, METRICS_FILE, PROVENANCE_FILE, SWEEPS_FILE};

/// A name that breaks out of every place where text is not escaped.
const HOSTILE: &str = "</script><img src=x onerror=alert(1)>\"'&";

fn place(x_m: f64, y_m: f64) -> Box3<crate::geometry::Ego> {
    Box3 { center: Point::new(x_m, y_m, 0.8), length_m: 4.0, width_m: 2.0, height_m: 1.6, yaw_rad: 0.1 }
}

/// Three episodes of four samples: of four objects each, one harmful is missed and one harmless called harmful.
fn samples() -> Vec<EvalSample> {
    let mut samples = Vec::new();
    for (episode, weather) in [("one", "ClearNoon"), ("two", HOSTILE), ("three", "FogNight")] {
        for i in 0..4_u32 {
            let x_m = 24.0 - 3.0 * f64::from(i);
            let object = |name: &str, at: (f64, f64), harm, distribution| LabelledObject {
                truth: Object {
                    id: Some(name.to_owned()),
                    category: Some(name.to_owned()),
                    kind: Some(Kind::Static),
                    distribution: Some(distribution),
                    n_lidar_points: Some(20 + i),
                    visible_fraction: Some(0.75),
                    ..Object::new(place(at.0, at.1))
                },
                harm,
            };
            let detection = |at: (f64, f64), harm, score| Detection {
                box_in_ego: place(at.0, at.1),
                velocity_in_ego_mps: [0.0; 2],
                harm,
                score,
                spread: None,
            };
            let score = 0.5 + 0.1 * f64::from(i);
            samples.push(EvalSample {
                id: format!("{episode}/{i}"),
                facts: SampleFacts {
                    episode: Some(episode.into()),
                    time_s: Some(0.3 * f64::from(i)),
                    town: Some("oldtown".into()),
                    weather: Some(weather.into()),
                    mor_m: Some(if weather == "FogNight" { 80.0 } else { 20_000.0 }),
                    rain_rate_mmph: Some(f64::from(u8::from(weather == HOSTILE))),
                    speed_mps: Some(8.0),
                    steering_angle_rad: Some(0.02),
                    position_in_world_m: Some([3.0 * f64::from(i), 0.0]),
                    front_bumper_x_m: Some(3.6),
                    zone_in_ego_m: Some(vec![[3.6, -1.7], [25.0, -1.7], [25.0, 1.7], [3.6, 1.7]]),
                    ..SampleFacts::default()
                },
                objects: vec![
                    object("car", (x_m, 0.0), Harm::Harmful, Distribution::Id),
                    object(HOSTILE, (x_m - 8.0, 0.5), Harm::Harmful, Distribution::Ood),
                    object("hay_bale", (x_m, 6.0), Harm::Harmless, Distribution::Ood),
                    object("pole", (x_m, -9.0), Harm::Harmless, Distribution::Id),
                ],
                detections: vec![
                    detection((x_m + 0.3, 0.1), Harm::Harmful, score),
                    detection((x_m, 6.2), Harm::Harmful, score - 0.1),
                    detection((x_m, -9.0), Harm::Harmless, score),
                    detection((x_m + 0.4, 0.0), Harm::Harmless, 0.3),
                ],
                n_points: vec![],
            });
        }
    }
    samples
}

/// `sweeps.json` of steering, judged by the network and by the zone.
fn sweeps() -> serde_json::Value {
    let curve = |judge: &str| {
        let point = |value: f64| {
            serde_json::json!({
                "value": value, "scores": {"total": {"harmful": 0.5, "harmless": 0.8, "mean": 0.65}, "id_matched": null,
                    "ood_all": null, "ood_matched": null},
                "n_truths": 50, "n_located": 40, "n_harmful": 4, "n_called_harmful": 5, "n_both": 4,
                "set_iou": if value == 0.0 { None } else { Some(0.8) }, "agreement": 0.9,
            })
        };
        let points = [-35.0, 0.0, 35.0].map(point);
        serde_json::json!({"change": "steering_deg", "judge": judge, "truth_moves": true, "points": points})
    };
    serde_json::json!({"n_samples": 12, "curves": [curve("network"), curve("zone-soft")], "early": null})
}

/// Writes a folder of scores, with all that may be there or with the metrics alone.
fn write_scores(folder: &Path, mode: Mode, is_whole: bool) {
    let protocol = Protocol::default();
    fs::create_dir_all(folder).unwrap();
    let evaluation = evaluate(&samples(), &protocol, mode).unwrap();
    fs::write(folder.join(METRICS_FILE), evaluation.to_json()).unwrap();
    if is_whole {
        let json = |value: serde_json::Value| value.to_string();
        fs::write(folder.join(FAULTS_FILE), json(serde_json::to_value(&evaluation.faults).unwrap())).unwrap();
        let hash = |c: &str| c.repeat(16);
        let fingerprint = Fingerprint { dataset_sha256: hash("0123"), labels_sha256: hash("4567") };
        let source = Provenance {
            command: format!("harmzone eval {HOSTILE}"),
            fingerprint: Some(fingerprint),
            checkpoint_sha256: Some(hash("89ab")),
            ..Provenance::default()
        };
        fs::write(folder.join(PROVENANCE_FILE), json(serde_json::to_value(source).unwrap())).unwrap();
        fs::write(folder.join(SWEEPS_FILE), json(sweeps())).unwrap();
        let picture = image::RgbImage::from_pixel(64, 32, image::Rgb([90, 120, 60]));
        fs::create_dir_all(folder.join("kinds")).unwrap();
        for name in ["frame_speed.png", "kinds/hay_bale.png"] {
            picture.save(folder.join(name)).unwrap();
        }
    }
}

struct Made {
    folder: tempfile::TempDir,
    request: ReportRequest,
}

impl Made {
    fn new(is_whole: bool) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        write_scores(&path("id"), Mode::Id, is_whole);
        write_scores(&path("ood"), Mode::Ood, is_whole);
        let scores = |name| Some(ScoresRequest { folder: path(name), data: None });
        let request = ReportRequest {
            out: path("page/report.html"),
            id: scores("id"),
            ood: scores("ood"),
            results: None,
            drives: None,
            n_cards: 12,
            command: "harmzone report".into(),
            force: false,
        };
        Self { folder, request }
    }

    fn html(&self) -> (ReportSummary, String) {
        let summary = run(&ReportRequest { force: true, ..self.request.clone() }).unwrap();
        let html = fs::read_to_string(&summary.out).unwrap();
        assert_eq!(html.len(), summary.bytes);
        (summary, html)
    }
}

#[test]
fn the_page_tells_all_that_the_scores_hold_beside_the_paper() {
    let made = Made::new(true);
    let (summary, html) = made.html();
    // For each side: one object per kind and episode, three episodes.
    assert_eq!(summary.n_cards, 2 * 3 * 2);
    for part in [
        "paper 0.812", // ID mAP, mean
        "paper 0.345", // OOD, all FPs, harmless
        "12 samples in distribution, 12 samples out of distribution",
        "missed, of events",
        "AUROC",
        "ECE",
        "Family, out of distribution",
        "hay bale",
        "Recall in haze and fog",
        "Steering set to: agreement of the harmful sets",
        "One frame at several states, in pictures",
        "Each kind out of distribution, in pictures",
        "dataset.json  0123",
        "zone over its boxes, soft",
        "room to stop",
        "data-kind=\"missed: not seen\"",
        "data-kind=\"false alarm: harmless object\"",
    ] {
        assert!(html.contains(part), "{part}");
    }
    let evaluation = evaluate(&samples(), &Protocol::default(), Mode::Ood).unwrap();
    let ours = format!("{:.3}<small>", evaluation.metrics.columns.total.harmful.unwrap());
    assert!(html.contains(&ours), "{ours}");
}

#[test]
fn text_of_files_never_becomes_markup() {
    let made = Made::new(true);
    let results = made.folder.path().join("results.json");
    let mut told = results::test_data::test_results();
    told.tables[0].title = HOSTILE.to_owned();
    fs::write(&results, told.to_json()).unwrap();
    let request = ReportRequest { results: Some(results), ..made.request.clone() };
    let html = fs::read_to_string(run(&request).unwrap().out).unwrap();
    assert!(!html.contains("<img src=x"), "markup of a name");
    assert_eq!(html.matches("<script>").count(), 1);
    assert!(html.contains("&lt;img src=x onerror=alert(1)&gt;"), "the name itself is there");
}

#[test]
fn nothing_is_fetched_from_anywhere() {
    let (_, html) = Made::new(true).html();
    let html = html.to_lowercase();
    for word in ["http:", "https:", "src=\"//", "url(", "@import", "<iframe", "<link rel=\"stylesheet"] {
        assert!(!html.contains(word), "{word}");
    }
    for (at, _) in html.match_indices(" src=\"") {
        assert!(html[at + 6..].starts_with("data:"), "{}", &html[at..at + 60]);
    }
    assert!(html.contains("content-security-policy") && html.contains("default-src 'none'"));
}

#[test]
fn the_same_scores_give_the_same_bytes_and_no_page_is_lost() {
    let made = Made::new(true);
    let (summary, first) = made.html();
    assert_eq!(made.html().1, first);
    let message = run(&made.request).unwrap_err().to_string();
    assert!(message.contains("--force") && message.contains("report.html"), "{message}");
    assert_eq!(fs::read_to_string(summary.out).unwrap(), first);
}

#[test]
fn what_is_absent_is_left_out_with_the_command_that_makes_it() {
    let mut made = Made::new(false);
    made.request.id = None;
    let (summary, html) = made.html();
    assert!(summary.n_cards == 0 && !summary.is_whole, "without faults there are no pictures");
    let told = summary.absent.join("\n");
    for (part, command) in
        [("sweeps", "harmzone sweep"), ("results.json", "--results"), ("faults", "harmzone eval")]
    {
        let line = summary.absent.iter().find(|line| line.contains(part));
        assert!(line.is_some_and(|line| line.contains(command)), "{part}: {told}");
    }
    assert!(html.contains("class=\"absent\"") && !html.contains("id=\"controls\""));
    assert!(!html.contains("In distribution</h3>"), "one side alone");
}

#[test]
fn scores_of_the_other_kind_and_missing_data_are_refused() {
    let made = Made::new(true);
    let swapped = ReportRequest { id: made.request.ood.clone(), ..made.request.clone() };
    let message = run(&swapped).unwrap_err().to_string();
    assert!(message.contains("--id needs") && message.contains("--ood"), "{message}");
    let mut elsewhere = made.request.clone();
    elsewhere.id.as_mut().unwrap().data = Some(made.folder.path().join("nowhere"));
    assert!(run(&elsewhere).unwrap_err().to_string().contains("nowhere"));
}

#[test]
fn old_faults_are_not_drawn_over_another_data_set_or_without_its_labels() {
    let mut made = Made::new(true);
    made.request.id = None;
    let data = made.folder.path().join("data");
    // Without an episode: what is wrong is told before a sample is read.
    let write = |seed: u64| {
        fs::create_dir_all(LabelManifest::folder(&data, "rect")).unwrap();
        let manifest = Manifest::new("c0ffee".into(), seed, true);
        manifest.write(&data).unwrap();
        LabelManifest::new("rect", String::new(), &manifest).write(&data).unwrap();
    };
    write(1);
    let source = Provenance {
        data: Some(data.clone()),
        fingerprint: Some(Fingerprint::of(&data, "rect").unwrap()),
        ..Provenance::default()
    };
    let file = made.request.ood.as_ref().unwrap().folder.join(PROVENANCE_FILE);
    fs::write(file, serde_json::to_string(&source).unwrap()).unwrap();
    let check = |made: &Made, what: &str, command: &str| {
        let (summary, html) = made.html();
        let is_told = |line: &String| line.contains(what) && line.contains(command);
        assert!(summary.absent.iter().any(is_told) && html.contains(what), "{what}: {:?}", summary.absent);
        assert!(summary.n_cards == 6 && !summary.is_whole, "the faults are told all the same");
    };
    check(&made, "no pictures of 6 of 6 faults", "--ood-data DIR");
    write(2);
    let changed = "no pictures, since the data set or its labels are not those that were scored";
    check(&made, changed, "harmzone eval");
    fs::remove_dir_all(data.join("labels")).unwrap();
    check(&made, "no pictures, since the labels that were scored are not there", "harmzone label");
    made.request.ood.as_mut().unwrap().data = Some(data.clone());
    check(&made, "no pictures of 6 of 6 faults", "--ood-data DIR");
    write(2);
    check(&made, changed, "harmzone eval");
}

#[test]
fn the_style_sheet_knows_every_tone_of_the_charts() {
    use crate::report::chart::Tone::{Amber, Green, Grid, Harmful, Harmless, Ink, Soft};
    let style = include_str!("report.css");
    for tone in [Ink, Soft, Grid, Harmful, Harmless, Green, Amber] {
        let color = tone.rgb();
        let written = format!("#{:02X}{:02X}{:02X}", color.0, color.1, color.2);
        for attribute in ["fill", "stroke"] {
            assert!(style.contains(&format!("[{attribute}=\"{written}\"]")), "{tone:?} {attribute}");
        }
    }
}

#[test]
fn drives_are_compared_beside_the_scores_that_foretell_them_or_alone() {
    let mut made = Made::new(true);
    let metrics = made.request.ood.as_ref().unwrap().folder.join(METRICS_FILE);
    let mut of_scores: serde_json::Value =
        serde_json::from_str(&fs::read_to_string(&metrics).unwrap()).unwrap();
    let points = of_scores["safety"]["alarms"]["points"].as_array_mut().unwrap();
    points.truncate(2);
    let scores = [0.8, 0.4];
    for (point, score) in points.iter_mut().zip(scores) {
        point["score"] = score.into();
    }
    fs::write(&metrics, of_scores.to_string()).unwrap();
    let (hit, small) = (Some(6.0), |score: f64| format!("small@{score}"));
    let mut of = vec![
        drives("blind", [hit, hit, hit, None]),
        drives("truth", [None; 4]),
        drives(&small(scores[0]), [hit, None, None, None]),
        drives(&small(scores[1]), [hit, hit, None, None]),
        // Another judge's scores are others, though the network is the same.
        drives("zone:small@0.5", [hit, None, None, None]),
    ];
    of[0].1[0].weather = HOSTILE.into();
    let folder = made.folder.path().join("drives");
    fs::create_dir_all(&folder).unwrap();
    let summary = summary(&of, &"89ab".repeat(16));
    fs::write(folder.join(DriveSummary::FILE), serde_json::to_string(&summary).unwrap()).unwrap();
    made.request.drives = Some(folder);
    let (told, html) = made.html();
    for part in [
        "Closed loop",
        "20 drives of 5 drivers",
        "What the scores out of distribution say of it",
        "Collisions and missed events",
        "2 drivers: too few",
        "0.67 (",
        "Development figures, on dev",
    ] {
        assert!(html.contains(part), "{part}");
    }
    assert!(told.absent.iter().any(|absent| absent.contains("not recorded")), "{:?}", told.absent);
    assert!(!html.contains(HOSTILE));
    // A network of another hash is not the one that was scored; and drives alone make a page, too.
    made.request.ood = None;
    made.request.id = None;
    let (told, html) = made.html();
    assert!(html.contains("Closed loop") && !html.contains("say of it") && !html.contains("Calibration"));
    assert!(told.is_whole);
}
