//! One episode as a scene: its files, and the rows of the tables that tell of it.
//!
//! All sensors of a sample share its time and pose. Every sample is a keyframe; the top LiDAR's clouds between samples are its
//! sweeps, each with a pose of its own.

use std::collections::BTreeMap;

use super::calendar::date;
use super::cameras::{self, MissingCamera};
use super::can_bus::CanMessages;
use super::files::{LIDAR, SensorFile, cloud_file, ending, in_their_axes};
use super::naming::Naming;
use super::tokens::sample_token;
use crate::export::{ExportError, LabelledEpisode};
use crate::files::NewFolder;
use crate::geometry::{Ego, Frame, Lidar, Pinhole, Transform, World};
use crate::interrupt;
use crate::nuscenes::{
    CalibratedSensorRow, EgoPoseRow, InstanceRow, LogRow, SampleAnnotationRow, SampleDataRow, SampleRow,
    SceneRow, Token, default_attribute, detection_class, rotation_of, translation_of, write_cloud,
};
use crate::object::{Harm, Object};
use crate::progress::Progress;
use crate::sample::Sample;

/// Where the picture of missing cameras lies.
pub(super) const BLACK: &str = "samples/absent.jpg";

/// Upper bounds of the visibility bins, and their tokens.
pub(super) const VISIBILITIES: [(f64, &str, &str); 4] =
    [(0.4, "1", "v0-40"), (0.6, "2", "v40-60"), (0.8, "3", "v60-80"), (f64::INFINITY, "4", "v80-100")];

/// All rows of one scene, and its CAN bus.
pub(super) struct SceneRows {
    pub log: LogRow,
    pub scene: SceneRow,
    pub samples: Vec<SampleRow>,
    pub data: Vec<SampleDataRow>,
    pub poses: Vec<EgoPoseRow>,
    pub calibrations: Vec<CalibratedSensorRow>,
    pub annotations: Vec<SampleAnnotationRow>,
    pub instances: Vec<InstanceRow>,
    pub can: CanMessages,
    /// Names of the categories that occur.
    pub categories: Vec<&'static str>,
}

/// Where and when an episode lies in the export.
#[derive(Debug)]
pub(super) struct Placement {
    pub global_from_world: Transform<World, World>,
    /// What is added to its times.
    pub delay_us: u64,
}

/// Writes an episode's files and collects its rows.
pub(super) fn write(
    episode: &LabelledEpisode,
    place: &Placement,
    naming: Naming,
    folder: &NewFolder,
    progress: &dyn Progress,
) -> Result<SceneRows, ExportError> {
    let mut scene = SceneBuilder::new(episode, place, naming, folder);
    for sample_idx in 0..episode.reader.len() {
        interrupt::check()?;
        let (sample, harms) = episode.sample(sample_idx)?;
        let global_from_ego = place.global_from_world * sample.measured.world_from_ego;
        scene.add(sample_idx, &sample, &harms, &global_from_ego)?;
        progress.advance(1);
    }
    Ok(scene.rows)
}

fn token_of(episode: &LabelledEpisode, sample_idx: usize) -> Token {
    let time_ns = episode.reader.times_ns()[sample_idx];
    sample_token(episode.reader.log(), &episode.entry().name, sample_idx, time_ns)
}

struct SceneBuilder<'a> {
    episode: &'a LabelledEpisode,
    delay_us: u64,
    naming: Naming,
    folder: &'a NewFolder,
    missing: Vec<MissingCamera>,
    rows: SceneRows,
    /// Index of the last annotation of each instance.
    last_of_instance: BTreeMap<Token, usize>,
    /// Index of the last file of each channel.
    last_of_channel: BTreeMap<String, usize>,
}

