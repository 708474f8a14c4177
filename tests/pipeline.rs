//! End to end on tiny real data: gen -> label -> train -> predict -> eval -> view, and rivals, sweeps and zones. Needs
//! what `make setup` makes.

mod made_data;

use std::path::Path;
use std::process::Command;

use fs_err as fs;
use made_data::{Fixture, KINDS, TINY, copy, done, fails, fixture, generate, harmzone, text};
use serde_json::{Value, json};

fn metrics_in(scores: &Path) -> Value {
    let text = fs::read(scores.join("metrics.json")).expect("metrics are written");
    serde_json::from_slice(&text).expect("JSON")
}

fn assert_near(metrics: &Value, column: &str, expected: f64, tolerance: f64) {
    let mean = metrics[column]["mean"].as_f64().expect("a number");
    assert!((mean - expected).abs() <= tolerance, "{column}: {mean}, not {expected} within {tolerance}");
}

#[test]
fn a_trained_run_is_scored_drawn_and_predicts_files() {
    let Fixture { id, ood, run, .. } = fixture();
    let table = done(&["eval", text(run), "--data", text(id)]);
    assert!(table.contains("harmful") && table.contains("paper 0.795"), "{table}");
    let scores = tempfile::tempdir().expect("a temporary folder");
    let out = scores.path().join("ood");
    let message = fails(&["eval", text(run), "--data", text(id), "--split", "train"]);
    assert!(message.contains("learned from") && message.contains("--on-training-data"), "{message}");
    let own = done(&["eval", text(run), "--data", text(id), "--split", "train", "--on-training-data"]);
    assert!(own.starts_with("Development figures, on train"), "{own}");
    done(&["eval", text(run), "--data", text(ood), "--ood", "--out", text(&out)]);
    let metrics = metrics_in(&out);
    // Each of the 16 queries gives a box of each class.
    let counts = &metrics["counts"];
    assert_eq!(
        (&counts["truths"]["harmless"]["all"], &counts["n_samples"]),
        (&14.into(), &3.into()),
        "{counts}"
    );
    assert_eq!(counts["detections"], json!({ "harmful": 48, "harmless": 48 }));
    // Five steps make no boxes worth a score, but they learn where something is: each stage's last step has less loss there than its first.
    let log = fs::read_to_string(run.join("log.csv")).expect("a log");
    let heatmap_of = |stage: &str| -> Vec<f64> {
        let rows = log.lines().filter(|row| row.split(',').nth(1) == Some(stage));
        rows.map(|row| row.split(',').nth(4).and_then(|of| of.parse().ok()).expect("a loss")).collect()
    };
    for (stage, n_steps) in [("lidar", 3), ("fused", 2)] {
        let heatmap = heatmap_of(stage);
        assert!(heatmap.len() == n_steps && heatmap[n_steps - 1] < 0.9 * heatmap[0], "{stage}: {heatmap:?}");
    }

    let predictions = scores.path().join("predictions");
    done(&["predict", text(run), "--data", text(id), "--out", text(&predictions)]);
    assert!(predictions.join("predictions.json").exists());
    let n_files = fs::read_dir(&predictions).expect("a folder").count();
    assert_eq!(n_files, 2, "one MCAP for the one validation episode, and the JSON");

    let picture = scores.path().join("sample.png");
    done(&["view", text(id), "--sample", "3", "--predictions", text(&predictions), "--out", text(&picture)]);
    let drawn = image::open(&picture).expect("a PNG");
    assert!(drawn.width() > 1000 && drawn.height() > 400);
}

