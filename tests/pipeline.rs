//! End to end on tiny real data: gen -> label -> train -> predict -> eval -> view, and what each says of
//! bad input. Needs what `make setup` makes.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;
use std::time::Duration;

use fs_err as fs;

/// A config small enough to train in seconds.
const TINY: [&str; 20] = [
    "--set",
    "model.grid.cell_size_m=3.2",
    "--set",
    "model.lidar.pillars.bev_channels=[16,16]",
    "--set",
    "model.fuser_channels=16",
    "--set",
    "model.head.n_queries=16",
    "--set",
    "model.camera.cnn.image_width_px=128",
    "--set",
    "model.camera.cnn.n_depth_bins=12",
    "--set",
    "lidar_stage.epochs=3",
    "--set",
    "fused_stage.epochs=2",
    "--set",
    "save_every_steps=1",
    "--set",
    "batch_size=2",
];

/// Over that, a closed set that fits three samples well enough to find some object of each kind.
const KINDS: [&str; 9] = [
    "model.head.classes=kind",
    "model.head.numeric_fusion=none",
    "validate_every_epochs=0",
    "model.use_camera=false",
    "fused_stage.epochs=0",
    "lidar_stage.epochs=60",
    "save_every_steps=100",
    "average_decay=0.5",
    "model.head.n_queries=40",
];

fn harmzone(args: &[&str]) -> Output {
    command(args).output().expect("the program starts")
}

fn command(args: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_harmzone"));
    // From another folder: the program finds all it needs by itself.
    command.args(args).current_dir(std::env::temp_dir());
    command
}

fn done(args: &[&str]) -> String {
    let output = harmzone(args);
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "harmzone {args:?} failed:\n{stderr}");
    String::from_utf8(output.stdout).expect("output is text")
}

/// Runs a command that must fail with exit code 1, and gives its message.
fn fails(args: &[&str]) -> String {
    let output = harmzone(args);
    assert_eq!(output.status.code(), Some(1), "harmzone {args:?} ended with {:?}", output.status);
    String::from_utf8(output.stderr).expect("messages are text")
}

fn text(path: &Path) -> &str {
    path.to_str().expect("temporary paths are text")
}

fn generate(out: &Path, jobs: &str, more: &[&str]) {
    let base = [
        "gen",
        "--town",
        "downtown",
        "--samples",
        "3",
        "--seed",
        "5",
        "--set",
        "val_every=2",
        "--jobs",
        jobs,
    ];
    done(&[&base, more, &["--out", text(out)]].concat());
}

/// Two labelled datasets, ID and OOD, and a trained run; made once for all tests here.
struct Fixture {
    _folder: tempfile::TempDir,
    id: PathBuf,
    ood: PathBuf,
    run: PathBuf,
}

fn fixture() -> &'static Fixture {
    static FIXTURE: OnceLock<Fixture> = OnceLock::new();
    FIXTURE.get_or_init(|| {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let (id, ood, run) = (folder.path().join("id"), folder.path().join("ood"), folder.path().join("run"));
        generate(&id, "2", &["--episodes", "2"]);
        generate(&ood, "2", &["--episodes", "1", "--ood"]);
        done(&["label", text(&id)]);
        done(&["label", text(&ood)]);
        done(&[&["train", text(&id), "--out", text(&run)], TINY.as_slice()].concat());
        Fixture { _folder: folder, id, ood, run }
    })
}

fn episodes(dataset: &Path) -> Vec<(String, Vec<u8>)> {
    let mut found: Vec<(String, Vec<u8>)> = fs::read_dir(dataset.join("episodes"))
        .expect("the dataset has episodes")
        .map(|entry| entry.expect("a readable folder").path())
        .map(|path| {
            (
                text(&path).rsplit('/').next().unwrap_or_default().to_owned(),
                fs::read(&path).expect("a readable file"),
            )
        })
        .collect();
    found.sort();
    found
}

