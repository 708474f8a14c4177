//! What can be told of a run before its first step: pictures that the network cannot take, what nobody annotated, and settings
//! that leave something idle.
//!
//! Of data that are read as they are needed, the first episode stands for all; the pictures of the others are looked at when
//! they are read.

use std::borrow::Cow;
use std::collections::BTreeSet;

use super::config::TrainConfig;
use super::error::TrainError;
use crate::dataset::{Dataset, DatasetError, LabelledSample, SampleSource, episode_of_id};
use crate::episode::EpisodeReader;
use crate::model::{ImageTooFlat, PictureFit};
use crate::object::Kind;
use crate::sample::IgnoredRegion;

/// The data in memory, or else the first episode.
///
/// # Errors
/// The episode is broken.
pub fn at_hand(source: SampleSource<'_>) -> Result<Cow<'_, Dataset>, DatasetError> {
    match source {
        SampleSource::InMemory(dataset) => Ok(Cow::Borrowed(dataset)),
        SampleSource::OnDisk(split) => Ok(Cow::Owned(split.read(&[0])?)),
    }
}

/// Refuses pictures that the network cannot take, and warns of what the data leave out.
///
/// # Errors
/// As [`check_pictures`]; the first episode is broken.
pub fn check(source: SampleSource<'_>, config: &TrainConfig) -> Result<(), TrainError> {
    let data = at_hand(source)?;
    check_pictures(data.samples(), config)?;
    let place = match source {
        SampleSource::InMemory(_) => "",
        SampleSource::OnDisk(_) => "in the first episode, ",
    };
    for told in gaps(data.samples(), config) {
        tracing::warn!("{place}{told}");
    }
    Ok(())
}

/// Refuses pictures that are too flat for the crop, or that cannot be in one batch.
///
/// # Errors
/// [`TrainError::Input`] with the sample, [`TrainError::PictureHeights`] with two samples.
pub fn check_pictures(samples: &[LabelledSample], config: &TrainConfig) -> Result<(), TrainError> {
    if !config.model.use_camera {
        return Ok(());
    }
    let mut first: Option<(&str, usize)> = None;
    for sample in samples {
        let flat = |source| TrainError::Input { sample: sample.id.clone(), source };
        let fit = fit_of(sample, config).map_err(|error| flat(error.into()))?;
        let height_px = fit.height_px() as usize;
        let (one, one_px) = *first.get_or_insert((sample.id.as_str(), height_px));
        if height_px != one_px && config.batch_size > 1 {
            return Err(TrainError::PictureHeights {
                one: one.to_owned(),
                one_px,
                other: sample.id.clone(),
                other_px: height_px,
            });
        }
    }
    Ok(())
}

/// How a sample's picture fits the network; its size is that of its calibration, as the reader of episodes has checked.
fn fit_of(sample: &LabelledSample, config: &TrainConfig) -> Result<PictureFit, ImageTooFlat> {
    let camera = &sample.measured.intrinsics;
    PictureFit::of([camera.width_px, camera.height_px], &config.model.camera)
}

/// A sentence for each thing that these samples do not teach, although one may think so.
fn gaps(samples: &[LabelledSample], config: &TrainConfig) -> Vec<String> {
    let mut told = Vec::new();
    let is_cropped = |sample: &&LabelledSample| {
        config.model.use_camera && fit_of(sample, config).is_ok_and(|fit| fit.leaves_out_middle())
    };
    let mut cropped = samples.iter().filter(is_cropped);
    if let Some(first) = cropped.next() {
        let camera = &first.measured.intrinsics;
        told.push(format!(
            "the crop leaves out the middle row of {} of the {} pictures, so that what is far ahead is not seen; the first is sample {}, {} x {} px",
            1 + cropped.count(),
            samples.len(),
            first.id,
            camera.width_px,
            camera.height_px
        ));
    }
    let n_episodes = count_episodes(samples.iter());
    let lacking = Kind::ALL.into_iter().filter_map(|kind| {
        let lacks = |sample: &&LabelledSample| {
            sample.facts.labelled.as_ref().is_some_and(|labelled| !labelled.kinds.contains(&kind))
        };
        let n_lacking = count_episodes(samples.iter().filter(lacks));
        (n_lacking > 0).then(|| format!("{} in {n_lacking} of {n_episodes} episodes", kind.name()))
    });
    let lacking: Vec<String> = lacking.collect();
    if !lacking.is_empty() {
        told.push(format!(
            "these kinds are not annotated: {}; what stands there of them is learnt as nothing",
            lacking.join(", ")
        ));
    }
    let is_of_picture = |region: &IgnoredRegion| matches!(region, IgnoredRegion::Image { .. });
    let n_ignoring = samples.iter().filter(|sample| sample.facts.ignored.iter().any(is_of_picture)).count();
    if n_ignoring > 0 {
        told.push(format!(
            "ignored regions of the picture, which {n_ignoring} samples have, are not used: what they show is learnt as nothing"
        ));
    }
    told
}

fn count_episodes<'a>(samples: impl Iterator<Item = &'a LabelledSample>) -> usize {
    samples.map(|sample| episode_of_id(&sample.id)).collect::<BTreeSet<_>>().len()
}

