//! What the ego's sensors measure at one instant, and how much of each object they see.

use jpeg_encoder::{ColorType, Encoder, SamplingFactor};
use nalgebra::Vector3;

use super::aov::AovWriter;
use super::appearance::Appearance;
use super::drive::Drive;
use super::leaves::Leaves;
use super::rays::Caster;
use super::surfaces::Surface;
use super::timings::{Timings, time};
use super::{CheckedConfig, EpisodePlan, GenerateError};
use crate::geometry::{Lidar, Transform, World};
use crate::sample::{EncodedImage, ImageFormat, LidarPoint};
use crate::sensors::camera::{Material, Rendered, Scope, Shot};
use crate::sensors::lidar::{Finish, Hit, Receiver, Reflector, Turn, is_in_view};
use crate::sensors::{Rig, WeatherState};
use crate::sim::DrawnView;

/// The sensors of one episode.
pub(super) struct Sensors {
    /// As drawn for this episode.
    rig: Rig,
    appearance: Appearance,
    leaves: Leaves,
    /// Of each camera of the rig.
    scopes: Vec<Scope>,
    caster: Caster,
    /// Of each LiDAR of the rig.
    receivers: Vec<Receiver>,
    aov: Option<AovWriter>,
    jpeg_quality: u8,
}

/// A camera's picture, and the pixels of each object in it.
pub(super) struct Picture {
    pub image: EncodedImage,
    pub visible_px: Vec<u32>,
}

/// A LiDAR's points, and how many of them are on each object.
pub(super) struct Cloud {
    pub points: Vec<LidarPoint>,
    pub n_points: Vec<u32>,
}

impl Sensors {
    pub(super) fn new(
        config: &CheckedConfig,
        plan: &EpisodePlan,
        state: &WeatherState,
        rig: Rig,
        (appearance, leaves): (Appearance, Leaves),
        drive: &Drive,
        aov: Option<AovWriter>,
    ) -> Result<Self, GenerateError> {
        let scope = |camera| Scope::new(plan.weather, state, camera, plan.seed);
        let receivers = rig
            .lidars
            .iter()
            .map(|lidar| Receiver::new(&lidar.config, lidar.n_rings, state, lidar.seed(plan.seed)));
        Ok(Self {
            appearance,
            leaves,
            scopes: rig.cameras.iter().map(scope).collect(),
            caster: Caster::new(config.raw.lidar_engine, &rig, &drive.simulator)?,
            receivers: receivers.collect(),
            aov,
            jpeg_quality: config.raw.render.jpeg_quality,
            rig,
        })
    }

    pub(super) fn rig(&self) -> &Rig {
        &self.rig
    }

    /// Whether pictures are made with depths.
    pub(super) fn needs_depth(&self) -> bool {
        self.scopes[0].needs_depth() || self.aov.is_some()
    }

