//! One episode: its file, its entry, each of its samples, and its labels.

use std::path::Path;

use super::camera::Sight;
use super::check::{Aspect, Remark};
use super::labels::{EpisodeLabels, LabelSet};
use super::maker::{Maker, Plans, is_of_gen};
use super::motion::Motion;
use super::objects::{MARGIN_M, Objects};
use super::rig::{Calibration, Mounting, rig_of};
use super::sample::Ground;
use super::spread::Portrait;
use super::tally::Tally;
use super::{archive, entries, sample, times};
use crate::episode::manifest::{EpisodeEntry, LabelCounts};
use crate::episode::{EpisodeError, EpisodeReader, check_stamps};
use crate::files::sha256_hex;
use crate::progress::Progress;
use crate::sample::Sample;
use crate::sensors::Rig;
use crate::store;

/// Points lie this many standard deviations of the range beside the thing that they are on.
const RANGE_SIGMAS: f64 = 4.0;

/// What is known before episodes are read.
pub(super) struct Context<'a> {
    pub path: &'a Path,
    pub maker: &'a Maker,
    pub plans: &'a Plans,
    pub sets: &'a [LabelSet],
}

/// What came of an episode.
#[derive(Default)]
pub(super) struct Examined {
    /// Each with its place.
    pub remarks: Vec<(String, Remark)>,
    pub tally: Tally,
    /// Hash of the config in its metadata.
    pub config_sha256: Option<String>,
    /// Whether that config is one of `gen`.
    pub is_of_gen: bool,
    /// `None` where a sample could not be read.
    pub portrait: Option<Portrait>,
    /// Where the sensors of an episode are that has no rig in its metadata and is no log.
    pub calibration: Option<Calibration>,
    /// The counts of each label set; `None` where they could not be read.
    pub labels: Vec<Option<LabelCounts>>,
}

impl Examined {
    fn tell(&mut self, at: &str, remark: Remark) {
        self.remarks.push((at.to_owned(), remark));
    }

    fn tell_all(&mut self, at: &str, remarks: impl IntoIterator<Item = Remark>) {
        self.remarks.extend(remarks.into_iter().map(|remark| (at.to_owned(), remark)));
    }
}

/// Examines an episode of a data set.
pub(super) fn examine(context: &Context<'_>, entry: &EpisodeEntry, progress: &dyn Progress) -> Examined {
    let mut examined = Examined { labels: vec![None; context.sets.len()], ..Examined::default() };
    let (mut open_labels, mut of_labels) = (Vec::new(), Vec::new());
    for set in context.sets {
        open_labels.push(set.open(context.path, entry, &mut examined.tally.n_hashed, &mut of_labels));
    }
    examined.tally.n_label_files = open_labels.iter().flatten().count() as u64;
    examined.tell_all(&entry.name, of_labels);
    match open(context, entry, &mut examined) {
        Some((reader, in_file_ns)) => {
            let config_toml = &reader.meta().config_toml;
            examined.config_sha256 = Some(sha256_hex(config_toml.as_bytes()));
            examined.is_of_gen = is_of_gen(config_toml);
            examine_content(context, entry, &reader, &in_file_ns, &mut open_labels, &mut examined, progress);
        }
        None => progress.advance(entry.n_samples as u64),
    }
    examined
}

