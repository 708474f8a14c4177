//! A program that answers, and the ways in which one fails.

use super::*;
use crate::dataset::test_data;

fn ask(command: &str, reply_s: f64) -> Result<Vec<Detection>, ExternalError> {
    let mut external = External::start(command, reply_s)?;
    external.detect("an-episode", 3, &test_data::dataset(1).samples()[0].measured)
}

/// Reads three messages and prints what is given.
fn answering(print: &str) -> String {
    format!(
        "python3 -c \"\nimport struct, sys\ni, o = sys.stdin.buffer, sys.stdout.buffer\n\
         [i.read(struct.unpack('<I', i.read(4))[0]) for _ in range(3)]\n{print}\no.flush()\""
    )
}

#[test]
fn a_program_that_answers_is_understood() {
    let print = "b = b'{\\\"detections\\\": [{\\\"center_m\\\": [9, 0, 1], \\\"size_m\\\": [1, 2, 3], \
                 \\\"yaw_rad\\\": 0, \\\"harm\\\": \\\"harmful\\\", \\\"score\\\": 0.5}]}'\n\
                 o.write(struct.pack('<I', len(b)) + b)";
    let found = ask(&answering(print), 10.0).unwrap();
    let [found] = found[..] else { panic!("{found:?}") };
    assert_eq!((found.box_in_ego.width_m, found.score), (2.0, 0.5));
}

#[test]
fn one_that_hangs_ends_with_whoever_asked_it() {
    let mut external = External::start("sleep 600", 0.02).unwrap();
    // As at the end of this process.
    drop(external.guard.stdin.take());
    let n_looks = (0..N_LOOKS).find(|_| {
        std::thread::sleep(LOOK);
        external.process.try_wait().unwrap().is_some()
    });
    assert!(n_looks.is_some(), "it runs on");
}

#[test]
fn the_header_does_not_tell_what_a_scenario_is_called() {
    let data = test_data::dataset(1);
    let measured = &data.samples()[0].measured;
    let of = |name: &str| serde_json::to_string(&header(name, 0, measured)).unwrap();
    assert!(!of("bag_beside_1").contains("bag"));
    assert_ne!(of("bag_beside_1"), of("bag_beside_2"));
}

#[test]
fn one_that_dies_hangs_or_talks_nonsense_is_told_apart() {
    let error = ask("exit 3", 5.0).unwrap_err();
    assert!(matches!(error, ExternalError::Ended { .. }), "{error}");
    let error = ask("echo no such weights >&2; exit 3", 5.0).unwrap_err().to_string();
    assert!(error.contains("exit status: 3") && error.contains("no such weights"), "{error}");
    let chatty = "head -c 300000 /dev/zero | tr '\\0' x >&2; echo the end >&2; exit 3";
    let error = ask(chatty, 20.0).unwrap_err().to_string();
    assert!(error.contains("the end") && error.len() < 100_000, "{} bytes", error.len());
    let error = ask("sleep 60", 0.02).unwrap_err();
    assert!(matches!(error, ExternalError::Late { .. }), "{error}");
    // More than a pipe holds, to a program that never reads.
    let mut measured = test_data::dataset(1).samples()[0].measured.clone();
    measured.image.bytes = vec![0; 1 << 20];
    let error = External::start("sleep 60", 0.02).unwrap().detect("a", 0, &measured).unwrap_err();
    assert!(matches!(error, ExternalError::Late { .. }), "{error}");
    let error = ask(&answering("print('hello, this is a log line')"), 10.0).unwrap_err().to_string();
    assert!(error.contains("is a print in the way"), "{error}");
    let of_json = |json: &str| {
        let print = format!("b = b'{json}'\no.write(struct.pack('<I', len(b)) + b)");
        ask(&answering(&print), 10.0).unwrap_err().to_string()
    };
    assert!(of_json("[]").contains("not usable"), "{}", of_json("[]"));
    let flat = "{\\\"detections\\\": [{\\\"center_m\\\": [9, 0, 1], \\\"size_m\\\": [1, 0, 3], \
                \\\"yaw_rad\\\": 0, \\\"harm\\\": \\\"harmful\\\", \\\"score\\\": 0.5}]}";
    assert!(of_json(flat).contains("width_m is 0"), "{}", of_json(flat));
    let vast = flat.replace("[1, 0, 3]", "[1e200, 1e200, 3]");
    assert!(of_json(&vast).contains("at most 10000 m"), "{}", of_json(&vast));
    // What a recorded drive would not take, none takes.
    let whole = flat.replace("[1, 0, 3]", "[1, 2, 3]");
    let narrow = whole.replace("\\\"score\\\"", "\\\"spread\\\": {\\\"x_m\\\": -1, \\\"y_m\\\": 1, \\\"z_m\\\": 1, \\\"length\\\": 1, \\\"width\\\": 1, \\\"height\\\": 1, \\\"yaw_rad\\\": 1}, \\\"score\\\"");
    assert!(of_json(&narrow).contains("box 0: spread.x_m is -1"), "{}", of_json(&narrow));
    let of_another = whole.replacen('{', "{\\\"sample_idx\\\": 2, ", 1);
    assert!(of_json(&of_another).contains("sample 3 was asked for"), "{}", of_json(&of_another));
}

