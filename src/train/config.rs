//! What a training run is: data order, stages, schedule, losses, augmentation.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::schedule::Schedule;
use crate::config::with_table;
use crate::model::{CameraBackbone, Classes, ModelConfig, ModelConfigError, NumericFusion};

/// `configs/train-paper.toml`: the keys in which training the `paper` profile differs from the default.
const PAPER_TOML: &str = include_str!("../../configs/train-paper.toml");

/// A training run; `configs/train.toml` equals the default.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TrainConfig {
    /// Seed of weights, order and augmentation.
    pub seed: u64,
    /// Samples of a batch.
    pub batch_size: usize,
    /// First stage: LiDAR, numeric branch and head. Default 10 epochs, as the paper; with 0 the camera trains
    /// with all the rest from the start.
    pub lidar_stage: StageConfig,
    /// Second stage: the camera joins. Default 3 epochs, as the paper; 0 without a camera.
    pub fused_stage: StageConfig,
    /// Share of a stage's steps over which the learning rate rises, or beta1 falls. Default 0.4.
    pub rise_share: f64,
    pub weight_decay: f32,
    /// L2 norm that all gradients together are scaled down to.
    pub clip_norm: f32,
    /// Decay of the moving average of the weights, which is what a run leaves behind; 0 leaves the last
    /// step's weights.
    pub average_decay: f64,
    /// Share of each epoch's places that go to samples with something harmful ahead, drawn again and again;
    /// the rest goes through all samples. 0 shows each sample once.
    pub harmful_share: f64,
    /// Batches whose mean gradient makes one step of the optimizer; as many as there are threads are computed
    /// side by side, each with its own batch statistics.
    pub accumulate: usize,
    /// Epochs between two scores on the validation split, written to `validation.csv`; 0 for none.
    pub validate_every_epochs: usize,
    /// Memory for prepared inputs, MiB; what does not fit is prepared anew in each epoch.
    pub cache_mib: usize,
    pub loss: LossConfig,
    pub augment: AugmentConfig,
    /// Steps between two states to resume from.
    pub save_every_steps: usize,
    /// Weights of the image backbone to start from, of torchvision, timm, Microsoft or mmdet; `--image-weights`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub image_weights: Option<PathBuf>,
    pub model: ModelConfig,
}

/// One training stage.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StageConfig {
    pub epochs: usize,
    /// Peak of the schedule's learning rate.
    pub max_learning_rate: f64,
    /// Default `one_cycle`.
    #[serde(default)]
    pub schedule: Schedule,
}

/// Weights of the losses, and of the assignment's costs, as TransFusion.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LossConfig {
    pub heatmap_weight: f64,
    pub harm_weight: f64,
    pub box_weight: f64,
    pub harm_cost: f64,
    pub center_cost: f64,
    pub iou_cost: f64,
}

impl Default for LossConfig {
    fn default() -> Self {
        Self {
            heatmap_weight: 1.0,
            harm_weight: 1.0,
            box_weight: 0.25,
            harm_cost: 0.15,
            center_cost: 0.25,
            iou_cost: 0.25,
        }
    }
}

/// Augmentation that keeps labels true to the zone.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct AugmentConfig {
    /// Reflects half of the samples in the ego's x-z plane, steering angle included.
    pub mirror: bool,
    /// Speeds and steering angles drawn anew for each sample beside the recorded ones; the objects are
    /// labelled again for each with the label set's zone. 0 turns it off, as does a network that does
    /// not see speed and steering.
    pub n_redrawn_states: usize,
    /// Share of the steering angles drawn anew that point at some object.
    pub aimed_share: f64,
    /// Fastest speed drawn, m/s.
    pub max_speed_mps: f64,
    /// Largest steering angle drawn, degrees.
    pub max_steering_deg: f64,
    /// Most objects of other samples pasted into a sample's cloud, 0 to this many, each as likely; none
    /// without a LiDAR branch.
    pub max_pasted: usize,
    /// Most that a pasted object is stretched or shrunk by, along each of its axes.
    pub max_stretch: f64,
    /// Share of the pasted static objects that lie on their side.
    pub tipped_share: f64,
}

impl Default for AugmentConfig {
    fn default() -> Self {
        Self {
            mirror: true,
            n_redrawn_states: 7,
            aimed_share: 0.5,
            max_speed_mps: 18.0,
            max_steering_deg: 35.0,
            max_pasted: 3,
            max_stretch: 1.5,
            tipped_share: 0.2,
        }
    }
}

impl Default for TrainConfig {
    fn default() -> Self {
        Self {
            seed: 0,
            batch_size: 2,
            lidar_stage: StageConfig { epochs: 10, max_learning_rate: 2e-3, schedule: Schedule::OneCycle },
            fused_stage: StageConfig { epochs: 3, max_learning_rate: 1e-3, schedule: Schedule::OneCycle },
            rise_share: 0.4,
            weight_decay: 0.01,
            clip_norm: 10.0,
            average_decay: 0.998,
            harmful_share: 0.0,
            accumulate: 2,
            validate_every_epochs: 1,
            cache_mib: 3072,
            loss: LossConfig::default(),
            augment: AugmentConfig::default(),
            save_every_steps: 100,
            image_weights: None,
            model: ModelConfig::default(),
        }
    }
}

