//! The pages without a socket: what is answered, to whom, and with which headers.

use std::path::Path;
use std::sync::Arc;

use axum::Router;
use axum::body::{Body, to_bytes};
use axum::http::{HeaderMap, Method, Request, StatusCode, header};
use fs_err as fs;
use serde_json::Value;
use tower::ServiceExt as _;

use super::access::{AccessToken, Gate};
use super::folder::ServedFolder;
use super::routes::router;
use super::sets::SetOptions;
use super::site::{ServedSite, WantedSets};
use crate::dataset::test_data;
use crate::episode::{
    DetectionReader, DetectionWriter, DriveLogWriter, LabelReader, Manifest, SampleCommand, SampleDetections,
    SourceMeta,
};
use crate::files::write_sealed;
use crate::object::{Detection, Harm};
use crate::outcome::{DRIVING, Origin};
use crate::progress::Silent;

const HOST: &str = "127.0.0.1:4321";

/// A served folder with one data set in `data`.
struct Served {
    folder: tempfile::TempDir,
    runtime: tokio::runtime::Runtime,
    site: Arc<ServedSite>,
    wanted: Option<WantedSets>,
    router: Router,
    token: String,
}

/// What came back.
struct Answer {
    status: StatusCode,
    headers: HeaderMap,
    body: Vec<u8>,
}

impl Served {
    /// Serves episodes of so many samples; `prepare` may change the folder before.
    fn new(n_samples: &[usize], prepare: impl FnOnce(&Path)) -> Self {
        Self::with(n_samples, prepare, &SetOptions::default())
    }

    fn with(n_samples: &[usize], prepare: impl FnOnce(&Path), options: &SetOptions) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let data = folder.path().join("data");
        fs::create_dir(&data).unwrap();
        test_data::write(&data, n_samples);
        prepare(folder.path());
        let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build().unwrap();
        let served = ServedFolder::open(folder.path()).unwrap();
        let (site, wanted) = ServedSite::open(served, options).unwrap();
        let gate = Gate { token: AccessToken::draw().unwrap(), port: 4321 };
        let token = gate.token.as_str().to_owned();
        let router = router(site.clone(), gate);
        Self { folder, runtime, site, wanted: Some(wanted), router, token }
    }

    fn ask(&self, request: Request<Body>) -> Answer {
        self.runtime.block_on(async {
            let response = self.router.clone().oneshot(request).await.unwrap();
            let (parts, body) = response.into_parts();
            let body = to_bytes(body, usize::MAX).await.unwrap().to_vec();
            Answer { status: parts.status, headers: parts.headers, body }
        })
    }

    fn request(&self, path: &str) -> axum::http::request::Builder {
        Request::builder().uri(format!("{path}?token={}", self.token)).header(header::HOST, HOST)
    }

    fn get(&self, path: &str) -> Answer {
        self.ask(self.request(path).body(Body::empty()).unwrap())
    }

    fn json(&self, path: &str) -> Value {
        let answer = self.get(path);
        assert_eq!(answer.status, StatusCode::OK, "{path}: {}", String::from_utf8_lossy(&answer.body));
        serde_json::from_slice(&answer.body).unwrap()
    }

    /// Reads all sets that were asked for.
    fn read_through(&mut self) {
        self.site.stop();
        let wanted = self.wanted.take().unwrap();
        std::thread::scope(|scope| scope.spawn(|| self.site.read_through(wanted, &Silent)).join().unwrap());
    }
}