#[test]
fn the_score_that_calibrate_chooses_is_kept_with_the_network_and_used() {
    let Fixture { id, ood: nearly_standing, run, .. } = fixture();
    let folder = tempfile::tempdir().expect("a temporary folder");
    let ood = &folder.path().join("drive");
    generate(ood, "1", &["--episodes", "1", "--ood", "--set", "sample_period_s=1.5"]);
    done(&["label", text(ood)]);
    let checkpoint = folder.path().join("model.safetensors");
    fs::copy(run.join("model.safetensors"), &checkpoint).expect("a file");
    let operating_score = |more: &[&str]| {
        let scored = done(&[&["eval", text(&checkpoint), "--data", text(ood), "--json"], more].concat());
        let metrics: Value = serde_json::from_str(&scored).expect("JSON");
        metrics["config"]["operating_score"].as_f64().expect("a number")
    };
    assert_eq!(operating_score(&[]), 0.2, "the default, where none was chosen");
    let before =
        done(&["predict", text(&checkpoint), "--data", text(ood), "--out", text(&folder.path().join("a"))]);
    // Five epochs of three samples are no network to warn by: nearly all is allowed.
    let told =
        done(&["calibrate", text(&checkpoint), "--data", text(ood), "--false-alarms-per-km", "1000000"]);
    assert!(told.starts_with("warns from a score of 0.") && told.contains("alarms a kilometre"), "{told}");
    assert!(told.contains("\nbrakes from a score of 0."), "{told}");
    let chosen = operating_score(&[]);
    assert!(chosen != 0.2 && told.contains(&format!("{chosen:.3}")), "{chosen}: {told}");
    assert_eq!(operating_score(&["--set", "operating_score=0.7"]), 0.7);
    let after =
        done(&["predict", text(&checkpoint), "--data", text(ood), "--out", text(&folder.path().join("b"))]);
    assert_eq!(before.split(':').next(), after.split(':').next(), "the same boxes");
    let boxes = |of: &str| fs::read(folder.path().join(of).join("predictions.json")).expect("boxes");
    assert!(boxes("a") == boxes("b"));

    let again = harmzone(&["eval", text(&checkpoint), "--data", text(ood)]);
    let told = String::from_utf8_lossy(&again.stderr).into_owned();
    assert!(again.status.success() && told.contains("were made by 1 of the 1 episodes"), "{told}");
    let sweeps = folder.path().join("sweeps");
    done(&["sweep", text(&checkpoint), "--data", text(ood), "--out", text(&sweeps)]);
    let resolved: toml::Table =
        fs::read_to_string(sweeps.join("sweep.toml")).expect("a config").parse().expect("TOML");
    let drawn_from = resolved["picture_min_score"].as_float().expect("a number");
    assert!((drawn_from - chosen).abs() < 1e-6, "{drawn_from}, not {chosen}");

    let refused = |run: &Path, more: &[&str]| fails(&[&["calibrate", text(run)], more].concat());
    let message = refused(&checkpoint, &["--data", text(id), "--split", "train"]);
    assert!(message.contains("learned from"), "{message}");
    let message = refused(Path::new("small"), &["--data", text(id)]);
    assert!(message.contains("inside the program") && message.contains("run's folder"), "{message}");
    let message = refused(&checkpoint, &["--data", text(ood), "--false-alarms-per-km", "0.001"]);
    assert!(message.contains("no score spends as few"), "{message}");
    let message = refused(&checkpoint, &["--data", text(nearly_standing)]);
    assert!(message.contains("the car drives 0.") && message.contains("from 1 m on"), "{message}");
    let message = refused(&checkpoint, &["--data", text(ood), "--braking-false-alarms-per-km", "11"]);
    assert!(message.contains("11 is more than --false-alarms-per-km 10"), "{message}");
    assert_eq!(operating_score(&[]), chosen, "what was there stays");
}

/// Over the tiny config: LiDAR alone, undisturbed, for as long as it takes to know three samples by heart (4 s).
const BY_HEART: [&str; 12] = [
    "model.use_camera=false",
    "model.head.n_queries=40",
    "lidar_stage.epochs=120",
    "fused_stage.epochs=0",
    "validate_every_epochs=0",
    "save_every_steps=100",
    "average_decay=0.5",
    "augment.disturbed_share=0.0",
    "augment.thinned_share=0.0",
    "augment.fogged_share=0.0",
    "augment.no_cloud_share=0.0",
    "augment.no_picture_share=0.0",
];

#[test]
fn training_learns_its_samples_by_heart() {
    let Fixture { id, run, .. } = fixture();
    let folder = tempfile::tempdir().expect("a temporary folder");
    let long = folder.path().join("long");
    let set: Vec<&str> = BY_HEART.iter().flat_map(|key| ["--set", key]).collect();
    done(&[&["train", text(id), "--out", text(&long)], TINY.as_slice(), &set].concat());
    let own_score = |run: &Path, name: &str| {
        let out = folder.path().join(name);
        let own = ["--split", "train", "--on-training-data", "--out", text(&out)];
        done(&[&["eval", text(run), "--data", text(id)], own.as_slice()].concat());
        metrics_in(&out)["total"]["mean"].as_f64().expect("a number")
    };
    // 0.91, against 0.12 after the fixture's five epochs.
    let (much, little) = (own_score(&long, "much"), own_score(run, "little"));
    assert!(much > 0.7 && little < 0.3, "{much} {little}");

    // Heatmap and harm, from 2.6 to 0.2 and less; the boxes' loss, a likelihood, may be negative.
    let log = fs::read_to_string(long.join("log.csv")).expect("a log");
    let loss = |row: &str| -> f64 {
        let parts = row.split(',').skip(4).take(2);
        parts.map(|part| part.parse::<f64>().expect("a number")).sum()
    };
    let rows: Vec<&str> = log.lines().skip(1).collect();
    let (first, last) = (loss(rows[0]), loss(rows[rows.len() - 1]));
    assert!(last < first / 4.0, "{first} {last}");
}

