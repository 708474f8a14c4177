//! Sensors beside the front camera and the top LiDAR: what an episode says of them, and what a reader finds of them.

use foxglove::messages as fox;

use super::archive_reader::Archive;
use super::error::{EpisodeError, MessageFault};
use super::messages::TopicMessage;
use super::{checks, convert, topics};
use crate::geometry::{Camera, Frame, Lidar};
use crate::sample::Around;

/// Sensors beside the front camera and the top LiDAR, by name.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct OtherSensors {
    pub cameras: Vec<String>,
    pub lidars: Vec<String>,
    /// LiDARs, the top one among them, that have sweeps between samples.
    pub sweeping: Vec<String>,
}

impl OtherSensors {
    /// What a file has, sorted by name; its topics are taken.
    pub(super) fn of(archive: &mut Archive) -> Result<Self, EpisodeError> {
        let found = |of: fn(&str) -> Option<&str>| -> Vec<String> {
            archive.topics().filter_map(of).map(str::to_owned).collect()
        };
        let mut others = Self {
            cameras: found(topics::camera_of),
            lidars: found(topics::lidar_of),
            sweeping: found(topics::lidar_of_sweeps),
        };
        others.cameras.retain(|name| name != Camera::NAME);
        others.lidars.retain(|name| name != Lidar::NAME);
        for [image, info] in others.cameras.iter().map(|name| topics::of_camera(name)) {
            archive.take(&image, fox::CompressedImage::schema)?;
            archive.take(&info, fox::CameraCalibration::schema)?;
        }
        for topic in others.clouds() {
            archive.take(&topic, fox::PointCloud::schema)?;
        }
        for name in &others.sweeping {
            archive.set_aside(&topics::of_sweeps(name));
        }
        Ok(others)
    }

    /// The topics that have a message for each sample.
    pub(super) fn each_sample(&self) -> impl Iterator<Item = String> {
        let of_cameras = self.cameras.iter().flat_map(|name| topics::of_camera(name));
        of_cameras.chain(self.lidars.iter().map(|name| topics::of_lidar(name)))
    }

    /// The topics of all clouds.
    pub(super) fn clouds(&self) -> impl Iterator<Item = String> {
        let of_lidars = self.lidars.iter().map(|name| topics::of_lidar(name));
        of_lidars.chain(self.sweeping.iter().map(|name| topics::of_sweeps(name)))
    }

    /// Whether these are the sensors of a sample at a time, and its sweeps lie after the sample before.
    pub(super) fn check(
        &self,
        around: Around<'_>,
        before_ns: Option<u64>,
        time_ns: u64,
    ) -> Result<(), MessageFault> {
        let cameras = around.views.iter().map(|view| view.name.as_str());
        let lidars = around.clouds.iter().map(|cloud| cloud.name.as_str());
        same("cameras", cameras, &self.cameras)?;
        same("lidars", lidars, &self.lidars)?;
        for view in around.views {
            convert::check_pinhole(&view.intrinsics)?;
            checks::check_picture_size(&view.image, &view.intrinsics)?;
        }
        let mut last_ns = before_ns.unwrap_or(time_ns);
        for sweep in around.sweeps {
            if !self.sweeping.contains(&sweep.lidar) {
                let found = format!("of `{}` in an episode with sweeps of {:?}", sweep.lidar, self.sweeping);
                return Err(MessageFault::new(
                    "sweeps",
                    found,
                    "the LiDARs with which the episode was started are needed",
                ));
            }
            if !(last_ns..time_ns).contains(&sweep.time_ns) {
                let found = format!("at {} ns, before a sample at {time_ns} ns", sweep.time_ns);
                return Err(MessageFault::new(
                    "sweeps",
                    found,
                    "times between two samples, in order, are needed",
                ));
            }
            last_ns = sweep.time_ns;
        }
        Ok(())
    }
}

fn same<'a>(
    what: &'static str,
    found: impl Iterator<Item = &'a str> + Clone,
    wanted: &[String],
) -> Result<(), MessageFault> {
    if found.clone().eq(wanted.iter().map(String::as_str)) {
        return Ok(());
    }
    let found = format!("{:?} in an episode with {wanted:?}", found.collect::<Vec<_>>());
    Err(MessageFault::new(what, found, "the same sensors in each sample are needed"))
}
