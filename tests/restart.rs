//! What is killed and called again ends with the same bytes, and so does the same seed in more processes. Needs what
//! `make setup` makes.

mod made_data;

use std::path::Path;

use fs_err as fs;
use harmzone::episode::Manifest;
use made_data::{
    Fixture, TINY, command, done, episodes, fail, fails, fixture, generate, generation, kill_when_filled,
    succeed, text,
};

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

/// What a processor with fewer instructions would have the libraries do: the C library, numpy and Mesa's drawing.
const WITHOUT_AVX_512: [(&str, &str); 3] = [
    ("GLIBC_TUNABLES", "glibc.cpu.hwcaps=-AVX512F,-AVX512VL,-AVX512BW,-AVX512DQ,-AVX512CD"),
    ("NPY_DISABLE_CPU_FEATURES", "X86_V4 AVX512F AVX512CD AVX512_SKX AVX512_ICL AVX512_SPR"),
    ("LP_NATIVE_VECTOR_WIDTH", "128"),
];

#[test]
fn episodes_are_the_same_on_a_processor_with_fewer_instructions() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("older");
    let done = command(&generation(&out, "1", &["--episodes", "2"])).envs(WITHOUT_AVX_512).output();
    let done = done.expect("the program starts");
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    assert!(episodes(&out) == episodes(&fixture().id));
    // What may still tell two machines apart stands in the manifest: here, how wide the drawing's vectors are.
    let made_with = |of: &std::path::Path| Manifest::read(of).expect("a manifest").made_with;
    let ([here], [older]) = (&made_with(&fixture().id)[..], &made_with(&out)[..]) else {
        panic!("one machine each")
    };
    assert!(
        here.mujoco.starts_with(char::is_numeric) && here.libc == older.libc && here.cpu == older.cpu,
        "{older:?}"
    );
    assert!(older.opengl.contains("128 bits") && here.opengl != older.opengl, "{here:?}, {older:?}");
}

#[test]
fn training_gives_the_same_bytes_on_one_thread() {
    let Fixture { id, run, .. } = fixture();
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("alone");
    let args = [&["train", text(id), "--out", text(&out)], TINY.as_slice()].concat();
    let done = command(&args).env("RAYON_NUM_THREADS", "1").output().expect("the program starts");
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let read = |of: &std::path::Path| fs::read(of.join("model.safetensors")).expect("the run is whole");
    assert!(read(&out) == read(run));
}

#[test]
fn gen_killed_in_the_middle_and_called_again_ends_with_the_same_bytes() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("killed");
    let args = generation(&out, "1", &["--episodes", "2"]);
    // Once the first episode stands, the second is under way.
    kill_when_filled(&mut command(&args), &out.join("episodes"));
    done(&args);
    assert!(episodes(&out) == episodes(&fixture().id));
}

#[test]
fn train_killed_in_the_middle_and_called_again_ends_with_the_same_bytes() {
    let Fixture { id, run, .. } = fixture();
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("killed");
    let args = [&["train", text(id), "--out", text(&out)], TINY.as_slice()].concat();
    kill_when_filled(&mut command(&args), &out.join("state"));
    done(&args);
    for file in ["model.safetensors", "log.csv"] {
        assert!(
            fs::read(out.join(file)).expect("the run is whole")
                == fs::read(run.join(file)).expect("the run is whole"),
            "{file} differs"
        );
    }
}

#[test]
fn shards_that_are_merged_are_what_one_run_makes() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = |name: &str| folder.path().join(name);
    let shards = [path("a"), path("b")];
    for (shard, out) in ["0/2", "1/2"].into_iter().zip(&shards) {
        generate(out, "1", &["--episodes", "2", "--shard", shard]);
        done(&["label", text(out)]);
        assert_eq!(episodes(out).len(), 1);
    }
    let whole = path("whole");
    let args = ["merge", text(&shards[1]), text(&shards[0]), "--out", text(&whole)];
    assert!(done(&args).contains("episodes  2"));
    assert!(episodes(&whole) == episodes(&fixture().id));
    for file in ["dataset.json", "gen.toml", "labels/rect/labels.json"] {
        let read = |folder: &std::path::Path| fs::read(folder.join(file)).expect("a data set with labels");
        assert!(read(&whole) == read(&fixture().id), "{file} differs");
    }
    let half = path("half");
    let args = ["merge", text(&shards[1]), "--out", text(&half)];
    assert!(fails(&args).contains("--shard 0/2"), "the command that makes the rest is told");
}

#[test]
fn a_training_that_barely_fits_keeps_its_bound_or_ends_with_its_state_and_its_bytes_are_the_same() {
    let Fixture { id, run, .. } = fixture();
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("run");
    let train = |bound: Option<String>| {
        let mut words = vec!["train", text(id), "--out", text(&out)];
        words.extend(TINY);
        let mut command = command(&words);
        command.args(bound.iter().flat_map(|gib| ["--max-memory", gib]));
        command
    };
    let told = fail(&mut train(Some("0.1".to_owned())));
    let number = |after: &str| {
        let (_, rest) = told.split_once(after).unwrap_or_else(|| panic!("{after} is not in {told}"));
        let digits = rest.chars().take_while(char::is_ascii_digit).collect::<String>();
        digits.parse::<f64>().expect("a number of MiB")
    };
    let least_mib = number("needs about ");
    assert!(told.contains("--max-memory") && !out.exists(), "{told}");
    // The step is reckoned; what it takes beyond may pass a bound that is no wider.
    let mut n_ended = 0;
    for share in [1.02, 1.1, 1.3] {
        let gib = format!("{:.4}", share * least_mib / 1024.0);
        let output = train(Some(gib)).output().expect("the program runs");
        if output.status.success() {
            break;
        }
        let told = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(told.contains("--max-memory"), "{told}");
        // What a process holds before its first step is not the same twice.
        if told.contains("needs about") {
            continue;
        }
        let is_saved = fs::read_dir(out.join("state")).is_ok_and(|mut states| states.next().is_some());
        assert!(is_saved, "its state is not kept: {told}");
        n_ended += 1;
    }
    succeed(&mut train(None));
    let bytes = |run: &Path| fs::read(run.join("model.safetensors")).expect("a network");
    assert!(bytes(&out) == bytes(run), "after {n_ended} runs that passed their bound");
}
