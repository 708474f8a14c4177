//! Rigs that come with harmzone, and a user's own from a file.

use std::path::Path;

use super::rig_config::RigConfig;
use crate::config::{self, Check, ConfigError};

/// A rig by name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ShippedRig {
    /// One camera and the LiDAR's sector in its view: the default.
    Front,
    /// nuScenes' six cameras and the LiDAR's whole turn.
    Surround,
}

impl ShippedRig {
    pub const ALL: [Self; 2] = [Self::Front, Self::Surround];

    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Front => "front",
            Self::Surround => "surround",
        }
    }

    /// Its config.
    ///
    /// # Panics
    /// If the file that was compiled in is broken, which a test excludes.
    #[must_use]
    pub fn config(self) -> RigConfig {
        match self {
            Self::Front => RigConfig::default(),
            Self::Surround => toml::from_str(include_str!("../../configs/rigs/surround.toml"))
                .expect("a test reads the file that comes with the program"),
        }
    }
}

impl RigConfig {
    /// The rig with this name, or that of a TOML file.
    ///
    /// # Errors
    /// Neither a name nor a file, or a file that is no valid rig.
    pub fn named_or_read(name: &str) -> Result<Self, ConfigError> {
        if let Some(rig) = ShippedRig::ALL.into_iter().find(|rig| rig.name() == name) {
            return Ok(rig.config());
        }
        let path = Path::new(name);
        let rig: Self = config::load(Some(path), &[])?;
        match rig.check() {
            Ok(()) => Ok(rig),
            Err(invalid) => Err(ConfigError::Invalid { invalid, path: path.to_owned() }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Point;
    use crate::sensors::Rig;

    #[test]
    fn the_surround_rig_sees_the_whole_circle_and_has_the_front_rigs_camera() {
        let [front, surround] = ShippedRig::ALL.map(|rig| Rig::try_from(&rig.config()).unwrap());
        assert_eq!(surround.front(), front.front());
        assert_eq!((surround.cameras.len(), front.cameras.len()), (6, 1));
        assert!(surround.top().is_full() && !front.top().is_full());
        for degrees in 0..360 {
            let (sin, cos) = f64::from(degrees).to_radians().sin_cos();
            let at = Point::new(40.0 * cos, 40.0 * sin, 1.0);
            let sees = |camera: &&crate::sensors::RigCamera| {
                let pixel = camera.intrinsics.project(&(camera.ego_from_camera.inverse() * at));
                pixel.is_some_and(|(u_px, v_px)| camera.intrinsics.contains(u_px, v_px))
            };
            assert!(surround.cameras.iter().any(|camera| sees(&camera)), "nobody looks to {degrees} degrees");
        }
    }

    #[test]
    fn kittis_rig_is_read_from_its_file() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/configs/rigs/kitti.toml");
        let rig = Rig::try_from(&RigConfig::named_or_read(path).unwrap()).unwrap();
        assert_eq!(rig.lidars[0].n_rings, 64);
        // P2 of its object frames.
        assert!((rig.front().intrinsics.fx_px - 721.5).abs() < 1.0, "{}", rig.front().intrinsics.fx_px);
    }

    #[test]
    fn a_file_that_is_no_valid_rig_is_told_with_its_path() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("rig.toml");
        for (text, wanted) in [
            ("cameras = {}", "cameras is []; one named cam_front is needed"),
            (
                "[cameras.cam_front]\nwidth_px = 0",
                "cameras.cam_front.width_px is 0; a number from 16 to 4096",
            ),
            (
                "[lidars.lidar_top]\nelevations_deg = [3, 1]",
                "lidars.lidar_top.elevations_deg is [3.0, 1.0]; ",
            ),
            (
                "[lidars.lidar_top]\nlost_beams = [40]",
                "lidars.lidar_top.lost_beams is [40]; numbers of its 32",
            ),
            ("[lidars.lidar_top]\nelevations_deg = [1]\nlost_beams = [0]", "not of all are needed"),
            ("[lidars.lidar_top]\npreset = \"hdl33\"", "expected one of `hdl32e`"),
            ("[cameras.cam_a]\n[cameras.cam_a]", "duplicate key"),
        ] {
            fs_err::write(&path, text).unwrap();
            let error = RigConfig::named_or_read(path.to_str().unwrap()).unwrap_err().to_string();
            assert!(error.contains(wanted) && error.ends_with("rig.toml"), "{text}: {error}");
        }
    }

    #[test]
    fn what_is_neither_a_name_nor_a_file_is_told() {
        assert_eq!(RigConfig::named_or_read("front").unwrap(), RigConfig::default());
        let error = RigConfig::named_or_read("sideways").unwrap_err().to_string();
        assert!(error.contains("sideways"), "{error}");
    }
}