#[test]
fn a_trained_run_is_scored_drawn_and_predicts_files() {
    let Fixture { id, ood, run, .. } = fixture();
    let table = done(&["eval", text(run), "--data", text(id)]);
    assert!(table.contains("harmful") && table.contains("0.7947"), "{table}");
    let scores = tempfile::tempdir().expect("a temporary folder");
    let out = scores.path().join("ood");
    done(&["eval", text(run), "--data", text(ood), "--ood", "--out", text(&out)]);
    let metrics: serde_json::Value =
        serde_json::from_slice(&fs::read(out.join("metrics.json")).expect("metrics are written"))
            .expect("JSON");
    for column in ["total", "id_matched", "ood_all", "ood_matched"] {
        let mean = metrics[column]["mean"].as_f64().expect("a number");
        assert!((0.0..=1.0).contains(&mean), "{column}: {mean}");
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
    let sweeps: serde_json::Value = serde_json::from_str(&text_of(&out)).expect("JSON");
    let curves = sweeps["curves"].as_array().expect("curves");
    assert_eq!((curves.len(), &sweeps["n_samples"]), (4 * 5, &3.into()));
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
    let table = done(&["eval", "small", "--data", text(&id)]);
    assert!(table.contains("0.7947"), "{table}");
    let table = done(&["eval", "small", "--data", text(&fixture().ood), "--ood"]);
    assert!(table.contains("mAP_OOD"), "{table}");
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
    let info: serde_json::Value = serde_json::from_str(&done(&["info", text(&out), "--json"])).expect("JSON");
    assert_eq!((&info["n_samples"], &info["seed"]), (&1.into(), &9.into()));
    assert_eq!(info["towns"]["downtown"]["n_samples"], 1);
    assert_eq!(info["weathers"].as_object().map(serde_json::Map::len), Some(1));
    assert!(info["note"].as_str().is_some_and(|note| note.contains("harmzone label")), "{info}");
    // `all` was resolved to names.
    let config = fs::read_to_string(out.join("gen.toml")).expect("the config is saved");
    assert!(config.contains("ClearNoon") && !config.contains("\"all\""), "{config}");
}

#[test]
fn the_same_seed_gives_the_same_bytes_whatever_the_jobs() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let one = folder.path().join("one");
    generate(&one, "1", &["--episodes", "2"]);
    assert!(episodes(&one) == episodes(&fixture().id));
    assert_eq!(
        fs::read(one.join("dataset.json")).expect("a manifest"),
        fs::read(fixture().id.join("dataset.json")).expect("a manifest")
    );
}

#[test]
fn gen_killed_in_the_middle_and_called_again_ends_with_the_same_bytes() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("killed");
    let base =
        ["gen", "--town", "downtown", "--samples", "3", "--seed", "5", "--set", "val_every=2", "--jobs", "1"];
    let args = [&base[..], &["--episodes", "2", "--out", text(&out)]].concat();
    let mut child = command(&args).spawn().expect("the program starts");
    // Once the first episode stands, the second is under way.
    while !out.join("episodes").exists()
        || !fs::read_dir(out.join("episodes")).is_ok_and(|mut dir| {
            dir.any(|e| e.is_ok_and(|e| e.path().extension().is_some_and(|x| x == "mcap")))
        })
    {
        assert!(child.try_wait().expect("a child of ours").is_none(), "gen ended without an episode");
        std::thread::sleep(Duration::from_millis(20));
    }
    child.kill().expect("a running program can be killed");
    child.wait().expect("a killed program ends");
    done(&args);
    assert!(episodes(&out) == episodes(&fixture().id));
}

#[test]
fn train_killed_in_the_middle_and_called_again_ends_with_the_same_bytes() {
    let Fixture { id, run, .. } = fixture();
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("killed");
    let args = [&["train", text(id), "--out", text(&out)], TINY.as_slice()].concat();
    let mut child = command(&args).spawn().expect("the program starts");
    while !fs::read_dir(out.join("state")).is_ok_and(|mut dir| dir.next().is_some()) {
        assert!(child.try_wait().expect("a child of ours").is_none(), "the run ended without a state");
        std::thread::sleep(Duration::from_millis(5));
    }
    child.kill().expect("a running program can be killed");
    child.wait().expect("a killed program ends");
    done(&args);
    for file in ["model.safetensors", "log.csv"] {
        assert!(
            fs::read(out.join(file)).expect("the run is whole")
                == fs::read(run.join(file)).expect("the run is whole"),
            "{file} differs"
        );
    }
}

