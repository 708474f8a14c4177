//! From one sample's cloud and packed picture to its boxes, stage by stage, so that each can be measured: the
//! functions that [`Input::prepare`], [`Detector::forward`] and [`detections`] call, one after the other.

use burn::tensor::Device;

use super::batch::Batch;
use super::detector::Detector;
use super::head::detections;
use super::input::{Input, InputError};
use crate::object::Detection;
use crate::sample::Measured;

/// Detects the boxes of one sample, best first, and calls `done` with the name of each stage when it ends. The
/// detector is in inference mode.
///
/// # Errors
/// The image is broken or too flat, or speed or steering is not finite.
pub fn detect_by_stage(
    detector: &Detector,
    measured: &Measured,
    min_score: f32,
    device: &Device,
    done: &mut dyn FnMut(&'static str),
) -> Result<Vec<Detection>, InputError> {
    let config = detector.config();
    let input = Input::prepare_by_stage(measured, config, false, true, done)?;
    let batch = Batch::stack(&[&input], config, true, device);
    done("tensors");
    let features = detector.image_features(&batch);
    done("camera branch");
    let lidar = detector.lidar_map(&batch, features.as_ref());
    done("LiDAR branch");
    let camera = detector.camera_map(&batch, features);
    done("lift and splat");
    let pillars = lidar.as_ref().and_then(|maps| maps.pillars.clone());
    let fused = detector.fuse(camera, lidar);
    done("fuser and backbone");
    let output = detector.head(&batch, fused, pillars);
    done("head");
    let found = detections(&output, config, min_score);
    done("box decode");
    Ok(found.concat())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::test_data;
    use crate::model::ModelConfig;

    #[test]
    fn boxes_by_stages_are_those_of_the_whole_functions() {
        let device = Device::flex();
        let data = test_data::dataset(1);
        let measured = &data.samples()[0].measured;
        for config in ModelConfig::in_little() {
            let detector = Detector::init(&config, 0, &device);
            let mut stages = Vec::new();
            let found = detect_by_stage(&detector, measured, 0.0, &device, &mut |stage| stages.push(stage));
            let input = Input::prepare(measured, &config, false, true).unwrap();
            let batch = Batch::stack(&[&input], &config, true, &device);
            let whole = detections(&detector.forward(&batch), &config, 0.0).concat();
            assert!(!whole.is_empty());
            assert_eq!((found.unwrap(), stages.len()), (whole, 12));
        }
    }
}
