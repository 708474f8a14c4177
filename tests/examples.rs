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
    insta::assert_snapshot!(run("read_episode"), @r"
    street: 3 samples in nowhere, ClearNoon
    0.0 s: 8.0 m/s, 1 LiDAR points, a picture of 32x18
      car:1 at x 14.0 m, y 3.2 m
      sofa:2 at x 19.0 m, y 0.3 m
    0.3 s: 8.0 m/s, 1 LiDAR points, a picture of 32x18
      car:1 at x 11.6 m, y 3.2 m
      sofa:2 at x 16.6 m, y 0.3 m
    0.6 s: 8.0 m/s, 1 LiDAR points, a picture of 32x18
      car:1 at x 9.2 m, y 3.2 m
      sofa:2 at x 14.2 m, y 0.3 m
    ");
}

#[test]
fn a_zone_of_ones_own_labels_objects() {
    insta::assert_snapshot!(run("own_zone"), @r"
    sample               object              x, m   by the zone   by braking distance
    0                    car:1               14.0   harmless      harmless
    0                    sofa:2              19.0   harmful       harmless
    1                    car:1               11.6   harmless      harmless
    1                    sofa:2              16.6   harmful       harmless
    2                    car:1                9.2   harmless      harmless
    2                    sofa:2              14.2   harmful       harmless
    ");
}

#[test]
fn any_detector_is_scored() {
    insta::assert_snapshot!(run("score_detector"), @r"
    AP, mean of 0.5, 1, 2 and 4 m
    all objects      harmful 0.497   harmless 1.000
    in distribution  harmful no truth   harmless 1.000
    errors of harmful boxes at 2 m: 1.50 m
    ");
}