/// Rows of one branch, and of one stage, in little.
fn experiment(folder: &Path) -> PathBuf {
    let keys = |keys: &[&str]| {
        let quoted: Vec<String> = keys.iter().map(|key| format!("'{key}'")).collect();
        format!("[{}]", quoted.join(", "))
    };
    let tiny: Vec<&str> = TINY.iter().copied().filter(|&key| key != "--set").collect();
    let file = folder.join("results.toml");
    let rows = [
        ("lidar", ["model.use_camera=false", "fused_stage.epochs=0", "lidar_stage.schedule=cyclic"]),
        ("camera", ["model.use_lidar=false", "lidar_stage.epochs=0", "fused_stage.schedule=warmup_cosine"]),
        ("one-stage", ["lidar_stage.epochs=0", "fused_stage.epochs=1", "model.head.numeric_fusion=paper"]),
    ];
    let mut config = format!("preset = 'small'\ncommon = {}\nheadline = {{ name = 'small' }}\n", keys(&tiny));
    for (name, set) in rows {
        config += &format!("[[rows]]\nname = '{name}'\nset = {}\n", keys(&set));
    }
    config += "[[tables]]\ntitle = 'Branches'\nnote = 'One each.'\nrows = [";
    config += &rows.map(|(name, _)| format!("{{ label = 'with {name}', row = '{name}' }}")).join(", ");
    config += "]\n";
    for judge in ["network", "zone-soft"] {
        config += &format!("[[rivals]]\nlabel = 'by {judge}'\nrow = 'lidar'\njudge = '{judge}'\n");
    }
    let kinds = keys(&KINDS);
    config += &format!("[closed_set]\nname = 'kinds'\nset = {kinds}\n");
    fs::write(&file, config).expect("a writable folder");
    file
}

#[test]
fn an_experiment_killed_in_a_training_goes_on_and_its_commands_make_its_rows() {
    let Fixture { id, ood, run, .. } = fixture();
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("results");
    let config = experiment(folder.path());
    let data = ["--data", text(id), "--ood", text(ood), "--headline", text(run)];
    let args = [&["results", "--config", text(&config), "--out", text(&out)], data.as_slice()].concat();
    let document = || fs::read_to_string(out.join("RESULTS.md")).expect("tables are written");

    let message = fails(&[&args, ["--only", "radar"].as_slice()].concat());
    assert!(message.contains("radar") && message.contains("one-stage"), "{message}");
    done(&[&args, ["--only", "lidar"].as_slice()].concat());
    assert!(document().contains("| with camera | not trained yet"), "{}", document());
    assert!(document().contains("Not trained yet."), "the headline was not asked for: {}", document());
    assert!(!out.join("report.html").exists(), "a page is of the headline");
    let checkpoint = |run: &Path| fs::read(run.join("model.safetensors")).expect("the run is whole");
    let changed = || {
        let time =
            |name: &str| fs::metadata(out.join(name)).and_then(|file| file.modified()).expect("a record");
        ["scores/lidar.json", "scores/lidar-rivals.json"].map(time)
    };
    let first = changed();

    let mut child = command(&args).spawn().expect("the program starts");
    while !fs::read_dir(out.join("runs/camera/state")).is_ok_and(|mut dir| dir.next().is_some()) {
        assert!(child.try_wait().expect("a child of ours").is_none(), "the rows ended without a state");
        std::thread::sleep(Duration::from_millis(5));
    }
    child.kill().expect("a running program can be killed");
    child.wait().expect("a killed program ends");
    assert!(!out.join("scores/camera.json").exists());
    done(&args);
    assert_eq!(changed(), first, "a finished row is not done again, nor are its rivals");
    let whole = document();
    assert!(
        whole.contains("| closed set, energy | `kinds` |")
            && whole.contains("| by network | `lidar` |")
            && whole.contains("| by zone-soft | `lidar` |"),
        "{whole}"
    );
    assert!(!whole.contains("not trained yet") && !whole.contains("Not trained yet"), "{whole}");
    // One page of the headline's scores, faults and sweeps, and of the tables.
    let page = || fs::read_to_string(out.join("report.html")).expect("a page is written");
    let told = page();
    for part in
        ["closed set, energy", "Steering set to: mAP", "harmzone results --config", "Training, train.toml"]
    {
        assert!(told.contains(part), "{part}");
    }
    assert!(told.contains("data:image/jpeg") && !told.contains("To make it:"), "all of it is there");
    let scored = || {
        let time = |side: &str| fs::metadata(out.join("report").join(side).join("metrics.json"))?.modified();
        ["id", "ood"].map(|side| time(side).expect("the headline is scored"))
    };
    let first_scored = scored();
    let time = fs::read_to_string(out.join("runs/camera/time.json")).expect("a time");
    assert!(time.contains("\"n_calls\":2"), "{time}");

    // What stands under a table makes the same networks.
    for name in ["camera", "one-stage"] {
        let own = folder.path().join(name);
        let line =
            whole.lines().find(|line| line.contains(&format!("--out runs/{name}"))).expect("a command");
        let line = line.replace("data/id", text(id)).replace(&format!("runs/{name}"), text(&own));
        let script = line.replace("harmzone ", &format!("{} ", env!("CARGO_BIN_EXE_harmzone")));
        assert!(Command::new("sh").args(["-c", &script]).status().expect("a shell").success(), "{script}");
        assert!(checkpoint(&own) == checkpoint(&out.join("runs").join(name)), "{script}");
        assert!(own.join("curves.png").is_file() && own.join("curves.svg").is_file());
    }

    // The tables come from results.json alone; a card takes the figures of the network beside it.
    let card = folder.path().join("net.md");
    fs::write(&card, "# Net\n<!-- figures: begin --><!-- figures: end -->\n").expect("a writable folder");
    fs::write(card.with_extension("safetensors"), b"another network").expect("a writable folder");
    let again = ["results", "--out", text(&out), "--tables-only", "--card", text(&card)];
    let message = fails(&again);
    assert!(message.contains("not the headline's"), "{message}");
    fs::write(card.with_extension("safetensors"), checkpoint(run)).expect("a writable folder");
    for name in ["RESULTS.md", "report.html"] {
        fs::remove_file(out.join(name)).expect("it was there");
    }
    done(&again);
    assert_eq!(document(), whole);
    assert_eq!(page(), told, "from what is kept");
    assert_eq!(scored(), first_scored, "and nothing is scored again");
    assert!(fs::read_to_string(&card).expect("a card").contains("mAP_OOD"));

    // Another config for a row that is trained is told, not silently mixed in.
    let changed = fs::read_to_string(&config).expect("a config").replace("batch_size=2", "batch_size=3");
    fs::write(&config, changed).expect("a writable folder");
    let message = fails(&args);
    assert!(message.contains("row `lidar`") && message.contains("another config"), "{message}");
}

