//! The whole detector: LiDAR and camera branches, fuser, head.

use std::path::Path;
use std::sync::{Mutex, PoisonError};

use burn::module::{Module, ModuleVisitor, Param};
use burn::tensor::{Device, Tensor};

use super::batch::Batch;
use super::bev_backbone::BevBackbone;
use super::camera::{CameraBranch, ImageFeatures};
use super::config::ModelConfig;
use super::head::{Head, Output};
use super::image_weights::{ImageWeightsError, ImageWeightsReport, load_image_weights};
use super::layers::ConvBlock;
use super::lidar::{LidarBranch, LidarMaps};
use super::parameters::n_trained;
use crate::device::is_cpu;

/// The device's generator is one for the whole process.
static GENERATOR: Mutex<()> = Mutex::new(());

/// A fused LiDAR-camera detector of harmful and harmless objects.
#[derive(Module, Debug)]
pub struct Detector {
    lidar: Option<LidarBranch>,
    camera: Option<CameraBranch>,
    fuser: Option<ConvBlock>,
    backbone: Option<BevBackbone>,
    head: Head,
    #[module(skip)]
    config: ModelConfig,
}

impl Detector {
    /// A detector with random weights from `seed`: same seed, same weights, whatever the device.
    #[must_use]
    pub fn init(config: &ModelConfig, seed: u64, device: &Device) -> Self {
        let cpu = if device.is_autodiff() { Device::flex().autodiff() } else { Device::flex() };
        let detector = {
            // Parameters are drawn when first read: hold the generator until all are drawn.
            let _held = GENERATOR.lock().unwrap_or_else(PoisonError::into_inner);
            cpu.seed(seed);
            let detector = Self::build(config, &cpu);
            detector.visit(&mut Draw);
            detector
        };
        if *device == cpu { detector } else { detector.to_device(device) }
    }

    /// Does work that draws the random numbers of training, dropout and drop path, from a seed; nobody else draws meanwhile.
    pub fn with_generator<R>(device: &Device, seed: u64, work: impl FnOnce() -> R) -> R {
        let _held = GENERATOR.lock().unwrap_or_else(PoisonError::into_inner);
        device.seed(seed);
        work()
    }

    /// Loads the image backbone's weights from a file of another library.
    ///
    /// # Errors
    /// The file cannot be read or does not fit.
    ///
    /// # Panics
    /// If the camera branch has no Swin Transformer.
    pub fn load_image_weights(&mut self, path: &Path) -> Result<ImageWeightsReport, ImageWeightsError> {
        let Some(CameraBranch::Swin(branch)) = &mut self.camera else {
            panic!("the training config was checked: image weights need a Swin Transformer");
        };
        load_image_weights(path, branch.swin_mut())
    }

    fn build(config: &ModelConfig, device: &Device) -> Self {
        let channels_in = config.lidar_channels() + config.camera_channels();
        Self {
            lidar: config.use_lidar.then(|| LidarBranch::init(config, device)),
            camera: config.use_camera.then(|| CameraBranch::init(config, device)),
            fuser: config
                .has_fuser()
                .then(|| ConvBlock::init(channels_in, config.fuser_channels, 1, device).with_plain_norm()),
            backbone: config
                .has_backbone()
                .then(|| BevBackbone::init(config.fused_channels(), &config.lidar.voxel.backbone, device)),
            head: Head::init(config.head_channels_in(), &config.head, &config.grid, device).with_look(
                config.look_pillars(),
                config.lidar.pillars.channels,
                device,
            ),
            config: config.clone(),
        }
    }

    #[must_use]
    pub fn config(&self) -> &ModelConfig {
        &self.config
    }

    /// Names of the parts and the number of trained parameters in each; the detector is on an autodiff device.
    #[must_use]
    pub fn n_parameters(&self) -> Vec<(&'static str, usize)> {
        let mut parts = vec![("LiDAR encoder", self.lidar.as_ref().map(n_trained))];
        match &self.camera {
            Some(CameraBranch::Swin(branch)) => {
                let n_swin = n_trained(branch.swin());
                parts.push(("image backbone", Some(n_swin)));
                parts.push(("camera neck and lift", Some(n_trained(branch) - n_swin)));
            }
            camera => parts.push(("camera branch", camera.as_ref().map(n_trained))),
        }
        parts.push(("fuser", self.fuser.as_ref().map(n_trained)));
        parts.push(("bird's-eye backbone", self.backbone.as_ref().map(n_trained)));
        parts.push(("head", Some(n_trained(&self.head))));
        parts.into_iter().filter_map(|(name, n)| Some((name, n?))).collect()
    }