/// What is wrong with a training config.
#[derive(Debug, Error)]
pub enum TrainConfigError {
    #[error("training config: `{field}` is {found}; {valid}")]
    Field { field: &'static str, found: String, valid: &'static str },
    #[error(transparent)]
    Model(#[from] ModelConfigError),
}

impl TrainConfig {
    /// Training of the `paper` profile, with the published schedules.
    #[must_use]
    pub fn paper() -> Self {
        let keys = PAPER_TOML.parse().expect("a test reads the shipped file");
        let default = Self { model: ModelConfig::paper(), ..Self::default() };
        with_table(&default, &keys).expect("a test reads the shipped file")
    }

    /// The augmentation that serves this network: no other states for one that does not see them, and no pasted
    /// objects, which pictures do not show, for one without LiDAR.
    #[must_use]
    pub fn augment_of_model(&self) -> AugmentConfig {
        let mut augment = self.augment;
        if self.model.head.numeric_fusion == NumericFusion::None {
            augment.n_redrawn_states = 0;
        }
        if !self.model.use_lidar {
            augment.max_pasted = 0;
        }
        augment
    }

    /// Checks what the types cannot say.
    ///
    /// # Errors
    /// Names the first field that does not fit, and what would.
    pub fn check(&self) -> Result<(), TrainConfigError> {
        let positive = [
            ("lidar_stage.max_learning_rate", self.lidar_stage.max_learning_rate),
            ("fused_stage.max_learning_rate", self.fused_stage.max_learning_rate),
            ("clip_norm", f64::from(self.clip_norm)),
            ("batch_size", self.batch_size as f64),
            ("accumulate", self.accumulate as f64),
            ("save_every_steps", self.save_every_steps as f64),
            ("epochs of both stages", (self.lidar_stage.epochs + self.fused_stage.epochs) as f64),
        ];
        for (field, found) in positive {
            if !(found > 0.0 && found.is_finite()) {
                return Err(TrainConfigError::Field {
                    field,
                    found: found.to_string(),
                    valid: "it must be a finite number above zero",
                });
            }
        }
        if !(self.augment.max_stretch >= 1.0 && self.augment.max_stretch.is_finite()) {
            return Err(TrainConfigError::Field {
                field: "augment.max_stretch",
                found: self.augment.max_stretch.to_string(),
                valid: "it must be 1, which is as it was, or more",
            });
        }
        let shares = [
            ("average_decay", self.average_decay),
            ("harmful_share", self.harmful_share),
            ("rise_share", self.rise_share),
            ("augment.aimed_share", self.augment.aimed_share),
            ("augment.tipped_share", self.augment.tipped_share),
        ];
        for (field, found) in shares {
            if !(0.0..=1.0).contains(&found) {
                return Err(TrainConfigError::Field {
                    field,
                    found: found.to_string(),
                    valid: "it must lie in 0..=1",
                });
            }
        }
        if self.model.use_camera != (self.fused_stage.epochs > 0) {
            return Err(TrainConfigError::Field {
                field: "fused_stage.epochs",
                found: self.fused_stage.epochs.to_string(),
                valid: "with model.use_camera it must be above zero, without it zero: the camera trains there",
            });
        }
        if !self.model.use_lidar && self.lidar_stage.epochs > 0 {
            return Err(TrainConfigError::Field {
                field: "lidar_stage.epochs",
                found: self.lidar_stage.epochs.to_string(),
                valid: "without model.use_lidar it must be zero: the LiDAR trains there",
            });
        }
        if self.model.head.classes == Classes::Kind && self.validate_every_epochs > 0 {
            return Err(TrainConfigError::Field {
                field: "validate_every_epochs",
                found: self.validate_every_epochs.to_string(),
                valid: "with model.head.classes = \"kind\" it must be zero: the score is of harm",
            });
        }
        let has_swin = self.model.use_camera && self.model.camera.backbone == CameraBackbone::Swin;
        if let Some(path) = self.image_weights.as_ref().filter(|_| !has_swin) {
            return Err(TrainConfigError::Field {
                field: "image_weights",
                found: path.display().to_string(),
                valid: "only a camera branch with backbone = \"swin\" takes image weights (--model paper)",
            });
        }
        Ok(self.model.check()?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_shipped_file_equals_the_default() {
        let shipped: TrainConfig = toml::from_str(include_str!("../../configs/train.toml")).unwrap();
        assert_eq!(shipped, TrainConfig::default());
        shipped.check().unwrap();
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
        with(&["lidar_stage.epochs=0"]).unwrap();
        with(&["model.use_camera=false", "fused_stage.epochs=0"]).unwrap();
        with(&["model.use_lidar=false", "lidar_stage.epochs=0"]).unwrap();
        for wrong in [&["model.use_lidar=false"], &["model.use_camera=false"], &["fused_stage.epochs=0"]] {
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
    fn a_negative_rate_is_named() {
        let mut config = TrainConfig::default();
        config.fused_stage.max_learning_rate = -1.0;
        assert!(config.check().unwrap_err().to_string().contains("fused_stage.max_learning_rate"));
    }
}
