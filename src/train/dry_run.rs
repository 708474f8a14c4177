//! A training run described before it starts: parameters, tensors, memory, steps.

use std::fmt;

use burn::tensor::Device;
use serde::Serialize;

use super::config::TrainConfig;
use super::data_check;
use super::error::TrainError;
use super::plan::STAGES;
use super::step::n_abreast;
use crate::dataset::SampleSource;
use crate::model::{Detector, NumericFusion, StepTensor, step_tensors};
use crate::text_table::text_table;

/// A run before it starts.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct DryRun {
    /// Trained numbers of each part.
    pub parameters: Vec<Part>,
    pub n_parameters: usize,
    pub tensors: Vec<StepTensor>,
    /// Memory of a training step, with the camera if the network has one.
    pub memory: Memory,
    pub batch_size: usize,
    /// Batches per step.
    pub accumulate: usize,
    /// Speeds and steering angles per sample.
    pub n_states: usize,
    pub stages: Vec<StageSteps>,
    pub n_steps: usize,
}

/// A part of the detector.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Part {
    pub name: &'static str,
    pub n_parameters: usize,
}

/// Estimated bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Memory {
    pub parameters: usize,
    pub gradients: usize,
    /// AdamW's two moments, and the parameters after the step beside those before it.
    pub optimizer: usize,
    /// The moving average of the parameters.
    pub average: usize,
    /// Tensors that autodiff keeps for the backward pass, of all batches that run in parallel.
    pub activations: usize,
    pub total: usize,
}

/// A stage of the run.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct StageSteps {
    pub name: &'static str,
    pub n_epochs: usize,
    pub n_steps: usize,
}

impl DryRun {
    /// Describes a run over a split; of what is on disk, it reads one episode. What would end the run before its first step,
    /// ends this, too.
    ///
    /// # Errors
    /// There are no training samples, the episode is broken, a picture does not fit the network, or the image weights do not.
    pub fn of<'a>(source: impl Into<SampleSource<'a>>, config: &TrainConfig) -> Result<Self, TrainError> {
        let source = source.into();
        data_check::check(source, config)?;
        if let Some(path) = &config.image_weights {
            Detector::init(&config.model, config.seed, &Device::flex()).load_image_weights(path)?;
        }
        Self::unchecked(source, config)
    }

    /// As [`Self::of`], for a run that is still to be checked.
    ///
    /// # Errors
    /// There are no training samples, or the episode is broken.
    pub(super) fn unchecked(source: SampleSource<'_>, config: &TrainConfig) -> Result<Self, TrainError> {
        let first = data_check::at_hand(source)?;
        let Some(first) = first.samples().first() else {
            return Err(TrainError::NoSamples { path: source.path().to_owned() });
        };
        let camera = &first.measured.intrinsics;
        Ok(Self::new(config, source.n_samples(), [camera.width_px, camera.height_px]))
    }

    /// Describes a run over `n_samples` samples with images of `image_px` (width, height). The config has passed its
    /// check.
    #[must_use]
    pub fn new(config: &TrainConfig, n_samples: usize, image_px: [u32; 2]) -> Self {
        let detector = Detector::init(&config.model, config.seed, &Device::flex().autodiff());
        let parameters: Vec<Part> = detector
            .n_parameters()
            .into_iter()
            .map(|(name, n_parameters)| Part { name, n_parameters })
            .collect();
        let n_parameters: usize = parameters.iter().map(|part| part.n_parameters).sum();
        let n_states = match config.model.head.numeric_fusion {
            NumericFusion::None => 1,
            NumericFusion::Paper | NumericFusion::Film => 1 + config.augment.n_redrawn_states,
        };
        let batch_size = config.batch_size.min(n_samples);
        let tensors = step_tensors(&config.model, batch_size, n_states, image_px);
        let bytes = 4 * n_parameters;
        let of_batch: usize = tensors.iter().map(|tensor| tensor.kept_bytes).sum();
        let activations = n_abreast(config, &Device::flex()) * of_batch;
        let steps_per_epoch = n_samples.div_ceil(config.batch_size * config.accumulate);
        let stages: Vec<StageSteps> = STAGES
            .into_iter()
            .zip([config.lidar_stage, config.fused_stage])
            .map(|(name, stage)| StageSteps {
                name,
                n_epochs: stage.epochs,
                n_steps: stage.epochs * steps_per_epoch,
            })
            .collect();
        Self {
            parameters,
            n_parameters,
            tensors,
            memory: Memory {
                parameters: bytes,
                gradients: bytes,
                optimizer: 3 * bytes,
                average: bytes,
                activations,
                total: 6 * bytes + activations,
            },
            batch_size,
            accumulate: config.accumulate,
            n_states,
            n_steps: stages.iter().map(|stage| stage.n_steps).sum(),
            stages,
        }
    }
}

