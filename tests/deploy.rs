//! Work in parts, without a coordinator: the shards of `label` and `predict`, and the templates of `deploy/` as far as a machine
//! without a cluster can try them, with stand-ins for sbatch and srun that run each task here. Needs what `make setup` makes.

mod made_data;

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;

use fs_err as fs;
use harmzone::files::sha256_of;
use made_data::{done, fails, text};

const ROOT: &str = env!("CARGO_MANIFEST_DIR");
const WORLD: [&str; 10] =
    ["--preset", "demo", "--town", "oldtown", "--episodes", "3", "--samples", "1", "--seed", "4"];

/// The data set of one run of `gen`, labelled.
fn whole() -> &'static Path {
    static FOLDER: OnceLock<tempfile::TempDir> = OnceLock::new();
    let folder = FOLDER.get_or_init(|| {
        let folder = tempfile::tempdir().expect("a folder can be made");
        let path = text(folder.path());
        done(&[&["gen", "--out", path], &WORLD[..]].concat());
        done(&["label", path]);
        folder
    });
    folder.path()
}

/// A machine with the stand-ins and the program in its PATH.
struct Slurm {
    folder: tempfile::TempDir,
}

impl Slurm {
    fn new() -> Self {
        let folder = tempfile::tempdir().expect("a folder can be made");
        fs::create_dir(folder.path().join("bin")).expect("it is new");
        std::os::unix::fs::symlink(made_data::program(), folder.path().join("bin/harmzone"))
            .expect("it is new");
        fs::write(folder.path().join("jobs"), "").expect("it can be written");
        Self { folder }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn command(&self, program: impl AsRef<Path>) -> Command {
        let mut path = OsString::from(self.path("bin"));
        path.push(format!(":{ROOT}/tests/data/slurm:"));
        path.push(std::env::var_os("PATH").unwrap_or_default());
        let mut command = Command::new(program.as_ref());
        command.env("PATH", path).env("FAKE_SLURM", self.folder.path()).current_dir(self.folder.path());
        command
    }

    fn submit(&self, words: &[&str]) -> Output {
        let mut command = self.command(format!("{ROOT}/deploy/slurm/submit.sh"));
        command.args(words).output().expect("the script starts")
    }

    fn jobs(&self) -> String {
        fs::read_to_string(self.path("jobs")).expect("the stand-in writes it")
    }
}

/// The hash of every file below a folder.
fn hashes(folder: &Path) -> BTreeMap<PathBuf, String> {
    let mut found = BTreeMap::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(inner) = folders.pop() {
        for entry in fs::read_dir(inner).expect("it is a folder") {
            let path = entry.expect("it can be read").path();
            if path.is_dir() {
                folders.push(path);
            } else {
                let name = path.strip_prefix(folder).expect("it is below").to_owned();
                found.insert(name, sha256_of(&path).expect("it can be read"));
            }
        }
    }
    found
}

/// A copy of the data set without labels.
fn unlabelled(folder: &Path) -> PathBuf {
    let data = folder.join("data");
    let copied = Command::new("cp").arg("-r").arg(whole()).arg(&data).status().expect("cp starts");
    assert!(copied.success());
    fs::remove_dir_all(data.join("labels")).expect("the data set is labelled");
    data
}

#[test]
fn an_array_of_slurm_makes_the_data_set_of_one_machine_also_after_a_shard_failed() {
    let slurm = Slurm::new();
    // The node of shard 1 fails; what depends on the array does not begin.
    fs::write(slurm.path("refuse"), "1\n").unwrap();
    let told = slurm.submit(&[&["out", "2"], &WORLD[..]].concat());
    assert!(told.status.success(), "{}", String::from_utf8_lossy(&told.stderr));
    let said = String::from_utf8_lossy(&told.stdout).into_owned();
    assert!(said.contains("job 1, 0 to 1") && said.contains("job 2"), "{said}");
    assert_eq!(slurm.jobs(), "1 failed (no)\n2 failed (no: DependencyNeverSatisfied)\n");

    // The one shard again, and then the merge, as the template says.
    fs::remove_file(slurm.path("refuse")).unwrap();
    let send = |words: &[&str]| {
        let mut command = slurm.command(format!("{ROOT}/tests/data/slurm/sbatch"));
        command.env("OUT", slurm.path("out")).env("SHARDS", "2");
        assert!(command.args(words).status().unwrap().success());
    };
    let gen_script = format!("{ROOT}/deploy/slurm/gen.sbatch");
    send(&[&["--array=1-1", gen_script.as_str()], &WORLD[..]].concat());
    send(&[&format!("{ROOT}/deploy/slurm/merge.sbatch")]);
    let log = fs::read_to_string(slurm.path("4.log")).unwrap_or_default();
    assert!(slurm.jobs().ends_with("3 ok\n4 ok\n"), "{}\n{log}", slurm.jobs());

    assert_eq!(hashes(&slurm.path("out/data")), hashes(whole()));
}

#[test]
fn wrong_usage_of_the_slurm_template_is_told_and_sends_nothing() {
    let slurm = Slurm::new();
    for words in [&["out"][..], &["out", "none", "--seed", "1"], &["out", "0"]] {
        let told = slurm.submit(words);
        assert_eq!(told.status.code(), Some(2));
        assert!(String::from_utf8_lossy(&told.stderr).contains("usage:"));
    }
    assert_eq!(slurm.jobs(), "");
    // Outside of an array there is no shard.
    let mut command = slurm.command("bash");
    command.arg(format!("{ROOT}/deploy/slurm/gen.sbatch")).env("OUT", "x").env("SHARDS", "2");
    let told = command.env_remove("SLURM_ARRAY_TASK_ID").output().unwrap();
    assert!(!told.status.success() && String::from_utf8_lossy(&told.stderr).contains("array job"));
}

#[test]
fn labels_in_parts_are_the_labels_of_one_run() {
    let folder = tempfile::tempdir().unwrap();
    let data = unlabelled(folder.path());
    let path = text(&data);
    let first: serde_json::Value =
        serde_json::from_str(&done(&["label", path, "--shard", "0/2", "--json"])).unwrap();
    assert_eq!((&first["n_episodes"], &first["was_complete"]), (&2.into(), &false.into()));
    let again = done(&["label", path, "--shard", "0/2", "--json"]);
    assert!(again.contains("\"was_complete\": true"), "{again}");
    // A part is no set yet.
    assert!(!data.join("labels/rect/labels.json").exists());
    done(&["label", path, "--shard", "1/2"]);
    let kept = fs::metadata(data.join("labels/rect/part-1-of-2.json")).unwrap();
    assert!(kept.is_file());
    // The join labels nothing anew: the files are the ones that are there.
    let mut old = fs::read_dir(data.join("labels/rect")).unwrap().map(|entry| entry.unwrap().path());
    let old = old.find(|path| path.extension().is_some_and(|suffix| suffix == "mcap")).unwrap();
    let before = fs::metadata(&old).unwrap().modified().unwrap();
    done(&["label", path]);
    assert_eq!(fs::metadata(&old).unwrap().modified().unwrap(), before);
    assert_eq!(hashes(&data), hashes(whole()));

    // Of a torn part everything is made anew.
    fs::remove_dir_all(data.join("labels")).unwrap();
    done(&["label", path, "--shard", "0/2"]);
    fs::write(&old, "torn").unwrap();
    done(&["label", path]);
    assert_eq!(hashes(&data), hashes(whole()));
}

/// Numbers to 12 digits: in a file of boxes a yaw is a quaternion.
fn rounded(value: serde_json::Value) -> serde_json::Value {
    match value {
        serde_json::Value::Number(number) => format!("{:.12}", number.as_f64().expect("a number")).into(),
        serde_json::Value::Array(values) => values.into_iter().map(rounded).collect(),
        serde_json::Value::Object(of) => of.into_iter().map(|(key, value)| (key, rounded(value))).collect(),
        other => other,
    }
}

#[test]
fn predictions_in_parts_are_those_of_one_run_and_what_is_wrong_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| text(&folder.path().join(name)).to_owned();
    let of = |more: &[&str]| {
        let data = text(whole());
        done(&[&["predict", "small", "--data", data, "--split", "train"], more].concat())
    };
    of(&["--out", &path("whole")]);
    for index in 0..2 {
        of(&["--out", &path(&format!("part{index}")), "--shard", &format!("{index}/2")]);
    }
    let (zero, one, all) = (path("part0"), path("part1"), path("all"));
    let told = fails(&["merge", &one, "--out", &all]);
    assert!(told.contains("1 of 2 parts are missing") && told.contains("--shard 0/2"), "{told}");
    let told = fails(&["merge", &one, &one, "--out", &all]);
    assert!(told.contains("given twice"), "{told}");
    done(&["merge", &one, &zero, "--out", &all]);
    assert_eq!(hashes(Path::new(&all)), hashes(Path::new(&path("whole"))));
    let told = fails(&["merge", &zero, &one, "--out", &all]);
    assert!(told.contains("new folder"), "{told}");