/// One box, in JSON for [`answering`].
const ONE: &str = "{\\\"center_m\\\": [9, 0, 1], \\\"size_m\\\": [1, 2, 3], \\\"yaw_rad\\\": 0, \\\"harm\\\": \\\"harmful\\\", \\\"score\\\": 0.5}";

#[test]
fn an_answer_may_come_in_pieces_and_must_come_whole() {
    let told = format!("b = b'{{\\\"detections\\\": [{ONE}]}}'\nm = struct.pack('<I', len(b)) + b\n");
    let in_pieces = format!("{told}for i in range(len(m)): o.write(m[i:i + 1]); o.flush()");
    assert_eq!(ask(&answering(&in_pieces), 10.0).unwrap().len(), 1);
    for part in ["m[:2]", "m[:20]"] {
        let error = ask(&answering(&format!("{told}o.write({part})")), 10.0).unwrap_err().to_string();
        assert!(error.contains("it ended within a message"), "{error}");
    }
}

#[test]
fn an_answer_that_nobody_asked_for_is_told_at_the_next_sample() {
    let print = "b = b'{\\\"detections\\\": []}'\n[o.write(struct.pack('<I', len(b)) + b) for _ in range(2)]\no.flush()\ni.read()";
    let mut external = External::start(&answering(print), 10.0).unwrap();
    let data = test_data::dataset(1);
    let measured = &data.samples()[0].measured;
    external.detect("a", 0, measured).unwrap();
    std::thread::sleep(Duration::from_millis(500));
    let error = external.detect("a", 1, measured).unwrap_err().to_string();
    assert!(error.contains("an answer to no sample"), "{error}");
}

#[test]
fn numbers_without_end_and_boxes_without_number_are_refused() {
    let of = |print: &str| ask(&answering(print), 10.0).unwrap_err().to_string();
    for number in ["NaN", "1e999", "-Infinity"] {
        let print = format!(
            "b = b'{{\\\"detections\\\": [{}]}}'\no.write(struct.pack('<I', len(b)) + b)",
            ONE.replacen('9', number, 1)
        );
        let error = of(&print);
        assert!(error.contains("not usable"), "{number}: {error}");
    }
    let many = format!(
        "b = b'{{\\\"detections\\\": [' + b', '.join([b'{ONE}'] * 1001) + b']}}'\no.write(struct.pack('<I', len(b)) + b)"
    );
    assert!(of(&many).contains("1001 boxes; at most 1000"), "{}", of(&many));
}

#[test]
fn one_that_closes_its_output_and_runs_on_is_told() {
    let error = ask("exec >&-; sleep 60", 30.0).unwrap_err().to_string();
    assert!(error.contains("closed its standard output and runs on"), "{error}");
}

#[test]
fn of_endless_words_the_end_is_kept() {
    let mut external = External::start("yes a warning >&2", 0.05).unwrap();
    let data = test_data::dataset(1);
    let error = external.detect("a", 0, &data.samples()[0].measured).unwrap_err().to_string();
    assert!(error.contains("no answer within") && error.contains("a warning"), "{error}");
    assert!(error.len() < 2_000, "{} bytes", error.len());
    assert!(external.stderr.bytes.lock().unwrap().len() <= STDERR_TAIL_BYTES as usize);
}

#[test]
fn what_a_detector_has_started_ends_with_it() {
    let mut external = External::start("sleep 600 & echo $! >&2; wait", 0.05).unwrap();
    let data = test_data::dataset(1);
    external.detect("a", 0, &data.samples()[0].measured).unwrap_err();
    let child: u32 = external.stderr.last_lines().trim().parse().unwrap();
    let runs = || {
        let stat = fs_err::read_to_string(format!("/proc/{child}/stat")).unwrap_or_default();
        !stat.is_empty() && !stat.contains(") Z ")
    };
    assert!(runs());
    drop(external);
    let n_looks = (0..N_LOOKS).find(|_| {
        std::thread::sleep(LOOK);
        !runs()
    });
    assert!(n_looks.is_some(), "it runs on");
}
