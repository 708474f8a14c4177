//! Import: logs of real cars to episodes that every other stage takes as they are.
//!
//! An importer of a format implements [`Log`] and [`Drive`]; [`run()`] is the pipeline that all formats share: one episode a drive, one
//! sample in memory, whole files or none, continued where it stopped.

mod av2;
mod cloud;
mod config;
mod drive;
mod error;
mod folder;
mod ground;
mod intensity;
mod kitti;
mod log;
mod motion;
mod notes;
pub mod nuscenes;
mod objects;
mod odometry;
mod pictures;
mod rectify;
mod rings;
pub mod ros2;
mod run;
mod samples;
mod state;
mod tracks;

pub use av2::{Av2Log, open_av2};
pub use config::{
    AssumedConfig, CategoryRule, GroundSource, IgnoreWord, ImportConfig, IntensityScale, LabelledConfig,
    LogFormat, ObjectRule, RingConfig, SizeConfig, VehicleConfig,
};
pub use error::ImportError;
pub use kitti::{KittiLog, RECTIFIED_CAMERA, open_kitti};
pub use log::{
    Distortion, Drive, DriveFacts, GroundHeight, Log, Odometry, RawCamera, RawFrame, RawImage, RawObject,
    RawPoint, Series,
};
pub use notes::Notes;
pub use run::{ImportOptions, ImportSummary, run};
