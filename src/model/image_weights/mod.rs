//! Pretrained Swin Transformer weights from other libraries' files: torchvision, timm, Microsoft, mmdet;
//! `.pth`, `.pt` or `.safetensors`, inside `state_dict` or `model`, behind a prefix such as `backbone.` or not.
//!
//! A file must fit the backbone in full. Only output norms may be missing, since classifiers have none; they then
//! keep their values. Keys outside the backbone's prefix (necks, heads, optimizers) are ignored.

mod file;
#[cfg(test)]
mod hostile_tests;
mod names;

use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};

use burn::store::{BurnToPyTorchAdapter, ModuleSnapshot, PyTorchToBurnAdapter, bridge};
use burn::tensor::{DType, TensorData};
use thiserror::Error;

use super::camera::Swin;
pub use names::Scheme;

/// Number of keys that an error lists; it counts the others.
const N_LISTED: usize = 8;

/// Why weights could not be loaded.
#[derive(Debug, Error)]
pub enum ImageWeightsError {
    #[error("cannot read the image weights: {0}")]
    Io(#[source] std::io::Error),
    #[error("the image weights are neither PyTorch's nor safetensors: {message}: {}", path.display())]
    Unreadable { message: String, path: PathBuf },
    #[error(
        "the image weights hold no Swin Transformer with names of torchvision (`features.0.0.weight`), timm or \
         Microsoft (`patch_embed.proj.weight`) or mmdet (`patch_embed.projection.weight`); they hold {}: {}",
        list(found), path.display()
    )]
    NoSwin { found: Vec<String>, path: PathBuf },
    /// Names with the file's prefix; a missing one has harmzone's name.
    #[error(
        "the image weights ({scheme} names) do not fit the backbone: missing {}; unexpected {}; of another shape {}: {}",
        list(missing), list(unexpected), list(misshapen), path.display()
    )]
    Unfit {
        scheme: Scheme,
        missing: Vec<String>,
        unexpected: Vec<String>,
        /// Names, each with the shape found and the shape needed.
        misshapen: Vec<Misshapen>,
        path: PathBuf,
    },
    #[error("the values of `{key}` cannot be read: {message}: {}", path.display())]
    Values { key: String, message: String, path: PathBuf },
}

/// A weight whose shape is not the backbone's.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Misshapen {
    pub key: String,
    pub found: Vec<usize>,
    pub needed: Vec<usize>,
}

impl fmt::Display for Misshapen {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {:?} (needed {:?})", self.key, self.found, self.needed)
    }
}

/// Lists the first items and counts the others.
fn list<T: fmt::Display>(items: &[T]) -> String {
    let first: Vec<String> = items.iter().take(N_LISTED).map(ToString::to_string).collect();
    match items.len() {
        0 => "none".into(),
        n if n > N_LISTED => format!("{} and {} more", first.join(", "), n - N_LISTED),
        _ => first.join(", "),
    }
}

/// The result of loading.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ImageWeightsReport {
    pub scheme: Scheme,
    /// Text in front of the backbone's keys.
    pub prefix: String,
    pub n_loaded: usize,
    /// Output norms that the file lacks and that keep their values, by harmzone's names.
    pub fresh: Vec<String>,
    /// Keys that the backbone does not need: classifiers, constants, other parts of a detector.
    pub unneeded: Vec<String>,
}

impl fmt::Display for ImageWeightsReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { scheme, prefix, n_loaded, .. } = self;
        write!(f, "{n_loaded} image weights loaded ({scheme} names, prefix `{prefix}`)")?;
        write!(f, "; left as they were: {}; not needed: {}", list(&self.fresh), list(&self.unneeded))
    }
}

