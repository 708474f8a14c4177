//! As [`super::io_errors`], of the commands that take what is there and make another thing of it: imports, merges, mending, boxes and
//! scores. A disk that does not answer is never taken for what is not there.

use std::path::Path;

use fs_err as fs;

use super::folder::{copy, hashes};
use super::io_errors::{EIO, Outcome, assert_unharmed, check, tell_progress};
use super::made_data::{command, done, fixture, generation, text};
use super::n_faults;
use super::shim::{Fault, with_fault};

/// A command that goes on in `data`, and what lies there before it.
struct Other {
    name: &'static str,
    words: Vec<String>,
    prepare: fn(&Path),
}

/// Each in the folder `data`.
fn others(data: &Path) -> Vec<Other> {
    let path = |name: &str| text(&data.join(name)).to_owned();
    let other = |name, words: &[&str], prepare| {
        let words = words.iter().map(|&word| word.to_owned()).collect();
        Other { name, words, prepare }
    };
    let (out, log, set) = (path("out"), path("log"), path("in"));
    vec![
        other("merge", &["merge", &path("b"), &path("a"), "--out", &out], |data| {
            for (shard, name) in ["0/2", "1/2"].into_iter().zip(["a", "b"]) {
                let shard_out = data.join(name);
                done(&generation(&shard_out, "1", &["--episodes", "2", "--shard", shard]));
                done(&["label", text(&shard_out)]);
            }
        }),
        other("nuscenes", &["import", "nuscenes", &log, "--out", &out], |data| {
            let words = ["--categories", "source", "--version", "v1.0-mini"];
            let log = data.join("log");
            done(&[["export", "nuscenes", text(&fixture().id), text(&log)].as_slice(), &words].concat());
        }),
        other("kitti", &["import", "kitti", &log, "--out", &out], |data| {
            let log = data.join("log");
            done(&["export", "kitti", text(&fixture().id), text(&log), "--categories", "kinds"]);
        }),
        other("doctor --fix", &["doctor", &set, "--fix"], |data| {
            let set = data.join("in");
            copy(&fixture().id, &set);
            fs::write(set.join("episodes/left.mcap.partial"), "torn").expect("a folder of ours");
        }),
        other("predict", &["predict", "small", "--data", &set, "--out", &out], |data| {
            copy(&fixture().id, &data.join("in"));
        }),
        other("eval", &["eval", "small", "--data", &set, "--out", &out], |data| {
            copy(&fixture().id, &data.join("in"));
        }),
    ]
}

/// Fails calls of each, all of them or so many at even distances.
fn fail(most: Option<usize>) -> Vec<(&'static str, Outcome)> {
    let home = tempfile::tempdir().expect("a temporary folder");
    let snapshots = tempfile::tempdir().expect("a temporary folder");
    let data = home.path().join("data");
    let mut outcomes = Vec::new();
    for Other { name, words, prepare } in others(&data) {
        let [before, after] = ["before", "after"].map(|of| snapshots.path().join(format!("{name}-{of}")));
        fs::create_dir(&before).expect("a folder of ours");
        if data.exists() {
            fs::remove_dir_all(&data).expect("a folder of ours");
        }
        prepare(&before);
        copy(&before, &data);
        let mut outcome = Outcome::default();
        let mut counted = command(&words.iter().map(String::as_str).collect::<Vec<_>>());
        let Some(counter) = with_fault(&mut counted, &data, Fault::None) else { return outcomes };
        assert!(counted.output().expect("the program starts").status.success(), "{name}");
        assert_ne!(hashes(&data), hashes(&before), "{name}");
        outcome.n_calls = counter.n_calls();
        copy(&data, &after);
        let step = most.map_or(1, |most| (outcome.n_calls as usize / most).max(1));
        for number in (0..outcome.n_calls).step_by(step) {
            tell_progress(name, EIO, number, outcome.n_calls);
            check(&words, home.path(), &before, &after, Fault::Call { number, errno: EIO }, &mut outcome);
        }
        if outcomes.is_empty() {
            Outcome::print_head();
        }
        outcome.print(name);
        outcomes.push((name, outcome));
    }
    outcomes
}

#[test]
fn an_error_at_some_calls_of_the_other_commands_loses_nothing_in_silence() {
    assert_unharmed(&fail(Some(2)));
}

#[test]
#[ignore = "half an hour: make soak ROWS=io_others"]
fn long_io_others() {
    let most = std::env::var_os("HARMZONE_FAULTS").map(|_| n_faults(0));
    let outcomes = fail(most);
    assert!(outcomes.iter().all(|(_, outcome)| outcome.n_calls > 0));
    assert_unharmed(&outcomes);
}