    /// Runs the whole network. Without camera inputs in the batch (the LiDAR stage) the camera's channels are zero:
    /// the fuser's LiDAR half learns there, and the camera later joins a network that already detects.
    ///
    /// # Panics
    /// If the batch was made with another config.
    pub fn forward(&self, batch: &Batch) -> Output {
        let device = batch.numeric.device();
        // On a GPU, work from two threads would wait for each other.
        if device.is_autodiff() || !is_cpu(&device) {
            let features = self.image_features(batch);
            let picture_objects = self.picture_objects(features.as_ref());
            let lidar = self.lidar_map(batch, features.as_ref());
            let pillars = lidar.as_ref().and_then(|maps| maps.pillars.clone());
            let output = self.head(batch, self.fuse(self.camera_map(batch, features), lidar), pillars);
            return Output { picture_objects, ..output };
        }
        // Inside the pool no operation has to wake it and wait; and while one branch uses one thread, the
        // other branch uses the rest.
        rayon::scope(|_| {
            let (camera, lidar) = if self.config.paint_channels() > 0 {
                let features = self.image_features(batch);
                let of_points = features.clone();
                rayon::join(|| self.camera_map(batch, features), || self.lidar_map(batch, of_points.as_ref()))
            } else {
                let camera = || self.camera_map(batch, self.image_features(batch));
                rayon::join(camera, || self.lidar_map(batch, None))
            };
            let pillars = lidar.as_ref().and_then(|maps| maps.pillars.clone());
            self.head(batch, self.fuse(camera, lidar), pillars)
        })
    }
}

/// The parts of [`Detector::forward`], in its order; maps are `[batch, channel, cell_y, cell_x]`.
impl Detector {
    /// The camera branch before its lift, if the two are separate.
    pub(super) fn image_features(&self, batch: &Batch) -> Option<ImageFeatures> {
        let (branch, batch) = self.camera.as_ref().zip(batch.camera.as_ref())?;
        Some(branch.image_features(batch))
    }

    /// The camera's map from [`Self::image_features`].
    pub(super) fn camera_map(&self, batch: &Batch, features: Option<ImageFeatures>) -> Option<Tensor<4>> {
        let branch = self.camera.as_ref()?;
        if let (Some(batch), Some(features)) = (&batch.camera, features) {
            return Some(branch.lift(features, batch));
        }
        let grid = &self.config.grid;
        let channels = self.config.camera_channels();
        let shape = [batch.n_samples, channels, grid.n_cells_y(), grid.n_cells_x()];
        Some(Tensor::zeros(shape, &batch.numeric.device()))
    }

    /// The LiDAR's map, whose points take along what `features` show.
    pub(super) fn lidar_map(&self, batch: &Batch, features: Option<&ImageFeatures>) -> Option<LidarMaps> {
        let branch = self.lidar.as_ref()?;
        let points = batch.lidar.as_ref().expect("the batch was made with this config");
        let painted = features.zip(batch.camera.as_ref()).and_then(|(of, batch)| of.of_points(batch));
        Some(branch.forward(points, painted, batch.n_samples, &batch.numeric.device()))
    }

    /// Whether each pixel shows an object.
    fn picture_objects(&self, features: Option<&ImageFeatures>) -> Option<Tensor<4>> {
        self.camera.as_ref()?.objects(features?)
    }

    /// The map that the head sees.
    pub(super) fn fuse(&self, camera: Option<Tensor<4>>, lidar: Option<LidarMaps>) -> Tensor<4> {
        let lidar = lidar.map(|maps| maps.map);
        let mut x = Tensor::cat(camera.into_iter().chain(lidar).collect(), 1);
        if let Some(fuser) = &self.fuser {
            x = fuser.forward(x);
        }
        if let Some(backbone) = &self.backbone {
            x = backbone.forward(x);
        }
        x
    }

