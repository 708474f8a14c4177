//! A whole experiment in little: killed, called again, told by its tables, and made again by the commands in them.

#[path = "../../tests/made_data/mod.rs"]
mod made_data;

use std::path::{Path, PathBuf};
use std::process::Command;

use fs_err as fs;
use harmzone::report::results::Results;
use made_data::{Fixture, KINDS, TINY, fail, fixture, kill_when_filled, program, succeed, text};

fn xtask(args: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_xtask"));
    command.args(args);
    command
}

/// What is to stand beside a run that is not there.
fn nobody() -> String {
    "[[side_by_side]]\ntitle = 'Nobody'\nnote = 'A run that is not there.'\nrows = [{ label = 'own', row = 'lidar' }, \
     { label = 'nobody', row = 'nobody' }]\n[[given]]\nname = 'nobody'\nruns = ['not/there']\n"
        .to_owned()
}

/// Rows of one branch, and of one stage, in little.
fn experiment(folder: &Path, given: &Path) -> PathBuf {
    let keys = |keys: &[&str]| {
        let quoted: Vec<String> = keys.iter().map(|key| format!("'{key}'")).collect();
        format!("[{}]", quoted.join(", "))
    };
    let tiny: Vec<&str> = TINY.iter().copied().filter(|&key| key != "--set").collect();
    let file = folder.join("results.toml");
    let rows = [
        ("lidar", vec!["model.use_camera=false", "fused_stage.epochs=0", "lidar_stage.schedule=cyclic"]),
        (
            "camera",
            vec!["model.use_lidar=false", "lidar_stage.epochs=0", "fused_stage.schedule=warmup_cosine"],
        ),
        (
            "one-stage",
            vec![
                "lidar_stage.epochs=0",
                "fused_stage.epochs=1",
                "model.head.numeric_fusion=paper",
                "model.head.judge=both",
            ],
        ),
    ];
    let mut config = format!("preset = 'small'\ncommon = {}\nheadline = {{ name = 'small' }}\n", keys(&tiny));
    for (name, set) in &rows {
        config += &format!("[[rows]]\nname = '{name}'\nset = {}\n", keys(set));
    }
    config += "[[tables]]\ntitle = 'Branches'\nnote = 'One each.'\nrows = [";
    config += &rows.map(|(name, _)| format!("{{ label = 'with {name}', row = '{name}' }}")).join(", ");
    config += "]\n";
    config += "[[side_by_side]]\ntitle = 'Eyes'\nnote = 'On the same samples.'\nrows = [{ label = 'cloud', row = 'lidar' }, \
               { label = 'dark', row = 'one-stage', blind = 'camera' }, \
               { label = 'rule', row = 'kinds', judge = 'zone' }]\n";
    config += "questions = [{ row = 'dark', better = 'It sees.', worse = 'It sees.', level = 'It sees.' }]\n";
    config += "[[side_by_side]]\ntitle = 'Guests'\nnote = 'A run that was given.'\nrows = [{ label = 'own', row = 'lidar' }, \
               { label = 'guest', row = 'guest' }, { label = 'both', row = 'one-stage' }]\n";
    config += &format!("[[given]]\nname = 'guest'\nruns = ['{}']\n", text(given));
    config += &nobody();
    config += "[seeds]\nvalues = [7]\nrows = ['one-stage']\n";
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
    let again = folder.path().join("again");
    let config = experiment(folder.path(), &again);
    let mut train = Command::new(program());
    train.args(["train", text(id), "--out", text(&again)]).args(TINY).args(["--set", "seed=5"]);
    succeed(&mut train);
    let data = ["--data", text(id), "--ood", text(ood), "--headline", text(run)];
    let message = fail(
        xtask(&["results", "--config", text(&config), "--out", text(&out)])
            .args(data)
            .args(["--headline-again", text(run)]),
    );
    assert!(message.contains("two runs of `small` are from seed"), "{message}");
    let data = [&data[..], &["--headline-again", text(&again)]].concat();
    let args = [&["results", "--config", text(&config), "--out", text(&out)], data.as_slice()].concat();
    let document = || fs::read_to_string(out.join("RESULTS.md")).expect("tables are written");

    let message = fail(&mut xtask(&[&args, ["--only", "radar"].as_slice()].concat()));
    assert!(message.contains("radar") && message.contains("one-stage"), "{message}");
    succeed(&mut xtask(&[&args, ["--only", "lidar"].as_slice()].concat()));
    assert!(document().contains("| with camera | not trained yet"), "{}", document());
    assert!(!document().contains("Eyes"), "one of its rows is not trained: {}", document());
    assert!(document().contains("Not trained yet."), "the headline was not asked for: {}", document());
    assert!(!out.join("report.html").exists(), "a page is of the headline");
    let checkpoint = |run: &Path| fs::read(run.join("model.safetensors")).expect("the run is whole");
    let changed =
        || fs::metadata(out.join("scores/lidar.json")).and_then(|file| file.modified()).expect("a record");
    let first = changed();

    kill_when_filled(&mut xtask(&args), &out.join("runs/camera/state"));
    assert!(!out.join("scores/camera.json").exists());
    succeed(&mut xtask(&args));
    assert_eq!(changed(), first, "a finished row is not done again, nor are its rivals");
    let whole = document();
    assert!(
        whole.contains("| closed set, energy | kinds |")
            && whole.contains("| by network | lidar |")
            && whole.contains("| by zone-soft | lidar |")
            && whole.contains("| zone over the closed set's boxes | kinds |")
            && whole.contains("| AP, mean of both | truths | cloud | dark | rule |")
            && whole.contains("| AP, mean of both | truths | own | guest | both |")
            && whole.contains("It sees. (dark, against cloud: mean AP ")
            && whole.contains(", seeds ")
            && whole.contains("| seed 5 | mean | standard deviation |"),
        "{whole}"
    );
    assert!(!whole.contains("Nobody"), "its run is not there: {whole}");
    assert!(!whole.contains("not trained yet") && !whole.contains("Not trained yet"), "{whole}");
    // One page of the headline's scores, faults and sweeps, and of the tables.
    let page = || fs::read_to_string(out.join("report.html")).expect("a page is written");
    let told = page();
    for part in
        ["closed set, energy", "Steering set to: mAP", "-p xtask -- results --config", "Training, train.toml"]
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
        let script = line.replace("harmzone ", &format!("{} ", program().display()));
        assert!(Command::new("sh").args(["-c", &script]).status().expect("a shell").success(), "{script}");
        assert!(checkpoint(&own) == checkpoint(&out.join("runs").join(name)), "{script}");
        assert!(own.join("curves.png").is_file() && own.join("curves.svg").is_file());
    }

    // The tables come from results.json alone; a card takes the figures of the network beside it.
    let card = folder.path().join("net.md");
    fs::write(&card, "# Net\n<!-- figures: begin --><!-- figures: end -->\n").expect("a writable folder");
    fs::write(card.with_extension("safetensors"), b"another network").expect("a writable folder");
    let again = ["results", "--out", text(&out), "--tables-only", "--card", text(&card)];
    let message = fail(&mut xtask(&again));
    assert!(message.contains("not the headline's"), "{message}");
    fs::write(card.with_extension("safetensors"), checkpoint(run)).expect("a writable folder");
    for name in ["RESULTS.md", "report.html"] {
        fs::remove_file(out.join(name)).expect("it was there");
    }
    succeed(&mut xtask(&again));
    assert_eq!(document(), whole);
    assert_eq!(page(), told, "from what is kept");
    assert_eq!(scored(), first_scored, "and nothing is scored again");
    assert!(fs::read_to_string(&card).expect("a card").contains("mAP_OOD"));

    // Split test is made and scored once, and answers from then on: in its towns, in a map by path, and in all of them.
    let map = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/data/crossroads.xodr");
    let maps = format!("test_maps=['{}', 'not/there.xodr']", text(&map));
    let wanted = [
        "--set",
        "preset=demo",
        "--set",
        "test_seed=1018",
        "--set",
        &maps,
        "--final",
        "--date",
        "2026-01-02",
    ];
    let report = [&args, wanted.as_slice()].concat();
    let kept = || -> Vec<PathBuf> {
        let files = fs::read_dir(out.join("scores")).expect("scores are kept");
        let files = files.map(|file| file.expect("a file").path());
        files.filter(|file| text(file).contains("/scores/reported")).collect()
    };
    assert!(kept().is_empty(), "{:?}", kept());
    let message = fail(&mut xtask(&report));
    assert!(
        message.contains("`nobody` is to stand beside the others") && message.contains("not/there"),
        "{message}"
    );
    let text_of_config = fs::read_to_string(&config).expect("a config");
    fs::write(&config, text_of_config.replace(&nobody(), "")).expect("a writable folder");
    let of_guest = folder.path().join("again/data.json");
    let own = fs::read_to_string(&of_guest).expect("a run knows its data");
    fs::write(&of_guest, own.replace("labels", "notes")).expect("a writable folder");
    let message = fail(&mut xtask(&report));
    assert!(message.contains("was trained on other data") && message.contains(text(&of_guest)), "{message}");
    assert!(kept().is_empty(), "{:?}", kept());
    fs::write(&of_guest, own).expect("a writable folder");
    for is_first in [true, false] {
        succeed(&mut xtask(&report));
        let reported = document();
        for part in [
            "## Split test",
            ", 2026-01-02; network ",
            ".) Split test.",
            "The same on split dev",
            "In harbour, hillside:",
            "| mean of the seeds | towns of training",
            "maps are not there: not/there.xodr.",
        ] {
            assert!(reported.contains(part), "{part}: {reported}");
        }
        assert_eq!(
            kept().len(),
            5,
            "the headline, its other seed, their mean, and twice rows side by side: {:?}",
            kept()
        );
        for file in kept() {
            let text = fs::read_to_string(&file).expect("figures are kept");
            if is_first {
                fs::write(&file, text + " ").expect("a writable folder");
            } else {
                assert!(text.ends_with(' '), "made once: {}", file.display());
            }
        }
    }
    for set in ["test", "test-ood", "test-maps", "test-maps-ood"] {
        let made = fs::read_to_string(out.join(set).join("gen.toml")).expect("the set was made");
        assert!(made.contains("\nseed = 1018\n"), "{set}: {made}");
    }
    let results = Results::read(&out.join("results.json")).expect("results are kept");
    let rows = results.side_by_side[0].reported.as_ref().expect("rows side by side on split test");
    let groups = &results.reported.as_ref().expect("the headline on split test").groups;
    let [towns, maps, all] = &groups[..] else { panic!("{groups:?}") };
    assert_eq!(rows.fingerprint, all.ood.fingerprint);
    assert!(rows.fingerprint != towns.ood.fingerprint && rows.fingerprint != results.data.ood.fingerprint);
    assert_eq!((rows.of.n_samples, all.towns.len()), (all.ood.n_samples, 3));
    assert_eq!(all.id.n_episodes, towns.id.n_episodes + maps.id.n_episodes);
    // The mean of the seeds, of the figures that stand beside it.
    let means = results.seed_means.expect("the mean of two seeds");
    let of_seeds = results.reported.iter().chain(&results.reported_repeats);
    let of_seeds: Vec<f64> = of_seeds.filter_map(|of| of.groups[2].ood.scores.total.mean).collect();
    let mean = means.groups[2].ood.mean[0].figures[0].value.expect("a mean");
    assert!((mean - of_seeds.iter().sum::<f64>() / 2.0).abs() < 1e-12, "{mean} of {of_seeds:?}");
    assert_eq!(means.groups[2].ood.n_episodes, all.ood.n_episodes, "no two sets share an episode's name");
    // Boxes that are judged beside others are judged as the network does itself.
    let again = results.repeats.iter().map(|of| &of.record);
    let runs = results.rows.iter().chain(again).filter(|of| of.name.starts_with("one-stage"));
    let of_runs: Vec<f64> = runs.filter_map(|of| of.ood.total.mean).collect();
    let mean = results.side_by_side[1].of.mean[0].figures[2].value.expect("a mean");
    assert_eq!(of_runs.len(), 2);
    assert!((mean - of_runs.iter().sum::<f64>() / 2.0).abs() < 1e-12, "{mean} of {of_runs:?}");
    let boxes = fs::read_dir(out.join("report/test-maps-ood")).expect("a scoring");
    let boxes = boxes.filter(|file| text(&file.as_ref().expect("a file").path()).contains("/boxes-"));
    assert!(boxes.count() >= 4, "of two seeds and of the rows side by side");

    // Another config for a row that is trained is told, not silently mixed in.
    let changed = fs::read_to_string(&config).expect("a config").replace("batch_size=2", "batch_size=3");
    fs::write(&config, changed).expect("a writable folder");
    let message = fail(&mut xtask(&args));
    assert!(message.contains("row `lidar`") && message.contains("another config"), "{message}");
}