/// Boxes for every episode of the data set: each truth as it is, but every first harmful one of a sample called harmless,
/// and one box where nothing is.
fn predict(data: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    fs::write(to.join("predictions.json"), b"{}").unwrap();
    for entry in Manifest::read(data).unwrap().episodes {
        let reader = crate::episode::EpisodeReader::open_entry(data, &entry).unwrap();
        let labels =
            LabelReader::open(&data.join("labels/rect").join(format!("{}.mcap", entry.name))).unwrap();
        let meta = SourceMeta {
            episode: entry.name.clone(),
            episode_sha256: entry.sha256.clone(),
            set: "made".into(),
            config_toml: String::new(),
            generator_version: String::new(),
        };
        let file = to.join(format!("{}.mcap", entry.name));
        let mut writer = DetectionWriter::create(&file, &meta).unwrap();
        for (sample, labels) in reader.samples().zip(labels.samples()) {
            let sample = sample.unwrap();
            let detection = |box_in_ego, harm, score| Detection {
                box_in_ego,
                velocity_in_ego_mps: [0.0; 2],
                harm,
                score,
                spread: None,
            };
            let mut has_missed = false;
            let truths = sample.objects().iter().zip(&labels.labels);
            let mut detections: Vec<Detection> = truths
                .map(|(object, label)| {
                    let is_harmful = label.harm == Harm::Harmful;
                    let is_miss = is_harmful && !has_missed;
                    has_missed |= is_harmful;
                    detection(object.box_in_ego, if is_miss { Harm::Harmless } else { label.harm }, 0.75)
                })
                .collect();
            let mut nowhere = sample.objects()[0].box_in_ego;
            nowhere.center = crate::geometry::Point::new(20.0, -40.0, 1.0);
            detections.push(detection(nowhere, Harm::Harmful, 0.5));
            detections.push(detection(nowhere, Harm::Harmful, 0.01)); // below the score that counts
            writer.write(&SampleDetections { time_ns: sample.measured.time_ns, detections }).unwrap();
        }
        writer.finish().unwrap();
        assert!(DetectionReader::open(&file).is_ok());
    }
}

/// Leaves in a data set what `drive` does: the boxes of [`predict`] as logs, and who drove.
fn drive(data: &Path, who: &str, seen_from: f64) {
    let logs = data.join("predictions");
    predict(data, &logs);
    fs::remove_file(logs.join("predictions.json")).unwrap();
    let origin = Origin {
        who: who.parse().unwrap(),
        sha256: String::new(),
        min_score: Some(0.9),
        seen_from: Some(seen_from),
        generator_version: String::new(),
        driving: DRIVING,
        device: "cpu".into(),
        cpus: Vec::new(),
    };
    write_sealed(&data.join("who.json"), &origin).unwrap();
    for entry in Manifest::read(data).unwrap().episodes {
        let file = logs.join(format!("{}.mcap", entry.name));
        let boxes = DetectionReader::open(&file).unwrap();
        fs::remove_file(&file).unwrap();
        let meta = SourceMeta { set: origin.who.name.clone(), ..boxes.meta().clone() };
        let mut log = DriveLogWriter::create(&file, &meta).unwrap();
        for sample in boxes.samples() {
            let time_ns = sample.time_ns;
            let command = SampleCommand { time_ns, braking_mps2: None, speed_mps: 5.0, is_harmful: false };
            log.write(sample, Some(&command)).unwrap();
        }
        log.finish().unwrap();
    }
}

#[test]
fn every_answer_carries_the_policy_and_only_the_front_gives_the_cookie() {
    let served = Served::new(&[1], |folder| fs::write(folder.join("report.html"), "<p>told</p>").unwrap());
    let paths =
        ["/", "/page.js", "/icon.svg", "/api/folder", "/reports/0", "/absent", "/api/sets/7/episodes"];
    for path in paths {
        let answer = served.get(path);
        let policy = answer.headers[header::CONTENT_SECURITY_POLICY].to_str().unwrap();
        assert!(
            policy.contains("default-src 'none'") && policy.contains("base-uri 'none'"),
            "{path}: {policy}"
        );
        assert_eq!(policy.starts_with("sandbox "), path == "/reports/0", "{path}");
        // Reports hold pictures and clips in themselves.
        for held in ["img-src data:;", "media-src data:;"] {
            assert_eq!(policy.contains(held), path == "/reports/0", "{path}: {policy}");
        }
        assert!(!policy.contains("allow-same-origin") && !policy.contains("unsafe-eval"));
        assert_eq!(answer.headers[header::X_CONTENT_TYPE_OPTIONS], "nosniff");
        assert_eq!(answer.headers[header::REFERRER_POLICY], "no-referrer");
        assert!(!answer.headers.contains_key(header::ACCESS_CONTROL_ALLOW_ORIGIN));
        assert_eq!(answer.headers.contains_key(header::SET_COOKIE), path == "/", "{path}");
    }
    let cookie = served.get("/").headers[header::SET_COOKIE].to_str().unwrap().to_owned();
    assert!(cookie.ends_with("; HttpOnly; SameSite=Strict; Path=/"), "{cookie}");
    let with_cookie = Request::builder().uri("/api/folder").header(header::HOST, HOST);
    let with_cookie = with_cookie.header(header::COOKIE, cookie.split(';').next().unwrap());
    assert_eq!(served.ask(with_cookie.body(Body::empty()).unwrap()).status, StatusCode::OK);
}

