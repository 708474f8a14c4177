//! The files of an export to nuScenes, by their paths in its folder.

use crate::export::MARKER;
use crate::files::FolderContent;

/// All files of an export, of any version.
pub(super) const CONTENT: FolderContent = FolderContent {
    marker: MARKER,
    files: &[
        "v1.0-*/category.json",
        "v1.0-*/attribute.json",
        "v1.0-*/visibility.json",
        "v1.0-*/instance.json",
        "v1.0-*/sensor.json",
        "v1.0-*/calibrated_sensor.json",
        "v1.0-*/ego_pose.json",
        "v1.0-*/log.json",
        "v1.0-*/scene.json",
        "v1.0-*/sample.json",
        "v1.0-*/sample_data.json",
        "v1.0-*/sample_annotation.json",
        "v1.0-*/map.json",
        "maps/%%%%%%%%%%%%%%%%%%%%%%%%%%%%%%%%.png",
        "can_bus/scene-####_vehicle_monitor.json",
        "can_bus/scene-####_steeranglefeedback.json",
        "can_bus/scene-####_pose.json",
        "can_bus/scene-####_meta.json",
        "samples/absent.jpg",
        "samples/LIDAR_TOP/*__LIDAR_TOP__#*.pcd.bin",
        "samples/*/*__*__#*.jpg",
        "samples/*/*__*__#*.png",
        "sweeps/LIDAR_TOP/*__LIDAR_TOP__#*.pcd.bin",
    ],
};

#[cfg(test)]
mod tests {
    use super::*;
    use crate::export::nuscenes::scene::BLACK;
    use crate::export::nuscenes::{Release, mask_file};
    use crate::nuscenes::TABLES;

    #[test]
    fn tables_masks_and_the_black_picture_are_ours_and_what_other_tools_add_is_not() {
        for table in TABLES {
            assert!(CONTENT.holds(&format!("{}/{table}.json", Release::Mini.name())), "{table}");
        }
        for ours in [BLACK, mask_file("downtown-1").as_str(), "samples/CAM_FRONT/a-7__CAM_FRONT__1500.png"] {
            assert!(CONTENT.holds(ours), "{ours}");
        }
        for other in ["nuscenes_infos_train.pkl", "maps/expansion/downtown.json", "v1.0-mini/panoptic.json"] {
            assert!(!CONTENT.holds(other), "{other}");
        }
    }
}