impl<'a> SceneBuilder<'a> {
    fn new(episode: &'a LabelledEpisode, place: &Placement, naming: Naming, folder: &'a NewFolder) -> Self {
        let (entry, reader) = (episode.entry(), &episode.reader);
        let log_token = Token::of("log", &entry.name);
        let last = reader.len().saturating_sub(1);
        let origin =
            reader.log().map_or_else(|| "simulated".to_owned(), |log| format!("from {}", log.format));
        let rows = SceneRows {
            log: LogRow {
                token: log_token.clone(),
                logfile: entry.name.clone(),
                vehicle: "harmzone ego".into(),
                date_captured: date(
                    reader.times_ns().first().copied().unwrap_or_default() / 1000 + place.delay_us,
                ),
                location: entry.town.clone(),
                wheelbase_m: None,
                front_bumper_x_m: None,
            },
            scene: SceneRow {
                token: Token::of("scene", &entry.name),
                log_token,
                nbr_samples: reader.len(),
                first_sample_token: token_of(episode, 0),
                last_sample_token: token_of(episode, last),
                name: String::new(),
                description: format!("{}, {origin}: {} in {}", entry.name, entry.weather, entry.town),
            },
            samples: Vec::new(),
            data: Vec::new(),
            poses: Vec::new(),
            calibrations: Vec::new(),
            annotations: Vec::new(),
            instances: Vec::new(),
            can: CanMessages::default(),
            categories: Vec::new(),
        };
        let missing = cameras::missing(reader.cameras());
        let (last_of_instance, last_of_channel) = (BTreeMap::new(), BTreeMap::new());
        Self {
            episode,
            delay_us: place.delay_us,
            naming,
            folder,
            missing,
            rows,
            last_of_instance,
            last_of_channel,
        }
    }

    fn add(
        &mut self,
        sample_idx: usize,
        sample: &Sample,
        harms: &[Harm],
        global_from_ego: &Transform<World, Ego>,
    ) -> Result<(), ExportError> {
        let time_us = sample.measured.time_ns / 1000 + self.delay_us;
        let token = token_of(self.episode, sample_idx);
        let prev = self.rows.samples.last_mut().map_or_else(Token::none, |before| {
            before.next = token.clone();
            before.token.clone()
        });
        let (scene_token, next) = (self.rows.scene.token.clone(), Token::none());
        self.rows.samples.push(SampleRow {
            token: token.clone(),
            timestamp: time_us,
            prev,
            next,
            scene_token,
        });
        let state = &sample.measured.ego_state;
        self.rows.can.add(time_us, state, global_from_ego);
        self.rows.log.wheelbase_m = Some(state.wheelbase_m);
        self.rows.log.front_bumper_x_m = Some(state.front_bumper_x_m);
        self.add_sweeps(sample_idx, sample, &token, global_from_ego)?;
        for file in self.write_files(sample_idx, sample, time_us)? {
            self.add_file(file, &token, time_us, global_from_ego);
        }
        for (object_idx, object) in sample.objects().iter().enumerate() {
            self.add_annotation(object, harms.get(object_idx).copied(), &token, global_from_ego);
        }
        Ok(())
    }

    /// Writes the top LiDAR's clouds since the sample before; as in nuScenes they belong to the sample that follows.
    fn add_sweeps(
        &mut self,
        sample_idx: usize,
        sample: &Sample,
        sample_token: &Token,
        global_from_ego: &Transform<World, Ego>,
    ) -> Result<(), ExportError> {
        let measured = &sample.measured;
        let global_from_world = *global_from_ego * measured.world_from_ego.inverse();
        for sweep in self.episode.reader.sweeps(sample_idx)? {
            if sweep.lidar != Lidar::NAME {
                continue;
            }
            let time_us = sweep.time_ns / 1000 + self.delay_us;
            let filename =
                format!("sweeps/{LIDAR}/{}__{LIDAR}__{time_us}.pcd.bin", self.episode.entry().name);
            self.folder.make(&format!("sweeps/{LIDAR}"))?;
            self.folder.write(&filename, &write_cloud(sweep.points.iter().map(in_their_axes)))?;
            let world_from_ego = sweep.world_from_lidar * measured.ego_from_lidar.inverse();
            let file = SensorFile { is_key_frame: false, ..cloud_file(measured, filename) };
            self.add_file(file, sample_token, time_us, &(global_from_world * world_from_ego));
        }
        Ok(())
    }