/// Loads a Swin Transformer's weights from a file of another library.
///
/// # Errors
/// The file cannot be read, holds no Swin Transformer, or a name or shape does not fit. The backbone then stays as
/// it was.
pub fn load_image_weights(path: &Path, swin: &mut Swin) -> Result<ImageWeightsReport, ImageWeightsError> {
    let tensors = file::read(path)?;
    let Some((scheme, prefix)) = names::recognise(tensors.keys().map(String::as_str)) else {
        return Err(ImageWeightsError::NoSwin {
            found: tensors.into_keys().collect(),
            path: path.to_owned(),
        });
    };
    let (mut found, mut unneeded) = (BTreeMap::new(), Vec::new());
    for (key, tensor) in &tensors {
        let name = key.strip_prefix(&prefix).and_then(|key| scheme.translate(key, &swin.out_stages()));
        match name {
            Some(name) => _ = found.insert(name, (key, tensor)),
            None => unneeded.push(key.clone()),
        }
    }

    let needed = weights_of(swin);
    let (mut missing, mut fresh, mut misshapen) = (Vec::new(), Vec::new(), Vec::new());
    for (name, shape) in &needed {
        match found.get(name) {
            Some((_, tensor)) if tensor.shape.as_slice() == shape => {}
            Some((key, tensor)) => misshapen.push(Misshapen {
                key: (*key).clone(),
                found: tensor.shape.to_vec(),
                needed: shape.clone(),
            }),
            None if name.starts_with("norms.") => fresh.push(name.clone()),
            None => missing.push(name.clone()),
        }
    }
    let surplus = found.iter().filter(|(name, _)| !needed.contains_key(*name));
    let mut unexpected: Vec<String> = surplus.map(|(_, (key, _))| (*key).clone()).collect();
    if !missing.is_empty() || !unexpected.is_empty() || !misshapen.is_empty() {
        unexpected.sort();
        return Err(ImageWeightsError::Unfit {
            scheme,
            missing,
            unexpected,
            misshapen,
            path: path.to_owned(),
        });
    }

    let mut weights = Vec::with_capacity(found.len());
    for (name, (key, tensor)) in &found {
        let mut values = file::values(tensor).map_err(|message| ImageWeightsError::Values {
            key: (*key).clone(),
            message,
            path: path.to_owned(),
        })?;
        if scheme == Scheme::Mmdet && name.contains(".merge.") {
            values = by_neighbour(&values, *tensor.shape.as_slice().last().expect("a weight has an axis"));
        }
        weights.push(bridge::from_data(TensorData::new(values, needed[name].clone()), name.clone(), None));
    }
    let n_loaded = weights.len();
    let applied = swin.apply(weights, None, Some(Box::new(PyTorchToBurnAdapter)), false);
    assert!(applied.errors.is_empty() && applied.applied.len() == n_loaded, "names and shapes were checked");
    Ok(ImageWeightsReport { scheme, prefix, n_loaded, fresh, unneeded })
}

/// Names and shapes of the backbone's weights, as PyTorch has them.
fn weights_of(swin: &Swin) -> BTreeMap<String, Vec<usize>> {
    let tensors = swin.collect(None, Some(Box::new(BurnToPyTorchAdapter)), false);
    let floats = tensors.into_iter().filter(|tensor| tensor.dtype == DType::F32);
    floats.map(|tensor| (tensor.name, tensor.shape.to_vec())).collect()
}

