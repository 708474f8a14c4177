//! What a training run is: data order, stages, schedule, losses, augmentation.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::schedule::Schedule;
use crate::config::{
    Bounds, Check, Docs, InvalidConfig, Keys, Rule, SHARE, above, define_config, from_to, impl_checked, part,
    require, with_table,
};
use crate::kernels::Products;
use crate::model::{CameraBackbone, Classes, ModelConfig, NumericFusion};

/// `configs/train-paper.toml`: the keys in which training the `paper` profile differs from the default.
const PAPER_TOML: &str = include_str!("../../configs/train-paper.toml");

define_config! {
    /// A training run; `configs/train.toml` equals the default.
    pub struct TrainConfig {
        /// Seed of weights, order and augmentation.
        seed: u64 = 0, in Rule::Any;
        /// Samples of a batch.
        batch_size: usize = 2, in from_to(1.0, 1024.0);
        /// First stage: LiDAR, numeric branch and head. Default 0 epochs, the paper's 10; with 0 the camera trains
        /// with all the rest from the start.
        lidar_stage: StageConfig =
            StageConfig { epochs: 0, max_learning_rate: 2e-3, schedule: Schedule::OneCycle },
            in part::<StageConfig>();
        /// Second stage: the camera joins. Default 10 epochs, the paper's 3; 0 without a camera.
        fused_stage: StageConfig =
            StageConfig { epochs: 10, max_learning_rate: 2e-3, schedule: Schedule::OneCycle },
            in part::<StageConfig>();
        /// Share of a stage's steps over which the learning rate rises, or beta1 falls. Default 0.4.
        rise_share: f64 = 0.4, in SHARE;
        /// Of AdamW.
        weight_decay: f32 = 0.01, in from_to(0.0, 1000.0);
        /// L2 norm that all gradients together are scaled down to.
        clip_norm: f32 = 10.0, in above(0.0, 1e9);
        /// Decay of the moving average of the weights, which is the result of a run; 0 gives the last
        /// step's weights.
        average_decay: f64 = 0.998, in SHARE;
        /// Share of each epoch's places given to samples with something harmful ahead, drawn again and again;
        /// the other places go through all samples. 0 shows each sample once.
        harmful_share: f64 = 0.0, in SHARE;
        /// Batches whose mean gradient makes one step of the optimizer; as many as there are threads are computed
        /// side by side, each with its own batch statistics.
        accumulate: usize = 2, in from_to(1.0, 1024.0);
        /// Share of a stage's steps after which batch norms keep their running statistics, as at inference, in place of each small
        /// batch's own. Default 1.
        norms_until: f64 = 1.0, in SHARE;
        /// What convolutions multiply in training; default `f32`. With `bf16` a step takes less time on CPUs with AVX512-BF16, and
        /// as long as before on others.
        products: Products = Products::F32;
        /// Epochs between two scorings of the validation split, written to `validation.csv`; 0 for none.
        validate_every_epochs: usize = 1, in from_to(0.0, 1e6);
        /// Memory for prepared inputs, MiB; what does not fit is prepared anew in each epoch.
        cache_mib: usize = 3072, in from_to(0.0, 1e7);
        // Left out of a run's own config where it is off, so that runs from before it go on.
        #[serde(skip_serializing_if = "StreamConfig::is_off")]
        stream: StreamConfig = StreamConfig::default(), in part::<StreamConfig>();
        loss: LossConfig = LossConfig::default(), in part::<LossConfig>();
        augment: AugmentConfig = AugmentConfig::default(), in part::<AugmentConfig>();
        /// Steps between two saved states to resume from.
        save_every_steps: usize = 100, in from_to(1.0, 1e9);
        /// Weights of the image backbone to start from, by torchvision, timm, Microsoft or mmdet;
        /// `--image-weights`.
        #[serde(skip_serializing_if = "Option::is_none")]
        image_weights: Option<PathBuf> = None;
        model: ModelConfig = ModelConfig::default(), in part::<ModelConfig>();
    }
}

define_config! {
    /// Training on data that need not fit in memory.
    #[derive(Copy, Eq)]
    pub struct StreamConfig {
        /// Episodes of a window: each epoch shuffles the episodes, cuts them into windows, and shows one window after the
        /// other. The windows of a step and the next one are in memory. 0 loads the whole split.
        window_episodes: usize = 0, in from_to(0.0, 1e9);
    }
}