    /// Writes the cloud and the pictures of a sample.
    fn write_files(
        &self,
        sample_idx: usize,
        sample: &Sample,
        time_us: u64,
    ) -> Result<Vec<SensorFile>, ExportError> {
        let measured = &sample.measured;
        let name = |channel: &str, ending: &str| {
            format!("samples/{channel}/{}__{channel}__{time_us}.{ending}", self.episode.entry().name)
        };
        let mut files = Vec::new();
        let lidar = name(LIDAR, "pcd.bin");
        self.folder.write(&lidar, &write_cloud(measured.points.iter().map(in_their_axes)))?;
        files.push(cloud_file(measured, lidar));
        let front = (cameras::front(), &measured.image, measured.ego_from_camera, measured.intrinsics);
        let views = self.episode.reader.views(sample_idx)?;
        let others = views.iter().map(|view| {
            (cameras::channel_of(&view.name), &view.image, view.ego_from_camera, view.intrinsics)
        });
        for (channel, image, ego_from_camera, intrinsics) in std::iter::once(front).chain(others) {
            let format = ending(image);
            let filename = name(&channel, format);
            self.folder.make(&format!("samples/{channel}"))?;
            self.folder.write(&filename, &image.bytes)?;
            let ego_from_sensor = ego_from_camera.isometry;
            files.push(SensorFile {
                channel,
                is_key_frame: true,
                ego_from_sensor,
                intrinsics: Some(intrinsics),
                filename,
                format,
            });
        }
        files.extend(self.missing.iter().map(|camera| SensorFile {
            channel: camera.channel.into(),
            is_key_frame: true,
            ego_from_sensor: camera.ego_from_camera.isometry,
            intrinsics: Some(camera.intrinsics),
            filename: BLACK.into(),
            format: "jpg",
        }));
        Ok(files)
    }

    fn add_file(
        &mut self,
        file: SensorFile,
        sample_token: &Token,
        time_us: u64,
        global_from_ego: &Transform<World, Ego>,
    ) {
        let of_sweep = if file.is_key_frame { String::new() } else { format!("/{time_us}") };
        let token = Token::of("sample_data", &format!("{sample_token}/{}{of_sweep}", file.channel));
        let (translation, rotation) =
            (translation_of(&global_from_ego.isometry), rotation_of(&global_from_ego.isometry));
        self.rows.poses.push(EgoPoseRow { token: token.clone(), timestamp: time_us, rotation, translation });
        let (idx, calibrated_sensor_token) = (self.rows.data.len(), self.calibration(&file));
        let prev =
            self.last_of_channel.insert(file.channel.clone(), idx).map_or_else(Token::none, |before| {
                self.rows.data[before].next = token.clone();
                self.rows.data[before].token.clone()
            });
        self.rows.data.push(SampleDataRow {
            token: token.clone(),
            sample_token: sample_token.clone(),
            ego_pose_token: token,
            calibrated_sensor_token,
            timestamp: time_us,
            fileformat: file.format.into(),
            is_key_frame: file.is_key_frame,
            height: file.intrinsics.map_or(0, |camera| camera.height_px),
            width: file.intrinsics.map_or(0, |camera| camera.width_px),
            filename: file.filename,
            prev,
            next: Token::none(),
        });
    }

    /// The row of a sensor's calibration: the one before where it is the same.
    fn calibration(&mut self, file: &SensorFile) -> Token {
        let matrix = |camera: Pinhole| {
            // Digit for digit: nuScenes does not say whether pixel (0, 0) is a pixel's centre or its corner.
            vec![[camera.fx_px, 0.0, camera.cx_px], [0.0, camera.fy_px, camera.cy_px], [0.0, 0.0, 1.0]]
        };
        let key = format!("{}/{}/{}", self.rows.log.token, file.channel, self.rows.calibrations.len());
        let row = CalibratedSensorRow {
            token: Token::of("calibrated_sensor", &key),
            sensor_token: Token::of("sensor", &file.channel),
            translation: translation_of(&file.ego_from_sensor),
            rotation: rotation_of(&file.ego_from_sensor),
            camera_intrinsic: file.intrinsics.map_or_else(Vec::new, matrix),
        };
        let is_same = |old: &&CalibratedSensorRow| {
            CalibratedSensorRow { token: row.token.clone(), ..(*old).clone() } == row
        };
        if let Some(old) = self.rows.calibrations.iter().rev().find(is_same) {
            return old.token.clone();
        }
        let token = row.token.clone();
        self.rows.calibrations.push(row);
        token
    }