#[test]
fn a_refused_request_reaches_nothing_and_heads_have_no_body() {
    let served = Served::new(&[1], |_| {});
    let bare = Request::builder().uri("/api/folder").header(header::HOST, HOST).body(Body::empty()).unwrap();
    let answer = served.ask(bare);
    assert_eq!(answer.status, StatusCode::FORBIDDEN);
    assert!(String::from_utf8(answer.body).unwrap().contains("harmzone serve"));
    let other = served.request("/").header(header::HOST, "evil.example");
    assert_eq!(served.ask(other.body(Body::empty()).unwrap()).status, StatusCode::MISDIRECTED_REQUEST);
    for method in [Method::POST, Method::PUT, Method::DELETE, Method::PATCH, Method::OPTIONS] {
        let answer = served.ask(served.request("/api/folder").method(method).body(Body::empty()).unwrap());
        assert_eq!(answer.status, StatusCode::METHOD_NOT_ALLOWED);
        assert_eq!(answer.headers[header::ALLOW], "GET, HEAD");
    }
    let head = served.ask(served.request("/api/folder").method(Method::HEAD).body(Body::empty()).unwrap());
    assert!(head.status == StatusCode::OK && head.body.is_empty());
}

#[test]
fn episodes_are_listed_at_once_and_their_faults_once_they_are_read() {
    let mut served =
        Served::new(&[3, 2], |folder| predict(&folder.join("data"), &folder.join("run/predictions/data")));
    let overview = served.json("/api/folder");
    let set = &overview["sets"][0];
    assert_eq!((&set["name"], &set["labels"]), (&"data, boxes of made".into(), &"rect".into()));
    assert_eq!((&set["detector"], &set["min_score"]), (&"made".into(), &0.2.into()));
    assert_eq!(overview["sets"].as_array().unwrap().len(), 1);

    let list = served.json("/api/sets/0/episodes");
    assert_eq!((&list["n_read"], list["episodes"].as_array().unwrap().len()), (&0.into(), 2));
    let row = &list["episodes"][0];
    assert_eq!((&row["name"], &row["n_samples"], &row["vehicle"]), (&"made-0".into(), &3.into(), &15.into()));
    assert!(row["is_read"] == false && row["missed"].is_null());

    // One that is opened is read at once, whatever the background does.
    let detail = served.json("/api/sets/0/episodes/made-1");
    let numbers = |key: &str| -> Vec<u64> {
        detail["by_sample"][key].as_array().unwrap().iter().map(|n| n.as_u64().unwrap()).collect()
    };
    let (harmful, missed, alarms) = (numbers("harmful"), numbers("missed"), numbers("false_alarms"));
    assert!(harmful.iter().sum::<u64>() > 0, "the made samples have harm");
    assert!(
        missed.iter().zip(&harmful).all(|(&missed, &harmful)| missed == harmful.min(1)),
        "{missed:?} {harmful:?}"
    );
    assert_eq!(alarms, [1, 1]);

    served.json("/api/sets/0/episodes");
    served.site.stop();
    served.wanted.as_mut().unwrap().close();
    assert_eq!(served.json("/api/sets/0/episodes")["n_read"], 1, "a stopped site reads no more by itself");
}