    /// The head's output, whose queries look at `pillars` if the config says so.
    pub(super) fn head(&self, batch: &Batch, fused: Tensor<4>, pillars: Option<Tensor<4>>) -> Output {
        self.head.forward(fused, pillars, batch.numeric.clone())
    }
}

/// Reads each parameter, which draws it.
struct Draw;

impl ModuleVisitor for Draw {
    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        let _drawn = param.val();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Check;
    use crate::dataset::test_data;
    use crate::model::Input;
    use crate::model::head::coder::CODE_SIZE;
    use crate::model::head::detections;
    use burn::optim::GradientsParams;

    fn batch(config: &ModelConfig, with_camera: bool, device: &Device) -> Batch {
        let data = test_data::dataset(2);
        let prepare = |sample: &crate::dataset::LabelledSample| {
            let input = Input::prepare(&sample.measured, config, false, true).unwrap();
            // Two states per sample.
            input.with_states(&[sample.measured.ego_state; 2], false).unwrap()
        };
        let inputs: Vec<Input> = data.samples().iter().map(prepare).collect();
        Batch::stack(&inputs.iter().collect::<Vec<_>>(), config, with_camera, device)
    }

    #[test]
    fn either_branch_or_both_make_a_detector_of_either_profile() {
        let device = Device::flex();
        for config in ModelConfig::in_little() {
            for (use_lidar, use_camera) in [(true, true), (true, false), (false, true)] {
                let config = ModelConfig { use_lidar, use_camera, ..config.clone() };
                config.check().unwrap();
                let detector = Detector::init(&config, 0, &device);
                let output = detector.forward(&batch(&config, use_camera, &device));
                assert_eq!(output.boxes.dims(), [4, 20, CODE_SIZE]);
                let cells = [config.grid.n_cells_y(), config.grid.n_cells_x()];
                assert_eq!(output.heatmap.dims()[2..], cells.map(|n| config.head.heatmap_scale * n));
                assert!(output.harm.sum().into_scalar::<f32>().is_finite());
            }
        }
    }

    /// Each parameter of both branches takes part: every one gets a gradient.
    #[test]
    fn gradients_reach_every_parameter() {
        let device = Device::flex().autodiff();
        for config in ModelConfig::in_little() {
            let detector = Detector::init(&config, 0, &device);
            let output = detector.forward(&batch(&config, true, &device));
            let mut loss = output.heatmap.sum() + output.boxes.abs().sum() + output.harm.abs().sum();
            if let Some(objects) = output.picture_objects {
                loss = loss + objects.sum();
            }
            let gradients = GradientsParams::from_grads(loss.backward(), &detector);
            let mut missing = Missing { gradients: &gradients, n_missing: 0 };
            detector.visit(&mut missing);
            assert_eq!(missing.n_missing, 0);
        }
    }

    struct Missing<'a> {
        gradients: &'a GradientsParams,
        n_missing: usize,
    }

    impl ModuleVisitor for Missing<'_> {
        fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
            let is_left_out = param.val().is_require_grad() && self.gradients.get::<D>(param.id).is_none();
            self.n_missing += usize::from(is_left_out);
        }
    }

    #[test]
    fn the_lidar_stage_and_a_sample_without_points_pass_through() {
        let device = Device::flex();
        for config in ModelConfig::in_little() {
            let mut data = test_data::dataset(1);
            data.sample_mut(0).measured.points.clear();
            let input = Input::prepare(&data.samples()[0].measured, &config, false, true).unwrap();
            let batch = Batch::stack(&[&input], &config, false, &device);
            let output = Detector::init(&config, 0, &device).forward(&batch);
            assert!(output.boxes.sum().into_scalar::<f32>().is_finite());
        }
    }

    #[test]
    fn a_query_of_a_class_specific_heatmap_reports_its_class_alone() {
        let device = Device::flex();
        let [small, paper] = ModelConfig::in_little();
        let classes = |config: &ModelConfig, min_score: f32| {
            let output = Detector::init(config, 0, &device).forward(&batch(config, true, &device));
            let n_queries = output.queries[0].len();
            (detections(&output, config, min_score)[0].len(), n_queries)
        };
        let (n_small, n_queries) = classes(&small, 0.0);
        assert_eq!(n_small, 2 * n_queries);
        let (n_paper, n_queries) = classes(&paper, 0.0);
        assert_eq!(n_paper, n_queries);
    }
}