#[test]
fn a_rival_is_a_file_of_boxes_that_eval_scores() {
    let Fixture { ood, run, .. } = fixture();
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("zone");
    let args = ["baseline", "zone", text(run), "--data", text(ood), "--out", text(&out)];
    let told = done(&args);
    assert!(told.contains("boxes for 3 samples"), "{told}");
    let message = fails(&args);
    assert!(message.contains("--force") && message.contains("zone"), "{message}");
    let boxes = out.join("predictions.json");
    let table = done(&["eval", "--predictions", text(&boxes), "--data", text(ood), "--ood"]);
    assert!(table.contains("mAP_OOD"), "{table}");
    // Beside the network's own boxes unless told otherwise, with its own name.
    done(&["baseline", "zone-soft", text(run), "--data", text(ood)]);
    assert!(run.join("predictions/ood-zone-soft/predictions.json").is_file());
    let message = fails(&["baseline", "oracle", text(run), "--data", text(ood)]);
    assert!(message.contains("oracle") && message.contains("speed-zone-soft"), "{message}");
}

#[test]
fn a_closed_set_is_trained_on_kinds_and_its_harm_is_a_file_of_boxes() {
    let Fixture { id, ood, run, .. } = fixture();
    let folder = tempfile::tempdir().expect("a temporary folder");
    let kinds = folder.path().join("kinds");
    let set: Vec<&str> = KINDS.iter().flat_map(|key| ["--set", key]).collect();
    let train = ["train", text(id), "--out", text(&kinds)];
    let message = fails(&[&train, TINY.as_slice(), &set[..4]].concat());
    assert!(message.contains("validate_every_epochs"), "{message}");
    done(&[&train, TINY.as_slice(), &set[..]].concat());
    let out = folder.path().join("closed");
    let closed = ["baseline", "closed-mahalanobis", text(&kinds), "--data", text(ood), "--out", text(&out)];
    let message = fails(&closed);
    assert!(message.contains("--fit"), "{message}");
    done(&[&closed, ["--fit", text(id)].as_slice()].concat());
    let boxes = out.join("predictions.json");
    let table = done(&["eval", "--predictions", text(&boxes), "--data", text(ood), "--ood"]);
    assert!(table.contains("mAP_OOD"), "{table}");

    // A rule that judges boxes alone takes its boxes, too; one that asks the network for harm does not.
    let zoned = folder.path().join("zoned");
    done(&["baseline", "zone-expected", text(&kinds), "--data", text(ood), "--out", text(&zoned)]);
    let boxes = zoned.join("predictions.json");
    let (rule, file) = (format!("zone-expected:{}", text(&kinds)), text(&boxes).to_owned());
    let versus = ["versus", rule.as_str(), file.as_str(), "--data", text(ood), "--ood", "--json"];
    let json: Value = serde_json::from_str(&done(&versus)).expect("JSON");
    let total = &json["of"]["mean"][0]["figures"];
    assert_eq!((&total[1]["over_first"], total[0]["value"].is_number()), (&0.0.into(), true), "{total}");
    let [one, other] = [rule.as_str(), text(run)].map(|of| format!("two={of}"));
    let names = ["versus", one.as_str(), "truth", other.as_str(), "--data", text(ood), "--ood", "--json"];
    let json: Value = serde_json::from_str(&done(&names)).expect("JSON");
    let total = &json["of"]["mean"][0]["figures"];
    assert_eq!(json["columns"], serde_json::json!(["two", "truth"]));
    assert_eq!(
        (total[0]["runs"].as_array().map(Vec::len), &total[1]["runs"]),
        (Some(2), &Value::Null),
        "{total}"
    );
    let twice = fails(&["versus", &one, "truth", &one, "--data", text(ood)]);
    assert!(twice.contains("one run twice"), "{twice}");
    let message = fails(&["versus", &format!("both:{}", text(&kinds)), "truth", "--data", text(ood)]);
    assert!(message.contains("tells kinds") && message.contains("baseline zone"), "{message}");

    // Neither network is taken for the other.
    let message = fails(&["eval", text(&kinds), "--data", text(ood)]);
    assert!(message.contains("tells kinds") && message.contains("closed-msp"), "{message}");
    let wrong = [
        "baseline",
        "closed-msp",
        text(run),
        "--data",
        text(ood),
        "--fit",
        text(id),
        "--out",
        text(&out),
        "--force",
    ];
    let message = fails(&wrong);
    assert!(message.contains("model.head.classes=kind"), "{message}");
}