#[test]
fn reading_through_ends_with_every_episode_known() {
    let mut served = Served::new(&[1, 1, 1], |_| {});
    served.json("/api/sets/0/episodes");
    let wanted = served.wanted.take().unwrap();
    std::thread::scope(|scope| {
        let reading = scope.spawn(|| served.site.read_through(wanted, &Silent));
        let begin = std::time::Instant::now();
        while served.json("/api/sets/0/episodes")["n_read"] != 3 {
            assert!(begin.elapsed().as_secs() < 60, "it reads on");
            std::thread::sleep(std::time::Duration::from_millis(5));
        }
        served.site.stop();
        reading.join().unwrap();
    });
    let list = served.json("/api/sets/0/episodes");
    let rows = list["episodes"].as_array().unwrap();
    assert!(
        rows.iter().all(|row| row["is_read"] == true && row["harmful"].is_u64() && row["missed"].is_null())
    );
}

#[test]
fn a_sample_has_facts_picture_and_points_and_marks_its_faults() {
    let served = Served::new(&[2], |folder| predict(&folder.join("data"), &folder.join("found")));
    let base = "/api/sets/0/episodes/made-0/samples/1";
    let facts = served.json(base);
    let objects = facts["objects"].as_array().unwrap();
    let harmful = objects.iter().filter(|of| of["harm"] == "harmful").count();
    let missed: Vec<&Value> = objects.iter().filter(|of| !of["fault"].is_null()).collect();
    assert_eq!(missed.len(), harmful.min(1));
    assert!(missed.iter().all(|of| of["fault"] == "called_harmless" && of["harm"] == "harmful"));
    let detections = facts["detections"].as_array().unwrap();
    assert_eq!(detections.len(), 6, "without that of a low score");
    let alarms: Vec<&Value> = detections.iter().filter(|of| !of["fault"].is_null()).collect();
    assert_eq!((alarms.len(), &alarms[0]["fault"]), (1, &"nothing_there".into()));
    assert_eq!(facts["zone"].as_array().unwrap().len(), 4);

    let image = served.get(&format!("{base}/image"));
    assert_eq!(image.headers[header::CONTENT_TYPE], "image/png");
    assert!(image::load_from_memory(&image.body).is_ok());
    let points = served.get(&format!("{base}/points"));
    assert_eq!(points.body.len() as u64, 6 * facts["n_points"].as_u64().unwrap());
    for (path, told) in [
        ("/api/sets/0/episodes/made-0/samples/2", "there is no sample 2"),
        ("/api/sets/0/episodes/absent/samples/0", "there is no episode `absent`"),
        ("/api/sets/0/episodes/..%2fmade-0/samples/0", "there is no episode `../made-0`"),
        ("/api/sets/1/episodes", "there is no data set 1"),
        ("/api/scores/0", "there is no scores 0"),
        ("/reports/0", "there is no report 0"),
    ] {
        let answer = served.get(path);
        let body = String::from_utf8(answer.body).unwrap();
        assert!(answer.status == StatusCode::NOT_FOUND && body.contains(told), "{path}: {body}");
    }
}