/// The reader of a file without a wrong checksum, and the times of its samples in the file's order.
fn open(
    context: &Context<'_>,
    entry: &EpisodeEntry,
    examined: &mut Examined,
) -> Option<(EpisodeReader, Vec<u64>)> {
    let (file, name) = (context.path.join(&entry.file), &entry.name);
    // What cannot be looked at is told where it is read.
    if matches!(store::is_there(&file), Ok(false)) {
        let text = format!(
            "dataset.json names the episode, and its file is not there; the command that made the data set, given again, makes it: {}",
            file.display()
        );
        examined.tell(name, Remark::fault(Aspect::Files, "missing episode", text));
        return None;
    }
    match store::sha256_of(&file) {
        Ok(found) if found == entry.sha256 => examined.tally.n_hashed += 1,
        Ok(found) => {
            let (wanted, path) = (entry.sha256.clone(), file.clone());
            let error = EpisodeError::OtherContent { found, wanted, path };
            examined.tell(name, Remark::fault(Aspect::Hashes, "episode", error.to_string()));
        }
        Err(error) => examined.tell(name, Remark::fault(Aspect::Hashes, "episode", error.to_string())),
    }
    let is_ours = context.maker.is_known();
    let read = check_stamps(&file, is_ours)
        .and_then(|(counts, off)| Ok((counts, off, archive::examine(&file, counts)?)));
    let (in_file_ns, off) = match read {
        Ok((counts, off, (in_file_ns, remark))) => {
            let tally = &mut examined.tally;
            tally.n_archives += 1;
            tally.n_bytes += counts.n_bytes;
            tally.n_records += counts.n_records as u64;
            examined.tell_all(name, remark);
            (in_file_ns, off)
        }
        Err(error) => {
            examined.tell(name, Remark::fault(Aspect::Checksums, "episode", error.to_string()));
            return None;
        }
    };
    match EpisodeReader::open(&file) {
        Ok(reader) => {
            examined.tally.n_opened += 1;
            // Importers stamp as `gen` does; others may take the stamps of a log's sensors.
            let may_be = reader.log().is_some() && !is_ours;
            examined.tell_all(name, times::examine_stamps(&file, &off, may_be));
            Some((reader, in_file_ns))
        }
        Err(error) => {
            examined.tell(name, Remark::fault(Aspect::Schemas, "episode", error.to_string()));
            None
        }
    }
}

