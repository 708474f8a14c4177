//! Which samples a message of boxes is the truth of.

use fs_err as fs;
use harmzone::episode::Split;
use harmzone::import::ros2::Ros2Log;
use harmzone::import::{ImportConfig, ImportOptions, LogFormat, run};
use harmzone::progress::Silent;
use mcap::WriteOptions;

use super::{data, plain_mapping};

#[test]
fn a_message_of_boxes_belongs_to_one_cloud() {
    let whole = fs::read(data().join("plain/plain.mcap")).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bag.mcap");
    let mut writer = WriteOptions::new().create(fs::File::create(&path).unwrap()).unwrap();
    let mut n_boxes = 0;
    for message in mcap::MessageStream::new(&whole).unwrap() {
        let message = message.unwrap();
        n_boxes += usize::from(message.channel.topic == "/boxes");
        if message.channel.topic != "/boxes" || n_boxes == 3 {
            writer.write(&message).unwrap();
        }
    }
    writer.finish().unwrap();
    // Five clouds 0.1 s apart lie within the tolerance of the one message of boxes.
    let config = ImportConfig { stamp_tolerance_s: 0.25, ..ImportConfig::shipped(LogFormat::Ros2) };
    let log = Ros2Log::open(&path, Some(plain_mapping()), &config).unwrap();
    let options = ImportOptions { scenes: Vec::new(), split: Split::Test, skip_bad: false, force: false };
    let summary = run(&log, LogFormat::Ros2, &config, &folder.path().join("out"), &options, &Silent).unwrap();
    assert_eq!((n_boxes, summary.n_samples, summary.n_objects.total()), (5, 1, 2));
}