/// Reorders the merged channels of `[.., 4 * channel]` values from mmdet's order (channel, row, column) to ours
/// (column, row, channel).
fn by_neighbour(values: &[f32], n_merged: usize) -> Vec<f32> {
    let n_channels = n_merged / 4;
    let of_row = |row: &[f32]| -> Vec<f32> {
        let value = |ours: usize| {
            let (neighbour, channel) = (ours / n_channels, ours % n_channels);
            let (column, line) = (neighbour / 2, neighbour % 2);
            row[channel * 4 + line * 2 + column]
        };
        (0..n_merged).map(value).collect()
    };
    values.chunks(n_merged).flat_map(of_row).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::test_device;
    use crate::model::config::ModelConfig;
    use crate::model::golden::formula::{fill, named_weights, tensor};
    use crate::model::golden::{Golden, values};
    use burn::store::PathFilter;

    /// The backbone that `tests/golden/torch_swin.py` wrote weights of.
    fn small() -> Swin {
        let [_, paper] = ModelConfig::in_little();
        Swin::init(&paper.camera.swin.swin, &test_device())
    }

    fn golden_file(name: &str) -> PathBuf {
        Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden").join(name)
    }

    #[test]
    fn weights_of_every_library_give_the_same_maps() {
        let golden = Golden::read("swin");
        for (name, scheme, prefix, n_fresh, n_unneeded) in [
            ("swin_weights_torchvision.pth", Scheme::Torchvision, "model.", 6, 4 + 6),
            ("swin_weights_timm.safetensors", Scheme::Timm, "", 6, 4),
            ("swin_weights_mmdet.pth", Scheme::Mmdet, "state_dict.backbone.", 0, 1),
            ("swin_weights_microsoft.pt", Scheme::Microsoft, "", 0, 0),
        ] {
            let mut swin = small();
            let report = load_image_weights(&golden_file(name), &mut swin).unwrap();
            assert_eq!((report.scheme, report.prefix.as_str()), (scheme, prefix), "{name}");
            assert_eq!(
                (report.fresh.len(), report.unneeded.len()),
                (n_fresh, n_unneeded),
                "{name}: {report}"
            );
            assert_eq!(report.n_loaded + n_fresh, named_weights(&swin).len());
            if n_fresh > 0 {
                // Classifiers hold no output norms: these are the formula's in the script.
                let mut whole = small();
                fill(&mut whole);
                let norms = PathFilter::new().with_regex("^norms");
                let _ = swin.apply(whole.collect(Some(norms), None, false), None, None, false);
            }
            let maps = swin.forward(tensor("image", [2, 3, 37, 50], &test_device()));
            for (i, map) in maps.into_iter().enumerate() {
                golden.check(&format!("map{i}"), &map);
            }
        }
    }

    #[test]
    fn every_key_that_does_not_fit_is_named_and_the_backbone_stays() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("weights.safetensors");
        let bytes = fs_err::read(golden_file("swin_weights_timm.safetensors")).unwrap();
        let file = safetensors::SafeTensors::deserialize(&bytes).unwrap();
        let mut views: BTreeMap<String, _> = file.tensors().into_iter().collect();
        views.remove("layers.1.blocks.0.norm1.weight").unwrap();
        let bias = views["layers.0.blocks.0.norm1.bias"].clone();
        views.insert("absolute_pos_embed".into(), bias.clone());
        views.insert("layers.0.blocks.2.norm1.bias".into(), bias.clone());
        views.insert("layers.3.blocks.0.attn.relative_position_bias_table".into(), bias);
        fs_err::write(&path, safetensors::serialize(&views, None).unwrap()).unwrap();

        let mut swin = small();
        let before = values(swin.forward(tensor("image", [1, 3, 8, 8], &test_device()))[0].clone());
        let error = load_image_weights(&path, &mut swin).unwrap_err();
        let text = error.to_string();
        let ImageWeightsError::Unfit { missing, unexpected, misshapen, .. } = error else { panic!("{text}") };
        assert_eq!(missing, ["stages.1.blocks.0.norm1.weight"]);
        assert_eq!(unexpected, ["absolute_pos_embed", "layers.0.blocks.2.norm1.bias"]);
        let key = "layers.3.blocks.0.attn.relative_position_bias_table".into();
        assert_eq!(misshapen, [Misshapen { key, found: vec![4], needed: vec![25, 4] }]);
        assert!(text.contains(
            "of another shape layers.3.blocks.0.attn.relative_position_bias_table [4] (needed [25, 4])"
        ));
        assert_eq!(values(swin.forward(tensor("image", [1, 3, 8, 8], &test_device()))[0].clone()), before);
    }

    #[test]
    fn files_that_hold_no_swin_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("weights.pth");
        let load = |bytes: &[u8]| {
            fs_err::write(&path, bytes).unwrap();
            load_image_weights(&path, &mut small()).unwrap_err()
        };
        assert!(matches!(load(b"not a pickle"), ImageWeightsError::Unreadable { .. }));
        let other = include_bytes!("../../../tests/golden/lss_fpn.safetensors");
        let error = load(other);
        assert!(matches!(&error, ImageWeightsError::NoSwin { .. }), "{error}");
        assert!(error.to_string().contains("gradient.levels.0.lateral.conv.weight"), "{error}");
        fs_err::remove_file(&path).unwrap();
        assert!(matches!(load_image_weights(&path, &mut small()), Err(ImageWeightsError::Io(_))));
    }
}