#[test]
fn a_sweep_is_a_folder_of_figures_and_pictures() {
    let Fixture { ood, run, .. } = fixture();
    let folder = tempfile::tempdir().expect("a temporary folder");
    let sweep = |out: &Path, more: &[&str]| -> Vec<String> {
        let few = ["speed_mps=[0.0, 14.0]", "steering_deg=[-35.0, 35.0]", "speed_factor=[0.9, 1.1]"];
        let set = few.iter().chain(more).flat_map(|key| ["--set", key]);
        ["sweep", text(run), "--data", text(ood), "--out", text(out)]
            .into_iter()
            .chain(set)
            .map(str::to_owned)
            .collect()
    };
    let call = |args: &[String]| done(&args.iter().map(String::as_str).collect::<Vec<_>>());
    let out = folder.path().join("sweep");
    let table = call(&sweep(&out, &[]));
    assert!(table.contains("network") && table.contains("speed-zone-soft"), "{table}");
    let plots = ["speed", "steering", "sensor_errors", "early"]
        .map(|name| [format!("{name}.svg"), format!("{name}.png")]);
    let others = ["sweeps.csv", "sweep.toml", "frame_speed.png", "frame_steering.png"].map(str::to_owned);
    for name in plots.as_flattened().iter().chain(&others) {
        assert!(out.join(name).is_file(), "{name}");
    }
    let n_kinds = fs::read_dir(out.join("kinds")).expect("pictures of kinds").count();
    assert!(n_kinds > 0, "the dataset holds objects out of distribution");
    let text_of = |out: &Path| fs::read_to_string(out.join("sweeps.json")).expect("figures");
    let sweeps: Value = serde_json::from_str(&text_of(&out)).expect("JSON");
    let curves = sweeps["curves"].as_array().expect("curves");
    // Four changes, seven judges.
    assert_eq!((curves.len(), &sweeps["n_samples"]), (4 * 7, &3.into()));
    let harmful = |i: usize| curves[0]["points"][i]["n_harmful"].as_u64().expect("a count");
    assert!(curves[0]["change"] == "speed_mps" && harmful(0) <= harmful(1), "{}", curves[0]);

    // The same again, byte for byte, but never by accident.
    let other = folder.path().join("other");
    call(&sweep(&other, &[]));
    assert!(text_of(&out) == text_of(&other));
    let again = sweep(&out, &[]);
    let message = fails(&again.iter().map(String::as_str).collect::<Vec<_>>());
    assert!(message.contains("--force"), "{message}");
    let wrong = sweep(&folder.path().join("wrong"), &["speeds=[1.0]"]);
    let message = fails(&wrong.iter().map(String::as_str).collect::<Vec<_>>());
    assert!(message.contains("speeds") && message.contains("speed_mps"), "{message}");
}

#[test]
fn the_network_inside_the_program_predicts_is_scored_and_drawn_by_its_name() {
    let (_folder, id) = copy();
    // Its scores on these six samples, within what one box more or less at another rank makes.
    let scores = id.join("scores");
    let table = done(&["eval", "small", "--data", text(&id), "--out", text(&scores)]);
    assert!(table.contains("paper 0.795"), "{table}");
    assert_near(&metrics_in(&scores), "total", 0.951, 0.05);
    let table =
        done(&["eval", "small", "--data", text(&fixture().ood), "--ood", "--out", text(&scores), "--force"]);
    assert!(table.contains("mAP_OOD"), "{table}");
    for (column, mean) in
        [("total", 0.989), ("id_matched", 0.997), ("ood_all", 0.989), ("ood_matched", 1.000)]
    {
        assert_near(&metrics_in(&scores), column, mean, 0.12);
    }
    let told = done(&["predict", "small", "--data", text(&id)]);
    let n_boxes: usize = told.split(' ').next().and_then(|n| n.parse().ok()).expect("a count of boxes");
    let predictions = id.join("predictions/small");
    assert!(n_boxes > 0 && predictions.join("predictions.json").is_file(), "{told}");
    let picture = id.join("sample.png");
    done(&["view", text(&id), "--sample", "3", "--predictions", "small", "--out", text(&picture)]);
    // The weights went through the same code as a checkpoint of one's own.
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/models/small.safetensors");
    let out = id.join("of-file");
    done(&["predict", file, "--data", text(&id), "--out", text(&out)]);
    let boxes = |folder: &Path| fs::read(folder.join("predictions.json")).expect("predictions");
    assert!(boxes(&predictions) == boxes(&out));

    let message = fails(&["eval", "tiny", "--data", text(&id)]);
    assert!(message.contains("`small`") && message.contains("harmzone train"), "{message}");
    let message = fails(&["eval", "./small", "--data", text(&id)]);
    assert!(message.contains("no finished checkpoint") && message.contains("./small"), "{message}");
}