#[test]
fn what_is_torn_or_leads_out_is_told_and_the_rest_is_shown() {
    let outside = tempfile::tempdir().unwrap();
    let mut served = Served::new(&[1, 1, 1, 1], |folder| {
        let file = |i: usize| folder.join(format!("data/episodes/made-{i}.mcap"));
        let bytes = fs::read(file(0)).unwrap();
        fs::write(file(0), &bytes[..bytes.len() / 2]).unwrap();
        let moved = outside.path().join("made-1.mcap");
        fs::copy(file(1), &moved).unwrap();
        fs::remove_file(file(1)).unwrap();
        std::os::unix::fs::symlink(&moved, file(1)).unwrap();
        fs::remove_file(file(2)).unwrap();
        fs::create_dir(folder.join("broken")).unwrap();
        fs::write(folder.join("broken/dataset.json"), b"{ torn").unwrap();
        fs::create_dir(folder.join("scores")).unwrap();
        fs::write(folder.join("scores/metrics.json"), b"{}").unwrap();
    });
    let sets = served.json("/api/folder")["sets"].clone();
    assert!(sets[0]["trouble"].as_str().unwrap().contains("broken/dataset.json"), "{sets}");
    assert_eq!((&sets[1]["trouble"], &sets[1]["n_episodes"]), (&Value::Null, &4.into()));
    for (i, told) in [(0, "made-0.mcap"), (1, "leads out of"), (2, "made-2.mcap")] {
        let detail = served.json(&format!("/api/sets/1/episodes/made-{i}"));
        assert!(detail["trouble"].as_str().unwrap().contains(told), "{detail}");
        let answer = served.get(&format!("/api/sets/1/episodes/made-{i}/samples/0"));
        let body = String::from_utf8(answer.body).unwrap();
        assert!(answer.status == StatusCode::UNPROCESSABLE_ENTITY && body.contains(told), "{body}");
    }
    served.json("/api/sets/1/episodes/made-3/samples/0");
    let answer = served.get("/api/scores/0");
    assert!(answer.status == StatusCode::UNPROCESSABLE_ENTITY);
    assert!(String::from_utf8(answer.body).unwrap().contains("metrics.json"));
    served.read_through();
    assert!(served.folder.path().join("data").is_dir());
}

#[test]
fn the_label_set_and_the_score_that_are_asked_for_are_shown() {
    let found = |folder: &Path| predict(&folder.join("data"), &folder.join("found"));
    let options = |labels: &str, min_score| SetOptions { labels: Some(labels.to_owned()), min_score };
    let served = Served::with(&[1], found, &options("rect", Some(0.6)));
    let detail = served.json("/api/sets/0/episodes/made-0");
    assert_eq!(detail["false_alarms"], 0, "the box where nothing is has a score of 0.5");
    let served = Served::with(&[1], |_| {}, &options("absent", None));
    let set = served.json("/api/folder")["sets"][0].clone();
    assert!(
        set["labels"].is_null() && set["trouble"].as_str().unwrap().contains("no label set `absent`"),
        "{set}"
    );
    assert!(served.json("/api/sets/0/episodes/made-0")["harmful"].is_null());
}

#[test]
fn logs_of_drives_are_boxes_of_their_own_data_set_from_the_score_at_which_the_driver_braked() {
    let served = Served::new(&[2, 1], |folder| {
        // Another driver's drives, which went the same way.
        let other = folder.join("other");
        fs::create_dir(&other).unwrap();
        test_data::write(&other, &[2, 1]);
        // Called as a network inside the program, whose score is another.
        drive(&folder.join("data"), "small=zone:runs/a", 0.3);
    });
    let sets = served.json("/api/folder")["sets"].clone();
    assert_eq!(sets.as_array().unwrap().len(), 2, "{sets}");
    assert_eq!((&sets[0]["name"], &sets[0]["detector"]), (&"data, boxes of small".into(), &"small".into()));
    assert_eq!(sets[0]["min_score"], 0.3);
    assert_eq!((&sets[1]["name"], &sets[1]["detector"]), (&"other".into(), &Value::Null));
    let detail = served.json("/api/sets/0/episodes/made-0");
    assert!(detail["trouble"].is_null() && detail["missed"].is_u64(), "{detail}");
    assert_eq!(detail["false_alarms"], 2, "one in each sample");
    let facts = served.json("/api/sets/0/episodes/made-0/samples/0");
    assert_eq!(facts["detections"].as_array().unwrap().len(), 6, "without that of a low score");
}

#[test]
fn a_folder_with_nothing_to_show_is_refused_and_says_what_would_be_shown() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("notes.txt"), b"nothing").unwrap();
    let open = |path: &Path| ServedSite::open(ServedFolder::open(path)?, &SetOptions::default()).map(drop);
    let told = open(folder.path()).unwrap_err().to_string();
    assert!(told.contains("harmzone gen") && told.contains(folder.path().to_str().unwrap()), "{told}");
    assert!(open(&folder.path().join("absent")).is_err());
}