#[test]
fn unknown_towns_and_weathers_list_those_that_exist() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("data");
    let message = fails(&["gen", "--town", "atlantis", "--out", text(&out)]);
    assert!(message.contains("atlantis") && message.contains("downtown"), "{message}");
    let message = fails(&["gen", "--town", "downtown", "--weather", "Hail", "--out", text(&out)]);
    assert!(message.contains("Hail") && message.contains("ClearNoon"), "{message}");
    assert!(!out.join("dataset.json").exists());
}

#[test]
fn a_dataset_without_labels_says_how_to_make_them() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let message = fails(&[
        "train",
        text(&fixture().id),
        "--labels",
        "absent",
        "--out",
        text(&folder.path().join("run")),
    ]);
    assert!(message.contains("harmzone label") && message.contains("absent"), "{message}");
}

/// A copy of the labelled ID dataset that a test may spoil.
fn copy() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let to = folder.path().join("copy");
    let copied = Command::new("cp").arg("-r").arg(&fixture().id).arg(&to).status().expect("cp runs");
    assert!(copied.success());
    (folder, to)
}

#[test]
fn labels_of_another_dataset_are_refused() {
    let (_folder, dataset) = copy();
    fs::remove_dir_all(dataset.join("labels")).expect("labels were there");
    let other = fixture().ood.join("labels");
    let copied =
        Command::new("cp").arg("-r").arg(other).arg(dataset.join("labels")).status().expect("cp runs");
    assert!(copied.success());
    let message = fails(&["train", text(&dataset), "--out", text(&dataset.join("run"))]);
    assert!(message.contains("another dataset") && message.contains("harmzone label"), "{message}");
}