impl StreamConfig {
    /// Whether the whole split is in memory.
    #[must_use]
    pub fn is_off(&self) -> bool {
        self.window_episodes == 0
    }
}

/// One training stage.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StageConfig {
    /// Passes over the training split; 0 leaves the stage out.
    pub epochs: usize,
    /// Peak of the schedule's learning rate.
    pub max_learning_rate: f64,
    /// Default `one_cycle`.
    #[serde(default)]
    pub schedule: Schedule,
}

define_config! {
    /// Weights of the losses, and of the assignment's costs, as TransFusion.
    #[derive(Copy)]
    pub struct LossConfig {
        /// Of the heatmap's focal loss.
        heatmap_weight: f64 = 1.0, in WEIGHT;
        /// Of the class branch's focal loss.
        harm_weight: f64 = 1.0, in WEIGHT;
        /// Of the L1 loss of boxes.
        box_weight: f64 = 0.25, in WEIGHT;
        /// Of the spreads of boxes, within `box_weight`, where the network predicts them.
        spread_weight: f64 = 1.0, in WEIGHT;
        /// Of a wrong class in matching queries with objects.
        harm_cost: f64 = 0.15, in WEIGHT;
        /// Of the distance of centres in matching.
        center_cost: f64 = 0.25, in WEIGHT;
        /// Of too little overlap in matching.
        iou_cost: f64 = 0.25, in WEIGHT;
        /// How far from an object's middle a query may sit to be matched with it, metres; as far as half the box's diagonal and
        /// half of this, if that is more.
        match_reach_m: f64 = 1.5, in from_to(0.1, 1e6);
        /// Losses of a batch are divided by at least so many objects: in one with a single object the background would weigh
        /// many times as much.
        least_objects: f64 = 3.0, in from_to(1.0, 1000.0);
        /// Of the loss that asks of each pixel whether it shows an object, where points take the picture's features along.
        picture_weight: f64 = 1.0, in WEIGHT;
        /// Objects that cover fewer cells of the picture's map weigh as much in it as if they covered so many.
        least_picture_cells: f64 = 12.0, in from_to(1.0, 1e4);
        /// Whether the yaw of a static object may be learnt half a turn off: it has no front.
        turns_statics: bool = false;
        /// What objects that no LiDAR point hit are to the network.
        unhit: Unhit = Unhit::Ignored;
        /// Fewest pixels that an unhit object must show to be more than background.
        min_visible_px: u32 = 40, in from_to(1.0, 1e9);
    }
}

/// What a visible object that no LiDAR point hit is to the network. Scores leave such objects out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Unhit {
    /// Nothing.
    Background,
    /// Neither object nor nothing.
    Ignored,
    /// An object like others.
    Truth,
}