fn examine_content(
    context: &Context<'_>,
    entry: &EpisodeEntry,
    reader: &EpisodeReader,
    in_file_ns: &[u64],
    open_labels: &mut [Option<EpisodeLabels<'_>>],
    examined: &mut Examined,
    progress: &dyn Progress,
) {
    let config = context.maker.gen_config();
    let period_s = config.map(|config| config.sample_period_s);
    examined.tell_all(&entry.name, times::examine(reader.times_ns(), in_file_ns, period_s));
    let rig = rig_of(reader.meta()).map(|(_, rig)| rig);
    let is_log = reader.log().is_some();
    let mut content = Content {
        objects: Objects::new(
            is_log,
            config.map(|config| config.annotation.max_range_m),
            margin_m(rig.as_ref()),
        ),
        sight: Sight::new(is_log, rig.as_ref(), reader.cameras().is_empty()),
        mounting: Mounting::new(is_log, rig.as_ref()),
        motion: Motion::default(),
        ground: Ground::default(),
        sum_range_m: 0.0,
    };
    let mut n_read = 0;
    for sample_idx in 0..reader.len() {
        let at = format!("{}/{sample_idx}", entry.name);
        match reader.whole_sample(sample_idx) {
            Ok(sample) => {
                n_read += 1;
                let remarks = content.add(reader, sample_idx, &sample, &mut examined.tally);
                examined.tell_all(&at, remarks);
                for labels in open_labels.iter_mut().flatten() {
                    examined.tell_all(&at, labels.examine(sample_idx, &sample));
                }
            }
            Err(error) => examined.tell(&at, Remark::fault(aspect_of(&error), "sample", error.to_string())),
        }
        progress.advance(1);
    }
    if reader.scales_intensity() {
        let text = "intensities are from 0 to 1; they are read times 255, since 0 to 255 is needed";
        examined.tell(&entry.name, Remark::warning(Aspect::Clouds, "intensity scale", text));
    }
    let of_whole = [content.motion.judge(), content.sight.judge()].concat();
    examined.tell_all(&entry.name, of_whole);
    examined.tell_all(&entry.name, std::mem::take(&mut content.ground).judge());
    content.count(&mut examined.tally);
    if n_read < reader.len() {
        return;
    }
    examined.tally.n_whole += 1;
    let counts = content.objects.counts;
    examined.tell_all(&entry.name, entries::examine(entry, reader, &counts, context.maker, context.plans));
    examined.calibration = content.mounting.first().filter(|_| rig.is_none() && !is_log);
    examined.portrait = Some(Portrait {
        name: entry.name.clone(),
        n_samples: reader.len() as u64,
        objects: counts,
        sum_range_m: content.sum_range_m,
        has_truth: reader.has_truth(),
    });
    for (labels, counts) in open_labels.iter().zip(&mut examined.labels) {
        *counts = labels.as_ref().map(|labels| labels.counts);
        examined.tally.n_labels += labels.as_ref().map_or(0, |labels| labels.n_labels);
    }
}

/// How far points may lie beside the thing that they are on.
fn margin_m(rig: Option<&Rig>) -> f64 {
    let noise_m = rig.map_or(0.0, |rig| {
        rig.lidars
            .iter()
            .map(|lidar| lidar.config.range_noise_m + lidar.config.ring_bias_m)
            .fold(0.0, f64::max)
    });
    MARGIN_M + RANGE_SIGMAS * noise_m
}

/// The check that a sample fails that cannot be read.
fn aspect_of(error: &EpisodeError) -> Aspect {
    let fault = match error {
        EpisodeError::Damaged { .. } | EpisodeError::NoIndex { .. } => return Aspect::Checksums,
        EpisodeError::NotAligned { .. } | EpisodeError::TimeOrder { .. } => return Aspect::Times,
        EpisodeError::Invalid { fault, .. } => fault,
        _ => return Aspect::Schemas,
    };
    match fault.field {
        _ if fault.object.is_some() => Aspect::Boxes,
        "picture" | "format" => Aspect::Pictures,
        "points" | "fields" | "data" | "frame_id of the cloud" | "pose of the cloud" => Aspect::Clouds,
        "K" | "K[0]" | "K[2]" | "K[4]" | "K[5]" | "D" => Aspect::Camera,
        "cam_front" | "lidar_top" | "transforms" | "rotation" | "translation.x" | "translation.y"
        | "translation.z" => Aspect::Rig,
        _ => Aspect::Schemas,
    }
}

/// What is gathered from sample to sample.
struct Content {
    objects: Objects,
    sight: Sight,
    mounting: Mounting,
    motion: Motion,
    ground: Ground,
    sum_range_m: f64,
}

impl Content {
    fn add(
        &mut self,
        reader: &EpisodeReader,
        sample_idx: usize,
        sample: &Sample,
        tally: &mut Tally,
    ) -> Vec<Remark> {
        let measured = &sample.measured;
        let mut points = sample::in_ego(&measured.ego_from_lidar, &measured.points);
        let mut remarks = sample::examine(sample, &points);
        remarks.extend(self.mounting.add(measured));
        self.motion.add(measured);
        self.ground.add(&points);
        self.sight.add(measured, &points, sample.objects());
        tally.n_samples += 1;
        tally.picture_sizes.insert((measured.intrinsics.width_px, measured.intrinsics.height_px));
        // An object's points are those of all LiDARs.
        if !reader.lidars().is_empty() {
            match reader.clouds(sample_idx) {
                Ok(clouds) => {
                    let in_ego =
                        clouds.iter().map(|cloud| sample::in_ego(&cloud.ego_from_lidar, &cloud.points));
                    points.extend(in_ego.flatten());
                }
                Err(error) => {
                    remarks.push(Remark::fault(
                        aspect_of(&error),
                        "cloud of a further LiDAR",
                        error.to_string(),
                    ));
                    return remarks;
                }
            }
        }
        remarks.extend(self.objects.add(sample.objects(), &points));
        let centers = sample.objects().iter().map(|object| object.box_in_ego.center);
        self.sum_range_m += centers.map(|center| center.x().hypot(center.y())).sum::<f64>();
        remarks
    }

    fn count(&self, tally: &mut Tally) {
        let (objects, sight) = (&self.objects, &self.sight);
        tally.n_objects += objects.n_boxes;
        tally.n_ids += objects.n_ids();
        tally.n_counted += objects.n_counted;
        tally.farthest_m = tally.farthest_m.max(objects.farthest_m);
        tally.fastest_mps = tally.fastest_mps.max(objects.fastest_mps);
        tally.n_points += sight.n_points;
        tally.n_across += sight.n_across;
        tally.n_inside += sight.n_inside;
        tally.n_rigs += u64::from(self.mounting.first().is_some());
        tally.n_driven += 1;
    }
}