    fn add_annotation(
        &mut self,
        object: &Object,
        harm: Option<Harm>,
        sample_token: &Token,
        global_from_ego: &Transform<World, Ego>,
    ) {
        let category = self.naming.category(object, harm);
        if !self.rows.categories.contains(&category) {
            self.rows.categories.push(category);
        }
        let id = object.id.as_deref().unwrap_or_default();
        // A log's own token of an instance is kept, unless labels split the instance.
        let instance_token = match Token::from(id) {
            token @ Token::Hex(_) if !self.naming.needs_labels() => token,
            _ => Token::of("instance", &format!("{}/{id}/{category}", self.episode.entry().name)),
        };
        let token = Token::of("sample_annotation", &format!("{sample_token}/{id}"));
        let idx = self.rows.annotations.len();
        let before = self.last_of_instance.insert(instance_token.clone(), idx);
        let prev = before.map_or_else(Token::none, |before| {
            self.rows.annotations[before].next = token.clone();
            self.rows.annotations[before].token.clone()
        });
        self.count_instance(&instance_token, category, &token);
        let bounds = object.box_in_ego;
        let center = *global_from_ego * bounds.center;
        // The whole rotation: on a slope the box leans with the ego.
        let turn = Transform::<World, World>::from_xyz_yaw(0.0, 0.0, 0.0, bounds.yaw_rad);
        let rotation = global_from_ego.isometry.rotation * turn.isometry.rotation;
        let attribute = detection_class(category)
            .map_or("", |class| default_attribute(class, object.velocity_in_ego_mps));
        self.rows.annotations.push(SampleAnnotationRow {
            token,
            sample_token: sample_token.clone(),
            instance_token,
            visibility_token: visibility(object.visible_fraction),
            attribute_tokens: if attribute.is_empty() {
                Vec::new()
            } else {
                vec![Token::of("attribute", attribute)]
            },
            translation: center.coords.coords.into(),
            size: [bounds.width_m, bounds.length_m, bounds.height_m],
            rotation: [rotation.w, rotation.i, rotation.j, rotation.k],
            prev,
            next: Token::none(),
            num_lidar_pts: object.n_lidar_points.map_or(0, i64::from),
            num_radar_pts: 0,
        });
    }

    fn count_instance(&mut self, token: &Token, category: &str, annotation: &Token) {
        if let Some(row) = self.rows.instances.iter_mut().find(|row| row.token == *token) {
            row.nbr_annotations += 1;
            row.last_annotation_token = annotation.clone();
            return;
        }
        self.rows.instances.push(InstanceRow {
            token: token.clone(),
            category_token: Token::of("category", category),
            nbr_annotations: 1,
            first_annotation_token: annotation.clone(),
            last_annotation_token: annotation.clone(),
        });
    }
}

/// The bin of a visible share; nuScenes' schema has an empty token where it is not known.
fn visibility(fraction: Option<f64>) -> Token {
    let bin = |fraction: f64| VISIBILITIES.into_iter().find(|(below, ..)| fraction <= *below);
    fraction.and_then(bin).map_or_else(Token::none, |(_, token, _)| Token::from(token))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_fall_into_their_bins() {
        let told = [Some(0.0), Some(0.4), Some(0.41), Some(0.7), Some(1.0), None]
            .map(|share| visibility(share).to_string());
        assert_eq!(told, ["1", "1", "2", "3", "4", ""]);
    }
}