define_config! {
    /// Augmentation that keeps labels true to the zone.
    #[derive(Copy)]
    pub struct AugmentConfig {
        /// Reflects half of the samples in the ego's x-z plane, steering angle included.
        mirror: bool = true;
        /// Speeds and steering angles drawn anew for each sample beside the recorded ones; the objects are
        /// labelled again for each with the label set's zone. 0 turns it off, as does a network that does
        /// not see speed and steering.
        n_redrawn_states: usize = 7, in from_to(0.0, 1000.0);
        /// Share of the steering angles drawn anew that point at some object.
        aimed_share: f64 = 0.5, in SHARE;
        /// Fastest speed drawn, m/s.
        max_speed_mps: f64 = 18.0, in from_to(0.0, 100.0);
        /// Largest steering angle drawn, degrees.
        max_steering_deg: f64 = 35.0, in from_to(0.0, 80.0);
        /// Standard deviation of what the network is told of a speed drawn anew, as a share of it; the labels are of the true
        /// one.
        speed_error: f64 = 0.0, in from_to(0.0, 1.0);
        /// The same of a steering angle, degrees.
        steering_error_deg: f64 = 0.0, in from_to(0.0, 20.0);
        /// Most objects of other samples pasted into a sample's cloud: 0 to this many, equally likely; none
        /// without a LiDAR branch.
        max_pasted: usize = 3, in from_to(0.0, 100.0);
        /// Share of a stage's steps after which nothing is pasted any more, as PointAugmenting's fade: what is pasted, the picture does
        /// not show, so that a network learns to believe points that no picture bears out. Default 1.
        paste_until: f64 = 1.0, in SHARE;
        /// Whether what is pasted comes from samples of as much fog and rain.
        paste_alike: bool = false;
        /// Pasted objects are not made smaller than this along their longest side, metres.
        least_pasted_m: f64 = 0.0, in from_to(0.0, 10.0);
        /// Largest factor by which a pasted object is stretched or shrunk along each of its axes.
        max_stretch: f64 = 1.5, in from_to(1.0, 10.0);
        /// Share of the pasted objects that stand farther away than they did, with as many points as a LiDAR has there.
        moved_share: f64 = 0.5, in SHARE;
        /// Largest factor of their distance.
        max_moved: f64 = 2.5, in from_to(1.0, 10.0);
        /// Share of the pasted static objects that are made smaller as a whole.
        shrunk_share: f64 = 0.3, in SHARE;
        /// Smallest factor of their size.
        min_shrink: f64 = 0.35, in from_to(0.05, 1.0);
        /// Share of the pasted static objects that lie on their side.
        tipped_share: f64 = 0.2, in SHARE;
        /// Share of the samples to which each of the next disturbances happens, apart from the others.
        disturbed_share: f64 = 0.8, in SHARE;
        /// Standard deviation of pitch and roll of the car and all its sensors, degrees; its height changes by 17 mm a degree.
        tilt_deg: f64 = 0.6, in from_to(0.0, 20.0);
        /// Standard deviation of the logarithms of a factor and an exponent on all intensities.
        intensity_spread: f64 = 0.3, in from_to(0.0, 3.0);
        /// Most noise along a beam, metres.
        range_noise_m: f64 = 0.04, in from_to(0.0, 1.0);
        /// Most returns lost at random.
        dropped_share: f64 = 0.2, in SHARE;
        /// Standard deviation of the logarithms of a factor and an exponent on the picture's colours.
        picture_spread: f64 = 0.25, in from_to(0.0, 3.0);
        /// Share of the samples with one ring in 2, 3 or 4.
        thinned_share: f64 = 0.1, in SHARE;
        /// Share of the samples whose cloud gets fog, of an optical range of 50 to 400 m.
        fogged_share: f64 = 0.1, in SHARE;
        /// Share of the samples without a cloud; with a picture only.
        no_cloud_share: f64 = 0.03, in SHARE;
        /// Share of the samples with a black picture.
        no_picture_share: f64 = 0.05, in SHARE;
    }
}

impl TrainConfig {
    /// Training of the `paper` profile, with the published schedules.
    #[must_use]
    pub fn paper() -> Self {
        let keys = PAPER_TOML.parse().expect("a test reads the shipped file");
        let default = Self { model: ModelConfig::paper(), ..Self::default() };
        with_table(&default, &keys).expect("a test reads the shipped file")
    }

    /// The augmentation for this network: no redrawn states if it does not see speed and steering, no
    /// pasted objects, which pictures do not show, if it has no LiDAR, and no sample without a sensor if it has no other.
    #[must_use]
    pub fn augment_of_model(&self) -> AugmentConfig {
        let mut augment = self.augment;
        if self.model.head.numeric_fusion == NumericFusion::None {
            augment.n_redrawn_states = 0;
        }
        if !self.model.use_lidar {
            augment.max_pasted = 0;
            augment.no_picture_share = 0.0;
        }
        if !self.model.use_camera {
            augment.no_cloud_share = 0.0;
        }
        augment
    }
}

impl Check for TrainConfig {
    fn check_relations(&self) -> Result<(), InvalidConfig> {
        let (of_lidar, of_camera) = (self.lidar_stage.epochs, self.fused_stage.epochs);
        let trains = of_lidar + of_camera > 0;
        require(trains, "lidar_stage.epochs", of_lidar, "epochs of both stages must be above zero together")?;
        let wanted = "with model.use_camera it must be above zero, without it zero: the camera trains there";
        require(self.model.use_camera == (of_camera > 0), "fused_stage.epochs", of_camera, wanted)?;
        let wanted = "without model.use_lidar it must be zero: the LiDAR trains there";
        require(self.model.use_lidar || of_lidar == 0, "lidar_stage.epochs", of_lidar, wanted)?;
        let (is_harm, every) = (self.model.head.classes == Classes::Harm, self.validate_every_epochs);
        let wanted = "with model.head.classes = \"kind\" it must be zero: the score is of harm";
        require(is_harm || every == 0, "validate_every_epochs", every, wanted)?;
        let has_swin = self.model.use_camera && self.model.camera.backbone == CameraBackbone::Swin;
        if let Some(path) = &self.image_weights {
            let wanted = "only a camera branch with backbone = \"swin\" takes image weights (--model paper)";
            require(has_swin, "image_weights", path.display(), wanted)?;
        }
        self.model.check_relations().map_err(|error| error.within("model"))
    }
}

