//! The files of an export to KITTI, by their paths in its folder.

use crate::export::MARKER;
use crate::files::FolderContent;

/// Folders in `training` and `testing`, of a file for each frame.
pub(super) const PARTS: [&str; 6] = ["velodyne", "image_2", "calib", "label_2", "ego_state", "ring"];

/// All files of an export; `testing` itself may be a link.
pub(super) const CONTENT: FolderContent = FolderContent {
    marker: MARKER,
    files: &[
        "testing",
        "training/velodyne/######.bin",
        "training/image_2/######.png",
        "training/calib/######.txt",
        "training/label_2/######.txt",
        "training/ego_state/######.json",
        "training/ring/######.bin",
        "testing/velodyne/######.bin",
        "testing/image_2/######.png",
        "testing/calib/######.txt",
        "testing/label_2/######.txt",
        "testing/ego_state/######.json",
        "testing/ring/######.bin",
        "ImageSets/train.txt",
        "ImageSets/val.txt",
        "ImageSets/trainval.txt",
        "ImageSets/test.txt",
    ],
};

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_part_of_both_halves_has_its_files() {
        for (half, part) in ["training", "testing"].iter().flat_map(|half| PARTS.map(|part| (half, part))) {
            let holds = |file: &str| CONTENT.holds(&format!("{half}/{part}/{file}"));
            assert!(["000007.bin", "000007.png", "000007.txt", "000007.json"].into_iter().any(holds));
            assert!(!holds("notes.txt"));
        }
        assert!(CONTENT.holds(MARKER) && !CONTENT.holds("kitti_infos_train.pkl"));
    }
}