#[test]
fn the_zones_are_compared_drawn_and_labelled_under_their_names() {
    let (_folder, dataset) = copy();
    let plot = dataset.join("zones.png");
    let told = done(&["zones", text(&dataset), "--json", "--plot", text(&plot)]);
    let told: serde_json::Value = serde_json::from_str(&told).expect("JSON");
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
        let labels: serde_json::Value = serde_json::from_slice(&labels).expect("JSON");
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

#[test]
fn a_truncated_episode_and_a_foreign_file_are_named() {
    let (_folder, dataset) = copy();
    let (name, bytes) = episodes(&dataset).remove(0);
    let path = dataset.join("episodes").join(&name);
    fs::write(&path, &bytes[..bytes.len() / 2]).expect("a writable copy");
    let message = fails(&["label", text(&dataset), "--labels", "again"]);
    assert!(message.contains(&name), "{message}");
    fs::write(&path, b"not an MCAP at all").expect("a writable copy");
    let message = fails(&["label", text(&dataset), "--labels", "again"]);
    assert!(message.contains(&name), "{message}");
}

#[test]
fn an_output_folder_of_something_else_is_left_alone() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    fs::write(folder.path().join("thesis.txt"), "years of work").expect("a writable folder");
    fails(&["gen", "--town", "downtown", "--episodes", "1", "--samples", "1", "--out", text(folder.path())]);
    fails(&["train", text(&fixture().id), "--out", text(folder.path())]);
    assert_eq!(fs::read_to_string(folder.path().join("thesis.txt")).expect("still there"), "years of work");
    assert_eq!(fs::read_dir(folder.path()).expect("a folder").count(), 1);
}

#[test]
fn another_config_in_the_same_folder_needs_force() {
    let Fixture { id, run, .. } = fixture();
    let before = fs::read(run.join("model.safetensors")).expect("a checkpoint");
    let message = fails(&["train", text(id), "--out", text(run), "--set", "seed=9"]);
    assert!(message.contains("--force"), "{message}");
    assert!(fs::read(run.join("model.safetensors")).expect("a checkpoint") == before);
    let message = fails(&["gen", "--town", "downtown", "--seed", "6", "--samples", "3", "--out", text(id)]);
    assert!(message.contains("--force"), "{message}");
}

#[test]
fn a_checkpoint_that_does_not_fit_its_config_is_refused() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("model.safetensors");
    let mut bytes = fs::read(fixture().run.join("model.safetensors")).expect("a checkpoint");
    let (from, to) = (b"fuser_channels = 16", b"fuser_channels = 32");
    let at = bytes.windows(from.len()).position(|window| window == from).expect("the config is inside");
    bytes[at..at + from.len()].copy_from_slice(to);
    fs::write(&path, bytes).expect("a writable folder");
    let message = fails(&["eval", text(&path), "--data", text(&fixture().id)]);
    assert!(message.contains("do not fit its config"), "{message}");
}

#[test]
fn a_sample_out_of_range_tells_the_range() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("x.png");
    let message = fails(&["view", text(&fixture().id), "--sample", "6", "--out", text(&out)]);
    assert!(message.contains('6') && message.contains('5'), "{message}");
}

#[test]
fn missing_gl_says_what_to_install() {
    let output = command(&["doctor"])
        .env("__EGL_VENDOR_LIBRARY_FILENAMES", "/nowhere/egl.json")
        .output()
        .expect("the program starts");
    assert_eq!(output.status.code(), Some(1));
    let all = [output.stdout, output.stderr].concat();
    let all = String::from_utf8_lossy(&all);
    assert!(all.contains("libegl1"), "{all}");
}

#[test]
fn a_device_that_is_not_there_is_told_with_what_is() {
    let of = |device| harmzone(&["train", "nowhere", "--out", "nowhere", "--device", device]);
    let absent = of("vulkan:99");
    let text = String::from_utf8_lossy(&absent.stderr).into_owned();
    let told = if cfg!(feature = "vulkan") { "no device vulkan:99" } else { "this build has cpu" };
    assert!(absent.status.code() == Some(1) && text.contains(told), "{text}");
    let unknown = of("gpu");
    let text = String::from_utf8_lossy(&unknown.stderr).into_owned();
    assert!(unknown.status.code() == Some(2) && text.contains("vulkan:N"), "{text}");
}

#[test]
fn a_wrong_flag_is_a_usage_error() {
    assert_eq!(harmzone(&["gen", "--city", "downtown"]).status.code(), Some(2));
}