    // Scores of the joined boxes are those of the network itself, but for what hangs on the score that it warns from and
    // on its spreads, which a file of boxes does not hold.
    let eval = |words: &[&str], out: &str| {
        let data = ["--data", text(whole()), "--split", "train", "--out", out];
        done(&[&["eval"], words, &data[..]].concat());
        let scores = fs::read_to_string(Path::new(out).join("metrics.json")).unwrap();
        let scores: serde_json::Value = serde_json::from_str(&scores).unwrap();
        ["total", "per_threshold", "curves", "tp_errors"].map(|part| {
            assert!(scores[part].is_object(), "{part}");
            if part == "tp_errors" { rounded(scores[part].clone()) } else { scores[part].clone() }
        })
    };
    let mine = eval(&["--predictions", &format!("{all}/predictions.json")], &path("e1"));
    assert_eq!(mine, eval(&["small"], &path("e2")));

    let torn = folder.path().join("part1");
    let file = fs::read_dir(&torn).unwrap().map(|entry| entry.unwrap().path());
    let file = file.filter(|path| path.extension().is_some_and(|suffix| suffix == "mcap")).min().unwrap();
    fs::write(&file, "torn").unwrap();
    let told = fails(&["merge", &zero, &one, "--out", &path("new")]);
    assert!(told.contains("not as it was written") && told.contains(text(&file)), "{told}");
    let other = path("other");
    of(&["--out", &other, "--shard", "1/3"]);
    let told = fails(&["merge", &zero, &other, "--out", &path("new")]);
    assert!(told.contains("number of parts") && told.contains("wanted 2"), "{told}");
}
