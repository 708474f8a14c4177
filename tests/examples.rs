//! The programs in `examples/` run, without a file and on none but their own data, and say what they promise.

use std::process::Command;

/// What an example prints.
fn run(name: &str) -> String {
    let tests = std::env::current_exe().expect("a running program has a path");
    let release = tests.ancestors().nth(2).expect("tests lie in target/release/deps");
    let program = release.join("examples").join(name);
    assert!(program.is_file(), "no {}: run `cargo build --release --examples` first", program.display());
    let output =
        Command::new(program).current_dir(std::env::temp_dir()).output().expect("the example starts");
    assert!(output.status.success(), "{name}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).expect("output is text")
}

#[test]
fn an_episode_is_read() {
    insta::assert_snapshot!(run("read_episode"), @"");
}

#[test]
fn a_zone_of_ones_own_labels_objects() {
    insta::assert_snapshot!(run("own_zone"), @"");
}

#[test]
fn any_detector_is_scored() {
    insta::assert_snapshot!(run("score_detector"), @"");
}