#[test]
fn info_counts_what_an_outside_reader_counts() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let python = root.join(".venv-test/bin/python");
    assert!(python.is_file(), "no {}: run `make setup-test` first", python.display());
    let folder = tempfile::tempdir().expect("a temporary folder");
    for dataset in [&fixture().id, &fixture().ood] {
        let told = folder.path().join("info.json");
        fs::write(&told, done(&["info", text(dataset), "--json"])).expect("a writable folder");
        let checked = Command::new(&python)
            .arg(root.join("tests/python/check_info.py"))
            .args([dataset.as_path(), Path::new("rect"), told.as_path()])
            .output()
            .expect("Python starts");
        let counts = String::from_utf8_lossy(&checked.stdout);
        assert!(checked.status.success(), "{counts}{}", String::from_utf8_lossy(&checked.stderr));
        assert!(counts.trim().ends_with(" 0 differences"), "{counts}");
    }
    let plot = folder.path().join("info.png");
    let table = done(&["info", text(&fixture().ood), "--plot", text(&plot)]);
    assert!(table.contains("OOD objects to one ID object") && plot.is_file(), "{table}");
}

#[test]
fn a_preset_lies_under_set_and_set_under_the_flags() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("data");
    let set = ["--preset", "small", "--set", "samples=2", "--set", "seed=9", "--set", "towns=[\"market\"]"];
    let flags = ["--town", "downtown", "--episodes", "1", "--samples", "1", "--jobs", "1"];
    done(&[&["gen", "--out", text(&out)], &set[..], &flags[..]].concat());
    let info: Value = serde_json::from_str(&done(&["info", text(&out), "--json"])).expect("JSON");
    assert_eq!((&info["n_samples"], &info["seed"]), (&1.into(), &9.into()));
    assert_eq!(info["towns"]["downtown"]["n_samples"], 1);
    assert_eq!(info["weathers"].as_object().map(serde_json::Map::len), Some(1));
    assert!(info["note"].as_str().is_some_and(|note| note.contains("harmzone label")), "{info}");
    // `all` was resolved to names.
    let config = fs::read_to_string(out.join("gen.toml")).expect("the config is saved");
    assert!(config.contains("ClearNoon") && !config.contains("\"all\""), "{config}");
}

#[test]
fn the_zones_are_compared_drawn_and_labelled_under_their_names() {
    let (_folder, dataset) = copy();
    let plot = dataset.join("zones.png");
    let told = done(&["zones", text(&dataset), "--json", "--plot", text(&plot)]);
    let told: Value = serde_json::from_str(&told).expect("JSON");
    let drawn = image::open(&plot).expect("a PNG");
    assert!(drawn.width() > 1000 && told["plot"]["sample"] == told["most_disputed_sample"], "{told}");
    let message = fails(&["zones", text(&dataset), "--plot", text(&plot)]);
    assert!(message.contains("--force"), "{message}");
    let message =
        fails(&["zones", text(&dataset), "--plot", text(&dataset.join("b.png")), "--sample", "999"]);
    assert!(message.contains("no sample 999"), "{message}");
    for (i, kind) in ["rect", "arc", "ttc", "rss"].into_iter().enumerate() {
        done(&["label", text(&dataset), "--set", &format!("kind={kind}")]);
        let labels = fs::read(dataset.join("labels").join(kind).join("labels.json")).expect("a label set");
        let labels: Value = serde_json::from_slice(&labels).expect("JSON");
        assert_eq!(labels["counts"], told["zones"][i]["counts"], "{kind}");
    }
    // The flags' old meanings are told.
    for (old, new) in
        [(["--set", "again"], "--labels NAME"), (["--override", "kind=arc"], "`--set kind=arc`")]
    {
        let output = harmzone(&[&["label", text(&dataset)], old.as_slice()].concat());
        let message = String::from_utf8(output.stderr).expect("messages are text");
        assert!(output.status.code() == Some(2) && message.contains(new), "{message}");
    }
    // A run learns from any of them.
    let run = dataset.join("run-rss");
    done(&[&["train", text(&dataset), "--labels", "rss", "--out", text(&run)], TINY.as_slice()].concat());
    done(&["eval", text(&run), "--data", text(&dataset), "--labels", "rss"]);
}