    /// Takes a picture with one of the rig's cameras.
    pub(super) fn take_picture(
        &self,
        camera_idx: usize,
        drive: &mut Drive,
        speed_mps: f64,
        sample_idx: u64,
        timings: &mut Timings,
    ) -> Result<Picture, GenerateError> {
        let (appearance, needs_depth) = (&self.appearance, self.needs_depth());
        let (world_from_ego, n_objects) = (drive.world_from_ego(), drive.object_bodies.len());
        let simulator = &mut drive.simulator;
        let DrawnView { rgb, depth_m, geoms } =
            time(&mut timings.picture, || simulator.render(camera_idx, needs_depth))?;
        if let Some(aov) = &self.aov {
            let shown = geoms.iter().map(|&geom| (appearance.object(geom), appearance.background(geom)));
            time(&mut timings.writing, || aov.write(camera_idx, sample_idx, &depth_m, shown))?;
        }
        let picture = time(&mut timings.weather, || {
            let material: Vec<Material> = geoms.iter().map(|&geom| appearance.material(geom)).collect();
            let rendered = Rendered { rgb: &rgb, depth_m: &depth_m, material: &material };
            let shot = Shot { world_from_ego, speed_mps, lamps: &appearance.lamps, sample_idx };
            self.scopes[camera_idx].see(&rendered, &shot)
        });
        let mut bytes = Vec::new();
        time(&mut timings.packing, || {
            let own = self.rig.cameras[camera_idx].config.jpeg_quality;
            let mut encoder = Encoder::new(&mut bytes, own.unwrap_or(self.jpeg_quality));
            encoder.set_sampling_factor(SamplingFactor::F_1_1);
            encoder.set_optimized_huffman_tables(true);
            let [width, height] = [picture.width(), picture.height()].map(|px| px as u16);
            encoder.encode(picture.as_raw(), width, height, ColorType::Rgb)
        })?;
        let mut visible_px = vec![0; n_objects];
        for object in geoms.iter().filter_map(|&geom| appearance.object(geom)) {
            visible_px[object] += 1;
        }
        Ok(Picture { image: EncodedImage { format: ImageFormat::Jpeg, bytes }, visible_px })
    }

    /// Turns one of the rig's LiDARs.
    pub(super) fn turn_lidar(
        &mut self,
        lidar_idx: usize,
        drive: &Drive,
        turn: Turn,
        timings: &mut Timings,
    ) -> Result<Cloud, GenerateError> {
        let lidar = &self.rig.lidars[lidar_idx];
        let pose = self.world_from_lidar(lidar_idx, drive);
        let caster = &mut self.caster;
        let hits = time(&mut timings.rays, || caster.cast(drive, lidar_idx, lidar, &pose))?;
        let cloud = time(&mut timings.truth, || {
            let reflections: Vec<Hit> = (0..hits.geom.len())
                .map(|ray| {
                    let (Surface { reflectivity, finish }, is_paved) =
                        self.appearance.surface(hits.geom[ray]);
                    let (range_m, cos_incidence) = (hits.range_m[ray], hits.cos_incidence[ray]);
                    let leaves_m = if finish == Finish::Leafy {
                        let way = pose.rotate(&lidar.pattern.directions[ray]);
                        let object = self.appearance.object(hits.geom[ray]);
                        let object = object.map(|i| (i, &drive.poses[drive.object_bodies[i]]));
                        let at = pose.isometry.translation.vector + way * range_m;
                        self.leaves.behind_m(&at.into(), &way, object)
                    } else {
                        0.0
                    };
                    Hit { range_m, cos_incidence, reflectivity, is_paved, finish, leaves_m }
                })
                .collect();
            let front = self.rig.front();
            let camera_from_lidar = front.ego_from_camera.inverse() * lidar.ego_from_lidar;
            let mut cloud = Cloud { points: Vec::new(), n_points: vec![0; drive.object_bodies.len()] };
            for found in self.receivers[lidar_idx].returns(&lidar.pattern, &reflections, turn) {
                let at = Vector3::new(found.point.x_m, found.point.y_m, found.point.z_m).cast::<f64>();
                if !lidar.is_full() && !is_in_view(&at, &front.intrinsics, &camera_from_lidar) {
                    continue;
                }
                let object = self.appearance.object(hits.geom[found.ray]);
                if let (Reflector::Target, Some(object)) = (found.reflector, object) {
                    cloud.n_points[object] += 1;
                }
                cloud.points.push(found.point);
            }
            cloud
        });
        Ok(cloud)
    }

    /// Where a LiDAR is now.
    pub(super) fn world_from_lidar(&self, lidar_idx: usize, drive: &Drive) -> Transform<World, Lidar> {
        drive.world_from_ego() * self.rig.lidars[lidar_idx].ego_from_lidar
    }

    /// Gives the files beside the episode their final names.
    pub(super) fn finish(self) -> Result<(), GenerateError> {
        self.aov.map_or(Ok(()), AovWriter::finish)
    }
}
