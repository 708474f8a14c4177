//! The program in a terminal and in a pipe: progress, colours, JSON, manual, completions, a project from `init`. Needs what
//! `make setup` makes.

mod made_data;

use std::io::Write as _;
use std::path::Path;
use std::process::{Command, Output, Stdio};

use fs_err as fs;
use made_data::{TINY, command, done, fails, fixture, harmzone, text};
use serde_json::Value;

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

#[test]
fn in_a_pipe_a_training_tells_lines_and_quietly_nothing() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let train = |run: &Path, more: &[&str]| {
        let words = ["train", text(&fixture().id), "--out", text(run), "--json"];
        let output = harmzone(&[&words[..], &TINY, more].concat());
        assert!(output.status.success(), "{}", said(&output));
        let json: Value = serde_json::from_slice(&output.stdout).expect("one JSON value on standard output");
        (json, said(&output))
    };
    let (summary, told) = train(&folder.path().join("told"), &[]);
    assert_eq!(summary["n_steps"], summary["n_steps_now"]);
    assert!(summary["last_loss"]["total"].as_f64().is_some_and(|loss| loss > 0.0), "{summary}");
    assert!(Path::new(summary["checkpoint"].as_str().expect("a path")).is_file());
    // The table: a header and a row an epoch, with what is left to go.
    let rows = |stage: &str| {
        // A line of progress, of a machine that takes a second a step, has a time and a rate.
        let is_row = |line: &&str| {
            line.trim_start().starts_with(stage) && line.contains(':') && !line.contains("samples/s")
        };
        told.lines().filter(is_row).count()
    };
    assert!(told.contains("epoch    loss") && rows("lidar") == 3 && rows("fused") == 2, "{told}");
    assert!(!told.contains('\u{1b}'), "{told:?}");
    let (quietly, told) = train(&folder.path().join("quiet"), &["--quiet"]);
    assert_eq!(told, "");
    assert_eq!(quietly["last_loss"], summary["last_loss"]);
    let (again, told) = train(&folder.path().join("told"), &[]);
    let total = |of: &Value| of["last_loss"]["total"].as_f64().expect("a loss");
    assert!((total(&again) - total(&summary)).abs() < 1e-3, "from the log: {again}");
    assert!(!told.contains("epoch    loss"), "nothing was left to do: {told}");
}

#[test]
fn an_error_is_coloured_only_where_a_terminal_shows_it() {
    let mut plain = command(&["info", "nowhere"]);
    let plain = plain.env_remove("CLICOLOR_FORCE").output().expect("the program starts");
    assert!(said(&plain).starts_with("error: "), "{}", said(&plain));
    let of = |variable: &str| {
        let mut info = command(&["info", "nowhere"]);
        info.env_remove("NO_COLOR").env("CLICOLOR_FORCE", "1").env(variable, "1");
        said(&info.output().expect("the program starts"))
    };
    assert!(of("HARMZONE_TEST").starts_with('\u{1b}'), "{:?}", of("HARMZONE_TEST"));
    assert!(of("NO_COLOR").starts_with("error: "), "{:?}", of("NO_COLOR"));
}

#[test]
fn the_log_is_told_as_much_as_is_asked_for() {
    let both = harmzone(&["doctor", "-q", "-v"]);
    assert_eq!(both.status.code(), Some(2));
    assert!(said(&both).contains("cannot be used with"), "{}", said(&both));
    let labels = |flag: &str| {
        let mut label = command(&["label", text(&fixture().id), "--labels", &format!("of{flag}"), flag]);
        said(&label.env("HARMZONE_LOG", "off").output().expect("the program starts"))
    };
    assert_eq!(labels("-q"), "");
    assert!(labels("-v").contains("label"), "progress comes as lines");
}

#[test]
fn bash_takes_the_completions_and_man_pages_are_written_once() {
    let script = done(&["completions", "bash"]);
    assert!(
        script.contains("foxglove-layout") && !script.contains("label-worker"),
        "a command is missing or too much"
    );
    let mut bash = Command::new("bash").arg("-n").stdin(Stdio::piped()).spawn().expect("bash starts");
    bash.stdin.take().expect("a pipe").write_all(script.as_bytes()).expect("bash reads");
    assert!(bash.wait().expect("bash ends").success());
    let folder = tempfile::tempdir().expect("a temporary folder");
    let pages = folder.path().join("man");
    let told = done(&["man", "--out", text(&pages)]);
    assert!(told.contains("pages") && pages.join("harmzone-import-ros2.1").is_file(), "{told}");
    let told = fails(&["man", "--out", text(&pages)]);
    assert!(told.contains("--force"), "{told}");
}

#[test]
fn a_config_is_shown_as_a_file_that_a_command_takes() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let file = folder.path().join("zone.toml");
    fs::write(&file, done(&["config", "show", "zone", "--set", "kind=ttc"])).expect("a file is written");
    let told = done(&["config", "show", "zone", "--config", text(&file), "--changed"]);
    assert_eq!(told.trim(), "kind=ttc");
    let told = fails(&["config", "show", "zone", "--set", "knd=ttc"]);
    assert!(told.contains("did you mean `kind`?"), "{told}");
    let found: Value =
        serde_json::from_str(&done(&["config", "explain", "kind", "--stage", "zone", "--json"]))
            .expect("JSON");
    assert_eq!(found[0]["entry"]["default"], "rect");
}

#[test]
fn the_project_of_init_runs_to_its_report() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let project = folder.path().join("project");
    done(&["init", text(&project)]);
    // The same commands on less: the script is the user's to change.
    let script = fs::read_to_string(project.join("run.sh")).expect("a script");
    let small = script
        .replace("--episodes 12 --samples 10", "--episodes 6 --samples 2")
        .replace("--episodes 4 --samples 10", "--episodes 2 --samples 2")
        .replace("--set fused_stage.epochs=2", &TINY.join(" "));
    assert_ne!(small, script);
    fs::write(project.join("run.sh"), small).expect("the script is written");
    let program = made_data::program();
    let folder = program.parent().expect("a folder").display();
    let path = format!("{folder}:{}", std::env::var("PATH").expect("PATH"));
    let mut bash = Command::new("bash");
    let output = bash.arg("run.sh").current_dir(&project).env("PATH", path).output().expect("bash starts");
    assert!(output.status.success(), "{}", said(&output));
    assert!(project.join("runs/first/report.html").is_file());
}