/// Whether anybody annotated any sample; of data on disk the heads of the episodes tell.
///
/// # Errors
/// An episode is broken.
pub fn is_any_annotated(source: SampleSource<'_>) -> Result<bool, DatasetError> {
    match source {
        SampleSource::InMemory(dataset) => {
            Ok(dataset.samples().iter().any(|sample| !sample.facts.is_unlabelled))
        }
        SampleSource::OnDisk(split) => {
            for entry in split.episodes() {
                if EpisodeReader::open(&split.path().join(&entry.file))?.has_truth() {
                    return Ok(true);
                }
            }
            Ok(false)
        }
    }
}

/// A sentence for each setting that leaves idle what was asked for.
#[must_use]
pub fn idle_settings(config: &TrainConfig, n_devices: usize, has_validation: bool) -> Vec<String> {
    let mut told = Vec::new();
    if n_devices > config.accumulate {
        told.push(format!(
            "only {} of the {n_devices} devices are used: they share the batches of a step, and `accumulate` is {}",
            config.accumulate, config.accumulate
        ));
    }
    let [every, of_lidar, of_fused] =
        [config.validate_every_epochs, config.lidar_stage.epochs, config.fused_stage.epochs];
    if has_validation && every > of_lidar.max(of_fused) {
        told.push(format!(
            "the validation split is never scored: `validate_every_epochs` is {every}, and the stages have {of_lidar} and {of_fused} \
             epochs"
        ));
    }
    told
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::test_data;

    /// Three samples, of which the last has a picture of this height in pixels; the others have 160 x 90.
    fn with_height(height_px: u32) -> Dataset {
        let mut data = test_data::dataset(3);
        data.sample_mut(2).measured.intrinsics.height_px = height_px;
        data
    }

    #[test]
    fn pictures_of_two_heights_are_refused_where_a_batch_may_hold_both() {
        let mut config = TrainConfig::default();
        let told = |config: &TrainConfig| {
            check_pictures(with_height(120).samples(), config).err().map(|error| error.to_string())
        };
        let refused = told(&config).unwrap();
        for word in ["made/0", "made/2", "225", "300", "--set batch_size=1"] {
            assert!(refused.contains(word), "{word}: {refused}");
        }
        check_pictures(with_height(90).samples(), &config).unwrap();
        config.batch_size = 1;
        assert_eq!(told(&config), None);
        (config.batch_size, config.model.use_camera) = (2, false);
        assert_eq!(told(&config), None);
    }

    #[test]
    fn a_picture_too_flat_for_the_crop_is_named_and_one_that_loses_its_middle_is_told() {
        let config = TrainConfig::paper();
        let refused = check((&with_height(40)).into(), &config).unwrap_err().to_string();
        assert!(refused.contains("made/2") && refused.contains("at least 256 px"), "{refused}");
        check((&with_height(160)).into(), &config).unwrap();
        let told = gaps(with_height(160).samples(), &config).concat();
        assert!(told.contains("middle row of 1 of the 3") && told.contains("made/2, 160 x 160 px"), "{told}");
        assert!(gaps(with_height(90).samples(), &config).is_empty());
    }

    #[test]
    fn what_nobody_annotated_is_told() {
        let mut data = test_data::dataset(2);
        assert!(gaps(data.samples(), &TrainConfig::default()).is_empty());
        assert!(is_any_annotated((&data).into()).unwrap());
        let facts = &mut data.sample_mut(1).facts;
        facts.labelled = Some(toml::from_str("kinds = [\"vehicle\"]").unwrap());
        facts.ignored =
            vec![IgnoredRegion::Image { left_px: 0.0, top_px: 0.0, right_px: 9.0, bottom_px: 9.0 }];
        let told = gaps(data.samples(), &TrainConfig::default());
        assert_eq!(told.len(), 2, "{told:?}");
        assert!(told[0].contains("pedestrian in 1 of 1 episodes, static in 1 of 1"), "{told:?}");
        assert!(!told[0].contains("vehicle") && told[1].contains("which 1 samples have"), "{told:?}");
        (0..2).for_each(|i| data.sample_mut(i).facts.is_unlabelled = true);
        assert!(!is_any_annotated((&data).into()).unwrap());
    }

    #[test]
    fn idle_devices_and_a_validation_that_never_comes_are_told() {
        let mut config = TrainConfig::default();
        assert!(idle_settings(&config, config.accumulate, true).is_empty());
        assert_eq!(idle_settings(&config, config.accumulate + 1, true).len(), 1);
        config.validate_every_epochs = config.fused_stage.epochs + 1;
        assert!(idle_settings(&config, 1, true)[0].contains("never scored"));
        assert!(idle_settings(&config, 1, false).is_empty());
    }
}