impl fmt::Display for DryRun {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mib = |bytes: usize| format!("{:.1}", bytes as f64 / f64::from(1 << 20));
        let parts = self.parameters.iter().map(|part| (part.name.to_string(), part.n_parameters));
        let parts = parts.chain([("all".to_owned(), self.n_parameters)]);
        let parts = parts.map(|(name, n_parameters)| [name, n_parameters.to_string()]);
        writeln!(f, "{}", text_table(std::iter::once(["parameters", "n"].map(str::to_owned)).chain(parts)))?;
        let tensors = self.tensors.iter().map(|tensor| {
            let shape = tensor.shape.iter().map(ToString::to_string).collect::<Vec<_>>().join(" x ");
            [tensor.name.to_string(), shape, mib(tensor.kept_bytes)]
        });
        let head = ["main tensors of a step", "shape", "kept for the backward pass, MiB"].map(str::to_owned);
        writeln!(f, "{}", text_table(std::iter::once(head).chain(tensors)))?;
        let Memory { parameters, gradients, optimizer, average, activations, total } = self.memory;
        let memory = [
            ("parameters", parameters),
            ("gradients", gradients),
            ("optimizer", optimizer),
            ("moving average", average),
            ("activations", activations),
            ("all", total),
        ];
        let memory = memory.map(|(name, bytes)| [name.to_owned(), mib(bytes)]);
        let head = ["memory of a step, estimated", "MiB"].map(str::to_owned);
        write!(f, "{}", text_table(std::iter::once(head).chain(memory)))?;
        writeln!(f, "without the program and the data\n")?;
        let stages = self
            .stages
            .iter()
            .map(|stage| [stage.name.to_string(), stage.n_epochs.to_string(), stage.n_steps.to_string()]);
        let head = ["stage", "epochs", "steps"].map(str::to_owned);
        let all = ["all".to_owned(), String::new(), self.n_steps.to_string()];
        write!(f, "{}", text_table(std::iter::once(head).chain(stages).chain([all])))?;
        write!(
            f,
            "a step: {} batches of {}, {} states a sample",
            self.accumulate, self.batch_size, self.n_states
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Check;
    use crate::model::ModelConfig;
    use crate::train::StageConfig;

    fn of(model: ModelConfig, n_samples: usize) -> DryRun {
        let config = TrainConfig { model, ..TrainConfig::default() };
        config.check().unwrap();
        DryRun::new(&config, n_samples, [800, 450])
    }

    #[test]
    fn text_for_small() {
        insta::assert_snapshot!(of(ModelConfig::default(), 1001));
    }

    #[test]
    fn text_for_paper() {
        insta::assert_snapshot!(of(ModelConfig::paper(), 1001));
    }

    #[test]
    fn json() {
        let config = TrainConfig {
            model: ModelConfig { use_camera: false, ..ModelConfig::default() },
            lidar_stage: StageConfig { epochs: 10, ..TrainConfig::default().lidar_stage },
            fused_stage: StageConfig { epochs: 0, ..TrainConfig::default().fused_stage },
            ..TrainConfig::default()
        };
        let text = serde_json::to_string_pretty(&DryRun::new(&config, 3, [800, 450])).unwrap();
        insta::assert_snapshot!(text);
    }

    /// The published counts (of BEVFusion's two repositories): 39.8 M in all.
    #[test]
    fn paper_has_the_published_numbers_of_parameters() {
        let paper = of(ModelConfig::paper(), 1);
        let part = |name: &str| {
            let part = paper.parameters.iter().find(|part| part.name == name);
            part.unwrap_or_else(|| panic!("{name} among {:?}", paper.parameters)).n_parameters as f64
        };
        let near = |found: f64, published: f64, share: f64| (found / published - 1.0).abs() < share;
        assert!(near(paper.n_parameters as f64, 39.8e6, 0.02), "{}", paper.n_parameters);
        assert!(near(part("fuser"), 0.775e6, 0.001), "{}", part("fuser"));
        assert!(near(part("LiDAR encoder"), 2.694e6, 0.002), "{}", part("LiDAR encoder"));
        assert!(near(part("bird's-eye backbone"), 4.281e6 + 0.296e6, 0.001));
        assert!(near(part("image backbone"), 27.5e6, 0.005), "{}", part("image backbone"));
        assert!(near(part("camera neck and lift"), 1.591e6 + 0.058e6 + 1.380e6 + 0.173e6, 0.001));
    }

    /// The published head has 1.035 M with ten classes and no numeric branch.
    #[test]
    fn the_papers_head_has_the_published_number_of_parameters_and_its_numeric_branch() {
        let mut plain = ModelConfig::paper();
        plain.head.numeric_fusion = NumericFusion::None;
        let head = |model: ModelConfig| of(model, 1).parameters.last().unwrap().n_parameters;
        let (plain, full) = (head(plain), head(ModelConfig::paper()));
        // Eight classes fewer: heatmap (3x3 and bias), embedding, class net.
        let ten_classes = plain + 8 * (128 * 9 + 1) + 8 * 128 + 8 * (64 + 1);
        assert!((ten_classes as f64 / 1.035e6 - 1.0).abs() < 0.001, "{ten_classes}");
        assert_eq!(full - plain, 2 * 128 + 128 + 128 * 200 + 200 + 129 * 128 + 128);
    }

    #[test]
    fn lidar_alone_is_the_published_lidar_model() {
        let mut model = ModelConfig::paper();
        (model.use_camera, model.head.numeric_fusion) = (false, NumericFusion::None);
        let config = TrainConfig { model, ..TrainConfig::default() };
        let n = DryRun::new(&config, 1, [800, 450]).n_parameters;
        // 8.306 M, with ten classes.
        assert!((n as f64 / 8.306e6 - 1.0).abs() < 0.005, "{n}");
    }
}
