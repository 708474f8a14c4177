//! Which objects around a driving car matter? harmzone makes driving episodes, labels objects harmful or harmless by a
//! danger zone, trains a LiDAR-camera detector on that question and scores any detector by it.
//!
//! A zone, labels and a score, without a file or a network:
//!
//! ```
//! use harmzone::dataset::SampleFacts;
//! use harmzone::eval::{EvalSample, Mode, Protocol, score};
//! use harmzone::geometry::{Box3, Point};
//! use harmzone::object::{Detection, Harm, LabelledObject, Object};
//! use harmzone::sample::EgoState;
//! use harmzone::zone::{Zone, ZoneConfig, ZoneError};
//!
//! // The ground that a car needs at 10 m/s, straight on: 25 m beyond its bumper, a lane wide.
//! let ego = EgoState {
//!     speed_mps: 10.0,
//!     steering_angle_rad: 0.0,
//!     yaw_rate_rps: 0.0,
//!     acceleration_mps2: 0.0,
//!     wheelbase_m: 2.7,
//!     front_bumper_x_m: 3.6,
//! };
//! let zone = Zone::try_from(ZoneConfig::default())?.at(&ego)?;
//!
//! // One sofa lies in the lane, one beside it. The zone labels them.
//! let standing = [0.0, 0.0];
//! let sofa = |x_m, y_m| {
//!     Box3 { center: Point::new(x_m, y_m, 0.4), length_m: 0.9, width_m: 2.0, height_m: 0.8, yaw_rad: 0.0 }
//! };
//! let label = |box_in_ego| {
//!     let harm = zone.harm_of(&box_in_ego, standing)?.harm;
//!     Ok::<_, ZoneError>(LabelledObject { truth: Object::new(box_in_ego), harm })
//! };
//! let objects = vec![label(sofa(20.0, 0.5))?, label(sofa(20.0, 6.0))?];
//! assert_eq!([objects[0].harm, objects[1].harm], [Harm::Harmful, Harm::Harmless]);
//!
//! // A detector finds both, 0.7 m too far off, and takes both for harmful.
//! let found = |box_in_ego, score| {
//!     Detection { box_in_ego, velocity_in_ego_mps: standing, harm: Harm::Harmful, score, spread: None }
//! };
//! let detections = vec![found(sofa(20.7, 0.5), 0.9), found(sofa(20.7, 6.0), 0.4)];
//! let sample = EvalSample::new("street/0", SampleFacts::default(), objects, detections);
//!
//! // The harmful one is matched at 1, 2 and 4 m and missed at 0.5 m, and the false one ranks below it; nobody reported a harmless one.
//! let ap = score(&[sample], &Protocol::default(), Mode::Id)?.columns.total;
//! assert!((ap.harmful.unwrap() - 0.75).abs() < 0.01 && ap.harmless == Some(0.0));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! The modules in the order of their layers, each of which imports only from those before it (`tests/architecture.rs`
//! checks it; `ARCHITECTURE.md` draws the pipeline):
//!
//! - what everything stands on: [`config`], [`device`], [`files`], [`geometry`], [`history`], [`meshes`], [`progress`], [`random`],
//!   [`store`], [`text_table`], [`worker`];
//! - what is in a sample: [`object`], [`sample`], [`nuscenes`]; the rule by which objects matter: [`zone`]; what rays meet first: [`rays`];
//! - the world: [`scene`], [`sensors`], [`sim`]; its files: [`episode`]; the stages that write them: [`generate`], [`import`],
//!   [`label`], [`export`]; and what reads them: [`dataset`];
//! - two data sets side by side: [`compare`];
//! - the network: [`kernels`], [`model`], [`infer`], [`train`]; predictions of others: [`exchange`]; the scores: [`eval`], [`report`], and a page of
//!   all in the browser: [`serve`];
//!   the closed loop: [`drive`], and what comes of it: [`outcome`];
//! - the program's flags: [`cli`].

#[cfg(not(any(feature = "embed", feature = "wheel")))]
compile_error!("the simulator needs Python: the feature `embed` for the program, `wheel` for `make wheel`");

pub mod config;
pub mod device;
pub mod files;
pub mod geometry;
pub mod history;
pub mod interrupt;
pub mod meshes;
pub mod progress;
pub mod random;
pub mod store;
pub mod text_table;
pub mod worker;

pub mod nuscenes;
pub mod object;
pub mod rays;
pub mod sample;
pub mod zone;

pub mod scene;
pub mod sensors;

pub mod episode;
#[allow(clippy::disallowed_methods, reason = "the one module that speaks to Python")]
pub mod sim;

pub mod export;
pub mod generate;
pub mod import;
pub mod label;

pub mod dataset;
#[allow(unsafe_code, reason = "vector instructions; every block states its bounds")]
pub mod kernels;

pub mod compare;
pub mod drive;
pub mod eval;
pub mod exchange;
pub mod infer;
pub mod model;
pub mod outcome;
pub mod train;

pub mod report;
pub mod serve;

pub mod cli;

#[cfg(feature = "wheel")]
#[allow(clippy::disallowed_methods, reason = "it speaks to Python")]
pub mod python;
