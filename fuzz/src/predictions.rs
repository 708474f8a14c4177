//! Boxes that other tools found: our own JSON, nuScenes' results, KITTI's rows.

use harmzone::eval::json::{RawSamples, join, read_predictions, read_truth, write_predictions, write_truth};
use harmzone::eval::{Mode, Protocol, evaluate};
use harmzone::exchange::{
    HarmRule, ImportPredictions, import_predictions, kitti::KittiReader, nuscenes::ResultsReader,
};
use harmzone::progress::Silent;
use harmzone::zone::{Zone, ZoneConfig};

use super::made_episode::{Made, dataset};
use super::scratch;

/// KITTI's name of the made data set's first frame.
const FRAME: &str = "000000";

thread_local! {
    static MADE: Made = dataset("predictions/data");
}

/// First byte modulo 4: our JSON, nuScenes' results, or KITTI's rows, with harm by names; then by the zone from 4 on.
pub fn predictions(bytes: &[u8]) {
    let Some((kind, rest)) = scratch::split(bytes) else { return };
    match kind % 4 {
        0 | 3 => own(rest),
        1 => {
            let path = scratch::write("predictions/results.json", rest);
            MADE.with(|made| {
                let mut reader = match ResultsReader::open(&path, &made.dataset) {
                    Ok(reader) => reader,
                    Err(error) => return scratch::tell(&error),
                };
                bring_in(made, kind, &mut reader);
            });
        }
        _ => {
            let path = scratch::write(&format!("predictions/rows/{FRAME}.txt"), rest);
            scratch::write("predictions/rows/000001.txt", b"");
            MADE.with(|made| {
                let folder = path.parent().expect("it lies in a folder");
                let Ok(mut reader) = KittiReader::open(folder, &made.dataset) else { return };
                bring_in(made, kind, &mut reader);
            });
        }
    }
}

fn bring_in(made: &Made, kind: usize, reader: &mut dyn harmzone::exchange::ReadBoxes) {
    let zone = || Zone::try_from(ZoneConfig::default()).expect("the default is valid");
    let harm = if kind & 4 == 0 { HarmRule::Names } else { HarmRule::Zone(Box::new(zone())) };
    let out = scratch::empty_folder("predictions/out");
    let request = ImportPredictions { data: &made.dataset, split: None, harm, out: &out, force: true };
    if let Err(error) = import_predictions(&request, reader, &Silent) {
        scratch::tell(&error);
    }
}

/// The file as predictions and as truth, scored against itself.
fn own(text: &[u8]) {
    let path = scratch::write("predictions/boxes.json", text);
    let (found, truth) = (read_predictions(&path), read_truth(&path));
    let _ = RawSamples::read(&path).map(|samples| samples.n_samples());
    let copy = scratch::place("predictions/copy.json");
    if let Ok(found) = &found {
        let samples = found.samples.iter().map(|(id, boxes)| (id.as_str(), boxes.as_slice()));
        write_predictions(&copy, samples).expect("what was read can be written");
        assert!(read_predictions(&copy).is_ok(), "what was written cannot be read");
    }
    if let (Ok(found), Ok(truth)) = (found, truth)
        && let Ok(samples) = join(found, truth)
    {
        let _ = evaluate(&samples, &Protocol::default(), Mode::Id);
        let _ = evaluate(&samples, &Protocol::default(), Mode::Ood);
        write_truth(&copy, &samples).expect("what was read can be written");
    }
}