impl Bounds for StageConfig {
    const BOUNDS: Keys = &[("epochs", from_to(0.0, 100_000.0)), ("max_learning_rate", above(0.0, 1000.0))];
    const DOCS: Docs = &[
        ("epochs", &["Passes over the training split; 0 leaves the stage out."]),
        ("max_learning_rate", &["Peak of the schedule's learning rate."]),
        ("schedule", &["How it rises and falls. Default `one_cycle`."]),
    ];
}

/// Bounds of the weight of a loss or cost.
const WEIGHT: Rule = from_to(0.0, 1e6);

impl_checked!(TrainConfig);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_shipped_file_equals_the_default() {
        let shipped: TrainConfig = toml::from_str(include_str!("../../configs/train.toml")).unwrap();
        assert_eq!(shipped, TrainConfig::default());
        crate::config::assert_every_number_is_checked(&shipped);
    }

    /// BEVFusion's two stages (mit-han-lab/bevfusion), with the epochs of arXiv 2506.23426.
    #[test]
    fn the_paper_profile_trains_as_published() {
        let paper = TrainConfig::paper();
        paper.check().unwrap();
        assert_eq!(paper.model, ModelConfig::paper());
        let stage = |epochs, max_learning_rate, schedule| StageConfig { epochs, max_learning_rate, schedule };
        assert_eq!(paper.lidar_stage, stage(10, 1e-3, Schedule::Cyclic));
        assert_eq!(paper.fused_stage, stage(3, 2e-4, Schedule::WarmupCosine));
        assert_eq!((paper.weight_decay, paper.clip_norm, paper.rise_share), (0.01, 35.0, 0.4));
        assert_eq!((paper.batch_size * paper.accumulate, paper.average_decay), (32, 0.0));
    }

    #[test]
    fn a_branch_that_is_not_there_has_no_stage_and_the_camera_may_train_from_the_start() {
        let with = |keys: &[&str]| {
            let keys: Vec<String> = keys.iter().map(|&key| key.to_owned()).collect();
            crate::config::with_overrides(&TrainConfig::default(), &keys).unwrap().check()
        };
        with(&[]).unwrap();
        with(&["lidar_stage.epochs=3"]).unwrap();
        with(&["model.use_camera=false", "lidar_stage.epochs=3", "fused_stage.epochs=0"]).unwrap();
        with(&["model.use_lidar=false"]).unwrap();
        let of_no_branch: [&[&str]; 3] = [
            &["model.use_lidar=false", "lidar_stage.epochs=3"],
            &["model.use_camera=false"],
            &["lidar_stage.epochs=3", "fused_stage.epochs=0"],
        ];
        for wrong in of_no_branch {
            let message = with(wrong).unwrap_err().to_string();
            assert!(message.contains("_stage.epochs"), "{wrong:?}: {message}");
        }
        let message = with(&["lidar_stage.epochs=0", "fused_stage.epochs=0"]).unwrap_err().to_string();
        assert!(message.contains("both stages"), "{message}");
    }

    #[test]
    fn a_closed_set_is_trained_without_scores_of_harm() {
        let mut config = TrainConfig::default();
        config.model.head.classes = Classes::Kind;
        assert!(config.check().unwrap_err().to_string().contains("validate_every_epochs"));
        config.validate_every_epochs = 0;
        config.check().unwrap();
    }

    #[test]
    fn a_stream_is_in_the_config_of_a_run_where_it_is_on() {
        let with = |n: &str| {
            let keys = [format!("stream.window_episodes={n}")];
            crate::config::with_overrides(&TrainConfig::default(), &keys).unwrap()
        };
        assert!(!crate::config::to_toml(&with("0")).contains("stream"));
        assert!(crate::config::to_toml(&with("64")).contains("[stream]\nwindow_episodes = 64\n"));
        assert_eq!(with("64").stream.window_episodes, 64);
        with("1000000000").check().unwrap();
        let told = with("1000000001").check().unwrap_err().to_string();
        assert!(told.contains("stream.window_episodes"), "{told}");
    }

    #[test]
    fn a_negative_rate_is_named() {
        let mut config = TrainConfig::default();
        config.fused_stage.max_learning_rate = -1.0;
        assert!(config.check().unwrap_err().to_string().contains("fused_stage.max_learning_rate"));
    }
}
