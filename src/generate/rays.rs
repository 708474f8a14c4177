//! The LiDAR's rays in one episode, by the engine of the config.

use crate::geometry::{Lidar, Transform, World};
use crate::rays::{Beams, RayHits, RayScene};
use crate::sensors::{Rig, RigLidar};
use crate::sim::{SimError, Simulator};

use super::config::LidarEngine;
use super::drive::Drive;

/// What casts the rays of a rig's LiDARs.
pub(super) enum Caster {
    Bvh {
        scene: Box<RayScene>,
        /// Of each LiDAR.
        beams: Vec<Beams>,
    },
    Mujoco,
}

impl Caster {
    /// # Errors
    /// As [`Simulator::ray_scene`].
    pub(super) fn new(engine: LidarEngine, rig: &Rig, simulator: &Simulator) -> Result<Self, SimError> {
        Ok(match engine {
            LidarEngine::Bvh => {
                let scene = Box::new(simulator.ray_scene()?);
                let beams = rig.lidars.iter().map(|lidar| Beams::new(&lidar.pattern.directions));
                Self::Bvh { scene, beams: beams.collect() }
            }
            LidarEngine::Mujoco => Self::Mujoco,
        })
    }

    /// What each ray of a LiDAR's pattern hits first, now; `lidar_idx` is its place in the rig.
    ///
    /// # Errors
    /// As [`Simulator::cast_rays`].
    pub(super) fn cast(
        &mut self,
        drive: &Drive,
        lidar_idx: usize,
        lidar: &RigLidar,
        world_from_lidar: &Transform<World, Lidar>,
    ) -> Result<RayHits, SimError> {
        // A return's noise may bring it into range.
        let max_range_m = lidar.config.max_range_m + 1.0;
        match self {
            Self::Bvh { scene, beams } => {
                scene.set_poses(&drive.poses);
                Ok(scene.cast(&world_from_lidar.isometry, &beams[lidar_idx], max_range_m))
            }
            Self::Mujoco => {
                let rays = lidar.pattern.directions.iter();
                let directions: Vec<_> = rays.map(|ray| world_from_lidar.rotate(ray)).collect();
                let origin = world_from_lidar.isometry.translation.vector.into();
                drive.simulator.cast_rays(&origin, &directions, max_range_m)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;
    use std::sync::Arc;

    use fs_err as fs;
    use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

    use super::*;
    use crate::scene::models::{self, Model};
    use crate::scene::{Lighting, PopulateConfig, Town, populate, town_names};
    use crate::sensors::RigConfig;
    use crate::sensors::lidar::Pattern;
    use crate::sim::{CameraMount, Renderer};

    const MAX_RANGE_M: f64 = 80.0;
    /// Share of rays that may differ: those within a hair of an edge.
    const MOST_OTHERS: f64 = 7e-5;
    const COINCIDENT_M: f64 = 1e-6;

    fn mount() -> CameraMount {
        let rig = Rig::try_from(&RigConfig::default()).unwrap();
        CameraMount {
            body: "ego".into(),
            cameras: vec![(rig.front().ego_from_camera, rig.front().intrinsics)],
            n_samples: 0,
            shadow_size_px: 256,
            renderer: Renderer::Classic,
        }
    }

    /// Whether ray `i` of one and ray `k` of the other differ: in what they hit, by a millimetre or in the angle. Where
    /// surfaces of two geoms coincide, either will do.
    fn differ(ours: &RayHits, i: usize, theirs: &RayHits, k: usize) -> bool {
        let away_m = (ours.range_m[i] - theirs.range_m[k]).abs();
        if ours.geom[i] != theirs.geom[k] {
            return !(away_m < COINCIDENT_M);
        }
        let cos_apart = (ours.cos_incidence[i] - theirs.cos_incidence[k]).abs();
        ours.geom[i] >= 0 && (away_m > 1e-3 || cos_apart > 1e-4)
    }

    /// Casts by both engines. Returns the number of rays, of those that hit, and of those that differ. As `mj_multiRay`
    /// loses hits, `mj_ray` is asked again where they differ.
    fn compare(simulator: &Simulator, pose: &Isometry3<f64>, directions: &[Vector3<f64>]) -> [usize; 3] {
        let ours = simulator.ray_scene().unwrap().cast(pose, &Beams::new(directions), MAX_RANGE_M);
        let turned: Vec<Vector3<f64>> = directions.iter().map(|direction| pose * direction).collect();
        let origin = pose.translation.vector.into();
        let theirs = simulator.cast_rays(&origin, &turned, MAX_RANGE_M).unwrap();
        let doubtful: Vec<usize> =
            (0..turned.len()).filter(|&ray| differ(&ours, ray, &theirs, ray)).collect();
        let again: Vec<Vector3<f64>> = doubtful.iter().map(|&ray| turned[ray]).collect();
        let single = simulator.cast_single_rays(&origin, &again, MAX_RANGE_M);
        let others = doubtful.iter().enumerate().filter(|&(k, &ray)| differ(&ours, ray, &single, k));
        let n_hits = ours.geom.iter().filter(|&&geom| geom >= 0).count();
        [directions.len(), n_hits, others.count()]
    }

    fn start(town: &str, ood: bool) -> Drive {
        let town = Arc::new(Town::load(town).unwrap());
        let world = populate(&town, &PopulateConfig { ood, ..PopulateConfig::default() }, 5).unwrap();
        let lighting = Lighting { ambient: [0.5; 3], sun: None };
        let mut drive = Drive::new(&world, &lighting, &mount(), 5).unwrap();
        (0..40).for_each(|_| drive.step().unwrap());
        drive
    }

    fn sum(parts: impl Iterator<Item = [usize; 3]>) -> [usize; 3] {
        parts.fold([0; 3], |sum, part| [0, 1, 2].map(|i| sum[i] + part[i]))
    }

    #[test]
    fn whole_turns_in_every_town_are_as_mujocos() {
        let elevations_deg: Vec<f64> = (0..40).map(|ring| -32.0 + 1.2 * f64::from(ring)).collect();
        let turn = Pattern::spinning(&elevations_deg, 1.1).directions;
        let towns = town_names().into_iter().map(|town| (town, false)).chain([("market".to_owned(), true)]);
        for (name, ood) in towns {
            let drive = start(&name, ood);
            let ego = drive.world_from_ego().isometry;
            let poses = [(0.94, 0.0, 1.84), (8.0, 3.0, 0.6), (-5.0, -8.0, 9.0)]
                .map(|(x, y, z)| ego * Isometry3::translation(x, y, z));
            let [n, n_hits, n_others] = sum(poses.iter().map(|pose| compare(&drive.simulator, pose, &turn)));
            assert!(n_hits > n / 2, "{name}: {n_hits} of {n} hit");
            assert!(n_others as f64 <= MOST_OTHERS * n as f64, "{name}: {n_others} of {n} differ");
        }
    }

    /// A model alone in the world, with the text and the files of its folder.
    fn stage(model: &Model) -> Simulator {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("mjcf_assets").join(&model.name);
        let xml = fs::read_to_string(folder.join("model.xml")).unwrap();
        let eye = "<body name=\"an_eye\" pos=\"0 0 90\"><geom size=\"1\" group=\"4\"/></body></worldbody>";
        let files: Vec<(String, Vec<u8>)> = fs::read_dir(folder)
            .unwrap()
            .map(|entry| entry.unwrap().path())
            .filter(|path| path.is_file())
            .map(|path| (path.file_name().unwrap().to_string_lossy().into_owned(), fs::read(&path).unwrap()))
            .collect();
        let mount = CameraMount { body: "an_eye".into(), ..mount() };
        Simulator::new(&xml.replace("</worldbody>", eye), &files, &mount).unwrap()
    }

    #[test]
    fn every_model_is_as_mujocos_from_all_sides_and_from_within() {
        let mut n_all = [0; 3];
        for model in models::load().unwrap() {
            let simulator = stage(&model);
            let [low, high] = model.bounds;
            let (middle, size) = (nalgebra::center(&low, &high), high - low);
            // Nothing regular: no ray along an edge.
            let eyes = (0..10).map(|i| {
                let (turn, up) = (f64::from(i) * 0.7, f64::from(i % 4) * 0.3 - 0.2);
                let out = if i == 0 { Vector3::zeros() } else { Vector3::new(turn.cos(), turn.sin(), up) };
                middle + out * (1.0 + size.norm()) + Vector3::new(0.0123, 0.0071, 0.0037)
            });
            let found = sum(eyes.map(|eye: Point3<f64>| {
                let targets = (1..=1000).map(|i| {
                    let share = Vector3::new(0.819_172_5, 0.671_043_6, 0.549_700_5) * f64::from(i);
                    low + (share.map(f64::fract) * 1.1 - Vector3::repeat(0.05)).component_mul(&size)
                });
                let directions: Vec<Vector3<f64>> =
                    targets.map(|target| (target - eye).normalize()).collect();
                let pose = Isometry3::from_parts(Translation3::from(eye), UnitQuaternion::identity());
                compare(&simulator, &pose, &directions)
            }));
            assert!(found[1] > found[0] / 20, "{}: {} of {} hit", model.name, found[1], found[0]);
            assert!(found[2] <= 5, "{}: {} of {} differ", model.name, found[2], found[0]);
            n_all = [0, 1, 2].map(|i| n_all[i] + found[i]);
        }
        assert!(n_all[2] as f64 <= MOST_OTHERS * n_all[0] as f64, "{} of {} differ", n_all[2], n_all[0]);
    }
}
